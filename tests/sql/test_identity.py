"""A number that passes from an object to another takes nothing along, and scenes do not reach into each other."""

from datetime import UTC, datetime
from typing import Any

import psycopg
import pytest
from mixed_scenes import mixed_scene
from piecework import load, refresh, stage

from conflictdb import store
from conflictdb.core.run import run_scene
from conflictdb.earth.registry import Setup
from conflictdb.jobs.detect import detect
from conflictdb.jobs.sources import Stored
from conflictdb.store import write_rows

Conn = psycopg.Connection[Any]

# Two squares that overlap, and one far from them.
PUT = "SELECT put_area(%s, %s, ST_SetSRID(ST_MakeEnvelope(%s, 50, %s, 51), 4326))"
# With the number of another area, which restores, merges and replicas may bring.
REUSE = """
INSERT INTO area (area_id, scene_id, key, footprint, active_span, properties)
    OVERRIDING SYSTEM VALUE
    SELECT %s, s.scene_id, %s, ST_Multi(ST_SetSRID(ST_MakeEnvelope(%s, 50, %s, 51), 4326)), NULL, '{}'
    FROM scene s WHERE s.name = %s
"""
TRACK = """
INSERT INTO track (track_id, scene_id, key, path, outline, properties)
    OVERRIDING SYSTEM VALUE
    SELECT %s, s.scene_id, %s, 'SRID=4326;LINESTRING M(30 57 1000,31 57 2000)', rectangle_outline(9, 9, 9, 9), '{}'
    FROM scene s WHERE s.name = %s
"""
HERE = "ST_SetSRID(ST_MakeEnvelope(0, 50, 2, 51), 4326)"
ALWAYS = "'[2026-01-01 00:00+00,2026-01-02 00:00+00)'::tstzrange"


def put(conn: Conn, scene: str, key: str, west: float) -> int:
    row = conn.execute(PUT.encode(), [scene, key, west, west + 1]).fetchone()
    assert row is not None
    return int(row[0])


