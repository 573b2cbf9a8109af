"""Great circles against 50 digits, and distances in their plane."""

from dataclasses import dataclass, replace

import mpmath
import numpy as np
import pytest
import scenes
from kernel_planes import distance_m
from mpmath import mp, mpf

from conflictdb import kernel
from conflictdb.arrays.objects import TrackBatch
from conflictdb.core.pieces.cutting import track_pieces
from conflictdb.earth.geodesy import MEAN_RADIUS_M as RADIUS_M
from conflictdb.earth.gnomonic import Gnomonic
from conflictdb.earth.registry import Setup
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import Motion, Scene

CLOSE_M = 1e-8
LEG_S = 1000.0
# Placeholders: places and outlines are replaced.
LEG = scenes.track("T", [(0, 0), (0, 0)], [0, LEG_S], 1.0, 1.0, 1.0, 1.0)
Place = tuple[float, float]


def haven(plane: Gnomonic, start: Place, end: Place, outline_m: np.ndarray, origin: np.ndarray) -> Movement:
    """A haven on a leg of `LEG_S`; it heads north where it does not move."""
    leg = track_pieces(Setup.of(Scene("s", Motion.GREAT_CIRCLE)), TrackBatch.of([LEG]))
    there = {"leg_start_deg": np.array([start]), "leg_end_deg": np.array([end]), "bearing_deg": np.zeros(1)}
    pieces = replace(
        leg, **there, shape_xy=outline_m, shape_to_xy=outline_m, shape_offset=np.array([0, len(outline_m)])
    )
    return Movement.of(kernel.KernelScene(plane.kernel_plane, pieces), np.zeros(1, np.int64), LEG.times_us[:1], origin)


@dataclass(frozen=True)
class Case:
    """One leg with a haven of four vertices; all that a comparison needs."""

    centre: tuple[float, float]
    start: tuple[float, float]
    end: tuple[float, float]
    outline_m: np.ndarray
    origin: np.ndarray

    @property
    def plane(self) -> Gnomonic:
        return Gnomonic(*self.centre)

    @property
    def haven(self) -> Movement:
        return haven(self.plane, self.start, self.end, self.outline_m[:, :, 0].T, self.origin)


def away(rng: np.random.Generator, place: tuple[float, float], degrees: float) -> tuple[float, float]:
    """A place some degrees from another, in any direction."""
    d, b = np.radians(degrees), rng.uniform(0, 2 * np.pi)
    lon, lat = np.radians(place)
    lat2 = np.arcsin(np.clip(np.sin(lat) * np.cos(d) + np.cos(lat) * np.sin(d) * np.cos(b), -1, 1))
    lon2 = lon + np.arctan2(np.sin(b) * np.sin(d) * np.cos(lat), np.cos(d) - np.sin(lat) * np.sin(lat2))
    return float(np.degrees(lon2)), float(np.degrees(lat2))


def cases(count: int, seed: int) -> list[Case]:
    """Legs of 1 m to 50 degrees, havens of 1 m to 300 km, up to 50 degrees from centres anywhere."""
    rng = np.random.default_rng(seed)
    found: list[Case] = []
    while len(found) < count:
        centre = (float(rng.uniform(-180, 180)), float(rng.choice([rng.uniform(-90, 90), 90.0, -90.0, 0.0])))
        start = away(rng, centre, 50 * np.sqrt(rng.random()))
        end = away(rng, start, 10 ** rng.uniform(-5, np.log10(50)))
        plane = Gnomonic(*centre)
        x, y = plane.to_plane(*end)
        if not np.hypot(x, y) < RADIUS_M * np.tan(np.radians(55)):
            continue
        outline = rng.uniform(-1, 1, (2, 4, 1)) * 10 ** rng.uniform(0, 5.5)
        origin = np.array(plane.to_plane(*start)).reshape(2, 1) * rng.integers(2)
        found.append(Case(centre, start, end, outline, origin))
    return found


def unit(lon: float, lat: float) -> mpmath.matrix:
    lon, lat = mpmath.radians(mpf(lon)), mpmath.radians(mpf(lat))
    return mpmath.matrix([mpmath.cos(lat) * mpmath.cos(lon), mpmath.cos(lat) * mpmath.sin(lon), mpmath.sin(lat)])


