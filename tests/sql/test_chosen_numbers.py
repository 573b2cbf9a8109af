"""Only the database gives numbers and versions: an editor who could choose them would block others, or hide changes."""

from typing import Any

import psycopg
import pytest
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene

from conflictdb import store
from conflictdb.jobs.detect import detect

Conn = psycopg.Connection[Any]

LARGEST = 2**62 - 1
SHAPE = "'SRID=4326;MULTIPOLYGON(((0 0,1 0,1 1,0 1,0 0)))'"
PATH = "'SRID=4326;LINESTRING M (0 0 0, 1 1 3600)'"
AREA = f"""INSERT INTO conflictdb.area (area_id, scene_id, key, footprint)
    OVERRIDING SYSTEM VALUE SELECT {{id}}, scene_id, 'X', {SHAPE} FROM conflictdb.scene"""
TRACK = f"""INSERT INTO conflictdb.track (track_id, scene_id, key, path, outline)
    OVERRIDING SYSTEM VALUE SELECT {{id}}, scene_id, 'X', {PATH}, conflictdb.rectangle_outline(9, 9, 9, 9)
    FROM conflictdb.scene"""
SCENE = "INSERT INTO conflictdb.scene (scene_id, name) OVERRIDING SYSTEM VALUE VALUES ({id}, 'another')"
MARK = (
    "INSERT INTO conflictdb.change (scene_id, object_kind, object_id, version) SELECT scene_id, 0, {id}, 1 FROM scene"
)
# Inserts of another session, with the number that comes next.
NEXT = {
    AREA: "SELECT put_area('s', 'Y', 'SRID=4326;POLYGON((0 0,1 0,1 1,0 1,0 0))')",
    TRACK: f"SELECT put_track('s', 'Y', {PATH}, rectangle_outline(9, 9, 9, 9))",
    SCENE: "SELECT create_scene('t')",
}
# For each table with an identity column that editors or readers add rows to.
CHOSEN = [
    *(statement.format(id=2) for statement in NEXT),
    "INSERT INTO attached_change (attached_change_id, attachment_id) OVERRIDING SYSTEM VALUE VALUES (1, 1)",
    """INSERT INTO attachment (attachment_id, scene_id, object_kind, table_schema, table_name, map, identity_columns,
                               has_triggers, every)
       OVERRIDING SYSTEM VALUE SELECT 1, scene_id, 0, 'a', 'b', '{}', '{}', false, '1 h' FROM scene""",
    """INSERT INTO probe_request (probe_id, scene_id, kind)
       OVERRIDING SYSTEM VALUE SELECT 1, scene_id, 'probe' FROM scene""",
    """INSERT INTO change (change_id, scene_id, object_kind, object_id, version)
       OVERRIDING SYSTEM VALUE SELECT 99, scene_id, 0, 1, 1 FROM scene""",
    "UPDATE area SET area_id = DEFAULT",
    "UPDATE area SET version = 1",
    "UPDATE area SET first_version = 1",
    f"INSERT INTO area (scene_id, key, footprint, first_version) SELECT scene_id, 'X', {SHAPE}, 1 FROM scene",
    f"INSERT INTO area (scene_id, key, footprint, version) SELECT scene_id, 'X', {SHAPE}, 9000 FROM scene",
    "SELECT setval('area_area_id_seq', 9)",
    "SELECT nextval('area_area_id_seq')",
    "SELECT setval('version_seq', 9)",
]


@pytest.fixture
def filled(rolled_back: Conn) -> Conn:
    """Scene s with an area A; the connection is an editor's."""
    rolled_back.execute("SELECT create_scene('s')")
    rolled_back.execute("SELECT put_area('s', 'A', 'SRID=4326;POLYGON((0 0,1 0,1 1,0 1,0 0))')")
    rolled_back.execute("SET ROLE conflictdb_editor")
    return rolled_back


@pytest.mark.parametrize("statement", CHOSEN)
def test_an_editor_chooses_no_number(filled: Conn, statement: str) -> None:
    with pytest.raises(psycopg.errors.InsufficientPrivilege), filled.transaction():
        filled.execute(statement.encode())


