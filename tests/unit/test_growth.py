"""Havens that change: their motion against the oracle, its bounds, and the answers of growing scenes."""

from dataclasses import astuple, replace

import numpy as np
import oracle
import pytest
import scenes
import shapely
from layouts import GROWING, LOW_LATITUDE
from mixed_scenes import plain_scene
from motion_bounds import LASTS_S, tightness
from scenes import HOUR_S
from verdicts import periods_us

from conflictdb import InvalidInput, kernel, solve
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.cutting import area_pieces, check_plane, track_pieces
from conflictdb.earth.geodesy import earth_of
from conflictdb.earth.registry import Setup
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import EarthModel, Scene, Track

ROUNDING_M = 2e-8  # plane coordinates reach 4e7 m


def shapes_at(scene: Scene, pieces: Pieces, rows: np.ndarray, zero_us: np.ndarray) -> Movement:
    return Movement.of(kernel.KernelScene(Setup.of(scene).plane.kernel_plane, pieces), rows, zero_us)


def whole_legs(pieces: Pieces) -> Pieces:
    """Shapes exist for the time of their slices: here those are the whole legs."""
    return replace(pieces, start_us=pieces.leg_start_us, end_us=pieces.leg_end_us)


def leg_shapes(scene: Scene, track: Track) -> tuple[Pieces, Movement]:
    """The one leg of a track, time counted from its start."""
    pieces = whole_legs(track_pieces(Setup.of(scene), TrackBatch.of([track])))
    return pieces, shapes_at(scene, pieces, np.zeros(1, np.int64), pieces.leg_start_us[:1])


@pytest.mark.parametrize("earth", EarthModel)
def test_vertices_agree_with_the_oracle(earth: EarthModel) -> None:
    """On every leg, also of havens that change at every waypoint."""
    scene, _, tracks = plain_scene(GROWING, 21, 0, 12, earth)
    globe, figure = oracle.Globe.of(earth), earth_of(earth)
    turn_m = 2 * np.pi * figure.radius_m
    for track in tracks:
        pieces = whole_legs(track_pieces(Setup.of(scene), TrackBatch.of([track])))
        for phase in oracle.phases(globe, track, 0.0):
            row = np.flatnonzero(pieces.leg_start_us == phase.start_us)[:1]
            seconds = np.linspace(0.0, (phase.end_us - phase.start_us) / 1e6, 7)
            rows = np.repeat(row, len(seconds))
            found = shapes_at(scene, pieces, rows, pieces.leg_start_us[rows]).positions(seconds).T
            expected = phase.vertices(int(phase.start_us), seconds)
            shift = np.round((found[..., 0].mean() - expected[..., 0].mean()) / turn_m) * turn_m
            apart = found[:, :, None] - expected[:, None] - np.array([shift, 0.0])
            distance = np.hypot(apart[..., 0], apart[..., 1])
            assert max(distance.min(axis=1).max(), distance.min(axis=2).max()) < 10 * ROUNDING_M


SMALL, LARGE = (1e4, 1e4, 1e4, 1e4), (1e5, 5e4, 3e4, 8e4)


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize(
    ("start", "way", "sizes", "mps", "limits"),
    [
        ((0, 10), (0, 3), SMALL, 0.0, (1.06, 1.24, 1.15)),
        ((0, 10), (3, 3), LARGE, 0.0, (1.13, 1.60, 1.37)),
        ((0, 60), (5, 3), LARGE, 0.0, (1.13, 3.67, 1.37)),
        ((0, 60), (5, 3), LARGE, 1.0, (1.34, 4.62, 1.67)),
        ((0, 75), (10, 2), LARGE, 1.0, (1.55, 5.26, 1.89)),
        ((0, 60), (5, 0), SMALL, 1.0, (2.40, 3.05, 1.08)),
        ((0, -60), (5, -3), LARGE, 1.0, (1.36, 4.39, 1.70)),
        ((0, 60), (5, -3), SMALL, 1.0, (1.27, 5.32, 1.80)),
        ((0, 10), (0, 3), (0.0, 0.0, 0.0, 0.0), 1.0, (1.07, 3.19, 1.09)),
    ],
)
def test_bounds_are_near_what_they_bound(
    earth: EarthModel,
    start: tuple[float, float],
    way: tuple[float, float],
    sizes: tuple[float, float, float, float],
    mps: float,
    limits: tuple[float, float, float],
) -> None:
    """The ratio of each bound to its exact value on a whole leg: as measured, and a hundredth more.

    A bound that grows costs time and widens the reported intervals; no other test notices.
    """
    end = (start[0] + way[0], start[1] + way[1])
    _, one = leg_shapes(
        Scene("s", earth=earth), replace(scenes.track("T", [start, end], [0, LASTS_S], *sizes), grow_mps=mps)
    )
    ratios, at, bounds = tightness(one)
    for ratio, limit in zip(ratios, limits, strict=True):
        assert 1.0 - 1e-6 <= ratio <= limit
    highest = earth_of(earth).plane_scale(np.abs(at[1]).max() / earth_of(earth).radius_m)
    assert bounds.scale[0] == pytest.approx(highest, rel=1e-12)


