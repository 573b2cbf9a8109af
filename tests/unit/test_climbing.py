"""Heights that change along legs: conflicts last while both the places and the heights of two objects overlap."""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import climbs
import numpy as np
import pytest
import shapely
import shifting
from layouts import HARBOUR, LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene
from verdicts import ROUNDING_S, periods_us

from conflictdb import delays, solve
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.packed import packed, unpacked
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.formats.scene_file import read_scene, scene_text
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Intervals, Scene, Track, rectangle_outline_m
from conflictdb.model.results import Conflict

T0_US = 1_772_323_200_000_000
HOUR_US = 3_600_000_000

TIMES_US = np.array([T0_US, T0_US + HOUR_US, T0_US + 2 * HOUR_US])
WAY = np.array([[4.0, 57.0], [4.5, 57.1], [5.0, 57.0]])
OUTLINE = rectangle_outline_m(50.0, 50.0, 20.0, 20.0)
WHOLE = shapely.MultiPolygon([shapely.box(3.0, 56.0, 6.0, 58.0)])


def climbing(key: str = "T", **changes: Any) -> Track:
    """A track that climbs from the ground to 1,000 m on its first leg, and descends to 400 m on its second."""
    members = {"floors_m": [0.0, 1000.0, 400.0], "ceilings_m": [100.0, 1100.0, 500.0], **changes}
    return Track(key, WAY, TIMES_US, OUTLINE, **members)


