"""Clear objects in memory: who may move, the least delays, speeds for the rest, verified and explained."""

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, tzinfo
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from conflictdb.core import moving_plans
from conflictdb.core.delays import differences_of, start_of
from conflictdb.core.near import Memory
from conflictdb.core.to_results import moment_of
from conflictdb.core.world import Reach
from conflictdb.errors import ConflictDBError, InvalidInput
from conflictdb.memory import questions
from conflictdb.memory.area_places import nearest_place
from conflictdb.memory.detours import rerouted, ways_of
from conflictdb.memory.index import Index
from conflictdb.memory.least import Solution, least
from conflictdb.memory.passing import moves_of
from conflictdb.memory.program import Program, chain_of
from conflictdb.memory.rounding import rounded_delays
from conflictdb.memory.yielding import levels_of, yielding_areas
from conflictdb.model import inputs
from conflictdb.model.clock import Clock
from conflictdb.model.margin import Margin
from conflictdb.model.methods import Method
from conflictdb.model.plans import MINUS_INFINITY_US, Area, Scene, Track, is_by_legs
from conflictdb.model.proposals import Goal, Left, Move, NewPlace, NewWaypoints, Proposal
from conflictdb.model.recurring_plans import later, require_one_voyage
from conflictdb.model.units import Units

_Ints = NDArray[np.int64]
Pairs = frozenset[tuple[str, str]]

# As of requests for delays: longer than a plan of this kind.
_LONGEST_S: Final = 1e7
_MOST_LEVEL: Final = 1_000_000
# A solver keeps its numbers to some digits: costs must not differ by more.
_LEAST_WEIGHT: Final = 1e-6
_MOST_WEIGHT: Final = 1e6
# Reasons of tracks for which `detours` has ways that a proposal cannot store.
_AS_FAST: Final = "keeps its speed: its tolerances contain other speeds already"
_REPEATED: Final = "stays as planned: its voyages repeat"
_AREA_REPEATED: Final = "stays as planned: its times follow a schedule"
_UNCHANGED: Final = "gets no new waypoints: its size, heights or tolerances are given by leg or waypoint (`detours`)"


@dataclass(frozen=True, slots=True)
class ProposalLimits:
    """What a proposal may change, checked.

    within_us, now_us, slowest, fastest, aside_m, goal, limit_s : as of `resolve`, in microseconds
    margin : of `margin_s` and `margin_m`
    units : of `units`
    clock : of `round_s` and `time_zone`
    """

    within_us: int
    now_us: int | None
    slowest: float
    fastest: float
    aside_m: float
    goal: Goal
    limit_s: float
    margin: Margin
    clock: Clock
    units: Units

    @classmethod
    def of(
        cls,
        within_s: Any,
        now: inputs.Instant | None,
        slowest: Any,
        fastest: Any,
        aside_m: Any,
        goal: Any,
        limit_s: Any,
        margin_s: Any,
        margin_m: Any,
        round_s: Any,
        time_zone: tzinfo,
        units: Any,
    ) -> "ProposalLimits":
        """Return the limits. Raises InvalidInput."""
        within_s = inputs.seconds("resolve", "within_s", within_s)
        if within_s > _LONGEST_S:
            raise InvalidInput("resolve", "within_s", f"must be at most {_LONGEST_S:g} s; got {within_s!r}")
        now_us = None if now is None else (inputs.moment("resolve", "now", now) - inputs.EPOCH) // inputs.MICROSECOND
        if goal not in list(Goal):
            raise InvalidInput("resolve", "goal", f"must be one of {', '.join(Goal)}; got {goal!r:.20}")
        factors = questions.limits(slowest, fastest)
        aside_m = inputs.reach_m("resolve", "aside_m", aside_m)
        limit_s = inputs.seconds("resolve", "limit_s", limit_s)
        margin = Margin.of("resolve", margin_s, margin_m)
        if not isinstance(time_zone, tzinfo):
            raise InvalidInput(
                "resolve", "time_zone", f"must be a time zone, such as a ZoneInfo; got {time_zone!r:.60}"
            )
        clock = Clock(time_zone, round(1e6 * inputs.seconds("resolve", "round_s", round_s)))
        if units not in list(Units):
            raise InvalidInput("resolve", "units", f"must be one of {', '.join(Units)}; got {units!r:.60}")
        return cls(round(1e6 * within_s), now_us, *factors, aside_m, Goal(goal), limit_s, margin, clock, Units(units))

    def of_delays(self, plan: Area | Track) -> tuple[int, int]:
        """Return the least and the greatest delay of a plan."""
        if self.now_us is None:
            return 0, self.within_us
        ahead_us = (start_of(plan) if isinstance(plan, Area) else int(plan.times_us[0])) - self.now_us
        return (0, 0) if ahead_us < 0 else (-min(self.within_us, ahead_us), self.within_us)


