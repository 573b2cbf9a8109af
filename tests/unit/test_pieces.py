"""Pieces contain all that their objects cover, in space and time, and only convex pieces are marked convex."""

from typing import Any

import numpy as np
import oracle
import oracle_circle
import pytest
import scenes
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from layouts import WORKLOADS, Workload
from mixed_scenes import plain_scene

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.cutting import MAX_SLICES, area_pieces, check_plane, track_pieces
from conflictdb.earth.geodesy import earth_of
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, EarthModel, Motion, Scene, Track


def hull(pieces: Pieces, k: int) -> shapely.Polygon:
    return shapely.Polygon(pieces.hull_xy[pieces.hull_offset[k] : pieces.hull_offset[k + 1]])


def shape(pieces: Pieces, k: int) -> np.ndarray:
    return pieces.shape_xy[pieces.shape_offset[k] : pieces.shape_offset[k + 1]]


def true_phases(scene: Scene, thing: Area | Track) -> list[Any]:
    """The brute-force phases of an object, in the scene's plane."""
    if scene.motion is Motion.GREAT_CIRCLE:
        assert scene.centre is not None
        return oracle_circle.phases(oracle_circle.Chart.at(*scene.centre), thing)
    return oracle.phases(oracle.Globe.of(scene.earth), thing, 0.0)


def assert_holds_the_motion(scene: Scene, track: Track, samples: int = 33) -> Pieces:
    """Every vertex of the true motion, sampled, lies in the hull of the slice, with half the tolerance to spare."""
    pieces = track_pieces(Setup.of(scene), TrackBatch.of([track]))
    turn_m = 2 * np.pi * earth_of(scene.earth).radius_m
    phases = {phase.start_us: phase for phase in true_phases(scene, track)}
    for k in range(len(pieces)):
        around = hull(pieces, k)
        assert around.is_valid
        phase = phases[int(pieces.leg_start_us[k])]
        seconds = np.linspace(0.0, (pieces.end_us[k] - pieces.start_us[k]) / 1e6, samples)
        xy = phase.vertices(int(pieces.start_us[k]), seconds).reshape(-1, 2)
        shift = np.round((around.centroid.x - xy[:, 0].mean()) / turn_m) * turn_m
        points = shapely.points(xy + np.array([shift, 0.0]))
        # Tight, too: the padding for the curvature within a slice may not dwarf the slice.
        spare_m = 200.0 * (scene.tolerance_m + scene.separation_m) + 1.0
        if scene.centre is not None:  # the plane stretches by up to 4 there, across by 2
            spare_m *= 4.0
        assert np.ptp(around.exterior.xy[0]) < 3.0 * (np.ptp(xy[:, 0]) + np.ptp(xy[:, 1])) + spare_m
        assert shapely.contains_properly(around, points).all()
        assert shapely.distance(around.exterior, points).min() >= 0.49 * (scene.tolerance_m + scene.separation_m)
    return pieces


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda w: w.name)
def test_hulls_hold_the_true_motion(workload: Workload, earth: EarthModel) -> None:
    scene, _, tracks = plain_scene(workload, 31, 0, 8, earth, separation_m=50.0)
    for track in tracks:
        assert_holds_the_motion(scene, track)


@pytest.mark.slow
@pytest.mark.parametrize("earth", EarthModel)
def test_hulls_hold_the_true_motion_sweep(earth: EarthModel) -> None:
    for workload in WORKLOADS:
        for seed in range(40, 60):
            scene, _, tracks = plain_scene(workload, seed, 0, 20, earth)
            for track in tracks:
                assert_holds_the_motion(scene, track)


@settings(max_examples=60)
@given(
    st.sampled_from(list(EarthModel)),
    st.floats(-88, 88),
    st.floats(-88, 88),
    st.floats(-180, 180),
    st.floats(-180, 180),
    st.tuples(*[st.sampled_from([0.0, 1.0, 1e4, 2e5, 9e5])] * 4),
)
def test_hulls_hold_any_leg(
    earth: EarthModel, lat1: float, lat2: float, lon1: float, lon2: float, sizes: tuple[float, ...]
) -> None:
    scene = Scene("s", earth=earth, tolerance_m=0.0)
    track = scenes.track("T", [(lon1, lat1), (lon2, lat2)], [0, 1e6], *sizes)
    try:
        check_plane(Setup.of(scene).plane, [], [track])
    except InvalidInput:
        return  # reaches over the pole
    assert_holds_the_motion(scene, track)


