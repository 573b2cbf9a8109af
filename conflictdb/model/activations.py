"""The rules of several activations: spans of areas, departures of tracks, and schedules."""

import itertools
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from conflictdb.errors import InvalidInput
from conflictdb.model import inputs

# Ends of an unbounded span, in arrays of microseconds.
MINUS_INFINITY_US: Final = -(2**63)
INFINITY_US: Final = 2**63 - 1
# Activations of one object, at most: one every 5 minutes for a year.
MOST_ACTIVATIONS: Final = 105_120

Spans = tuple[tuple[int | None, int | None], ...]


def spans_of(who: str, given: Any) -> Spans:
    """Return spans sorted, and joined where they touch or overlap; raises InvalidInput.

    given : pairs of start and end, instants; None is unbounded
    """
    found = []
    for i, pair in enumerate(_listed(who, "spans", given, "[start, end]")):
        if isinstance(pair, str) or not isinstance(pair, Sequence | np.ndarray) or len(pair) != 2:
            raise InvalidInput(who, f"spans[{i}]", f"must be a pair [start, end]; got {pair!r:.60}")
        try:
            start, end = inputs.span_us(who, *pair)
        except InvalidInput as error:
            raise InvalidInput(who, f"spans[{i}].{error.field}", error.rule) from None
        low, high = MINUS_INFINITY_US if start is None else start, INFINITY_US if end is None else end
        if low >= high:
            raise InvalidInput(who, f"spans[{i}]", "must end after it starts")
        found.append((low, high))
    joined: list[tuple[int, int]] = []
    for low, high in sorted(found):
        if joined and low <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], high)
        else:
            joined.append((low, high))
    return tuple(
        (None if low == MINUS_INFINITY_US else low, None if high == INFINITY_US else high) for low, high in joined
    )


def departures_of(who: str, given: Any, lasts_us: int) -> tuple[int, ...]:
    """Return departures, microseconds, increasing; raises InvalidInput if a voyage begins before the last one ends.

    lasts_us : how long a voyage takes
    """
    listed = _listed(who, "departures", given, "an instant")
    found = inputs.instants_us(who, "departures", listed).tolist() if listed else []
    for i, (first, second) in enumerate(itertools.pairwise(found), 1):
        if second <= first:
            raise InvalidInput(who, f"departures[{i}]", "must be later than the one before")
        if second < first + lasts_us:
            took = f"a voyage takes {lasts_us / 1e6:g} s, and one object is in one place: use two tracks"
            raise InvalidInput(who, f"departures[{i}]", f"is before the voyage before it has ended ({took})")
    return tuple(found)


def check_schedule(who: str, source: Any) -> None:
    """Raise InvalidInput for a schedule that is not understood."""
    # Recurrences are seldom, and their library takes time to import.
    from conflictdb.model.schedules import schedule_of

    schedule_of(who, source)


def _listed(who: str, field: str, given: Any, of: str) -> list[Any]:
    if isinstance(given, str | bytes) or not isinstance(given, Sequence | np.ndarray):
        raise InvalidInput(who, field, f"must be a list, each {of}; got {given!r:.60}")
    if len(given) > MOST_ACTIVATIONS:
        raise InvalidInput(who, field, f"must have at most {MOST_ACTIVATIONS:,} entries; got {len(given):,}")
    return list(given)
