"""Conflicts are replaced in one transaction, exactly for the pairs that were looked at; marks made meanwhile stay."""

import json
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from numpy.typing import NDArray
from patience import WAIT_S
from piecework import load, mark_all, refresh, write_run
from psycopg.pq import TransactionStatus

from conflictdb import store
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.polygons import Polygons
from conflictdb.core.conflict_regions import Meetings
from conflictdb.core.pieces.bundling import bundles_of
from conflictdb.earth.registry import Setup
from conflictdb.jobs.detect import detect as detect_scene
from conflictdb.model.methods import REMOVED, Method
from conflictdb.model.plans import INFINITY_US, Area, Scene, Track, rectangle_outline_m
from conflictdb.store import write_rows

Conn = psycopg.Connection[Any]

SCENE = Scene("s", tolerance_m=0.0)
T0_US = 1_772_323_200_000_000
RECORD = store.RunRecord(
    "nlp",
    {"tolerance_m": 0.0},
    datetime(2026, 3, 1, tzinfo=UTC),
    {
        "candidate_pairs": 7,
        "intersecting_pairs": 5,
        "window_pairs": 3,
        "solved_pairs": 2,
        "pieces_s": 0.1,
        "stage1_s": 0.2,
        "stage2_s": 0.3,
        "stage3_s": 0.4,
        "stage4_s": 0.5,
    },
)


def square(key: str, west: float) -> Area:
    return Area(key, shapely.MultiPolygon([shapely.box(west, 50, west + 1, 51)]), start_us=T0_US)


def track(key: str, east: float) -> Track:
    times = np.array([T0_US, T0_US + 3_600_000_000])
    return Track(key, np.array([[0.0, 50.5], [east, 50.5]]), times, rectangle_outline_m(100, 100, 100, 100))


# B and A overlap; T passes through both, U sails past them.
AREAS = [square("B", 0.5), square("A", 0.0)]
TRACKS = [track("T", 2.0), track("U", 3.0)]


def found(
    conn: Conn,
    pairs: dict[tuple[str, str], list[tuple[int, int]]],
    *,
    verdict: int = 0,
    at: tuple[float, float] | None = None,
) -> Conflicts:
    """Return results for pairs of keys, as the transaction sees the objects."""
    known = {
        key: (kind, number, version)
        for kind, key, number, version in conn.execute(
            """SELECT 0, key, area_id, version FROM conflictdb.area
               UNION ALL SELECT 1, key, track_id, version FROM conflictdb.track"""
        )
    }
    members = (np.array([known[pair[k]] for pair in pairs], dtype=np.int64).reshape(-1, 3) for k in (0, 1))
    a, b = ((one[:, 0].astype(np.int8), one[:, 1], one[:, 2]) for one in members)
    n = len(pairs)
    period_us = np.array([period for periods in pairs.values() for period in periods], np.int64).reshape(-1, 2)
    period_offset = np.cumsum([0, *(len(periods) for periods in pairs.values())]).astype(np.int64)
    return Conflicts.of_members(
        a,
        b,
        (period_us, period_offset),
        np.full(n, verdict, np.int8),
        first_contact_deg=np.tile(np.array(at or (np.nan, np.nan)), (n, 1)),
        time_error_s=np.full(n, 1e-6),  # less than any two periods below differ by
    )


def detect(
    conn: Conn, scene_id: int, pairs: dict[tuple[str, str], list[tuple[int, int]]], **more: Any
) -> store.RunOutcome:
    """Detect with a given answer; a session that was just closed may still have the lock."""
    begin(conn, scene_id, lock_timeout_s=None)
    conn.rollback()
    refresh(conn, scene_id)
    begin(conn, scene_id)
    outcome = write_run(conn, scene_id, RECORD, found(conn, pairs, **more))
    conn.commit()
    return outcome


def begin(conn: Conn, scene_id: int, lock_timeout_s: float | None = 0.0) -> int:
    return store.begin_locked(conn, scene_id, "s", lock_timeout_s, print)


ONE = [(T0_US, T0_US + 1)]
TWO = [(T0_US, T0_US + 1), (T0_US + 5, T0_US + 5)]
ALL = {("T", "A"): ONE, ("U", "T"): TWO, ("B", "A"): [(T0_US, INFINITY_US)]}


@pytest.fixture
def scene_id(conn: Conn) -> int:
    return load(conn, SCENE, AREAS, TRACKS)


