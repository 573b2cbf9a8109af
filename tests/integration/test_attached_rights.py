"""Attached tables are read with the rights of who attached them; what that role's code does stays without effect."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import psycopg
import pytest
from psycopg import sql

from conflictdb import connect
from conflictdb.db import attached, store
from conflictdb.errors import InvalidInput, StoreError

Conn = psycopg.Connection[Any]

MAP = {"key": "id", "footprint": "shape"}
AREA = "'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))'"


@pytest.fixture
def roles(conn: Conn) -> Iterator[dict[str, str]]:
    """Return the names of four roles: who plans (an editor), who writes, who keeps (a worker), and another editor."""
    names = {role: f"{role}_{conn.info.dbname}" for role in ("planner", "writer", "keeper", "other")}
    groups = {"planner": "editor", "keeper": "worker", "other": "editor"}
    for role, name in names.items():
        conn.execute(sql.SQL("CREATE ROLE {} NOLOGIN").format(sql.Identifier(name)))
        if role in groups:
            group = sql.Identifier(f"conflictdb_{groups[role]}")
            conn.execute(sql.SQL("GRANT {} TO {}").format(group, sql.Identifier(name)))
    conn.execute(sql.SQL("CREATE SCHEMA mission AUTHORIZATION {}").format(sql.Identifier(names["planner"])))
    conn.execute(sql.SQL("GRANT USAGE ON SCHEMA mission TO {}").format(sql.Identifier(names["writer"])))
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.commit()
    with acting(conn, names["planner"]):
        conn.execute("CREATE TABLE mission.ops (id integer, shape geometry)")
        conn.execute(f"INSERT INTO mission.ops VALUES (1, {AREA})")
        conn.execute(sql.SQL("GRANT ALL ON mission.ops TO {}").format(sql.Identifier(names["writer"])))
    yield names
    conn.rollback()
    conn.execute("RESET ROLE")
    everybody = sql.SQL(", ").join(map(sql.Identifier, names.values()))
    conn.execute(sql.SQL("DROP OWNED BY {} CASCADE").format(everybody))
    conn.execute(sql.SQL("DROP ROLE {}").format(everybody))
    conn.commit()


@contextmanager
def acting(conn: Conn, role: str) -> Iterator[None]:
    """Work as a role, in transactions of its own."""
    conn.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(role)))
    conn.commit()
    yield
    conn.commit()
    conn.execute("RESET ROLE")
    conn.commit()


def follow(conn: Conn, role: str) -> None:
    with acting(conn, role):
        attached.follow(conn, "s", again=True)


def keys(conn: Conn) -> list[str]:
    with conn.transaction():
        return [key for (key,) in conn.execute("SELECT key FROM conflictdb.area ORDER BY key").fetchall()]


def test_each_role_needs_no_more_than_its_own(conn: Conn, roles: dict[str, str]) -> None:
    """Who writes needs nothing here, who keeps scenes current nothing there, and who plans creates nothing here."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.attach("s", "area", "mission.ops", MAP)
    with acting(conn, roles["writer"]):
        conn.execute(f"INSERT INTO mission.ops VALUES (2, {AREA})")
        conn.execute("UPDATE mission.ops SET id = 3 WHERE id = 1")
    follow(conn, roles["keeper"])
    assert keys(conn) == ["2", "3"]
    with acting(conn, roles["keeper"]):
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            conn.execute("SELECT FROM mission.ops")
        conn.rollback()
    with acting(conn, roles["planner"]):
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            conn.execute("CREATE FUNCTION conflictdb.mine() RETURNS int LANGUAGE sql AS 'SELECT 1'")
        conn.rollback()
        with connect(conn) as db:
            assert db.detach("s", "mission.ops") == 2
    assert conn.execute("SELECT to_regnamespace('conflictdb_attached') IS NULL").fetchone() == (True,)


def test_the_tables_of_others_are_compared_or_refused(conn: Conn, roles: dict[str, str]) -> None:
    with acting(conn, roles["other"]), connect(conn) as db, pytest.raises(StoreError, match="schema mission"):
        db.attach("s", "area", "mission.ops", MAP)
    with acting(conn, roles["planner"]):
        conn.execute(sql.SQL("GRANT USAGE ON SCHEMA mission TO {}").format(sql.Identifier(roles["other"])))
    with acting(conn, roles["other"]), connect(conn) as db, pytest.raises(InvalidInput, match="cannot be read by role"):
        db.attach("s", "area", "mission.ops", MAP)
    with acting(conn, roles["planner"]):
        conn.execute(sql.SQL("GRANT SELECT ON mission.ops TO {}").format(sql.Identifier(roles["other"])))
    with acting(conn, roles["other"]), connect(conn) as db:
        with pytest.raises(InvalidInput, match=r"only its owner may give .* does not own mission.ops"):
            db.attach("s", "area", "mission.ops", MAP)
        db.attach("s", "area", "mission.ops", MAP, every_s=60)
    follow(conn, roles["keeper"])
    assert keys(conn) == ["1"]
    # Rights that are taken away are gone here too.
    with acting(conn, roles["planner"]):
        conn.execute(sql.SQL("REVOKE SELECT ON mission.ops FROM {}").format(sql.Identifier(roles["other"])))
    conn.execute("UPDATE conflictdb.attachment SET compared_at = compared_at - interval '1 hour'")
    conn.commit()
    follow(conn, roles["keeper"])
    with connect(conn) as db:
        assert "permission denied for table ops" in str(db.attachments()[0].error)
    assert keys(conn) == ["1"]


