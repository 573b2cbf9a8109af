"""Stage 1 finds every pair whose boxes meet, by its index, and only those with a changed member."""

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
from layouts import HARBOUR, LOW_LATITUDE, SEAM
from mixed_scenes import plain_scene
from piecework import Stored, expected_pairs, load, refresh, stored_pieces

from conflictdb import store
from conflictdb.arrays.column_numbers import numbers_of_words
from conflictdb.core import memory_budget
from conflictdb.core.memory_budget import DEFAULT_MEMORY
from conflictdb.core.near import Question
from conflictdb.errors import StoreError
from conflictdb.jobs import sources
from conflictdb.jobs.sources import joined
from conflictdb.model.plans import Area, EarthModel

Conn = psycopg.Connection[Any]


def candidates(conn: Conn, scene_id: int, at_once: int = 1_000_000) -> list[tuple[int, int]]:
    """Run stage 1 in a transaction that stays open; return its pairs of pieces."""
    store.begin_snapshot(conn)
    return [
        pair
        for found in store.candidates(conn, scene_id, at_once)
        for pair in zip(found.a.tolist(), found.b.tolist(), strict=True)
    ]


def assert_exactly(found: list[tuple[int, int]], pieces: list[Stored], changed: set[str] | None = None) -> None:
    """Every required pair is there, once; any other pair must be explained by boxes rounded to float32."""
    key = {p.piece_id: p.key for p in pieces}
    pairs = {frozenset(pair) for pair in found}
    assert len(pairs) == len(found)
    must, may = expected_pairs(pieces), expected_pairs(pieces, grown=16.0)
    if changed is not None:
        must, may = ({pair for pair in some if changed & {key[i] for i in pair}} for some in (must, may))
    assert must <= pairs <= may
    assert must


def joined_pairs(conn: Conn, scene_id: int, at_once: int = 1_000_000) -> list[list[tuple[int, int]]]:
    """Stage 1 joined by the client, in a transaction that stays open; its pairs of pieces, chunk by chunk."""
    store.begin_snapshot(conn)
    rows = store.boxes(conn, scene_id, 1_000_000)
    found = joined(rows.ids, rows.pieces, rows.boxes, at_once)
    return [list(zip(some.a.tolist(), some.b.tolist(), strict=True)) for some in found]


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, HARBOUR], ids=lambda w: w.name)
@pytest.mark.parametrize("is_layered", [False, True])
def test_a_whole_scene_joined_in_memory_has_the_pairs_of_the_database(
    conn: Conn, workload: Any, is_layered: bool
) -> None:
    """Every pair whose boxes meet, once; no pair with another scene or at other heights.

    Except boxes that meet only because the index rounds them outward. All pairs of two objects are in one chunk.
    """
    scene, areas, tracks = plain_scene(workload, 3, 25, 25, EarthModel.SPHERE if is_layered else EarthModel.WGS84)
    if is_layered:
        areas = [replace(a, floor_m=100.0 * (i % 3), ceiling_m=100.0 * (i % 3 + 1)) for i, a in enumerate(areas)]
    other = load(conn, *plain_scene(replace(LOW_LATITUDE, name="other"), 16, 10, 10))
    scene_id = load(conn, scene, areas, tracks)
    refresh(conn, other)
    refresh(conn, scene_id)
    pieces = stored_pieces(conn, scene_id)
    conn.rollback()
    known = candidates(conn, scene_id)
    assert_exactly(known, pieces)
    conn.rollback()
    (whole,) = joined_pairs(conn, scene_id)
    assert set(whole) <= set(known)
    assert_exactly(whole, pieces)
    conn.rollback()
    key = {p.piece_id: p.key for p in pieces}
    chunks = joined_pairs(conn, scene_id, 10)
    assert len(chunks) > 1
    assert sorted(pair for chunk in chunks for pair in chunk) == sorted(whole)
    of_objects = [{frozenset((key[a], key[b])) for a, b in chunk} for chunk in chunks]
    assert sum(map(len, of_objects)) == len(set[frozenset[str]]().union(*of_objects))


def test_boxes_are_those_of_a_whole_scene_that_is_small_enough(conn: Conn) -> None:
    scene_id = load(conn, *plain_scene(LOW_LATITUDE, 15, 5, 5))
    refresh(conn, scene_id)
    count = len(stored_pieces(conn, scene_id))
    conn.rollback()
    store.begin_snapshot(conn)
    assert len(store.boxes(conn, scene_id, count)) == count
    assert len(store.boxes(conn, scene_id, count - 1)) == 0
    # Whatever the memory: a server returns no answer of more than a gigabyte.
    assert len(list(store.candidates(conn, scene_id, 10**9))) == 1
    assert len(list(store.candidates(conn, scene_id, 10**9, fit=2))) > 1
    conn.execute("DELETE FROM conflictdb.change")
    assert len(store.boxes(conn, scene_id, count)) == 0
    conn.rollback()
    with pytest.raises(StoreError, match="REPEATABLE READ"):
        store.boxes(conn, scene_id, count)


