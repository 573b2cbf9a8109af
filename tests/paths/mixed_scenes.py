"""Random scenes of 3 to 12 objects that mix the features of plans, by seed.

    mixed = mixed_scene(7)                              # features drawn by the seed, FEATURES[7 % n] among them
    mixed = mixed_scene(7, {Feature.SCHEDULE_OF_AREA})  # these features, and those that they need
    mixed.scene, mixed.areas, mixed.tracks              # the arguments of `solve`
    mixed.features                                      # the features that the scene has, by `features_of`
    mixed.plan                                          # the object that questions are about
    mixed.others                                        # areas and tracks without it

`features_of(scene, areas, tracks)` reads the features from any scene. The same seed and features give the same scene.

Objects are aimed at a few hubs, places with a time, so that about a third of the pairs meets. Times lie on a grid of
ten minutes, so that many spans share ends. Scenes play in 2001 or in 2090. Schedules are expanded from today and over
all voyages: the expanded window ends with the last voyage of 2090 and begins with the first one of 2001. Answers do
not depend on the clock until then. With Feature.FAR, schedules have a second session 400 days after the last voyage of
2090, or before the first one of 2001, and the plan departs there. A schedule may have no activation in the window:
`solve` issues an IncompleteWarning then.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model.inputs import certain
from conflictdb.model.plans import Area, EarthModel, Intervals, Motion, Scene, Track, rectangle_outline_m
from conflictdb.model.rule_table import RuleTable
from conflictdb.model.rules import Rule

Object = Area | Track

MINUTE_US: Final = 60_000_000
GRID_US: Final = 10 * MINUTE_US
DAY_US: Final = 86_400_000_000
FAR_DAYS: Final = 400
METRES_PER_DEGREE: Final = 111_195.0  # near enough to lay out a scene
CLASSES: Final = ("ferry", "drone", "range")


class Feature(StrEnum):
    """A property of objects or a setting that a scene may have."""

    UNBOUNDED = "unbounded areas"
    ACTIVATIONS = "several activations"
    SCHEDULE_OF_AREA = "schedules of areas"
    SCHEDULE_OF_TRACK = "schedules of tracks"
    FAR = "times beyond the expanded window"
    DEPARTURES = "departures"
    ZERO = "zero durations"
    DEPARTURE_WINDOW = "departure windows"
    ARRIVAL_WINDOW = "arrival windows"
    SPEED_WINDOW = "speed windows"
    CROSS_TRACK = "cross-track limits"
    TURN_RADIUS = "turn radii"
    HEIGHTS = "heights"
    LEG_HEIGHTS = "heights of legs"
    CLIMBS = "climbs"
    GROWTH = "growth"
    OUTLINES = "outlines that change"
    CLASSES = "separation by class"
    ALLOWED = "allowed pairs"
    CLASS_VERTICAL = "vertical separation by class"
    CLASS_TIME = "separation in time by class"
    OWNERS = "owners"
    SEPARATION = "separation"
    VERTICAL_SEPARATION = "vertical separation"
    TIME_SEPARATION = "separation in time"
    CLOSED = "closed intervals"
    NEAREST = "closest approaches"
    GREAT_CIRCLE = "great circles"
    SPHERE = "sphere"
    ANTIMERIDIAN = "antimeridian"
    HIGH_LATITUDE = "high latitude"


FEATURES: Final = tuple(Feature)
_TOLERANCES: Final = {
    Feature.DEPARTURE_WINDOW,
    Feature.ARRIVAL_WINDOW,
    Feature.SPEED_WINDOW,
    Feature.CROSS_TRACK,
    Feature.TURN_RADIUS,
}
_BANDS: Final = (Feature.HEIGHTS, Feature.LEG_HEIGHTS, Feature.CLIMBS)
_NEEDS: Final = {
    Feature.VERTICAL_SEPARATION: Feature.HEIGHTS,
    Feature.CLASS_VERTICAL: Feature.HEIGHTS,
    Feature.LEG_HEIGHTS: Feature.HEIGHTS,
    Feature.CLIMBS: Feature.HEIGHTS,
    Feature.FAR: Feature.SCHEDULE_OF_AREA,
    Feature.GREAT_CIRCLE: Feature.SPHERE,
}


@dataclass(frozen=True)
class Mixed:
    """A scene with its features; `plan` is one of its objects, which questions are about."""

    seed: int
    scene: Scene
    areas: list[Area]
    tracks: list[Track]
    plan_key: str
    features: frozenset[Feature]

    @property
    def objects(self) -> list[Object]:
        """Areas, then tracks."""
        return [*self.areas, *self.tracks]

    @property
    def plan(self) -> Object:
        """The object that questions are about."""
        return next(one for one in self.objects if one.key == self.plan_key)

    @property
    def others(self) -> tuple[list[Area], list[Track]]:
        """Areas and tracks without the plan."""
        return (
            [area for area in self.areas if area.key != self.plan_key],
            [track for track in self.tracks if track.key != self.plan_key],
        )


def features_of(scene: Scene, areas: Iterable[Area], tracks: Iterable[Track]) -> frozenset[Feature]:
    """Return the features that a scene and its objects have; FAR: a track departs a hundred days from another one."""
    areas, tracks = list(areas), list(tracks)
    both: list[Object] = [*areas, *tracks]
    members = [track.tolerances for track in tracks if track.tolerances]
    classed = {one.object_class for one in both if one.object_class is not None}
    rules = [rule for rule in scene.rules if classed & {rule.a_class, rule.b_class}]
    departs = [int(track.times_us[0]) for track in tracks if track.schedule is None]
    per_leg = [track for track in tracks if track.floors_m is not None or track.ceilings_m is not None]
    points = [shapely.get_coordinates(area.footprint) for area in areas] + [track.positions_deg for track in tracks]
    everywhere = np.concatenate([np.zeros((0, 2)), *points])
    found = {
        Feature.UNBOUNDED: any(
            area.schedule is None and not area.spans_us and None in (area.start_us, area.end_us) for area in areas
        ),
        Feature.ACTIVATIONS: any(area.spans_us is not None and area.schedule is None for area in areas),
        Feature.SCHEDULE_OF_AREA: any(area.schedule is not None for area in areas),
        Feature.SCHEDULE_OF_TRACK: any(track.schedule is not None for track in tracks),
        Feature.FAR: bool(departs) and max(departs) - min(departs) > 100 * DAY_US,
        Feature.DEPARTURES: any(track.departures_us is not None and track.schedule is None for track in tracks),
        Feature.ZERO: any(_is_short(one) for one in both),
        Feature.DEPARTURE_WINDOW: any("departure_window" in given for given in members),
        Feature.ARRIVAL_WINDOW: any("arrival_window" in given for given in members),
        Feature.SPEED_WINDOW: any("min_speed_kn" in given or "max_speed_kn" in given for given in members),
        Feature.CROSS_TRACK: any("xtd_port_m" in given or "xtd_starboard_m" in given for given in members),
        Feature.TURN_RADIUS: any("turn_radius_m" in given for given in members),
        Feature.HEIGHTS: any(one.floor_m is not None or one.ceiling_m is not None for one in both),
        Feature.LEG_HEIGHTS: any(_heights(track) == len(track.times_us) - 1 for track in per_leg),
        Feature.CLIMBS: any(_heights(track) == len(track.times_us) for track in per_leg),
        Feature.GROWTH: any(track.grow_mps > 0.0 for track in tracks),
        Feature.OUTLINES: any(track.outlines_m is not None for track in tracks),
        Feature.CLASSES: any(rule.separation_m is not None for rule in rules),
        Feature.ALLOWED: any(rule.allowed for rule in rules),
        Feature.CLASS_VERTICAL: any(rule.vertical_m is not None for rule in rules),
        Feature.CLASS_TIME: any(rule.time_s is not None for rule in rules),
        Feature.OWNERS: any(one.owner is not None for one in both),
        Feature.SEPARATION: scene.separation_m > 0.0,
        Feature.VERTICAL_SEPARATION: scene.vertical_separation_m > 0.0,
        Feature.TIME_SEPARATION: scene.time_separation_s > 0.0,
        Feature.CLOSED: scene.intervals is Intervals.CLOSED,
        Feature.NEAREST: scene.nearest_m > 0.0,
        Feature.GREAT_CIRCLE: scene.motion is Motion.GREAT_CIRCLE,
        Feature.SPHERE: scene.earth is EarthModel.SPHERE,
        Feature.ANTIMERIDIAN: bool((np.abs(everywhere[:, 0]) > 179.0).any()),
        Feature.HIGH_LATITUDE: bool((np.abs(everywhere[:, 1]) > 75.0).any()),
    }
    return frozenset(feature for feature, is_there in found.items() if is_there)


def mixed_scene(seed: int, features: Collection[Feature] | None = None) -> Mixed:
    """Return the scene of a seed; the features may be given."""
    rng = np.random.default_rng([seed, 42])
    wanted = _drawn(rng, seed) if features is None else set(features)
    for _ in range(2):
        wanted |= {_NEEDS[feature] for feature in wanted if feature in _NEEDS}
    return _Maker(rng, seed, frozenset(wanted)).made()


def _drawn(rng: np.random.Generator, seed: int) -> set[Feature]:
    """Return the feature of a seed's number, and up to five others."""
    some = rng.choice(len(FEATURES), int(rng.integers(0, 6)), replace=False)
    return {FEATURES[seed % len(FEATURES)], *(FEATURES[i] for i in some.tolist())}


