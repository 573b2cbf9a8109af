"""Settings of a role, a database, an environment or a caller's connection change neither input nor output."""

import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import psycopg
import pytest
import sqlalchemy
from commands import STRAIT, runner
from databases import server_directory
from patience import WAIT_S
from scenes import T0_US

import conflictdb
from conflictdb import Database, ReadOnlyDatabase, Scene, connect, store
from conflictdb import embedded as server
from conflictdb.cli.codes import DONE, FAILED
from conflictdb.embedded.account import account_for
from conflictdb.embedded.discovery import find_server
from conflictdb.jobs import schema
from conflictdb.jobs.worker import Worker

SETTINGS = {
    "DateStyle": "German, DMY",
    "IntervalStyle": "sql_standard",
    "TimeZone": "Asia/Kathmandu",
    "extra_float_digits": "-15",
    "bytea_output": "escape",
    "client_encoding": "LATIN1",
    "default_transaction_isolation": "serializable",
    "standard_conforming_strings": "off",
    "transform_null_equals": "on",
    "search_path": "pg_catalog",
}
NUMBERS_AND_TIMES = {"run_id", "found_at", "conflict_id", "changed_at", "a_id", "a_version", "b_id", "b_version"}
# Not in LATIN1, or with other bytes in it than in UTF-8.
KEY, NAME = "Ærø-Ω", "Übung 北"
GREAT = """{"type": "FeatureCollection", "scene": {"name": "great", "motion": "great_circle", "earth": "sphere",
"centre": [4.123456789012345, 57.98765432109876]}, "features": [
{"type": "Feature", "id": "A", "geometry": {"type": "Polygon", "coordinates": [[[4, 57], [5, 57], [5, 58], [4, 57]]]},
 "properties": {"kind": "area"}},
{"type": "Feature", "id": "B", "geometry": {"type": "Polygon", "coordinates": [[[4, 57], [5, 57], [4, 58], [4, 57]]]},
 "properties": {"kind": "area"}}]}"""


def everything(db: Database, tmp_path: Path) -> list[object]:
    """Load, detect and read back in every way; return the output, except numbers of runs and times of work."""
    db.load(STRAIT)
    great = tmp_path / "great.geojson"
    great.write_text(GREAT)
    db.load(great)
    (area,) = conflictdb.read(great).areas[:1]
    store.replace_scene(db.connection, Scene("s"), [replace(area, key=KEY, name=NAME, start_us=T0_US)], [], merge=True)
    found: list[object] = []
    for scene in ("strait", "great", "s"):
        db.scene(scene).detect(nearest_m=None if scene == "strait" else 2000.0)
        for one in [*db.scene(scene).conflicts(with_region=True), *db.scene(scene).approaches()]:
            found.append({name: value for name, value in asdict(one).items() if name not in NUMBERS_AND_TIMES})
        found.append(db.scene(scene).text())
        found.append([(run.conflicts, run.objects, run.error) for run in store.runs(db.connection, scene, 9)])
    found.append([(s.scene, s.areas, s.tracks, s.pending, s.conflicts, s.error) for s in db.scenes()])
    with pytest.raises(conflictdb.InvalidInput, match="known: 'great', 's', 'strait'"):
        db.scene(NAME).conflicts()
    assert db.status().worker_count == 0
    return found


@pytest.fixture
def expected(server_dsn: str, template: str, tmp_path: Path, dsn: str) -> list[object]:
    """Return the output of a database without settings; it is cleared for the test."""
    with connect(dsn) as db:
        found = everything(db, tmp_path)
        db.connection.execute("DELETE FROM conflictdb.scene")
        db.connection.commit()
    return found


@pytest.fixture
def odd_dsn(dsn: str, expected: list[object]) -> str:
    """Return how to connect to a database that sets everything otherwise."""
    with psycopg.connect(dsn, autocommit=True) as conn:
        for name, value in SETTINGS.items():
            conn.execute(f"ALTER DATABASE {conn.info.dbname} SET {name} = '{value}'".encode())
    return dsn


