"""A plain rewriting of scenes, for the oracle: each pair as objects without features, by loops and tables.

Shares nothing with the package but the classes of a scene. Activations, departures and schedules become copies with
spans; classes and owners a table of pairs that are compared, with their separation; separation in time becomes spans
that are longer, and tracks that sail earlier and later; tolerances become voyages, drawn within them.

    for pair in plain_pairs(scene, areas, tracks):
        pair.found(0.0)       # when the two are in contact, at least
        pair.found(5.0)       # ... or nearer by 5 m than they must be apart: not longer than that

Schedules are those of `mixed_scenes`: daily rules of RFC 5545 that begin in UTC, and periods of days in a time zone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time, timedelta
from itertools import combinations
from typing import Any, Final
from zoneinfo import ZoneInfo

import numpy as np
import oracle
from numpy.typing import NDArray

from conflictdb.model.inputs import certain
from conflictdb.model.plans import Area, Intervals, Scene, Track
from conflictdb.model.rules import Rule

Thing = Area | Track
Span = tuple[float, float]
DAY_US: Final = 86_400_000_000
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
SHIFTS: Final = 7  # of a track that sails earlier or later, within the separation in time
VOYAGES: Final = 4  # that are drawn of a track with tolerances, with the planned one
_STEP_S: Final = 10.0
INSIDE: Final = 0.98  # of its tolerances


@dataclass(frozen=True)
class Required:
    """Least distances of two objects, and the time between two uses of a place."""

    separation_m: float
    vertical_m: float
    time_us: float


@dataclass(frozen=True)
class PlainPair:
    """Two objects, the area first, else the smaller key, as copies that are there once.

    each : all combinations of their copies; of tracks with tolerances, and of earlier and later ones, one list for each
        draw: they are in contact if one of a list is
    is_drawn : whether voyages within tolerances are drawn: others may be in contact at other times
    is_exact : whether neither these nor shifts in time are drawn
    doubtful : copies that may be there, if schedules are expanded farther
    unmoved : all combinations of copies, at their own times
    """

    keys: tuple[str, str]
    scene: Scene
    required: Required
    draws: tuple[tuple[tuple[Thing, Thing], ...], ...]
    doubtful: tuple[tuple[Thing, Thing], ...]
    unmoved: tuple[tuple[Thing, Thing], ...]
    is_drawn: bool
    is_exact: bool

    def found(self, nearer_m: float, *, doubtful: bool = False) -> list[list[Span]]:
        """Return for each draw when copies are nearer than they must be apart and so many metres more, microseconds."""
        more = self.doubtful if doubtful else ()
        return [_merged([span for a, b in (*draw, *more) for span in self._met(a, b, nearer_m)]) for draw in self.draws]

    def may_be_near(self) -> bool:
        """Return whether circles around two tracks come as near as they must not, at times as near, by coarse steps."""
        return any(_may_be_near(a, b, self.required) for a, b in self.unmoved)

    def _met(self, a: Thing, b: Thing, nearer_m: float) -> Iterator[Span]:
        scene = replace(self.scene, separation_m=self.required.separation_m + nearer_m)
        bands = list(_overlaps(a, b, self.required.vertical_m, scene.intervals is Intervals.CLOSED))
        if not bands or not _share_time(a, b, scene.intervals is Intervals.CLOSED):
            return
        met = oracle.meeting(scene, _bare(a), _bare(b), 20.0)
        for start, end in met.intervals_us:
            for low, high in bands:
                first, last = max(start, low), min(end, high)
                if first <= last:
                    yield first, last


def plain_pairs(
    scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], today: datetime, rng: np.random.Generator
) -> Iterator[PlainPair]:
    """Yield the pairs of a scene that are compared."""
    window = _window(scene, tracks, today, 0)
    wide = _window(scene, tracks, today, 2 * DAY_US)
    things: list[Thing] = sorted([*areas, *tracks], key=lambda one: (isinstance(one, Track), one.key.encode()))
    bare = Scene("plain", scene.motion, scene.earth, tolerance_m=0.0, centre=scene.centre, intervals=scene.intervals)
    draws = {one.key: _draws(one, window, rng) for one in things}
    wider = {one.key: list(_copies(one, wide)) for one in things}
    for a, b in combinations(things, 2):
        required = _required(scene, a, b)
        if required is None or (a.owner is not None and a.owner == b.owner):
            continue
        some = []
        for k in range(max(len(draws[a.key]), len(draws[b.key])) if draws[a.key] and draws[b.key] else 0):
            mine, theirs = draws[a.key][k % len(draws[a.key])], draws[b.key][k % len(draws[b.key])]
            some.append([(one, other) for one in mine for other in theirs])
        more = [(one, other) for one in wider[a.key] for other in wider[b.key]]
        unmoved = tuple(more)
        is_drawn = any(isinstance(one, Track) and one.tolerances is not None for one in (a, b))
        is_exact = not is_drawn and (not required.time_us or isinstance(a, Area))
        if required.time_us:
            some = [list(_with_time(pairs, required.time_us)) for pairs in some]
            more = list(_with_time(more, required.time_us))
        yield PlainPair(
            (a.key, b.key), bare, required, tuple(map(tuple, some)), tuple(more), unmoved, is_drawn, is_exact
        )


def _required(scene: Scene, a: Thing, b: Thing) -> Required | None:
    """Return what a pair needs; None: it is not compared. The most specific rule replaces the settings."""
    ranked: dict[int, list[Rule]] = {}
    for rule in scene.rules:
        for one, other in ((a, b), (b, a)):
            fits = _fit(rule.a_class, one), _fit(rule.b_class, other)
            if None not in fits:
                rank = {(0, 0): 0, (0, 1): 1, (0, 2): 2, (1, 1): 3, (1, 2): 4, (2, 2): 5}[tuple(sorted(fits))]
                ranked.setdefault(rank, []).append(rule)
                break
    rules = ranked[min(ranked)] if ranked else []
    if any(rule.allowed for rule in rules):
        return None

    def largest(name: str, setting: float) -> float:
        given = [getattr(rule, name) for rule in rules]
        return max(setting if one is None else one for one in given) if given else setting

    return Required(
        largest("separation_m", scene.separation_m),
        largest("vertical_m", scene.vertical_separation_m),
        1e6 * largest("time_s", scene.time_separation_s),
    )


def _fit(side: str | None, one: Thing) -> int | None:
    """Return how a side of a rule names an object: 0 by class, 1 by kind, 2 as any; None: it does not."""
    if side is None:
        return 2
    if side in ("area", "track"):
        return 1 if side == ("area" if isinstance(one, Area) else "track") else None
    return 0 if side == one.object_class else None


def _window(scene: Scene, tracks: Sequence[Track], today: datetime, more_us: int) -> tuple[float, float]:
    """Return the time for which schedules are expanded: today and some days, and over all voyages."""
    first = _us(datetime.combine(today.date(), time(), UTC))
    ends = [(first, first + DAY_US + scene.horizon_days * DAY_US)]
    more = max([1e6 * scene.time_separation_s, *(1e6 * (rule.time_s or 0.0) for rule in scene.rules)]) + more_us
    for track in tracks:
        if track.schedule is None:
            departs = track.departures_us if track.departures_us is not None else (int(track.times_us[0]),)
            lasts = int(track.times_us[-1] - track.times_us[0])
            ends += [(at - more, at + lasts + more + 1) for at in departs]
    return min(start for start, _ in ends), max(end for _, end in ends)


def _draws(one: Thing, window: tuple[float, float], rng: np.random.Generator) -> list[list[Thing]]:
    """Return lists of copies; of a track with tolerances some voyages, of others one list."""
    if isinstance(one, Track) and one.tolerances:
        return [[voyage] for voyage in _voyages(one, rng)]
    return [list(_copies(one, window))]


def _copies(one: Thing, window: tuple[float, float]) -> Iterator[Thing]:
    """Yield an object as often as it is there."""
    if isinstance(one, Area):
        for start, end in _spans(one, window):
            ends = [certain(int(at)) if np.isfinite(at) else None for at in (start, end)]
            yield replace(_plain(one), start_us=ends[0], end_us=ends[1])
        return
    lasts = int(one.times_us[-1] - one.times_us[0])
    if one.schedule is not None:
        departs = [start for start, _ in _scheduled(one.schedule)]
        departs = [at for at in departs if at < window[1] and at + lasts >= window[0]]
    else:
        departs = [int(one.times_us[0])] if one.departures_us is None else list(one.departures_us)
    for at in departs:
        yield _later(one, at - int(one.times_us[0]))


def _spans(area: Area, window: tuple[float, float]) -> list[tuple[float, float]]:
    if area.schedule is None:
        given = area.spans_us if area.spans_us is not None else ((area.start_us, area.end_us),)
        return [(-np.inf if start is None else start, np.inf if end is None else end) for start, end in given]
    low = max(window[0], -np.inf if area.start_us is None else area.start_us)
    high = min(window[1], np.inf if area.end_us is None else area.end_us)
    cut = [(max(start, low), min(end, high)) for start, end in _scheduled(area.schedule)]
    return [(start, end) for start, end in cut if start < end]


def _scheduled(schedule: Any) -> list[tuple[int, int]]:
    """Return all activations of a schedule, microseconds since 1970."""
    found = []
    for rule in schedule if isinstance(schedule, list) else [schedule]:
        if "rrule" in rule:
            found += _of_rrule(rule)
            continue
        zone = ZoneInfo(rule["timezone"])
        days = rule.get("dates") or _days(rule["from"], rule["until"])
        for day in days:
            for start, end in rule["periods"]:
                begin = _moment(day, start, zone)
                finish = _moment(day, end, zone)
                if finish <= begin:
                    finish = _moment((date.fromisoformat(day) + timedelta(days=1)).isoformat(), end, zone)
                found.append((_us(begin), _us(finish)))
    return sorted(found)


def _of_rrule(rule: Mapping[str, str]) -> Iterator[tuple[int, int]]:
    begin, every = rule["rrule"].splitlines()
    at = datetime.strptime(begin.removeprefix("DTSTART:"), "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
    parts = dict(part.split("=") for part in every.removeprefix("RRULE:").split(";"))
    assert parts["FREQ"] == "DAILY"
    lasts = timedelta(minutes=int(rule["duration"].removeprefix("PT").removesuffix("M")))
    for _ in range(int(parts["COUNT"])):
        yield _us(at), _us(at + lasts)
        at += timedelta(days=int(parts.get("INTERVAL", "1")))


def _days(first: str, last: str) -> Iterator[str]:
    day = date.fromisoformat(first)
    while day <= date.fromisoformat(last):
        yield day.isoformat()
        day += timedelta(days=1)


def _moment(day: str, clock: str, zone: ZoneInfo) -> datetime:
    return datetime.combine(date.fromisoformat(day), time.fromisoformat(clock), zone).astimezone(UTC)


def _us(moment: datetime) -> int:
    return (moment - EPOCH) // timedelta(microseconds=1)


def _plain(one: Thing) -> Any:
    """Return an object without class, owner and times of its own."""
    common: dict[str, Any] = {"name": None, "properties": {}, "object_class": None, "owner": None, "schedule": None}
    if isinstance(one, Area):
        return replace(one, **common, spans_us=None, start_us=None, end_us=None)
    return replace(one, **common, tolerances=None, departures_us=None, max_speed_kn=np.inf)


def _later(track: Track, by_us: int) -> Track:
    times: Any = [certain(int(at) + by_us) for at in track.times_us]
    return replace(_plain(track), times_us=times, max_speed_kn=np.inf)


def _with_time(pairs: Sequence[tuple[Thing, Thing]], within_us: float) -> Iterator[tuple[Thing, Thing]]:
    """Yield pairs of which one is there earlier and later: areas for longer, tracks with other departures."""
    for a, b in pairs:
        if isinstance(a, Area):
            ends = [
                None if at is None else certain(int(at + by))
                for at, by in ((a.start_us, -within_us), (a.end_us, within_us))
            ]
            yield replace(a, start_us=ends[0], end_us=ends[1]), b
            continue
        assert isinstance(b, Track)
        for by in np.linspace(-0.999 * within_us, 0.999 * within_us, SHIFTS):
            yield a, _later(b, int(by))


def _may_be_near(a: Thing, b: Thing, required: Required) -> bool:
    assert isinstance(a, Track)
    assert isinstance(b, Track)
    (lon, lat, at, reach), (lon_b, lat_b, at_b, reach_b) = _circles(a), _circles(b)
    half = 0.5 * (np.mod(lon[:, None] - lon_b + np.pi, 2.0 * np.pi) - np.pi)
    square = np.sin(0.5 * (lat[:, None] - lat_b)) ** 2 + np.cos(lat[:, None]) * np.cos(lat_b) * np.sin(half) ** 2
    metres = 2.0 * 6_400_000.0 * np.arcsin(np.sqrt(square))
    together = np.abs(at[:, None] - at_b) <= required.time_us + 1e6 * _STEP_S
    return bool((together & (0.98 * metres <= reach + reach_b + required.separation_m)).any())


def _circles(track: Track) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]:
    """Return longitudes and latitudes (radians) of a track every few seconds, the times, and a radius of its haven."""
    at = np.arange(int(track.times_us[0]), int(track.times_us[-1]) + 1e6 * _STEP_S, 1e6 * _STEP_S)
    lon, lat = np.unwrap(np.radians(track.positions_deg[:, 0])), np.radians(track.positions_deg[:, 1])
    places = [np.interp(at, track.times_us, each) for each in (lon, lat)]
    outlines = track.outline_m if track.outlines_m is None else track.outlines_m
    grown_m = 3.0 * track.grow_mps * (track.times_us[-1] - track.times_us[0]) / 1e6
    fastest_mps = float(_speeds_kn(track).max()) * 1852.0 / 3600.0
    return *places, at, float(np.hypot(outlines[..., 0], outlines[..., 1]).max()) + grown_m + fastest_mps * _STEP_S


def _voyages(track: Track, rng: np.random.Generator) -> Iterator[Track]:
    """Yield voyages within the tolerances of a track, the planned one first; none if its turns are arcs."""
    given = track.tolerances or {}
    if np.any(given.get("turn_radius_m", 0.0)):
        return
    yield _plain(track)
    windows = {name: [_us(datetime.fromisoformat(at)) for at in given.get(name) or ()] for name in
               ("departure_window", "arrival_window")}  # fmt: skip
    legs = len(track.times_us) - 1
    lasts = np.diff(track.times_us) / 1e6
    found = 0
    for _ in range(50):
        if found == VOYAGES - 1:
            return
        factors = np.ones(legs)
        if "min_speed_kn" in given:
            planned = _speeds_kn(track)
            low = np.broadcast_to(given["min_speed_kn"], legs) / planned
            high = np.broadcast_to(given["max_speed_kn"], legs) / planned
            way = rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], legs)
            factors = 1.0 + INSIDE * way * np.where(way < 0.0, 1.0 - low, high - 1.0)
        depart = int(track.times_us[0])
        if windows["departure_window"]:
            depart = int(rng.choice([*windows["departure_window"], depart]))
        times = depart + np.concatenate([[0], np.round(1e6 * np.cumsum(lasts / factors))]).astype(np.int64)
        arrives = windows["arrival_window"]
        if arrives and not arrives[0] <= times[-1] <= arrives[1]:
            continue
        voyage = replace(_plain(track), times_us=[certain(int(at)) for at in times], max_speed_kn=np.inf)
        if legs == 1:
            side = "port" if rng.random() < 0.5 else "starboard"
            limit = float(np.max(given.get(f"xtd_{side}_m", 0.0)))
            by = INSIDE * limit * float(rng.choice([0.0, 0.5, 1.0])) * (-1.0 if side == "port" else 1.0)
            voyage = replace(voyage, positions_deg=_aside(track.positions_deg, by), max_speed_kn=np.inf)
        found += 1
        yield voyage


def _speeds_kn(track: Track) -> NDArray[np.float64]:
    """Return the planned speeds of legs, near enough for voyages that stay inside."""
    lon, lat = np.radians(track.positions_deg).T
    half = 0.5 * (np.mod(np.diff(lon) + np.pi, 2.0 * np.pi) - np.pi)
    square = np.sin(0.5 * np.diff(lat)) ** 2 + np.cos(lat[:-1]) * np.cos(lat[1:]) * np.sin(half) ** 2
    metres = 2.0 * 6_371_000.0 * np.arcsin(np.sqrt(square))
    return np.asarray(metres / (np.diff(track.times_us) / 1e6) * 3600.0 / 1852.0)


def _aside(positions_deg: NDArray[np.float64], starboard_m: float) -> NDArray[np.float64]:
    """Return both ends of a leg some metres to starboard."""
    lon, lat = np.radians(positions_deg).T
    east = (np.mod(lon[1] - lon[0] + np.pi, 2.0 * np.pi) - np.pi) * np.cos(lat.mean())
    bearing = np.arctan2(east, lat[1] - lat[0])
    north_m, east_m = -np.sin(bearing) * starboard_m, np.cos(bearing) * starboard_m
    moved = np.array(positions_deg)
    moved[:, 1] += np.degrees(north_m / 6_371_000.0)
    moved[:, 0] += np.degrees(east_m / 6_371_000.0 / np.cos(lat))
    return moved


def _bare(one: Thing) -> Thing:
    """Return an object at all heights."""
    if isinstance(one, Area):
        return replace(one, floor_m=None, ceiling_m=None)
    return replace(one, floor_m=None, ceiling_m=None, floors_m=None, ceilings_m=None, max_speed_kn=np.inf)


def _share_time(a: Thing, b: Thing, closed: bool) -> bool:
    (start, end), (first, last) = _life(a), _life(b)
    low, high = max(start, first), min(end, last)
    return low < high or (closed and low == high)


def _life(one: Thing) -> Span:
    if isinstance(one, Area):
        return (
            -np.inf if one.start_us is None else one.start_us,
            np.inf if one.end_us is None else one.end_us,
        )
    return int(one.times_us[0]), int(one.times_us[-1])


def _overlaps(a: Thing, b: Thing, apart_m: float, closed: bool) -> Iterator[Span]:
    """Yield when the heights of two objects are nearer than they must be apart, for each pair of legs."""
    for start, end, floors, ceilings in _bands(a):
        for first, last, floors_b, ceilings_b in _bands(b):
            low, high = max(start, first), min(end, last)
            if low > high:
                continue
            for lower, upper, of, to in (
                (floors, ceilings_b, (start, end), (first, last)),
                (floors_b, ceilings, (first, last), (start, end)),
            ):
                # The gap from the ceiling of one to the floor of the other changes linearly.
                gaps = [_between(lower, of, at) - _between(upper, to, at) - apart_m for at in (low, high)]
                low, high = _below(low, high, gaps, closed)
                if low > high:
                    break
            if low <= high:
                yield low, high


def _below(low: float, high: float, gaps: list[float], closed: bool) -> Span:
    """Return the part of a span in which a linear gap is below 0, or 0 if closed; the empty one is (1, 0)."""
    inside = [gap < 0.0 or (closed and gap == 0.0) for gap in gaps]
    if all(inside):
        return low, high
    if not any(inside):
        return 1.0, 0.0
    crossing = low + (high - low) * gaps[0] / (gaps[0] - gaps[1])
    return (low, crossing) if inside[0] else (crossing, high)


def _between(ends: tuple[float, float], span: Span, at: float) -> float:
    if ends[0] == ends[1] or span[0] == span[1]:
        return ends[0]
    return ends[0] + (ends[1] - ends[0]) * (at - span[0]) / (span[1] - span[0])


def _bands(one: Thing) -> Iterator[tuple[float, float, tuple[float, float], tuple[float, float]]]:
    """Yield start and end of each leg, with the floors and the ceilings at both."""
    floor = -np.inf if one.floor_m is None else one.floor_m
    ceiling = np.inf if one.ceiling_m is None else one.ceiling_m
    if isinstance(one, Area):
        yield *_life(one), (floor, floor), (ceiling, ceiling)
        return
    legs = len(one.times_us) - 1
    for k in range(legs):
        found = []
        for whole, each in ((floor, one.floors_m), (ceiling, one.ceilings_m)):
            if each is None:
                found.append((whole, whole))
            elif len(each) == legs:
                found.append((float(each[k]), float(each[k])))
            else:
                ends = float(each[k]), float(each[k + 1])
                open_end = next((end for end in ends if np.isinf(end)), None)
                found.append(ends if open_end is None else (open_end, open_end))
        yield int(one.times_us[k]), int(one.times_us[k + 1]), found[0], found[1]


def _merged(spans: Sequence[Span]) -> list[Span]:
    found: list[Span] = []
    for start, end in sorted(spans):
        if found and start <= found[-1][1] + 2.0:
            found[-1] = found[-1][0], max(found[-1][1], end)
        else:
            found.append((start, end))
    return found
