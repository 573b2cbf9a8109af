"""`advise`: it changes nothing, its counts are those of a detection, and it says where there is nothing to advise."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from commands import STRAIT, Run
from layouts import LONG_LEGS, LOW_LATITUDE
from made_scenes import sea
from mixed_scenes import plain_scene

import conflictdb
from conflictdb import Area, EarthModel, InvalidInput, Method, Scene, Track, store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.client.advise import (
    DATABASE_PER_PIECE,
    FIXED_S,
    TEST_PER_CANDIDATE,
    TOLERANCES_M,
    TRIED,
    WRITE_PER_CONFLICT,
    Advice,
    Estimate,
    advise,
)
from conflictdb.client.estimates import Trial
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.registry import Setup

TABLES = ("scene", "area", "track", "change", "piece", "conflict", "run")
HOUR_US = 3_600_000_000
START_US = 1_772_323_200_000_000  # 1 March 2026


def contents(dsn: str) -> list[Any]:
    """Return every row of every table, with the transaction that wrote it."""
    with psycopg.connect(dsn) as conn:
        return [
            conn.execute(f"SELECT t.xmin::text, t.ctid::text, t::text FROM conflictdb.{table} t ORDER BY 2").fetchall()
            for table in TABLES
        ]


def of(advice: Advice, method: Method, tolerance_m: float) -> Estimate:
    (found,) = (one for one in advice.estimates if one.setting == Trial(method, tolerance_m))
    return found


def counts(advice: Advice) -> list[Any]:
    """Return all that does not depend on the clock."""
    return [advice.pairs, advice.sampled_pairs] + [
        repr(replace(one, seconds=0.0, database_s=0.0)) for one in advice.estimates
    ]


def strangers(count: int) -> list[Track]:
    """Tracks of an hour each, a day apart, all in the same place."""
    return [
        Track(
            f"T{i}",
            np.array([[5.0, 50.0], [5.1, 50.0]]),
            START_US + np.array([24 * i * HOUR_US, (24 * i + 1) * HOUR_US]),
            np.array([[0.0, 0.0]]),
        )
        for i in range(count)
    ]


@pytest.mark.parametrize("detected", [False, True])
def test_it_changes_nothing(dsn: str, detected: bool) -> None:
    """No row is written, with or without pending changes: readers may ask, in read-only sessions too."""
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        if detected:
            db.scene("strait").detect()
    before = contents(dsn)
    with conflictdb.connect(f"{dsn} options='-c default_transaction_read_only=on -c role=conflictdb_reader'") as db:
        assert db.scene("strait").advise().estimates
    assert contents(dsn) == before


def test_where_every_pair_is_sampled_counts_are_those_of_detections(dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        advice = db.scene("strait").advise()
        assert advice.sampled_pairs == advice.pairs
        for estimate in advice.estimates:
            setting, count = estimate.setting, estimate.conflicts
            done = db.scene("strait").detect(method=setting.method, tolerance_m=setting.tolerance_m, full=True)
            found = (estimate.candidate_pairs, estimate.intersecting_pairs, count.value)
            counted = [done.candidate_pairs, done.intersecting_pairs, done.conflicts]
            assert list(found) == pytest.approx(counted, rel=1e-12)
            assert count.low == count.value == count.high
            assert estimate.unresolved_share.count == done.unresolved


def test_estimates_are_near_what_a_detection_counts(dsn: str) -> None:
    """150 pairs of 240 objects are drawn: conflicts are within their interval, other counts within a factor of 3."""
    scene, areas, tracks = plain_scene(replace(LOW_LATITUDE, window=6.0), 4, 120, 120)
    advice = advise(scene, areas, tracks, sample=150, seed=1)
    assert advice.sampled_pairs == 150 < advice.pairs
    with conflictdb.connect(dsn) as db:
        store.replace_scene(db.connection, scene, areas, tracks, merge=False)
        for method in (Method.SCREEN, Method.EXACT):
            done = db.scene(scene.name).detect(method=method, full=True)
            estimate = of(advice, method, scene.tolerance_m)
            for value, true in (
                (estimate.candidate_pairs, done.candidate_pairs),
                (estimate.intersecting_pairs, done.intersecting_pairs),
                (estimate.conflicts.value, done.conflicts),
            ):
                assert true / 3 <= value <= true * 3, method
            assert estimate.conflicts.low <= done.conflicts <= estimate.conflicts.high, method


def test_cost_counts_no_regions_of_screen(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """`screen` stores none: neither the kernel nor the database computes them, and a row costs what a row costs."""
    without: list[int] = []
    stage = store.stage

    def counted(conn: Any, staged: Any, part: Any, region: Any) -> None:
        without.append(int((np.diff(region.offset) == 0).sum()))
        stage(conn, staged, part, region)

    monkeypatch.setattr(store, "stage", counted)
    ((areas, tracks),) = sea(300, 1)
    left, units, foretold = {}, {}, {}
    with conflictdb.connect(dsn) as db:
        store.replace_scene(db.connection, Scene("sea"), areas, tracks, merge=False)
        advice = db.scene("sea").advise(sample=10_000)
        widest = Scene("sea", tolerance_m=max(TOLERANCES_M))
        pieces = len(pieces_of(Setup.of(widest), AreaBatch.of(areas), TrackBatch.of(tracks)))
        assert advice.sampled_pairs == advice.pairs
        for method in (Method.SCREEN, Method.EXACT):
            without.clear()
            done = db.scene("sea").detect(method=method, full=True)
            left[method] = sum(without) / done.conflicts
            units[method] = (
                WRITE_PER_CONFLICT * done.conflicts
                + TEST_PER_CANDIDATE * done.candidate_pairs
                + DATABASE_PER_PIECE * pieces
            )
            foretold[method] = of(advice, method, 1.0).database_s - FIXED_S
    assert left[Method.SCREEN] == 1.0
    assert left[Method.EXACT] == 0.0
    # The time to make a piece, by the clock, cancels out.
    ratio = foretold[Method.SCREEN] / foretold[Method.EXACT]
    assert ratio == pytest.approx(units[Method.SCREEN] / units[Method.EXACT], rel=1e-6)


@pytest.mark.parametrize("earth", list(EarthModel))
def test_screen_and_exact_are_compared_at_each_tolerance(earth: EarthModel) -> None:
    scene, areas, tracks = plain_scene(LONG_LEGS, 2, 14, 14, earth, tolerance_m=50.0)
    advice = advise(scene, areas, tracks, sample=80)
    tolerances = {50.0, *TOLERANCES_M}
    assert {one.setting for one in advice.estimates} == {Trial(method, m) for method in TRIED for m in tolerances}
    truth = of(advice, Method.EXACT, 0.0)
    assert (str(truth.false_share), truth.too_long_worst_s) in (("none", 0.0), ("-", 0.0))
    screen = of(advice, Method.SCREEN, 50.0)
    assert screen.false_share.count > 0
    assert screen.unresolved_share.count > 0
    assert screen.too_long_worst_s > 0.0
    assert of(advice, Method.EXACT, 50.0).too_long_worst_s < screen.too_long_worst_s


def test_the_same_seed_draws_the_same_sample_whatever_the_order_of_objects() -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 3, 10, 10)
    first = advise(scene, areas, tracks, sample=12, seed=7)
    assert first.sampled_pairs == 12
    assert counts(advise(scene, areas[::-1], tracks[::-1], sample=12, seed=7)) == counts(first)
    assert counts(advise(scene, areas, tracks, sample=12, seed=8)) != counts(first)


def test_areas_for_ever_have_no_slack() -> None:
    areas = [
        Area(key, shapely.MultiPolygon([shapely.box(x, 50.0, x + 1.0, 51.0)])) for x, key in ((4.0, "a"), (4.5, "b"))
    ]
    advice = advise(Scene("areas"), areas, [])
    for one in advice.estimates:
        assert (one.conflicts.value, one.false_share.count, one.too_long_worst_s) == (1.0, 0, 0.0)


def test_boxes_that_meet_without_their_hulls_are_told_apart_by_stage_2() -> None:
    """Two triangles in opposite corners of nearly the same box, and a track along the gap between them."""
    areas = [
        Area(key, shapely.MultiPolygon([shapely.Polygon(ring)]))
        for key, ring in (("a", [(4, 50), (5, 50), (4, 51)]), ("b", [(5, 51), (5, 50.1), (4.1, 51)]))
    ]
    track = Track("t", np.array([[4.05, 51.0], [5.0, 50.05]]), np.array([0, HOUR_US]), np.array([[0.0, 0.0]]))
    for tracks in ([], [track]):
        advice = advise(Scene("gap"), areas, tracks)
        for one in advice.estimates:
            assert one.candidate_pairs > 0
            assert (one.intersecting_pairs, one.conflicts.value, one.false_share.of) == (0, 0, 0)
            assert one.seconds > 0.0


def test_pairs_that_only_come_near_are_no_conflicts() -> None:
    """`nearest_m` adds pairs without conflict to a detection's results: they are neither reported nor wrong."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 3, 8, 8)
    plain = advise(scene, areas, tracks)
    near = advise(replace(scene, nearest_m=50_000.0), areas, tracks)
    # Also where the scene's own method does not look for them.
    by_screen = advise(replace(scene, nearest_m=50_000.0, method=Method.SCREEN), areas, tracks)
    assert of(by_screen, Method.EXACT, 1.0).candidate_pairs == of(near, Method.EXACT, 1.0).candidate_pairs
    for tolerance_m in (0.0, 1.0):
        one, other = (of(advice, Method.EXACT, tolerance_m) for advice in (plain, near))
        assert one.conflicts == other.conflicts
        assert other.false_share.count == 0
        assert other.candidate_pairs > 2.0 * one.candidate_pairs
        # Methods without closest approaches do not look further for one.
        assert of(near, Method.SCREEN, tolerance_m).candidate_pairs == pytest.approx(one.candidate_pairs)