def resolve(
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None = None,
    *,
    keys: Collection[str] | None = None,
    keep: Collection[str] = (),
    weights: Mapping[str, float] | None = None,
    levels: Mapping[str, int] | None = None,
    within_s: float = 7200.0,
    now: inputs.Instant | None = None,
    slowest: float = 1.0,
    fastest: float = 1.0,
    aside_m: float = 0.0,
    goal: Goal | str = Goal.TOTAL,
    limit_s: float = 30.0,
    movable: Collection[str] = (),
    margin_s: float = 0.0,
    margin_m: float = 0.0,
    round_s: float = 0.0,
    time_zone: tzinfo = UTC,
    units: Units | str = Units.NAUTICAL,
) -> Proposal:
    """Return the least changes of departures that clear a scene, verified by a detection of the whole changed scene.

    A delay shifts a whole plan: nothing of it is there before, and nothing after. Areas stay unless they are
    `movable`, and the method is `exact`. Of two tracks the one moves that a separation rule says yields
    (`Rule.yields`); the other one moves only if no delay clears the first. As few plans as possible are left in
    conflict, and the others have the least delays. Within the time limit the answer may be worse than that: `bound_s`
    is a proven bound. It is never worse than first come, first served.

    Raises the errors of `solve`, and InvalidInput for unknown keys and for limits that are none.

    Parameters
    ----------
    keys : collection of str, optional
        The tracks that may move; by default those in conflict.
    keep : collection of str
        Objects that stay as planned.
    weights : mapping of str to float, optional
        Cost of a second of a track, from 1e-6 to 1e6; by default 1.
    levels : mapping of str to int, optional
        Priority of tracks, by default 0: tracks of a higher level are placed first, those below yield to them.
    within_s : float
        The longest delay, seconds.
    now : instant, optional
        Plans that begin later may also begin earlier than planned, but not before it; plans that have begun stay.
    slowest, fastest : float
        Tracks that no delay clears go at another speed, from `slowest` to `fastest` times the planned one; by default
        none does.
    aside_m : float
        Movable areas that no time clears go up to this far aside, at their true size: the least whole number of tenths
        of a nautical mile, or kilometre, on one of eight bearings. Tracks that neither clears get one or two new
        waypoints on a leg, up to this far aside of it, and arrive at most `within_s` later; by default none does.
        Their size and heights must not change on the way.
    goal : str
        ``total``, the sum of all delays, or ``largest``.
    limit_s : float
        Time for the proof, seconds.
    movable : collection of str
        The areas that may move if they are in conflict: in time, and with `aside_m` in place; by default none.
    margin_s, margin_m : float
        Wanted on top of the required separations in time and in distance: plans that come nearer are in conflict here.
    round_s : float
        Delays are rounded away from 0, so that departures are whole multiples of so many seconds since midnight, and
        checked again; by default they are exact. `is_least` and `bound_s` are those before.
    time_zone : tzinfo
        Whose midnight.
    units : str
        ``nautical`` or ``metric``: which unit an area goes aside by tenths of.
    """
    given = (within_s, now, slowest, fastest, aside_m, goal, limit_s, margin_s, margin_m, round_s, time_zone, units)
    limits = ProposalLimits.of(*given)
    areas = questions.each("resolve", "areas", areas, Area)
    scene = limits.margin.added_to(questions.scene_of("resolve", scene))
    if isinstance(movable, str):
        raise InvalidInput("resolve", "movable", f"must be a list of keys; got the text {movable!r:.60}")
    setup, pieces, key_of, known, areas = questions.numbered_with_areas(
        "resolve", tracks, areas, scene, Reach(limits.within_us, limits.within_us, limits.slowest), set(movable)
    )
    scene = replace(setup.scene, method=Method.EXACT, nearest_m=0.0)
    planned = {track.key: track for track in known}
    of_areas = {area.key: area for area in areas}
    weights, levels = dict(weights or {}), dict(levels or {})
    _check(scene, planned, of_areas, keys, keep, weights, levels, movable)
    plans: dict[str, Area | Track] = {**planned, **{key: of_areas[key] for key in movable}}
    number_of = {key: number for number, key in key_of.items()}
    before = conflicts(planned.values(), areas, scene)
    concerned = {key for pair in before for key in pair if key in plans}
    # A proposal moves one voyage.
    repeated = {key for key, plan in plans.items() if _repeats(plan)}
    chosen = concerned if keys is None else {*keys, *(concerned & set(movable))}
    moving = sorted(chosen - set(keep) - repeated, key=str.encode)
    numbers = np.array([number_of[key] for key in moving], np.int64)
    low, high = np.array([limits.of_delays(plans[key]) for key in moving], np.int64).reshape(-1, 2).T
    most_us = int(high.max(initial=0) - low.min(initial=0)) + 1
    found = differences_of(setup.under(scene), Memory(pieces), numbers, most_us, waits=None, moves_areas=bool(movable))
    weight = np.array([weights.get(key, 1.0) for key in moving])
    program = Program.of(found, numbers, low, high, weight)
    classes = [plans[key].object_class for key in moving]
    kinds = ["area" if key in of_areas else "track" for key in moving]
    level = levels_of(program, np.array([levels.get(key, 0) for key in moving], np.int64), classes, kinds, scene.rules)
    departs = [questions.departure_us(plans[key], None) for key in moving]
    begins = np.array([MINUS_INFINITY_US if at is None else at for at in departs], np.int64)
    solution = place(program, np.argsort(begins, kind="stable").tolist(), level, limits.goal, limits.limit_s)
    exact = dict(zip(moving, solution.delays.tolist(), strict=True))
    placed = rounded_delays(program, solution.delays, departs, limits.clock)
    if (placed != solution.delays).any():
        solution = replace(solution, delays=placed, objective_s=program.cost(placed, limits.goal))
    delays = {key: int(us) for key, us in zip(moving, solution.delays.tolist(), strict=True) if us}
    changed = planned | {key: later(planned[key], us) for key, us in delays.items() if key in planned}
    areas = [later(area, delays[area.key]) if area.key in delays else area for area in areas]
    rest = {moving[i] for i in solution.left}
    speeds = _speeds(scene, changed, areas, sorted(rest & planned.keys(), key=str.encode), limits)
    changed |= {key: at_speed(planned[key], factor) for key, factor in speeds.items()}
    unkept = {key: planned[key] for key in (concerned & planned.keys()) - set(keep) - repeated}
    fixed = {key: area for key, area in of_areas.items() if key not in plans}
    notes = yielding_areas(before, unkept, fixed, scene.rules)
    for key in sorted(concerned & repeated - set(keep), key=str.encode):
        if key not in of_areas:
            notes.append(f"track {key!r} {_REPEATED}")
        elif not limits.aside_m:
            notes.append(f"area {key!r} {_AREA_REPEATED}")
    stuck = sorted((rest & planned.keys()) - speeds.keys(), key=str.encode)
    if not limits.slowest == limits.fastest == 1.0:
        notes += [f"track {key!r} {_AS_FAST}" for key in stuck if planned[key].tolerances is not None]
    if limits.aside_m > 0.0:
        notes += [f"track {key!r} {_UNCHANGED}" for key in stuck if is_by_legs(planned[key])]
    ways = _ways(scene, changed, areas, stuck, limits)
    changed |= {key: rerouted(scene, planned[key], way) for key, way in ways.items()}
    fixed_times = {key for key in concerned & repeated & set(movable) - set(keep) if key in of_areas}
    places = _places(scene, changed, areas, sorted((rest & of_areas.keys()) | fixed_times, key=str.encode), limits)
    areas = [_elsewhere(scene, area, places[area.key]) if area.key in places else area for area in areas]
    after = conflicts(changed.values(), areas, scene)
    _verify(before, after, {*moving, *places} - (rest - speeds.keys() - ways.keys() - places.keys()))
    blocked = {moving[i]: _blocking(program, numbers, solution, i, found, key_of) for i in solution.left}
    still = sorted({key for pair in after for key in pair if key in plans}, key=str.encode)
    left = [Left(key, blocked.get(key) or _met(after, key)) for key in still]
    leaves = zip(moving, departs, strict=True)
    departs_at = {key: moment_of(at + delays.get(key, 0)) for key, at in leaves if at is not None}
    moves = moves_of(
        scene, changed, areas, delays, exact, speeds, ways, places, before - after, found, key_of, departs_at
    )
    return Proposal(
        tuple(moves),
        tuple(left),
        limits.goal,
        solution.objective_s,
        solution.bound_s,
        solution.is_least,
        notes=tuple(notes),
        margin_s=limits.margin.time_us / 1e6,
        margin_m=limits.margin.distance_m,
    )