def dot(a: mpmath.matrix, b: mpmath.matrix) -> mpf:
    return mpmath.fsum(x * y for x, y in zip(a, b, strict=True))


def cross(a: mpmath.matrix, b: mpmath.matrix) -> mpmath.matrix:
    return mpmath.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def precise_vertex(case: Case, fraction: float, vertex: int) -> tuple[mpf, mpf]:
    """A vertex in the plane, metres from its own zero, in 50 digits."""
    a, b = unit(*case.start), unit(*case.end)
    pole = cross(a, b)
    heading = cross(pole, a) / mpmath.norm(pole)
    starboard = cross(heading, a)
    across, ahead = (mpf(float(size)) / mpf(RADIUS_M) for size in case.outline_m[:, vertex, 0])
    angle = mpmath.atan2(mpmath.norm(pole), dot(a, b)) * mpf(fraction) + ahead
    place = mpmath.cos(across) * (mpmath.cos(angle) * a + mpmath.sin(angle) * heading) + mpmath.sin(across) * starboard
    up, lon = unit(*case.centre), mpmath.radians(mpf(case.centre[0]))
    east = mpmath.matrix([-mpmath.sin(lon), mpmath.cos(lon), 0])
    height = dot(up, place)
    return mpf(RADIUS_M) * dot(east, place) / height, mpf(RADIUS_M) * dot(cross(up, east), place) / height


def test_vertices_agree_with_fifty_digits() -> None:
    with mp.workdps(50):
        for case in cases(60, 1):
            for fraction in (0.0, 0.375, 1.0):
                found = case.haven.positions(np.array([fraction * LEG_S]))
                for vertex in range(4):
                    for axis, true in enumerate(precise_vertex(case, fraction, vertex)):
                        error = true - mpf(float(case.origin[axis, 0])) - mpf(float(found[axis, vertex, 0]))
                        assert abs(error) < CLOSE_M, case


def test_plane_and_back() -> None:
    rng = np.random.default_rng(2)
    for centre in ((0.0, 0.0), (179.9, -33.0), (10.0, 90.0), (-60.0, -90.0)):
        plane = Gnomonic(*centre)
        places = np.array([away(rng, centre, degrees) for degrees in rng.uniform(0, 60, 200)])
        lon, lat = plane.from_plane(*plane.to_plane(places[:, 0], places[:, 1]))
        turn = (lon - places[:, 0] + 180.0) % 360.0 - 180.0
        assert np.abs(turn * np.cos(np.radians(lat))).max() < 3e-14 * 60
        assert np.abs(lat - places[:, 1]).max() < 3e-14 * 60
    assert np.isnan(Gnomonic(0.0, 0.0).to_plane(90.1, 0.0)).all()


def test_the_antimeridian_is_one_line_however_it_is_written() -> None:
    plane = Gnomonic(171.3, 40.1)
    lat = np.linspace(-40, 89, 50)
    ways = [np.stack(plane.to_plane(np.full(50, lon), lat)) for lon in (180.0, -180.0, -540.0)]
    assert np.array_equal(ways[0], ways[1])
    assert np.array_equal(ways[0], ways[2])
    assert np.array_equal(*(np.stack(plane.to_plane(lon, 90.0)) for lon in (-180.0, 55.0)))


def test_a_leg_that_does_not_move_keeps_the_heading_it_is_given() -> None:
    plane = Gnomonic(5.0, 50.0)
    still = haven(plane, (7.0, 52.0), (367.0, 52.0), np.array([[0.0, 1000.0]]), np.zeros((2, 1)))
    lon, lat = plane.from_plane(*still.positions(np.array([0.5])))
    assert lon[0, 0] == pytest.approx(7.0, abs=1e-12)
    assert (lat[0, 0] - 52.0) * np.radians(1) * RADIUS_M == pytest.approx(1000.0, abs=1e-7)
    np.testing.assert_array_equal(still.positions(np.array([LEG_S])), still.positions(np.zeros(1)))
    bounds = still.bounds(np.zeros(1), np.ones(1))
    assert not bounds.velocity.any()
    assert not bounds.acceleration.any()