def test_boxes_take_the_memory_of_their_columns_once(conn: Conn) -> None:
    """While they are read, and while they are sorted and joined: a million of them are joined beside 512 MB."""
    rows = 60_000
    scene_id = load(conn, *plain_scene(LOW_LATITUDE, 15, 5, 5))
    refresh(conn, scene_id)
    conn.execute(
        "INSERT INTO conflictdb.piece (scene_id, object_kind, object_id, version, part, turn, hull, span, floor_m, "
        "ceiling_m, shape, class_number, owner_number) "
        "SELECT scene_id, 0, 1000 + n, 1, 0, 0, ST_Translate(hull, 1e7 + 1e6 * n, 0), span, floor_m, ceiling_m, shape, "
        "class_number, owner_number "
        "FROM (SELECT * FROM conflictdb.piece WHERE object_kind = 0 LIMIT 1) p, generate_series(1, %s) n",
        [rows],
    )
    conn.commit()
    store.begin_snapshot(conn)
    tracemalloc.start()
    try:
        found = store.boxes(conn, scene_id, 10**6)
        _, reading = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        ids, pieces, boxes = found.ids, found.pieces, found.boxes
        del found
        pairs = sum(map(len, joined(ids, pieces, boxes, 1_000)))
        _, joining = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(ids) > rows
    assert pairs > 0
    # A row has 101 bytes in memory. Messages of the server are a megabyte at a time.
    assert reading < 110 * rows + 6 * 2**20
    # Sorting adds some temporary columns; not those of the kernel, which _BOX_BYTES counts.
    assert joining < memory_budget._BOX_BYTES * rows


def pairs_of_source(conn: Conn, scene_id: int, boxes: int) -> set[frozenset[tuple[int, ...]]]:
    """The pairs of pieces of a detection, by kind, object, part and turn; the client joins at most `boxes` boxes."""
    store.begin_snapshot(conn)
    found = set()
    for pieces, a, b, *_ in sources.Stored(conn, scene_id, DEFAULT_MEMORY._replace(boxes=boxes)).pairs(Question()):
        columns = (pieces.kind, pieces.object_id, pieces.part, pieces.turn)
        names = list(zip(*(column.tolist() for column in columns), strict=True))
        pairs = [frozenset((names[i], names[j])) for i, j in zip(a.tolist(), b.tolist(), strict=True)]
        assert found.isdisjoint(pairs)
        found |= set(pairs)
    conn.rollback()
    return found


def test_marked_pairs_joined_in_memory_are_those_of_the_database(conn: Conn) -> None:
    """With marks for all pairs of an object, and for those with a class or kind."""
    rng = np.random.default_rng(1)
    scene, areas, tracks = plain_scene(HARBOUR, 3, 40, 40)
    areas, tracks = (
        [replace(one, object_class=(None, "ferry", "drone", "tug")[rng.integers(4)]) for one in some]
        for some in (areas, tracks)
    )
    scene_id = load(conn, scene, areas, tracks)
    refresh(conn, scene_id)
    marks = conn.execute("SELECT object_kind, object_id, version FROM conflictdb.change").fetchall()
    with_numbers = [None, *numbers_of_words(["ferry", "drone", "track", "area"]).tolist()]
    conn.rollback()
    every = pairs_of_source(conn, scene_id, 10**6)
    for share, chosen in ((1.0, with_numbers[1:2]), (1.0, with_numbers[1:]), (0.5, with_numbers), (0.3, [None])):
        conn.execute("DELETE FROM conflictdb.change")
        for _ in range(2):
            for kind, number, version in (mark for mark in marks if rng.random() < share):
                conn.execute(
                    "INSERT INTO conflictdb.change (is_covered, scene_id, object_kind, object_id, version, "
                    "with_number) VALUES (true, %s, %s, %s, %s, %s)",
                    [scene_id, kind, number, version, chosen[rng.integers(len(chosen))]],
                )
        conn.commit()
        found = pairs_of_source(conn, scene_id, 10**6)
        assert found == pairs_of_source(conn, scene_id, 0)
        assert len(every) > len(found) > 20


def test_few_changed_objects_are_not_joined_in_memory(conn: Conn) -> None:
    scene_id = load(conn, *plain_scene(LOW_LATITUDE, 15, 30, 30))
    refresh(conn, scene_id)
    conn.execute("DELETE FROM conflictdb.change WHERE change_id > (SELECT min(change_id) + 1 FROM conflictdb.change)")
    conn.commit()
    store.begin_snapshot(conn)
    assert len(store.boxes(conn, scene_id, 1_000_000)) == 0
    conn.execute(
        "INSERT INTO conflictdb.change (scene_id, object_kind, object_id, version, is_covered) "
        "SELECT scene_id, 1, track_id, version, true FROM conflictdb.track"
    )
    assert len(store.boxes(conn, scene_id, 1_000_000)) == len(stored_pieces(conn, scene_id))


