"""Random scenes that mix the features of plans, by seed: the one generator of them.

    mixed = mixed_scene(7)                              # features drawn by the seed, FEATURES[7 % n] among them
    mixed = mixed_scene(7, {Feature.SCHEDULE_OF_AREA})  # these features, and those that they need
    mixed = mixed_scene(7, place=SEAM, areas=2)         # in a workload of `layouts`, with two areas
    mixed = mixed_scene(7, is_odd=True)                 # with odd keys, names, properties and heights
    mixed.scene, mixed.areas, mixed.tracks              # the arguments of `solve`
    mixed.features                                      # the features that the scene has, by `features_of`
    mixed.plan                                          # the object that questions are about
    mixed.others                                        # areas and tracks without it
    scene, areas, tracks = plain_scene(SEAM, 7, 20, 30) # of a workload, without features
    scene, areas, tracks = odd_scene(7)                 # anywhere, with odd values and features

The same arguments give the same scene. A layout draws places, times and shapes (`layouts`), and the maker adds
features to them.

Without a workload, objects are aimed at a few hubs, places with a time, so that about a third of the pairs meets. Times
lie on a grid of ten minutes, so that many spans share ends. Scenes with features play in 2001 or in 2090. Schedules are
expanded from today and over all voyages: the expanded window ends with the last voyage of 2090 and begins with the
first one of 2001. Answers do not depend on the clock until then. With Feature.FAR, schedules have a second session 400
days after the last voyage of 2090, or before the first one of 2001, and the plan departs there. A schedule may have no
activation in the window: `solve` issues an IncompleteWarning then.
"""

from collections.abc import Collection
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
import odd_values
from layouts import MINUTE_US, Hubs, Layout, Spread, Voyage, Workload, sharpest_deg
from odd_values import Anywhere, Scattered
from scene_features import DAY_US, FEATURES, NEEDS, TOLERANCES, Feature, Object, features_of

from conflictdb.errors import InvalidInput
from conflictdb.model.inputs import all_certain, certain
from conflictdb.model.plans import MAX_INSTANT_US, MIN_INSTANT_US, Area, EarthModel, Intervals, Motion, Scene, Track
from conflictdb.model.rule_table import RuleTable
from conflictdb.model.rules import Rule

CLASSES: Final = ("ferry", "drone", "range")
Content = tuple[Scene, list[Area], list[Track]]
_TIMES_OF_AREAS: Final = {Feature.SCHEDULE_OF_AREA, Feature.ACTIVATIONS, Feature.ZERO, Feature.UNBOUNDED}


@dataclass(frozen=True)
class Mixed:
    """A scene with its features; `plan` is one of its objects, which questions are about."""

    seed: int
    scene: Scene
    areas: list[Area]
    tracks: list[Track]
    plan_key: str

    @cached_property
    def features(self) -> frozenset[Feature]:
        """The features that the scene has."""
        return features_of(self.scene, self.areas, self.tracks)

    @property
    def content(self) -> Content:
        """The scene, its areas and its tracks."""
        return self.scene, self.areas, self.tracks

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


def mixed_scene(
    seed: int,
    features: Collection[Feature] | None = None,
    place: Workload | Anywhere | None = None,
    areas: int | None = None,
    tracks: int | None = None,
    *,
    is_odd: bool = False,
    **settings: Any,
) -> Mixed:
    """Return the scene of a seed.

    features : those that it has; None: drawn by the seed
    place : None: around hubs
    areas, tracks : how many; None: drawn by the seed
    is_odd : whether keys, names, classes, owners, properties and heights are odd
    settings : of the scene, in place of drawn ones
    """
    rng = np.random.default_rng([seed, 42])
    wanted = _drawn(rng, seed) if features is None else set(features)
    for _ in range(2):
        wanted |= {NEEDS[feature] for feature in wanted if feature in NEEDS}
    layout: Layout
    if isinstance(place, Workload):
        layout = Spread(place, seed, (areas or 0, tracks or 0), wanted)
    elif isinstance(place, Anywhere):
        layout = Scattered(place, seed, wanted)
    else:
        layout = Hubs(rng, seed, wanted)
    make = (_OddMaker if is_odd else _Maker)(rng, seed, frozenset(wanted - set(layout.lacks)), layout)
    return make.made(settings, areas, tracks)


