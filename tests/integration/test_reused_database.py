"""The database that tests use in turn is as the template, whatever the test before left in it."""

from collections.abc import Iterator

import psycopg
import pytest
from databases import TestServer
from lent_sessions import LentSessions
from reused import ReusedDatabase

OBJECTS = """
SELECT conflictdb.create_scene('s');
SELECT conflictdb.put_area('s', 'A', ST_SetSRID(ST_MakeEnvelope(4, 57, 5, 58), 4326));
SELECT conflictdb.put_area('s', 'B', ST_SetSRID(ST_MakeEnvelope(4, 57, 5, 58), 4326));
"""
# Leftovers that are removed, so that the next test gets the same database.
REMOVED = {
    "nothing": "SELECT 1",
    "objects": OBJECTS,
    "statistics": OBJECTS + "ANALYZE",
    "a table": "CREATE TABLE mine (id serial PRIMARY KEY); CREATE INDEX ON mine ((id + 1))",
    "a schema": "CREATE SCHEMA mine; CREATE TABLE mine.t (); CREATE FUNCTION mine.f() RETURNS int RETURN 1",
    "an attached table": OBJECTS
    + """CREATE TABLE zone (id text PRIMARY KEY, shape geometry(Polygon, 4326));
         INSERT INTO zone VALUES ('Z', ST_MakeEnvelope(0, 50, 1, 51, 4326));
         SELECT conflictdb.attach('s', 'area', 'zone', '{"key": "id", "footprint": "shape"}')""",
    "a trigger": "CREATE TRIGGER mine BEFORE UPDATE ON conflictdb.area FOR EACH ROW "
    "EXECUTE FUNCTION suppress_redundant_updates_trigger()",
    "a type": "CREATE TYPE mine AS ENUM ('a'); CREATE DOMAIN yours AS int",
    "a function": "CREATE FUNCTION conflictdb.mine() RETURNS int RETURN 1",
    "an extension": "CREATE EXTENSION postgres_fdw; CREATE SERVER mine FOREIGN DATA WRAPPER postgres_fdw",
    "a policy": "CREATE POLICY mine ON conflictdb.scene FOR SELECT",
}
# Leftovers that are not removed, so that the next test gets another database.
REPLACED = {
    "a column": "ALTER TABLE conflictdb.scene ADD mine int",
    "a column of PostGIS": "ALTER TABLE spatial_ref_sys ADD mine int",
    "a routine less": "DROP FUNCTION conflictdb.haven_at",
    "another routine": "ALTER FUNCTION conflictdb.haven_at SECURITY DEFINER",
    "a trigger less": "ALTER TABLE conflictdb.area DISABLE TRIGGER USER",
    "a comment": "COMMENT ON TABLE conflictdb.scene IS 'mine'",
    "a grant": "GRANT SELECT ON conflictdb.scene TO PUBLIC",
    "a setting": "DO $$ BEGIN EXECUTE format('ALTER DATABASE %I SET work_mem = 64', current_database()); END $$",
    "another version": "UPDATE conflictdb.alembic_version SET version_num = '0000'",
    "no schema": "DROP SCHEMA conflictdb CASCADE",
}


@pytest.fixture(scope="module")
def reused(_server: TestServer, template: str, worker_id: str) -> Iterator[ReusedDatabase]:
    reused = ReusedDatabase(_server, template, f"{_server.prefix}_{worker_id}_left")
    yield reused
    reused.drop()


@pytest.mark.parametrize("left", REMOVED.values(), ids=REMOVED)
def test_what_is_left_is_removed(reused: ReusedDatabase, left: str) -> None:
    dsn = reused.dsn()
    with psycopg.connect(dsn) as conn:
        conn.execute(left.encode())
    reused.clean()
    assert reused.dsn() == dsn
    with psycopg.connect(dsn) as conn:
        conn.execute(OBJECTS)
        found = conn.execute(
            "SELECT array_agg(a.area_id), (SELECT array_agg(c.change_id) FROM conflictdb.change c), min(s.scene_id), "
            "(SELECT count(*) FROM conflictdb.attachment), "
            "(SELECT min(c.reltuples) = -1 AND max(c.reltuples) <= 0 FROM pg_class c "
            " WHERE c.relnamespace = 'conflictdb'::regnamespace AND c.relkind = 'r'), "
            "to_regclass('mine') IS NULL AND to_regclass('zone') IS NULL "
            "FROM conflictdb.area a JOIN conflictdb.scene s USING (scene_id)"
        ).fetchone()
    assert found == ([1, 2], [1, 2], 1, 0, True, True)
    reused.clean()


@pytest.mark.parametrize("left", REPLACED.values(), ids=REPLACED)
def test_what_cannot_be_removed_costs_another_database(reused: ReusedDatabase, left: str) -> None:
    dsn = reused.dsn()
    with psycopg.connect(dsn) as conn:
        conn.execute(left.encode())
    reused.clean()
    assert reused.dsn() != dsn
    with psycopg.connect(reused.dsn()) as conn:
        conn.execute(OBJECTS)
    reused.clean()


def test_sessions_that_are_left_end(reused: ReusedDatabase) -> None:
    with psycopg.connect(reused.dsn()) as conn:
        conn.execute(OBJECTS)  # takes its locks
        reused.clean()
        with pytest.raises(psycopg.OperationalError):
            conn.execute("SELECT 1")


def test_what_a_kept_session_left_is_counted(reused: ReusedDatabase) -> None:
    """A session counts once a second, unless it ends: a change just after that was not seen."""
    for _ in range(3):
        dsn = reused.dsn()
        for statement in ("CREATE TEMP TABLE first ()", "SELECT conflictdb.protect_scenes()"):
            with reused.session(dsn) as conn:
                conn.execute(statement.encode())
                conn.commit()
            reused.clean()
        assert reused.dsn() != dsn


def test_a_lent_session_is_as_a_new_one(reused: ReusedDatabase) -> None:
    """Closed, it is lent again, without what was set in it; after a setting for new sessions it is not lent."""
    dsn = reused.dsn()
    query = (
        "SELECT current_setting('work_mem'), to_regclass('mine'), (SELECT count(*) FROM pg_listening_channels()), "
        "(SELECT count(*) FROM pg_locks WHERE locktype = 'advisory' AND pid = pg_backend_pid())"
    )
    with psycopg.connect(dsn) as conn:
        expected = conn.execute(query).fetchone()
    sessions = LentSessions()
    lent = sessions.connect(dsn)
    pid = lent.info.backend_pid
    lent.execute("SET work_mem = '77MB'; CREATE TEMPORARY TABLE mine (); LISTEN mine; SELECT pg_advisory_lock(7)")
    lent.commit()
    for _ in range(2):
        lent.close()
    again = sessions.connect(dsn)
    assert again.info.backend_pid == pid
    assert again.execute(query).fetchone() == expected
    again.close()
    with psycopg.connect(dsn) as conn:
        conn.execute(REPLACED["a setting"])
    other = sessions.connect(dsn)
    assert other.info.backend_pid != pid
    assert other.execute("SHOW work_mem").fetchone() == ("64kB",)
    other.close()
    sessions.close()
    assert other.closed
    reused.clean()
    assert reused.dsn() != dsn
    reused.clean()
