"""Behind PgBouncer, which in transaction mode gives every transaction another session of the server."""

import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import psycopg
import pytest
import sqlalchemy
from city import CITY, asked, keys, square
from commands import STRAIT, STRAIT_CAME, runner
from patience import WAIT_S, until
from ports import free_port
from psycopg import conninfo

from conflictdb import connect, store
from conflictdb.errors import LockTimeout, StoreError
from conflictdb.jobs import detect
from conflictdb.jobs.looks import Looks
from conflictdb.jobs.worker import Worker
from conflictdb.model.plans import Scene, Track, rectangle_outline_m

PROGRAM = shutil.which("pgbouncer", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="PgBouncer did not run: not found (Debian package pgbouncer)")

CONFIGURATION = """
[databases]
* = {server}
[pgbouncer]
pool_mode = {mode}
default_pool_size = {size}
auth_type = any
listen_addr = 127.0.0.1
listen_port = {port}
unix_socket_dir =
logfile = {directory}/log
pidfile = {directory}/pid
query_wait_timeout = 180
"""


def owner(dsn: str) -> dict[str, Any]:
    """Return a user who may reach the server: PgBouncer refuses to run as root."""
    if os.geteuid():
        return {}
    directory = Path(conninfo.conninfo_to_dict(dsn).get("host") or "/")
    state = directory.stat() if directory.is_absolute() and directory != Path("/") else None
    uid, gid = (state.st_uid, state.st_gid) if state and state.st_uid else (65534, 65534)
    return {"user": uid, "group": gid, "extra_groups": []}


@contextmanager
def bouncer(dsn: str, mode: str, size: int) -> Iterator[str]:
    """Run PgBouncer before the server of a database; give how to connect to the database through it."""
    assert PROGRAM is not None
    given = conninfo.conninfo_to_dict(dsn)
    wanted = {name: given[name] for name in ("host", "port", "user", "password") if given.get(name)}
    port = free_port()
    directory = Path(tempfile.mkdtemp(prefix="conflictdb-pgbouncer-"))
    directory.chmod(0o777)
    file = directory / "pgbouncer.ini"
    server = " ".join(f"{name}={value}" for name, value in wanted.items())
    file.write_text(CONFIGURATION.format(server=server, mode=mode, size=size, port=port, directory=directory))
    file.chmod(0o644)
    process = subprocess.Popen([PROGRAM, file], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **owner(dsn))
    through = conninfo.make_conninfo("", host="127.0.0.1", port=port, user=given.get("user"), dbname=given["dbname"])
    try:
        until(lambda: process.poll() is not None or answers(through))
        assert process.poll() is None, (directory / "log").read_text()
        yield through
    finally:
        process.terminate()
        process.wait(WAIT_S)
        shutil.rmtree(directory)


def answers(dsn: str) -> bool:
    with suppress(psycopg.OperationalError), psycopg.connect(dsn, connect_timeout=20):
        return True
    return False


@pytest.fixture
def pooled(dsn: str) -> Iterator[str]:
    """Return how to connect in transaction mode, to no more than three sessions."""
    with bouncer(dsn, "transaction", 3) as through:
        yield through


def test_a_detection_leaves_no_lock_in_the_pool(dsn: str, pooled: str) -> None:
    """Whichever sessions the transactions of the clients get, nobody waits for a lock left behind."""
    with connect(pooled) as one, connect(pooled) as two, psycopg.connect(pooled) as third:
        one.load(STRAIT)
        sessions = set()
        for turn in range(4):
            # An open transaction takes a session away, so that the next client gets another one.
            third.rollback()
            third.execute("SELECT 1")
            first, second = (one, two) if turn % 2 else (two, one)
            assert first.scene("strait").detect(full=True, lock_timeout_s=5.0).conflicts == 7
            assert second.scene("strait").detect(full=True, lock_timeout_s=5.0).conflicts == 7
            with psycopg.connect(dsn, autocommit=True) as direct:
                # The server has databases of other tests, too.
                held = "SELECT pid FROM pg_locks l JOIN pg_database d ON d.oid = l.database AND d.datname = %s"
                name = direct.info.dbname
                sessions.update(direct.execute(f"{held} WHERE locktype = 'advisory'".encode(), [name]).fetchall())
    assert sessions == set()


