"""The changes that are forbidden to plans, and the least that are not, from the differences of all of them at once."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from conflictdb.core.delays import LAST_INSTANT, Differences, Leeway, Spans, sorted_keys
from conflictdb.core.to_results import moment_of
from conflictdb.model.results import Delays, Forbidden

_Ints: TypeAlias = NDArray[np.int64]
# The changes of all plans together, side by side, fit into this many.
_MOST: Final = 2**61


class Answer(NamedTuple):
    """What is forbidden to a plan, in the units of its differences.

    forbidden : both ends of each interval, how far outside of what is proven each end lies, whether all between these
        is proven, and the keys of the objects that forbid it
    later, earlier : the nearest change, from the planned one on or back, that is not forbidden, rounded away from the
        conflict; None: none that is possible
    blocked_by : the keys of the objects that forbid every possible change
    """

    forbidden: list[tuple[int, int, int, int, bool, tuple[str, ...]]]
    later: int | None
    earlier: int | None
    blocked_by: tuple[str, ...]


def answers(
    keys: Mapping[int, str],
    found: Differences,
    plan: _Ints,
    limits: tuple[int, int],
    planned: int,
    first: _Ints,
    last: _Ints,
) -> Iterator[Answer]:
    """Yield the answers of n plans.

    keys : of objects by number
    found, plan : differences (m,), and the plan of each, from 0
    limits : the least and the greatest change of the question
    planned : the change that is none
    first, last : (n,) the least and the greatest change that is possible for each plan
    """
    least, most = limits
    # A plan's changes and one unit at both ends, and a gap: intervals of two plans do not touch.
    room = most - least + 4
    at_once = max(_MOST // room, 1)
    for begin in range(0, len(first), at_once):
        some = slice(begin, begin + at_once)
        rows = np.flatnonzero((plan >= begin) & (plan < begin + at_once))
        given = found.take(rows), plan[rows] - begin, limits, room, planned
        yield from _side_by_side(keys, *given, first[some], last[some])


def _side_by_side(
    keys: Mapping[int, str],
    found: Differences,
    plan: _Ints,
    limits: tuple[int, int],
    room: int,
    planned: int,
    first: _Ints,
    last: _Ints,
) -> Iterator[Answer]:
    """Yield the answers of n plans, whose changes are `room` apart."""
    least, most = limits
    shift = plan * room + (LAST_INSTANT - least)
    low, high = np.clip(found.low, least, most + 1), np.clip(found.high, least - 1, most)
    outer = Spans.union(low + shift, high + shift)
    inner_low = np.clip(found.inner_low, least - LAST_INSTANT, most + LAST_INSTANT + 1)
    inner_high = np.clip(found.inner_high, least - LAST_INSTANT - 1, most + LAST_INSTANT)
    inner = Spans.union(inner_low + shift, inner_high + shift)
    is_left = inner.high - inner.low >= 2 * LAST_INSTANT
    inner = Spans(inner.low[is_left] + LAST_INSTANT, inner.high[is_left] - LAST_INSTANT)
    of_plan = outer.low // room
    back = of_plan * room + (LAST_INSTANT - least)
    begin, end = np.searchsorted(inner.low, outer.low), np.searchsorted(inner.low, outer.high, side="right")
    proven_low, proven_high = outer.high.copy(), outer.low.copy()
    has_proven = end > begin
    proven_low[has_proven], proven_high[has_proven] = inner.low[begin[has_proven]], inner.high[end[has_proven] - 1]
    intervals = zip(
        (outer.low - back).tolist(),
        (outer.high - back).tolist(),
        (proven_low - outer.low).tolist(),
        (outer.high - proven_high).tolist(),
        (end - begin == 1).tolist(),
        _by(keys, found.other, outer, low + shift, low <= high),
        strict=True,
    )
    n = np.arange(len(first))
    planned_at = n * room + (LAST_INSTANT - least + planned)
    k = np.searchsorted(outer.low, planned_at, side="right") - 1
    later, earlier = np.full(len(n), planned), np.full(len(n), planned)
    in_conflict = np.flatnonzero(k >= 0)
    in_conflict = in_conflict[outer.high[k[in_conflict]] >= planned_at[in_conflict]]
    of = k[in_conflict]
    later[in_conflict], earlier[in_conflict] = outer.high[of] - back[of] + 1, outer.low[of] - back[of] - 1
    blocked = _blocked(keys, found, plan, first, last)
    own = np.searchsorted(of_plan, np.append(n, len(n)))
    every = list(intervals)
    for row, (start, stop, least_later, least_earlier, is_later, is_earlier) in enumerate(
        zip(
            own[:-1].tolist(),
            own[1:].tolist(),
            later.tolist(),
            earlier.tolist(),
            (later <= last).tolist(),
            (earlier >= first).tolist(),
            strict=True,
        )
    ):
        nearest = least_later if is_later else None, least_earlier if is_earlier else None
        yield Answer(every[start:stop], *nearest, blocked.get(row, ()))


def _by(
    keys: Mapping[int, str], other: _Ints, outer: Spans, low: _Ints, is_there: NDArray[np.bool_]
) -> list[tuple[str, ...]]:
    """Return the keys of the objects that forbid each interval, in order.

    low : (m,) where the difference with each object begins; only those that are there belong to an interval
    """
    others, number = np.unique(other[is_there], return_inverse=True)
    names = [keys[one] for one in others.tolist()]
    order = sorted(range(len(names)), key=lambda one: names[one].encode())
    rank = np.empty(len(names), np.int64)
    rank[order] = np.arange(len(names))
    interval = np.searchsorted(outer.low, low[is_there], side="right") - 1
    pairs = np.unique(interval * max(len(names), 1) + rank[number])
    interval, ranks = np.divmod(pairs, max(len(names), 1))
    in_order = [names[one] for one in order]
    every = [in_order[one] for one in ranks.tolist()]
    bounds = np.searchsorted(interval, np.arange(len(outer) + 1)).tolist()
    return [tuple(every[start:stop]) for start, stop in pairwise(bounds)]


def _blocked(
    keys: Mapping[int, str], found: Differences, plan: _Ints, first: _Ints, last: _Ints
) -> dict[int, tuple[str, ...]]:
    """Return the keys of the objects that forbid every possible change of a plan, of those that have any."""
    at_first, at_last = found.low <= first[plan], found.high >= last[plan]
    both = np.intersect1d(plan[at_first], plan[at_last])
    rows = np.flatnonzero(np.isin(plan, both))
    rows = rows[np.argsort(plan[rows], kind="stable")]
    bounds = np.searchsorted(plan[rows], np.append(both, len(first))).tolist()
    blocked = {}
    for one, (start, stop) in zip(both.tolist(), pairwise(bounds), strict=True):
        blocking = found.take(rows[start:stop]).blocking(int(first[one]), int(last[one]))
        if blocking:
            blocked[one] = sorted_keys(keys, blocking)
    return blocked


def delays_of_each(
    names: Sequence[str],
    keys: Mapping[int, str],
    found: Differences,
    plan: _Ints,
    horizon_us: int,
    leeways: Sequence[Leeway],
    margins: tuple[float, float] = (0.0, 0.0),
) -> list[Delays]:
    """Return the delays of n plans.

    names : (n,) their keys
    keys : of objects by number
    found, plan : differences (m,), and the plan of each, from 0
    margins : wanted on top of the required separations, seconds and metres
    """
    first = np.array([one.first_us for one in leeways], np.int64)
    last = np.array([one.last_us for one in leeways], np.int64)
    every = answers(keys, found, plan, (-horizon_us, horizon_us), 0, first, last)
    return [
        Delays(
            name,
            tuple(
                [
                    Forbidden(low / 1e6, high / 1e6, from_error / 1e6, to_error / 1e6, is_proven, by)
                    for low, high, from_error, to_error, is_proven, by in one.forbidden
                ]
            ),
            None if one.later is None else one.later / 1e6,
            None if one.earlier is None else -one.earlier / 1e6,
            one.blocked_by,
            leeway.waits,
            leeway.has_departed,
            leeway.first_us / 1e6,
            leeway.last_us / 1e6,
            departs_at=moment_of(leeway.departs_us),
            margin_s=margins[0],
            margin_m=margins[1],
        )
        for name, one, leeway in zip(names, every, leeways, strict=True)
    ]


def delays_of(key: str, keys: Mapping[int, str], found: Differences, horizon_us: int, leeway: Leeway) -> Delays:
    """Return the delays of a plan; found: its differences alone, perhaps none."""
    [own] = delays_of_each([key], keys, found, np.zeros(len(found.low), np.int64), horizon_us, [leeway])
    return own
