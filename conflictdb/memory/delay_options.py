"""What a question about delays asks: how far, with which margin, and which windows of departures."""

from dataclasses import dataclass
from typing import Any, Self

from conflictdb.errors import InvalidInput
from conflictdb.model import inputs
from conflictdb.model.margin import Margin
from conflictdb.model.plans import Area, Track


@dataclass(frozen=True, slots=True)
class DelayOptions:
    """The options of `delays`, checked.

    horizon_us : delays of up to this many microseconds, either way
    now_us, clear_within_m, waypoint, best : as of `delays`
    margin : of `margin_s` and `margin_m`
    from_us, to_us : the departures of windows, microseconds since 1970; None: as far as the horizon
    """

    horizon_us: int
    now_us: int | None
    clear_within_m: float | None
    waypoint: int | None
    margin: Margin
    from_us: int | None
    to_us: int | None
    best: int | None

    @classmethod
    def of(
        cls,
        within_s: Any = 7200.0,
        now: inputs.Instant | None = None,
        clear_within_m: Any = None,
        waypoint: int | None = None,
        margin_s: Any = 0.0,
        margin_m: Any = 0.0,
        start: inputs.Instant | None = None,
        end: inputs.Instant | None = None,
        best: Any = None,
    ) -> Self:
        """Return the options. Raises InvalidInput."""
        if clear_within_m is not None:
            clear_within_m = inputs.reach_m("delays", "clear_within_m", clear_within_m)
        from_us, to_us = _instant_us("start", start), _instant_us("end", end)
        if from_us is not None and to_us is not None and from_us > to_us:
            raise InvalidInput("delays", "start", "must not be after end")
        return cls(
            round(1e6 * inputs.seconds("delays", "within_s", within_s)),
            _instant_us("now", now),
            clear_within_m,
            waypoint,
            Margin.of("delays", margin_s, margin_m),
            from_us,
            to_us,
            None if best is None else inputs.count("delays", "best", best, 1),
        )

    @property
    def has_times(self) -> bool:
        """Whether windows have a start or an end, which needs the departure of one plan."""
        return self.from_us is not None or self.to_us is not None

    @property
    def has_slots(self) -> bool:
        """Whether windows are asked for."""
        return self.has_times or self.best is not None

    @property
    def may_be_stored(self) -> bool:
        """Whether stored differences have the answer."""
        return self.waypoint is None and self.clear_within_m is None and not self.margin and not self.has_slots

    def reach_us(self, plan: Area | Track, departs_us: int | None) -> int:
        """Return the longest delay asked about, microseconds, so that windows reach from start to end.

        departs_us : when the plan departs; None: never, or it is unbounded
        """
        if not self.has_times:
            return self.horizon_us
        if plan.schedule is not None or departs_us is None:
            rule = "is for a plan with a departure of its own; within_s asks about one that repeats, or has no start"
            raise InvalidInput(f"object {plan.key!r}", "start", rule)
        low, high = self._from(departs_us), self._to(departs_us)
        if low > high:
            given, other = ("start", "end") if self.to_us is None else ("end", "start")
            rule = f"is farther from the departure than within_s: give {other}, too, or a longer within_s"
            raise InvalidInput(f"object {plan.key!r}", given, rule)
        return round(1e6 * inputs.seconds("delays", "start, end", max(abs(low), abs(high)) / 1e6))

    def window_us(self, departs_us: int, first_us: int, last_us: int) -> tuple[int, int]:
        """Return the least and the greatest delay of windows, of those that are possible: first to last."""
        return max(self._from(departs_us), first_us), min(self._to(departs_us), last_us)

    def _from(self, departs_us: int) -> int:
        return -self.horizon_us if self.from_us is None else self.from_us - departs_us

    def _to(self, departs_us: int) -> int:
        return self.horizon_us if self.to_us is None else self.to_us - departs_us


def _instant_us(name: str, given: inputs.Instant | None) -> int | None:
    return None if given is None else (inputs.moment("delays", name, given) - inputs.EPOCH) // inputs.MICROSECOND
