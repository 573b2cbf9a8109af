"""How tracks keep their plans: the state that follows from the lateness at a position, and what silence does to it."""

from bisect import bisect_left
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np

from conflictdb.arrays.objects import TrackBatch
from conflictdb.core.delays import Spans
from conflictdb.model.speed_limits import MPS_PER_KNOT, shortest_m

ON_PLAN: Final = "on plan"
LATE: Final = "late"
EARLY: Final = "early"
OFF: Final = "off"
SILENT: Final = "silent"
PAST: Final = "past its end"
WAITING: Final = "not yet under way"
# Plans and positions are given to the minute: a minute later or earlier is still on plan.
NEAR_US: Final = 60_000_000
# Lengths of legs are rounded: this share faster counts as the same speed.
_ROUNDING: Final = 1e-3
# Slower than this, metres per second, a leg stands still.
STANDS_MPS: Final = 0.05


@dataclass(frozen=True, slots=True)
class PlannedTimes:
    """Times and speeds of a plan, on which the state of its track depends.

    gains : seconds that it may become earlier in a second: its speed limit, or else its fastest leg, by its slowest leg
    stands_us : how long its legs stand still, which it may omit
    fastest_mps : its speed limit, or else the speed of its fastest leg
    starts_us : when its voyages begin, in order
    lasts_us : how long each takes
    """

    gains: float
    stands_us: int
    fastest_mps: float
    starts_us: tuple[int, ...]
    lasts_us: int

    @classmethod
    def of(cls, tracks: TrackBatch, row: int) -> Self:
        """Return that of a track of a batch."""
        points = slice(int(tracks.waypoint_offset[row]), int(tracks.waypoint_offset[row + 1]))
        times_us = tracks.times_us[points]
        lasts_us = np.diff(times_us)
        speed = shortest_m(tracks.positions_deg[points]) * 1e6 / lasts_us
        moves = speed > STANDS_MPS
        limits = tracks.tolerances[row] or {}
        given = np.atleast_1d(np.array(limits.get("max_speed_kn") or np.nan, np.float64))
        fastest = float(np.max(speed)) if np.isnan(given).any() else MPS_PER_KNOT * float(given.max())
        slowest = float(speed[moves].min()) if moves.any() else fastest
        departs = tracks.departs.at_us[tracks.departs.offset[row] : tracks.departs.offset[row + 1]]
        starts = tuple(np.unique(departs).tolist()) if len(departs) else (int(times_us[0]),)
        gains = max(0.0, fastest / slowest - 1.0 - _ROUNDING) if slowest > 0.0 else 0.0
        stands_us = int(lasts_us[~moves].sum())
        whole_us = int(times_us[-1] - times_us[0])
        return cls(gains, stands_us, fastest, starts, whole_us)

    @property
    def first_us(self) -> int:
        """When its first voyage begins."""
        return self.starts_us[0]

    @property
    def last_us(self) -> int:
        """When its last voyage ends."""
        return self.starts_us[-1] + self.lasts_us

    def begins_us(self, at_us: int) -> int:
        """Return when the voyage after an instant begins, or the last one."""
        return self.starts_us[min(bisect_left(self.starts_us, at_us), len(self.starts_us) - 1)]

    def between(self, at_us: int) -> tuple[int, int] | None:
        """Return when the voyage before an instant ends, and when the next one begins; None unless it is in between."""
        k = bisect_left(self.starts_us, at_us)
        if not 0 < k < len(self.starts_us) or at_us <= self.starts_us[k - 1] + self.lasts_us:
            return None
        return self.starts_us[k - 1] + self.lasts_us, self.starts_us[k]