def test_one_detection_at_a_time_and_the_other_learns_of_it(pooled: str) -> None:
    with store.connect(pooled) as one, store.connect(pooled) as two:
        scene_id = store.set_scene(one, Scene("s"))
        store.begin_locked(one, scene_id, "s", 0.0, print)
        row = one.execute("SELECT pg_backend_pid()").fetchone()
        assert row is not None
        with pytest.raises(LockTimeout, match=f"waited 0.2 s: another detection .* process {row[0]} of the server"):
            detect.detect(two, "s", jobs=1, lock_timeout_s=0.2)
        one.rollback()
        assert detect.detect(two, "s", jobs=1, lock_timeout_s=5.0).conflicts == 0


def test_admissions_take_turns_and_leave_nothing_in_the_pool(pooled: str) -> None:
    """In Python and SQL, whichever sessions the transactions get."""
    with connect(pooled) as one, connect(pooled) as two, psycopg.connect(pooled) as third:
        store.set_scene(one.connection, CITY)
        for turn in range(12):  # statements are prepared from the sixth on
            third.rollback()
            third.execute("SELECT 1")
            first, second = (one, two) if turn % 2 else (two, one)
            lon = 0.1 * turn
            assert first.scene("city").admit(square(f"{turn}", lon), f"{turn}", lock_timeout_s=5.0)
            assert not second.scene("city").admit(square(f"{turn} b", lon), lock_timeout_s=5.0)
            assert asked(second.connection, square(f"{turn} b", lon))[0] is False
            second.connection.commit()
        for _ in range(4):
            third.rollback()
            assert third.execute("SHOW lock_timeout").fetchone() == ("0",)
            third.execute("SELECT 1")
        assert len(keys(one.scene("city"))) == 12


def test_all_commands_work(empty_dsn: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, template: str) -> None:
    """From `init` on, and as often as a driver takes to prepare statements, which another session does not know."""
    with bouncer(empty_dsn, "transaction", 3) as through, psycopg.connect(through) as busy:
        run = runner(through, capsys)
        for words in (
            ["admin", "init"],
            ["load", STRAIT],
            ["detect", "--scene", "strait", "--jobs", "1"],
            ["conflicts", "--scene", "strait", "--format", "json"],
            ["approaches", "--scene", "strait"],
            ["export", "--scene", "strait", tmp_path / "strait.geojson"],
            ["worker", "--once"],
            ["conflicts", "--live", "--scene", "strait"],
            ["status"],
        ):
            done = run(*words)
            assert (done.code, done.err.replace(STRAIT_CAME, "")) == (0, ""), (words, done.err)
        with connect(through) as db:
            for turn in range(12):
                busy.rollback()
                if turn % 2:
                    busy.execute("SELECT 1")
                assert len(db.scene("strait").conflicts()) == 7
                db.scene("strait").detect(full=turn % 4 == 0)


def test_feeds_and_looks_share_the_pool(dsn: str, pooled: str) -> None:
    """Trackers insert, a worker looks, and readers ask, each in whichever session; no role and no lock stays behind."""
    began = datetime.now(UTC) - timedelta(minutes=30)
    plan = Track("A", [(0, 0), (1, 0)], [began, began + timedelta(hours=1)], rectangle_outline_m(500, 500, 500, 500))
    with connect(pooled) as db, psycopg.connect(pooled) as feed, psycopg.connect(pooled) as busy:
        store.replace_scene(db.connection, Scene("s"), [], [plan], merge=False)
        db.connection.commit()
        looks = Looks()
        put = (
            "INSERT INTO conflictdb.position (scene, key, instant, place) "
            "VALUES ('s', %s, %s, ST_SetSRID(ST_MakePoint(%s, 0), 4326))"
        )
        for turn in range(12):  # statements are prepared from the sixth on
            busy.rollback()
            if turn % 2:
                busy.execute("SELECT 1")
            at = began + timedelta(minutes=turn + 1)
            with feed.transaction():
                feed.execute("SET LOCAL ROLE conflictdb_tracker")
                feed.execute(put, ["A", at, (turn + 1) / 60])
            with pytest.raises(psycopg.Error, match="is not a track"):
                feed.execute(put, ["X", at, 0])
            feed.rollback()
            assert looks.look(db.connection, round(1e6 * at.timestamp()), is_silence_due=True) == 1
            assert [(one.state, one.instant) for one in db.scene("s").live()] == [("on plan", at)]