def _arc(a: np.ndarray, b: np.ndarray, count: int) -> np.ndarray:
    """Unit vectors along the great circle between two."""
    w = np.linspace(0.0, 1.0, count)[:, None]
    chord = a * (1 - w) + b * w
    return chord / np.linalg.norm(chord, axis=1, keepdims=True)


def _in_space(xy: np.ndarray) -> np.ndarray:
    v = np.append(xy / RADIUS_M, np.ones((1, *xy.shape[1:])), axis=0)
    return np.moveaxis(v / np.linalg.norm(v, axis=0), 0, -1)


@pytest.mark.parametrize("gap_m", [1e-3, 1.0, 1e3, 1e5, 5e6])
@pytest.mark.parametrize("size_m", [1.0, 1e4, 1e6])
def test_distance_is_the_shortest_way_on_the_sphere(gap_m: float, size_m: float) -> None:
    """Against polygons sampled densely: never overstated, and understated by next to nothing."""
    rng = np.random.default_rng(5)
    for _ in range(12):
        turn = rng.uniform(0, 2 * np.pi, (2, 5))
        ring = np.stack([np.cos(np.sort(turn)), np.sin(np.sort(turn))])  # (2, 2, 5)
        middle = rng.uniform(-6e6, 6e6, 2) * rng.integers(2)
        a = middle[:, None] + size_m * ring[:, 0]
        b = middle[:, None] + size_m * ring[:, 1] + np.array([[2.2 * size_m + gap_m], [0.0]])
        found = distance_m(Gnomonic(0.0, 0.0), a, b)
        sampled = np.inf
        for one, other in ((a, b), (b, a)):
            edges = [_arc(*_in_space(one[:, [i, (i + 1) % 5]]), 4001) for i in range(5)]
            corners = _in_space(other)
            for edge in edges:
                chord = np.linalg.norm(edge[:, None] - corners[None], axis=-1).min()
                sampled = min(sampled, 2 * RADIUS_M * np.arcsin(chord / 2))
        assert found <= sampled + 1e-8
        assert found >= sampled - 1e-3 * min(1.0, size_m / 1e5) - 3e-9 - 1e-7 * sampled


def test_distance_between_points_is_known() -> None:
    plane = Gnomonic(0.0, 0.0)
    east, west = np.array(plane.to_plane(50.0, 0.0)), np.array(plane.to_plane(-50.0, 0.0))
    found = distance_m(plane, east.reshape(2, 1), west.reshape(2, 1))
    assert found == pytest.approx(np.radians(100.0) * RADIUS_M, abs=1e-7)
    edge = np.stack([plane.to_plane(np.array([-20.0, 40.0]), np.array([0.0, 0.0]))]).reshape(2, 2)
    off = np.array(plane.to_plane(7.0, 3.0)).reshape(2, 1)
    assert distance_m(plane, off, edge) == pytest.approx(np.radians(3.0) * RADIUS_M, abs=1e-7)


@pytest.mark.parametrize("away_deg", [0.5, 20.0, 70.0])
@pytest.mark.parametrize("count", [40, 150])
def test_distance_of_large_polygons_is_the_least_of_their_parts(away_deg: float, count: int) -> None:
    """Most vertices and sides of them are not looked at one by one."""
    rng, plane = np.random.default_rng(count), Gnomonic(5.0, 40.0)
    angle = 2 * np.pi * np.arange(count) / count
    size = RADIUS_M * np.radians(0.4 * away_deg)
    a = size * np.stack([np.cos(angle), 0.5 * np.sin(angle)])
    b = size * np.stack([0.3 * np.cos(angle), np.sin(angle)]) + RADIUS_M * np.tan(
        np.radians([[away_deg], [0.3 * away_deg]])
    )
    a, b = np.roll(a, rng.integers(count), axis=1), np.roll(b, rng.integers(count), axis=1)
    parts = [
        distance_m(plane, one[:, [i]], other[:, [k - 1, k]])
        for one, other in ((a, b), (b, a))
        for i in range(count)
        for k in range(count)
    ]
    assert min(parts) > 1000.0
    assert distance_m(plane, a, b) == pytest.approx(min(parts), abs=CLOSE_M)
