"""Random scenes, seeded, at low latitudes and where it is harder.

`low latitude` lies between latitudes 0 and 30. Its areas have 3 to 10 vertices, 50 to 100 nmi around, its tracks 50 to
100 nmi, and its havens are 20 to 40 nmi around. Every scene is thrown into a small window of that region, so that a few
dozen objects meet often. Objects of Bienkowski, Sidoti and Pattipati (2021) are larger: benchmarks/made_scenes.py has
these.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import shapely
from scenes import T0_US

from conflictdb.model.plans import Area, EarthModel, Motion, Scene, Track, rectangle_outline_m

NMI: Final = 1852.0
METRES_PER_DEGREE: Final = 60 * NMI  # near enough to lay out a scene


@dataclass(frozen=True)
class Workload:
    """Parameters of random scenes. Lengths are in nautical miles, latitudes and longitudes in degrees, times in hours.

    window : side of the square (in latitude degrees) that a scene is thrown into
    radius_area : of each vertex of a convex area, in place of `around_area`
    side_haven : of each side of a rectangular haven, in place of `around_haven`
    """

    name: str
    latitudes: tuple[float, float]
    longitudes: tuple[float, float]
    window: float
    leg: tuple[float, float]
    around_area: tuple[float, float] = (50.0, 100.0)
    around_haven: tuple[float, float] = (20.0, 40.0)
    radius_area: tuple[float, float] | None = None
    side_haven: tuple[float, float] | None = None
    legs: tuple[int, int] = (1, 4)
    speed_kn: tuple[float, float] = (5.0, 25.0)
    start_h: tuple[float, float] = (0.0, 6.0)
    odd_share: float = 0.3  # of areas that are not convex, have a hole or several parts, and of havens not rectangles
    highest: float = 88.0
    motion: Motion = Motion.RHUMB
    changing_share: float = 0.0  # of havens that grow, or change from waypoint to waypoint


LOW_LATITUDE: Final = Workload("low latitude", (0.0, 30.0), (-45.0, -15.0), 2.5, (50.0, 100.0))
HIGH_LATITUDE: Final = Workload("high latitude", (60.0, 78.0), (-180.0, 180.0), 3.0, (50.0, 200.0), highest=82.0)
SOUTH: Final = Workload("high southern latitude", (-78.0, -60.0), (-180.0, 180.0), 3.0, (50.0, 200.0), highest=82.0)
LONG_LEGS: Final = Workload(
    "long legs", (-55.0, 55.0), (-180.0, 180.0), 12.0, (400.0, 1000.0), (200.0, 400.0), highest=80.0
)
SEAM: Final = Workload("seam", (-30.0, 30.0), (179.0, 181.0), 3.0, (50.0, 150.0))
EQUATOR: Final = Workload("equator", (-1.0, 1.0), (-10.0, 10.0), 2.5, (50.0, 150.0))
HARBOUR: Final = Workload(
    "harbour", (-60.0, 70.0), (-180.0, 180.0), 0.015, (0.2, 1.5), (0.1, 0.8), (0.02, 0.2), start_h=(0.0, 0.1)
)
OCEAN: Final = Workload(
    "great circles",
    (-70.0, 70.0),
    (-180.0, 180.0),
    9.0,
    (300.0, 900.0),
    (200.0, 600.0),
    highest=85.0,
    motion=Motion.GREAT_CIRCLE,
)
ARCTIC: Final = Workload(
    "arctic circles", (76.0, 84.0), (-180.0, 180.0), 4.0, (50.0, 400.0), highest=87.0, motion=Motion.GREAT_CIRCLE
)
GROWING: Final = replace(
    HIGH_LATITUDE, name="growing", latitudes=(-70.0, 70.0), around_haven=(5.0, 30.0), changing_share=0.8
)
GROWING_CIRCLES: Final = replace(OCEAN, name="growing circles", around_haven=(5.0, 200.0), changing_share=0.8)
WORKLOADS: Final = (
    LOW_LATITUDE,
    HIGH_LATITUDE,
    SOUTH,
    LONG_LEGS,
    SEAM,
    EQUATOR,
    HARBOUR,
    OCEAN,
    ARCTIC,
    GROWING,
    GROWING_CIRCLES,
)


def throw(
    workload: Workload,
    seed: int,
    areas: int,
    tracks: int,
    earth: EarthModel = EarthModel.WGS84,
    tolerance_m: float = 1.0,
    separation_m: float = 0.0,
) -> tuple[Scene, list[Area], list[Track]]:
    """A random scene of some areas and tracks; the same for the same arguments. Great circles are on the sphere."""
    earth = EarthModel.SPHERE if workload.motion is Motion.GREAT_CIRCLE else earth
    rng = np.random.default_rng([seed, areas, tracks])
    lat = rng.uniform(*workload.latitudes)
    lon = rng.uniform(*workload.longitudes)
    name = f"{workload.name} {seed}"
    centre = ((lon + 180.0) % 360.0 - 180.0, lat) if workload.motion is Motion.GREAT_CIRCLE else None
    scene = Scene(name, workload.motion, earth, tolerance_m=tolerance_m, separation_m=separation_m, centre=centre)

    def somewhere() -> tuple[float, float]:
        half = workload.window / 2
        y = float(np.clip(lat + rng.uniform(-half, half), -workload.highest + 2, workload.highest - 2))
        return lon + float(rng.uniform(-half, half)) / np.cos(np.radians(y)), y

    return (
        scene,
        [_area(rng, workload, f"A{i}", *somewhere()) for i in range(areas)],
        [_track(rng, workload, f"T{i}", *somewhere()) for i in range(tracks)],
    )


def _ring(rng: np.random.Generator, count: int, around_m: float) -> np.ndarray:
    """Corners (count, 2), metres, of a convex polygon with this circumference, about its middle."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    while np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() > np.pi * 0.95:
        angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    xy = np.stack([np.cos(angle), rng.uniform(0.4, 1.0) * np.sin(angle)], axis=1)
    turn = rng.uniform(0, 2 * np.pi)
    xy = xy @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return xy * around_m / shapely.length(shapely.polygons(xy))


def convex_around(rng: np.random.Generator, radius: tuple[float, float]) -> np.ndarray:
    """Corners (3 to 10, 2) of the hull of points around the middle, each at a random bearing and distance."""
    count = int(rng.integers(3, 11))
    while True:
        angle = np.sort(rng.uniform(0, 2 * np.pi, count))
        if np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() < np.pi:
            break
    xy = rng.uniform(*radius, (count, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(shapely.get_coordinates(shapely.MultiPoint(xy).convex_hull)[:-1])


def _ground(lon: float, lat: float, xy_m: np.ndarray) -> np.ndarray:
    return np.stack(
        [lon + xy_m[:, 0] / METRES_PER_DEGREE / np.cos(np.radians(lat)), lat + xy_m[:, 1] / METRES_PER_DEGREE], axis=1
    )


def _wrapped(polygon: shapely.Polygon) -> shapely.MultiPolygon:
    """Unwrapped coordinates are valid, but not far outside one turn."""
    west = shapely.bounds(polygon)[0]
    turn = 360.0 * np.floor((west + 180.0) / 360.0)
    return shapely.MultiPolygon([shapely.transform(polygon, lambda xy: xy - np.array([turn, 0.0]))])


def _area(rng: np.random.Generator, workload: Workload, key: str, lon: float, lat: float) -> Area:
    if workload.radius_area:
        xy = convex_around(rng, workload.radius_area) * NMI
    else:
        xy = _ring(rng, int(rng.integers(3, 11)), rng.uniform(*workload.around_area) * NMI)
    holes = []
    kind = rng.choice(
        ["plain", "star", "hole"], p=[1 - workload.odd_share, workload.odd_share / 2, workload.odd_share / 2]
    )
    if kind == "star":
        # Every other corner drawn in: not convex, and never crossing itself.
        between = (xy + np.roll(xy, -1, axis=0)) / 2 * rng.uniform(0.3, 0.8, (len(xy), 1))
        xy = np.stack([xy, between], axis=1).reshape(-1, 2)
    elif kind == "hole":
        holes = [_ground(lon, lat, xy.mean(axis=0) + 0.6 * (xy - xy.mean(axis=0)))]
    polygon = shapely.Polygon(_ground(lon, lat, xy), holes)
    start, end = None, None
    if rng.random() < 0.5:
        start = T0_US + int(rng.uniform(0, 6) * 3.6e9)
        end = start + int(rng.uniform(0.5, 12) * 3.6e9)
    return Area(key, _wrapped(polygon), None, start, end)


def _track(rng: np.random.Generator, workload: Workload, key: str, lon: float, lat: float) -> Track:
    points, hours = [(lon, lat)], [rng.uniform(*workload.start_h)]
    bearing = rng.uniform(0, 360)
    for _ in range(int(rng.integers(*workload.legs))):
        bearing = rng.choice([bearing + rng.uniform(-120, 120), 90.0 * rng.integers(4)], p=[0.85, 0.15])
        nmi = rng.uniform(*workload.leg)
        x, y = points[-1]
        north = y + nmi / 60 * np.cos(np.radians(bearing))
        if abs(north) > workload.highest - 2:
            bearing, north = 180 - bearing, y - nmi / 60 * np.cos(np.radians(bearing))
        # An exact heading east or west needs equal latitudes, and an exact north equal longitudes.
        north = y if bearing in (90.0, 270.0) else north
        east = (
            0.0
            if bearing in (0.0, 180.0)
            else nmi / 60 * np.sin(np.radians(bearing)) / np.cos(np.radians((y + north) / 2))
        )
        points.append((x + east, north))
        hours.append(hours[-1] + nmi / rng.uniform(*workload.speed_kn))
        if rng.random() < 0.15:  # a loiter
            points.append(points[-1])
            hours.append(hours[-1] + rng.uniform(0.1, 2.0))
    lonlat = np.array(points)
    lonlat[:, 0] = (lonlat[:, 0] + 180.0) % 360.0 - 180.0
    for i in np.flatnonzero(np.diff(np.array(points)[:, 0]) == 0.0):
        lonlat[i + 1, 0] = lonlat[i, 0]
    around = rng.uniform(*workload.around_haven) * NMI
    if workload.side_haven:
        length, width = rng.uniform(*workload.side_haven, 2) * NMI
        fore, port = length * rng.uniform(0.1, 0.9), width * rng.uniform(0.1, 0.9)
        outline = rectangle_outline_m(fore, length - fore, port, width - port)
    elif rng.random() < workload.odd_share:
        outline = _ring(rng, int(rng.integers(3, 8)), around)[:: int(rng.choice([1, -1]))]
    else:
        length = rng.uniform(0.25, 0.45) * around
        fore, port = length * rng.uniform(0.1, 0.9), (around / 2 - length) * rng.uniform(0.1, 0.9)
        outline = rectangle_outline_m(fore, length - fore, port, around / 2 - length - port)
    times_us = T0_US + (np.array(hours) * 3.6e9).astype(np.int64)
    if workload.changing_share and rng.random() < workload.changing_share:
        return changing(rng, Track(key, lonlat, times_us, outline))
    return Track(key, lonlat, times_us, outline)


def changing(rng: np.random.Generator, track: Track) -> Track:
    """The track with a haven that grows at a speed, also from a point or a line, or changes at every waypoint."""
    size = np.hypot(*track.outline_m.T).max()
    if rng.random() < 0.5:
        lasts_s = (track.times_us[-1] - track.times_us[0]) / 1e6
        outline = [track.outline_m, track.outline_m, np.zeros((1, 2)), track.outline_m[:2]][int(rng.integers(4))]
        sharp = _sharpest_deg(outline) < 5.0
        return replace(
            track,
            outline_m=np.zeros((1, 2)) if sharp else outline,
            grow_mps=float(rng.uniform(0.2, 1.0) * size / lasts_s),
        )
    outlines = []
    for _ in track.times_us:
        # Turned by less than a right angle between any two, so that it stays convex on the way.
        turn, scale = rng.uniform(-0.7, 0.7), rng.uniform(0.4, 1.6, (1, 2))
        rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        outlines.append(track.outline_m * scale @ rotation)
    return replace(track, outline_m=outlines[0], outlines_m=np.array(outlines))


def _sharpest_deg(outline: np.ndarray) -> float:
    """The smallest angle between neighbouring sides, degrees; 180 for points and lines."""
    if len(outline) < 3:
        return 180.0
    edge = np.roll(outline, -1, axis=0) - outline
    before = -np.roll(edge, 1, axis=0)
    cosine = (edge * before).sum(axis=1) / np.hypot(*edge.T) / np.hypot(*before.T)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).min())
