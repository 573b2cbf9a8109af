"""Find the PostgreSQL with PostGIS for the embedded database.

In this order: CONFLICTDB_PG_BIN alone; servers on the machine (highest major version); a tree unpacked earlier into the
cache; downloaded packages of Debian or Ubuntu; else an error with the places searched and remedies. An existing data
directory needs a server of its own major version.
"""

import os
import re
import subprocess
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from conflictdb.embedded import packages
from conflictdb.embedded.account import Account, is_safe_program
from conflictdb.embedded.options import Settings
from conflictdb.embedded.packages import FetchError, Tree
from conflictdb.errors import ServerError

MINIMUM_POSTGRESQL: Final = 14
MINIMUM_POSTGIS: Final = (3, 3)

# Where packagers put servers, besides PATH and the active environments.
PLACES: Final = (
    "/usr/lib/postgresql/*/bin",
    "/usr/pgsql-*/bin",
    "/opt/homebrew/opt/postgresql@*/bin",
    "/usr/local/opt/postgresql@*/bin",
    "/home/linuxbrew/.linuxbrew/opt/postgresql@*/bin",
    "/opt/homebrew/bin",
    "/usr/local/bin",
    "/Applications/Postgres.app/Contents/Versions/*/bin",
    "/opt/local/lib/postgresql*/bin",
    "/usr/local/pgsql/bin",
    "/usr/bin",
)

#: Seconds that `postgres --version` may take on a loaded machine.
_PROBE_TIMEOUT_S: Final = 30.0

_REMEDIES: Final = """\
Any one of these helps:
  Debian, Ubuntu   sudo apt-get install postgresql-postgis
  macOS            brew install postgis
  conda            conda install -c conda-forge postgis
  Docker           docker run -d -p 127.0.0.1:5432:5432 -e POSTGRES_PASSWORD=secret postgis/postgis
                   export CONFLICTDB_DSN=postgresql://postgres:secret@127.0.0.1:5432/postgres
  own server       export CONFLICTDB_DSN=postgresql://USER@HOST/DATABASE (with PostGIS), or use --dsn"""


@dataclass(frozen=True, slots=True)
class Server:
    """Programs of one PostgreSQL that has PostGIS.

    bin : directory of `postgres` and `initdb`
    version : of PostgreSQL, as it reports it: `15.18`
    postgis : version of PostGIS that CREATE EXTENSION gives
    origin : `machine`, `cache` (unpacked earlier) or `fetched`
    tree : the unpacked tree it is from, if any
    """

    bin: Path
    version: str
    postgis: str
    origin: str
    tree: Tree | None = None

    @property
    def major(self) -> int:
        """Return the major version, which determines the data directories it can open."""
        return int(re.split(r"\D", self.version, maxsplit=1)[0])

    @property
    def environ(self) -> dict[str, str]:
        """Return the environment of its processes."""
        return server_environ(self.tree)

    def __str__(self) -> str:
        return f"PostgreSQL {self.version} with PostGIS {self.postgis} ({self.origin}: {self.bin})"


@dataclass(frozen=True, slots=True)
class Psql:
    """The client program psql, and its environment."""

    path: Path
    environ: Mapping[str, str]


def psql_of(settings: Settings, programs: Path | None) -> Psql | None:
    """Return psql from the directory of a server's programs, else from PATH, the machine's servers, or the cache.

    Root passes over programs that another account can change.
    """
    places = [programs] if programs else []
    places += [Path(place) for place in os.get_exec_path()]
    places += [directory for place in PLACES for directory in _matching(place)]
    places += [tree.bin for tree in packages.unpacked_trees(settings.cache) if tree.bin]
    for directory in places:
        if os.access(directory / "psql", os.X_OK) and is_safe_program(directory / "psql"):
            tree = packages.tree_of(directory)
            return Psql(directory / "psql", tree.environ if tree else {})
    return None