class _Maker:
    """Makes one scene. A hub is a place, metres east and north of the centre, and a time."""

    def __init__(self, rng: np.random.Generator, seed: int, features: frozenset[Feature]) -> None:
        self.rng, self.seed, self.features = rng, seed, features
        year = 2001 if seed % 2 else 2090
        day = datetime(year, 6, 1, 8, tzinfo=UTC) + timedelta(days=int(rng.integers(60)))
        self.t0_us = _us(day)
        self.far_us = (-FAR_DAYS if seed % 2 else FAR_DAYS) * DAY_US
        self.lat = float(rng.choice([-1, 1]) * (rng.uniform(79.0, 84.0) if Feature.HIGH_LATITUDE in features else 1.0))
        if Feature.HIGH_LATITUDE not in features:
            self.lat = float(rng.uniform(-60.0, 60.0))
        self.lon = float(rng.uniform(-170.0, 170.0))
        if Feature.ANTIMERIDIAN in features:
            self.lon = float(rng.choice([-1, 1]) * (180.0 - rng.uniform(0.0, 0.01)))
        count = int(rng.integers(1, 4))
        self.hubs = [
            (rng.uniform(-5000.0, 5000.0, 2), self.t0_us + GRID_US * int(rng.integers(1, 8))) for _ in range(count)
        ]

    def has(self, feature: Feature, share: float = 0.6) -> bool:
        """Return whether an object gets a feature of the scene."""
        return feature in self.features and self.rng.random() < share

    def made(self) -> Mixed:
        scene = self.settings()
        n = int(self.rng.integers(3, 11))
        areas_n = int(self.rng.integers(1, n))
        areas = [self.area(f"A{i}", i == 0) for i in range(areas_n)]
        tracks = [self.track(f"T{i}", i == 0) for i in range(n - areas_n)]
        far = Feature.FAR in self.features
        # The last track departs when planned: it keeps the expanded window where the first session is.
        tracks.append(self.voyage(f"T{len(tracks)}", {}, 0, 2))
        plan = self.pick(areas, tracks)
        if far:
            tracks.append(self.track("P", True, self.far_us))
            plan = "P"
        return Mixed(self.seed, scene, areas, tracks, plan, features_of(scene, areas, tracks))

    def pick(self, areas: list[Area], tracks: list[Track]) -> str:
        some = tracks if self.rng.random() < 0.7 else [*areas, *tracks]
        return some[int(self.rng.integers(len(some)))].key

    def settings(self) -> Scene:
        rng, has = self.rng, self.features.__contains__
        settings: dict[str, Any] = {"tolerance_m": float(rng.choice([0.0, 0.5, 1.0, 20.0])), "horizon_days": 3.0}
        if has(Feature.GREAT_CIRCLE):
            settings["motion"] = Motion.GREAT_CIRCLE
            if rng.random() < 0.7:
                settings["centre"] = (self.lon, self.lat)
        elif has(Feature.SPHERE):
            settings["earth"] = EarthModel.SPHERE
        if has(Feature.SEPARATION):
            settings["separation_m"] = float(rng.choice([100.0, 926.0, 2500.5]))
        if has(Feature.VERTICAL_SEPARATION):
            settings["vertical_separation_m"] = float(rng.choice([30.0, 100.0, 120.5]))
        if has(Feature.TIME_SEPARATION):
            settings["time_separation_s"] = float(rng.choice([60.0, 600.0, 1500.25]))
        if has(Feature.NEAREST):
            settings["nearest_m"] = float(rng.choice([500.0, 4000.0]))
        if has(Feature.CLOSED):
            settings["intervals"] = Intervals.CLOSED
        return Scene(f"mixed {self.seed}", rules=self.rules(), **settings)

    def rules(self) -> list[Rule]:
        """Return rules for pairs of classes, a class and a kind, and a class and any; no pair is ambiguous."""
        rng, found = self.rng, list[Rule]()
        sides = [(a, b) for i, a in enumerate(CLASSES) for b in (*CLASSES[i:], "track", None)]
        amounts: dict[Feature, tuple[str, list[float]]] = {
            Feature.CLASSES: ("separation_m", [0.0, 500.0, 2000.0]),
            Feature.CLASS_VERTICAL: ("vertical_m", [0.0, 50.0, 150.0]),
            Feature.CLASS_TIME: ("time_s", [0.0, 300.0, 1200.0]),
        }
        for n in rng.permutation(len(sides)).tolist():
            values: dict[str, Any] = {
                name: float(rng.choice(some))
                for feature, (name, some) in amounts.items()
                if feature in self.features and (rng.random() < 0.7 or not found)
            }
            if Feature.ALLOWED in self.features and (rng.random() < 0.3 or not values):
                values = {"allowed": True}
            if not values or (len(found) > 1 and rng.random() < 0.5):
                continue
            try:
                rule = Rule(*sides[n], **values)
                RuleTable.of([*found, rule])
            except InvalidInput:
                continue
            found.append(rule)
        return found

    def shared(self, i: str) -> dict[str, Any]:
        """Return what areas and tracks have alike."""
        rng, fields = self.rng, dict[str, Any]()
        if self.features & {Feature.CLASSES, Feature.ALLOWED, Feature.CLASS_VERTICAL, Feature.CLASS_TIME}:
            fields["object_class"] = (None, *CLASSES, *CLASSES)[int(rng.integers(7))]
        if Feature.OWNERS in self.features:
            fields["owner"] = (None, "one", "one", "other")[int(rng.integers(4))]
        if rng.random() < 0.3:
            fields["name"] = f"name of {i}"
        if rng.random() < 0.2:
            fields["properties"] = {"note": f"of {i}", "number": 7}
        return fields

    def hub(self) -> tuple[NDArray[np.float64], int]:
        return self.hubs[int(self.rng.integers(len(self.hubs)))]

    def ground(self, xy_m: NDArray[np.float64], is_wrapped: bool = True) -> NDArray[np.float64]:
        """Return longitude and latitude (n, 2) of metres east and north of the centre."""
        lat = self.lat + xy_m[:, 1] / METRES_PER_DEGREE
        lon = self.lon + xy_m[:, 0] / METRES_PER_DEGREE / np.cos(np.radians(lat))
        return np.stack([(lon + 180.0) % 360.0 - 180.0 if is_wrapped else lon, lat], axis=1)

    def band(self) -> tuple[float | None, float | None]:
        """Return floor and ceiling on a grid of 100 m, so that many bands touch; sometimes one is open."""
        floor = 100.0 * int(self.rng.integers(0, 4))
        ceiling = floor + 100.0 * int(self.rng.integers(1, 3))
        k = int(self.rng.integers(8))
        return (None if k == 0 else floor), (None if k == 1 else ceiling)

    def area(self, key: str, is_first: bool) -> Area:
        rng, share = self.rng, 1.0 if is_first else 0.5
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
        fields = self.shared(key)
        if self.has(Feature.HEIGHTS, share):
            fields["floor_m"], fields["ceiling_m"] = self.band()
        west = min(shape.bounds[0] for shape in shapes)
        turn = 360.0 * np.floor((west + 180.0) / 360.0)
        footprint = shapely.transform(shapely.MultiPolygon(shapes), lambda lonlat: lonlat - np.array([turn, 0.0]))
        return Area(key, footprint, **fields, **self.times_of_area(at_us, share))

    def times_of_area(self, at_us: int, share: float) -> dict[str, Any]:
        rng = self.rng
        start_us = at_us - GRID_US * int(rng.integers(0, 3))
        end_us = start_us + GRID_US * int(rng.integers(1, 4))
        if self.has(Feature.SCHEDULE_OF_AREA, share):
            fields: dict[str, Any] = {"schedule": self.schedule(start_us, end_us)}
            if rng.random() < 0.2:
                fields["end_us"] = certain(self.t0_us + 3 * abs(self.far_us))
            return fields
        if self.has(Feature.ACTIVATIONS, share):
            later_us = end_us + GRID_US * int(rng.integers(1, 3))
            spans = [(start_us, end_us), (later_us, later_us + GRID_US)]
            if rng.random() < 0.3:
                spans.append((later_us + 3 * GRID_US, None))
            return {"spans_us": [[certain(a), None if b is None else certain(b)] for a, b in spans]}
        if self.has(Feature.ZERO, share):
            return {"start_us": certain(at_us), "end_us": certain(at_us + 1)}
        if self.has(Feature.UNBOUNDED, share):
            ends = [(None, None), (start_us, None), (None, end_us)][int(rng.integers(3))]
            return {"start_us": certain(ends[0]), "end_us": certain(ends[1])}
        return {"start_us": certain(start_us), "end_us": certain(end_us)}

    def schedule(self, start_us: int, end_us: int) -> Any:
        """Return a schedule with a span on its day, and on the day of the far session or on the days around it."""
        kind, days = int(self.rng.integers(3)), [0]
        if Feature.FAR in self.features:
            days.append(self.far_us // DAY_US)
        elif self.rng.random() < 0.5:
            days = [-1, 0, 1]
        days = sorted(days)
        starts = [_moment(start_us + day * DAY_US) for day in days]
        lasts_us = end_us - start_us
        if kind == 0:
            every = f"FREQ=DAILY;INTERVAL={int(days[-1] - days[0]) // max(len(days) - 1, 1) or 1};COUNT={len(days)}"
            rule = f"DTSTART:{starts[0]:%Y%m%dT%H%M%SZ}\nRRULE:{every}"
            return {"rrule": rule, "duration": f"PT{lasts_us // MINUTE_US}M"}
        zone = ZoneInfo("Europe/Zurich" if self.rng.random() < 0.3 else "UTC")
        ends = [start + timedelta(microseconds=lasts_us) for start in starts]
        periods = [[f"{starts[0].astimezone(zone):%H:%M}", f"{ends[0].astimezone(zone):%H:%M}"]]
        dates = [f"{start.astimezone(zone):%Y-%m-%d}" for start in starts]
        if kind == 1:
            return {"periods": periods, "dates": dates, "timezone": zone.key}
        return [{"periods": periods, "from": date, "until": date, "timezone": zone.key} for date in dates]

    def track(self, key: str, is_first: bool, shift_us: int = 0) -> Track:
        """Return a track with features of the scene; shifted ones have no schedule and no departures."""
        rng, share = self.rng, 1.0 if is_first else 0.5
        fields = self.shared(key)
        recurs = None
        if not shift_us:
            if self.has(Feature.SCHEDULE_OF_TRACK, share):
                recurs = Feature.SCHEDULE_OF_TRACK
            elif self.has(Feature.DEPARTURES, share):
                recurs = Feature.DEPARTURES
        legs = int(rng.integers(1, 4))
        tolerant = recurs is None and bool(self.features & _TOLERANCES) and rng.random() < share + 0.2
        if tolerant and Feature.TURN_RADIUS in self.features:
            legs = max(legs, 2)
        if Feature.HEIGHTS in self.features and rng.random() < share + 0.3:
            fields |= self.heights_of_track(legs, share)
        return self.voyage(key, fields, shift_us, legs, recurs, tolerant, share)

    def heights_of_track(self, legs: int, share: float) -> dict[str, Any]:
        for feature, n in ((Feature.CLIMBS, legs + 1), (Feature.LEG_HEIGHTS, legs)):
            if self.has(feature, share):
                bands = [self.band() for _ in range(n)]
                return {
                    "floors_m": [-np.inf if floor is None else floor for floor, _ in bands],
                    "ceilings_m": [np.inf if ceiling is None else ceiling for _, ceiling in bands],
                }
        floor, ceiling = self.band()
        return {"floor_m": floor, "ceiling_m": ceiling}

    def voyage(
        self,
        key: str,
        fields: dict[str, Any],
        shift_us: int,
        legs: int,
        recurs: Feature | None = None,
        tolerant: bool = False,
        share: float = 0.0,
    ) -> Track:
        """Return a track that passes a hub at its time, or somewhat beside it or earlier or later."""
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
            stands = leg > 0 and rng.random() < 0.15 and not tolerant
            xy.append(xy[-1] + (0.0 if stands else speed * lasts_us / 1e6) * _direction(bearing))
            times.append(times[-1] + lasts_us)
            bearing += rng.uniform(-1.5, 1.5)
        lonlat = self.ground(np.array(xy))
        for i in np.flatnonzero((np.diff(np.array(xy), axis=0) == 0.0).all(axis=1)).tolist():
            lonlat[i + 1] = lonlat[i]
        fields = fields | self.haven(legs, tolerant, share, (times[-1] - times[0]) / 1e6)
        if tolerant:
            fields["tolerances"] = self.tolerances(legs, speed, times)
        lasts_us = times[-1] - times[0]
        if recurs is Feature.DEPARTURES:
            many = int(rng.integers(1, 4))
            first_us = times[0] + (-(lasts_us + GRID_US) if rng.random() < 0.3 else 0)
            fields["departures_us"] = [certain(first_us + i * (lasts_us + GRID_US)) for i in range(many)]
        elif recurs is Feature.SCHEDULE_OF_TRACK:
            fields["schedule"] = self.schedule(times[0], times[0] + MINUTE_US)
        return Track(key, lonlat, [certain(at) for at in times], **fields)

    def haven(self, legs: int, tolerant: bool, share: float, lasts_s: float) -> dict[str, Any]:
        rng = self.rng
        size = float(rng.choice([60.0, 300.0, 900.0]))
        kind = rng.random()
        if kind < 0.1:
            outline = np.zeros((1, 2))
        elif kind < 0.3:
            outline = size * np.array([[0.0, 1.0], [0.6, -0.5], [-0.6, -0.5]])
        else:
            outline = rectangle_outline_m(size, 0.6 * size, 0.3 * size, 0.4 * size)
        if not tolerant and self.has(Feature.OUTLINES, share):
            scales = rng.uniform(0.4, 1.6, (legs + 1, 1, 2))
            return {"outline_m": outline * scales[0], "outlines_m": outline * scales}
        if not tolerant and self.has(Feature.GROWTH, share):
            return {"outline_m": outline, "grow_mps": float(rng.uniform(50.0, 600.0) / lasts_s)}
        return {"outline_m": outline}

    def tolerances(self, legs: int, speed_mps: float, times: list[int]) -> dict[str, Any]:
        """Return members of tolerances; the windows of a scene with zero durations have one instant."""
        rng, found = self.rng, dict[str, Any]()
        per_leg = rng.random() < 0.5

        def numbers(low: float, high: float, n: int = legs) -> Any:
            values = [round(float(value), 3) for value in rng.uniform(low, high, n)]
            return values if per_leg else values[0]

        if Feature.CROSS_TRACK in self.features:
            found |= {"xtd_port_m": numbers(50.0, 800.0), "xtd_starboard_m": numbers(0.0, 800.0)}
        if Feature.SPEED_WINDOW in self.features:
            knots = speed_mps * 3600.0 / 1852.0
            found |= {"min_speed_kn": numbers(0.8 * knots, 0.95 * knots)}
            found |= {"max_speed_kn": numbers(1.05 * knots, 1.3 * knots)}
        if Feature.TURN_RADIUS in self.features and legs > 1:
            found["turn_radius_m"] = numbers(50.0, 400.0, legs - 1)
        wide = 0 if Feature.ZERO in self.features and rng.random() < 0.7 else GRID_US // 2
        for feature, name, at_us in (
            (Feature.DEPARTURE_WINDOW, "departure_window", times[0]),
            (Feature.ARRIVAL_WINDOW, "arrival_window", times[-1]),
        ):
            if feature in self.features:
                earlier_us, later_us = (rng.integers(0, 2, 2) * wide).tolist()
                found[name] = [f"{_moment(at):%Y-%m-%dT%H:%M:%SZ}" for at in (at_us - earlier_us, at_us + later_us)]
        return found


def _is_short(one: Object) -> bool:
    """Return whether a span of an object, or a window, lasts a microsecond at most."""
    if isinstance(one, Area):
        spans = one.spans_us if one.spans_us is not None else ((one.start_us, one.end_us),)
        return any(start is not None and end is not None and end - start <= 1 for start, end in spans)
    windows = [(one.tolerances or {}).get(name) for name in ("departure_window", "arrival_window")]
    return any(window is not None and window[0] == window[1] for window in windows)


def _heights(track: Track) -> int:
    return len(track.floors_m if track.floors_m is not None else track.ceilings_m)


def _direction(bearing: float) -> NDArray[np.float64]:
    return np.array([np.sin(bearing), np.cos(bearing)])


def _us(moment: datetime) -> int:
    return int(moment.timestamp()) * 1_000_000


def _moment(at_us: int) -> datetime:
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(at_us))
