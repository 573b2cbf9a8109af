"""Servers whose files a test may change: a tree of links to an installed server, and copies of files that locate it."""

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from conflictdb import embedded as server
from conflictdb.embedded.account import account_for
from conflictdb.embedded.discovery import Server, find_server
from conflictdb.embedded.options import Settings
from conflictdb.errors import ServerError


def local_server() -> Server:
    """The PostgreSQL with PostGIS of this machine; without one the test says that it did not run."""
    home = Path(tempfile.gettempdir())
    settings = replace(Settings.from_environment(home=home), download=False)
    try:
        return find_server(settings, account_for(home), None, lambda _: None)
    except ServerError as error:
        pytest.skip(f"did not run: no server of this machine ({error})")


def linked(original: Server, to: Path) -> Path:
    """Lay out an installation of its own, and return its programs; a server finds its files from where it is itself."""
    directories = {name: Path(_configured(original, name)) for name in ("bindir", "sharedir", "pkglibdir")}
    prefix = Path(os.path.commonpath(directories.values()))
    usr = to / "root" / "usr"  # as in trees of unpacked packages
    copied = {name: usr / path.relative_to(prefix) for name, path in directories.items()}
    _link_members(directories["bindir"], copied["bindir"], but=["postgres", "initdb", "pg_config"])
    for program in ("postgres", "initdb", "pg_config"):
        shutil.copy2(directories["bindir"] / program, copied["bindir"])
    copied["pkglibdir"].symlink_to(directories["pkglibdir"])
    _link_members(directories["sharedir"], copied["sharedir"], but=["extension"])
    _link_members(directories["sharedir"] / "extension", copied["sharedir"] / "extension")
    if original.tree is not None:
        (to / "packages.txt").symlink_to(original.tree.path / "packages.txt")
        (usr / "share" / "proj").symlink_to(prefix / "share" / "proj")
        for libraries in (prefix / "lib").glob("*-linux-gnu*"):
            (usr / "lib" / libraries.name).symlink_to(libraries)
    return copied["bindir"]


def _configured(original: Server, name: str) -> str:
    command = [original.bin / "pg_config", f"--{name}"]
    return subprocess.run(command, check=True, capture_output=True, text=True, env=original.environ).stdout.strip()


def _link_members(original: Path, to: Path, but: list[str] | None = None) -> None:
    to.mkdir(parents=True)
    for member in original.iterdir():
        if member.name not in (but or []):
            (to / member.name).symlink_to(member)


@contextmanager
def own_installation() -> Iterator[tuple[Path, server.EmbeddedServer]]:
    """Run a server from files of its own; give the directory of its programs, and the server."""
    original = local_server()
    directory = Path(tempfile.mkdtemp(prefix="conflictdb-installed-"))
    directory.chmod(0o755)  # as root the tests run the server as another user
    try:
        programs = linked(original, directory)
        settings = Settings(directory / "home", directory, pg_bin=programs)
        with server.embedded(durable=False, settings=settings) as running:
            yield programs, running
        while server.status(settings=settings).pid is not None:
            time.sleep(0.01)
    finally:
        shutil.rmtree(directory, ignore_errors=True)
