"""Paths without a database."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from typing import Final

import geopandas
import numpy as np
import shapely
from case import Case, Finding, NotApplicable, Plan, at_speed, idle_schedules, only_of, same, solved, waiting
from layouts import Hubs
from scene_features import DAY_US

from conflictdb import Index, chances, delays, detours, resolve, solve, speeds
from conflictdb.core.world import Reach, World
from conflictdb.formats.scene_file import feature_of
from conflictdb.memory.resolve import moved
from conflictdb.model.inputs import EPOCH, MICROSECOND, certain
from conflictdb.model.plans import Area, Track
from conflictdb.model.proposals import Proposal
from conflictdb.model.recurring_plans import later
from conflictdb.model.results import Conflict, Delays, Forbidden, Speeds, Verdict

METRES_PER_DEGREE: Final = Hubs.METRES_PER_DEGREE
WITHIN_S: Final = 1800.0
# Longer than a day: delayed tracks leave the expanded window, and meet the spans of schedules on other days.
DAYS_S: Final = 93_600.0
# Longer than any track, with a quarter of an hour before and after it.
HOURS_S: Final = 7200.0
# Shorter than this quarter: what forbids only longer delays lies outside on both sides.
MINUTES_S: Final = 600.0
# Delays are compared this close to the ends of forbidden intervals, of the first and the last one.
_CLOSE_US: Final = 1000
# Speeds are compared where rounding does not decide.
_SHARE: Final = 0.37


def other_order(case: Case) -> Finding:
    """`solve` with the objects in another order."""
    areas, tracks = case.mixed.areas[::-1], case.mixed.tracks[::-1]
    return same(case.rows, solved(tracks[1:] + tracks[:1], areas, case.scene).values())


def frames(case: Case) -> Finding:
    """`solve` with GeoDataFrames: the columns of scene files, and the values that JSON has."""
    tracks, areas = _frame(case.mixed.tracks), _frame(case.mixed.areas)
    with idle_schedules():
        return same(case.rows, solve(tracks, areas, case.scene))


def _frame(objects: Iterable[Area | Track]) -> geopandas.GeoDataFrame:
    features = [feature_of(one) for one in objects]
    rows = [{"id": feature["id"], **feature["properties"]} for feature in features]
    columns = {name: [row.get(name) for row in rows] for name in dict.fromkeys(name for row in rows for name in row)}
    shapes = [shapely.geometry.shape(feature["geometry"]) for feature in features]
    return geopandas.GeoDataFrame(columns, geometry=shapes, crs=4326)


def index(case: Case) -> Finding:
    """`Index`: each plan is probed, then put; and the plan of the scene is probed once all are put.

    Voyages first: a later one expands the schedules further, and pairs of earlier objects are not probed again.
    """
    plans, found = Index(case.scene), list[Conflict]()
    with idle_schedules():
        for one in sorted(case.mixed.objects, key=lambda one: isinstance(one, Area) or one.schedule is not None):
            found += plans.probe(one)
            plans.put(one)
        within = plans.probe(case.mixed.plan)
    finding = same(case.rows, found, is_exact=case.has_fixed_plane)
    finding.add(same(case.rows_of_plan, within, is_exact=case.has_fixed_plane))
    return finding


def delays_in_memory(case: Case) -> Finding:
    """`delays` of one track: forbidden delays conflict, free ones do not."""
    track = case.single_track()
    finding = Finding()
    for one, within_s in ((with_other_days(case, track), DAYS_S), (with_closed_areas(case, track), HOURS_S)):
        with idle_schedules():
            [answer] = delays(one.mixed.tracks, one.mixed.areas, one.scene, track.key, within_s)
        finding.add(claims_of_delays(one, answer, track, within_s))
    return finding


def with_closed_areas(case: Case, track: Track) -> Case:
    """Return the scene with two areas at the first waypoint of a track: one is always active, one before and after it.

    Only the first one forbids every delay.
    """
    box = _box_at(track, 0)
    ends_us, begins_us = (int(at) for at in (track.times_us[0] - 900_000_000, track.times_us[-1] + 900_000_000))
    spans = [[None, certain(ends_us)], [certain(begins_us), None]]
    areas = [Area("closed", box), Area("closed before and after", box, spans_us=spans)]
    return _with(case, areas)


def with_other_days(case: Case, track: Track, waypoint: int = 1) -> Case:
    """Return the scene with two areas on the way of a track, whose schedules no voyage reaches as planned.

    One is active at a waypoint, 1 the first, on the day after or before, away from the other voyages and today; one at
    the last waypoint after the track has arrived.
    """
    starts_us, ends_us = int(track.times_us[0]), int(track.times_us[-1])
    day_us = DAY_US if case.mixed.seed % 2 == 0 else -DAY_US
    at_us = int(track.times_us[waypoint - 1]) + day_us - 600_000_000
    areas = [
        Area("another day", _box_at(track, waypoint - 1), schedule=_once(at_us, 1200)),
        Area("after it", _box_at(track, -1), schedule=_once(ends_us + (ends_us - starts_us) // 5, 600)),
    ]
    return _with(case, areas)


def _with(case: Case, areas: list[Area]) -> Case:
    return Case(replace(case.mixed, areas=[*case.mixed.areas, *areas]), case.folder)


def _box_at(track: Track, waypoint: int) -> shapely.Polygon:
    """Return a small area at a waypoint, 0 the first."""
    lon, lat = track.positions_deg[waypoint].tolist()
    high = 100.0 / METRES_PER_DEGREE
    wide = high / np.cos(np.radians(lat))
    return shapely.box(lon - wide, lat - high, lon + wide, lat + high)


def _once(from_us: int, lasts_s: int) -> dict[str, str]:
    """Return a schedule with one span."""
    start = EPOCH + from_us * MICROSECOND
    return {"rrule": f"DTSTART:{start:%Y%m%dT%H%M%SZ}\nRRULE:FREQ=DAILY;COUNT=1", "duration": f"PT{lasts_s}S"}


def area_delays_in_memory(case: Case) -> Finding:
    """`delays` of one area: forbidden delays of its activations conflict, free ones do not."""
    area, finding = case.single_area(), Finding()
    for within_s in (HOURS_S, DAYS_S):
        with idle_schedules():
            [answer] = delays(case.mixed.tracks, case.mixed.areas, case.scene, area.key, within_s)
        fixed, expanded = with_activations(case, area, within_s)
        finding.add(claims_of_delays(fixed, answer, expanded, within_s))
    return finding


def with_activations(case: Case, area: Area, within_s: float) -> tuple[Case, Area]:
    """Return the scene, and an area, with the activations that a question has which moves the area.

    Schedules do not follow an area that moves: copies of it meet these activations.
    """
    beside = case.mixed.areas if area.schedule is not None else [area]
    reach = Reach.either(round(1e6 * within_s))
    world = World.of(case.scene, case.mixed.areas, case.mixed.tracks, reach=reach, moved=beside)
    areas, tracks = world.expanded(case.mixed.areas, case.mixed.tracks)
    areas, tracks = [later(area, 0) for area in areas], [later(track, 0) for track in tracks]
    fixed = Case(replace(case.mixed, areas=areas, tracks=tracks), case.folder)
    return fixed, next(one for one in areas if one.key == area.key)


def claims_of_delays(case: Case, answer: Delays, track: Plan, within_s: float) -> Finding:
    """Check the claims of delays by moving the track and solving again."""
    finding, whole_us = Finding(), round(1e6 * within_s)
    for at_us, is_free, one in _delays_to_check(answer, -whole_us, whole_us):
        met = case.met_after(later(track, at_us))
        if is_free:
            finding.check(not met, f"{track.key}: delay {at_us / 1e6} s is free, but meets {met}")
        elif one is not None:
            if one.is_proven:
                finding.check(bool(met), f"{track.key}: delay {at_us / 1e6} s is forbidden, but meets nothing")
            finding.check(met <= set(one.by), f"{track.key}: delay {at_us / 1e6} s meets {met}, not only {one.by}")
    for sign, least_s in ((1, answer.least_later_s), (-1, answer.least_earlier_s)):
        if least_s is not None:
            met = case.met_after(later(track, sign * round(1e6 * least_s)))
            finding.check(not met, f"{track.key}: advised delay {sign * least_s} s meets {met}")
    for share in (0.08, 0.31, 0.52, 0.77) if answer.blocked_by else ():
        at_us = round(1e6 * (answer.earliest_s + share * (answer.latest_s - answer.earliest_s)))
        missing = set(answer.blocked_by) - case.met_after(later(track, at_us))
        finding.check(not missing, f"{track.key}: {missing} block every delay, but not one of {at_us / 1e6} s")
    return finding


def _delays_to_check(answer: Delays, low_us: int, high_us: int) -> Iterator[tuple[int, bool, Forbidden | None]]:
    """Yield delays close to the ends of two forbidden intervals, on both sides, whether each is free, and its interval.

    Also those by a day, at which a track meets the spans of schedules on other days.
    """
    ends = [(round(1e6 * one.from_s), round(1e6 * one.to_s)) for one in answer.forbidden]
    given = list(zip(answer.forbidden, ends, strict=True))
    for one, (from_us, to_us) in [*given[:1], *given[1:][-1:]]:
        first_us = from_us + round(1e6 * one.from_error_s) + _CLOSE_US
        last_us = to_us - round(1e6 * one.to_error_s) - _CLOSE_US
        if first_us < last_us:
            yield first_us, False, one
            yield last_us, False, one
        for at_us in (from_us - _CLOSE_US, to_us + _CLOSE_US):
            if low_us < at_us < high_us and all(not low <= at_us <= high for low, high in ends):
                yield at_us, True, None
    for at_us in (-DAY_US, DAY_US) if high_us > DAY_US else (high_us // 3,):
        if all(not low - _CLOSE_US <= at_us <= high + _CLOSE_US for low, high in ends):
            yield at_us, True, None


def waits_in_memory(case: Case) -> Finding:
    """`delays` at a waypoint: the track stands there longer."""
    track = case.single_track(is_exact=True)
    inner = len(track.times_us) - 2
    if inner < 1 or _has_heights_of_legs(track) or track.grow_mps or track.outlines_m is not None:
        raise NotApplicable("no waypoint between two legs, or a haven or heights by leg")
    finding = Finding()
    asked = [(with_other_days(case, track, 2), DAYS_S)]
    asked += [(beside, WITHIN_S) for beside in _beside_the_waypoint(case, track)]
    for one, within_s in asked:
        with idle_schedules():
            [answer] = delays(one.mixed.tracks, one.mixed.areas, one.scene, track.key, within_s, waypoint=2)
        finding.add(claims_of_waits(one, answer, track, within_s))
    return finding


def _beside_the_waypoint(case: Case, track: Track) -> Iterator[Case]:
    """Yield scenes of the track and a small area beside its second waypoint: the heading of the wait decides."""
    reach_m = float(np.hypot(*track.outline_m.T).max())
    lon, lat = track.positions_deg[1].tolist()
    leaves_us = int(track.times_us[1])
    for bearing in np.radians([20.0, 110.0, 200.0, 290.0]).tolist() if reach_m else ():
        north, east = (
            np.cos(bearing) * reach_m / METRES_PER_DEGREE,
            np.sin(bearing) * reach_m / METRES_PER_DEGREE,
        )
        x, y, half = (
            lon + 0.55 * east / np.cos(np.radians(lat)),
            lat + 0.55 * north,
            0.02 * reach_m / METRES_PER_DEGREE,
        )
        box = shapely.box(x - half / np.cos(np.radians(lat)), y - half, x + half / np.cos(np.radians(lat)), y + half)
        start, end = certain(leaves_us + 120_000_000), certain(leaves_us + 720_000_000)
        areas = [Area("beside", box, start_us=start, end_us=end)]
        scene = replace(case.scene, separation_m=0.0, rules=(), tolerance_m=min(case.scene.tolerance_m, 1.0))
        yield Case(replace(case.mixed, scene=scene, areas=areas, tracks=[track]), case.folder)


def claims_of_waits(case: Case, answer: Delays, track: Track, within_s: float) -> Finding:
    """Check the claims of waits at the second waypoint."""
    finding = Finding()
    for at_us, is_free, one in _delays_to_check(answer, 0, round(1e6 * within_s)):
        if at_us > _CLOSE_US:
            met = case.met_after(waiting(track, 2, at_us))
            if is_free:
                finding.check(not met, f"{track.key}: a wait of {at_us / 1e6} s is free, but meets {met}")
            elif one is not None and one.is_proven:
                finding.check(bool(met), f"{track.key}: a wait of {at_us / 1e6} s is forbidden, but meets nothing")
    if answer.least_later_s:
        met = case.met_after(waiting(track, 2, round(1e6 * answer.least_later_s)))
        finding.check(not met, f"{track.key}: the advised wait of {answer.least_later_s} s meets {met}")
    return finding


def _has_heights_of_legs(track: Track) -> bool:
    return track.floors_m is not None or track.ceilings_m is not None


def speeds_in_memory(case: Case) -> Finding:
    """`speeds` of one track: forbidden speeds conflict, free ones do not."""
    track = case.single_track(is_exact=True)
    beyond = with_other_days(case, track)
    with idle_schedules():
        [answer] = speeds(beyond.mixed.tracks, beyond.mixed.areas, case.scene, track.key, 0.6, 1.8)
    return claims_of_speeds(beyond, answer, track)


def claims_of_speeds(case: Case, answer: Speeds, track: Track) -> Finding:
    """Check the claims of speeds by changing the speed and solving again."""
    finding = Finding()
    reached = 0.6
    for one in answer.forbidden:
        factor = one.from_factor + _SHARE * (one.to_factor - one.from_factor)
        met = case.met_after(at_speed(track, factor))
        if one.is_proven and one.to_factor - one.from_factor > 1e-4:
            finding.check(bool(met), f"{track.key}: speed {factor} is forbidden, but meets nothing")
        finding.check(met <= set(one.by), f"{track.key}: speed {factor} meets {met}, not only {one.by}")
        if one.from_factor - reached > 1e-3:
            free = reached + _SHARE * (one.from_factor - reached)
            met = case.met_after(at_speed(track, free))
            finding.check(not met, f"{track.key}: speed {free} is free, but meets {met}")
        reached = one.to_factor
    for factor in {one for one in (answer.slower, answer.faster) if one is not None}:
        met = case.met_after(at_speed(track, factor))
        finding.check(not met, f"{track.key}: advised speed {factor} meets {met}")
    return finding


def detours_in_memory(case: Case) -> Finding:
    """`detours`: no way meets anything."""
    track = case.single_track(is_exact=True)
    with idle_schedules():
        ways = detours(case.mixed.tracks, case.mixed.areas, case.scene, key=track.key, most_m=6000.0, later_s=1800.0)
    if not ways:
        raise NotApplicable("there is no way")
    finding = Finding()
    for way in [*ways[:2], *ways[-1:]]:
        met = case.met_after(way.track)
        finding.check(not met, f"{track.key}: detour {way.waypoints_deg} meets {met}")
    return finding


def resolve_in_memory(case: Case, aside_m: float = 0.0) -> Finding:
    """`resolve`: after its moves, moved tracks meet nothing, and the others nothing new."""
    with idle_schedules():
        proposal = resolve(
            case.mixed.tracks, case.mixed.areas, case.scene, within_s=WITHIN_S, limit_s=5.0, aside_m=aside_m
        )
    return claims_of_resolve(case, proposal)


def resolve_with_ways(case: Case) -> Finding:
    """`resolve` with new waypoints."""
    return resolve_in_memory(case, 3000.0)


def resolve_with_areas(case: Case) -> Finding:
    """`resolve` that may move all areas in time, with departures in whole minutes."""
    mixed, movable = case.mixed, [area.key for area in case.mixed.areas]
    with idle_schedules():
        proposal = resolve(
            mixed.tracks, mixed.areas, case.scene, within_s=WITHIN_S, limit_s=5.0, movable=movable, round_s=60.0
        )
    return claims_of_resolve(case, proposal, movable)


def claims_of_resolve(case: Case, proposal: Proposal, movable: Collection[str] = ()) -> Finding:
    """Check a proposal by moving all its plans and solving again: plans meet something if they are left, only.

    movable : areas that may move, which are checked as well
    """
    finding = Finding()
    scene = replace(case.scene, nearest_m=0.0)
    moves = {move.key: move for move in proposal.moves}
    left = {one.key for one in proposal.left}
    tracks = [moved(scene, track, moves[track.key]) if track.key in moves else track for track in case.mixed.tracks]
    areas = [
        later(area, round(1e6 * moves[area.key].delay_s)) if area.key in moves else area for area in case.mixed.areas
    ]
    # Rounding decides whether shapes that only touch are reported.
    after = {
        pair: row
        for pair, row in solved(tracks, areas, scene).items()
        if case.has_fixed_plane or row.verdict is not Verdict.GRAZING
    }
    concerned = {key for pair, row in case.rows.items() if row.verdict is not Verdict.NEAR for key in pair}
    for key in (one.key for one in tracks if one.departures_us is not None or one.schedule is not None):
        finding.check(key not in moves, f"{key} moves, although its voyages repeat")
        is_noted = any(f"track {key!r} stays as planned" in note for note in proposal.notes)
        finding.check(is_noted == (key in concerned), f"{key} is in conflict and stays, or not: {proposal.notes}")
    for key in [*(track.key for track in tracks), *movable]:
        met = [*only_of(after, {key})]
        if case.has_fixed_plane or met:
            problem = f"{key} meets {met} after the proposal, is left: {key in left}"
            finding.check(bool(met) == (key in left), problem)
    new = after.keys() - case.rows.keys()
    finding.check(not new, f"{new} are new after the proposal")
    return finding


def chances_in_memory(case: Case) -> Finding:
    """`chances` of one track with three departures: each bound contains the share of departures in conflict."""
    track = case.single_track()
    delays_s = [0.0, 240.0, -600.0]
    with idle_schedules():
        answer = chances(case.mixed.tracks, case.mixed.areas, case.scene, {track.key: delays_s})
    met = [case.met_after(later(track, round(1e6 * by_s))) for by_s in delays_s]
    finding = Finding()
    keys = {one.key for one in case.mixed.objects} - {track.key}
    for other in sorted(keys):
        share = sum(other in some for some in met) / len(met)
        pair = next((p for p in ((track.key, other), (other, track.key)) if p in answer.pairs), None)
        low, high = answer.pairs[pair] if pair else (0.0, 0.0)
        if share or pair:
            finding.check(
                low - 1e-9 <= share <= high + 1e-9,
                f"{track.key} meets {other} with probability {share}, not from {low} to {high}",
            )
    return finding


MEMORY_PATHS: Final = {
    "solve, other order": other_order,
    "GeoDataFrames": frames,
    "Index": index,
    "delays": delays_in_memory,
    "delays of an area": area_delays_in_memory,
    "delays at a waypoint": waits_in_memory,
    "speeds": speeds_in_memory,
    "detours": detours_in_memory,
    "resolve": resolve_in_memory,
    "resolve with ways": resolve_with_ways,
    "resolve with areas": resolve_with_areas,
    "chances": chances_in_memory,
}
