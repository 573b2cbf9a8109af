"""How likely conflicts are if departures and speeds are uncertain, all of them independent: bounds on either side.

The factors of time of both plans are divided into cells. Within a cell the differences of departure in contact lie
between bounds that are linear in each factor (`contacts_at_speeds`), so that the probability is bounded by the values
at the corners. Where the distribution of differences has a second derivative, the expectations of the bounds say more:
to half of it times the variance. Cells whose bounds are apart are halved, as long as the budget lasts.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import Track
from conflictdb.stages.at_any_time import AnyTime
from conflictdb.stages.chances import (
    AS_FAST,
    AT_ONCE,
    LEAST_PARTS,
    PLANNED,
    ROUNDING,
    Bounds,
    Budget,
    Found,
    Uncertain,
    atoms_of,
    bend,
    difference_within,
    outward,
)
from conflictdb.stages.contacts_at_speeds import Meeting, Pace, meetings_of

# Bounds of a probability are this near each other, or their cells are this many. Tighter, more: slower.
_AIM: Final = 1e-7
_MOST_CELLS: Final = 20_000
# The cells of all that a track may meet, together; and those of the speed of each.
_MOST_OF_TRACK: Final = 100_000
_OF_RIVAL: Final = 16
# A part of a cell costs as much as this number of values of a distribution, besides those that it computes; and a call
# for all cells does, for each part. The most rounds in which cells are halved.
_PART_VALUES: Final = 30
_VALUES: Final = 4
_CALL_VALUES: Final = 5_000
_MOST_ROUNDS: Final = 200
# Cells are not halved below this probability in either direction.
_LEAST_RANK: Final = 1e-13
# More than means of cells are rounded by, relative to the range.
_ROUNDED: Final = 1e-9


@dataclass(frozen=True, slots=True)
class UncertainPlan:
    """The departure of a track, seconds after the planned one, and its speed, by the planned one: both uncertain."""

    departure: Uncertain
    speed: Uncertain

    @property
    def tail(self) -> float:
        """The probability that either is beyond its limits."""
        return self.departure.tail + self.speed.tail


# Of n cells: bounds of the probability given each, and the sizes (n, 2) of each in both directions.
_Evaluated = tuple[Floats, Floats, Floats]


def chance_of_meeting(a: UncertainPlan, b: UncertainPlan, meeting: Meeting, budget: Budget) -> Bounds:
    """Return bounds on the probability that a track meets another object."""
    curved, parts, share = bend(a.departure, b.departure), len(meeting.parts), budget.share()
    is_certain = a.speed.low == a.speed.high and b.speed.low == b.speed.high
    of_part = share // (_VALUES * parts)
    groups = max(of_part // (1 if is_certain else _MOST_CELLS), math.isqrt(of_part), LEAST_PARTS)
    groups = min(groups, atoms_of(a.departure, b.departure))

    def evaluate(ranks: Floats) -> _Evaluated:
        i, j = _times(a.speed, ranks[:, 0]), _times(b.speed, ranks[:, 1])
        corners = _corners(i, j)
        shares = _share(a.speed, ranks[:, 0], i), _share(b.speed, ranks[:, 1], j)
        most = np.zeros(len(ranks))
        for cells, low, high in _united(*meeting.outer(*corners), is_inner=False):
            most[cells] += np.minimum(
                difference_within(a.departure, b.departure, low.min(axis=1), high.max(axis=1), groups, is_most=True),
                difference_within(
                    a.departure,
                    b.departure,
                    _expected(low, shares, cells)[0],
                    _expected(high, shares, cells)[1],
                    groups,
                    is_most=True,
                )
                + _error(curved, low, high),
            )
        least = np.zeros(len(ranks))
        for cells, low, high in _united(*meeting.inner(*corners), is_inner=True):
            least[cells] += np.maximum(
                difference_within(a.departure, b.departure, low.max(axis=1), high.min(axis=1), groups, is_most=False),
                difference_within(
                    a.departure,
                    b.departure,
                    _expected(low, shares, cells)[1],
                    _expected(high, shares, cells)[0],
                    groups,
                    is_most=False,
                )
                - _error(curved, low, high),
            )
        sizes = np.column_stack([np.ptp(i, axis=1) * meeting.lasts_s[0], np.ptp(j, axis=1) * meeting.lasts_s[1]])
        return np.minimum(least, 1.0), np.minimum(most, 1.0), sizes

    cost = _Cost(parts, parts * (_PART_VALUES + _VALUES * groups), parts * _CALL_VALUES)
    least, most, values = _integral(evaluate, _MOST_CELLS, cost, share)
    budget.spend(values)
    return outward(least, most, a.tail + b.tail)


@dataclass(frozen=True, slots=True)
class RivalAtSpeed:
    """What a track may meet; is_first: the meeting has it as the other object."""

    plan: UncertainPlan
    meeting: Meeting
    is_first: bool

    @property
    def cells(self) -> int:
        """The number of cells of its speed."""
        return 1 if self.plan.speed.low == self.plan.speed.high else _OF_RIVAL


def chance_of_any(
    track: UncertainPlan, rivals: list[RivalAtSpeed], pairs: list[Bounds], tail: float, budget: Budget
) -> Bounds:
    """Return bounds on the probability that a track meets any of some objects.

    Given its delay and its speed, conflicts are independent.

    pairs : the bounds of each
    tail : the probability that something is beyond its limits
    """
    lasts_s = max((one.meeting.lasts_s[0 if one.is_first else 1] for one in rivals), default=0.0)

    def evaluate(ranks: Floats) -> _Evaluated:
        delay = _values(track.departure, ranks[:, 0])
        own = _times(track.speed, ranks[:, 1])
        free = np.ones((2, len(ranks)))
        for rival in rivals:
            # Each cell with each cell of the speed of the rival.
            count = rival.cells
            edges = np.arange(count + 1) / count
            others = np.tile(_times(rival.plan.speed, np.column_stack([edges[:-1], edges[1:]])), (len(ranks), 1))
            delays, owns = np.repeat(delay, count, axis=0), np.repeat(own, count, axis=0)
            met = _met(rival, delays, *((owns, others) if rival.is_first else (others, owns)))
            met = met.reshape(2, len(ranks), count).mean(axis=2)
            free *= 1.0 - np.minimum(met, 1.0)
        sizes = np.column_stack([np.ptp(delay, axis=1), np.ptp(own, axis=1) * lasts_s])
        return 1.0 - free[0], 1.0 - free[1], sizes

    if not rivals:
        return 0.0, min(tail, 1.0)
    parts = [len(one.meeting.parts) for one in rivals]
    rows = [one.cells * count for one, count in zip(rivals, parts, strict=True)]
    cost = _Cost(max(rows), _PART_VALUES * sum(rows), _CALL_VALUES * sum(parts))
    most_cells = max(_MOST_OF_TRACK // len(rivals) // _OF_RIVAL, 64)
    least, most, values = _integral(evaluate, most_cells, cost, budget.share())
    budget.spend(values)
    least, most = outward(least, most, tail)
    return max(least, *(low for low, _ in pairs)), min(most, sum(high for _, high in pairs) + tail)


def _met(rival: RivalAtSpeed, delay: Floats, i: Floats, j: Floats) -> Floats:
    """Return bounds (2, n) of the probability that a rival departs when it meets a track, in cells (n, 2)."""
    departure, met = rival.plan.departure, np.zeros((2, len(delay)))
    corners = _corners(i, j)
    for k, of in ((0, rival.meeting.inner), (1, rival.meeting.outer)):
        for cells, low, high in _united(*of(*corners), is_inner=k == 0):
            # The delay of the first minus that of the second lies between low and high.
            if rival.is_first:
                low, high = -high, -low
            first, last = (delay[cells, ::-1] if k == 0 else delay[cells]).T
            begin, end = (low.max(axis=1), high.min(axis=1)) if k == 0 else (low.min(axis=1), high.max(axis=1))
            met[k, cells] += departure.within(first + begin, last + end)
    return met


@dataclass(frozen=True, slots=True)
class _Cost:
    """The rows of arrays that a cell takes, and the values that a cell and a call for all cells cost."""

    rows: int
    of_cell: int
    of_call: int


def _integral(
    evaluate: Callable[[Floats], _Evaluated], most_cells: int, cost: _Cost, most_values: int
) -> tuple[float, float, int]:
    """Return bounds on the mean of a probability over all ranks of two quantities, (0, 1) each; and their cost."""
    at_once = max(AT_ONCE // (4 * cost.rows), 1)
    ranks = np.array([[[0.0, 1.0], [0.0, 1.0]]])
    least, most, sizes = evaluate(ranks)
    values = cost.of_call + cost.of_cell
    for done in range(_MOST_ROUNDS + 1):
        widths = np.ptp(ranks, axis=2)
        mass = widths.prod(axis=1)
        gap = mass * (most - least)
        can = (sizes > 0.0) & (widths > _LEAST_RANK)
        chosen = np.flatnonzero(can.any(axis=1) & (gap > 0.5 * _AIM / len(gap)))
        room = min(most_cells - len(gap), (most_values - values - cost.of_call) // (2 * cost.of_cell))
        if gap.sum() <= _AIM or room <= 0 or not chosen.size or done == _MOST_ROUNDS:
            break
        chosen = chosen[np.argsort(-gap[chosen], kind="stable")[:room]]
        direction = np.where(can[chosen], sizes[chosen], -1.0).argmax(axis=1)
        halves, every = np.repeat(ranks[chosen], 2, axis=0), np.arange(len(chosen))
        middle = ranks[chosen][every, direction].mean(axis=1)
        halves[2 * every, direction, 1] = halves[2 * every + 1, direction, 0] = middle
        kept = np.setdiff1d(np.arange(len(gap)), chosen)
        values += cost.of_call + len(halves) * cost.of_cell
        some = [evaluate(halves[at : at + at_once]) for at in range(0, len(halves), at_once)]
        found = [np.concatenate(columns) for columns in zip(*some, strict=True)]
        ranks = np.concatenate([ranks[kept], halves])
        least, most, sizes = (
            np.concatenate([old[kept], new]) for old, new in zip((least, most, sizes), found, strict=True)
        )
    return float((mass * least).sum()), float((mass * most).sum()), values


def _values(given: Uncertain, ranks: Floats) -> Floats:
    """Return the least and the largest value (n, 2) of ranks (n, 2)."""
    return np.column_stack([given.quantile(ranks[:, 0], is_high=False), given.quantile(ranks[:, 1], is_high=True)])


def _times(speed: Uncertain, ranks: Floats) -> Floats:
    """Return the least and the largest factor of time (n, 2) of the ranks (n, 2) of a speed."""
    return 1.0 / _values(speed, ranks)[:, ::-1]


def _corners(i: Floats, j: Floats) -> tuple[Floats, Floats]:
    """Return both factors (n, 4) at the corners of cells."""
    return i[:, [0, 0, 1, 1]], j[:, [0, 1, 0, 1]]


def _share(speed: Uncertain, ranks: Floats, times: Floats) -> Floats:
    """Return bounds (n, 2) on where between its ends in a cell the mean of a factor of time is, 0 to 1."""
    low, high = _values(speed, ranks).T
    width = np.ptp(times, axis=1)
    mean = np.clip(speed.mean_of(ranks), low, high)
    # 1 / speed is convex: at least its value at the mean, at most its chord there.
    bounds = np.column_stack([1.0 / mean, (low + high - mean) / (low * high)]) - times[:, :1]
    share = bounds / np.where(width > 0.0, width, 1.0)[:, None] + [-_ROUNDED, _ROUNDED]
    return np.clip(share, 0.0, 1.0)


def _expected(values: Floats, shares: tuple[Floats, Floats], cells: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Return bounds on the expectation of what is linear in both factors, from its values (n, 4) at the corners."""
    found = []
    for of_i in shares[0][cells].T:
        for of_j in shares[1][cells].T:
            first = values[:, 0] + of_j * (values[:, 1] - values[:, 0])
            last = values[:, 2] + of_j * (values[:, 3] - values[:, 2])
            found.append(first + of_i * (last - first))
    return np.minimum.reduce(found), np.maximum.reduce(found)