def plain_scene(
    workload: Workload,
    seed: int,
    areas: int,
    tracks: int,
    earth: EarthModel = EarthModel.WGS84,
    tolerance_m: float = 1.0,
    separation_m: float = 0.0,
) -> Content:
    """Return a scene of a workload without features. Great circles are on the sphere."""
    earth = EarthModel.SPHERE if workload.motion is Motion.GREAT_CIRCLE else earth
    settings = {"earth": earth, "tolerance_m": tolerance_m, "separation_m": separation_m}
    return mixed_scene(seed, (), workload, areas, tracks, **settings).content


def odd_scene(seed: int, place: Anywhere | None = None) -> Content:
    """Return a scene of few objects with any valid values, anywhere."""
    return mixed_scene(seed, None, place or Anywhere(), is_odd=True).content


def _drawn(rng: np.random.Generator, seed: int) -> set[Feature]:
    """Return the feature of a seed's number, and up to five others."""
    some = rng.choice(len(FEATURES), int(rng.integers(0, 6)), replace=False)
    return {FEATURES[seed % len(FEATURES)], *(FEATURES[i] for i in some.tolist())}


class _Maker:
    """Makes one scene: gives features to what a layout draws."""

    is_odd = False

    def __init__(self, rng: np.random.Generator, seed: int, features: frozenset[Feature], layout: Layout) -> None:
        self.rng, self.seed, self.features, self.layout = rng, seed, features, layout
        self.is_timed = bool(_TIMES_OF_AREAS & features)
        self.classes: tuple[str, ...] = CLASSES

    def has(self, feature: Feature, share: float = 0.6) -> bool:
        """Return whether an object gets a feature of the scene."""
        return feature in self.features and self.rng.random() < share

    def made(self, settings: dict[str, Any], areas_n: int | None, tracks_n: int | None) -> Mixed:
        scene = self.scene(settings)
        if areas_n is None or tracks_n is None:
            drawn = self.layout.counts()
            areas_n, tracks_n = (drawn[i] if n is None else n for i, n in enumerate((areas_n, tracks_n)))
        areas = [self.area(self.key(f"A{i}"), i == 0) for i in range(areas_n)]
        tracks = [self.track(self.key(f"T{i}"), i == 0) for i in range(tracks_n - 1)]
        if tracks_n:
            tracks.append(self.last_track(self.key(f"T{tracks_n - 1}")))
        plan = self.pick(areas, tracks)
        if Feature.FAR in self.features:
            tracks.append(self.track(self.key("P"), True, self.layout.far_us))
            plan = tracks[-1].key
        return Mixed(self.seed, scene, areas, tracks, plan)

    def pick(self, areas: list[Area], tracks: list[Track]) -> str:
        some = tracks if tracks and self.rng.random() < 0.7 else [*areas, *tracks]
        return some[int(self.rng.integers(len(some)))].key if some else ""

    def scene(self, given: dict[str, Any]) -> Scene:
        rng, has = self.rng, self.features.__contains__
        settings = self.layout.settings()
        if has(Feature.GREAT_CIRCLE):
            settings |= {"motion": Motion.GREAT_CIRCLE, "earth": EarthModel.SPHERE}
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
        return Scene(rules=self.rules(), **{**settings, **given})

    def rules(self) -> list[Rule]:
        """Return rules for pairs of classes, a class and a kind, and a class and any; no pair is ambiguous."""
        rng, found = self.rng, list[Rule]()
        amounts: dict[Feature, tuple[str, list[float]]] = {
            Feature.CLASSES: ("separation_m", [0.0, 500.0, 2000.0]),
            Feature.CLASS_VERTICAL: ("vertical_m", [0.0, 50.0, 150.0]),
            Feature.CLASS_TIME: ("time_s", [0.0, 300.0, 1200.0]),
        }
        sides = [(a, b) for i, a in enumerate(self.classes) for b in (*self.classes[i:], "track", None)]
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

    def key(self, key: str) -> str:
        return key

    def named(self, key: str) -> dict[str, Any]:
        """Return what areas and tracks have alike."""
        rng, fields = self.rng, dict[str, Any]()
        if self.layout.is_bare:
            return fields
        if self.features & {Feature.CLASSES, Feature.ALLOWED, Feature.CLASS_VERTICAL, Feature.CLASS_TIME}:
            fields["object_class"] = (None, *self.classes, *self.classes)[int(rng.integers(7))]
        if Feature.OWNERS in self.features:
            fields["owner"] = (None, "one", "one", "other")[int(rng.integers(4))]
        if rng.random() < 0.3:
            fields["name"] = f"name of {key}"
        if rng.random() < 0.2:
            fields["properties"] = {"note": f"of {key}", "number": 7}
        return fields

    def band(self) -> tuple[float | None, float | None]:
        """Return floor and ceiling on a grid of 100 m, so that many bands touch; sometimes one is open."""
        floor = 100.0 * int(self.rng.integers(0, 4))
        ceiling = floor + 100.0 * int(self.rng.integers(1, 3))
        k = int(self.rng.integers(8))
        return (None if k == 0 else floor), (None if k == 1 else ceiling)

    def area(self, key: str, is_first: bool) -> Area:
        share = 1.0 if is_first else 0.5
        footprint, at_us = self.layout.footprint()
        fields = self.named(key)
        if self.has(Feature.HEIGHTS, share):
            fields["floor_m"], fields["ceiling_m"] = self.band()
        return Area(key, footprint, **fields, **self.times_of_area(at_us, share))

    def times_of_area(self, at_us: int, share: float) -> dict[str, Any]:
        rng, grid_us = self.rng, self.layout.grid_us
        start_us, end_us = self.layout.span(at_us, self.is_timed)
        if start_us is not None and end_us is not None:
            if self.has(Feature.SCHEDULE_OF_AREA, share):
                fields: dict[str, Any] = {"schedule": self.schedule(start_us, end_us)}
                if rng.random() < 0.2:
                    fields["end_us"] = certain(self.layout.t0_us + 3 * abs(self.layout.far_us))
                return fields
            if self.has(Feature.ACTIVATIONS, share):
                later_us = end_us + grid_us * int(rng.integers(1, 3))
                spans = [(start_us, end_us), (later_us, later_us + grid_us)]
                if rng.random() < 0.3:
                    spans.append((later_us + 3 * grid_us, None))
                return {"spans_us": [[certain(a), None if b is None else certain(b)] for a, b in spans]}
            if self.has(Feature.ZERO, share):
                return {"start_us": certain(at_us), "end_us": certain(at_us + 1)}
            if self.has(Feature.UNBOUNDED, share):
                start_us, end_us = [(None, None), (start_us, None), (None, end_us)][int(rng.integers(3))]
        return {"start_us": certain(start_us), "end_us": certain(end_us)}

    def schedule(self, start_us: int, end_us: int, lasts_us: int = 0) -> Any:
        """Return a schedule with a span on its day, and on the day of the far session or on the days around it.

        lasts_us : how long a voyage takes; one of more than a day departs on its day alone
        """
        kind, days = int(self.rng.integers(3)), [0]
        start_us, end_us = self.layout.session(start_us, end_us)
        if Feature.FAR in self.features:
            days.append(self.layout.far_us // DAY_US)
        elif self.rng.random() < 0.5:
            days = [-1, 0, 1] if lasts_us < DAY_US else [0]
        days = sorted(days)
        starts = [_moment(start_us + day * DAY_US) for day in days]
        open_us = end_us - start_us
        if kind == 0:
            every = f"FREQ=DAILY;INTERVAL={int(days[-1] - days[0]) // max(len(days) - 1, 1) or 1};COUNT={len(days)}"
            rule = f"DTSTART:{starts[0]:%Y%m%dT%H%M%SZ}\nRRULE:{every}"
            return {"rrule": rule, "duration": f"PT{open_us // MINUTE_US}M"}
        zone = ZoneInfo("Europe/Zurich" if self.rng.random() < 0.3 else "UTC")
        ends = [start + timedelta(microseconds=open_us) for start in starts]
        periods = [[f"{starts[0].astimezone(zone):%H:%M}", f"{ends[0].astimezone(zone):%H:%M}"]]
        dates = [f"{start.astimezone(zone):%Y-%m-%d}" for start in starts]
        if kind == 1:
            return {"periods": periods, "dates": dates, "timezone": zone.key}
        return [{"periods": periods, "from": date, "until": date, "timezone": zone.key} for date in dates]

    def track(self, key: str, is_first: bool, shift_us: int = 0) -> Track:
        """Return a track with features of the scene; shifted ones have no schedule and no departures."""
        rng, share = self.rng, 1.0 if is_first else 0.5
        fields = self.named(key)
        recurs = None
        if not shift_us:
            if self.has(Feature.SCHEDULE_OF_TRACK, share):
                recurs = Feature.SCHEDULE_OF_TRACK
            elif self.has(Feature.DEPARTURES, share):
                recurs = Feature.DEPARTURES
        legs = self.layout.legs()
        tolerant = recurs is None and bool(self.features & TOLERANCES) and rng.random() < share + 0.2
        if tolerant and Feature.TURN_RADIUS in self.features:
            legs = self.layout.turning(legs)
        if Feature.HEIGHTS in self.features and rng.random() < share + 0.3:
            fields |= self.heights_of_track(legs, share)
        return self.sailing(key, fields, legs, shift_us, recurs, tolerant, share)

    def last_track(self, key: str) -> Track:
        """Return a track that departs when planned: it keeps the expanded window where the first session is."""
        fields = self.named(key) if self.is_odd else {}
        return self.sailing(key, fields, self.layout.legs(is_last=True))

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

    def sailing(
        self,
        key: str,
        fields: dict[str, Any],
        legs: int,
        shift_us: int = 0,
        recurs: Feature | None = None,
        tolerant: bool = False,
        share: float = 0.0,
    ) -> Track:
        """Return a track with the voyage that the layout draws."""
        rng = self.rng
        voyage = self.layout.voyage(legs, shift_us, not tolerant)
        lasts_us, grid_us = int(voyage.times_us[-1] - voyage.times_us[0]), self.layout.grid_us
        first_us = int(voyage.times_us[0])
        fields = fields | self.haven(voyage, tolerant, share)
        if tolerant:
            fields["tolerances"] = self.tolerances(legs, voyage)
        if recurs is Feature.DEPARTURES:
            many = int(rng.integers(1, 4))
            first_us += -(lasts_us + grid_us) if rng.random() < 0.3 else 0
            departs = [first_us + i * (lasts_us + grid_us) for i in range(many)]
            valid = [certain(at) for at in departs if MIN_INSTANT_US <= at <= MAX_INSTANT_US - lasts_us]
            fields["departures_us"] = valid or None
        elif recurs is Feature.SCHEDULE_OF_TRACK:
            fields["schedule"] = self.schedule(first_us, first_us + MINUTE_US, lasts_us)
        return Track(key, voyage.lonlat, all_certain(voyage.times_us), **fields, **self.layout.track_fields)

    def haven(self, voyage: Voyage, tolerant: bool, share: float) -> dict[str, Any]:
        rng, legs = self.rng, len(voyage.times_us) - 1
        found = self.layout.haven(voyage.times_us)
        if tolerant:
            return {"outline_m": found["outline_m"]}
        outline = found["outline_m"]
        if self.has(Feature.OUTLINES, share):
            scales = rng.uniform(0.4, 1.6, (legs + 1, 1, 2))
            if self.is_odd and rng.random() < 0.5:
                scales[int(rng.integers(legs + 1))] = 0.0
            return {"outline_m": outline * scales[0], "outlines_m": outline * scales}
        if self.has(Feature.GROWTH, share):
            lasts_s = (voyage.times_us[-1] - voyage.times_us[0]) / 1e6
            outline = np.zeros((1, 2)) if sharpest_deg(outline) < 5.0 else outline
            grow_mps = min(float(self.layout.scale * rng.uniform(50.0, 600.0) / lasts_s), 1e6)
            return {"outline_m": outline, "grow_mps": grow_mps}
        return found

    def tolerances(self, legs: int, voyage: Voyage) -> dict[str, Any]:
        """Return members of tolerances; the windows of a scene with zero durations have one instant."""
        rng, found = self.rng, dict[str, Any]()
        per_leg, scale = rng.random() < 0.5, self.layout.scale

        def numbers(low: float, high: float, n: int = legs) -> Any:
            values = [round(float(value), 3) for value in rng.uniform(low, high, n)]
            return values if per_leg else values[0]

        if Feature.CROSS_TRACK in self.features:
            found |= {"xtd_port_m": numbers(50.0 * scale, 800.0 * scale)}
            found |= {"xtd_starboard_m": numbers(0.0, 800.0 * scale)}
        if Feature.SPEED_WINDOW in self.features:
            slowest, fastest = (speed * 3600.0 / 1852.0 for speed in voyage.speeds_mps)
            found |= {"min_speed_kn": numbers(0.8 * slowest, 0.95 * slowest)}
            found |= {"max_speed_kn": numbers(1.05 * fastest, 1.3 * fastest)}
        if Feature.TURN_RADIUS in self.features and legs > 1:
            found["turn_radius_m"] = numbers(50.0 * scale, 400.0 * scale, legs - 1)
        wide = 0 if Feature.ZERO in self.features and rng.random() < 0.7 else self.layout.grid_us // 2
        for feature, name, at_us in (
            (Feature.DEPARTURE_WINDOW, "departure_window", int(voyage.times_us[0])),
            (Feature.ARRIVAL_WINDOW, "arrival_window", int(voyage.times_us[-1])),
        ):
            if feature in self.features:
                earlier_us, later_us = (rng.integers(0, 2, 2) * wide).tolist()
                found[name] = [_text(at) for at in (at_us - earlier_us, at_us + later_us)]
        return found


class _OddMaker(_Maker):
    """Makes a scene with odd keys, names, classes, owners, properties and heights."""

    is_odd = True

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.keys = set[str]()
        self.classes = tuple(odd_values.word(self.rng) for _ in CLASSES)

    def key(self, key: str) -> str:
        found = odd_values.key(self.rng, self.keys)
        self.keys.add(found)
        return found

    def named(self, key: str) -> dict[str, Any]:
        """Return what areas and tracks have alike; a class of the rules if there are any."""
        usual = super().named(key)
        return usual | odd_values.named(self.rng, {*usual} & {"object_class", "owner"})

    def band(self) -> tuple[float | None, float | None]:
        low = odd_values.number(self.rng, -1e5, 1e5 - 1.0)
        high = odd_values.number(self.rng, float(np.nextafter(low, 1e5)), 1e5)
        k = int(self.rng.integers(4))
        return (None if k == 0 else low), (None if k == 1 else high)


def _text(at_us: int) -> str:
    return _moment(at_us).isoformat().replace("+00:00", "Z")


def _moment(at_us: int) -> datetime:
    return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=int(at_us))
