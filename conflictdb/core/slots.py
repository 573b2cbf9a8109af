"""Free windows of departures, and what closes the others, from the differences of one track or area."""

from collections.abc import Iterator, Mapping
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from conflictdb.core.delays import Differences, sorted_keys
from conflictdb.core.near import FOREVER_US
from conflictdb.core.to_results import moment_of
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import MAX_INSTANT_US, MIN_INSTANT_US, Area
from conflictdb.model.recurring_plans import spans_of
from conflictdb.model.results import Closed, Delays, Opening, Slot

_Ints = NDArray[np.int64]


def slots_of(delays: Delays, least: int, most: int, best: int | None = None) -> tuple[Slot, ...]:
    """Return the free windows of delays in [least, most], microseconds: nearest to the planned departure first.

    delays : with a departure
    best : the number of windows to return; None: all
    """
    closed = [(round(1e6 * one.from_s), round(1e6 * one.to_s)) for one in delays.forbidden]
    windows, low = [], least
    for first, last in [*closed, (most + 1, most + 1)]:
        if low <= (high := min(first - 1, most)):
            windows.append((low, high))
        low = max(low, last + 1)
    windows.sort(key=lambda window: (max(window[0], -window[1], 0), window[0] - window[1]))
    departs_at = _departure(delays)
    return tuple(Slot(low / 1e6, high / 1e6, *_between(departs_at, low, high)) for low, high in windows[:best])


def closed_of(
    delays: Delays, found: Differences, least: int, most: int, keys: Mapping[int, str], areas: Mapping[int, Area]
) -> tuple[Closed, ...]:
    """Return what closes delays in [least, most], microseconds, in order; each with the same objects throughout.

    found : the differences that `delays` follow from
    keys : the keys of objects by number
    areas : the areas among these, with the activations of their schedules
    """
    departs_at, rows = _departure(delays), []
    for low, high, by in _stretches(found, least, most):
        openings = [_opening(keys[one], areas.get(one), found, one, low, high) for one in by]
        opened_by = tuple(sorted((one for one in openings if one), key=lambda one: one.key))
        if len(opened_by) < len(by):  # each of them closes all of these departures
            opened_by = ()
        between = _between(departs_at, low, high)
        rows.append(Closed(low / 1e6, high / 1e6, *between, sorted_keys(keys, by), opened_by))
    return tuple(rows)


def _stretches(found: Differences, least: int, most: int) -> Iterator[tuple[int, int, list[int]]]:
    """Yield the closed intervals of delays that the same objects forbid, and the numbers of these."""
    low, high = np.maximum(found.low, least), np.minimum(found.high, most)
    rows = np.flatnonzero(low <= high)
    low, high, other = low[rows], high[rows], found.other[rows]
    at = np.concatenate([low, high + 1])
    change = np.repeat([1, -1], len(rows))
    order = np.argsort(at, kind="stable")
    count: dict[int, int] = {}
    since, before = least, frozenset[int]()
    events = zip(at[order].tolist(), change[order].tolist(), np.tile(other, 2)[order].tolist(), strict=True)
    pending = [*events, (most + 1, 0, -1)]
    for k, (now, by, number) in enumerate(pending):
        if by:
            count[number] = count.get(number, 0) + by
        if k + 1 < len(pending) and pending[k + 1][0] == now:
            continue
        present = frozenset(key for key, n in count.items() if n)
        if present == before and now <= most:
            continue
        if before and since < now:
            yield since, now - 1, sorted(before)
        since, before = now, present


def _opening(key: str, area: Area | None, found: Differences, number: int, low: int, high: int) -> Opening | None:
    """Return when an area with one span would have to end, or to start, to close none of these delays."""
    spans = () if area is None else spans_of(area)
    if len(spans) != 1:
        return None
    start_us, end_us = spans[0]
    rows = (found.other == number) & (found.low <= high) & (found.high >= low)
    first, last = int(found.low[rows].min()), int(found.high[rows].max())
    # A span that ends earlier, or starts later, moves this end of what it forbids as much.
    if end_us is not None and last < FOREVER_US:
        ends_us = end_us - (last - low) - 1
        if start_us is None or ends_us > start_us:
            return Opening(key, moment_of(ends_us), None)
    if start_us is not None and first > -FOREVER_US:
        starts_us = start_us + (high - first) + 1
        if end_us is None or starts_us < end_us:
            return Opening(key, None, moment_of(starts_us))
    return None


def _departure(delays: Delays) -> datetime:
    assert delays.departs_at is not None  # noqa: S101
    return delays.departs_at


def _between(departs_at: datetime, low: int, high: int) -> tuple[datetime, datetime]:
    return _later(departs_at, low), _later(departs_at, high)


def _later(departs_at: datetime, by_us: int) -> datetime:
    at_us = (departs_at - EPOCH) // MICROSECOND + by_us
    return EPOCH + min(max(at_us, MIN_INSTANT_US), MAX_INSTANT_US) * MICROSECOND