@dataclass(slots=True)
class _Search:
    """The places searched, for the error message."""

    major: int | None
    account: Account
    lines: list[str] = field(default_factory=list)

    def best(self, places: Iterator[tuple[Path, Tree | None]], origin: str) -> Server | None:
        """Return the suitable server of the highest major version, the first of equals; note all others."""
        suitable: list[Server] = []
        for directory, tree in places:
            found = self.inspect(directory, origin, tree)
            if isinstance(found, Server):
                suitable.append(found)
            else:
                self.lines.append(f"{directory}: {found}")
        return max(suitable, key=lambda server: server.major, default=None)

    def inspect(self, directory: Path, origin: str, tree: Tree | None = None) -> Server | str:
        """Return the server in a directory, or why it is unsuitable."""
        version = self._ask([directory / "postgres", "--version"], tree)
        match = re.search(r"\) (\d+\S*)", version)
        if match is None:
            return f"postgres does not run as user {self.account.name}: {' '.join(version.split()[:40])}"
        number = match[1]
        major = int(re.split(r"\D", number, maxsplit=1)[0])
        if major < MINIMUM_POSTGRESQL:
            return f"PostgreSQL {number} is older than {MINIMUM_POSTGRESQL}"
        extensions = self._extensions(directory, major, tree)
        absent = [name for name in ("postgis", "btree_gist") if not (extensions / f"{name}.control").is_file()]
        if absent:
            return f"PostgreSQL {number}, but without {' and '.join(absent)}"
        control = (extensions / "postgis.control").read_text(errors="replace")
        found = re.search(r"^default_version\s*=\s*'((\d+)\.(\d+)[^']*)'", control, re.M)
        if found is None or (int(found[2]), int(found[3])) < MINIMUM_POSTGIS:
            minimum = ".".join(map(str, MINIMUM_POSTGIS))
            return f"PostgreSQL {number}, but PostGIS {found[1] if found else '?'} is older than {minimum}"
        if self.major not in (None, major):
            return f"PostgreSQL {number} with PostGIS, but the data need version {self.major}"
        missing = tree.missing_libraries() if tree else []
        if missing:
            return f"unpacked earlier, no longer runs here: {', '.join(missing)}"
        return Server(directory, number, found[1], origin, tree)

    def _extensions(self, directory: Path, major: int, tree: Tree | None) -> Path:
        shared = self._ask([directory / "pg_config", "--sharedir"], tree).strip()
        guesses = [f"../share/postgresql/{major}", f"../../../../share/postgresql/{major}", "../share/postgresql"]
        guesses += [f"../share/postgresql@{major}", "../share"]
        shares = [Path(shared)] if shared.startswith("/") else []
        shares += [Path(os.path.normpath(directory / guess)) for guess in guesses]
        places = [share / "extension" for share in shares]
        return next((place for place in places if place.is_dir()), places[-1])

    def _ask(self, command: list[str | Path], tree: Tree | None) -> str:
        try:
            return self.account.run(command, server_environ(tree), _PROBE_TIMEOUT_S).stdout
        except (OSError, subprocess.TimeoutExpired) as error:
            return str(error)


def server_environ(tree: Tree | None) -> dict[str, str]:
    """Return the environment of server processes: without PG* variables and foreign PROJ or GDAL data."""
    alien = ("PG", "PROJ_", "GDAL_", "LC_", "LANG")
    environ = {name: value for name, value in os.environ.items() if not name.startswith(alien)}
    return {**environ, "LC_ALL": "C", **(tree.environ if tree else {})}


