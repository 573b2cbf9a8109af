"""Which server is chosen: trees of fake programs stand for PostgreSQL in all the places it may be."""

import fcntl
import os
import pwd
import shutil
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from patience import WAIT_S

from conflictdb.embedded import discovery
from conflictdb.embedded.account import Account
from conflictdb.embedded.discovery import Server, find_server, machine_directories
from conflictdb.embedded.options import Settings
from conflictdb.errors import ServerError

MYSELF = Account(pwd.getpwuid(os.getuid()).pw_name, os.getuid(), os.getgid())
SYSTEM_PROGRAMS = ("sh", "cat", "sleep")


def program(path: Path, script: str) -> None:
    """Write an executable shell script."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


class FakeMachine:
    """A machine whose PATH and places for servers are directories of a test."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.said: list[str] = []
        self.settings = Settings(home=root / "home", cache=root / "cache", download=False)

    def server(self, place: str, version: str, postgis: str | None = "3.5.0", btree_gist: bool = True) -> Path:
        """Put a server into `place`/bin and return that directory."""
        base = self.root / place
        program(base / "bin/postgres", f'echo "postgres (PostgreSQL) {version}"')
        program(base / "bin/initdb", "")
        program(base / "bin/pg_config", f"echo {base}/share")
        extensions = base / "share/extension"
        extensions.mkdir(parents=True)
        if postgis:
            (extensions / "postgis.control").write_text(f"default_version = '{postgis}'\n")
        if btree_gist:
            (extensions / "btree_gist.control").write_text("default_version = '1.7'\n")
        return base / "bin"

    def unpacked(self, major: int, system: str = "debian-12") -> Path:
        """Put an unpacked tree into the cache and return its directory of programs."""
        name = f"cache/{system}-{os.uname().machine}-postgresql-{major}"
        server = f"{name}/root/usr/lib/postgresql/{major}"
        self.server(server, f"{major}.1")
        for library in ("postgis-3", "btree_gist", "plpgsql"):
            (self.root / server / "lib").mkdir(exist_ok=True)
            (self.root / server / "lib" / f"{library}.so").touch()
        (self.root / name / "packages.txt").touch()
        return self.root / server / "bin"

    def find(self, major: int | None = None, **changed: object) -> Server:
        """Look for a server as `embedded` does."""
        places = {"home": self.settings.home, "cache": self.settings.cache, "download": self.settings.download}
        return find_server(Settings(**{**places, **changed}), MYSELF, major, self.said.append)  # type: ignore[arg-type]


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> FakeMachine:
    """Return a machine without any server, whose ldd finds every library."""
    for name in SYSTEM_PROGRAMS:
        (tmp_path / "system").mkdir(exist_ok=True)
        (tmp_path / "system" / name).symlink_to(str(shutil.which(name)))
    program(tmp_path / "system/ldd", "echo 'libc.so.6 => /lib/libc.so.6'")
    monkeypatch.setenv("PATH", f"{tmp_path}/system:{tmp_path}/onpath/bin")
    for name in ("CONDA_PREFIX", "VIRTUAL_ENV"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(discovery, "PLACES", (f"{tmp_path}/usr/lib/postgresql/*/bin", f"{tmp_path}/usr/pgsql-*/bin"))
    return FakeMachine(tmp_path)


def words(error: Exception) -> str:
    """Return the text of an error without its line breaks."""
    return " ".join(str(error).split())


def test_nothing_found_says_where_it_looked_and_what_helps(machine: FakeMachine) -> None:
    """The error names every place, why each server will not do, and one command for each kind of machine."""
    bare = machine.server("usr/lib/postgresql/16", "16.4", postgis=None)
    old = machine.server("usr/lib/postgresql/13", "13.9")
    older = machine.server("usr/pgsql-15", "15.2", postgis="3.2.1")
    lacking = machine.server("onpath", "17.0", btree_gist=False)
    with pytest.raises(ServerError) as caught:
        machine.find()
    text = words(caught.value)
    assert f"{bare}: PostgreSQL 16.4, but without postgis" in text
    assert f"{old}: PostgreSQL 13.9 is older than 14" in text
    assert f"{older}: PostgreSQL 15.2, but PostGIS 3.2.1 is older than 3.3" in text
    assert f"{lacking}: PostgreSQL 17.0, but without btree_gist" in text
    for place in ("conda and virtual environment", "PATH", f"{machine.root}/usr/pgsql-*/bin", f"{machine.root}/cache"):
        assert place in text
    for remedy in (
        "apt-get install postgresql-postgis",
        "brew install",
        "conda install",
        "docker run",
        "CONFLICTDB_DSN",
    ):
        assert remedy in text


def test_download_turned_off_is_said(machine: FakeMachine) -> None:
    """CONFLICTDB_NO_DOWNLOAD is named as the reason why nothing was fetched, on a machine that could."""
    for name in ("apt-get", "apt-cache", "apt-config", "dpkg", "dpkg-deb", "dpkg-query"):
        program(machine.root / "system" / name, "exit 100")
    with pytest.raises(ServerError, match="package archive: turned off by CONFLICTDB_NO_DOWNLOAD"):
        machine.find(download=False)
    assert machine.said == []


def test_archive_out_of_reach_is_said(machine: FakeMachine) -> None:
    """Without a network the error carries apt's first complaint, and nothing half-made is left in the cache."""
    for name in ("apt-cache", "apt-config", "dpkg-deb", "dpkg-query"):
        program(machine.root / "system" / name, "exit 0")
    program(machine.root / "system/dpkg", "echo amd64")
    program(machine.root / "system/apt-get", "echo 'W: Failed to fetch: no route' >&2")
    with pytest.raises(ServerError) as caught:
        machine.find(download=True)
    said = "offers no postgresql-*-postgis-3; apt says: W: Failed to fetch: no route"
    assert f"package archive: {said}" in words(caught.value)
    assert len(machine.said) == 1
    assert "CONFLICTDB_NO_DOWNLOAD=1 turns this off" in machine.said[0]
    with pytest.raises(ServerError, match="offers no postgresql-14-postgis-3"):
        machine.find(major=14, download=True)


def test_highest_major_version_wins(machine: FakeMachine) -> None:
    """The newest suitable server is taken; versions compare as numbers."""
    machine.server("usr/lib/postgresql/14", "14.1")
    best = machine.server("usr/pgsql-100", "100.2")
    machine.server("onpath", "16.3")
    machine.server("usr/lib/postgresql/101", "101.1", postgis=None)
    found = machine.find()
    assert (found.bin, found.major, found.version, found.origin) == (best, 100, "100.2", "machine")


def test_active_environment_goes_before_path_and_system(machine: FakeMachine, monkeypatch: pytest.MonkeyPatch) -> None:
    """Among equals the order is conda, virtual environment, PATH, the system's places."""
    expected = [machine.server(place, "16.1") for place in ("conda", "venv", "onpath", "usr/lib/postgresql/16")]
    monkeypatch.setenv("CONDA_PREFIX", str(machine.root / "conda"))
    monkeypatch.setenv("VIRTUAL_ENV", str(machine.root / "venv"))
    assert list(machine_directories()) == expected
    assert machine.find().bin == expected[0]


def test_links_lead_to_the_real_server(machine: FakeMachine) -> None:
    """A program linked into PATH stands for the directory it really is in, which is listed once."""
    real = machine.server("usr/lib/postgresql/16", "16.1")
    for name in ("postgres", "initdb"):
        (machine.root / "onpath/bin").mkdir(parents=True, exist_ok=True)
        (machine.root / "onpath/bin" / name).symlink_to(real / name)
    assert list(machine_directories()) == [real]


def test_existing_data_want_their_own_version(machine: FakeMachine) -> None:
    """A data directory of an older version gets a server of that version, and an error if there is none."""
    machine.server("usr/lib/postgresql/17", "17.1")
    own = machine.server("usr/lib/postgresql/15", "15.7")
    assert machine.find(major=15).bin == own
    with pytest.raises(
        ServerError, match=r"are of PostgreSQL 16, and no PostgreSQL 16 with PostGIS was found"
    ) as caught:
        machine.find(major=16)
    assert "17.1 with PostGIS, but the data need version 16" in words(caught.value)
    assert "CONFLICTDB_HOME" in words(caught.value)


@pytest.mark.parametrize("kind", ["absent", "without postgis", "other version"])
def test_wrong_pg_bin_is_an_error(machine: FakeMachine, kind: str) -> None:
    """CONFLICTDB_PG_BIN is the only place then: a good server in another place does not help."""
    machine.server("onpath", "16.1")
    given = {
        "absent": lambda: machine.root / "nowhere/bin",
        "without postgis": lambda: machine.server("given", "16.1", postgis=None),
        "other version": lambda: machine.server("given", "16.1"),
    }[kind]()
    with pytest.raises(ServerError, match=f"CONFLICTDB_PG_BIN={given} will not do"):
        machine.find(major=15 if kind == "other version" else None, pg_bin=given)


def test_pg_bin_goes_before_the_machine(machine: FakeMachine) -> None:
    """CONFLICTDB_PG_BIN is taken although the machine has a newer server."""
    machine.server("onpath", "17.1")
    given = machine.server("given", "16.1")
    found = machine.find(pg_bin=given)
    assert (found.bin, found.origin) == (given, "CONFLICTDB_PG_BIN")


def test_cache_serves_when_the_machine_has_nothing(machine: FakeMachine) -> None:
    """A tree unpacked earlier is used, with its libraries and PROJ data in the server's environment only."""
    unpacked = machine.unpacked(15)
    found = machine.find()
    assert (found.bin, found.origin) == (unpacked, "cache")
    assert found.environ["PROJ_DATA"].endswith("root/usr/share/proj")
    assert "PROJ_DATA" not in os.environ
    machine.server("onpath", "14.1")
    assert machine.find().origin == "machine"


def test_tree_with_missing_libraries_is_refused(machine: FakeMachine) -> None:
    """A tree that was unpacked for another system, so that libraries are missing, is named and not used."""
    machine.unpacked(15)
    program(machine.root / "system/ldd", "echo 'libgeos_c.so.1 => not found'")
    with pytest.raises(ServerError) as caught:
        machine.find()
    assert "unpacked earlier, no longer runs here: libgeos_c.so.1" in words(caught.value)


def test_half_unpacked_tree_is_not_used(machine: FakeMachine) -> None:
    """The leftovers of a killed fetch have another name than a complete tree."""
    machine.unpacked(15).parents[5].rename(machine.root / "cache/fetch-1.part")
    with pytest.raises(ServerError, match=r"nothing\s+unpacked"):
        machine.find()


def test_second_fetch_waits_and_takes_what_the_first_brought(machine: FakeMachine) -> None:
    """Two processes that need the packages at once fetch them once."""
    for name in ("apt-get", "apt-cache", "apt-config", "dpkg", "dpkg-deb", "dpkg-query"):
        program(machine.root / "system" / name, "exit 100")
    (machine.root / "cache").mkdir()
    waits = threading.Event()
    found: list[Server] = []

    def say(line: str) -> None:
        machine.said.append(line)
        waits.set()

    def second() -> None:
        found.append(find_server(Settings(machine.root / "home", machine.root / "cache"), MYSELF, None, say))

    with (machine.root / "cache/lock").open("a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        thread = threading.Thread(target=second)
        thread.start()
        assert waits.wait(WAIT_S)
        machine.unpacked(15)
    thread.join(WAIT_S)
    assert [server.origin for server in found] == ["cache"]
    assert machine.said == ["another process is fetching PostgreSQL with PostGIS: waiting for it"]


def test_failed_fetch_leaves_nothing(machine: FakeMachine) -> None:
    """Neither its own files nor those of a process that was killed while it fetched."""
    for name in ("apt-get", "apt-cache", "apt-config", "dpkg", "dpkg-deb", "dpkg-query"):
        program(machine.root / "system" / name, "exit 100")
    (machine.root / "cache/fetch-left.part/root").mkdir(parents=True)
    with pytest.raises(ServerError, match="package archive"):
        find_server(Settings(machine.root / "home", machine.root / "cache"), MYSELF, None, machine.said.append)
    assert not list((machine.root / "cache").glob("*.part"))


def test_foreign_settings_do_not_reach_the_server(machine: FakeMachine, monkeypatch: pytest.MonkeyPatch) -> None:
    """Variables of PostgreSQL, PROJ and the locale that the user has set are not the server's."""
    for name in ("PGDATA", "PGPORT", "PROJ_LIB", "LC_ALL", "LANG"):
        monkeypatch.setenv(name, "alien")
    machine.server("onpath", "16.1")
    assert "alien" not in machine.find().environ.values()


SETTINGS: list[tuple[dict[str, str], Callable[[Settings], object], object]] = [
    ({"CONFLICTDB_HOME": "/somewhere"}, lambda s: s.home, Path("/somewhere")),
    ({"CONFLICTDB_HOME": "relative"}, lambda s: s.home, Path.cwd() / "relative"),
    ({"CONFLICTDB_PG_BIN": "/pg/bin"}, lambda s: s.pg_bin, Path("/pg/bin")),
    ({"CONFLICTDB_PG_BIN": ""}, lambda s: s.pg_bin, None),
    ({"CONFLICTDB_NO_DOWNLOAD": "1"}, lambda s: s.download, False),
    ({"CONFLICTDB_NO_DOWNLOAD": ""}, lambda s: s.download, True),
    ({"CONFLICTDB_NO_DOWNLOAD": "0"}, lambda s: s.download, True),
    ({}, lambda s: s.download, True),
]


@pytest.mark.parametrize(("environ", "read", "expected"), SETTINGS)
def test_settings_come_from_the_environment(
    environ: dict[str, str], read: Callable[[Settings], object], expected: object
) -> None:
    """Each variable changes its setting; an empty variable is ignored."""
    assert read(Settings.from_environment({"HOME": "/home/somebody", **environ})) == expected


def test_default_places_are_the_users_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """An ordinary user's data are below its home directory, those of root below /var."""
    monkeypatch.setattr(os, "geteuid", lambda: 1234)
    settings = Settings.from_environment({"HOME": "/home/somebody"})
    assert settings.home == Path("/home/somebody/.local/share/conflictdb/default")
    assert settings.cache == Path("/home/somebody/.cache/conflictdb")
    with pytest.raises(ServerError, match="user 1234 has no home directory"):
        Settings.from_environment({"HOME": ""})
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    settings = Settings.from_environment({"HOME": "/root"})
    assert settings.home == Path("/var/lib/conflictdb/default")
    assert settings.cache == Path("/var/cache/conflictdb")