def _error(curved: float, low: Floats, high: Floats) -> Floats:
    """Return the error (n,) of the distribution of differences at the mean of both ends, from their corners (n, 4).

    The variance of a bounded quantity is at most a quarter of the square of its range (T. Popoviciu, 1935).
    """
    if not np.isfinite(curved):
        return np.full(len(low), np.inf)
    return np.asarray(0.125 * curved * (np.ptp(low, axis=1) ** 2 + np.ptp(high, axis=1) ** 2))


def _united(low: Floats, high: Floats, *, is_inner: bool) -> Iterator[tuple[NDArray[np.int64], Floats, Floats]]:
    """Yield intervals whose union contains that of some intervals; is_inner: disjoint ones that lie within it.

    low, high : (parts, n, 4) ends of the intervals at the corners of n cells

    Yields the numbers of cells, and the ends at their corners.
    """
    order = np.argsort(low.mean(axis=2), axis=0)[..., None]
    low, high = np.take_along_axis(low, order, 0), np.take_along_axis(high, order, 0)
    begin, end = low[0].copy(), high[0].copy()
    for first, last in zip(low[1:], high[1:], strict=True):
        if is_inner:
            joins = (first <= end).all(axis=1)
            first = np.maximum(first, end)
            further = joins & (last.mean(axis=1) > end.mean(axis=1))
            end[further] = last[further]
            opens = np.flatnonzero(~joins & (first <= last).all(axis=1))
        else:
            joins = (first <= end).any(axis=1)
            begin[joins], end[joins] = np.minimum(begin, first)[joins], np.maximum(end, last)[joins]
            opens = np.flatnonzero(~joins)
        if opens.size:
            yield from _kept(opens, begin[opens], end[opens], is_inner)
            begin[opens], end[opens] = first[opens], last[opens]
    yield from _kept(np.arange(len(begin)), begin, end, is_inner)


