"""When a track could depart instead, as a sentence; times are rounded so that they stay free of conflicts."""

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from conflictdb.model.plans import Area
from conflictdb.model.results import Delays, Forbidden

# Rounded to the first of these that does not lead back into a conflict, microseconds.
_UNITS_US: Final = (1_000_000, 1000, 1)
# More keys than this are counted.
_MOST_KEYS: Final = 5


def departure_text(found: Delays, areas: Iterable[Area], named: Callable[[str], str]) -> str:
    """Return how much later or earlier a track may depart, or must to clear its conflicts.

    areas : those that it may meet
    named : returns how a key is shown
    """
    track = named(found.key)
    current = next((one for one in found.forbidden if one.from_s <= 0.0 <= one.to_s), None)
    if current is None:
        return f"{track} may leave {_shift(found, named)}"
    ways = (("later", least_text(found, is_later=True)), ("earlier", least_text(found, is_later=False)))
    least = [f"{text} {way}" for way, text in ways if text is not None]
    if not least:
        return f"no delay within {_horizon(found)} clears {track}: {_reason(found, current, areas, named)}"
    text = f"{track} must leave {' or '.join(least)} to clear {_listed(current.by, named)}"
    if len(least) == 1:
        other = "earlier" if found.least_earlier_s is None else "later"
        text += f"; no {other} departure within {_horizon(found)} does"
    return text


def least_text(found: Delays, *, is_later: bool) -> str | None:
    """Return the least later, or least earlier, departure without a conflict; None if there is none."""
    least_s = found.least_later_s if is_later else found.least_earlier_s
    return None if least_s is None else duration_text(_rounded_up(found, round(1e6 * least_s), 1 if is_later else -1))


def duration_text(us: int) -> str:
    """Return hours, minutes and seconds of microseconds; all of its decimals."""
    hours, rest = divmod(us, 3_600_000_000)
    minutes, rest = divmod(rest, 60_000_000)
    seconds = f"{rest // 1_000_000}.{rest % 1_000_000:06}".rstrip("0").rstrip(".")
    parts = [(str(hours), "h"), (str(minutes), "min"), (seconds, "s")]
    return " ".join(f"{count} {unit}" for count, unit in parts if count != "0") or "0 s"


def _shift(found: Delays, named: Callable[[str], str]) -> str:
    """Return how much later and earlier a track without a conflict may depart, and what it meets then."""
    later = min((one for one in found.forbidden if one.from_s > 0.0), key=lambda one: one.from_s, default=None)
    earlier = max((one for one in found.forbidden if one.to_s < 0.0), key=lambda one: one.to_s, default=None)
    limits = [
        f"up to {duration_text(_rounded_down(round(1e6 * first_s) - 1))} {way} before it meets {_listed(by, named)}"
        for way, first_s, by in (
            *([("later", later.from_s, later.by)] if later else []),
            *([("earlier", -earlier.to_s, earlier.by)] if earlier else []),
        )
    ]
    free = " or ".join(way for way, one in (("later", later), ("earlier", earlier)) if one is None)
    if not limits:
        return f"{_horizon(found)} {free} without a conflict"
    return ", and ".join([*limits, f"{_horizon(found)} {free}"] if free else limits)


def _reason(found: Delays, current: Forbidden, areas: Iterable[Area], named: Callable[[str], str]) -> str:
    """Return what forbids every delay."""
    unbounded = (area for area in areas if area.start_us is area.end_us is None)
    permanent = {area.key for area in unbounded if area.schedule is None and area.spans_us is None}
    for_ever = [key for key in found.blocked_by if key in permanent]
    if for_ever:
        verb = "is" if len(for_ever) == 1 else "are"
        return f"it crosses {_listed(for_ever, named)}, which {verb} there for ever"
    return f"it meets {_listed(found.blocked_by or current.by, named)}"


def _horizon(found: Delays) -> str:
    return duration_text(round(1e6 * found.latest_s))


def _rounded_down(us: int) -> int:
    """Return a shift in whole seconds, or finer ones where these are 0."""
    return next((whole for unit in _UNITS_US if (whole := us // unit * unit)), 0)


def _rounded_up(found: Delays, us: int, sign: int) -> int:
    """Return a least delay in whole seconds, or finer ones where these lead into the next conflict."""
    farthest_us = round(1e6 * (found.latest_s if sign > 0 else -found.earliest_s))
    spans_us = [sorted((round(1e6 * sign * one.from_s), round(1e6 * sign * one.to_s))) for one in found.forbidden]
    rounded = (-(-us // unit) * unit for unit in _UNITS_US)
    return next(
        whole for whole in rounded if whole <= farthest_us and not any(low <= whole <= high for low, high in spans_us)
    )


def _listed(keys: Sequence[str], named: Callable[[str], str]) -> str:
    names = [named(key) for key in keys[:_MOST_KEYS]]
    if len(keys) > _MOST_KEYS:
        names.append(f"{len(keys) - _MOST_KEYS:,} more")
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
