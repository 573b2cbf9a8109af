"""What README and docs print runs as printed: commands, SQL and Python, on an embedded database.

The README's first programs start as users start them, and so do those for a database of the user's own. The other
programs are forked from one that has imported libraries.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from databases import server_directory
from forked import forking
from patience import WAIT_S

from conflictdb import connect, read

ROOT = Path(__file__).resolve().parents[2]


def blocks(document: str, language: str) -> list[str]:
    text = (ROOT / document).read_text()
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


def commands(block: str) -> list[str]:
    lines = (re.sub(r"\s+#.*", "", line) for line in block.splitlines())
    return [line for line in lines if line.strip()]


def shell(command: str, folder: Path, **more: str) -> str:
    done = subprocess.run(
        ["/bin/sh", "-c", command],
        cwd=folder,
        env={**os.environ, **more},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def page_served(command: list[str], folder: Path) -> str:
    """Start a command that prints its address and serves until it is ended, and return its page."""
    with subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            with urllib.request.urlopen(process.stdout.readline().strip(), timeout=WAIT_S) as answer:  # noqa: S310 our own
                return answer.read().decode()  # type: ignore[no-any-return]
        finally:
            process.terminate()


@contextmanager
def folder_of(python: str, conflictdb: str) -> Iterator[Path]:
    """Make a directory whose ./run is the program under test; the server's user may pass through it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        (folder / "bin").mkdir()
        write_programs(folder, python, conflictdb)
        yield folder


def write_programs(folder: Path, python: str, conflictdb: str) -> None:
    """Write ./run and bin/conflictdb, which start these programs."""
    scripts = {
        "run": f"""if [ "$1" = python ]; then shift && exec {python} "$@"; fi
                   CONFLICTDB_PROGRAM=$0 exec {conflictdb} "$@" """,
        "bin/conflictdb": f'exec {conflictdb} "$@"',
    }
    for name, script in scripts.items():
        (folder / name).write_text(f"#!/bin/sh\n{script}\n")
        (folder / name).chmod(0o755)


@pytest.fixture
def folder() -> Iterator[Path]:
    """Return a directory whose ./run starts programs as users do."""
    with folder_of(sys.executable, f"{sys.executable} -m conflictdb") as folder:
        yield folder


@pytest.fixture(scope="module")
def forks() -> Iterator[str]:
    """Return the words before a program that is forked."""
    with tempfile.TemporaryDirectory() as name, forking(Path(name, "socket")) as words:
        yield words


@pytest.fixture
def forked_folder(forks: str) -> Iterator[Path]:
    """Return a directory whose ./run forks programs."""
    with folder_of(forks, f"{forks} conflictdb") as folder:
        yield folder


@contextmanager
def home_of_nothing() -> Iterator[Path]:
    """Name a directory for an embedded database, which is not there yet."""
    with tempfile.TemporaryDirectory(dir=server_directory()) as name:
        Path(name).chmod(0o755)
        yield Path(name) / "home"


@pytest.fixture
def new_home() -> Iterator[Path]:
    """Return a directory for an embedded database, which is not there yet."""
    with home_of_nothing() as home:
        yield home


