"""`status`, `init`, `upgrade`, `server`, exit codes and how errors look."""

import ast
import logging
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psycopg
import pytest
from commands import STRAIT, Run, runner
from patience import WAIT_S

import conflictdb
from conflictdb.cli import main
from conflictdb.errors import SchemaTooNew
from conflictdb.jobs import schema

# What no list needs, and what it may import from the rooms of solvers and files.
_LIBRARIES = {"numpy", "scipy", "shapely", "alembic", "sqlalchemy", "pyarrow", "pandas", "lxml", "http"}
_ROOMS = {"arrays", "core", "earth", "exchange", "formats", "kernel", "map", "memory", "plot", "spark"}
_RANKS = {"conflictdb.core", "conflictdb.core.memory_budget", "conflictdb.core.ranking"}
_TEXT = {"conflictdb.formats", "conflictdb.formats.json_text"}
_WRITERS = _TEXT | {"conflictdb.formats.conflict_text", "conflictdb.formats.writing"}


def program(*words: str, **environ: str) -> "subprocess.CompletedProcess[str]":
    """Run a command as a program of its own."""
    command = [sys.executable, "-m", "conflictdb", *words]
    environment = {**os.environ, **environ}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=WAIT_S, check=False)


def test_status_of_an_empty_database(run: Run, dsn: str) -> None:
    done = run("status")
    assert done.code == 0
    assert "PostGIS" in done.out
    assert "no scenes" in done.out
    assert run("status", "--format", "json").json["scenes"] == []


def test_status_shows_objects_pending_changes_and_last_run(run: Run) -> None:
    run("load", STRAIT)
    (scene,) = run("status", "--format", "json").json["scenes"]
    assert (scene["areas"], scene["tracks"], scene["pending"], scene["run_id"]) == (4, 7, 11, None)
    assert "never detected" in run("status").out
    run("detect", "--scene", "strait")
    (scene,) = run("status", "--format", "json").json["scenes"]
    assert (scene["pending"], scene["conflicts"], scene["error"]) == (0, 7, None)
    assert scene["finished_at"].endswith("Z")
    assert run("status").out.splitlines()[-1].split()[-1] == "done"