def machine_directories(environ: Mapping[str, str] = os.environ) -> Iterator[Path]:
    """Yield the directories on this machine that contain `postgres` and `initdb`, each once, in order of preference."""
    named = [Path(environ[name], "bin") for name in ("CONDA_PREFIX", "VIRTUAL_ENV") if environ.get(name)]
    named += [Path(place) for place in environ.get("PATH", "").split(os.pathsep) if place.startswith("/")]
    for place in PLACES:
        named += _matching(place)
    seen = set()
    for directory in named:
        try:
            # Packagers link the programs into one directory; the target has the rest of the server beside it.
            real = (directory / "postgres").resolve(strict=True).parent
        except OSError:
            continue
        if real not in seen and all(os.access(real / name, os.X_OK) for name in ("postgres", "initdb")):
            seen.add(real)
            yield real


def _matching(place: str) -> list[Path]:
    """Return the directories that match a pattern of PLACES, highest version first."""
    return sorted(Path("/").glob(place.lstrip("/")), key=_numbers, reverse=True)


def _numbers(path: Path) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", str(path))]


def find_server(settings: Settings, account: Account, major: int | None, say: Callable[[str], None]) -> Server:
    """Return the server to use, downloaded if needed.

    Parameters
    ----------
    settings : Settings
        Places to search, and permissions.
    account : Account
        The user who must be able to run it.
    major : int or None
        Major version of the existing data; None takes the highest.
    say : callable
        Called with a line before a download.

    Raises
    ------
    ServerError
        No server was found; the text lists the places searched and remedies.
    """
    search = _Search(major, account)
    if settings.pg_bin is not None:
        found = search.inspect(settings.pg_bin, "CONFLICTDB_PG_BIN", packages.tree_of(settings.pg_bin))
        if isinstance(found, Server):
            return found
        raise ServerError(f"CONFLICTDB_PG_BIN={settings.pg_bin} will not do: {found}")
    server = search.best(((directory, None) for directory in machine_directories()), "machine")
    if server is None:
        search.lines.append("conda and virtual environment, PATH: nothing else")
        search.lines.append(f"{', '.join(PLACES)}: nothing else")
        server = _in_cache(settings, search)
    if server is None:
        server = _fetched(settings, search, say)
    if server is None:
        raise ServerError(_not_found(settings, search))
    return server


def _in_cache(settings: Settings, search: _Search) -> Server | None:
    trees = packages.unpacked_trees(settings.cache)
    if not trees:
        search.lines.append(f"{settings.cache}: nothing unpacked")
    return search.best(((tree.bin or tree.path, tree) for tree in trees), "cache")


def _fetched(settings: Settings, search: _Search, say: Callable[[str], None]) -> Server | None:
    reason = packages.why_not_fetch()
    if reason is None and not settings.download:
        reason = "turned off by CONFLICTDB_NO_DOWNLOAD"
    try:
        if reason is not None:
            raise FetchError(reason)
        with packages.locked(settings.cache, say):
            # Another process may have fetched it while this one waited.
            server = _in_cache(settings, _Search(search.major, search.account))
            if server is not None:
                return server
            say(
                "no PostgreSQL with PostGIS here: fetching this system's own packages into"
                f" {settings.cache} (about 40 MB, once; CONFLICTDB_NO_DOWNLOAD=1 turns this off)"
            )
            tree = packages.fetch(settings.cache, search.major)
        return search.best(iter([(tree.bin or tree.path, tree)]), "fetched")
    except FetchError as error:
        search.lines.append(f"package archive: {error}")
    return None


def _not_found(settings: Settings, search: _Search) -> str:
    found = f"No PostgreSQL ({MINIMUM_POSTGRESQL} or newer) with PostGIS (3.3 or newer) was found."
    if search.major is not None:
        found = (
            f"The data in {settings.home} are of PostgreSQL {search.major}, and no PostgreSQL {search.major} with"
            " PostGIS was found.\nInstall that version, or start afresh: set CONFLICTDB_HOME to another directory."
        )
    return "\n".join([found, "Looked at:", *map(_indented, search.lines), _REMEDIES])


def _indented(line: str) -> str:
    return textwrap.fill(
        line, 118, initial_indent="  ", subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )
