"""Where, when and how large the objects of random scenes are; `mixed_scenes` adds their features.

    Hubs           a few kilometres, where about a third of the pairs meets at a few places and times
    a Workload     a window of a region, for ordinary objects of its sizes and speeds: WORKLOADS
    odd_values.Anywhere   any valid places, times and sizes

`low latitude` lies between latitudes 0 and 30. Its areas have 3 to 10 vertices, 50 to 100 nmi around, its tracks 50 to
100 nmi, and its havens are 20 to 40 nmi around. Every scene lies in a small window of that region, so that a few dozen
objects meet often. Objects of Bienkowski, Sidoti and Pattipati (2021) are larger: benchmarks/made_scenes.py has these.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scene_features import DAY_US, Feature
from scenes import T0_US

from conflictdb.model.plans import EarthModel, Motion, Track, rectangle_outline_m

Floats = NDArray[np.float64]
Span = tuple[int | None, int | None]

NMI: Final = 1852.0
METRES_PER_DEGREE: Final = 60 * NMI  # near enough to lay out a scene
MINUTE_US: Final = 60_000_000
FAR_DAYS: Final = 400


class Voyage(NamedTuple):
    """Waypoints (n, 2) degrees, their times (n,), and the least and the greatest speed of a leg, metres per second."""

    lonlat: Floats
    times_us: NDArray[np.int64]
    speeds_mps: tuple[float, float]


class Layout:
    """Draws the places, times and shapes of one scene, object by object.

    t0_us : about when the scene begins
    far_us : how much later, or earlier, times are that lie beyond the expanded window of schedules
    grid_us : a step of time, of which objects last some
    scale : how large objects are; those of hubs are of scale 1
    lacks : features that such a scene cannot have
    is_bare : whether objects have keys alone
    track_fields : what all its tracks have
    """

    t0_us: int
    far_us: int
    grid_us: int
    scale: float = 1.0
    lacks: Collection[Feature] = ()
    is_bare: bool = False
    track_fields: Mapping[str, Any] = MappingProxyType({})

    def settings(self) -> dict[str, Any]:
        """Return settings of the scene."""
        raise NotImplementedError

    def counts(self) -> tuple[int, int]:
        """Return how many areas and tracks the scene has if nothing else is asked for."""
        raise NotImplementedError

    def footprint(self) -> tuple[shapely.MultiPolygon, int]:
        """Return the shape of the next area, and a time at which tracks may pass it."""
        raise NotImplementedError

    def span(self, at_us: int, is_bounded: bool) -> Span:
        """Return the period of the area."""
        raise NotImplementedError

    def session(self, start_us: int, end_us: int) -> tuple[int, int]:
        """Return the period that a schedule has in place of this one."""
        return start_us, end_us

    def legs(self, *, is_last: bool = False) -> int:
        """Begin the next track, and return how many legs it has."""
        raise NotImplementedError

    def turning(self, legs: int) -> int:
        """Give the track a turn if it can have one, and return how many legs it has."""
        return max(legs, 2)

    def voyage(self, legs: int, shift_us: int, may_stand: bool) -> Voyage:
        """Return the voyage of the track; later by a shift."""
        raise NotImplementedError

    def haven(self, times_us: NDArray[np.int64]) -> dict[str, Any]:
        """Return the haven of the track as fields."""
        raise NotImplementedError


def day_us(rng: np.random.Generator, seed: int) -> int:
    """Return a day at 8 o'clock, in 2001 for odd seeds and in 2090 for even ones."""
    day = datetime(2001 if seed % 2 else 2090, 6, 1, 8, tzinfo=UTC) + timedelta(days=int(rng.integers(60)))
    return int(day.timestamp()) * 1_000_000


def far_us(seed: int) -> int:
    """Return how far from the day of a seed its far times are: before 2001 or after 2090."""
    return (-FAR_DAYS if seed % 2 else FAR_DAYS) * DAY_US