def test_a_database_without_schema_is_exit_3_until_init(empty_dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    run = runner(empty_dsn, capsys)
    for words in (("status",), ("load", STRAIT), ("conflicts", "--scene", "s"), ("worker", "--once"), ("demo",)):
        done = run(*words)
        assert (done.code, done.out) == (3, "")
        assert "run `conflictdb admin init`" in done.err
    assert run("admin", "init").code == 0
    assert run("admin", "init").code == 0
    assert run("admin", "upgrade").out.endswith(f" is at revision {schema.head()}\n")
    assert run("detect", STRAIT).code == 0


@pytest.mark.parametrize(("revision", "word"), [("9999", "newer conflictdb"), ("0000", "newer conflictdb")])
def test_a_schema_of_another_version_is_exit_3(run: Run, dsn: str, revision: str, word: str) -> None:
    with psycopg.connect(dsn) as conn:
        conn.execute("UPDATE conflictdb.alembic_version SET version_num = %s", (revision,))
    for command in (("status",), ("admin", "upgrade")):
        done = run(*command)
        assert done.code == 3
        assert word in done.err


def test_a_database_that_is_not_there_is_exit_5(dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    for target in (f"{dsn} dbname=nowhere", "host=127.0.0.1 port=1 connect_timeout=2", "not a dsn"):
        done = runner(target, capsys)("status")
        assert (done.code, done.out) == (5, "")
        assert done.err.startswith("conflictdb: cannot connect")


def test_dsn_comes_from_the_environment_and_the_option_goes_first(
    dsn: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CONFLICTDB_DSN", dsn)
    assert main(["status"]) == 0
    assert dsn.partition("dbname=")[2].split()[0] in capsys.readouterr().out
    assert main(["--dsn", "host=/nowhere", "status"]) == 5


def test_a_traceback_only_with_debug(run: Run, tmp_path: Path) -> None:
    missing = tmp_path / "missing.geojson"
    plain = run("load", missing)
    assert (plain.code, plain.err) == (4, f"conflictdb: {missing}: file: does not exist\n")
    root = logging.getLogger()
    before = root.level, root.handlers[:]
    assert "Traceback" in run("--debug", "load", missing).err
    assert (root.level, root.handlers) == before  # whoever called `main` logs as before


def test_messages_name_commands_as_they_can_be_typed(
    dsn: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The name that ./run was called by, quoted for a shell; a database of the environment is not printed."""
    monkeypatch.setenv("CONFLICTDB_PROGRAM", "/my plans/run")
    monkeypatch.setenv("CONFLICTDB_DSN", dsn)
    assert main(["status"]) == 0
    assert "`'/my plans/run' demo`" in capsys.readouterr().out
    with psycopg.connect(dsn) as conn:
        conn.execute("UPDATE conflictdb.alembic_version SET version_num = '0001'")
    assert main(["status"]) == 3
    assert "run `'/my plans/run' admin upgrade`" in capsys.readouterr().err
    with psycopg.connect(dsn) as conn:
        conn.execute("UPDATE conflictdb.alembic_version SET version_num = %s", (schema.head(),))
    assert main(["demo"]) == 0
    told = capsys.readouterr().out
    assert "\n  '/my plans/run' status\n" in told
    assert "dbname" not in told


def test_psql_opens_the_database_and_gets_all_arguments(dsn: str, tmp_path: Path) -> None:
    """Whichever psql comes first on PATH; a password is in its environment, where other users do not see it."""
    fake = tmp_path / "psql"
    fake.write_text('#!/bin/sh\nfor a in "$@"; do echo "<$a>"; done; echo "$PGPASSWORD"; exit 6\n')
    fake.chmod(0o755)
    words = ("--dsn", "postgresql://me:secret@there/plans", "psql", "-c", "SELECT 1", "--")
    done = program(*words, PATH=f"{tmp_path}:{os.environ['PATH']}")
    assert done.returncode == 6
    assert (
        done.stdout
        == "<--set=SHOW_CONTEXT=never>\n<--dbname>\n<user=me dbname=plans host=there>\n<-c>\n<SELECT 1>\n<-->\nsecret\n"
    )


def test_without_psql_says_what_helps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr("conflictdb.embedded.discovery.PLACES", ())
    monkeypatch.setattr("conflictdb.embedded.packages.unpacked_trees", lambda cache: [])
    assert main(["--dsn", "dbname=plans", "psql"]) == 1
    assert "sudo apt-get install postgresql-client" in capsys.readouterr().err


def test_psql_opens_a_database_whose_schema_this_program_does_not_know(
    dsn: str, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    """The message says to drop the schema: psql is how."""

    def refused(**_: object) -> None:
        raise SchemaTooNew("run DROP SCHEMA conflictdb CASCADE")

    opened = []
    running = SimpleNamespace(dsn=dsn, stay_through_exec=lambda: None)
    found = object()
    monkeypatch.setattr("conflictdb.cli.embedded.connect", refused)
    monkeypatch.setattr("conflictdb.embedded.embedded", lambda **_: running)
    monkeypatch.setattr("conflictdb.embedded.find_psql", lambda _: found)
    monkeypatch.setattr("conflictdb.cli.embedded._exec_psql", lambda *arguments: opened.append(arguments))
    monkeypatch.delenv("CONFLICTDB_DSN", raising=False)
    main(["psql", "-l"])
    assert opened == [(found, dsn, ["-l"])]
    assert "run DROP SCHEMA" in capsys.readouterr().err


def test_a_mistake_of_the_program_is_one_message_too(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr("conflictdb.client.database.Database.status", broken)
    done = run("status")
    assert (done.code, done.err.count("\n")) == (1, 1)
    assert "ZeroDivisionError" in done.err
    assert "--debug" in done.err


def test_output_into_a_closed_pipe_is_no_traceback(dsn: str) -> None:
    command = f'"{sys.executable}" -m conflictdb --dsn "$DSN" demo | true'
    done = subprocess.run(
        ["sh", "-c", command],
        env={**os.environ, "DSN": dsn},
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert done.stderr == ""


def test_the_module_runs_as_a_program(dsn: str) -> None:
    done = program("--dsn", dsn, "conflicts", "--scene", "s")
    assert (done.returncode, done.stdout) == (4, "")


def test_server_starts_stays_and_stops(server_dsn: str) -> None:
    """On a home of its own, which a server for tests must be able to enter."""
    home = Path(f"/tmp/conflictdb-test-{os.getpid()}-server")  # noqa: S108

    def server(action: str) -> str:
        done = program("server", action, CONFLICTDB_HOME=str(home))
        assert done.returncode == 0, done.stderr
        return done.stdout

    try:
        assert server("status").startswith("stopped")
        assert "stays until" in server("start")
        dsn = server("dsn").strip()
        with psycopg.connect(dsn) as conn:
            assert conn.execute("SELECT current_database()").fetchone() == ("conflictdb",)
        assert server("status").startswith("running")
        assert server("stop").startswith("stopped")
        with pytest.raises(psycopg.OperationalError):
            psycopg.connect(dsn)
    finally:
        program("server", "stop", CONFLICTDB_HOME=str(home))
        subprocess.run(["rm", "-rf", str(home)], check=True)


def test_what_the_driver_mutters_is_not_shown() -> None:
    """After Ctrl-C at some moments it logs that it could not roll back, on a connection that is closed anyway."""
    script = (
        "import logging\nfrom conflictdb.cli import main\nmain(['--dsn', 'host=/nowhere', 'status'])\n"
        "logging.getLogger('psycopg').warning('error ignored in rollback')"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=WAIT_S)
    assert done.stderr.startswith("conflictdb: ")
    assert "error ignored" not in done.stderr


def test_scenes_name_the_parent_of_a_branch_in_one_line(dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    with conflictdb.connect(dsn) as db:
        db.load_demo()
    run = runner(dsn, capsys)
    assert "BRANCH OF" not in run("scenes").out
    assert run("branch", "create", "two\nlines", "--scene", "strait").out == "two\\nlines: a branch of strait\n"
    header, first, second = run("scenes").out.splitlines()
    assert header.split()[-2:] == ["BRANCH", "OF"]
    assert first.split()[-1] != "strait"
    assert (second.split()[0], second.split()[-1]) == ("two\\nlines", "strait")
    assert run("branch", "drop", "two\nlines").out == "two\\nlines: dropped\n"


def test_names_with_line_breaks_stay_in_one_line(dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    with conflictdb.connect(dsn) as db:
        db.load_demo()
    run = runner(dsn, capsys)
    for words in (
        ("copy", "two\nlines", "--scene", "strait"),
        ("rename", "more\nlines", "--scene", "two\nlines"),
        ("delete", "FERRY", "--scene", "more\nlines"),
        ("admin", "rules", "ferry", "any", "--set", "separation_m=5", "--scene", "more\nlines"),
        ("delete", "--all", "--scene", "more\nlines"),
    ):
        done = run(*words)
        assert (done.code, done.out.count("\n")) == (0, 1), words
        assert "\\nlines" in done.out


def test_listing_commands_import_no_solver(dsn: str, run: Run) -> None:
    """They start in a third of the time that the solvers, the readers of files and their libraries take to import."""
    assert run("detect", STRAIT).code == 0
    script = (
        "import sys\nfrom conflictdb.cli import main\ncode = main(sys.argv[1:])\n"
        "print(code, sorted(sys.modules), file=sys.stderr)"
    )
    # A table of conflicts says how close, which is computed.
    forms = ("json", "csv", "geojson")
    lists = [
        *((words, _TEXT) for words in (["status"], ["scenes"])),
        *(([name, "--scene", "strait"], _TEXT) for name in ("objects", "history")),
        *((["conflicts", "--scene", "strait", "--format", form], _WRITERS) for form in forms),
    ]
    for words, files in lists:
        command = [sys.executable, "-c", script, "--dsn", dsn, *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=True)
        code, listed = done.stderr.splitlines()[-1].split(" ", 1)
        loaded = set(ast.literal_eval(listed))
        assert code == "0"
        assert _LIBRARIES & {name.split(".")[0] for name in loaded} == set()
        rooms = [name.split(".") for name in loaded if name.startswith("conflictdb.")]
        assert {".".join(room) for room in rooms if room[1] in _ROOMS} <= _RANKS | files
