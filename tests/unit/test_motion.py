"""The motion of havens compared with the oracle, and its bounds with the exact values."""

from dataclasses import replace

import kernel_planes
import numpy as np
import oracle
import pytest
import scenes
from layouts import HARBOUR, HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE, SEAM
from mixed_scenes import plain_scene

from conflictdb import kernel
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.cutting import track_pieces
from conflictdb.earth.geodesy import earth_of
from conflictdb.earth.mercator import Mercator
from conflictdb.earth.registry import Setup
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import EarthModel, Scene, Track

ROUNDING_M = 2e-8  # plane coordinates reach 4e7 m
SAMPLES = 65


def havens(scene: Scene, pieces: Pieces, rows: np.ndarray, zero_us: np.ndarray) -> Movement:
    return Movement.of(kernel.KernelScene(Setup.of(scene).plane.kernel_plane, pieces), rows, zero_us)


def legs_as_shapes(scene: Scene, track: Track) -> tuple[Pieces, Movement]:
    """One row per leg of a track, time counted from the leg's start."""
    pieces = track_pieces(Setup.of(scene), TrackBatch.of([track]))
    # Shapes exist for the time of their slices: here those are the whole legs.
    pieces = replace(pieces, start_us=pieces.leg_start_us, end_us=pieces.leg_end_us)
    _, first = np.unique(pieces.leg_start_us, return_index=True)
    return pieces, havens(scene, pieces, first, pieces.leg_start_us[first])


def oracle_plane(scene: Scene, track: Track, leg: int, seconds: np.ndarray) -> np.ndarray:
    globe = oracle.Globe.of(scene.earth)
    (phase,) = [oracle.phases(globe, track, 0.0)[leg]]
    return phase.vertices(int(track.times_us[leg]), seconds)


def shape_error_m(earth: EarthModel, found: np.ndarray, expected: np.ndarray) -> float:
    """Largest distance of the vertices of (2, v, n) shapes from those of (n, w, 2), in any order, up to whole turns."""
    found = found.transpose(2, 1, 0)
    turn = 2 * np.pi * oracle.Globe.of(earth).a
    shift = np.round((found[..., 0].mean() - expected[..., 0].mean()) / turn) * turn
    apart = found[:, :, None] - expected[:, None] - np.array([shift, 0.0])
    distance = np.hypot(apart[..., 0], apart[..., 1])
    return float(max(distance.min(axis=1).max(), distance.min(axis=2).max()))


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS, SEAM, HARBOUR], ids=lambda w: w.name)
def test_vertices_agree_with_the_oracle(workload: object, earth: EarthModel) -> None:
    scene, _, tracks = plain_scene(workload, 21, 0, 6, earth)
    for track in tracks:
        _, shapes = legs_as_shapes(scene, track)
        for leg in range(len(track.times_us) - 1):
            leg_s = float(track.times_us[leg + 1] - track.times_us[leg]) / 1e6
            seconds = np.linspace(0.0, leg_s, 9)
            rows = shapes.take(np.full(len(seconds), leg))
            expected = oracle_plane(scene, track, leg, seconds)
            assert shape_error_m(earth, rows.positions(seconds), expected) < 10 * ROUNDING_M


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("end", [84.0, -84.0])
@pytest.mark.parametrize("size_m", [1e3, 2e4, 5e4])
def test_vertices_of_slices_agree_with_the_oracle(earth: EarthModel, end: float, size_m: float) -> None:
    """All the way from the equator towards a pole: the nearer it is, the more terms their power series need."""
    scene = Scene("s", earth=earth)
    track = scenes.track("T", [(0.0, 0.0), (20.0, end)], [0, 36000], size_m, size_m, size_m, size_m)
    pieces = track_pieces(Setup.of(scene), TrackBatch.of([track]))
    for row in range(0, len(pieces), 5):
        shapes = havens(scene, pieces, np.full(3, row), np.full(3, pieces.start_us[row]))
        seconds = np.linspace(0.0, float(pieces.end_us[row] - pieces.start_us[row]) / 1e6, 3)
        into_leg_s = float(pieces.start_us[row] - track.times_us[0]) / 1e6
        expected = oracle_plane(scene, track, 0, into_leg_s + seconds)
        assert shape_error_m(earth, shapes.positions(seconds), expected) < 10 * ROUNDING_M, row


CARDINAL = [
    quarter + sign * away for quarter in (0, 90, 180, 270) for away in (0.0, 1e-12, 1e-9, 1e-6) for sign in (1, -1)
]


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("lat", [0.0, 50.0, -80.0])
def test_vertices_near_cardinal_bearings_agree_with_the_oracle(earth: EarthModel, lat: float) -> None:
    scene = Scene("s", earth=earth)
    for bearing in CARDINAL:
        away = 0.5 * np.array([np.sin(np.radians(bearing)), np.cos(np.radians(bearing))])
        away[np.abs(away) < 1e-16] = 0.0
        track = scenes.track("T", [(0.0, lat), (float(away[0]), lat + float(away[1]))], [0, 3600], 8e4, 1e4, 2e4, 5e4)
        _, shapes = legs_as_shapes(scene, track)
        seconds = np.array([0.0, 1000.0, 3600.0])
        rows = shapes.take(np.zeros(3, np.int64))
        expected = oracle_plane(scene, track, 0, seconds)
        assert shape_error_m(earth, rows.positions(seconds), expected) < 10 * ROUNDING_M, bearing