class Hubs(Layout):
    """Objects that pass a few hubs: a hub is a place, metres east and north of the centre, and a time."""

    METRES_PER_DEGREE: Final = 111_195.0
    grid_us = 10 * MINUTE_US

    def __init__(self, rng: np.random.Generator, seed: int, features: Collection[Feature]) -> None:
        self.rng = rng
        self.t0_us, self.far_us = day_us(rng, seed), far_us(seed)
        self.lat = float(rng.choice([-1, 1]) * (rng.uniform(79.0, 84.0) if Feature.HIGH_LATITUDE in features else 1.0))
        if Feature.HIGH_LATITUDE not in features:
            self.lat = float(rng.uniform(-60.0, 60.0))
        self.lon = float(rng.uniform(-170.0, 170.0))
        if Feature.ANTIMERIDIAN in features:
            self.lon = float(rng.choice([-1, 1]) * (180.0 - rng.uniform(0.0, 0.01)))
        count = int(rng.integers(1, 4))
        self.hubs = [
            (rng.uniform(-5000.0, 5000.0, 2), self.t0_us + self.grid_us * int(rng.integers(1, 8))) for _ in range(count)
        ]
        self.features = features
        self.seed = seed

    def settings(self) -> dict[str, Any]:
        found: dict[str, Any] = {
            "name": f"mixed {self.seed}",
            "tolerance_m": float(self.rng.choice([0.0, 0.5, 1.0, 20.0])),
            "horizon_days": 3.0,
        }
        if Feature.GREAT_CIRCLE in self.features and self.rng.random() < 0.7:
            found["centre"] = (self.lon, self.lat)
        return found

    def counts(self) -> tuple[int, int]:
        n = int(self.rng.integers(3, 11))
        areas = int(self.rng.integers(1, n))
        return areas, n - areas + 1

    def hub(self) -> tuple[Floats, int]:
        return self.hubs[int(self.rng.integers(len(self.hubs)))]

    def ground(self, xy_m: Floats, is_wrapped: bool = True) -> Floats:
        """Return longitude and latitude (n, 2) of metres east and north of the centre."""
        lat = self.lat + xy_m[:, 1] / self.METRES_PER_DEGREE
        lon = self.lon + xy_m[:, 0] / self.METRES_PER_DEGREE / np.cos(np.radians(lat))
        return np.stack([(lon + 180.0) % 360.0 - 180.0 if is_wrapped else lon, lat], axis=1)

    def footprint(self) -> tuple[shapely.MultiPolygon, int]:
        rng = self.rng
        place, at_us = self.hub()
        n = int(rng.integers(3, 8))
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi / n, n) + 2.0 * np.pi * np.arange(n) / n)
        radius = float(rng.choice([500.0, 1500.0, 4000.0])) * rng.uniform(0.7, 1.2)
        xy = place + rng.normal(0.0, 800.0, 2) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        shapes = [shapely.Polygon(self.ground(xy, False))]
        kind = rng.random()
        if kind < 0.1:
            hole = xy.mean(axis=0) + 0.5 * (xy - xy.mean(axis=0))
            shapes = [shapely.Polygon(self.ground(xy, False), [self.ground(hole, False)])]
        elif kind < 0.2:
            shapes.append(shapely.Polygon(self.ground(xy + np.array([3.0 * radius, 500.0]), False)))
        return _wrapped(shapes), at_us

    def span(self, at_us: int, is_bounded: bool) -> Span:
        start_us = at_us - self.grid_us * int(self.rng.integers(0, 3))
        return start_us, start_us + self.grid_us * int(self.rng.integers(1, 4))

    def legs(self, *, is_last: bool = False) -> int:
        return 2 if is_last else int(self.rng.integers(1, 4))

    def voyage(self, legs: int, shift_us: int, may_stand: bool) -> Voyage:
        """Pass a hub at its time, or somewhat beside it or earlier or later."""
        rng = self.rng
        place, at_us = self.hub()
        at_us += shift_us
        passing = place + rng.normal(0.0, 600.0, 2)
        speed, bearing = rng.uniform(4.0, 15.0), rng.uniform(0.0, 2.0 * np.pi)
        before_us = MINUTE_US * int(rng.choice([5, 10, 20]))
        xy = [passing - speed * before_us / 1e6 * _direction(bearing)]
        times = [at_us - before_us]
        for leg in range(legs):
            lasts_us = MINUTE_US * int(rng.choice([5, 10, 15])) + (before_us if leg == 0 else 0)
            stands = leg > 0 and rng.random() < 0.15 and may_stand
            xy.append(xy[-1] + (0.0 if stands else speed * lasts_us / 1e6) * _direction(bearing))
            times.append(times[-1] + lasts_us)
            bearing += rng.uniform(-1.5, 1.5)
        lonlat = self.ground(np.array(xy))
        for i in np.flatnonzero((np.diff(np.array(xy), axis=0) == 0.0).all(axis=1)).tolist():
            lonlat[i + 1] = lonlat[i]
        return Voyage(lonlat, np.array(times, np.int64), (speed, speed))

    def haven(self, times_us: NDArray[np.int64]) -> dict[str, Any]:
        size = float(self.rng.choice([60.0, 300.0, 900.0]))
        kind = self.rng.random()
        if kind < 0.1:
            outline = np.zeros((1, 2))
        elif kind < 0.3:
            outline = size * np.array([[0.0, 1.0], [0.6, -0.5], [-0.6, -0.5]])
        else:
            outline = rectangle_outline_m(size, 0.6 * size, 0.3 * size, 0.4 * size)
        return {"outline_m": outline}


