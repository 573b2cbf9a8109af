"""Regions in longitude and latitude contain their rings of the plane, and reach little beyond them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from oracle_circle import space

from conflictdb import kernel
from conflictdb.arrays.polygons import SRID, Polygons
from conflictdb.arrays.ragged import offsets
from conflictdb.core.conflict_regions import in_degrees
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.kernel.regions import OutlineKind, outlines
from conflictdb.model.plans import EarthModel, Motion, Scene

Floats = NDArray[np.float64]
PLANES = {
    "wgs84": Scene("s"),
    "sphere": Scene("s", earth=EarthModel.SPHERE),
    "circles": Scene("s", motion=Motion.GREAT_CIRCLE, earth=EarthModel.SPHERE, centre=(12.0, 48.0)),
    "circles at the equator": Scene("s", motion=Motion.GREAT_CIRCLE, earth=EarthModel.SPHERE, centre=(179.0, 1.0)),
    "arctic circles": Scene("s", motion=Motion.GREAT_CIRCLE, earth=EarthModel.SPHERE, centre=(-30.0, 79.0)),
}


def plane_of(name: str) -> Plane:
    return Setup.of(PLANES[name]).plane


def somewhere(name: str, rng: np.random.Generator) -> tuple[float, float]:
    """Return a place in the plane, where outlines may be: to 85 degrees, on great circles near the centre."""
    plane = plane_of(name)
    if plane.turn_m:
        x, y = plane.to_plane(
            [rng.uniform(-150.0, 150.0)], [rng.choice([rng.uniform(-85.0, 85.0), rng.uniform(-1.0, 1.0)])]
        )
        return float(x[0]), float(y[0])
    reach_m = 1e6 if name == "arctic circles" else 4e6
    return float(rng.uniform(-reach_m, reach_m)), float(rng.uniform(-reach_m, reach_m))


def convex(rng: np.random.Generator, place: tuple[float, float], size_m: float) -> shapely.Polygon:
    """Return a convex polygon of the plane: round, thin, of few or many corners, also with sides along the axes."""
    corners = int(rng.integers(3, 12))
    shape = np.array([1.0, rng.choice([1.0, 0.1, 1e-4])])
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners))
    xy = np.stack([np.cos(angle), np.sin(angle)], axis=1) * size_m * shape
    if rng.random() < 0.3:
        xy = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * size_m * shape
    turn = rng.choice([0.0, np.pi / 2.0, rng.uniform(0.0, np.pi)])
    xy = xy @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return shapely.orient_polygons(shapely.convex_hull(shapely.multipoints(xy + place)))


def rings_of(polygons: list[shapely.Polygon]) -> tuple[Floats, NDArray[np.int64]]:
    xy = [np.asarray(one.exterior.coords) for one in polygons]
    return np.concatenate(xy), offsets([len(one) for one in xy])


@dataclass(frozen=True)
class Both:
    """Dense places of the sides of a polygon: in the plane, and in degrees about the middle of a region."""

    plane: Plane

    def degrees(self, xy: Floats, region: shapely.Geometry) -> Floats:
        lon, lat = self.plane.from_plane(*xy.T)
        west, _, east, _ = region.bounds
        lon = lon - 360.0 * np.round((lon.mean() - 0.5 * (west + east)) / 360.0)
        on_seam = np.abs(np.abs(lon) - 180.0) < 1e-9
        return np.stack([np.where(on_seam, np.copysign(180.0, lon), lon), lat], axis=1)

    def in_plane(self, lonlat: Floats, near: shapely.Geometry) -> Floats:
        x, y = self.plane.to_plane(*lonlat.T)
        if self.plane.turn_m:
            west, _, east, _ = near.bounds
            x = x - self.plane.turn_m * np.round((x - 0.5 * (west + east)) / self.plane.turn_m)
        return np.stack([x, y], axis=1)

    def lack(self, polygon: shapely.Geometry, region: shapely.Geometry) -> int:
        """Return the number of places of the polygon's sides that the region does not cover."""
        dense = shapely.segmentize(polygon, max(polygon.length / 700.0, 1e-3))
        shapely.prepare(region)
        places = self.degrees(shapely.get_coordinates(dense), region)
        return int(np.count_nonzero(~shapely.covers(region, shapely.points(places))))

    def beyond_m(self, polygon: shapely.Geometry, region: shapely.Geometry) -> float:
        """Return how far the region reaches beyond the polygon, metres on the earth."""
        dense = shapely.segmentize(region, max(region.length / 700.0, 1e-9))
        places = shapely.get_coordinates(dense)
        xy = self.in_plane(places, polygon)
        outside = np.flatnonzero(~shapely.intersects_xy(polygon, xy))
        if not len(outside):
            return 0.0
        if not self.plane.turn_m:
            return self._beyond_circles_m(polygon, places[outside])
        # Angles are true in this plane: what is nearest there is so on the earth.
        line = shapely.shortest_line(shapely.points(xy[outside]), polygon)
        lon, lat = self.plane.from_plane(*shapely.get_coordinates(line).T)
        lon, lat = np.radians(lon).reshape(-1, 2), np.radians(lat).reshape(-1, 2)
        way = np.hypot(np.cos(lat).min(axis=1) * np.diff(lon)[:, 0], np.diff(lat)[:, 0])
        return float(way.max() * self.plane.kernel_plane.radius_m)

    def _beyond_circles_m(self, polygon: shapely.Geometry, places: Floats) -> float:
        """Return the largest distance of places from the sides of a polygon, which are great circles."""
        way = np.full(len(places), np.inf)
        points = space(places).astype(np.float64)
        for ring in shapely.get_rings(shapely.get_parts(polygon)):
            corners = space(np.stack(self.plane.from_plane(*shapely.get_coordinates(ring).T), axis=1)).astype(
                np.float64
            )
            for start, end in pairwise(corners):
                normal = np.cross(start, end)
                normal /= np.linalg.norm(normal)
                along = [np.cross(normal, start) @ points.T, np.cross(end, normal) @ points.T]
                across = np.abs(points @ normal)
                ends = np.minimum(*(np.linalg.norm(points - one, axis=1) for one in (start, end)))
                is_beside = (along[0] > 0.0) & (along[1] > 0.0)
                way = np.minimum(way, np.where(is_beside, np.arcsin(across), 2.0 * np.arcsin(0.5 * ends)))
        return float(way.max() * self.plane.kernel_plane.radius_m)


