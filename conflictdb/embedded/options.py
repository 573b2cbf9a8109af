"""Determine the places of the embedded database and its programs.

Only this module reads CONFLICTDB_HOME, CONFLICTDB_PG_BIN and CONFLICTDB_NO_DOWNLOAD.
"""

import os
import pwd
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from conflictdb.errors import ServerError


@dataclass(frozen=True, slots=True)
class Settings:
    """Places of the embedded database.

    home : directory of the cluster, its socket and its log
    cache : directory of unpacked server packages
    pg_bin : the only directory to take PostgreSQL from, if given
    download : whether packages may be fetched when the machine has no PostgreSQL with PostGIS
    """

    home: Path
    cache: Path
    pg_bin: Path | None = None
    download: bool = True

    @classmethod
    def from_environment(cls, environ: Mapping[str, str] = os.environ, home: Path | None = None) -> Self:
        """Return the settings of this user; `home` overrides CONFLICTDB_HOME.

        Raises
        ------
        ServerError
            The user has no home directory to keep the database in, and none is given.
        """
        given = home or environ.get("CONFLICTDB_HOME") or None
        pg_bin = environ.get("CONFLICTDB_PG_BIN") or None
        return cls(
            home=Path(given).absolute() if given else _user_directory(environ, "/var/lib", ".local/share") / "default",
            cache=_user_directory(environ, "/var/cache", ".cache"),
            pg_bin=Path(pg_bin).absolute() if pg_bin else None,
            download=environ.get("CONFLICTDB_NO_DOWNLOAD", "") in ("", "0"),
        )


def _user_directory(environ: Mapping[str, str], of_root: str, of_user: str) -> Path:
    if os.geteuid() == 0:
        return Path(of_root, "conflictdb")
    home = environ.get("HOME")
    if not home:
        try:
            home = pwd.getpwuid(os.geteuid()).pw_dir
        except KeyError:
            raise ServerError(
                f"user {os.geteuid()} has no home directory to keep the embedded database in: set HOME"
            ) from None
    return Path(home, of_user, "conflictdb").absolute()
