"""Fetch PostgreSQL with PostGIS from the machine's own Debian or Ubuntu archive into a cache.

Nothing is installed and no root is needed: apt works on a private state, and the packages it has verified are unpacked,
not configured. Packages that the machine has (above all its C library) are not fetched.
"""

import fcntl
import os
import platform
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

# Seconds for one apt or dpkg command; a fetch takes 6 to 9 s, more on a slow line.
COMMAND_TIMEOUT_S: Final = 900.0

# Never fetched: present on every Debian system, useful only to an installed server, or needed only by unused parts
# (GDAL: rasters; LLVM: jit, which is off; SFCGAL: solids).
_NOT_FETCHED: Final = re.compile(
    r"^(libgdal|libllvm|libsfcgal|perl|postgresql-common|postgresql-client-common|ssl-cert|debconf|adduser|ucf|locales"
    r"|libc6$|libgcc|gcc-|libc-bin|lsb-base|netbase|init-system|tzdata|sensible-utils|dpkg|tar$|logrotate|systemd"
    r"|passwd)"
)
_CONSTRAINT: Final = re.compile(r"^(?P<name>[^\s(:]+)(?::\S+)?\s*(?:\((?P<relation>[<>=]+)\s*(?P<version>[^)]+)\))?")


class FetchError(Exception):
    """The packages could not be fetched, or do not run here; the message is for the user."""


@dataclass(frozen=True, slots=True)
class Tree:
    """An unpacked server: `path` contains the packages' files below `root` and their list in `packages.txt`."""

    path: Path

    @property
    def bin(self) -> Path | None:
        """Return the directory of its programs, None if it has none."""
        return next(iter(sorted((self.path / "root/usr/lib/postgresql").glob("*/bin"))), None)

    @property
    def environ(self) -> dict[str, str]:
        """Return the environment of its programs, for the server's processes only."""
        root = self.path / "root"
        libraries = [*sorted(root.glob("usr/lib/*-linux-gnu*")), *sorted(root.glob("lib/*-linux-gnu*"))]
        proj = str(root / "usr/share/proj")
        return {"LD_LIBRARY_PATH": ":".join(map(str, libraries)), "PROJ_DATA": proj, "PROJ_LIB": proj}

    def missing_libraries(self) -> list[str]:
        """Return the shared libraries that its programs and extensions need and this machine lacks."""
        if self.bin is None:
            return ["postgres"]
        names = ("bin/postgres", "bin/initdb", "lib/postgis-3.so", "lib/btree_gist.so", "lib/plpgsql.so")
        files = [self.bin.parent / name for name in names]
        absent = [file.name for file in files if not file.exists()]
        if absent:
            return absent
        answer = subprocess.run(
            ["ldd", *files],
            env={**os.environ, **self.environ, "LC_ALL": "C"},
            capture_output=True,
            text=True,
            check=False,
        )
        lines = (answer.stdout + answer.stderr).splitlines()
        missing = {line.strip() for line in lines if "not found" in line or "not a dynamic executable" in line}
        return sorted(re.sub(r" => .*", "", line) for line in missing)


def tree_of(directory: Path) -> Tree | None:
    """Return the unpacked tree of a directory of programs, None if it is in none."""
    above = directory.parents
    return Tree(above[5]) if len(above) > 5 and (above[5] / "packages.txt").is_file() else None


def unpacked_trees(cache: Path) -> list[Tree]:
    """Return the complete trees of the cache for this kind of machine, newest system first."""
    pattern = f"*-{platform.machine()}-postgresql-*"
    paths = [path for path in cache.glob(pattern) if path.suffix != ".part"] if cache.is_dir() else []
    return [Tree(path) for path in sorted(paths, reverse=True)]


def why_not_fetch() -> str | None:
    """Return why this machine has no archive to fetch from, None if it has one."""
    if platform.system() != "Linux":
        return "only Debian and Ubuntu have an archive to fetch from"
    needed = ("apt-get", "apt-cache", "apt-config", "dpkg", "dpkg-deb", "dpkg-query", "ldd")
    absent = [name for name in needed if shutil.which(name) is None]
    return f"this is not Debian or Ubuntu: no {absent[0]}" if absent else None