# All in one test: each block builds on the state after the previous one, as for a reader.
@pytest.mark.usefixtures("server_dsn")  # makes sure that the server's programs are installed
def test_readme_runs_as_printed(folder: Path, forks: str, new_home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The README's commands, SQL and Python run one after the other on a fresh embedded database."""
    monkeypatch.setenv("CONFLICTDB_HOME", str(new_home))
    first, second, own = blocks("README.md", "sh")
    assert commands(first) == ["./run demo", "./run detect my.geojson", "./run map"]
    (folder / "my.geojson").write_bytes((ROOT / "conflictdb/scenes/strait.geojson").read_bytes())
    shell("./run server start", folder)
    try:
        told = shell("./run demo", folder)
        assert told.startswith("Your own plans: ./run detect my.geojson ")
        assert 0 < told.index("FERRY") < told.index("4 solver")
        assert "FERRY" in shell("./run detect my.geojson", folder)
        assert "<title>conflictdb" in page_served(["./run", "map"], folder)
        write_programs(folder, forks, f"{forks} conflictdb")
        next_commands = told.partition("Try next:\n")[2].splitlines()
        assert all(command.startswith("  ./run ") for command in next_commands)
        for command in next_commands:
            if "./run map" in command:
                assert "<title>conflictdb" in page_served(command.partition("#")[0].split(), folder)
            else:
                shell(command, folder)
        for command in commands(second):
            shell(command, folder)
        assert "FIRING" in (folder / "mine.geojson").read_text()
        assert "`./run psql` opens" in (ROOT / "README.md").read_text()
        (sql,) = blocks("README.md", "sql")
        for statement in filter(str.strip, sql.split(";\n")):
            (folder / "query.sql").write_text(statement)
            assert shell("./run psql -v ON_ERROR_STOP=1 -At -f query.sql", folder).strip(), statement
        shell("./run worker --once", folder)
        assert "REGATTA" in shell("./run conflicts --scene strait", folder)
        python, in_memory = blocks("README.md", "python")
        (folder / "example.py").write_text(python)
        assert "`./run python example.py` runs this" in (ROOT / "README.md").read_text()
        assert "conflicts in" in shell("./run python example.py", folder)
        (folder / "example.py").write_text(in_memory)
        assert shell("./run python example.py", folder).startswith("FIRING FERRY conflict 2026-06-01 09:")
    finally:
        shell("./run server stop", folder)
    assert [line.split()[0] for line in commands(own)] == ["pip", "conflictdb", "conflictdb", "conflictdb"]


def test_own_database_runs_as_printed(folder: Path, empty_dsn: str) -> None:
    """The README's commands for a database of the user's own, and the worker once, run on one without the schema."""
    program = str(Path(sys.executable).parent)
    path = {"PATH": f"{program}:{os.environ['PATH']}", "DSN": empty_dsn}
    (folder / "my.geojson").write_bytes((ROOT / "conflictdb/scenes/strait.geojson").read_bytes())
    _, init, detect, worker = commands(blocks("README.md", "sh")[2])
    shell(init, folder, **path)
    assert "FERRY" in shell(detect, folder, **path)
    shell(f"{worker} --once", folder, **path)


def test_files_of_the_reference_are_read(tmp_path: Path) -> None:
    """The scene file of docs/reference/files.md is one, also with the properties of its other examples."""
    scene, changes = blocks("docs/reference/files.md", "json")
    file = json.loads(scene)
    (track,) = (feature for feature in file["features"] if feature["id"] == "T1")
    track["geometry"]["coordinates"].pop()
    properties = [
        json.loads(f"{{{part}}}")["properties"] for part in re.split(r",?\n(?=\"properties\")", changes.strip())
    ]
    assert len(properties) == 2
    for k, given in enumerate(properties):
        file["features"].append({**track, "id": f"T{k + 2}", "properties": given})
    file["features"].remove(track)
    (tmp_path / "plain.json").write_text(scene)
    (tmp_path / "changing.json").write_text(json.dumps(file))
    for name in ("plain", "changing"):
        assert len(read(tmp_path / f"{name}.json").tracks) == (1 if name == "plain" else 2)


def test_fifteen_tasks_are_one_command_each() -> None:
    """The test below runs the page as printed; this test counts 15 tasks, each with exactly one command."""
    text = (ROOT / "docs/tutorial/fifteen-tasks.md").read_text()
    _, *tasks = re.split(r"^## ", text, flags=re.MULTILINE)
    assert len(tasks) == 15
    for task in tasks:
        (block,) = re.findall(r"^```sh\n(.*?)^```", task, flags=re.DOTALL | re.MULTILINE)
        lines = [line for line in block.splitlines() if line.startswith("./run ")]
        assert len(lines) == 1, task


PAGES = sorted(
    str(path.relative_to(ROOT)) for part in ("tutorial", "how-to") for path in (ROOT / "docs" / part).glob("*")
)


def test_pages_call_the_program_in_one_way() -> None:
    """The commands of how-to pages and tutorials begin with ./run, which needs no installation."""
    for page in PAGES:
        for block in re.findall(r"^```(?:sh|console)?\n(.*?)^```", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE):
            assert not re.findall(r"^(?:.*\| )?conflictdb .*", block, re.MULTILINE), page


def test_the_page_on_the_map_stays_short() -> None:
    """It has at most 900 words: the page itself shows the rest."""
    assert len((ROOT / "docs/how-to/see-the-map.md").read_text().split()) <= 900


# In an output as printed: an ellipsis is anything, times taken and numbers of runs are any.
VARIES = {"…": r"(?:.|\n)*?", "ms": r"\d+ ms", "run": r"run \d+, [\d.]+ s"}


def as_pattern(text: str) -> str:
    """Return a regular expression for an output as printed."""
    parts = re.split(r"(…|\d+ ms|run \d+, [\d.]+ s)", as_compared(text))
    kinds = (part if part == "…" else "ms" if part.endswith("ms") else "run" for part in parts[1::2])
    return "".join(
        a + b for a, b in zip(map(re.escape, parts[::2]), [*(VARIES[kind] for kind in kinds), ""], strict=True)
    )


def as_compared(text: str) -> str:
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


@pytest.fixture(scope="module")
def home(_server: object) -> Iterator[Path]:
    """Return the home of an embedded database that runs."""
    with home_of_nothing() as home:
        name = home.parent
        server = f"{sys.executable} -m conflictdb server"
        shell(f"{server} start", name, CONFLICTDB_HOME=str(home))
        yield home
        shell(f"{server} stop", name, CONFLICTDB_HOME=str(home))


@pytest.mark.parametrize("page", PAGES)
def test_page_runs_as_printed(
    page: str, forked_folder: Path, home: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands, SQL and Python of a page run in order on an empty database, and print what is below them."""
    folder = forked_folder
    monkeypatch.setenv("CONFLICTDB_HOME", str(home))
    if "$DSN" in (ROOT / page).read_text():  # few pages need a server of the reader's own
        monkeypatch.setenv("DSN", request.getfixturevalue("empty_dsn"))
    monkeypatch.setenv("PATH", f"{folder / 'bin'}:{Path(sys.executable).parent}:{os.environ['PATH']}")
    monkeypatch.setenv("PGTZ", "UTC")
    with connect() as db:
        db.connection.execute("DELETE FROM conflictdb.scene")
        db.connection.commit()
    background = []
    printed: str | None = None
    as_whom = " -U postgres" if "`./run psql -U postgres`" in (ROOT / page).read_text() else ""
    try:
        for language, block in re.findall(r"^```(\w+)\n(.*?)^```", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE):
            if language == "text" and printed is not None:
                found = as_compared(printed)
                assert re.fullmatch(as_pattern(block), found), f"{page} says\n{block}\nbut it is\n{found}"
                printed = None
            elif language == "sh" and block.endswith("&\n"):
                background.append(subprocess.Popen(block.split()[:-1], cwd=folder, stderr=subprocess.DEVNULL))
            elif language == "sh":
                printed = shell(f"set -e\n{block}", folder)
            elif language == "sql":
                (folder / "query.sql").write_text(f"\\pset footer off\n{block}")
                printed = shell(f"./run psql{as_whom} -q -v ON_ERROR_STOP=1 -f query.sql", folder)
            elif language == "python":
                (folder / "example.py").write_text(block)
                printed = shell("./run python example.py", folder)
            else:
                printed = None
    finally:
        for process in background:
            process.terminate()
            process.wait(WAIT_S)