def _repeats(plan: Area | Track) -> bool:
    """Return whether a plan has voyages, or a schedule, that a proposal does not move."""
    return plan.schedule is not None if isinstance(plan, Area) else plan.departures_us is not None


def conflicts(tracks: Iterable[Track], areas: Iterable[Area], scene: Scene) -> Pairs:
    """Return the keys of pairs that interfere or might."""
    return frozenset((one.a_key, one.b_key) for one in questions.solve(tracks, areas, scene))


def at_speed(track: Track, factor: float) -> Track:
    """Return a track at a factor of its planned speed, which departs as planned; whole microseconds."""
    since_us = track.times_us - track.times_us[0]
    times: Any = inputs.all_certain(track.times_us[0] + np.rint(since_us / factor).astype(np.int64))
    return replace(track, times_us=times, max_speed_kn=np.inf)


def moved(scene: Scene, plan: Area | Track, move: Move) -> Area | Track:
    """Return a plan as a move changes it."""
    if isinstance(plan, Area):
        return later(plan, round(1e6 * move.delay_s)) if move.place is None else _elsewhere(scene, plan, move.place)
    if move.detour is not None:
        return rerouted(scene, plan, move.detour)
    return at_speed(plan, move.speed) if move.speed != 1.0 else later(plan, round(1e6 * move.delay_s))