@dataclass(frozen=True, slots=True)
class Kept:
    """How a track keeps its plan.

    late_us : least and greatest lateness; None: unknown
    off_m : distance from all places of the haven; None unless off
    at_us, lonlat, height_m, error_m : its last position
    seen_us : lateness at the last position that the haven contained; None: none yet
    """

    state: str
    late_us: tuple[int, int] | None
    off_m: float | None
    at_us: int
    lonlat: tuple[float, float]
    height_m: float | None
    error_m: float
    seen_us: tuple[int, int] | None

    @property
    def is_as_planned(self) -> bool:
        """Whether its haven contains it as planned: no other conflicts follow than the planned ones."""
        return self.state in (ON_PLAN, WAITING)

    @property
    def is_over(self) -> bool:
        """Whether its plan is over."""
        return self.state == PAST

    def replaces(self, before: Self | None, since_us: int) -> bool:
        """Return whether nothing follows from an earlier state that does not follow from this one.

        since_us : since when the earlier ones were replaced: latenesses that are a minute apart count each
        """
        if before is None or (self.is_as_planned, self.is_over) != (before.is_as_planned, before.is_over):
            return False
        if self.is_as_planned or self.is_over:
            return True
        return self.state == before.state and self.at_us - since_us < NEAR_US

    def at(self, plan: PlannedTimes, latenesses: Spans, former: Self | None) -> Self:
        """Return the state at this position, which its haven contains at some latenesses.

        former : at an earlier position; None: this is the first
        """
        pause = plan.between(self.at_us)
        if pause is not None and _is_in_port(latenesses, self.at_us, pause, former):
            # Without a lateness of the former voyage.
            early_us = self.at_us - pause[1]
            return replace(self, state=WAITING, late_us=(early_us, early_us), off_m=None, seen_us=(early_us, early_us))
        seen = _chosen(latenesses, plan, self.at_us, former)
        if seen is None:
            seen_us = None if former is None else former.seen_us
            state = WAITING if self.at_us < plan.first_us else OFF
            if self.at_us > plan.last_us + (0 if seen_us is None else max(0, seen_us[1])):
                state = PAST
            return replace(self, state=state, late_us=None, seen_us=seen_us)
        low, high = seen
        if low <= self.at_us - plan.last_us <= high and self.at_us >= plan.last_us:
            state = PAST
        elif low <= self.at_us - plan.first_us <= high and self.at_us <= plan.first_us:
            state = WAITING
        elif low > NEAR_US:
            state = LATE
        else:
            state = EARLY if high < -NEAR_US else ON_PLAN
        return replace(self, state=state, late_us=seen, off_m=None, seen_us=seen)

    def away(self, off_m: float) -> Self:
        """Return this state of a track that is off by a distance."""
        return replace(self, off_m=off_m)

    def unheard(self, plan: PlannedTimes, now_us: int) -> Self:
        """Return the state now, without another position: its lateness grows both ways."""
        if self.state == WAITING and now_us < plan.begins_us(self.at_us):
            return self
        if now_us > plan.last_us + (0 if self.seen_us is None else max(0, self.seen_us[1])):
            return replace(self, state=PAST, late_us=self.seen_us, off_m=None)
        if self.seen_us is None or self.off_m is not None:
            # A track that was off when it was last heard of is not known to be on its way at all.
            return replace(self, state=SILENT, late_us=None)
        # In whole minutes: a look finds the alarms of a silent track again at most once a minute.
        lasts_us = -((self.at_us - now_us) // NEAR_US) * NEAR_US
        return replace(self, state=SILENT, late_us=_grown(self.seen_us, plan, lasts_us))


def _grown(seen_us: tuple[int, int], plan: PlannedTimes, lasts_us: int) -> tuple[int, int]:
    """Return which latenesses are possible after a time without a position."""
    return seen_us[0] - int(plan.gains * lasts_us) - min(plan.stands_us, lasts_us), seen_us[1] + lasts_us


def _is_in_port(latenesses: Spans, at_us: int, pause: tuple[int, int], former: Kept | None) -> bool:
    """Return whether a track has ended a voyage and waits for the next one, at a position between both."""
    ended_us, begins_us = pause
    if any(latenesses.contains(by_us, by_us) for by_us in (at_us - ended_us, at_us - begins_us)):
        return True
    # It was there, and is moved in port.
    return former is not None and former.state == WAITING and former.at_us > ended_us and not len(latenesses)


def _chosen(latenesses: Spans, plan: PlannedTimes, at_us: int, former: Kept | None) -> tuple[int, int] | None:
    """Return the interval of latenesses that follows on the former one; without one, that nearest to none."""
    if not len(latenesses):
        return None
    low, high = latenesses.low, latenesses.high
    middle = 0.0
    if former is not None and former.seen_us is not None:
        # One that waited is not early.
        middle = 0.0 if former.state == WAITING else 0.5 * sum(former.seen_us)
        least, most = _grown(former.seen_us, plan, max(at_us - former.at_us, 0))
        follows = np.flatnonzero((low <= most + NEAR_US) & (high >= least - NEAR_US))
        if follows.size:
            low, high = low[follows], high[follows]
    away = np.maximum(np.maximum(low - middle, middle - high), 0.0)
    k = int(np.argmin(away))
    return int(low[k]), int(high[k])
