"""Branches whose parent changes at the same time: nobody waits, and the next detection follows."""

from collections.abc import Iterator
from typing import Any

import psycopg
import pytest

from conflictdb import Area, Scene, connect, store
from conflictdb.errors import ConflictDBError
from conflictdb.jobs import detect

Conn = psycopg.Connection[Any]

AREA = "'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))'"
NEAR = "'SRID=4326;POLYGON((1.001 0, 2 0, 2 1, 1.001 1, 1.001 0))'"
CURRENT = "SELECT conflictdb_internal._is_current(scene_id) FROM conflictdb.scene WHERE name = 'b'"


@pytest.fixture
def other(dsn: str) -> Iterator[Conn]:
    with psycopg.connect(dsn) as conn:
        yield conn
        conn.rollback()


@pytest.fixture
def parent(conn: Conn) -> Conn:
    """Scene s, with two areas that are 111 m apart, one with a class."""
    conn.execute("SET lock_timeout = '1 s'")
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute(f"SELECT conflictdb.put_area('s', 'A', {AREA}, p_class => 'tug')".encode())
    conn.execute(f"SELECT conflictdb.put_area('s', 'N', {NEAR})".encode())
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    return conn


def ask(conn: Conn, query: str) -> Any:
    with conn.transaction():
        row = conn.execute(query.encode()).fetchone()
    return row[0] if row else None


def pairs(conn: Conn, scene: str) -> set[frozenset[str]]:
    with conn.transaction():
        rows = conn.execute(
            "SELECT a_key, b_key FROM conflictdb.conflicts WHERE scene = %s AND verdict <> 'near'", [scene]
        ).fetchall()
    return {frozenset(row) for row in rows}


CHANGES = {
    "settings": "SELECT conflictdb.create_scene('s', p_separation_m => 500)",
    "rules": "SELECT conflictdb.put_rule('s', 'tug', NULL, 500)",
}


@pytest.mark.parametrize("change", ["settings", "rules"])
def test_a_branch_that_is_made_meanwhile_follows(parent: Conn, other: Conn, change: str) -> None:
    """Its transaction does not see the change, and the change does not see the branch."""
    other.execute("SELECT conflictdb.create_branch('s', 'b')")
    other.execute(f"SELECT conflictdb.put_area('b', 'A', {AREA}, p_class => 'tug')".encode())
    parent.execute(CHANGES[change].encode())
    parent.commit()
    other.commit()
    assert ask(parent, CURRENT) is False
    assert "b" in store.waiting_scenes(parent)
    detect.detect_pending(parent, "b", jobs=1)
    assert ask(parent, CURRENT) is True
    assert pairs(parent, "b") == {frozenset("AN")}
    assert store.waiting_scenes(parent) == {}


@pytest.mark.parametrize("change", ["settings", "rules"])
@pytest.mark.parametrize(
    "lock",
    [
        "SELECT FROM conflictdb.scene WHERE name = 'b' FOR UPDATE",
        "SELECT conflictdb.rename_scene('b', 'c')",
        "SELECT FROM conflictdb.rule r JOIN conflictdb.scene s USING (scene_id) WHERE s.name = 'b' FOR UPDATE OF r",
        "SELECT conflictdb.drop_branch('b')",
    ],
)
def test_a_branch_that_is_locked_meanwhile_follows(parent: Conn, other: Conn, change: str, lock: str) -> None:
    parent.execute("SELECT conflictdb.put_rule('s', 'ferry', 'barge', 5)")
    parent.execute("SELECT conflictdb.create_branch('s', 'b')")
    parent.execute(f"SELECT conflictdb.put_area('b', 'A', {AREA}, p_class => 'tug')".encode())
    parent.commit()
    detect.detect(parent, "b", jobs=1)
    other.execute(lock.encode())
    parent.execute(CHANGES[change].encode())
    parent.commit()
    detect.detect(parent, "s", jobs=1, lock_timeout_s=1.0)
    other.rollback()
    assert pairs(parent, "s") == {frozenset("AN")}
    detect.detect_pending(parent, "b", jobs=1)
    assert ask(parent, CURRENT) is True
    assert pairs(parent, "b") == {frozenset("AN")}


def test_a_key_that_both_add_hides_the_parents_object(parent: Conn, other: Conn) -> None:
    """The branch had a conflict with the parent's object before its own edit of the key was committed."""
    parent.execute("SELECT conflictdb.create_branch('s', 'b')")
    parent.execute(f"SELECT conflictdb.put_area('b', 'X', {AREA})".encode())
    parent.commit()
    far = "'SRID=4326;POLYGON((20 0, 21 0, 21 1, 20 1, 20 0))'"
    other.execute(f"SELECT conflictdb.put_area('b', 'K', {far})".encode())
    parent.execute(f"SELECT conflictdb.put_area('s', 'K', {AREA})".encode())
    parent.commit()
    detect.detect(parent, "s", jobs=1)
    detect.detect(parent, "b", jobs=1)
    assert frozenset("KX") in pairs(parent, "b")
    other.commit()
    assert ask(parent, CURRENT) is False
    detect.detect_pending(parent, "b", jobs=1)
    assert ask(parent, CURRENT) is True
    assert pairs(parent, "b") == {frozenset("AX")}
    with pytest.raises(psycopg.Error, match="were changed in 's' too"):
        parent.execute("SELECT conflictdb.merge_branch('b')")
    parent.rollback()