SLOW = ("connection", "autocommit", "engine", "SQL_ASCII")


@pytest.mark.parametrize(
    "how", ["dsn", "transaction", "cursors", *(pytest.param(how, marks=pytest.mark.slow) for how in SLOW)]
)
def test_settings_of_a_session_change_nothing(odd_dsn: str, expected: list[object], tmp_path: Path, how: str) -> None:
    with ExitStack() as stack:
        target: Any = odd_dsn
        if how == "engine":
            target = sqlalchemy.create_engine("postgresql+psycopg://", creator=lambda: psycopg.connect(odd_dsn))
            stack.callback(target.dispose)
        elif how != "dsn":
            odd: dict[str, Any] = {
                "SQL_ASCII": {"client_encoding": "SQL_ASCII"},
                "cursors": {"cursor_factory": psycopg.ClientCursor, "row_factory": psycopg.rows.dict_row},
            }
            target = stack.enter_context(psycopg.connect(odd_dsn, autocommit=how == "autocommit", **odd.get(how, {})))
        before = psycopg_settings(target)
        db = stack.enter_context(connect(target))
        if how == "transaction":
            assert in_a_transaction_of_the_caller(db)
        assert everything(db, tmp_path) == expected
        assert psycopg_settings(target) == before


def psycopg_settings(target: Any) -> dict[str, str | None]:
    """Return the settings that the caller's connection shows; they are to stay so."""
    if not isinstance(target, psycopg.Connection):
        return {}
    return {name: target.info.parameter_status(name) for name in ("DateStyle", "TimeZone", "client_encoding")}


def in_a_transaction_of_the_caller(db: Database) -> bool:
    """Texts go in and out, and settings of the caller's transaction stay as before."""
    with db.connection.transaction():
        store.replace_scene(db.connection, Scene(NAME), [], [], merge=False)
        assert [one.scene.name for one in db.scenes()] == [NAME]
        shown = db.connection.execute("SHOW client_encoding").fetchone()
        db.connection.execute("DELETE FROM conflictdb.scene")
    return shown == ("LATIN1",)