@dataclass(frozen=True)
class Workload:
    """Parameters of random scenes. Lengths are in nautical miles, latitudes and longitudes in degrees, times in hours.

    window : side of the square (in latitude degrees) in which a scene lies
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


class Spread(Layout):
    """Objects of a workload, in a window of its region. The window and the objects have random numbers of their own."""

    lacks = frozenset({Feature.ANTIMERIDIAN, Feature.HIGH_LATITUDE})

    def __init__(self, workload: Workload, seed: int, counts: tuple[int, int], features: Collection[Feature]) -> None:
        self.workload, self.seed, self.is_bare = workload, seed, not features
        self.rng = np.random.default_rng([seed, *counts])
        lat = self.rng.uniform(*workload.latitudes)
        self.lon, self.lat = self.rng.uniform(*workload.longitudes), lat
        # Schedules are expanded from today: with features, scenes play when hubs do.
        self.t0_us, self.far_us = T0_US if self.is_bare else day_us(np.random.default_rng(seed), seed), far_us(seed)
        lasts_h = sum(workload.leg) / sum(workload.speed_kn)
        self.grid_us = MINUTE_US * max(1, round(lasts_h * 60.0 / 5.0))
        self.scale = min(sum(workload.around_area) * NMI / 25_000.0, 20.0)

    def settings(self) -> dict[str, Any]:
        name, motion = f"{self.workload.name} {self.seed}", self.workload.motion
        found = {"name": name, "motion": motion, "tolerance_m": 1.0}
        if motion is Motion.GREAT_CIRCLE:
            found |= {"earth": EarthModel.SPHERE, "centre": ((self.lon + 180.0) % 360.0 - 180.0, self.lat)}
        return found

    def counts(self) -> tuple[int, int]:
        some = self.rng.integers(1, 7, 2).tolist()
        return some[0], some[1] + 1

    def somewhere(self) -> tuple[float, float]:
        half, highest = self.workload.window / 2, self.workload.highest - 2
        y = float(np.clip(self.lat + self.rng.uniform(-half, half), -highest, highest))
        return self.lon + float(self.rng.uniform(-half, half)) / np.cos(np.radians(y)), y

    def footprint(self) -> tuple[shapely.MultiPolygon, int]:
        rng, workload = self.rng, self.workload
        lon, lat = self.somewhere()
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
        return _wrapped([shapely.Polygon(_ground(lon, lat, xy), holes)]), self.t0_us + 12 * self.grid_us

    def span(self, at_us: int, is_bounded: bool) -> Span:
        if self.rng.random() < 0.5 or is_bounded:
            start_us = self.t0_us + int(self.rng.uniform(0, 6) * 3.6e9)
            return start_us, start_us + int(self.rng.uniform(0.5, 12) * 3.6e9)
        return None, None

    def legs(self, *, is_last: bool = False) -> int:
        self._voyage = self._sailed()
        return len(self._voyage.times_us) - 1

    def turning(self, legs: int) -> int:
        while legs < 2 and self.workload.legs[1] > 2:
            legs = self.legs()
        return legs

    def voyage(self, legs: int, shift_us: int, may_stand: bool) -> Voyage:
        assert legs == len(self._voyage.times_us) - 1
        return self._voyage._replace(times_us=self._voyage.times_us + shift_us)

    def _sailed(self) -> Voyage:
        rng, workload = self.rng, self.workload
        points, hours, speeds = [self.somewhere()], [rng.uniform(*workload.start_h)], []
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
            speeds.append(rng.uniform(*workload.speed_kn))
            hours.append(hours[-1] + nmi / speeds[-1])
            if rng.random() < 0.15:  # a loiter
                points.append(points[-1])
                hours.append(hours[-1] + rng.uniform(0.1, 2.0))
        lonlat = np.array(points)
        lonlat[:, 0] = (lonlat[:, 0] + 180.0) % 360.0 - 180.0
        for i in np.flatnonzero(np.diff(np.array(points)[:, 0]) == 0.0):
            lonlat[i + 1, 0] = lonlat[i, 0]
        times_us = self.t0_us + (np.array(hours) * 3.6e9).astype(np.int64)
        return Voyage(lonlat, times_us, (min(speeds) * NMI / 3600.0, max(speeds) * NMI / 3600.0))

    def haven(self, times_us: NDArray[np.int64]) -> dict[str, Any]:
        outline = self._outline()
        if self.workload.changing_share and self.rng.random() < self.workload.changing_share:
            return changing_haven(self.rng, outline, times_us)
        return {"outline_m": outline}

    def _outline(self) -> Floats:
        rng, workload = self.rng, self.workload
        around = rng.uniform(*workload.around_haven) * NMI
        if workload.side_haven:
            length, width = rng.uniform(*workload.side_haven, 2) * NMI
            fore, port = length * rng.uniform(0.1, 0.9), width * rng.uniform(0.1, 0.9)
            return rectangle_outline_m(fore, length - fore, port, width - port)
        if rng.random() < workload.odd_share:
            return _ring(rng, int(rng.integers(3, 8)), around)[:: int(rng.choice([1, -1]))]
        length = rng.uniform(0.25, 0.45) * around
        fore, port = length * rng.uniform(0.1, 0.9), (around / 2 - length) * rng.uniform(0.1, 0.9)
        return rectangle_outline_m(fore, length - fore, port, around / 2 - length - port)


def _ring(rng: np.random.Generator, count: int, around_m: float) -> Floats:
    """Corners (count, 2), metres, of a convex polygon with this circumference, about its middle."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    while np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() > np.pi * 0.95:
        angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    xy = np.stack([np.cos(angle), rng.uniform(0.4, 1.0) * np.sin(angle)], axis=1)
    turn = rng.uniform(0, 2 * np.pi)
    xy = xy @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return xy * around_m / shapely.length(shapely.polygons(xy))


