"""The account that the server runs under: PostgreSQL refuses to run as root.

Root reads only regular files that this account owns, as text, and runs only programs that no other account can change.
"""

import errno
import os
import pwd
import stat
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from conflictdb.errors import ServerError

#: Bytes that are read of a file of the account.
_LONGEST_TEXT_BYTES: Final = 100_000


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

    def text_of(self, path: Path, start: int = 0) -> str:
        """Return the text of a file of this user from a byte on, 100,000 bytes at most.

        Raises
        ------
        FileNotFoundError
            There is no regular file of this user: none, a link, a FIFO, or a file of another account.
        """
        absent = FileNotFoundError(errno.ENOENT, f"no file of {self.name}", str(path))
        try:
            file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise absent if error.errno == errno.ELOOP else error from None
        try:
            state = os.fstat(file)
            if not stat.S_ISREG(state.st_mode) or state.st_uid != self.uid:
                raise absent
            return os.pread(file, _LONGEST_TEXT_BYTES, start).decode(errors="replace")
        finally:
            os.close(file)

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
    """Return who runs the server of a home: this user; for root its owner, else postgres, else nobody.

    Raises
    ------
    ServerError
        There is no such user, or it has no name (initdb asks for one).
    """
    uid = os.geteuid()
    if uid != 0:
        return _named(uid, "run as a user with a name (an entry in /etc/passwd)")
    for place in (home, home / "data"):  # in a home of another account, that account may exchange its data
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


def is_safe_program(path: Path) -> bool:
    """Return whether root may run a program: nobody else can change it, a directory above it, or a link to it."""
    if os.geteuid() != 0:
        return True
    places = {path, *path.parents}
    try:
        real = path.resolve(strict=True)
        states = [place.lstat() for place in places | {real, *real.parents}]
    except (OSError, RuntimeError):
        return False
    return all(map(_is_of_root, states))


def _is_of_root(state: os.stat_result) -> bool:
    mode = state.st_mode
    writable = bool(mode & stat.S_IWOTH) or (bool(mode & stat.S_IWGRP) and state.st_gid != 0)
    keeps_names = stat.S_ISDIR(mode) and bool(mode & stat.S_ISVTX)
    return state.st_uid == 0 and (stat.S_ISLNK(mode) or not writable or keeps_names)


def _named(uid: int, remedy: str) -> Account:
    try:
        entry = pwd.getpwuid(uid)
    except KeyError:
        raise ServerError(f"user {uid} has no name, and PostgreSQL needs one: {remedy}") from None
    return Account(entry.pw_name, uid, entry.pw_gid)