@contextmanager
def locked(cache: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Lock the cache; report if another process has it locked, and wait.

    Raises
    ------
    FetchError
        The cache cannot be written.
    """
    try:
        if not cache.exists():
            cache.mkdir(parents=True, exist_ok=True)
            if os.geteuid() == 0:  # another user runs what root unpacks
                cache.chmod(0o755)
        file = (cache / "lock").open("a")
    except OSError as error:
        raise FetchError(f"{cache} cannot be written: {error.strerror}") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("another process is fetching PostgreSQL with PostGIS: waiting for it")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def fetch(cache: Path, major: int | None) -> Tree:
    """Fetch and unpack PostgreSQL of a major version (None: the newest) with PostGIS; call it under `locked`.

    Raises
    ------
    FetchError
        No archive, no network, no such version, or libraries are missing.
    """
    reason = why_not_fetch()
    if reason:
        raise FetchError(reason)
    for left in cache.glob("fetch-*.part"):  # left by killed processes
        shutil.rmtree(left, ignore_errors=True)
    try:
        # A unique name: children of a killed process may still write into theirs.
        part = Path(tempfile.mkdtemp(".part", "fetch-", cache))
        try:
            return _fetched(part, cache, major)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise FetchError(f"fetching failed: {error}") from error


def _fetched(part: Path, cache: Path, major: int | None) -> Tree:
    apt = _PrivateApt.prepare(part)
    complaints = apt.update()
    found = _newest_major(apt, major)
    if found is None:
        missing_package = "postgresql-*-postgis-3" if major is None else f"postgresql-{major}-postgis-3"
        raise FetchError(f"offers no {missing_package}" + (f"; apt says: {complaints}" if complaints else ""))
    names = _closure(apt, found)
    apt.unpack(names)
    tree = _finish(part, found)
    final = cache / f"{_system_name()}-{platform.machine()}-postgresql-{found}"
    missing = tree.missing_libraries()
    if missing:
        raise FetchError(f"the unpacked PostgreSQL {found} misses {', '.join(missing)}")
    # A tree of that name exists only if it no longer runs (the caller has checked, under the same lock).
    shutil.rmtree(final, ignore_errors=True)
    part.rename(final)
    return Tree(final)


def _system_name() -> str:
    release = platform.freedesktop_os_release()
    return f"{release.get('ID', 'linux')}-{release.get('VERSION_ID', 'rolling')}"


@dataclass(frozen=True, slots=True)
class _PrivateApt:
    """The machine's apt with its sources, keys and proxies, but with its own state, cache and no hooks."""

    part: Path
    options: tuple[str, ...]

    @classmethod
    def prepare(cls, part: Path) -> "_PrivateApt":
        for name in ("state/lists/partial", "cache/archives/partial", "debs", "root"):
            (part / name).mkdir(parents=True)
        for place in (part, part / "root"):
            place.chmod(0o755)
        targets = subprocess.run(
            ["apt-config", "dump", "Acquire::IndexTargets"], capture_output=True, text=True, check=False
        ).stdout
        unused = set(re.findall(r"^Acquire::IndexTargets::(\S+?::\S+?)::", targets, re.M)) - {"deb::Packages"}
        # Hooks would change the system (some delete its package cache); other indexes are large and not needed.
        clear = ["APT::Update::Pre-Invoke", "APT::Update::Post-Invoke", "APT::Update::Post-Invoke-Success"]
        clear += [f"Acquire::IndexTargets::{name}" for name in sorted(unused)]
        config = part / "apt.conf"
        config.write_text("".join(f"#clear {name};\n" for name in [*clear, "APT::Architectures"]))
        arch = _output(["dpkg", "--print-architecture"]).strip()
        options = {
            "Dir::State": f"{part}/state",
            "Dir::State::status": "/var/lib/dpkg/status",
            "Dir::Cache": f"{part}/cache",
            "Debug::NoLocking": "1",
            "APT::Architectures::": arch,
            "APT::Sandbox::User": "",
            # A dead source costs seconds, not minutes, and does not stop the others.
            "Acquire::Retries": "1",
            "Acquire::http::Timeout": "15",
            "Acquire::https::Timeout": "15",
        }
        return cls(part, ("-c", str(config), *(f"-o{key}={value}" for key, value in options.items())))

    def update(self) -> str:
        """Fetch the package lists; return the first complaint, empty if there is none."""
        answer = _run(["apt-get", *self.options, "-q", "update"])
        complaints = [line for line in answer.stderr.splitlines() if line.startswith(("E:", "W:", "Err:"))]
        return complaints[0] if complaints else ""

    def search(self, pattern: str) -> list[str]:
        return [line.split()[0] for line in self._cache("search", "--names-only", pattern).splitlines()]

    def show(self, names: Sequence[str]) -> list[dict[str, str]]:
        """Return the records of the candidate versions of packages; missing packages are left out."""
        text = self._cache("show", "--no-all-versions", *names)
        return [dict(re.findall(r"^([A-Z][\w-]*): (.*)$", record, re.M)) for record in text.split("\n\n") if record]

    def unpack(self, names: Sequence[str]) -> None:
        """Download packages, verified by apt, and unpack them below `root`."""
        answer = _run(["apt-get", *self.options, "-q", "download", *names], cwd=self.part / "debs")
        if answer.returncode:
            raise FetchError(f"the packages could not be downloaded: {_last_lines(answer.stderr)}")
        for file in sorted((self.part / "debs").iterdir()):
            answer = _run(["dpkg-deb", "-x", str(file), str(self.part / "root")])
            if answer.returncode:
                raise FetchError(f"{file.name} could not be unpacked: {_last_lines(answer.stderr)}")
        versions = (file.stem + "\n" for file in sorted((self.part / "debs").iterdir()))
        (self.part / "packages.txt").write_text("".join(versions))

    def _cache(self, *command: str) -> str:
        # Its exit code also reports unknown names, which are not an error here.
        return _run(["apt-cache", *self.options, *command]).stdout


def _newest_major(apt: _PrivateApt, major: int | None) -> int | None:
    """Return the newest major version with server and PostGIS in the archive, or `major` if it is there."""
    names = apt.search(r"^postgresql-[0-9]+(-postgis-3)?$")
    servers = {name for name in names if not name.endswith("-postgis-3")}
    offered = [int(name.split("-")[1]) for name in names if name.removesuffix("-postgis-3") in servers - {name}]
    return max((number for number in offered if major in (None, number)), default=None)


def _closure(apt: _PrivateApt, major: int) -> list[str]:
    """Return the packages to unpack: the server, PostGIS, and their dependencies that the machine lacks."""
    server = f"postgresql-{major}"
    wave = [server, f"postgresql-client-{major}", f"{server}-postgis-3", f"{server}-postgis-3-scripts", "proj-data"]
    installed = _installed()
    chosen: dict[str, None] = {}
    seen = set(wave)
    while wave:
        records = apt.show(wave)
        chosen |= dict.fromkeys(record["Package"] for record in records)
        wave = []
        for record in records:
            depends = ",".join(record[field] for field in ("Pre-Depends", "Depends") if field in record)
            for clause in filter(None, map(str.strip, depends.split(","))):
                alternatives = [_CONSTRAINT.match(text.strip()) for text in clause.split("|")]
                known = [match for match in alternatives if match]
                if any(_is_there(match, installed, seen) for match in known):
                    continue
                seen.add(known[0]["name"])
                wave.append(known[0]["name"])
    return list(chosen)


def _is_there(dependency: re.Match[str], installed: Mapping[str, str], seen: set[str]) -> bool:
    name, relation, version = dependency["name"], dependency["relation"], dependency["version"]
    if name in seen or _NOT_FETCHED.match(name):
        return True
    if name not in installed:
        return False
    if relation is None:
        return True
    return _run(["dpkg", "--compare-versions", installed[name], relation, version]).returncode == 0


def _installed() -> dict[str, str]:
    rows = _output(["dpkg-query", "-W", "-f", "${Package} ${Version} ${db:Status-Abbrev}\n"]).splitlines()
    return {row.split()[0]: row.split()[1] for row in rows if row.split()[2:] == ["ii"]}


def _finish(part: Path, major: int) -> Tree:
    """Rename control files as CREATE EXTENSION expects, and remove files that a server does not read."""
    root = part / "root"
    # Debian's maintainer scripts make these links; packages that are only unpacked lack them.
    for control in (root / f"usr/share/postgresql/{major}/extension").glob("*-3.control"):
        shutil.copy(control, control.with_name(control.name.replace("-3.control", ".control")))
    for name in ("state", "cache", "debs"):
        shutil.rmtree(part / name)
    (part / "apt.conf").unlink()
    for name in ("locale", "doc", "man", "lintian"):
        shutil.rmtree(root / "usr/share" / name, ignore_errors=True)
    return Tree(part)


def _run(command: Sequence[str], cwd: Path | None = None) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command,
        cwd=cwd,
        env={**os.environ, "LC_ALL": "C"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=COMMAND_TIMEOUT_S,
        check=False,
    )


def _output(command: Sequence[str]) -> str:
    answer = _run(command)
    if answer.returncode:
        raise FetchError(f"{command[0]} failed: {_last_lines(answer.stderr)}")
    return answer.stdout


def _last_lines(text: str) -> str:
    return " ".join(text.strip().splitlines()[-3:])