def convex_around(rng: np.random.Generator, radius: tuple[float, float]) -> Floats:
    """Corners (3 to 10, 2) of the hull of points around the middle, each at a random bearing and distance."""
    count = int(rng.integers(3, 11))
    while True:
        angle = np.sort(rng.uniform(0, 2 * np.pi, count))
        if np.diff(np.append(angle, angle[0] + 2 * np.pi)).max() < np.pi:
            break
    xy = rng.uniform(*radius, (count, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(shapely.get_coordinates(shapely.MultiPoint(xy).convex_hull)[:-1])


def _ground(lon: float, lat: float, xy_m: Floats) -> Floats:
    return np.stack(
        [lon + xy_m[:, 0] / METRES_PER_DEGREE / np.cos(np.radians(lat)), lat + xy_m[:, 1] / METRES_PER_DEGREE], axis=1
    )


def _wrapped(polygons: list[shapely.Polygon]) -> shapely.MultiPolygon:
    """Unwrapped coordinates are valid, but not far outside one turn."""
    west = min(polygon.bounds[0] for polygon in polygons)
    turn = 360.0 * np.floor((west + 180.0) / 360.0)
    return shapely.transform(shapely.MultiPolygon(polygons), lambda xy: xy - np.array([turn, 0.0]))


def changing_haven(rng: np.random.Generator, outline: Floats, times_us: NDArray[np.int64]) -> dict[str, Any]:
    """The fields of a haven that grows at a speed, also from a point or a line, or changes at every waypoint."""
    size = np.hypot(*outline.T).max()
    if rng.random() < 0.5:
        lasts_s = (times_us[-1] - times_us[0]) / 1e6
        outline = [outline, outline, np.zeros((1, 2)), outline[:2]][int(rng.integers(4))]
        sharp = sharpest_deg(outline) < 5.0
        return {
            "outline_m": np.zeros((1, 2)) if sharp else outline,
            "grow_mps": float(rng.uniform(0.2, 1.0) * size / lasts_s),
        }
    outlines = []
    for _ in times_us:
        # Turned by less than a right angle between any two, so that it stays convex on the way.
        turn, scale = rng.uniform(-0.7, 0.7), rng.uniform(0.4, 1.6, (1, 2))
        rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        outlines.append(outline * scale @ rotation)
    return {"outline_m": outlines[0], "outlines_m": np.array(outlines)}


def changing(rng: np.random.Generator, track: Track) -> Track:
    """The track with a haven that changes."""
    return replace(track, **changing_haven(rng, track.outline_m, track.times_us))


def sharpest_deg(outline: Floats) -> float:
    """The smallest angle between neighbouring sides, degrees; 180 for points and lines."""
    if len(outline) < 3:
        return 180.0
    edge = np.roll(outline, -1, axis=0) - outline
    before = -np.roll(edge, 1, axis=0)
    cosine = (edge * before).sum(axis=1) / np.hypot(*edge.T) / np.hypot(*before.T)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).min())


def _direction(bearing: float) -> Floats:
    return np.array([np.sin(bearing), np.cos(bearing)])