def place(program: Program, order: Sequence[int], level: _Ints, goal: str, limit_s: float) -> Solution:
    """Return the delays of tracks, those of higher levels first.

    order : first come, first served
    level : (n,) priorities
    """
    ends = time.monotonic() + limit_s
    stuck: dict[int, int] = {}
    while more := [i for i, track in enumerate(_narrowed(program, stuck)) if i not in stuck and not track]:
        stuck |= dict.fromkeys(more, 0)
    levels = np.unique(level)[::-1].tolist()
    first: list[Solution] = []
    left = dict(stuck)
    while True:
        delays = dict(left)
        solved: list[Solution] = []
        unplaced: dict[int, int] = {}
        for one in levels:
            mine = [i for i in range(len(program)) if level[i] == one and i not in left]
            below = {i for i in range(len(program)) if i not in delays and i not in mine}
            part, rows = _among(program, delays, below)
            turns = [i for i in order if i in set(rows)]
            at = {row: k for k, row in enumerate(rows)}
            found = least(part, [at[i] for i in turns], goal, max(ends - time.monotonic(), 0.0))
            delays |= {row: int(found.delays[k]) for k, row in enumerate(rows)}
            unplaced |= {rows[k]: 0 for k in found.left}
            solved.append(found)
        first = first or solved
        if not unplaced or len(levels) == 1:
            break
        # The tracks left are in the way of higher levels, too: these are placed again.
        left |= unplaced
    all_delays = np.array([delays[i] for i in range(len(program))], np.int64)
    together = sum if goal == Goal.TOTAL else max
    objective_s = float(together([0.0, *(one.objective_s for one in solved)]))
    bound_s = min(float(together([0.0, *(one.bound_s for one in first)])), objective_s)
    is_least = first is solved and all(one.is_least for one in solved)
    return Solution(all_delays, frozenset({*left, *unplaced}), objective_s, bound_s, is_least)


