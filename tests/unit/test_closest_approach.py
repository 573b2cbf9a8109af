"""The kernel's closest approach: bounds, golden answers, an independent look at random pairs, and its border."""

import csv
import ctypes
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import oracle_distance
import pytest
import scenes
import shapely
from draws import draws
from kernel_internals import internals
from layouts import (
    GROWING,
    GROWING_CIRCLES,
    HARBOUR,
    HIGH_LATITUDE,
    LONG_LEGS,
    LOW_LATITUDE,
    OCEAN,
    SEAM,
    WORKLOADS,
    Workload,
)
from mixed_scenes import plain_scene
from oracle_motion import Globe
from pyproj import Geod
from sampling import placed
from scenes import FLATTENING, RADIUS_M
from staged import Staged

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows
from conflictdb.core.object_pairs import object_keys
from conflictdb.core.stage4.closest_approach import approaches
from conflictdb.kernel.approach import Closest, closest
from conflictdb.kernel.kernel_scene import HeldPairs
from conflictdb.kernel.meeting import distances
from conflictdb.model.plans import EarthModel, Motion, Scene

SUPPORT = Path(__file__).parents[1] / "support"
SAMPLES = 33


class Given:
    """Pairs of pieces of a random scene that share a time: pairs with a track, or only standing pieces."""

    def __init__(self, scene: Scene, areas: list[Any], tracks: list[Any], near: bool = False) -> None:
        staged = Staged.of(scene, areas, tracks)
        self.scene, self.plane, self.pieces, self.held = scene, staged.setup.plane, staged.pieces, staged.prepared
        if near:
            a, b = staged.pairs.a, staged.pairs.b
        else:
            every = np.arange(len(self.pieces))
            a, b = (PieceRows(one.ravel()) for one in np.meshgrid(every, every))
            other = self.pieces.object_id[a] != self.pieces.object_id[b]
            other |= self.pieces.kind[a] != self.pieces.kind[b]
            a, b = PieceRows(a[(a < b) & other]), PieceRows(b[(a < b) & other])
        start, end = self.pieces.shared_span(a, b)
        moving = np.flatnonzero((start < end) & (self.pieces.kind[b] == 1))
        self.a, self.b, self.start_us = a[moving], b[moving], start[moving]
        self.span_s = (end - start)[moving] / 1e6

    @classmethod
    def of(cls, workload: Workload, seed: int, count: int, earth: EarthModel, nearest_m: float = 0.0) -> "Given":
        scene, areas, tracks = plain_scene(workload, seed, count, count, earth)
        return cls(replace(scene, nearest_m=nearest_m, tolerance_m=0.0), areas, tracks, near=nearest_m > 0.0)

    def some(self, most: int, seed: int = 0) -> "Given":
        """Some of the pairs, at random."""
        rows = np.sort(np.random.default_rng(seed).permutation(len(self.a))[:most])
        self.a, self.b, self.start_us, self.span_s = (x[rows] for x in (self.a, self.b, self.start_us, self.span_s))
        return self

    def closest(self, offset: Any = None, wanted_m: float = np.inf, threads: int = 1, aim_m: float = 0.0) -> Closest:
        """The closest approach of each pair by itself, or of groups."""
        offset = np.arange(len(self.a) + 1) if offset is None else np.asarray(offset)
        columns = self.a, self.b, self.start_us, np.zeros(len(self.a)), self.span_s
        wanted, aim = np.full(len(offset) - 1, wanted_m), np.full(len(offset) - 1, aim_m)
        self.work = kernel.Work()
        return closest(self.held, *columns, offset, wanted, aim, self.work, threads)

    def distances(self, at_s: Floats) -> Floats:
        """Distances (n, k) at instants (n, k)."""
        n, k = at_s.shape
        columns = (np.repeat(column, k) for column in (self.a, self.b, self.start_us))
        return np.maximum(distances(self.held, *columns, at_s.ravel()), 0.0).reshape(n, k)


@cache
def _floors() -> Any:
    function = internals().floors
    function.argtypes = [ctypes.c_void_p] * 5
    return function


def floors(given: Given, low_s: Floats, high_s: Floats) -> tuple[Floats, Floats, Floats]:
    """Distances in the middle of times, and their two lower bounds."""
    found = [np.empty(len(low_s)) for _ in range(3)]
    columns = HeldPairs.arrays(given.a, given.b, given.start_us, low_s, high_s)
    held = HeldPairs.of(columns, slice(0, len(low_s)))
    status = _floors()(given.held.handle, ctypes.byref(held), *(column.ctypes.data for column in found))
    assert status == 0
    return found[0], found[1], found[2]