@pytest.mark.parametrize("limit_m", [1.0, 300.0])
@pytest.mark.parametrize("name", PLANES)
@pytest.mark.parametrize("rings", [50, pytest.param(3000, marks=pytest.mark.slow)])
def test_outlines_contain_their_rings_and_reach_little_beyond_them(name: str, limit_m: float, rings: int) -> None:
    """Convex rings of a centimetre to 1,000 km, to 85 degrees of latitude: none of 700 places of each is outside."""
    rng, both = np.random.default_rng([len(name), int(limit_m), rings]), Both(plane_of(name))
    polygons = [convex(rng, somewhere(name, rng), 10.0 ** rng.uniform(-2.0, 6.0)) for _ in range(rings)]
    polygons = [one for one in polygons if one.geom_type == "Polygon"]
    ring, ring_offset = rings_of(polygons)
    inside = np.array([one.representative_point().coords[0] for one in polygons])
    place = np.stack(both.plane.from_plane(*inside.T), axis=1)
    place[:, 0] = np.remainder(place[:, 0] + 180.0, 360.0) - 180.0
    data, end, kind = outlines(
        both.plane.kernel_plane, ring, ring_offset, np.arange(len(polygons) + 1), limit_m, place_deg=place
    )
    regions, seen = Polygons(data, end).geometries(), 0
    for polygon, region, known in zip(polygons, regions, kind.tolist(), strict=True):
        if known == OutlineKind.UNKNOWN:
            west, south, east, north = polygon.bounds
            assert name == "arctic circles" or min(east - west, north - south) < 1e-4 or not both.plane.turn_m
            continue
        assert shapely.get_srid(region) == SRID
        if known in (OutlineKind.SOUND, OutlineKind.AWAY):
            assert region.is_valid
            seen += 1
        if known != OutlineKind.CROSSED:
            assert both.lack(polygon, region) == 0
            assert both.beyond_m(polygon, region) <= 1.001 * limit_m
    assert seen > (0.5 if name == "arctic circles" else 0.75) * len(polygons)


@pytest.mark.parametrize("name", ["wgs84", "circles"])
@pytest.mark.parametrize("unions", [60, pytest.param(2000, marks=pytest.mark.slow)])
def test_unions_of_rings_contain_all_of_them(name: str, unions: int) -> None:
    """Of rings that overlap, touch along sides, are apart, lie in each other, or leave a hole."""
    rng, both, sound = np.random.default_rng(3), Both(plane_of(name)), 0
    for _ in range(unions):
        place, size_m = somewhere(name, rng), 10.0 ** rng.uniform(1.0, 5.0)
        parts = [
            convex(rng, tuple(np.add(place, rng.uniform(-1.5, 1.5, 2) * size_m)), size_m)
            for _ in range(rng.integers(2, 7))
        ]
        if rng.random() < 0.4:  # neighbours, cut from one polygon
            whole = convex(rng, place, size_m)
            cuts = [shapely.box(x, -1e8, x + size_m / 2.0, 1e8) for x in place[0] + size_m * np.arange(-1.0, 1.0, 0.5)]
            parts = [part for cut in cuts for part in shapely.get_parts(whole.intersection(cut))]
        if rng.random() < 0.2:  # a frame
            angle = np.linspace(0.0, 2.0 * np.pi, 7)
            bar = shapely.box(-0.7, -0.2, 0.7, 0.2)
            parts = [
                shapely.affinity.translate(
                    shapely.affinity.scale(
                        shapely.affinity.rotate(bar, 90.0 + np.degrees(a)), size_m, size_m, origin=(0, 0)
                    ),
                    place[0] + size_m * np.cos(a),
                    place[1] + size_m * np.sin(a),
                )
                for a in angle[:-1]
            ]
        parts = [
            shapely.orient_polygons(one) for one in parts if one.geom_type == "Polygon" and one.area > 1e-4 * size_m**2
        ]
        if not parts:
            continue
        ring, ring_offset = rings_of(parts)
        data, end, kind = outlines(both.plane.kernel_plane, ring, ring_offset, np.array([0, len(parts)]), 1.0)
        if kind[0] not in (OutlineKind.SOUND, OutlineKind.AWAY):
            continue
        sound += 1
        (region,) = Polygons(data, end).geometries()
        assert region.is_valid, shapely.is_valid_reason(region)
        assert all(both.lack(part, region) == 0 for part in parts)
        assert both.beyond_m(shapely.union_all(parts, grid_size=1e-6), region) <= 1.001
    assert sound > 0.75 * unions