@pytest.mark.parametrize("statement", list(NEXT))
def test_an_editor_does_not_block_the_next_number(filled: Conn, statement: str) -> None:
    (last,) = filled.execute("SELECT greatest((SELECT max(scene_id) FROM scene), 1)").fetchall()[0]
    for ahead in range(1, 4):
        with pytest.raises(psycopg.errors.InsufficientPrivilege), filled.transaction():
            filled.execute(statement.format(id=last + ahead).encode())
    filled.execute(NEXT[statement].encode())


@pytest.mark.parametrize("statement", [AREA, TRACK, SCENE, MARK])
@pytest.mark.parametrize("number", [0, -1, LARGEST + 1, LARGEST + 2, 2**63 - 1, -(2**63)])
@pytest.mark.parametrize("as_replica", [False, True])
def test_nobody_gives_a_number_that_means_another_object(
    rolled_back: Conn, statement: str, number: int, as_replica: bool
) -> None:
    """Even the owner of the tables cannot: an object goes by its kind above 62 bits."""
    rolled_back.execute("SELECT create_scene('s')")
    if as_replica:
        rolled_back.execute("SET LOCAL session_replication_role = replica")
    with pytest.raises(psycopg.errors.CheckViolation, match="_in_range"):
        rolled_back.execute(statement.format(id=number).encode())


@pytest.mark.parametrize("as_replica", [False, True])
def test_restores_and_replicas_bring_numbers_beyond_the_sequence(rolled_back: Conn, as_replica: bool) -> None:
    """As the owner of the tables, who sets the sequences afterwards."""
    if as_replica:
        rolled_back.execute("SET LOCAL session_replication_role = replica")
    rolled_back.execute("INSERT INTO scene (scene_id, name) OVERRIDING SYSTEM VALUE VALUES (7000, 's')")
    for number, statement in ((LARGEST, AREA), (1, TRACK)):
        rolled_back.execute(statement.format(id=number).replace("'X'", f"'{number}'").encode())
    assert rolled_back.execute("SELECT count(*) FROM change").fetchone() == (2,)


def test_marks_that_an_editor_makes_lose_no_conflict(conn: Conn) -> None:
    """Nothing depends on their version, and marks of missing objects are cleared."""
    conn.execute("SET search_path = conflictdb, conflictdb_internal, public")
    conn.commit()
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 31, 8, 8)
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    detect(conn, scene.name, jobs=1)
    found = {(c.a_key, c.b_key, c.periods) for c in store.conflicts(conn, scene.name)}
    conn.commit()
    assert found
    with conn.transaction():
        conn.execute("SET LOCAL ROLE conflictdb_editor")
        conn.execute(
            """INSERT INTO change (scene_id, object_kind, object_id, version)
               SELECT s.scene_id, k, i, v FROM scene s, generate_series(0, 1) k,
                      unnest(ARRAY[1, 2, 3, 4611686018427387903]) i,
                      unnest(ARRAY[-9223372036854775808, 0, 1, 9223372036854775807]) v"""
        )
    detect(conn, scene.name, jobs=1)
    assert {(c.a_key, c.b_key, c.periods) for c in store.conflicts(conn, scene.name)} == found
    assert conn.execute("SELECT count(*) FROM change").fetchone() == (0,)


def test_editors_load_and_edit_as_before(conn: Conn) -> None:
    """By functions, by statements with names of columns, and by COPY."""
    conn.execute("SET ROLE conflictdb_editor")
    conn.execute("SET search_path = conflictdb, conflictdb_internal, public")
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 31, 8, 8)
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    with conn.cursor() as cursor, cursor.copy("COPY area (scene_id, key, footprint) FROM STDIN") as copy:
        copy.write_row((1, "COPIED", "SRID=4326;MULTIPOLYGON(((0 0,1 0,1 1,0 1,0 0)))"))
    conn.execute("UPDATE area SET name = 'new', floor_m = 3 WHERE key = 'COPIED'")
    conn.execute("UPDATE scene SET history_kept = '1 day', tolerance_m = 2")
    conn.execute("SELECT FROM scene FOR UPDATE")
    (counted,) = conn.execute("SELECT objects FROM scenes").fetchall()
    assert counted == (17,)