@pytest.fixture(params=["copied", "stated"], autouse=True)
def _way_to_write(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have new rows written in either way."""
    if request.param == "copied":
        monkeypatch.setattr(write_rows, "_MANY_NEW", 1)


@pytest.fixture
def numbers(conn: Conn) -> dict[str, int]:
    """Scenes one and two, each with areas A and B that overlap; returns the numbers of the areas."""
    conn.execute("SET search_path = conflictdb, conflictdb_internal, public")
    numbers = {}
    for scene in ("one", "two"):
        conn.execute("SELECT create_scene(%s)", [scene])
        for key, west in (("A", 0.0), ("B", 0.5)):
            numbers[f"{scene} {key}"] = put(conn, scene, key, west)
        conn.commit()
        detect(conn, scene, jobs=1)
    return numbers


def pass_on(conn: Conn, number: int, scene: str, key: str, west: float) -> None:
    """Remove the area with a number, and give the number to another."""
    conn.execute("DELETE FROM area WHERE area_id = %s", [number])
    conn.execute(REUSE.encode(), [number, key, west, west + 1, scene])
    conn.commit()


def pairs(conn: Conn, what: str) -> list[tuple[Any, ...]]:
    return conn.execute(f"SELECT a_key, b_key FROM {what} ORDER BY a_key, b_key".encode()).fetchall()


def state(conn: Conn, scene: str) -> list[tuple[Any, ...]]:
    """Return the conflicts of a scene, with its number of pieces."""
    return conn.execute(
        """SELECT c.a_key, c.b_key, c.is_current, c.run_id, c.found_at, ST_AsText(c.region),
                  (SELECT count(*) FROM piece p JOIN scene s USING (scene_id) WHERE s.name = c.scene)
           FROM conflicts c WHERE c.scene = %s""",
        [scene],
    ).fetchall()


@pytest.mark.parametrize("west", [0.5, 80.0])
@pytest.mark.parametrize("scene", ["one", "two"])
def test_pieces_are_not_inherited(conn: Conn, numbers: dict[str, int], scene: str, west: float) -> None:
    pass_on(conn, numbers["one B"], scene, "NEW", west)
    assert pairs(conn, "candidates('one')") == []
    assert pairs(conn, "candidates('two')") == [("A", "B")]
    probed = f"SELECT key FROM probe('one', {HERE}, {ALWAYS})"
    # An area that no detection has seen is compared as it is now.
    is_here = scene == "one" and west < 2.0
    assert sorted(conn.execute(probed.encode()).fetchall()) == [("A",), ("NEW",)][: 1 + is_here]


def test_conflicts_keep_their_keys_until_they_are_computed_anew(conn: Conn, numbers: dict[str, int]) -> None:
    pass_on(conn, numbers["one B"], "one", "NEW", 0.5)
    query = "SELECT a_key, b_key, is_current, found_at FROM conflicts WHERE scene = 'one'"
    ((*before, found_at),) = conn.execute(query.encode()).fetchall()
    assert before == ["A", "B", False]
    conn.commit()
    run = detect(conn, "one", jobs=1)
    assert (run.opened, run.changed, run.closed) == (1, 0, 1)
    ((*after, found_anew_at),) = conn.execute(query.encode()).fetchall()
    assert after == ["A", "NEW", True]
    assert found_anew_at > found_at


def test_an_object_that_changes_keeps_what_was_found_of_it(conn: Conn, numbers: dict[str, int]) -> None:
    query = "SELECT a_key, b_key, found_at FROM conflicts WHERE scene = 'one'"
    before = conn.execute(query.encode()).fetchall()
    put(conn, "one", "B", 0.6)
    assert pairs(conn, "candidates('one')") == [("A", "B")]
    conn.commit()
    run = detect(conn, "one", jobs=1)
    assert (run.opened, run.closed) == (0, 0)
    assert conn.execute(query.encode()).fetchall() == before


@pytest.mark.parametrize("order", [("one", "two"), ("two", "one")])
def test_a_number_that_passes_to_another_scene(conn: Conn, numbers: dict[str, int], order: tuple[str, str]) -> None:
    """Detecting one scene leaves conflicts and pieces of the other as they are."""
    pass_on(conn, numbers["one B"], "two", "NEW", 0.5)
    for scene, other in (order, order[::-1]):
        before = state(conn, other)
        conn.commit()
        detect(conn, scene, jobs=1)
        assert state(conn, other) == before
    assert pairs(conn, "conflicts WHERE scene = 'one'") == []
    assert pairs(conn, "conflicts WHERE scene = 'two'") == [("A", "B"), ("A", "NEW"), ("B", "NEW")]
    assert conn.execute("SELECT is_current FROM scenes").fetchall() == [(True,), (True,)]


def test_both_numbers_of_a_pair_pass_to_another_scene(conn: Conn, numbers: dict[str, int]) -> None:
    before = state(conn, "one")
    pass_on(conn, numbers["one A"], "two", "C", 0.2)
    pass_on(conn, numbers["one B"], "two", "D", 0.3)
    detect(conn, "two", jobs=1)
    ((*kept, current, run_id, found_at, region, pieces),) = state(conn, "one")
    assert [(*kept, True, run_id, found_at, region, pieces)] == before
    assert not current
    assert len(pairs(conn, "conflicts WHERE scene = 'two'")) == 6


def test_a_number_that_passes_on_during_a_detection(conn: Conn, numbers: dict[str, int]) -> None:
    """Pieces of the old object exist, and the new object has its number when its conflicts are written."""
    put(conn, "one", "B", 0.6)
    conn.commit()
    refresh(conn, store.scene_id(conn, "one"))
    pass_on(conn, numbers["one B"], "one", "NEW", 80.0)
    store.begin_snapshot(conn)
    scene_id = store.scene_id(conn, "one")
    settings = store.read_settings(conn, scene_id)
    run = store.RunRecord("exact", {}, datetime(2026, 1, 1, tzinfo=UTC))
    staged = store.begin_write(conn, scene_id, run)
    ((found, _),) = run_scene(Setup.of(settings), Stored(conn, scene_id))
    assert len(found) == 1
    stage(conn, staged, found)
    store.end_write(conn, staged, run)
    conn.commit()
    assert pairs(conn, "conflicts WHERE scene = 'one'") == []
    assert conn.execute("SELECT is_current FROM scenes WHERE scene = 'one'").fetchone() == (False,)


def test_regions_are_not_made_of_the_pieces_of_another(conn: Conn, numbers: dict[str, int]) -> None:
    """Between the two transactions of a detection, and when the number is in use in another scene."""
    region = """SELECT ST_AsText(_conflict_region(c.scene_id, c.a_kind, c.a_id, c.a_version, c.b_kind, c.b_id,
                                                  c.b_version, c.periods, 'wgs84'), 6)
                FROM conflict c JOIN scene USING (scene_id) WHERE name = 'one'"""
    (before,) = conn.execute(region.encode()).fetchall()
    assert before != (None,)
    pass_on(conn, numbers["one B"], "two", "NEW", 0.2)
    detect(conn, "two", jobs=1)
    assert conn.execute(region.encode()).fetchall() == [before]
    conn.execute("DELETE FROM area WHERE key = 'NEW'")
    pass_on(conn, numbers["one B"], "one", "NEW", 0.2)
    refresh(conn, store.scene_id(conn, "one"))
    assert conn.execute(region.encode()).fetchall() == [(None,)]


def test_a_sequence_that_was_set_back(conn: Conn, numbers: dict[str, int]) -> None:
    """As after restores: versions stay later than the existing ones of the number."""
    conn.execute("SELECT setval('version_seq', 1, false)")
    pass_on(conn, numbers["one B"], "one", "NEW", 0.5)
    assert pairs(conn, "candidates('one')") == []
    put(conn, "two", "B", 0.6)
    assert pairs(conn, "candidates('two')") == [("A", "B")]
    conn.commit()
    for scene in ("one", "two"):
        detect(conn, scene, jobs=1)
    assert pairs(conn, "conflicts") == [("A", "B"), ("A", "NEW")]
    assert pairs(conn, "candidates('two')") == [("A", "B")]


def test_replicas_inherit_nothing_either(conn: Conn, numbers: dict[str, int]) -> None:
    conn.execute("SET LOCAL session_replication_role = replica")
    pass_on(conn, numbers["one B"], "one", "NEW", 0.5)
    assert pairs(conn, "candidates('one')") == []
    conn.commit()
    detect(conn, "one", jobs=1)
    assert pairs(conn, "conflicts WHERE scene = 'one'") == [("A", "NEW")]


def test_tracks_inherit_nothing(conn: Conn) -> None:
    conn.execute("SET search_path = conflictdb, conflictdb_internal, public")
    mixed = mixed_scene(7, ())
    scene = mixed.scene
    load(conn, scene, mixed.areas, mixed.tracks)
    conn.commit()
    detect(conn, scene.name, jobs=1)
    query = f"SELECT a_key, b_key FROM candidates('{scene.name}') WHERE '%s' IN (a_key, b_key)"
    assert conn.execute((query % "T1").encode()).fetchall()
    (number,) = conn.execute("DELETE FROM track WHERE key = 'T1' RETURNING track_id").fetchall()[0]
    conn.execute(TRACK.encode(), [number, "NEW", scene.name])
    assert conn.execute((query % "NEW").encode()).fetchall() == []
    conn.commit()
    detect(conn, scene.name, jobs=1)
    assert [c for c in store.conflicts(conn, scene.name) if "NEW" in (c.a_key, c.b_key)] == []


def test_rows_that_refer_to_another_scene_reach_nothing(conn: Conn, numbers: dict[str, int]) -> None:
    """As a worker could write them."""
    before = state(conn, "two")
    conn.execute("INSERT INTO change (scene_id, object_kind, object_id, version) "
                 "SELECT scene_id, 0, %s, 1 FROM scene WHERE name = 'one'", [numbers["two B"]])  # fmt: skip
    conn.execute(
        """INSERT INTO piece (scene_id, object_kind, object_id, version, part, turn, hull, span, floor_m, ceiling_m,
                              shape)
           SELECT (SELECT scene_id FROM scene WHERE name = 'one'), 0, p.object_id, p.version, 7, 0, p.hull, p.span,
                  p.floor_m, p.ceiling_m, p.shape FROM piece p WHERE p.object_id = %s""",
        [numbers["two A"]],
    )
    assert pairs(conn, "candidates('one')") == [("A", "B")]
    conn.commit()
    detect(conn, "one", full=True, jobs=1)
    assert pairs(conn, "conflicts WHERE scene = 'one'") == [("A", "B")]
    assert [row[:-1] for row in state(conn, "two")] == [row[:-1] for row in before]


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE area SET area_id = DEFAULT WHERE key = 'A'",
        "UPDATE area SET scene_id = (SELECT max(scene_id) FROM scene) WHERE key = 'A'",
        "UPDATE scene SET scene_id = DEFAULT WHERE name = 'empty'",
    ],
)
def test_numbers_do_not_change(conn: Conn, numbers: dict[str, int], statement: str) -> None:
    conn.execute("SELECT create_scene('empty')")
    with pytest.raises(psycopg.Error, match="cannot change") as refused:
        conn.execute(statement.encode())
    assert refused.value.sqlstate == "ZC008"


def test_first_version_is_kept_by_the_database_alone(conn: Conn, numbers: dict[str, int]) -> None:
    conn.execute("UPDATE area SET first_version = 0, floor_m = 1")
    assert conn.execute("SELECT DISTINCT first_version > 0, first_version < version FROM area").fetchall() == [
        (True, True)
    ]