def test_row_level_security_that_hides_rows_is_refused(conn: Conn, roles: dict[str, str]) -> None:
    """Also when it comes later: rows that are hidden are not gone."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.attach("s", "area", "mission.ops", MAP)
    follow(conn, roles["keeper"])
    with acting(conn, roles["planner"]):
        conn.execute("ALTER TABLE mission.ops ENABLE ROW LEVEL SECURITY")
        conn.execute("UPDATE mission.ops SET id = 2")
    follow(conn, roles["keeper"])
    assert keys(conn) == ["2"], "its owner sees all"
    with acting(conn, roles["planner"]):
        conn.execute("ALTER TABLE mission.ops FORCE ROW LEVEL SECURITY")
        conn.execute("TRUNCATE mission.ops")
    follow(conn, roles["keeper"])
    with connect(conn) as db:
        assert "would be affected by row-level security" in str(db.attachments()[0].error)
    assert keys(conn) == ["2"]
    with acting(conn, roles["planner"]), connect(conn) as db, pytest.raises(InvalidInput, match="hides rows from role"):
        db.attach("s", "area", "mission.ops", MAP)


@pytest.mark.parametrize(
    "table", ["pg_temp.mine", "conflictdb.area", "pg_catalog.pg_class", "mission.ops_id", "public.spatial_ref_sys_pkey"]
)
def test_what_is_no_table_of_a_mission_is_refused(conn: Conn, table: str) -> None:
    conn.execute("CREATE SCHEMA mission; CREATE SEQUENCE mission.ops_id")
    conn.execute("CREATE TEMPORARY TABLE mine (id integer, shape geometry)")
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.commit()
    with connect(conn) as db, pytest.raises(InvalidInput, match=r"table: (is|must be)"):
        db.attach("s", "area", table, MAP)


TROJAN = """
CREATE OR REPLACE FUNCTION conflictdb_attached.rows_{number}(text[], text) RETURNS SETOF conflictdb.attached_row
LANGUAGE plpgsql VOLATILE SECURITY DEFINER AS $$
BEGIN
    BEGIN
        {attempt};
    EXCEPTION WHEN OTHERS THEN
        RAISE WARNING '%', SQLERRM;
    END;
    RETURN;
END $$
"""


@pytest.mark.parametrize(
    "attempt",
    [
        "PERFORM set_config('search_path', 'evil, pg_catalog', false)",
        "PERFORM set_config('session_replication_role', 'replica', false)",
        "SET ROLE NONE",
        "RESET SESSION AUTHORIZATION",
        "CREATE TEMPORARY TABLE staged_attached (x integer)",
        "CREATE TEMPORARY TABLE attached_item (x integer)",
        "INSERT INTO mission.trap VALUES (1)",
        "LISTEN evil",
        "INSERT INTO conflictdb.attached_change (attachment_id) VALUES (999)",
        "DELETE FROM conflictdb.area",
        "PREPARE evil AS SELECT 1",
        "EXECUTE 'DECLARE evil CURSOR WITH HOLD FOR SELECT 1'",
    ],
)
def test_code_of_who_attached_has_no_effect_on_the_worker(conn: Conn, roles: dict[str, str], attempt: str) -> None:
    """It owns the function that reads its table, and may replace it with any other."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.attach("s", "area", "mission.ops", MAP)
        conn.execute("CREATE TABLE mission.trap (x integer)")
        conn.execute("CREATE TABLE mission.caught (who text)")
        conn.execute("GRANT ALL ON mission.caught TO PUBLIC; GRANT USAGE ON SCHEMA mission TO PUBLIC")
        conn.execute(
            """CREATE FUNCTION mission.spring() RETURNS trigger LANGUAGE plpgsql AS
               $$ BEGIN INSERT INTO mission.caught VALUES (current_user); RETURN NULL; END $$"""
        )
        conn.execute(
            """CREATE CONSTRAINT TRIGGER spring AFTER INSERT ON mission.trap DEFERRABLE INITIALLY DEFERRED
               FOR EACH ROW EXECUTE FUNCTION mission.spring()"""
        )
    follow(conn, roles["keeper"])
    assert keys(conn) == ["1"]
    with acting(conn, roles["planner"]):
        conn.execute(TROJAN.format(number=number, attempt=attempt).encode())
        conn.execute("UPDATE mission.ops SET id = 2")
    state = "SELECT current_setting('search_path'), current_setting('session_replication_role'), current_user"
    with acting(conn, roles["keeper"]):
        before = conn.execute(state).fetchone()
        conn.commit()
        attached.follow(conn, "s", again=True)
        assert conn.execute(state).fetchone() == before
        assert conn.execute("SELECT pg_listening_channels()").fetchall() == []
        assert conn.execute("SELECT count(*) FROM pg_cursors WHERE name = 'evil'").fetchone() == (0,)
        conn.commit()
    assert conn.execute("SELECT * FROM mission.caught").fetchall() == []
    assert conn.execute("SELECT count(*) FROM conflictdb.attached_change").fetchone() == (0,)
    conn.commit()
    if "PREPARE" not in attempt:  # names of statements last, but nothing uses any
        assert conn.execute("SELECT count(*) FROM pg_prepared_statements").fetchone() == (0,)
    assert keys(conn) == [], "by this function, it has no rows"


def test_a_function_that_does_not_end_is_given_up(
    conn: Conn, roles: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("conflictdb.db.store.attached._READ_WITHIN", "200ms")
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.attach("s", "area", "mission.ops", MAP)
        conn.execute(TROJAN.format(number=number, attempt="PERFORM pg_sleep(60)").encode())
    follow(conn, roles["keeper"])
    with connect(conn) as db:
        assert "statement timeout" in str(db.attachments()[0].error)
        assert list(store.waiting_scenes(conn)) == []
        assert not db.scenes()[0].is_current