def test_many_pieces_make_a_smaller_sample() -> None:
    """Two areas with coasts may be thousands of pairs of pieces: then fewer pairs of objects are tried."""
    combs = []
    for k in range(12):
        teeth = [
            corner
            for i in range(40)
            for corner in ((4.0 + i * 0.02, 50.0 + 0.01 * k), (4.01 + i * 0.02, 50.5 + 0.01 * k))
        ]
        ring = [*teeth, (4.8, 49.9 + 0.01 * k), (4.0, 49.9 + 0.01 * k)]
        combs.append(Area(f"A{k}", shapely.MultiPolygon([shapely.Polygon(ring)])))
    advice = advise(Scene("combs"), combs, [])
    assert advice.pairs == 66
    assert 1 <= advice.sampled_pairs < 66


def test_an_empty_scene_and_strangers_need_no_advice(dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        store.replace_scene(db.connection, Scene("empty"), [], [], merge=False)
        store.replace_scene(db.connection, Scene("apart"), [], strangers(3), merge=False)
        store.replace_scene(db.connection, Scene("one"), [], strangers(1), merge=False)
        assert db.scene("empty").advise().estimates == ()
        assert "holds no objects" in db.scene("empty").advise().recommendation
        for name in ("apart", "one"):
            advice = db.scene(name).advise()
            assert (advice.estimates, advice.pairs) == ((), 0)
            assert "come near each other" in advice.recommendation


def test_wrong_arguments_and_unknown_scenes_are_refused(dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        with pytest.raises(InvalidInput, match="not in this database"):
            db.scene("nowhere").advise()
        db.load(STRAIT)
        for wrong in ({"sample": 0}, {"sample": -3}, {"sample": 1.5}, {"seed": -1}, {"sample": True}):
            with pytest.raises(InvalidInput, match="must be a whole number"):
                db.scene("strait").advise(**wrong)  # type: ignore[arg-type]


def test_the_command_prints_tables(run: Run) -> None:
    run("load", STRAIT)
    done = run("advise", "--scene", "strait")
    assert (done.code, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0] == "strait: exact on wgs84 at 1 m"
    assert lines[1] == "sample: 8 of 8 pairs of objects that come near each other; seed 0"
    assert sum(line.startswith("exact *        1 m") for line in lines) == 1
    assert lines[-1].startswith("exact costs ")


def test_the_command_prints_json(run: Run) -> None:
    run("load", STRAIT)
    done = run("advise", "--scene", "strait", "--format", "json", "--sample", "4")
    advice = json.loads(done.out)
    assert (done.code, advice["scene"]["name"], advice["sampled_pairs"]) == (0, "strait", 4)
    for one in advice["estimates"]:
        assert one["seconds"] > one["database_s"] > 0.0
        for name in ("false_share", "unresolved_share"):
            share = one[name]
            assert set(share) == {"count", "of", "low", "high"}
            assert 0.0 <= share["low"] <= share["high"] <= 1.0
            assert share["low"] * share["of"] <= share["count"] <= share["high"] * share["of"]
        exact_is_truth = one["setting"] == {"method": "exact", "tolerance_m": 0.0}
        # Four of eight pairs are sampled: others may be false or unresolved, although none of these is.
        assert exact_is_truth or one["false_share"]["high"] > 0.0
        assert set(one["setting"]) == {"method", "tolerance_m"}


def test_the_command_answers_where_there_is_nothing(run: Run, dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        store.replace_scene(db.connection, Scene("empty"), [], [], merge=False)
    done = run("advise", "--scene", "empty")
    assert (done.code, done.out) == (0, "empty: the scene holds no objects: there is nothing to detect.\n")
    assert json.loads(run("advise", "--scene", "empty", "--format", "json").out)["estimates"] == []
    assert run("advise", "--scene", "nowhere").code == 4
    assert run("advise", "--scene", "s", "--sample", "0").code == 2