@pytest.mark.parametrize("earth", EarthModel)
def test_legs_from_near_one_pole_to_near_the_other_lose_no_digits(earth: EarthModel) -> None:
    """By symmetry they cross the equator at half their longitude and time: where a metre is a metre of the plane."""
    scene, figure = Scene("s", earth=earth), earth_of(earth)
    off = []
    for lat in np.linspace(88.0, 89.0, 21):
        track = scenes.track("T", [(-179.0, -lat), (0.9, lat)], [0, 36000], 0.5, 0.5, 0.5, 0.5)
        track = replace(track, outline_m=np.zeros((1, 2)))
        pieces = track_pieces(Setup.of(scene), TrackBatch.of([track])).take(np.array([0]))
        pieces = replace(pieces, start_us=pieces.leg_start_us, end_us=pieces.leg_end_us)
        x, y = havens(scene, pieces, np.zeros(1, np.int64), pieces.leg_start_us).positions(np.array([18000.0]))[:, 0, 0]
        off.append(np.hypot(x - figure.radius_m * np.radians(-89.05), y))
    assert max(off) < 6e-8


def test_tiny_leg_keeps_its_heading() -> None:
    """A leg of a millimetre steers a haven of 10 nmi: its nose may be off by the effect of a rounded degree."""
    scene = Scene("s", earth=EarthModel.WGS84)
    track = scenes.track("T", [(10, 50), (10 + 9e-9, 50 + 9e-9)], [0, 60], 18520.0, 0.0, 10.0, 10.0)
    _, shapes = legs_as_shapes(scene, track)
    found = shapes.take(np.array([0])).positions(np.array([30.0]))
    assert shape_error_m(scene.earth, found, oracle_plane(scene, track, 0, np.array([30.0]))) < 0.1


@pytest.mark.parametrize("earth", EarthModel)
def test_bounds_hold_for_a_haven_that_points_away_from_the_pole(earth: EarthModel) -> None:
    """Latitude plus reach passes the pole here, although no vertex does: the bounds must not fold over."""
    scene = Scene("s", earth=earth)
    track = scenes.track("T", [(0, 87.5), (30, 80)], [0, 36000], 1.2e6, 0.0, 5e4, 5e4)
    _, one = legs_as_shapes(scene, track)
    seconds = np.linspace(0.0, 36000.0, 4001)
    at = one.take(np.zeros(4001, np.int64)).positions(seconds).transpose(2, 1, 0)
    h = seconds[1]
    second = np.hypot(*np.moveaxis(at[2:] - 2 * at[1:-1] + at[:-2], -1, 0)) / h**2
    acceleration = one.bounds(np.array([0.0]), np.array([36000.0])).acceleration[0]
    assert second.max() <= acceleration
    assert acceleration < 1e3 * second.max(), "a bound that is of use"


@pytest.mark.parametrize("part", [(0.0, 1.0), (0.9, 1.0), (0.98, 1.0)])
@pytest.mark.parametrize("earth", EarthModel)
def test_bounds_hold_for_a_haven_that_widens(earth: EarthModel, part: tuple[float, float]) -> None:
    """From a point to a line of 2,000 km across its way north: what it has grown until then counts, early and late."""
    rings = [[(-size, 0.0), (size, 0.0), (size, 1.0), (-size, 1.0)] for size in (1.0, 1e6)]
    track = scenes.track("T", [(0, 55), (0, 75)], [0, 36000], 1.0, 1.0, 1.0, 1.0)
    track = replace(track, outline_m=rings[0], outlines_m=rings)
    _, one = legs_as_shapes(Scene("s", earth=earth), track)
    seconds = 36000.0 * np.linspace(*part, 401)
    at = one.take(np.zeros(401, np.int64)).positions(seconds).transpose(2, 1, 0)
    second = (at[2:] - 2 * at[1:-1] + at[:-2]) / (seconds[1] - seconds[0]) ** 2
    bounds = one.bounds(seconds[:1], seconds[-1:])
    rounding = 8.0 * ROUNDING_M / (seconds[1] - seconds[0]) ** 2
    assert np.hypot(*np.moveaxis(second, -1, 0)).max() <= bounds.acceleration[0] + rounding
    reference = one.take(np.zeros(401, np.int64)).reference(seconds).T
    aside = second - ((reference[2:] - 2 * reference[1:-1] + reference[:-2]) / (seconds[1] - seconds[0]) ** 2)[:, None]
    assert np.hypot(*np.moveaxis(aside, -1, 0)).max() <= bounds.variation[0] + rounding


def test_ways_over_the_pole_are_distorted_as_at_the_pole() -> None:
    """On the sphere: a way of 45 degrees from 80 degrees of latitude may pass the pole, where tanh(psi) is 1."""
    figure = earth_of(EarthModel.SPHERE)
    scale, way = 1.0 / np.cos(np.radians(80.0)), np.radians(45.0)
    rate = kernel_planes.drift(Mercator(figure), way * figure.radius_m, scale, 1.0)
    assert rate == pytest.approx(way * scale, rel=1e-12)