def _kept(
    cells: NDArray[np.int64], low: Floats, high: Floats, is_inner: bool
) -> Iterator[tuple[NDArray[np.int64], Floats, Floats]]:
    some = np.flatnonzero((low <= high).all(axis=1) | (not is_inner))
    if some.size:
        yield cells[some], low[some], high[some]


def chances_at_speeds(
    setup: Setup,
    placed: AnyTime,
    tracks: Mapping[int, Track],
    plans: Mapping[int, UncertainPlan],
    tail: float,
) -> Found:
    """Return the chances of pairs and tracks; tracks, plans: by number."""
    paces = {
        number: Pace(
            int(tracks[number].times_us[0]),
            float(tracks[number].times_us[-1] - tracks[number].times_us[0]) / 1e6,
            (plan.departure.low, plan.departure.high),
            (1.0 / plan.speed.high, 1.0 / plan.speed.low),
        )
        for number, plan in plans.items()
    }
    still = UncertainPlan(PLANNED, AS_FAST)
    pairs: dict[tuple[int, int], Bounds] = {}
    rivals: dict[int, list[tuple[RivalAtSpeed, Bounds]]] = {}
    meetings = meetings_of(setup, placed, paces)
    budget = Budget(len(meetings))
    for (a, b), meeting in meetings.items():
        other = plans.get(b, still)
        bounds = chance_of_meeting(plans[a], other, meeting, budget)
        if bounds[1] > tail + ROUNDING:
            pairs[a, b] = bounds
        rivals.setdefault(a, []).append((RivalAtSpeed(other, meeting, is_first=True), bounds))
        if b in plans:
            rivals.setdefault(b, []).append((RivalAtSpeed(plans[a], meeting, is_first=False), bounds))
    budget = Budget(len(rivals))
    return pairs, {
        number: chance_of_any(plans[number], [one for one, _ in some], [bounds for _, bounds in some], tail, budget)
        for number, some in rivals.items()
    }