@pytest.mark.parametrize("earth", EarthModel)
def test_a_place_that_goes_over_to_the_other_side_stays_near_its_chord(earth: EarthModel) -> None:
    """Here the bound needs all of its parts: of how the offset bends, and of how unevenly the reference point goes."""
    track = scenes.track("T", [(0, 45.0), (0, 44.7)], [0, LASTS_S], *SMALL)
    starboard, port = np.array([[1e5, 5e4]]), np.array([[-1e5, -1e4]])
    _, one = leg_shapes(Scene("s", earth=earth), replace(track, outline_m=starboard, outlines_m=[starboard, port]))
    (_, deviation, _), _, _ = tightness(one)
    assert 1.0 <= deviation <= 1.3


def test_no_growth_is_no_change_in_any_company() -> None:
    """Pieces of a rigid haven are the same to the bit in a batch with a growing one."""
    scene = Scene("s")
    rigid = scenes.track("R", [(0, 50), (3, 60)], [0, LASTS_S], 9000.0, 3000.0, 500.0, 4000.0)
    grows = replace(rigid, key="G", grow_mps=1.0)
    alone = track_pieces(Setup.of(scene), TrackBatch.of([rigid]))
    both = track_pieces(Setup.of(scene), TrackBatch.of([rigid, grows]))
    mine = both.take(np.flatnonzero(both.object_id == 0))
    assert both.changes
    for name in ("hull_xy", "shape_xy", "shape_to_xy", "start_us", "end_us"):
        np.testing.assert_array_equal(getattr(mine, name), getattr(alone, name))
    rows = np.arange(len(alone))
    t0, t1 = np.zeros(len(rows)), np.full(len(rows), 600.0)
    one, other = (shapes_at(scene, p, rows, alone.start_us) for p in (alone, both))
    np.testing.assert_array_equal(other.positions(t1), one.positions(t1))
    for bound, same in zip(astuple(other.bounds(t0, t1)), astuple(one.bounds(t0, t1)), strict=True):
        np.testing.assert_array_equal(bound, same)


@pytest.mark.parametrize("mps", [1e-9, 1e-4, 0.1, 3.0])
@pytest.mark.parametrize("sizes", [(0.0,) * 4, (100.0, 50.0, 0.0, 0.0), (5000.0,) * 4])
def test_growth_needs_no_more_slices(mps: float, sizes: tuple[float, ...]) -> None:
    """However small the haven begins, and however slowly it grows."""
    steady = scenes.track("T", [(0, 60), (4, 63)], [0, LASTS_S], *sizes)
    pieces = track_pieces(Setup.of(Scene("s")), TrackBatch.of([replace(steady, grow_mps=mps)]))
    assert len(pieces) <= 32


def test_growth_beyond_the_plane_is_refused() -> None:
    """Where the haven would pass 89.5 degrees, by its speed or by an outline; the error names the field."""
    still = scenes.track("far", [(0, 88), (0, 88)], [0, HOUR_S], 1000.0, 1000.0, 1000.0, 1000.0)
    late = np.array([still.outline_m, still.outline_m * 170.0])
    for track, field in (
        (replace(still, grow_mps=50.0), "grow_mps"),
        (replace(still, outlines_m=late), "outlines_m"),
    ):
        with pytest.raises(InvalidInput, match=r"track 'far'.*89\.5 degrees of latitude") as refused:
            check_plane(Setup.of(Scene("s")).plane, [], [track])
        assert refused.value.field == field
    check_plane(Setup.of(Scene("s")).plane, [], [replace(still, grow_mps=40.0)])


@pytest.mark.parametrize("earth", EarthModel)
def test_the_same_growth_as_speed_and_as_outlines_is_the_same_answer(earth: EarthModel) -> None:
    """A rectangle that grows, or the outlines that it grows to."""
    scene, areas, tracks = plain_scene(replace(LOW_LATITUDE, odd_share=0.0), 3, 6, 6, earth)
    by_speed = [replace(t, grow_mps=0.5) for t in tracks]
    by_outlines = []
    for t in tracks:
        age_s = (t.times_us - t.times_us[0]) / 1e6
        # In a rectangle about the reference point every corner moves away from both axes.
        outlines = t.outline_m + 0.5 * age_s[:, None, None] * np.sign(t.outline_m)
        by_outlines.append(replace(t, outlines_m=outlines))
    found = solve(by_speed, areas, scene)
    assert found == solve(by_outlines, areas, scene)
    assert found != solve(tracks, areas, scene)


def test_a_growth_of_nothing_is_the_same_answer() -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 3, 6, 6)
    same = [replace(t, outlines_m=np.array([t.outline_m] * len(t.times_us))) for t in tracks]
    assert solve(tracks, areas, scene) == solve(same, areas, scene)
    assert solve(tracks, areas, scene) == solve([replace(t, grow_mps=0.0) for t in tracks], areas, scene)