def stays_near(given: Given, separation_m: float) -> list[bool]:
    """Return for which pairs it is proven that they stay nearer than a distance."""
    function, found = internals().stays_near, np.empty(len(given.a), np.uint8)
    function.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
    columns = HeldPairs.arrays(given.a, given.b, given.start_us, np.zeros(len(given.a)), given.span_s)
    held = HeldPairs.of(columns, slice(0, len(given.a)))
    assert function(given.held.handle, ctypes.byref(held), separation_m, found.ctypes.data) == 0
    return [bool(one) for one in found]


def test_no_groups_are_no_error() -> None:
    """Nothing is asked, and nothing returned."""
    given = Given.of(WORKLOADS[0], 3, 4, EarthModel.SPHERE)
    nothing, whole = np.empty(0), np.empty(0, np.int64)
    found = closest(given.held, *[whole] * 3, nothing, nothing, np.zeros(1, np.int64), nothing, nothing, kernel.Work())
    assert len(found.at_s) == 0


def test_nearness_is_proven_up_to_half_a_radius() -> None:
    """The comparison with a sphere that the proof uses is sound for distances of less than half of the radius."""
    ships = [
        scenes.track(key, [(lon, 10.0)] * 2, [0, 3600], 10.0, 10.0, 5.0, 5.0) for key, lon in (("a", 0.0), ("b", 2.0))
    ]
    given = Given(Scene("s", earth=EarthModel.SPHERE), [], ships)
    radius_m = scenes.parallel_m(EarthModel.SPHERE, 0.0) * 180.0 / np.pi
    assert stays_near(given, 0.499 * radius_m) == [True]
    assert stays_near(given, 0.5 * radius_m) == [False]
    assert stays_near(given, 2e5) == [False]  # they are 219 km apart


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda w: w.name)
@draws("pairs", 200, 1500)
def test_nothing_is_nearer_than_the_bounds_of_its_time(workload: Workload, earth: EarthModel, pairs: int) -> None:
    """For long times and for short ones; and the bounds of short times are close."""
    if workload.motion is Motion.GREAT_CIRCLE and earth is EarthModel.WGS84:
        pytest.skip("great circles are on the sphere")
    given = Given.of(workload, 3, 8, earth).some(pairs)
    rng, n = np.random.default_rng(0), len(given.a)
    for parts in (1, 16, 256, 4096):
        low = given.span_s * rng.integers(parts, size=n) / parts
        high = low + given.span_s / parts
        seen = given.distances(np.linspace(low, high, SAMPLES, axis=1))
        middle, bound, box = floors(given, low, high)
        np.testing.assert_allclose(middle, seen[:, SAMPLES // 2], atol=1e-8, rtol=1e-14)
        # Distances may be understated, bounds are on those that are true.
        least = seen.min(axis=1)
        least = least + given.plane.distance_error_m(least)
        assert (bound <= least).all()
        assert (box <= least).all()
        assert (bound > 0.0).mean() > 0.5
    assert np.quantile((least - bound) / (1.0 + least), 0.9) < 1e-3


def test_bounds_allow_for_rounding() -> None:
    """Ships abreast on the equator of the sphere, where plane, proofs and distances are the same to the last digit."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    behind = 2010.0 / scenes.parallel_m(EarthModel.SPHERE, 0.0)
    starts = (("a", 0.0), ("b", behind))
    size = (1000.0, 1000.0, 1.0, 1.0)
    tracks = [scenes.track(key, [(lon, 0.0), (lon + 1.0, 0.0)], [0, 3600], *size) for key, lon in starts]
    given = Given(scene, [], tracks)
    for part in (1.0, 1e-3):
        low, high = np.zeros(len(given.a)), part * given.span_s
        least = given.distances(np.linspace(low, high, SAMPLES, axis=1)).min(axis=1)
        _, bound, _ = floors(given, low, high)
        assert (least - 1e-6 < bound).all()
        assert (bound < least - 1e-8).all()


def test_a_way_that_bulges_is_nearer_in_the_middle_than_at_its_ends() -> None:
    """A haven far to starboard of the equator goes along a parallel, which bends towards an area in the plane."""
    scene = Scene("s", Motion.GREAT_CIRCLE, centre=(0.0, 0.0))
    haven = np.array([(1.0e6, -5e3), (1.01e6, -5e3), (1.01e6, 5e3), (1.0e6, 5e3)])
    track = replace(scenes.track("T", [(-2.0, 0.0), (2.0, 0.0)], [0, 3600], 1.0, 1.0, 1.0, 1.0), outline_m=haven)
    area = scenes.area("A", shapely.box(-4.0, -8.9, 4.0, -8.0))
    given = Given(scene, [area], [track])
    low, high = np.zeros(len(given.a)), given.span_s
    seen = given.distances(np.linspace(low, high, SAMPLES, axis=1))
    _, bound, box = floors(given, low, high)
    assert (seen.min(axis=1) < np.minimum(seen[:, 0], seen[:, -1]) - 0.1).any()
    assert (np.maximum(bound, box) <= seen.min(axis=1) + 1e-6).all()


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_way_along_a_parallel_bends_from_what_lies_towards_the_equator(side: float) -> None:
    """1,000 km off, at 82 degrees, the bend adds as much to how fast the distance curves as the way across it does."""
    here = scenes.track("P", [(0.0, side * 73.0)] * 2, [0, 3600], 0.0, 0.0, 0.0, 0.0)
    ship = scenes.track("S", [(-6.0, side * 82.0), (6.0, side * 82.0)], [0, 3600], 0.0, 0.0, 0.0, 0.0)
    given = Given(Scene("s", earth=EarthModel.SPHERE), [], [here, ship])
    for parts in (1, 4):
        low = given.span_s * (np.arange(len(given.a)) % parts) / parts
        high = low + given.span_s / parts
        seen = given.distances(np.linspace(low, high, SAMPLES, axis=1)).min(axis=1)
        _, bound, _ = floors(given, low, high)
        assert (bound <= seen + 1e-5).all()
        assert (bound >= seen - 10.0).any()


def test_what_is_near_across_the_seam_is_not_said_to_be_far() -> None:
    """Points 2 degrees apart, whose coordinates are 358 degrees apart."""
    tracks = [
        scenes.track(k, [(lon, 10.0)] * 2, [0, 3600], 0.0, 0.0, 0.0, 0.0) for k, lon in (("W", -179.0), ("E", 179.0))
    ]
    given = Given(Scene("s", earth=EarthModel.SPHERE), [], tracks)
    low, high = np.zeros(len(given.a)), given.span_s
    seen = given.distances(np.stack([low, high], axis=1)).min(axis=1)
    assert seen.max() < 3e5
    _, bound, box = floors(given, low, high)
    assert (np.maximum(bound, box) <= seen + given.plane.distance_error_m(seen)).all()
    assert (bound > 0.99 * seen).all()


def golden() -> dict[tuple[str, ...], list[dict[str, str]]]:
    found: dict[tuple[str, ...], list[dict[str, str]]] = {}
    with (SUPPORT / "closest_approaches.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            found.setdefault(
                tuple(row[name] for name in ("workload", "earth", "nearest_m", "areas", "tracks")), []
            ).append(row)
    return found


@pytest.mark.parametrize("case", golden(), ids=lambda case: f"{case[0]} {case[1]}")
def test_answers_of_the_search_in_numpy(case: tuple[str, ...]) -> None:
    """Distances and places as another program found them; bounds as they were, or below half a millimetre."""
    name, earth, nearest_m, areas, tracks = case
    (workload,) = (one for one in WORKLOADS if one.name == name)
    scene, standing, moving = plain_scene(workload, 5, int(areas), int(tracks), EarthModel(earth))
    scene = replace(scene, nearest_m=float(nearest_m), tolerance_m=0.0)
    staged = Staged.of(scene, standing, moving)
    pairs = staged.pairs
    objects, group = np.unique(object_keys(staged.pieces, pairs.a, pairs.b), axis=1, return_inverse=True)
    always = np.zeros(len(group)), np.full(len(group), np.inf)
    wanted, aim = np.full(objects.shape[1], scene.nearest_m), np.zeros(objects.shape[1])
    found = approaches(staged.prepared, pairs.a, pairs.b, *always, group, wanted, aim, kernel.Work())
    number = {tuple(column): k for k, column in enumerate(objects.T.tolist())}
    for row in golden()[case]:
        k = number[tuple(int(row[key]) for key in ("a_kind", "a_id", "b_kind", "b_id"))]
        assert found.distance_m[k] == pytest.approx(float(row["closest_m"]), abs=1e-7, rel=1e-12)
        assert found.error_m[k] <= max(1.01 * float(row["error_m"]) + 1e-7, 5e-4)
        if found.distance_m[k] > 0.0:
            places = [float(row[key]) for key in ("a_lon", "a_lat", "b_lon", "b_lat")]
            np.testing.assert_allclose([*found.a_deg[k], *found.b_deg[k]], places, atol=3e-6)


def hulls(given: Given, row: int, at_s: float) -> list[Any]:
    pieces = (int(given.a[row]), int(given.b[row]))
    vertices = [placed(given.scene, given.pieces, piece, int(given.start_us[row]), at_s) for piece in pieces]
    return [shapely.MultiPoint(xy).convex_hull for xy in vertices]


def on_rhumb_lines(given: Given, pairs: list[list[Any]]) -> Floats:
    globe = Globe.of(given.scene.earth)
    one, two = (oracle_distance.edges_of_hulls(np.array([pair[k] for pair in pairs])) for k in (0, 1))
    return oracle_distance.least_m(globe, one, two)


def on_great_circles(given: Given, pairs: list[list[Any]]) -> Floats:
    """Between places along the edges: never less than the least."""
    found = []
    for pair in pairs:
        space = []
        for hull in pair:
            ring = shapely.get_coordinates(shapely.segmentize(hull, max(hull.length / 200.0, 1e-3)))
            lon, lat = np.radians(given.plane.from_plane(*ring.T))
            space.append(np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1))
        chord = np.sqrt(((space[0][:, None] - space[1][None]) ** 2).sum(axis=2)).min()
        found.append(2.0 * RADIUS_M[EarthModel.SPHERE] * np.arcsin(0.5 * chord))
    return np.array(found)


QUICK = [
    (LOW_LATITUDE, "wgs84"),
    (HIGH_LATITUDE, "sphere"),
    (GROWING, "wgs84"),
    (OCEAN, "sphere"),
    (GROWING_CIRCLES, "sphere"),
]
MANY = [(w, e) for w in WORKLOADS for e in ("wgs84", "sphere") if e == "sphere" or w.motion is Motion.RHUMB]


@pytest.mark.parametrize(
    ("workload", "earth", "count"),
    [
        *(pytest.param(*one, 25, id=f"{one[0].name} {one[1]}") for one in QUICK),
        *(pytest.param(*one, 400, id=f"{one[0].name} {one[1]}, many", marks=pytest.mark.slow) for one in MANY),
    ],
)
def test_an_independent_look_finds_the_distance_and_nothing_nearer(workload: Workload, earth: str, count: int) -> None:
    """Motion and distances by formulas independent of the kernel, before, at and after the reported instant.

    The distance is that of the reported points. These lie on the polygons at that instant, and at no sampled instant
    are polygons nearer than the bound allows.
    """
    given = Given.of(workload, 7, 12, EarthModel(earth), nearest_m=1e3 if workload is HARBOUR else 1e5).some(count)
    found = given.closest()
    geod = Geod(a=RADIUS_M[EarthModel(earth)], f=FLATTENING[EarthModel(earth)])
    look: Callable[[Given, list[list[Any]]], Floats] = (
        on_great_circles if workload.motion is Motion.GREAT_CIRCLE else on_rhumb_lines
    )
    assert (found.distance_m > 0.0).any()
    between = geod.inv(*found.a_deg.T, *found.b_deg.T)[2]
    np.testing.assert_array_less(np.abs(between - found.distance_m), found.error_m + 1e-4 + 1e-9 * found.distance_m)
    for row in np.flatnonzero(found.distance_m > 0.0).tolist():
        span, at = float(given.span_s[row]), float(found.at_s[row])
        steps = np.geomspace(1e-3, span, 6)
        instants = [at, *np.clip([*(at - steps), *(at + steps)], 0.0, span), *np.linspace(0.0, span, 7)]
        pairs = [hulls(given, row, t) for t in instants]
        for place, hull in zip((found.a_deg[row], found.b_deg[row]), pairs[0], strict=True):
            x, y = given.plane.to_plane(*place)
            turns = [shapely.Point(x + turn * given.plane.turn_m, y) for turn in (-2, -1, 0, 1, 2)]
            assert min(hull.distance(point) for point in turns) < 1e-2
        apart = [k for k, (one, two) in enumerate(pairs) if not one.intersects(two)]
        seen = look(given, [pairs[k] for k in apart])
        assert seen.min() >= found.distance_m[row] - found.error_m[row] - 2e-4 - 1e-9 * found.distance_m[row]


@pytest.mark.parametrize("workload", [HIGH_LATITUDE, SEAM, OCEAN, GROWING_CIRCLES], ids=lambda w: w.name)
def test_any_number_of_threads_any_order_and_any_company_give_the_same_bits(workload: Workload) -> None:
    given = Given.of(workload, 3, 8, EarthModel.SPHERE, nearest_m=5e4)
    n = len(given.a)
    one, two = given.closest(), given.closest(threads=3)
    columns = ("pair", "at_s", "distance_m", "error_m", "a_deg", "b_deg")
    for name in columns:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    order = np.random.default_rng(0).permutation(n)
    given.a, given.b, given.start_us, given.span_s = (
        x[order] for x in (given.a, given.b, given.start_us, given.span_s)
    )
    mixed = given.closest(threads=2)
    for name in columns[1:]:
        np.testing.assert_array_equal(getattr(one, name)[order], getattr(mixed, name))
    assert one.distance_m.min() == 0.0


@pytest.mark.parametrize("workload", [LOW_LATITUDE, LONG_LEGS, GROWING_CIRCLES], ids=lambda w: w.name)
def test_a_group_is_as_close_as_its_closest_pair(workload: Workload) -> None:
    given = Given.of(workload, 4, 8, EarthModel.SPHERE, nearest_m=5e4)
    n = len(given.a)
    alone = given.closest()
    offset = np.array([0, 0, n // 3, n // 3 + 1, n])
    together = given.closest(offset)
    assert together.pair[0] == -1
    assert together.distance_m[0] == np.inf
    for k in range(1, 4):
        mine = slice(offset[k], offset[k + 1])
        least = alone.distance_m[mine].min()
        assert together.distance_m[k] == pytest.approx(least, abs=1e-3)
        assert together.distance_m[k] - together.error_m[k] <= least
        assert offset[k] <= together.pair[k] < offset[k + 1]
        at_us = given.start_us[mine] + 1e6 * alone.at_s[mine]
        if least == 0.0:  # the first of all touches
            first = at_us[alone.distance_m[mine] == 0.0].min()
            mine_us = given.start_us[together.pair[k]] + 1e6 * together.at_s[k]
            assert mine_us == pytest.approx(first, abs=1.0)


def test_nothing_is_told_of_what_is_further_than_wanted() -> None:
    given = Given.of(LOW_LATITUDE, 4, 8, EarthModel.WGS84).some(300)
    everything, some = given.closest(), given.closest(wanted_m=1e5)
    far = everything.distance_m > 1e5
    assert 20 < far.sum() < len(far) - 20
    np.testing.assert_array_equal(some.pair < 0, far)
    assert np.isinf(some.distance_m[far]).all()
    assert np.isnan(some.a_deg[far]).all()
    np.testing.assert_allclose(some.distance_m[~far], everything.distance_m[~far], atol=1e-3)


@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, GROWING_CIRCLES], ids=lambda w: w.name)
def test_a_distance_that_need_not_be_known_well_takes_less_work_and_is_not_far_off(workload: Workload) -> None:
    """It is the distance at the reported instant, to a hundredth of the aim, and nowhere less than the bound."""
    given = Given.of(workload, 7, 12, EarthModel.SPHERE, nearest_m=1e5).some(200)
    fine = given.closest()
    windows = given.work.windows
    for aim_m in (1.0, 1e2, 1e4):
        found = given.closest(aim_m=aim_m)
        assert given.work.windows < windows
        windows = given.work.windows
        then = given.distances(found.at_s[:, None])[:, 0]
        np.testing.assert_array_less(np.abs(then - found.distance_m), 1e-6 + 0.01 * aim_m)
        np.testing.assert_array_less(found.error_m, np.maximum(aim_m, 1.1 * fine.error_m) + 0.01)
        np.testing.assert_array_less(fine.distance_m - fine.error_m - 1e-6, found.distance_m)
        np.testing.assert_array_less(found.distance_m - found.error_m, fine.distance_m + 1e-6)
        assert (found.distance_m > fine.distance_m + 0.1 * aim_m).any()


def test_the_first_touch_is_found_though_a_later_one_is_seen_first() -> None:
    """A reef of a few metres on the way to a large one, passed in seconds of an hour."""
    degree = scenes.parallel_m(EarthModel.SPHERE, 0.0)
    reef, land = shapely.box(0.2, -1e-5, 0.20001, 1e-5), shapely.box(0.5, -0.1, 0.9, 0.1)
    areas = [scenes.area(key, shape) for key, shape in (("A", reef), ("B", land))]
    ship = scenes.track("T", [(0.0, 0.0), (1.0, 0.0)], [0, 3600], 5.0, 5.0, 5.0, 5.0)
    given = Given(Scene("s", earth=EarthModel.SPHERE), areas, [ship])
    found = given.closest([0, len(given.a)])
    assert found.distance_m[0] == 0.0
    first_us = scenes.T0_US + 1e6 * (0.2 - 5.0 / degree) * 3600.0
    assert given.start_us[found.pair[0]] + 1e6 * found.at_s[0] == pytest.approx(first_us, abs=20.0)
    np.testing.assert_allclose(found.a_deg, [(0.2, 0.0)], atol=1e-6)


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize(("lon", "lat"), [(0.0, 89.0), (179.9999, 0.0), (-60.0, -85.0), (90.0, 60.0)])
def test_what_stands_still_at_sea_is_as_far_as_it_is(earth: EarthModel, lon: float, lat: float) -> None:
    """Points that wait, metres to half the earth apart, also across the seam and over a pole."""
    geod = Geod(a=RADIUS_M[earth], f=FLATTENING[earth])
    tracks, expected = [], []
    for k, away_m in enumerate((1.0, 1e3, 1e5, 5e6, 1.2e7)):
        for bearing in (0.0, 80.0, 200.0):
            east, north, _ = geod.fwd(lon, lat, bearing, away_m)
            if abs(north) > 89.4:
                continue
            tracks.append(scenes.track(f"{k} {bearing}", [(east, north), (east, north)], [0, 3600], 0.0, 0.0, 0.0, 0.0))
            expected.append(away_m)
    here = scenes.track("here", [(lon, lat), (lon, lat)], [0, 3600], 0.0, 0.0, 0.0, 0.0)
    scene = Scene("s", earth=earth, nearest_m=2e7)
    staged = Staged.of(scene, [], [here, *tracks])
    pieces = staged.pieces
    own = np.array([np.flatnonzero((pieces.object_id == k) & (pieces.turn == 0))[0] for k in range(len(tracks) + 1)])
    a, b = PieceRows(np.full(len(tracks), own[0])), PieceRows(own[1:])
    zero = np.zeros(len(a))
    found = approaches(
        staged.prepared, a, b, zero, zero + np.inf, np.arange(len(a)), zero + np.inf, zero, kernel.Work()
    )
    assert (np.abs(found.distance_m - expected) <= found.error_m + 1e-6).all()
    assert (found.at_s == 0.0).all()
    between = geod.inv(*found.a_deg.T, *found.b_deg.T)[2]
    np.testing.assert_allclose(between, expected, atol=1e-6)


def test_what_is_no_number_is_not_known_and_costs_no_other_group_anything() -> None:
    given = Given.of(LOW_LATITUDE, 3, 6, EarthModel.WGS84).some(60)
    expected = given.closest()
    spoilt, shape = int(given.a[0]), given.pieces.shape_xy.copy()
    shape[given.pieces.shape_offset[spoilt]] = np.nan
    given.held = kernel.KernelScene(given.plane.kernel_plane, replace(given.pieces, shape_xy=shape, shape_to_xy=shape))
    found = given.closest()
    its_own = (given.a == spoilt) | (given.b == spoilt)
    assert np.isnan(found.distance_m[its_own]).all()
    assert (found.pair[its_own] == -1).all()
    for name in ("pair", "at_s", "distance_m", "error_m", "a_deg", "b_deg"):
        np.testing.assert_array_equal(getattr(found, name)[~its_own], getattr(expected, name)[~its_own])


@pytest.mark.parametrize("offset", [[1, 60], [0, 59], [0, 61], [0, 30, 20, 60]])
def test_groups_that_are_none_are_refused(offset: list[int]) -> None:
    given = Given.of(LOW_LATITUDE, 3, 6, EarthModel.WGS84).some(60)
    with pytest.raises(ValueError, match="offsets of groups"):
        given.closest(offset)
