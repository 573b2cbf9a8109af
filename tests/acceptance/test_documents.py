"""What README and docs print runs as printed: commands and Python on the embedded database, SQL in it."""

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest

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
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture
def folder() -> Iterator[Path]:
    """Return a directory whose ./run is the program under test; the server's user may pass through it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        script = folder / "run"
        script.write_text(
            f"""#!/bin/sh
            if [ "$1" = python ]; then shift && exec "{sys.executable}" "$@"; fi
            CONFLICTDB_PROGRAM=$0 exec "{sys.executable}" -m conflictdb "$@"
            """
        )
        script.chmod(0o755)
        yield folder


# All in one test: each block builds on what the one before left, as it does for a reader.
@pytest.mark.usefixtures("server_dsn")  # makes sure that programs are there, fetched if need be
def test_readme_runs_as_printed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The README's commands, SQL and Python run one after the other on a fresh embedded database."""
    monkeypatch.setenv("CONFLICTDB_HOME", str(folder / "home"))
    first, second, own = blocks("README.md", "sh")
    assert commands(first) == ["./run demo", "./run test"]
    shell("./run server start", folder)
    try:
        told = shell("./run demo", folder)
        assert "FERRY" in told
        next_commands = told.partition("Try next:\n")[2].splitlines()
        assert all(command.startswith("  ./run ") for command in next_commands)
        for command in next_commands:
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


def test_integration_sql_runs_as_printed(conn: psycopg.Connection) -> None:
    """The SQL of docs/integration.md and docs/operations.md runs on a database with the schema."""
    for document in ("docs/integration.md", "docs/operations.md"):
        for block in blocks(document, "sql"):
            for statement in filter(str.strip, block.split(";\n")):
                conn.execute(statement.encode())


def test_integration_python_runs_as_printed(tmp_path: Path) -> None:
    """Objects of a file to conflicts in a file, without a database."""
    (tmp_path / "mine.geojson").write_bytes((ROOT / "conflictdb/scenes/strait.geojson").read_bytes())
    (python,) = blocks("docs/integration.md", "python")
    done = subprocess.run([sys.executable, "-c", python], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    features = json.loads((tmp_path / "conflicts.geojson").read_text())["features"]
    assert "FERRY" in {feature["properties"]["b_key"] for feature in features}
    assert (tmp_path / "approaches.csv").read_text().count("\n") == len(features) + 1
