"""Outlines that change: corners of sides that move outward, and polygons that stay convex on the way."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from layouts import GROWING
from mixed_scenes import plain_scene
from oracle_motion import grown, outlines

from conflictdb.arrays.objects import TrackBatch
from conflictdb.core.pieces.cutting import _legs, track_pieces
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.model.outlines import lose_convexity, mitred
from conflictdb.model.plan_rows import Many
from conflictdb.model.plans import Scene, Track, rectangle_outline_m


def grown_by(outline: np.ndarray, by_m: float) -> np.ndarray:
    corners, rate, _ = mitred(outline, np.array([0, len(outline)]))
    return corners + by_m * rate


rings = st.integers(0, 2**32).map(
    lambda seed: shapely.get_coordinates(
        shapely.MultiPoint(np.random.default_rng(seed).uniform(-1e3, 1e3, (12, 2))).convex_hull
    )[:-1]
)


@settings(max_examples=100)
@given(rings, st.floats(0.1, 1e4), st.booleans(), st.booleans())
def test_sides_move_outward_and_corners_are_mitred(ring: np.ndarray, by_m: float, flip: bool, repeat: bool) -> None:
    """The same polygon as a buffer with mitred corners, whichever way round, and with vertices given twice."""
    given = np.repeat(ring, 2, axis=0) if repeat else ring
    found = grown_by(given[::-1] if flip else given, by_m)
    wanted = shapely.buffer(shapely.Polygon(ring), by_m, join_style="mitre", mitre_limit=1e6)
    assert len(found) == len(ring)
    assert shapely.hausdorff_distance(shapely.Polygon(found), wanted) < 1e-6 * (1e3 + by_m) * 100
    assert np.allclose(found, grown(given[::-1] if flip else given, by_m), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize(
    ("outline", "wanted"),
    [
        (rectangle_outline_m(0, 0, 0, 0), (-2, -2, 2, 2)),
        (np.array([[5.0, 1.0]]), (3, -1, 7, 3)),
        (rectangle_outline_m(4, 1, 0, 0), (-2, -3, 2, 6)),
        (rectangle_outline_m(0, 0, 4, 1), (-6, -2, 3, 2)),
        (rectangle_outline_m(4, 1, 2, 3), (-4, -3, 5, 6)),
        (np.array([[0.0, 0.0], [0.0, 4.0], [4.0, 4.0], [4.0, 2.0], [4.0, 0.0]]), (-2, -2, 6, 6)),
        (np.zeros((3, 2)), (-2, -2, 2, 2)),
    ],
)
def test_rectangles_lines_and_points_grow_exactly(outline: np.ndarray, wanted: tuple[float, ...]) -> None:
    found = grown_by(outline, 2.0)
    assert (*found.min(axis=0), *found.max(axis=0)) == wanted
    assert shapely.Polygon(found).area == shapely.box(*wanted).area


def test_a_slanted_line_grows_to_a_rectangle() -> None:
    found = shapely.Polygon(grown_by(np.array([[0.0, 0.0], [3.0, 4.0]]), 1.0))
    wanted = shapely.buffer(shapely.LineString([(0, 0), (3, 4)]), 1.0, cap_style="square", join_style="mitre")
    assert shapely.hausdorff_distance(found, wanted) < 1e-12


def test_outlines_of_a_batch_are_those_of_each_track() -> None:
    """At both ends of every leg, in a batch with tracks of every kind; brute force gives the same."""
    scene, _, tracks = plain_scene(GROWING, 5, 0, 40)
    assert sum(t.grow_mps > 0 for t in tracks) > 5
    assert sum(t.outlines_m is not None for t in tracks) > 5
    legs = _legs(Setup.of(scene).plane, TrackBatch.of(tracks))
    leg = 0
    for track in tracks:
        wanted = outlines(track)
        for k in range(len(track.times_us) - 1):
            rows = slice(legs.outline_offset[leg], legs.outline_offset[leg + 1])
            ends = np.hstack([legs.outline_m[rows], legs.outline_to_m[rows]])
            expected = np.hstack([wanted[k], wanted[k + 1]])
            distance = np.hypot(*np.moveaxis(ends[:, None] - expected[None], -1, 0)[:2])
            assert distance.min(axis=1).max() < 1e-6
            assert distance.min(axis=0).max() < 1e-6
            assert shapely.Polygon(ends[:, :2]).exterior.is_ccw or shapely.Polygon(ends[:, :2]).area < 1e-6
            leg += 1


def test_nothing_that_changes_shares_its_memory() -> None:
    _, _, tracks = plain_scene(GROWING, 5, 0, 40)
    steady = [replace(t, grow_mps=0.0, outlines_m=None) for t in tracks]
    steady[3] = replace(steady[3], outlines_m=np.array([steady[3].outline_m] * len(steady[3].times_us)))
    legs = _legs(Setup.of(Scene("s")).plane, TrackBatch.of(steady))
    assert legs.outline_to_m is legs.outline_m


SQUARE = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]


def stays_convex(start: list[list[float]], end: list[list[float]]) -> bool:
    """Return whether a ring stays convex; the answer is the same between two others."""
    rings, count = [SQUARE, start, SQUARE], np.array([4, len(start), 4])
    lost = lose_convexity(np.concatenate(rings), np.concatenate([SQUARE, end, SQUARE[::-1]]), Many.of(count))
    assert lost[[0, 2]].tolist() == [False, True]
    return not lost[1]


@pytest.mark.parametrize(
    ("start", "end", "stays"),
    [
        (SQUARE, SQUARE, True),
        (SQUARE, [[9.0, 9.0], [99.0, 9.0], [99.0, 10.0], [9.0, 10.0]], True),
        (SQUARE, [*SQUARE[1:], SQUARE[0]], True),  # a quarter turn
        (SQUARE, [*SQUARE[2:], *SQUARE[:2]], True),  # half a turn, through a point
        (SQUARE, SQUARE[::-1], False),  # turned over
        (SQUARE, [[2.0, 2.0]] * 4, True),
        ([[2.0, 2.0]] * 4, SQUARE, True),
        (SQUARE, [[0.0, 0.0], [4.0, 0.0], [4.0, 0.0], [0.0, 4.0]], True),
        ([[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [0.0, 4.0]], [[0.0, 0.0], [0.0, 2.0], [0.0, 4.0], [-4.0, 0.0]], True),
        ([[0.0, 0.0], [1.0, 0.0], [4.0, 0.0], [0.0, 4.0]], [[0.0, 0.0], [0.0, 3.0], [0.0, 4.0], [-4.0, 0.0]], False),
        ([[0.0, 0.0], [3.0, 0.0], [4.0, 0.0], [0.0, 4.0]], [[0.0, 0.0], [0.0, 1.0], [0.0, 4.0], [-4.0, 0.0]], True),
        ([[0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 5.0]], True),
        ([[0.0, 0.0]], [[1.0, 0.0]], True),
    ],
)
def test_staying_convex(start: list[list[float]], end: list[list[float]], stays: bool) -> None:
    assert stays_convex(start, end) is stays
    assert stays_convex(end, start) is stays
    assert stays_convex(start[::-1], end[::-1]) is stays
    for share in np.linspace(0.0, 1.0, 41):
        between = shapely.Polygon((1 - share) * np.array(start) + share * np.array(end)) if len(start) > 2 else None
        if between is not None and stays and between.area > 1e-9:
            assert shapely.area(between.convex_hull) == pytest.approx(between.area, rel=1e-12)


@pytest.mark.parametrize("side", [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
def test_a_vertex_on_a_side_is_convex_wherever_the_outline_lies(side: tuple[float, float]) -> None:
    """Also where its coordinates are rounded inwards: to either side of the reference point, ahead of it or behind."""
    inwards = 0
    for part in np.linspace(0.01, 0.99, 99):
        first, last = np.array([1000.0, 1.0]), np.array([1.0, 1000.0])
        ring = np.array([first, first + part * (last - first), last, [1000.0, 1000.0]]) * side
        between, after = ring[1] - ring[0], ring[2] - ring[1]
        inwards += side[0] * side[1] * (between[0] * after[1] - between[1] * after[0]) > 0.0
        assert stays_convex(ring.tolist(), ring.tolist())
    assert inwards > 5


@settings(max_examples=200)
@given(st.integers(0, 2**32))
def test_staying_convex_is_what_sampling_says(seed: int) -> None:
    """Between random convex rings of as many vertices; the answer is that of 200 instants."""
    rng = np.random.default_rng(seed)
    angle = [np.sort(rng.uniform(0, 2 * np.pi, 5)) + rng.uniform(-1, 1) for _ in range(2)]
    start, end = (np.stack([np.cos(a), np.sin(a)], axis=1) * rng.uniform(0.3, 2, 2) for a in angle)
    share = np.linspace(0.0, 1.0, 201)[:, None, None]
    ring = (1 - share) * start + share * end
    edge = np.roll(ring, -1, axis=1) - ring
    after = np.roll(edge, -1, axis=1)
    least = (edge[..., 0] * after[..., 1] - edge[..., 1] * after[..., 0]).min()
    if abs(least) > 1e-3:
        assert stays_convex(start.tolist(), end.tolist()) is bool(least > 0.0)


def moored(**more: object) -> Track:
    return replace(scenes.track("T", [(0, 0), (0, 0), (0, 0)], [0, 10, 20]), **more)


SPIKE = np.array([[0.0, 0.0], [1000.0, 0.0], [1000.0, 5.0]])


@pytest.mark.parametrize(
    ("more", "field", "rule"),
    [
        ({"grow_mps": True}, "grow_mps", "from 0 to"),
        ({"grow_mps": "1"}, "grow_mps", "from 0 to"),
        ({"outlines_m": np.zeros((3, 2))}, "outlines_m", "equal vertex counts"),
        ({"outlines_m": np.full((3, 1, 2), np.inf)}, "outlines_m[0]", "finite"),
        ({"outlines_m": np.zeros((3, 1, 2))}, "outline_m", "first of outlines_m"),
    ],
)  # fmt: skip
def test_what_cannot_change_like_that_is_refused(more: dict[str, object], field: str, rule: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        moored(**more)
    assert refused.value.key == "track 'T'"
    assert refused.value.field == field
    assert rule in refused.value.rule


def test_a_haven_that_is_pointed_but_not_sharp_may_grow() -> None:
    assert moored(outline_m=SPIKE * [1.0, 5.0], grow_mps=1.0).grow_mps == 1.0


def test_steady_scenes_know_nothing_of_growth() -> None:
    """A growth of 0, and an outline per waypoint that is always the same, change nothing."""
    _, _, tracks = plain_scene(GROWING, 5, 0, 8)
    for track in tracks:
        steady = replace(track, grow_mps=0.0, outlines_m=None)
        same = replace(steady, outlines_m=np.array([steady.outline_m] * len(steady.times_us)))
        one, other = (scenes_of(Scene("s"), t) for t in (steady, same))
        for left, right in zip(one, other, strict=True):
            np.testing.assert_array_equal(left, right)


def scenes_of(scene: Scene, track: Track) -> list[np.ndarray]:
    pieces = track_pieces(Setup.of(scene), TrackBatch.of([track]))
    assert not pieces.changes
    return [pieces.hull_xy, pieces.shape_xy, pieces.start_us]