def _narrowed(program: Program, fixed: Mapping[int, int]) -> list[bool]:
    """Return whether each track has a free delay, given the fixed tracks."""
    rows = [i for i in range(len(program)) if i not in fixed]
    part = program.with_fixed(fixed)
    found = [True] * len(program)
    for k, row in enumerate(rows):
        found[row] = len(part.gaps_of(k)) > 0
    return found


def _among(program: Program, delays: Mapping[int, int], without: set[int]) -> tuple[Program, list[int]]:
    """Return the program of the tracks that have no delays yet, without some, and their rows."""
    kept = [i for i in range(len(program)) if i not in without]
    at = {row: k for k, row in enumerate(kept)}
    part = program.part(np.array(kept, np.int64)).with_fixed({at[i]: us for i, us in delays.items()})
    return part, [i for i in kept if i not in delays]


def _speeds(
    scene: Scene, changed: Mapping[str, Track], areas: list[Area], keys: Iterable[str], limits: ProposalLimits
) -> dict[str, float]:
    """Return the speeds, nearest to the planned one, that clear tracks without a clearing delay, one after another."""
    if limits.slowest == limits.fastest == 1.0:
        return {}
    now, found = dict(changed), {}
    for key in keys:
        begins_us = int(now[key].times_us[0])
        if now[key].tolerances is not None or (limits.now_us is not None and begins_us < limits.now_us):
            continue
        [one] = questions.speeds(now.values(), areas, scene, key, limits.slowest, limits.fastest)
        factors = [factor for factor in (one.slower, one.faster) if factor is not None]
        if factors:
            found[key] = min(factors, key=lambda factor: abs(np.log(factor)))
            now[key] = at_speed(now[key], found[key])
    return found


def _ways(
    scene: Scene, changed: Mapping[str, Track], areas: list[Area], keys: Sequence[str], limits: ProposalLimits
) -> dict[str, NewWaypoints]:
    """Return the shortest detours that are found for tracks that nothing else clears, one track after another."""
    if not (limits.aside_m > 0.0 and keys):
        return {}
    ends = time.monotonic() + limits.limit_s
    index = Index(scene)
    index.put([*areas, *changed.values()])
    prefix = max([*changed, *(area.key for area in areas)], key=len) + "#"
    found = {}
    for key in keys:
        track = changed[key]
        has_begun = limits.now_us is not None and int(track.times_us[0]) < limits.now_us
        if has_begun or is_by_legs(track) or time.monotonic() > ends:
            continue
        index.remove(key)
        if best := ways_of(index, prefix, scene, track, limits.aside_m, limits.within_us / 1e6)[:1]:
            one = best[0]
            found[key] = NewWaypoints(one.leg, one.waypoints_deg, one.longer_m, one.later_s)
            track = one.track
        index.put(track)
    return found