@pytest.mark.parametrize("method", [Method.EXACT, Method.NLP, Method.SCREEN])
def test_the_period_is_the_time_at_the_height_of_an_area(method: Method) -> None:
    found = solve([climbing()], [Area("A", WHOLE, floor_m=300.0, ceiling_m=500.0)], Scene("s", method=method))
    # Its ceiling is above 300 m from a fifth of an hour on, its floor below 500 m until half an hour, and again from
    # fifty minutes after the top.
    ((start, end), (again, last)) = periods_us(found[0])
    expected = [T0_US + HOUR_US // 5, T0_US + HOUR_US // 2, T0_US + HOUR_US + HOUR_US * 5 // 6, T0_US + 2 * HOUR_US]
    assert np.abs(np.array([start, end, again, last]) - expected).max() <= 2
    assert method == Method.SCREEN or found[0].time_error_s < 1e-5


def test_bands_that_touch_on_the_way_do_not_overlap() -> None:
    below = climbing("below", ceilings_m=[50.0, 1050.0, 450.0])
    above = climbing("above", floors_m=[50.0, 1050.0, 450.0], ceilings_m=[60.0, 1060.0, 460.0])
    assert solve([below, above], [], Scene("s")) == []
    assert len(solve([below, above], [], Scene("s", vertical_separation_m=1.0))) == 1
    top = Area("top", WHOLE, floor_m=1100.0)
    assert solve([climbing()], [top], Scene("s")) == []
    (grazed,) = solve([climbing()], [replace(top, floor_m=1099.0)], Scene("s"))
    ((start, end),) = periods_us(grazed)
    assert np.abs(np.array([start, end]) - T0_US - HOUR_US - np.array([-0.001, 1 / 600]) * HOUR_US).max() <= 2


def test_an_unbounded_height_at_a_waypoint_is_on_both_legs() -> None:
    track = climbing(ceilings_m=None, floors_m=[-np.inf, 300.0, 900.0])
    assert track.floor_m is None
    low = Area("A", WHOLE, ceiling_m=200.0)
    ((_, end),) = periods_us(solve([track], [low], Scene("s"))[0])
    assert end == T0_US + HOUR_US


@pytest.mark.parametrize(
    ("workload", "seeds", "objects"),
    [
        (LOW_LATITUDE, (3,), (3, 4)),
        (SEAM, (33,), (3, 4)),
        (HARBOUR, (25,), (2, 2)),
        (OCEAN, (33,), (3, 4)),
        *(pytest.param(one, range(8), (4, 5), marks=pytest.mark.slow) for one in (LOW_LATITUDE, SEAM, HARBOUR, OCEAN)),
    ],
    ids=lambda one: getattr(one, "name", None),
)
def test_random_climbs_meet_when_brute_force_says(
    workload: Workload, seeds: Sequence[int], objects: tuple[int, int]
) -> None:
    contacts = 0
    for seed in seeds:
        scene, areas, tracks = _random_scene(workload, seed, objects)
        found = {(c.a_key, c.b_key): c for c in solve(tracks, areas, scene) if c.verdict in ("conflict", "grazing")}
        objs = [*areas, *tracks]
        for i, one in enumerate(objs):
            for other in objs[max(i + 1, len(areas)) :]:
                first, second = sorted((one, other), key=lambda thing: (isinstance(thing, Track), thing.key.encode()))
                expected = climbs.meeting_us(scene, first, second)
                contacts += _agrees(expected, found.get((first.key, second.key)), 0.0)
    assert contacts >= 1


@pytest.mark.parametrize(
    ("workload", "seeds"),
    [
        (HARBOUR, (21, 56)),
        (LOW_LATITUDE, (4, 17, 37, 53, 56)),
        (OCEAN, (0, 1, 2)),
        *(pytest.param(one, range(200), marks=pytest.mark.slow) for one in (HARBOUR, LOW_LATITUDE, SEAM, OCEAN)),
    ],
    ids=lambda one: getattr(one, "name", None),
)
def test_periods_are_those_without_heights_while_heights_overlap(workload: Workload, seeds: Sequence[int]) -> None:
    contacts = 0
    for seed in seeds:
        scene, areas, tracks = _random_scene(workload, seed, (6, 8))
        things = {thing.key: thing for thing in (*areas, *tracks)}
        flat = solve(
            list(map(climbs.without_heights, tracks)),
            list(map(climbs.without_heights, areas)),
            replace(scene, vertical_separation_m=0.0),
        )
        found = {(c.a_key, c.b_key): c for c in solve(tracks, areas, scene)}
        assert found.keys() <= {(c.a_key, c.b_key) for c in flat}
        for one in flat:
            key = (one.a_key, one.b_key)
            if one.b_kind == "track":
                expected = climbs.while_heights_overlap(scene, *map(things.__getitem__, key), periods_us(one))
                contacts += _agrees(expected, found.get(key), one.time_error_s)
    assert contacts >= 5


def _agrees(expected: list[tuple[float, float]], answer: Conflict | None, error_s: float) -> int:
    """Compare reported periods with expected ones, known within error_s; return how many of these are certain."""
    rounding = 1e6 * (ROUNDING_S + error_s)
    slack = rounding if answer is None else rounding + 1e6 * answer.time_error_s
    reported = [] if answer is None else periods_us(answer)
    # A contact shorter than the slack, or in rounding, may be either.
    certain = [period for period in expected if period[1] - period[0] > 2 * slack]
    for start, end in certain:
        assert any(a <= start + rounding and end - rounding <= b for a, b in reported), (answer, start, end)
    for start, end in reported:
        of = [p for p in expected if start - rounding <= p[0] and p[1] <= end + rounding]
        if end - start > 2 * slack:
            assert of, (answer, start, end)
            assert of[0][0] - start <= slack
            assert end - of[-1][1] <= slack
    return len(certain)


def _random_scene(workload: Workload, seed: int, objects: tuple[int, int]) -> tuple[Scene, list[Area], list[Track]]:
    rng = np.random.default_rng([5, seed])
    scene, areas, tracks = plain_scene(workload, seed, *objects)
    vertical_m, intervals = float(rng.choice([0.0, 30.0])), str(rng.choice(["half_open", "closed"]))
    scene = replace(scene, vertical_separation_m=vertical_m, intervals=Intervals(intervals))
    areas = [replace(area, floor_m=low, ceiling_m=low + 300.0) for area in areas if (low := rng.uniform(0, 900))]
    return scene, areas, [_random_heights(rng, track) for track in tracks]


@pytest.mark.parametrize("intervals", list(Intervals))
@pytest.mark.parametrize("separation_m", [0.0, 30.0, 0.3])
@pytest.mark.parametrize("more_m", [-4.4e-7, 1e-8, 4.4e-7])
def test_the_time_of_a_slow_climb_is_within_its_bound(intervals: Intervals, separation_m: float, more_m: float) -> None:
    """At a millimetre a second the tenth part of a micrometre takes a hundred microseconds."""
    track = Track("T", WAY[:2], TIMES_US[:2], OUTLINE, floors_m=[0.0, 3.6], ceilings_m=[1.0, 4.6])
    area = Area("A", WHOLE, floor_m=2.6 + separation_m + more_m, ceiling_m=2000.0)
    scene = Scene("s", vertical_separation_m=separation_m, intervals=intervals)
    (found,) = solve([track], [area], scene)
    ((start, end),) = periods_us(found)
    ((low, high),) = climbs.overlaps_us(scene, area, track)
    assert 0 <= low - start <= 1e6 * found.time_error_s + 1
    assert end == high == TIMES_US[1]
    assert found.time_error_s < 1e-5


def _random_heights(rng: np.random.Generator, track: Track) -> Track:
    n = len(track.times_us)
    floors = np.round(rng.uniform(0.0, 900.0, n), 1)
    floors[rng.random(n) < 0.1] = -np.inf
    if rng.random() < 0.3:
        floors = floors[:-1]
    ceilings = np.where(np.isfinite(floors), floors, 900.0) + np.round(rng.uniform(20.0, 200.0, len(floors)), 1)
    if len(floors) < n and rng.random() < 0.5:
        ceilings = np.append(ceilings, 900.0) + 1000.0
    return replace(track, floors_m=floors, ceilings_m=ceilings, max_speed_kn=np.inf)


def test_delays_are_those_of_shifted_copies() -> None:
    """Beside level objects delays are exact; two that climb may only be forbidden more, and not proven."""
    rng = np.random.default_rng(2026)
    horizon_us, proven = 2 * HOUR_US, 0
    for n in range(8):
        box = shapely.box(4.1 + 0.05 * n, 56.9, 4.4 + 0.05 * n, 57.2)
        area = Area("A", shapely.MultiPolygon([box]), None, T0_US, T0_US + HOUR_US, floor_m=300.0, ceiling_m=500.0)
        other = Track("B", WAY[::-1] + np.array([0, 0.01]), TIMES_US, 40 * OUTLINE, floor_m=200.0, ceiling_m=210.0)
        if n % 2:
            other = replace(
                other, floor_m=None, ceiling_m=None, floors_m=[900.0, 200.0, 0.0], ceilings_m=[950, 250, 50]
            )
        tracks = [replace(climbing(), outline_m=40 * OUTLINE), other]
        (found,) = delays(tracks, [area], Scene("s"), key="T", within_s=2 * HOUR_US / 1e6)
        shifts = shifting.shifts_of(found, horizon_us, rng, 30)
        met = shifting.meets_when_shifted(Scene("s"), [area], tracks, "T", shifts)
        is_forbidden, is_proven = shifting.is_forbidden(found, shifts)
        for shift, keys, forbidden, certain in zip(shifts.tolist(), met, is_forbidden, is_proven, strict=True):
            assert forbidden or not keys, shift
            assert not certain or keys, shift
            proven += bool(certain)
    assert proven > 50


def test_time_separation_with_climbs_misses_nothing_and_proves_nothing() -> None:
    other = Track("B", WAY[::-1], TIMES_US, OUTLINE, floors_m=[900.0, 200.0, 0.0], ceilings_m=[950.0, 250.0, 50.0])
    scene = Scene("s", time_separation_s=1800.0)
    (found,) = solve([climbing(), other], [], scene)
    assert found.verdict == "unresolved"
    high = replace(other, floors_m=None, ceilings_m=None, floor_m=1200.0, ceiling_m=None)
    assert solve([climbing(), high], [], scene) == []


def test_near_pairs_are_near_while_their_heights_overlap() -> None:
    level = Track("B", WAY + np.array([0, 0.05]), TIMES_US, OUTLINE, floor_m=0.0, ceiling_m=50.0)
    (near,) = solve([climbing(), level], [], Scene("s", nearest_m=20_000.0))
    assert near.verdict == "near"
    assert near.closest_at is not None
    assert (near.closest_at.timestamp() - T0_US / 1e6) <= 180.001  # until 50 m


def test_packed_pieces_keep_their_climb() -> None:
    scene = Scene("s")
    pieces = pieces_of(Setup.of(scene), AreaBatch.of([]), TrackBatch.of([climbing()]))
    words, offset = packed(pieces)
    assert np.array_equal(unpacked(words, offset[:-1]).climb_m, pieces.climb_m)
    assert pieces.climbs().all()


def test_a_file_gives_heights_per_waypoint_and_gets_them_back() -> None:
    track = climbing(floors_m=[0.0, 1000.0, -np.inf], ceilings_m=[1100.0, np.inf])
    text = "".join(scene_text(Scene("s"), [], [track]))
    (back,) = read_scene(text, "s").tracks
    assert np.array_equal(back.floors_m, track.floors_m)
    assert np.array_equal(back.ceilings_m, track.ceilings_m)


@pytest.mark.parametrize(
    ("heights", "field", "rule"),
    [
        ({"floors_m": [0.0, 5.0, 0.0], "ceilings_m": [5.0, 5.0, 5.0]}, "ceiling_m[1]", "above the floor of leg 0 (5)"),
        ({"floors_m": [0.0, 5.0, 9.0], "ceilings_m": [6.0, 9.0]}, "ceiling_m[1]", "above the floor of leg 1 (9)"),
        ({"floors_m": [0.0, 5.0, 9.0, 8.0], "ceilings_m": None}, "floor_m", "one per waypoint (3); got 4"),
        ({"floors_m": [0.0, np.nan, 9.0], "ceilings_m": None}, "floor_m[1]", "finite"),
    ],
)
def test_wrong_heights_of_waypoints_are_refused(heights: dict[str, Any], field: str, rule: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        climbing(**heights)
    assert caught.value.field == field
    assert rule in caught.value.rule


def test_closed_bands_that_touch_on_the_way_overlap() -> None:
    below = climbing("below", ceilings_m=[50.0, 1050.0, 450.0])
    above = climbing("above", floors_m=[50.0, 1050.0, 450.0], ceilings_m=[60.0, 1060.0, 460.0])
    top = Area("top", WHOLE, floor_m=1100.0)
    assert len(solve([below, above], [], Scene("s", intervals="closed"))) == 1
    assert len(solve([climbing()], [top], Scene("s", intervals="closed"))) == 1


def test_heights_of_another_datum_are_refused() -> None:
    text = "".join(scene_text(Scene("s"), [Area("A", WHOLE, floor_m=0.0)], [climbing()]))
    for datum in ("WGS84", "flight level", 5):
        for place in (text.index('"kind": "area"'), text.index('"kind": "track"')):
            other = text[:place] + f'"vertical_datum":{json.dumps(datum)},' + text[place:]
            with pytest.raises(InvalidInput, match="vertical_datum: must be 'msl', the scene's"):
                read_scene(other, "s")
    same = text.replace('"kind":', '"vertical_datum": "MSL", "kind":')
    (area,) = read_scene(same, "s").areas
    assert area.properties == {"vertical_datum": "MSL"}
    unbounded = "".join(scene_text(Scene("s"), [Area("A", WHOLE, properties={"vertical_datum": "WGS84"})], []))
    assert len(read_scene(unbounded, "s").areas) == 1
