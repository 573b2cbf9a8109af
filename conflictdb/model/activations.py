"""Convert several activations: spans of areas, departures of tracks, and schedules."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model import inputs, plan_rules

# Ends of an unbounded span, in arrays of microseconds.
MINUS_INFINITY_US: Final = -(2**63)
INFINITY_US: Final = 2**63 - 1
# Activations of one object, at most: one every 5 minutes for a year.
MOST_ACTIVATIONS: Final = 105_120

Spans = tuple[tuple[int | None, int | None], ...]


def spans_us(who: str, given: Any) -> NDArray[np.int64]:
    """Return spans (n, 2), microseconds, MINUS_INFINITY_US and INFINITY_US where unbounded; raises InvalidInput.

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
        found.append((MINUS_INFINITY_US if start is None else start, INFINITY_US if end is None else end))
    try:
        return np.array(found, np.int64).reshape(-1, 2)
    except OverflowError:
        raise InvalidInput(who, "spans", plan_rules.IN_CALENDAR) from None


def joined(spans_us: NDArray[np.int64]) -> Spans:
    """Return spans (n, 2) sorted, and joined where they touch or overlap; None is unbounded."""
    found: list[tuple[int, int]] = []
    for low, high in sorted(map(tuple, spans_us.tolist())):
        if found and low <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], high)
        else:
            found.append((low, high))
    return tuple(
        (None if low == MINUS_INFINITY_US else low, None if high == INFINITY_US else high) for low, high in found
    )


def departures_us(who: str, given: Any) -> NDArray[np.int64]:
    """Return departures (n,), microseconds; raises InvalidInput."""
    listed = _listed(who, "departures", given, "an instant")
    return inputs.instants_us(who, "departures", listed) if listed else np.empty(0, np.int64)


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
