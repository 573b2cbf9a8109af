"""Limits of plans that are admitted: how far ahead, and of how many vertices."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

import shapely

from conflictdb.errors import InvalidInput
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import Area, Track

_DAY_US: Final = 86_400_000_000


@dataclass(frozen=True, slots=True)
class Limits:
    """None: no limit.

    max_vertices : of an area
    max_waypoints : of a track
    max_days_ahead : days from now until which a plan must end
    """

    max_vertices: int | None = None
    max_waypoints: int | None = None
    max_days_ahead: float | None = None

    def check(self, plans: Sequence[Area | Track]) -> None:
        """Raise InvalidInput for the first plan beyond a limit."""
        is_sized = self.max_vertices is not None or self.max_waypoints is not None
        for plan in plans:
            if is_sized:
                self._check_size(plan)
            if self.max_days_ahead is not None:
                _check_end(plan, self.max_days_ahead)

    def _check_size(self, plan: Area | Track) -> None:
        if isinstance(plan, Area):
            who, what, most = f"area {plan.key!r}", "vertices", self.max_vertices
            points = int(shapely.get_num_coordinates(plan.footprint))
        else:
            who, what, most, points = f"track {plan.key!r}", "waypoints", self.max_waypoints, len(plan.times_us)
        if most is not None and points > most:
            raise InvalidInput(who, "geometry", f"must have at most {most} {what}; got {points}")


def _check_end(plan: Area | Track, max_days_ahead: float) -> None:
    end_us: int | None
    if isinstance(plan, Area):
        who, end_us = f"area {plan.key!r}", plan.end_us
    else:
        who, (first, last) = f"track {plan.key!r}", (int(plan.times_us[0]), int(plan.times_us[-1]))
        end_us = last if not plan.departures_us else plan.departures_us[-1] + last - first
    # A schedule may go on without end.
    given = "no end" if end_us is None or plan.schedule is not None else f"{EPOCH + end_us * MICROSECOND}"
    now_us = (datetime.now(UTC) - EPOCH) / MICROSECOND
    if end_us is None or plan.schedule is not None or end_us > now_us + max_days_ahead * _DAY_US:
        raise InvalidInput(who, "end", f"must be at most {max_days_ahead:g} days from now; got {given}")
