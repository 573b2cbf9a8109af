"""An edit behind an attached view is found by a comparison: who waits for the scene waits for one that began later."""

import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import psycopg
import pytest
from commands import runner
from patience import until

from conflictdb import connect, store
from conflictdb.client.database import Database
from conflictdb.errors import NotCurrent
from conflictdb.jobs import detect

OPS = """
CREATE SCHEMA mission;
CREATE TABLE mission.ops AS SELECT 1 AS id, ST_MakeEnvelope(8, 57, 9, 58, 4326) AS shape;
CREATE VIEW mission.seen AS SELECT * FROM mission.ops;
"""
MAP = {"key": "id", "footprint": "shape"}
# As if the last detection and comparison had been so long ago.
AGES = """
UPDATE conflictdb.attachment SET compared_at = compared_at - interval '{0} s';
UPDATE conflictdb.run SET write_s = write_s + {1};
"""


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with psycopg.connect(dsn) as conn:
        conn.execute(OPS)
        conn.execute("SELECT conflictdb.create_scene('s')")
    with connect(dsn) as db:
        db.scene("s").attach("area", "mission.seen", MAP, every_s=600.0)
        db.scene("s").detect()
        yield db


def elsewhere(db: Database, statement: str) -> list[Any]:
    """Run a statement in a session and transaction of its own."""
    with psycopg.connect(db.connection.info.dsn, password=db.connection.info.password or None) as other:
        cursor = other.execute(statement.encode())
        return cursor.fetchall() if cursor.description else []


def test_a_wait_sees_an_edit_behind_a_view(db: Database) -> None:
    """A worker compares at once, long before the interval ends, and only while a session waits."""
    before = db.scene("s").state().compared_at
    assert before is not None
    elsewhere(db, "INSERT INTO mission.ops SELECT 2, shape FROM mission.ops")
    assert db.scenes()[0].is_current, "as of its last comparison"
    assert store.waiting_scenes(db.connection) == {}
    with ThreadPoolExecutor(1) as thread, psycopg.connect(db.connection.info.dsn) as reader:
        reader.execute("SET ROLE conflictdb_reader")
        waiting = thread.submit(reader.execute, b"SELECT conflictdb.wait_until_current('s', NULL)")
        until(lambda: store.waiting_scenes(db.connection))
        assert not waiting.done()
        until(lambda: detect.detect_pending(db.connection, "s", jobs=1) is not None)
        waiting.result()
        assert reader.execute("SELECT count(*) FROM conflictdb.conflicts").fetchone() == (1,)
        # The transaction goes on; its lock does not.
        until(lambda: store.waiting_scenes(db.connection) == {})
        locks = f"SELECT FROM pg_locks WHERE locktype = 'advisory' AND pid = {reader.info.backend_pid}"
        assert elsewhere(db, locks) == []
    after = db.scene("s").state().compared_at
    assert after is not None
    assert after > before
    assert elsewhere(db, "SELECT compared_at FROM conflictdb.scenes") == [(after,)]


def test_a_wait_without_a_comparison_fails_and_says_so(db: Database) -> None:
    with pytest.raises(NotCurrent, match=r"its views were compared last at .*, before the call"):
        db.scene("s").wait_until_current(timeout_s=0.1)
    with psycopg.connect(db.connection.info.dsn) as other:
        other.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        with pytest.raises(psycopg.Error, match="would wait in vain"):
            other.execute("SELECT conflictdb.wait_until_current('s')")
    # With triggers there is nothing to wait for.
    db.scene("s").reattach("seen", {}, to="mission.ops", every_s=0)
    db.scene("s").detect()
    db.scene("s").wait_until_current(timeout_s=0.0)
    assert db.scene("s").state().compared_at is None


def test_a_long_detection_leaves_views_compared(db: Database) -> None:
    """Nobody compares during a detection: its own time does not make the scene out of date."""
    db.scene("s").reattach("seen", every_s=5.0)
    db.scene("s").detect()
    elsewhere(db, AGES.format(60, 0))
    state = db.scene("s").state()
    assert not state.is_current
    assert "was compared last at" in str(state.remark)
    assert state.detection_helps
    elsewhere(db, AGES.format(0, 50))
    assert db.scene("s").state().is_current


def test_a_command_advises_detect_only_where_it_helps(
    db: Database, dsn: str, capsys: pytest.CaptureFixture[str]
) -> None:
    name = f"planner_{db.connection.info.dbname}"
    elsewhere(db, f"CREATE ROLE {name} LOGIN; GRANT conflictdb_worker TO {name}; GRANT ALL ON SCHEMA mission TO {name}")
    try:
        elsewhere(db, AGES.format(6000, 0))
        run, as_planner = runner(dsn, capsys), runner(f"{dsn} options='-c role={name}'", capsys)
        ended = run("conflicts", "--scene", "s")
        assert re.search(r"s: not complete: .* was compared last at .*`conflictdb detect --scene s` does it", ended.err)
        ended = as_planner("detect", "--scene", "s")
        assert re.search(r"s: not complete: .* was compared last at .* run a worker as role", ended.err)
        assert "does it" not in ended.err
        ended = run("detect", "--scene", "s")
        assert ended.err == ""
    finally:
        elsewhere(db, f"DROP OWNED BY {name}; DROP ROLE {name}")