def _places(
    scene: Scene, changed: Mapping[str, Track], areas: list[Area], keys: Sequence[str], limits: ProposalLimits
) -> dict[str, NewPlace]:
    """Return the least shifts of movable areas that no time clears, one area after another."""
    if not (limits.aside_m > 0.0 and keys):
        return {}
    ends = time.monotonic() + limits.limit_s
    index = Index(scene)
    index.put([*areas, *changed.values()])
    found = {}
    for area in (one for one in areas if one.key in keys):
        index.remove(area.key)
        place = nearest_place(index, scene, area, limits.aside_m, ends, limits.units)
        if place is not None:
            found[area.key] = place
        index.put(area if place is None else _elsewhere(scene, area, place))
    return found


def _elsewhere(scene: Scene, area: Area, place: NewPlace) -> Area:
    return cast("Area", moving_plans.moved(area, place.distance_m, place.bearing_deg, scene))


def _verify(before: Pairs, after: Pairs, placed: set[str]) -> None:
    """Raise an error if a conflict is new, or if a placed track keeps a conflict."""
    wrong = sorted(pair for pair in after if pair not in before or placed & set(pair))
    if wrong:
        pair = " and ".join(map(repr, wrong[0]))
        raise ConflictDBError(
            f"resolve: the detection of the changed scene found {len(wrong)} conflicts that should not be there, "
            f"first of {pair}; nothing is proposed. Please report the scene as a bug."
        )


def _blocking(
    program: Program,
    numbers: _Ints,
    solution: Solution,
    i: int,
    found: Any,
    key_of: Mapping[int, str],
) -> tuple[str, ...]:
    """Return the keys of few objects that together forbid each delay of a track, as the plan is."""
    own = found.take(np.flatnonzero(found.track == numbers[i]))
    delay = dict(zip(numbers.tolist(), solution.delays.tolist(), strict=True))
    shift = np.array([delay.get(other, 0) for other in own.other.tolist()], np.int64)
    rows = chain_of((own.low + shift).tolist(), (own.high + shift).tolist(), int(program.low[i]), int(program.high[i]))
    return tuple(sorted({key_of[int(own.other[row])] for row in rows}, key=str.encode))


def _met(after: Pairs, key: str) -> tuple[str, ...]:
    return tuple(sorted({one for pair in after if key in pair for one in pair} - {key}, key=str.encode))


def _check(
    scene: Scene,
    tracks: Mapping[str, Track],
    areas: Mapping[str, Area],
    keys: Collection[str] | None,
    keep: Collection[str],
    weights: Mapping[str, float],
    levels: Mapping[str, int],
    movable: Collection[str],
) -> None:
    """Raise InvalidInput for unknown keys, and for weights and levels that are none."""
    who, every = f"scene {scene.name!r}", {*tracks, *areas}
    for key in movable:
        if key not in areas:
            problem = "is a track, which moves anyway" if key in tracks else "is not known"
            raise InvalidInput(who, "movable", f"{key!r} {problem}")
    for name, given in (("keys", keys or ()), ("keep", keep)):
        if isinstance(given, str):
            raise InvalidInput("resolve", name, f"must be a list of keys; got the text {given!r:.60}")
    require_one_voyage("resolve", "keys", [tracks[key] for key in keys or () if key in tracks])
    for key in [*(keys or ()), *weights, *levels]:
        if key not in tracks and key not in movable:
            problem = "is an area, and moves only if it is movable" if key in every else "is not known"
            raise InvalidInput(who, "track", f"{key!r} {problem}")
    for key in keep:
        if key not in every:
            raise InvalidInput(who, "object", f"{key!r} is not known")
    for key, weight in weights.items():
        if not (inputs.is_number(weight) and _LEAST_WEIGHT <= weight <= _MOST_WEIGHT):
            rule = f"must be a number from {_LEAST_WEIGHT:g} to {_MOST_WEIGHT:g}; got {weight!r:.20}"
            raise InvalidInput("resolve", f"weights[{key!r}]", rule)
    for key, level in levels.items():
        if isinstance(level, bool) or not isinstance(level, int | np.integer) or abs(int(level)) > _MOST_LEVEL:
            rule = f"must be a whole number from -{_MOST_LEVEL} to {_MOST_LEVEL}; got {level!r:.20}"
            raise InvalidInput("resolve", f"levels[{key!r}]", rule)