def test_places_are_kept_within_half_a_turn(conn: Conn, scene_id: int) -> None:
    detect(conn, scene_id, {("A", "B"): ONE}, at=(181.0, 50.0))
    assert store.conflicts(conn, "s")[0].first_contact_deg == (-179.0, 50.0)


def test_run_is_recorded_with_its_funnel(conn: Conn, scene_id: int) -> None:
    outcome = detect(conn, scene_id, ALL, verdict=2)
    (run,) = store.runs(conn, "s")
    assert (run.run_id, run.opened, run.changed, run.closed) == (outcome.run_id, 3, 0, 0)
    assert (run.objects, run.conflicts, run.unresolved, run.error) == (4, 3, 3, None)
    assert (run.candidate_pairs, run.intersecting_pairs, run.window_pairs, run.solved_pairs) == (7, 5, 3, 2)
    assert (run.pieces_s, run.stage1_s, run.stage2_s, run.stage3_s, run.stage4_s) == (0.1, 0.2, 0.3, 0.4, 0.5)
    assert run.write_s is not None
    assert run.write_s > 0
    assert run.settings == {"tolerance_m": 0.0}
    assert run.started_at == RECORD.started_at
    (status,) = store.list_scenes(conn)
    assert (status.pending, status.conflicts, status.run_id, status.error) == (0, 3, outcome.run_id, None)


def test_detection_without_changes_changes_nothing(conn: Conn, scene_id: int) -> None:
    detect(conn, scene_id, ALL)
    before = store.conflicts(conn, "s", with_region=True)
    outcome = detect(conn, scene_id, {})
    assert (outcome.opened, outcome.changed, outcome.closed) == (0, 0, 0)
    assert store.conflicts(conn, "s", with_region=True) == before


def test_rows_that_are_the_same_are_not_written_again(conn: Conn, scene_id: int) -> None:
    """Not even rows of a changed object, if they are equal: only the row that differs is written."""
    versions = "SELECT a_key, b_key, xmin::text, ctid::text FROM conflictdb.conflict ORDER BY a_key, b_key"
    detect(conn, scene_id, ALL)
    before = conn.execute(versions.encode()).fetchall()
    conn.commit()
    mark_all(conn, scene_id)
    conn.commit()
    detect(conn, scene_id, ALL)
    assert conn.execute(versions.encode()).fetchall() == before
    mark_all(conn, scene_id)
    conn.commit()
    assert detect(conn, scene_id, ALL | {("U", "T"): ONE}).changed == 1
    after = conn.execute(versions.encode()).fetchall()
    assert [old == new for old, new in zip(before, after, strict=True)] == [True, True, False]


def test_rows_found_under_other_settings_are_written_if_they_differ(conn: Conn, scene_id: int) -> None:
    """And those whose digest is not known, as before an upgrade; others stay where they are."""
    versions = "SELECT xmin::text FROM conflictdb.conflict ORDER BY a_key, b_key"

    def written(record: store.RunRecord = RECORD) -> bool:
        before = conn.execute(versions.encode()).fetchall()
        mark_all(conn, scene_id)
        conn.commit()
        refresh(conn, scene_id)
        begin(conn, scene_id)
        outcome = write_run(conn, scene_id, record, found(conn, ALL))
        conn.commit()
        assert (outcome.opened, outcome.changed, outcome.closed) == (0, 0, 0)
        after = conn.execute(versions.encode()).fetchall()
        conn.commit()
        return all(old != new for old, new in zip(before, after, strict=True))

    detect(conn, scene_id, ALL)
    assert not written()
    assert not written(replace(RECORD, settings={"tolerance_m": 1.0}))
    assert written(replace(RECORD, method="exact"))
    assert not written(replace(RECORD, method="exact"))
    conn.execute("UPDATE conflictdb.conflict SET digest = DEFAULT")
    assert written(replace(RECORD, method="exact"))