def test_only_pairs_with_a_changed_member_are_looked_at_again(conn: Conn) -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 5, 25, 25)
    scene_id = load(conn, scene, areas, tracks)
    refresh(conn, scene_id)
    conn.execute("DELETE FROM conflictdb.change")
    conn.commit()
    assert candidates(conn, scene_id) == []
    conn.commit()

    areas[3], areas[4], tracks[5] = (replace(x, floor_m=-1e4) for x in (areas[3], areas[4], tracks[5]))
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    refresh(conn, scene_id)
    found = candidates(conn, scene_id)
    assert_exactly(found, stored_pieces(conn, scene_id), {areas[3].key, areas[4].key, tracks[5].key})


@pytest.mark.parametrize(("is_all", "others"), [(True, 5), (True, 30), (False, 5)])
def test_pairs_come_some_at_a_time_and_those_of_two_objects_together(conn: Conn, is_all: bool, others: int) -> None:
    """With another scene in the same place, which is smaller or larger."""
    scene_id = load(conn, *plain_scene(LOW_LATITUDE, 15, 20, 20))
    refresh(conn, load(conn, *plain_scene(replace(LOW_LATITUDE, name="other"), 16, others, others)))
    refresh(conn, scene_id)
    conn.execute("ANALYZE conflictdb.piece")
    if not is_all:
        conn.execute("DELETE FROM conflictdb.change WHERE object_kind = 0")
        conn.commit()
    key = {p.piece_id: p.key for p in stored_pieces(conn, scene_id)}
    conn.rollback()
    whole = candidates(conn, scene_id)
    conn.rollback()
    store.begin_snapshot(conn)
    chunks = [
        list(zip(found.a.tolist(), found.b.tolist(), strict=True)) for found in store.candidates(conn, scene_id, 10)
    ]
    assert sorted(pair for chunk in chunks for pair in chunk) == sorted(whole)
    of_objects = [{frozenset((key[a], key[b])) for a, b in chunk} for chunk in chunks]
    assert sum(map(len, of_objects)) == len(set[frozenset[str]]().union(*of_objects))
    most = max(sum(1 for a, b in whole if frozenset((key[a], key[b])) == pair) for some in of_objects for pair in some)
    assert all(len(chunk) < 10 + most for chunk in chunks)
    assert len(chunks) > len(whole) // 20 > 2


def test_change_that_no_piece_reflects_yet_is_left_for_later(conn: Conn) -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 6, 10, 10)
    scene_id = load(conn, scene, areas, tracks)
    refresh(conn, scene_id)
    conn.execute("DELETE FROM conflictdb.change")
    conn.commit()
    store.replace_scene(conn, scene, [replace(a, floor_m=0.0) for a in areas], tracks, merge=False)
    assert candidates(conn, scene_id) == []


def test_changed_pieces_are_looked_up_in_the_index(conn: Conn) -> None:
    """Each changed piece, whatever the planner thinks of so small a table."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 7, 30, 30)
    scene_id = load(conn, scene, areas, tracks)
    refresh(conn, scene_id)
    conn.execute("DELETE FROM conflictdb.change WHERE object_id <> (SELECT min(area_id) FROM conflictdb.area)")
    conn.commit()
    assert candidates(conn, scene_id)
    row = conn.execute(
        """SELECT pg_stat_get_xact_numscans('conflictdb.piece_scene_id_hull_span_gist'::regclass) >= count(*),
                  count(*) > 0
           FROM conflictdb.piece JOIN conflictdb.change USING (object_kind, object_id)"""
    ).fetchone()
    assert row == (True, True)


def test_plan_joins_on_the_one_index_over_scene_hull_and_span(conn: Conn) -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 8, 200, 200)
    refresh(conn, load(conn, scene, areas, tracks))
    plan = "\n".join(
        row[0] for row in conn.execute("EXPLAIN SELECT * FROM conflictdb.candidates(%s)", [scene.name]).fetchall()
    )
    assert "piece_scene_id_hull_span_gist" in plan
    condition = next(line for line in plan.splitlines() if "Index Cond" in line and "&&" in line)
    for column in ("scene_id = ", "hull && ", "span && "):
        assert column in condition
    index = conn.execute("SELECT indexdef FROM pg_indexes WHERE indexname = 'piece_scene_id_hull_span_gist'").fetchone()
    assert index == (
        "CREATE INDEX piece_scene_id_hull_span_gist ON conflictdb.piece USING gist (scene_id, hull, span)",
    )


def test_detection_must_read_one_snapshot(conn: Conn) -> None:
    scene_id = load(conn, *plain_scene(LOW_LATITUDE, 9, 2, 2))
    with pytest.raises(StoreError, match="REPEATABLE READ"):
        list(store.candidates(conn, scene_id, 1))


def test_unbounded_spans_meet_everything(conn: Conn) -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 10, 2, 1)
    areas = [Area("always", areas[0].footprint), Area("also", areas[0].footprint, end_us=-(10**15))]
    scene_id = load(conn, scene, areas, tracks)
    refresh(conn, scene_id)
    pairs = candidates(conn, scene_id)
    key = {p.piece_id: p.key for p in stored_pieces(conn, scene_id)}
    found = {frozenset(key[i] for i in pair) for pair in pairs}
    assert frozenset(("always", "also")) in found
    assert frozenset(("also", tracks[0].key)) not in found