@pytest.mark.parametrize(
    ("havens", "slices"), [(0.5, 1), (31.5, 1), (32.5, 2), (127.0, 2), (129.0, 3), (1e4, MAX_SLICES)]
)
def test_a_leg_has_as_many_slices_as_the_root_of_its_length(havens: float, slices: int) -> None:
    """Thirty-two havens long are one slice; the haven here is 200 m across, with the tolerance of a metre."""
    track = scenes.track("T", [(0.0, 0.0), (havens * 201.0 / 111_319.49, 0.0)], [0, 1e5], 100.0, 100.0, 0.0, 0.0)
    assert len(track_pieces(Setup.of(Scene("s")), TrackBatch.of([track]))) == slices
    wide = Scene("s", separation_m=2e6)
    assert len(track_pieces(Setup.of(wide), TrackBatch.of([track]))) == 1


def test_slices_follow_each_other_without_a_gap() -> None:
    scene, _, tracks = plain_scene(WORKLOADS[0], 32, 0, 10)
    pieces = track_pieces(Setup.of(scene), TrackBatch.of(tracks))
    for number, track in enumerate(tracks):
        own = np.flatnonzero((pieces.turn == 0) & (pieces.object_id == number))
        order = own[np.argsort(pieces.start_us[own], kind="stable")]
        assert pieces.start_us[order[0]] == track.times_us[0]
        assert pieces.end_us[order[-1]] == track.times_us[-1]
        np.testing.assert_array_equal(pieces.end_us[order[:-1]], pieces.start_us[order[1:]])
        assert pieces.end_inclusive[order].tolist() == [True] * (len(order) - 1) + [False]
        assert set(track.times_us.tolist()) <= {*pieces.start_us.tolist(), *pieces.end_us.tolist()}
        assert pieces.part[order].tolist() == list(range(len(order)))


def test_a_loiter_before_the_last_leg_has_its_heading() -> None:
    """Also in a batch of its own; a track that never moves heads north."""
    waits = scenes.track("T", [(0, 0), (0, 0), (1, 0)], [0, 100, 200], 4e4, 0.0, 0.0, 0.0)
    stays = scenes.track("U", [(0, 0), (0, 0)], [0, 100], 4e4, 0.0, 0.0, 0.0)
    east, north = (track_pieces(Setup.of(Scene("s")), TrackBatch.of([track])) for track in (waits, stays))
    for pieces, (width, height) in ((east, (4e4, 0.0)), (north, (0.0, 4e4))):
        west, south, right, top = hull(pieces, 0).bounds
        assert (right - west, top - south) == pytest.approx((width, height), rel=0.01, abs=10.0)


def test_a_leg_of_three_microseconds_has_no_empty_slices() -> None:
    track = scenes.track("T", [(0, 0), (9, 9)], [0, 3e-6], 1.0, 1.0, 1.0, 1.0)
    pieces = track_pieces(Setup.of(Scene("s")), TrackBatch.of([track]))
    assert (pieces.end_us > pieces.start_us).all()


def ring_is_convex_and_left_handed(ring: np.ndarray) -> bool:
    edges = np.roll(ring, -1, axis=0) - ring
    after = np.roll(edges, -1, axis=0)
    cross = edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0]
    size = np.hypot(*edges.T).max()
    return bool((cross >= -1e-9 * size).all()) and bool(cross.sum() > 0)


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda w: w.name)
def test_parts_make_up_the_area(workload: Workload, earth: EarthModel) -> None:
    """Convex, counter-clockwise, not overlapping, and together the area: no more, no less."""
    scene, areas, _ = plain_scene(workload, 33, 12, 0, earth)
    pieces = area_pieces(Setup.of(scene), AreaBatch.of(areas))
    for i, area in enumerate(areas):
        own = np.flatnonzero((pieces.object_id == i) & (pieces.turn == 0))
        rings = [shape(pieces, k) for k in own]
        assert all(ring_is_convex_and_left_handed(ring) for ring in rings)
        true = true_phases(scene, area)[0].footprint
        turn_m = 2 * np.pi * earth_of(scene.earth).radius_m
        # Each part may have come home by turns of its own.
        parts = []
        for ring in rings:
            shift = np.round((true.centroid.x - ring[:, 0].mean()) / turn_m) * turn_m
            parts.append(shapely.Polygon(ring + np.array([shift, 0.0])))
        assert sum(part.area for part in parts) == pytest.approx(true.area, rel=1e-9)
        assert shapely.symmetric_difference(shapely.union_all(parts), true).area < 1e-9 * true.area
        for k, ring in zip(own, rings, strict=True):
            assert shapely.covers(hull(pieces, k), shapely.MultiPoint(ring))
            assert pieces.start_us[k] == (MINUS_INFINITY_US if area.start_us is None else area.start_us)
            assert pieces.end_us[k] == (INFINITY_US if area.end_us is None else area.end_us)
            assert not pieces.end_inclusive[k]