def test_where_is_found_out_for_what_differs_alone(conn: Conn, scene_id: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """For a real detection: a second full one computes no region, and rewritten rows keep the same region."""
    asked: list[int] = []
    regions = Meetings.regions

    def counted(self: Meetings, rows: NDArray[np.int64]) -> Polygons:
        asked.append(len(rows))
        return regions(self, rows)

    monkeypatch.setattr(Meetings, "regions", counted)
    where = "SELECT a_key, b_key, ST_AsEWKT(region) FROM conflictdb.conflict ORDER BY a_key, b_key"
    first = detect_scene(conn, "s", full=True)
    assert sum(asked) == first.conflicts > 0
    before = conn.execute(where).fetchall()
    conn.commit()
    asked.clear()
    detect_scene(conn, "s", full=True)
    assert asked == []
    conn.execute("UPDATE conflictdb.conflict SET digest = 1, region = NULL")
    conn.commit()
    detect_scene(conn, "s", full=True)
    assert sum(asked) == first.conflicts
    assert conn.execute(where).fetchall() == before
    assert all(region for *_, region in before)


def test_many_rows_are_written_in_parts(conn: Conn, scene_id: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """One run counts all of them, and the removed rows."""
    monkeypatch.setattr(write_rows, "_ROWS_AT_ONCE", 1)
    first = detect(conn, scene_id, ALL, verdict=2)
    assert (first.opened, first.conflicts, first.unresolved) == (3, 3, 3)
    mark_all(conn, scene_id)
    conn.commit()
    second = detect(conn, scene_id, {("T", "U"): ONE, ("A", "U"): ONE, ("B", "U"): ONE})
    assert (second.opened, second.changed, second.closed) == (2, 1, 2)
    assert (second.conflicts, second.unresolved) == (3, 0)
    assert [c.run_id for c in store.conflicts(conn, "s")] == [second.run_id] * 3
    assert conn.execute("SELECT run_id FROM conflictdb.run ORDER BY 1").fetchall() == [
        (first.run_id,),
        (second.run_id,),
    ]


@pytest.mark.parametrize("many", [False, True])
def test_runs_count_the_conflicts_of_the_scene(conn: Conn, scene_id: int, many: bool) -> None:
    """Also conflicts that they did not examine, and whether few objects changed or many."""
    detect(conn, scene_id, ALL, verdict=2)
    if many:
        conn.execute(
            """INSERT INTO conflictdb.change (scene_id, object_kind, object_id, version)
               SELECT %s, 0, 1000000 + n, 1 FROM generate_series(1, 2000) n""",
            [scene_id],
        )
        conn.commit()
    store.replace_scene(conn, SCENE, AREAS, [TRACKS[0], replace(TRACKS[1], floor_m=0.0)], merge=False)
    outcome = detect(conn, scene_id, {("T", "U"): ONE, ("A", "U"): ONE, ("B", "U"): ONE}, verdict=1)
    assert (outcome.opened, outcome.changed, outcome.closed) == (2, 1, 0)
    (run,) = store.runs(conn, "s")
    assert (run.conflicts, run.unresolved) == (5, 2)
    detect(conn, scene_id, {})
    (run,) = store.runs(conn, "s")
    assert (run.conflicts, run.unresolved) == (5, 2)


def test_conflicts_of_a_removed_object_stay_until_the_next_detection(conn: Conn, scene_id: int) -> None:
    detect(conn, scene_id, ALL)
    store.replace_scene(conn, SCENE, AREAS, TRACKS[1:], merge=False)
    assert {(c.a_key, c.b_key): c.is_current for c in store.conflicts(conn, "s")} == {
        ("A", "T"): False, ("T", "U"): False, ("A", "B"): True,
    }  # fmt: skip
    outcome = detect(conn, scene_id, {})
    assert outcome.closed == 2
    assert [(c.a_key, c.b_key) for c in store.conflicts(conn, "s")] == [("A", "B")]
    row = conn.execute(
        """SELECT count(*) FROM conflictdb.piece
           WHERE object_kind = 1 AND object_id NOT IN (SELECT track_id FROM conflictdb.track)"""
    ).fetchone()
    assert row == (0,)
    assert store.list_scenes(conn)[0].pending == 0


def test_changes_made_during_a_detection_stay_marked_and_disturb_nobody(conn: Conn, dsn: str, scene_id: int) -> None:
    """Writers change, add and remove objects, and settings, between and within both transactions: none fails."""
    with store.connect(dsn) as writer:
        begin(conn, scene_id)
        areas, _ = store.changed_areas(conn, scene_id), store.changed_tracks(conn, scene_id)
        assert len(areas) == 2
        store.replace_scene(writer, SCENE, [replace(AREAS[0], floor_m=1.0), AREAS[1]], TRACKS, merge=False)
        refresh_rest(conn, scene_id)
        store.replace_scene(writer, SCENE, [square("C", 0.2)], [], merge=True)
        begin(conn, scene_id)
        store.set_scene(writer, replace(SCENE, separation_m=10.0))
        store.replace_scene(writer, replace(SCENE, separation_m=10.0), AREAS[1:], TRACKS[:1], merge=False)
        write_run(conn, scene_id, RECORD, found(conn, ALL))
        conn.commit()
    current = {(c.a_key, c.b_key): c.is_current for c in store.conflicts(conn, "s")}
    assert current == {("A", "B"): False, ("A", "T"): False, ("T", "U"): False}
    assert store.list_scenes(conn)[0].pending == 5  # A, B, C, T, U; two of them removed
    outcome = detect(conn, scene_id, {("A", "T"): ONE})
    assert (outcome.opened, outcome.changed, outcome.closed) == (0, 0, 2)
    assert [c.is_current for c in store.conflicts(conn, "s")] == [True]
    assert store.list_scenes(conn)[0].pending == 0


def refresh_rest(conn: Conn, scene_id: int) -> None:
    """Finish transaction 1 on the snapshot that is open."""
    from conflictdb.core.pieces.covers import pieces_of

    settings = store.read_settings(conn, scene_id)
    areas, tracks = store.changed_areas(conn, scene_id), store.changed_tracks(conn, scene_id)
    assert areas.floor_m.tolist() == [-np.inf, -np.inf]  # still the snapshot's
    pieces = pieces_of(Setup.of(settings), areas, tracks)
    store.replace_pieces(conn, scene_id, [bundles_of(pieces)])
    conn.commit()


def test_object_removed_after_its_pieces_were_made_drops_out(conn: Conn, dsn: str, scene_id: int) -> None:
    refresh(conn, scene_id)
    store.begin_snapshot(conn)
    result = found(conn, ALL)
    conn.rollback()
    with store.connect(dsn) as writer:
        store.replace_scene(writer, SCENE, AREAS, TRACKS[:1], merge=False)
    store.begin_snapshot(conn)
    write_run(conn, scene_id, RECORD, result)
    conn.commit()
    assert sorted((c.a_key, c.b_key) for c in store.conflicts(conn, "s")) == [("A", "B"), ("A", "T")]
    assert store.list_scenes(conn)[0].pending == 1


def test_listeners_are_told_what_a_detection_changed(conn: Conn, dsn: str, scene_id: int) -> None:
    with psycopg.connect(dsn, autocommit=True) as listener:
        listener.execute("LISTEN conflictdb")
        outcome = detect(conn, scene_id, ALL)
        (heard,) = listener.notifies(timeout=WAIT_S, stop_after=1)
    assert json.loads(heard.payload) == {"scene": "s", "run": outcome.run_id, "opened": 3, "changed": 0, "closed": 0}


def test_the_database_takes_the_methods_that_python_knows(conn: Conn) -> None:
    """Both refuse any other."""
    for method in Method:
        conn.execute("SELECT conflictdb.create_scene('m', p_method => %s)", [method])
    with pytest.raises(psycopg.Error, match=f"must be one of {', '.join(Method)}; got 'guess'"):
        conn.execute("SELECT conflictdb.create_scene('m', p_method => 'guess')")
    conn.rollback()
    for method, why in REMOVED.items():
        with pytest.raises(psycopg.Error, match=f"got '{method}', which {why}"):
            conn.execute("SELECT conflictdb.create_scene('m', p_method => %s)", [method])


def test_failed_detection_is_recorded_and_nothing_else_changes(conn: Conn, scene_id: int) -> None:
    detect(conn, scene_id, ALL)
    mark_all(conn, scene_id)
    conn.commit()
    number = store.record_failure(conn, scene_id, replace(RECORD, counted={"pieces_s": 0.1}), "ValueError: no")
    assert conn.info.transaction_status == TransactionStatus.IDLE
    (run,) = store.runs(conn, "s")
    assert (run.run_id, run.error, run.conflicts) == (number, "ValueError: no", None)
    assert (run.pieces_s, run.candidate_pairs, run.stage4_s) == (0.1, None, None)
    (status,) = store.list_scenes(conn)
    assert (status.error, status.conflicts, status.pending) == ("ValueError: no", 3, 4)


def test_renamed_object_keeps_one_row_per_pair(conn: Conn, scene_id: int) -> None:
    detect(conn, scene_id, ALL)
    conn.execute("UPDATE conflictdb.area SET key = 'Z' WHERE key = 'A'")
    conn.commit()
    detect(conn, scene_id, {("Z", "B"): ONE, ("Z", "T"): ONE})
    assert sorted((c.a_key, c.b_key) for c in store.conflicts(conn, "s")) == [("B", "Z"), ("T", "U"), ("Z", "T")]


def test_scene_with_conflicts_can_be_removed(conn: Conn, scene_id: int) -> None:
    detect(conn, scene_id, ALL)
    conn.execute("DELETE FROM conflictdb.scene")
    conn.commit()
    assert store.list_scenes(conn) == []