def test_polygons_with_holes_keep_them() -> None:
    """Holes shrink, and those narrower than the limit go: the region is then united from convex parts."""
    both = Both(plane_of("wgs84"))
    x, y = (float(one[0]) for one in both.plane.to_plane([5.0], [50.0]))
    shell = shapely.box(x - 5e4, y - 5e4, x + 5e4, y + 5e4)
    wide, narrow = shapely.box(x - 1e4, y - 1e4, x + 1e4, y + 1e4), shapely.box(x + 2e4, y, x + 2e4 + 0.5, y + 3e4)
    for holes in ([wide], [wide, narrow], [narrow]):
        polygon = shell.difference(shapely.union_all(holes))
        (region,) = in_degrees(both.plane, np.array([polygon]), 1.0)
        assert region.is_valid
        assert both.lack(polygon, region) == 0
        assert both.beyond_m(polygon, region) <= 1.001
        centre = shapely.Point(both.degrees(np.array([[x, y]]), region)[0])
        assert region.covers(centre) == (wide not in holes)


@pytest.mark.parametrize("lat", [0.0, 60.0])
def test_regions_at_the_seam_end_there(lat: float) -> None:
    """The kernel cuts rings at the antimeridian; a region has longitudes within 180 degrees and lacks nothing."""
    plane = plane_of("wgs84")
    half_m, (_, y) = 0.5 * plane.turn_m, plane.to_plane([0.0], [lat])
    east = shapely.box(half_m - 3e4, y[0], half_m, y[0] + 8e4)
    west = shapely.Polygon([(-half_m, y[0]), (-half_m + 5e4, y[0] + 1e4), (-half_m, y[0] + 8e4)])
    ring, ring_offset = rings_of([east, west])
    data, end, kind = outlines(plane.kernel_plane, ring, ring_offset, np.array([0, 2]), 1.0)
    assert kind.tolist() == [OutlineKind.SOUND]
    (region,) = Polygons(data, end).geometries()
    assert region.is_valid
    assert (region.bounds[0], region.bounds[2]) == (-180.0, 180.0)
    for part, ring_part in zip(sorted(region.geoms, key=lambda one: -one.bounds[0]), (east, west), strict=True):
        assert Both(plane).lack(ring_part, part) == 0


def test_a_ring_around_the_earth_has_a_bounded_number_of_corners() -> None:
    """A metre wide: with a corner every few kilometres, some of them are too much to be printed."""
    plane = plane_of("wgs84")
    corners = [(0.0, 0.0), (1.5e7, 5e6), (3e7, 1e7), (3e7, 1e7 + 1.0), (0.0, 1.0), (0.0, 0.0)]
    polygon = shapely.orient_polygons(shapely.Polygon(np.array(corners) - (1.5e7, 0.0)).convex_hull)
    ring, ring_offset = rings_of([polygon])
    data, end, kind = outlines(plane.kernel_plane, ring, ring_offset, np.arange(2), 0.01)
    assert kind[0] != OutlineKind.UNKNOWN
    (region,) = Polygons(data, end).geometries()
    assert 1_000 < shapely.get_num_coordinates(region) < 30_000


def test_outlines_refuse_what_is_no_region() -> None:
    """NaN and infinite corners, rings of two corners, and holes before their shell have no outline."""
    plane = plane_of("wgs84").kernel_plane
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]) * 1e3
    for ring in (
        square * np.nan,
        square + np.array([0.0, np.inf]),
        square + np.array([0.0, 1e9]),
        square[[0, 1, 0]],
        square[:0],
    ):
        _, end, kind = outlines(plane, ring, offsets([len(ring)]), np.arange(2), 1.0)
        assert (kind.tolist(), end.tolist()) == ([OutlineKind.UNKNOWN], [0, 0])
    _, _, kind = outlines(plane, square, offsets([5]), np.arange(2), 1.0, is_hole=np.array([True]))
    assert kind.tolist() == [OutlineKind.UNKNOWN]
    with pytest.raises(ValueError, match="separation or tolerance"):
        outlines(plane, square, offsets([5]), np.arange(2), np.nan)
    with pytest.raises(ValueError, match="plane is unknown"):
        outlines(kernel.KernelPlane(7, 0, 1.0), square, offsets([5]), np.arange(2), 1.0)