def test_convex_areas_are_one_piece_and_others_few() -> None:
    corners = np.array([(np.cos(a), np.sin(a)) for a in np.linspace(0, 2 * np.pi, 400, endpoint=False)])
    star = corners * (1 + 0.3 * np.sin(np.linspace(0, 40 * np.pi, 400, endpoint=False)))[:, None]
    areas = [
        scenes.area("box", shapely.box(0, 0, 1, 1)),
        scenes.area("collinear", shapely.Polygon([(0, 0), (0.5, 0), (1, 0), (1, 0.5), (1, 1), (0, 1)])),
        scenes.area("round", shapely.Polygon(corners)),
        scenes.area("L", shapely.Polygon([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)])),
        scenes.area("star", shapely.Polygon(star)),
    ]
    pieces = area_pieces(Setup.of(Scene("s")), AreaBatch.of(areas))
    counts = np.bincount(pieces.object_id)
    # A circle in degrees is convex in the Mercator plane too; an L is two pieces, three at most.
    assert counts[:3].tolist() == [1, 1, 1]
    assert counts[3] <= 3
    assert counts[4] <= 4 * 41


def test_copies_across_the_seam() -> None:
    """An area that reaches +180 degrees has a copy one turn west, and an area outside +-180 is wrapped."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    half = np.pi * earth_of(scene.earth).radius_m
    areas = [
        scenes.area("inside", shapely.box(10, 0, 20, 1)),
        scenes.area("across", shapely.box(170, 0, 190, 1)),
        scenes.area("beyond", shapely.box(190, 0, 200, 1)),
        scenes.area("before", shapely.box(-200, 0, -190, 1)),
        scenes.area("at", shapely.box(170, 0, 180, 1)),
        scenes.area("world", shapely.box(-180, 0, 180, 1)),
    ]
    pieces = area_pieces(Setup.of(scene), AreaBatch.of(areas))
    turns = {area.key: sorted(pieces.turn[pieces.object_id == i].tolist()) for i, area in enumerate(areas)}
    assert turns["inside"] == [0]
    assert turns["across"] == [-1, 0]
    assert turns["beyond"] == [0]
    assert turns["before"] == [0]
    assert turns["at"] == [-1, 0]
    assert -1 in turns["world"]
    for k in range(len(pieces)):
        west, _, _, _ = hull(pieces, k).bounds
        assert -half <= west + 2 * half * -int(pieces.turn[k]) < half
    tracks = [scenes.track("E", [(179, 0), (-179, 0)], [0, 100]), scenes.track("on", [(180, 0), (180, 5)], [0, 100])]
    moving = track_pieces(Setup.of(scene), TrackBatch.of(tracks))
    for i in range(2):
        assert {0, -1} == set(moving.turn[moving.object_id == i].tolist())


@pytest.mark.parametrize(
    ("lat", "sizes", "field"),
    [(89.5, (1, 1, 1, 1), "geometry"), (-89.1, (1, 1, 1, 1), "geometry"), (88.9, (2e5, 0, 0, 0), "outline_m")],
)
def test_what_the_plane_cannot_hold_is_refused(lat: float, sizes: tuple[float, ...], field: str) -> None:
    track = scenes.track("far north", [(0, 80 * np.sign(lat)), (0, lat)], [0, 100], *sizes)
    with pytest.raises(InvalidInput, match="89") as refusal:
        check_plane(Setup.of(Scene("s")).plane, [], [track])
    assert "far north" in refusal.value.key
    assert refusal.value.field == field


def test_areas_over_a_pole_are_refused_by_name() -> None:
    cap = scenes.area("cap", shapely.box(-180, 85, 180, 90))
    with pytest.raises(InvalidInput, match=r"89 degrees.*great_circle") as refusal:
        check_plane(Setup.of(Scene("s")).plane, [cap], [])
    assert refusal.value.key == "area 'cap'"


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("grow_mps", [0.0, 1e6])
def test_a_leg_that_is_too_short_to_be_cut_is_padded_by_no_more_than_its_haven_needs(
    earth: EarthModel, grow_mps: float
) -> None:
    """From pole to pole in a microsecond."""
    scene = Scene("s", earth=earth)
    times_us = np.array([scenes.T0_US, scenes.T0_US + 1])
    outline_m = np.array([(-239646.0, -55706.0), (958585.0, 23965.0)])
    track = Track(
        "T", np.array([(-34.0, -89.0), (0.0, 89.0)]), times_us, outline_m, grow_mps=grow_mps, max_speed_kn=np.inf
    )
    check_plane(Setup.of(scene).plane, [], [track])
    pieces = track_pieces(Setup.of(scene), TrackBatch.of([track]))
    assert len(pieces) <= 20  # that of the leg, and copies for the turns that a haven of 1,000 km makes near a pole


def test_nothing_makes_no_pieces() -> None:
    scene = Scene("s")
    assert len(area_pieces(Setup.of(scene), AreaBatch.of([]))) == 0
    assert len(track_pieces(Setup.of(scene), TrackBatch.of([]))) == 0