def test_environment_of_libpq_changes_nothing(
    dsn: str, expected: list[object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PGDATESTYLE", "SQL, DMY")
    monkeypatch.setenv("PGTZ", "America/St_Johns")
    monkeypatch.setenv("PGCLIENTENCODING", "SQL_ASCII")
    with connect(dsn) as db:
        assert everything(db, tmp_path) == expected
        shown = db.connection.execute("SELECT now(), '1 day'::interval").fetchone()
        assert shown is not None, "what users ask for on our connection comes, too"
    with psycopg.connect(dsn) as conn, connect(conn) as db:
        assert db.scene("strait").conflicts()


def test_a_connection_whose_transactions_are_read_only(dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Reading works; writing fails with one line that gives the reason."""
    with connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect()
        db.connection.execute(
            f"ALTER DATABASE {db.connection.info.dbname} SET default_transaction_read_only = on".encode()
        )
        db.connection.commit()
    run = runner(dsn, capsys)
    assert run("conflicts", "--scene", "strait").code == DONE
    assert run("status").code == DONE
    for words in (["detect", "--scene", "strait"], ["load", STRAIT], ["worker"], ["worker", "--once"]):
        done = run(*words)
        assert (done.code, done.err.count("\n")) == (FAILED, 1), words
        assert "are read-only by default: turn off default_transaction_read_only for user" in done.err
    with psycopg.connect(dsn) as conn, connect(conn) as db:
        conn.execute("SET default_transaction_read_only = off")
        conn.commit()
        conn.read_only = True
        with pytest.raises(ReadOnlyDatabase, match="takes no changes in this transaction: cannot execute"):
            db.scene("strait").detect()
        with pytest.raises(ReadOnlyDatabase, match="takes no changes in this transaction: cannot execute"):
            db.load(STRAIT)


@pytest.fixture
def standby() -> Iterator[tuple[str, str]]:
    """Return how to connect to two databases of a hot standby: with a scene in it, and empty."""
    home = Path(tempfile.mkdtemp(prefix="conflictdb-", dir=server_directory()))
    home.chmod(0o755)
    try:
        # A server that ran with another wal_level before cannot become a standby.
        with server.embedded(home / "db", durable=False) as embedded, psycopg.connect(embedded.admin_dsn) as conn:
            conn.autocommit = True
            conn.execute("ALTER SYSTEM SET wal_level = 'replica'")
        await_stop(home / "db")
        with server.embedded(home / "db") as embedded:
            with connect(embedded.admin_dsn, create=True) as db:
                db.load(STRAIT)
                db.scene("strait").detect()
            with psycopg.connect(embedded.admin_dsn, autocommit=True) as conn:
                conn.execute("CREATE DATABASE empty")
        await_stop(home / "db")
        yield from running_standby(home / "db")
    finally:
        shutil.rmtree(home, ignore_errors=True)


def await_stop(home: Path) -> None:
    stop = time.monotonic() + WAIT_S
    while server.status(home).pid is not None:
        assert time.monotonic() < stop
        time.sleep(0.05)


def running_standby(home: Path) -> Iterator[tuple[str, str]]:
    # Without a primary to follow it waits for one, and answers queries meanwhile.
    settings = server.Settings.from_environment(home=home)
    account = account_for(home)
    programs = find_server(settings, account, None, print)
    data = home / "data"
    (data / "standby.signal").touch()
    process = subprocess.Popen(
        [programs.bin / "postgres", "-D", data, "-c", f"unix_socket_directories={data}", "-c", "listen_addresses="],
        env={**programs.environ, "HOME": str(home)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        **account.switch,
    )
    try:
        dsn = f"host={data} port=5432 user=postgres dbname="
        stop = time.monotonic() + WAIT_S
        while process.poll() is None and time.monotonic() < stop:
            with suppress(psycopg.OperationalError):
                psycopg.connect(f"{dsn}conflictdb").close()
                break
            time.sleep(0.05)
        yield f"{dsn}conflictdb", f"{dsn}empty"
    finally:
        process.terminate()
        process.wait(WAIT_S)


def test_a_hot_standby_is_read_and_says_what_it_is(
    standby: tuple[str, str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Reading works; writing, by the worker too, ends with one line."""
    dsn, empty = standby
    run = runner(dsn, capsys)
    assert run("conflicts", "--scene", "strait").out.count("\n") == 8
    assert "strait" in run("status").out
    assert run("export", "--scene", "strait", tmp_path / "strait.geojson").code == DONE
    for words in (
        *(["detect", "--scene", "strait"], ["load", STRAIT], ["worker"], ["worker", "--once"], ["demo"]),
        ["resolve", "--scene", "strait"],
    ):
        done = run(*words)
        assert (done.code, done.err.count("\n")) == (FAILED, 1), done.err
        assert "is a hot standby, which takes no changes: connect to the primary server" in done.err
    with connect(dsn) as db:
        for write in (
            lambda: db.scene("strait").rename("other"),
            lambda: db.scene("strait").branch("b"),
            lambda: db.scene("strait").delete(),
        ):
            with pytest.raises(ReadOnlyDatabase, match="; connect to the primary server, or turn off") as refused:
                write()
            assert "SQLSTATE" not in str(refused.value)
    done = runner(empty, capsys)("admin", "init")
    assert (done.code, done.err.count("\n")) == (FAILED, 1)
    assert "is a hot standby" in done.err
    with pytest.raises(ReadOnlyDatabase, match="hot standby"):
        schema.upgrade(empty)
    with pytest.raises(ReadOnlyDatabase, match="hot standby"):
        Worker(lambda: store.connect(dsn), print).run()