@pytest.mark.parametrize("lock", ["scene WHERE name = 'b' FOR UPDATE", "area WHERE key = 'X' FOR UPDATE"])
def test_a_branch_in_use_goes_with_its_parent(parent: Conn, other: Conn, lock: str) -> None:
    """At once for those who ask; its rows when it is free."""
    parent.execute("SELECT conflictdb.create_branch('s', 'b')")
    parent.execute(f"SELECT conflictdb.put_area('b', 'X', {AREA})".encode())
    parent.commit()
    other.execute(f"SELECT FROM conflictdb.{lock}".encode())
    parent.execute("SELECT conflictdb.remove_scene('s')")
    parent.commit()
    with connect(parent) as db, pytest.raises(Exception, match=r"'b'.*is not in this database"):
        db.scene("b").objects()
    store.drop_orphans(parent)
    assert ask(parent, "SELECT count(*) FROM conflictdb.scene") == 1
    other.rollback()
    store.drop_orphans(parent)
    for table in ("scene", "area", "change", "branch_edit", "object_key"):
        assert ask(parent, f"SELECT count(*) FROM conflictdb.{table}") == 0


@pytest.mark.parametrize(
    "statement",
    [
        "SELECT conflictdb.create_branch('t', 'b')",
        "SELECT conflictdb.create_scene('b')",
        "SELECT conflictdb.rename_scene('t', 'b')",
        "SELECT conflictdb.copy_scene('t', 'b')",
        "INSERT INTO conflictdb.scene (name) VALUES ('b')",
        "UPDATE conflictdb.scene SET name = 'b' WHERE name = 't'",
    ],
)
def test_a_branch_without_a_scene_takes_no_name(parent: Conn, other: Conn, statement: str) -> None:
    """Nobody sees it, and no worker may run, which would remove it: who takes the name does; another role, too."""
    parent.execute("SELECT conflictdb.create_scene('t')")
    parent.execute("SELECT conflictdb.create_branch('s', 'b')")
    parent.commit()
    other.execute("SELECT FROM conflictdb.scene WHERE name = 'b' FOR UPDATE")
    parent.execute("SELECT conflictdb.remove_scene('s')")
    parent.execute("SET ROLE conflictdb_editor")
    parent.commit()
    with pytest.raises(psycopg.Error, match="is still used by a branch of a removed scene") as found:
        parent.execute(statement.encode())
    assert found.value.sqlstate == "ZC007"
    parent.rollback()
    other.rollback()
    parent.execute("SET ROLE conflictdb_editor")
    parent.execute(statement.encode())
    parent.execute("RESET ROLE")
    parents = "SELECT count(*) FROM conflictdb.scene b JOIN conflictdb.scene p ON p.scene_id = b.parent_scene_id"
    assert ask(parent, parents) == ("branch" in statement)
    assert ask(parent, "SELECT count(*) FROM conflictdb.scene WHERE name = 'b'") == 1


def test_no_object_of_a_branch_keeps_its_parent_from_another_plane(parent: Conn, other: Conn) -> None:
    """Its role may be one that only reads the parent. Objects that do not fit are unresolved, and not merged."""
    other.execute("SELECT conflictdb.create_branch('s', 'b')")
    far = AREA.replace("0 0, 1 0, 1 1, 0 1, 0 0", "179 0, 179.9 0, 179.9 1, 179 0")
    other.execute(f"SELECT conflictdb.put_area('b', 'far', {far})".encode())
    other.commit()
    plane = "p_motion => 'great_circle', p_centre_lon => 0, p_centre_lat => 0"
    parent.execute(f"SELECT conflictdb.create_scene('s', {plane})".encode())
    parent.commit()
    for scene in "sb":
        detect.detect_pending(parent, scene, jobs=1)
    assert ask(parent, CURRENT) is True
    verdicts = "SELECT DISTINCT verdict FROM conflictdb.conflicts WHERE scene = 'b' AND 'far' IN (a_key, b_key)"
    assert ask(parent, verdicts) == "unresolved"
    with pytest.raises(psycopg.Error, match="'far': footprint: reaches"):
        other.execute("SELECT conflictdb.merge_branch('b')")


def test_heights_in_a_branch_keep_no_parent_from_another_datum(parent: Conn, other: Conn) -> None:
    """The branch alone stays behind, and its detection says why."""
    other.execute("SELECT conflictdb.create_branch('s', 'b')")
    other.execute(f"SELECT conflictdb.put_area('b', 'A', {AREA}, p_floor_m => 5)".encode())
    other.commit()
    parent.execute("SELECT conflictdb.create_scene('s', p_vertical_datum => 'wgs84')")
    parent.commit()
    assert ask(parent, CURRENT) is False
    detect.detect_pending(parent, "s", jobs=1)
    with pytest.raises(ConflictDBError, match="vertical_datum: must stay 'msl' while objects have heights"):
        detect.detect_pending(parent, "b", jobs=1)
    parent.rollback()
    assert ask(parent, CURRENT) is False
    other.execute("SELECT conflictdb.remove_object('b', 'A')")
    other.commit()
    detect.detect_pending(parent, "b", jobs=1)
    assert ask(parent, CURRENT) is True


def test_a_branch_that_has_lost_its_parent_takes_no_scene_with_it(parent: Conn, other: Conn, dsn: str) -> None:
    """A scene of its name begins anew: its objects would go with the branch."""
    other.execute("SELECT conflictdb.create_branch('s', 'b')")
    parent.execute("SELECT conflictdb.remove_scene('s')")
    parent.commit()
    other.commit()
    with connect(dsn) as db:
        db.scene("b").put(Area("A", [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]), Scene("b"))
        store.drop_orphans(parent)
        assert [one.key for one in db.scene("b").objects()] == ["A"]
