"""The account that the server runs under: PostgreSQL refuses to run as root."""

import os
import pwd
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from conflictdb.errors import ServerError


@dataclass(frozen=True, slots=True)
class Account:
    """User that runs the server; `switch` is what subprocess needs to become it (nothing when it is this user)."""

    name: str
    uid: int
    gid: int

    @property
    def switch(self) -> dict[str, Any]:
        """Return the arguments that make subprocess run a program as this user."""
        if os.geteuid() == self.uid:
            return {}
        return {"user": self.uid, "group": self.gid, "extra_groups": []}

    def run(
        self,
        command: Sequence[str | Path],
        environ: Mapping[str, str],
        timeout_s: float | None = None,
        cwd: Path = Path("/"),
    ) -> "subprocess.CompletedProcess[str]":
        """Run a program as this user to its end; its output and errors come together in `stdout`.

        Raises
        ------
        OSError
            It cannot be executed by this user.
        subprocess.TimeoutExpired
            It took longer than `timeout_s`, in seconds.
        """
        return subprocess.run(
            command,
            env=environ,
            cwd=cwd,
            timeout=timeout_s,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            check=False,
            **self.switch,
        )


def account_for(home: Path) -> Account:
    """Return who runs the server of a home: this user; for root the owner of its data, else postgres, else nobody.

    Raises
    ------
    ServerError
        There is no such user, or it has no name (initdb asks for one).
    """
    uid = os.geteuid()
    if uid != 0:
        return _named(uid, "run as a user with a name (an entry in /etc/passwd)")
    for place in (home / "data", home):
        try:
            owner = place.stat().st_uid
        except FileNotFoundError:
            continue
        if owner != 0:
            return _named(owner, f"it owns {place}; give that to a user with a name")
    for name in ("postgres", "nobody"):
        try:
            entry = pwd.getpwnam(name)
        except KeyError:
            continue
        return Account(name, entry.pw_uid, entry.pw_gid)
    raise ServerError("PostgreSQL does not run as root, and there is no user postgres or nobody: run as another user")


def _named(uid: int, remedy: str) -> Account:
    try:
        entry = pwd.getpwuid(uid)
    except KeyError:
        raise ServerError(f"user {uid} has no name, and PostgreSQL needs one: {remedy}") from None
    return Account(entry.pw_name, uid, entry.pw_gid)