@pytest.mark.parametrize("how", ["connection", "engine"])
def test_a_connection_of_the_caller_works_as_it_is(pooled: str, how: str) -> None:
    """With a driver that prepares statements, since it is not configured for the pooler."""
    with psycopg.connect(pooled) as busy:
        engine = sqlalchemy.create_engine("postgresql+psycopg://", creator=lambda: psycopg.connect(pooled))
        target: Any = engine if how == "engine" else psycopg.connect(pooled)
        try:
            with connect(target) as db:
                db.load(STRAIT)
                for turn in range(12):
                    busy.rollback()
                    if turn % 2:
                        busy.execute("SELECT 1")
                    assert db.scene("strait").detect(full=turn % 4 == 0).conflicts == 7
                    assert len(db.scene("strait").conflicts()) == 7
        finally:
            engine.dispose()
            if how == "connection":
                target.close()


def test_a_worker_that_hears_nothing_says_so_once_and_looks_for_changes(dsn: str, pooled: str) -> None:
    said, done = worked(pooled, dsn, heard_within_s=0.5)
    assert done == ["first", "second"]
    assert said == [said[0]], "once, although it had to connect again"
    assert said[0].startswith("notifications do not arrive on this connection")


def test_a_pooler_in_session_mode_is_as_good_as_none(dsn: str) -> None:
    with bouncer(dsn, "session", 5) as through:
        assert worked(through, dsn, heard_within_s=WAIT_S) == ([], ["first", "second"])


def worked(through: str, dsn: str, heard_within_s: float) -> tuple[list[str], list[str]]:
    """Have a worker detect two scenes, and lose its connection in between; return its output, and the scenes."""
    said: list[str] = []
    done: list[str] = []
    connections: list[psycopg.Connection[Any]] = []

    def opened() -> psycopg.Connection[Any]:
        connections.append(store.connect(store.worker_dsn(through)))
        return connections[-1]

    def report(scene: str, outcome: object, waited_s: float) -> None:
        assert isinstance(outcome, detect.Run)
        done.append(scene)
        if scene == "second":
            raise KeyboardInterrupt
        for connection in connections:
            connection.close()
        raise StoreError("lost")

    def work() -> None:
        with suppress(KeyboardInterrupt):
            options: dict[str, Any] = {"retry_s": 0.01, "unnotified_s": 0.1, "heard_within_s": heard_within_s}
            Worker(opened, report, 600.0, jobs=1, say=said.append, **options).run()

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    with connect(dsn) as db:
        for scene in ("first", "second"):
            time.sleep(1.5)  # it waits for changes now
            db.load(STRAIT, scene)
            until(lambda scene=scene: done[-1:] == [scene])  # type: ignore[misc]
    thread.join(WAIT_S)
    assert said[-2:] == ["lost the database, connecting again: lost", "connected again"]
    return said[:-2], done


def test_workers_are_counted_whichever_session_they_have(dsn: str, pooled: str) -> None:
    """Idle ones too, whose session another client has; and no session that the pool keeps after they have gone."""
    ends = threading.Event()

    def stops(connection: psycopg.Connection[Any], timeout_s: float) -> bool:
        if ends.wait(0.05):
            raise KeyboardInterrupt
        return False

    def work() -> None:
        with suppress(KeyboardInterrupt), pytest.MonkeyPatch.context() as patch:
            patch.setattr(store, "wait_for_change", stops)
            connection = lambda: store.connect(store.worker_dsn(pooled))  # noqa: E731
            Worker(connection, lambda *_: None, jobs=1, say=lambda _: None, heard_within_s=0.1).run()

    def count() -> int:
        return store.service(direct).worker_count

    named = "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() AND application_name = %s"
    thread = threading.Thread(target=work, daemon=True)
    with psycopg.connect(dsn, autocommit=True) as direct, connect(pooled) as db:
        assert count() == 0
        thread.start()
        # The transactions before its first stamp count too, but only while they last.
        until(lambda: direct.execute("SELECT count(*) FROM conflictdb.worker_stamp").fetchone() == (1,))
        for _ in range(6):  # clients with other names take the sessions
            with psycopg.connect(pooled, application_name="other") as one:
                db.scenes()
                one.execute("SELECT 1")
                assert count() == 1
        ends.set()
        thread.join(WAIT_S)
        assert count() == 0
        with psycopg.connect(store.worker_dsn(pooled)) as detecting:
            detecting.execute("SELECT 1")
            assert count() == 1, "its transaction may last longer than a stamp"
        assert direct.execute(named, [store.WORKER_NAME]).fetchone() != (0,), "the pool keeps its session"
        until(lambda: count() == 0)