def test_more_growth_meets_no_later() -> None:
    """The haven that grows faster contains the other one: its first contact is no later, its last no earlier."""
    wall = scenes.area("A", shapely.box(1.0, -1, 1.2, 1))
    track = scenes.track("T", [(0, 0.3), (2, -0.4)], [0, 10 * HOUR_S], 3000.0, 100.0, 100.0, 2000.0)
    spans = [periods_us(solve([replace(track, grow_mps=mps)], [wall])[0])[0] for mps in (0.0, 0.01, 0.1, 1.0)]
    starts, ends = zip(*spans, strict=True)
    assert list(starts) == sorted(starts, reverse=True)
    assert list(ends) == sorted(ends)
    assert starts[-1] < starts[0]


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("mps", [1.0, 1e-9, 1e-18])
def test_two_that_grow_from_nothing_meet_when_they_have_grown_enough(earth: EarthModel, mps: float) -> None:
    """Neither has an edge at the start: that must not look like a contact."""
    nothing = dict.fromkeys(("fore", "aft", "port", "starboard"), 0.0)
    one = replace(scenes.track("one", [(0, 0), (0, 0)], [0, 6 * HOUR_S], **nothing), grow_mps=mps)
    two = replace(scenes.track("two", [(0, 0.1), (0, 0.1)], [0, 6 * HOUR_S], **nothing), grow_mps=mps)
    beside = replace(scenes.track("beside", [(1, 0), (1, 0)], [0, 6 * HOUR_S], **nothing), grow_mps=mps)
    found = solve([one, two, beside], [], Scene("s", earth=earth, tolerance_m=0.0))
    if mps < 1.0:
        assert found == []
        return
    (meeting,) = found
    meets_s = scenes.meridian_m(earth, 0.1) / 2.0
    assert (meeting.a_key, meeting.b_key) == ("one", "two")
    ((start_us, end_us),) = periods_us(meeting)
    assert start_us == pytest.approx(scenes.instant_us(meets_s), abs=3)
    assert end_us == scenes.instant_us(6 * HOUR_S)


def test_a_haven_that_draws_in_to_a_point_and_opens_again() -> None:
    """Through a point halfway on the leg: it leaves the wall it touches, and comes back to it."""
    square = scenes.track("T", [(0, 0), (0, 0)], [0, 2 * HOUR_S], 9000.0, 9000.0, 9000.0, 9000.0)
    turned = replace(square, outlines_m=np.array([square.outline_m, -square.outline_m]))
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0)
    wall = scenes.area("A", shapely.box(-1, np.degrees(4500.0 / 6371008.771415), 1, 1))
    (meeting,) = solve([turned], [wall], scene)
    assert len(periods_us(meeting)) == 2
    (_, out), (back, _) = periods_us(meeting)
    assert out == pytest.approx(scenes.instant_us(0.5 * HOUR_S), abs=3)
    assert back == pytest.approx(scenes.instant_us(1.5 * HOUR_S), abs=3)


@pytest.mark.parametrize("mps", [1.0, 0.5, 1e-18])
def test_points_close_beside_each_other_meet_when_they_have_grown_enough(mps: float) -> None:
    """A tenth of a metre apart on long curved ways: the first window begins where neither has an edge."""
    metre = 1.0 / (scenes.meridian_m(EarthModel.SPHERE, 0.5) - scenes.meridian_m(EarthModel.SPHERE, -0.5))
    nothing = dict.fromkeys(("fore", "aft", "port", "starboard"), 0.0)
    tracks = [
        replace(scenes.track(key, [(0, lat), (0, lat + 4)], [0, 10 * HOUR_S], **nothing), grow_mps=mps)
        for key, lat in (("ahead", 60.0 + 0.1 * metre), ("behind", 60.0))
    ]
    found = solve(tracks, [], Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0))
    if mps < 0.1:  # too little for an edge to show at all
        assert found == []
        return
    ((start_us, _),) = periods_us(found[0])
    assert start_us == pytest.approx(scenes.instant_us(0.05 / mps), abs=10)


def test_polygons_without_any_edge_have_no_depth() -> None:
    """Four vertices in one place, as a haven has before it grows, do not overlap."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    boxes = AreaBatch.of([scenes.area(key, shapely.box(0, 0, 1, 1)) for key in ("A", "B")])
    pieces = area_pieces(Setup.of(scene), boxes)
    pieces = replace(pieces, shape_xy=np.repeat([[0.0, 0.0], [10.0, 0.0]], 4, axis=0))
    zero = np.zeros(1)
    pair = kernel.Questions(np.array([0]), np.array([1]), zero.astype(np.int64), zero, zero + 100.0, zero + np.inf)
    prepared = kernel.KernelScene(Setup.of(scene).plane.kernel_plane, pieces)
    assert len(kernel.contacts(prepared, pair, 0.0, 1.0, kernel.Work())) == 0
