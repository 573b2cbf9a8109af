"""Departures as clock times in a zone, rounded to a step; what is rounded stays free of conflicts."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, tzinfo
from typing import Final

from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.results import Delays

# A window that contains no whole step takes the first of these, microseconds.
_FINER_US: Final = (1_000_000, 1000, 1)


@dataclass(frozen=True, slots=True)
class Clock:
    """How departures are shown.

    zone : of the clock
    step_us : departures are rounded to whole multiples of this since midnight there, microseconds; 0: exact
    """

    zone: tzinfo = UTC
    step_us: int = 60_000_000

    @property
    def name(self) -> str:
        """The name of the zone."""
        return "UTC" if self.zone is UTC else str(self.zone)

    def steps_us(self) -> Iterator[int]:
        """Yield the step, then finer ones."""
        yield from (unit for unit in (self.step_us, *_FINER_US) if 0 < unit <= max(self.step_us, 1))

    def rounded_us(self, at_us: int, step_us: int, *, up: bool) -> int:
        """Return an instant, microseconds since 1970, rounded to a multiple of a step since midnight in the zone."""
        moment = EPOCH + at_us * MICROSECOND
        local = moment.astimezone(self.zone)
        midnight = local.replace(hour=0, minute=0, second=0, microsecond=0, tzinfo=None)
        since_us = (local.replace(tzinfo=None) - midnight) // MICROSECOND
        rest_us = since_us % step_us
        return at_us + (step_us - rest_us if up else -rest_us) if rest_us else at_us

    def rounded(self, moment: datetime, step_us: int | None = None, *, up: bool) -> datetime:
        """Return a moment rounded as `rounded_us`; None: to the clock's own step."""
        at_us = (moment - EPOCH) // MICROSECOND
        step_us = next(self.steps_us()) if step_us is None else step_us
        return moment + (self.rounded_us(at_us, step_us, up=up) - at_us) * MICROSECOND

    def text(self, moment: datetime, beside: datetime | None = None) -> str:
        """Return a moment in the zone, with its date unless that is the date of another one."""
        local = moment.astimezone(self.zone)
        form = "minutes" if not (local.second or local.microsecond) else "seconds"
        form = "microseconds" if local.microsecond else form
        text = local.replace(tzinfo=None).isoformat(" ", form)
        same_day = beside is not None and beside.astimezone(self.zone).date() == local.date()
        return text[11:] if same_day else text


def rounded_delay_us(found: Delays, delay_us: int, clock: Clock, *, later: bool) -> int:
    """Return a free delay, rounded away from the planned departure so that it is a clock time and still free.

    found : with a departure; its forbidden delays are what a rounded one is checked against
    """
    if found.departs_at is None:
        return delay_us
    departs_us = (found.departs_at - EPOCH) // MICROSECOND
    least_us, most_us = round(1e6 * found.earliest_s), round(1e6 * found.latest_s)
    for step_us in clock.steps_us():
        rounded_us = clock.rounded_us(departs_us + delay_us, step_us, up=later) - departs_us
        if least_us <= rounded_us <= most_us and is_free(found, rounded_us):
            return rounded_us
    return delay_us


def is_free(found: Delays, delay_us: int) -> bool:
    """Return whether a delay within the horizon is proven free."""
    return not any(round(1e6 * one.from_s) <= delay_us <= round(1e6 * one.to_s) for one in found.forbidden)


def rounded_window(low: datetime, high: datetime, clock: Clock) -> tuple[datetime, datetime]:
    """Return the part of a free window between two clock times."""
    for step_us in clock.steps_us():
        first, last = clock.rounded(low, step_us, up=True), clock.rounded(high, step_us, up=False)
        if low <= first <= last <= high:
            return first, last
    return low, high
