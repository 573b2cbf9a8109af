"""Tolerances of a track: how far a voyage may differ from its plan, and still be covered by the track's haven.

They have nothing in common with the scene's setting tolerance_m (settings.py).

A voyage follows the legs in order. On a leg it stays within the cross-track limits, and its progress along the leg has
a speed within the leg's bounds; its ship heads along the leg. It departs and arrives within the windows. At a waypoint
it turns from one heading to the next, on an arc if there is a turn radius.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model import inputs
from conflictdb.model.speed_limits import MPS_PER_KNOT, shortest_m

# Members of the tolerances of a track, in files, SQL and Python: numbers, or lists of one number per leg; windows are
# [earliest, latest], ISO 8601 with an offset; turn radii are one number, or one per waypoint between two legs.
PER_LEG: Final = ("xtd_port_m", "xtd_starboard_m", "min_speed_kn", "max_speed_kn")
WINDOWS: Final = ("departure_window", "arrival_window")
MEMBERS: Final = (*PER_LEG, "turn_radius_m", *WINDOWS)

# 10 nautical miles. Routes of ECDIS give cross-track limits in nautical miles: a larger number is probably metres.
MOST_XTD_M: Final = 18_520.0
MOST_RADIUS_M: Final = 18_520.0
MOST_SPEED_KN: Final = 100_000.0
_MOST_RADIUS_M: Final = 6_405_700.0  # above the largest radius of curvature of the earth
_LONGEST_S: Final = 3.2e9
_DAY_US: Final = 86_400_000_000
_LONGEST_WINDOW_US: Final = 366 * _DAY_US


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Tolerances of a track with n waypoints.

    port_m, starboard_m : (n - 1,) cross-track limits of each leg
    min_speed_mps, max_speed_mps : (n - 1,) bounds of the speed along each leg; NaN: the planned speed
    turn_radius_m : (n - 2,) of the arc at each waypoint between two legs; 0: the heading jumps
    departure_us : (2,) earliest and latest departure
    arrival_us : (2,) earliest and latest arrival; None: as follows from departure and speeds
    """

    port_m: NDArray[np.float64]
    starboard_m: NDArray[np.float64]
    min_speed_mps: NDArray[np.float64]
    max_speed_mps: NDArray[np.float64]
    turn_radius_m: NDArray[np.float64]
    departure_us: NDArray[np.int64]
    arrival_us: NDArray[np.int64] | None

    def latest_arrival_us(self, positions_deg: NDArray[np.float64], times_us: NDArray[np.int64]) -> int:
        """Return an instant after which no voyage of a plan is under way; at most a hundred years after its departure.

        An arc is no longer than either of its legs, and may be sailed as slowly as the slower one.

        positions_deg, times_us : (n, 2) and (n,) of the plan's waypoints
        """
        if self.arrival_us is not None:
            return int(self.arrival_us[1])
        lon, lat = np.radians(positions_deg).T
        east = np.abs(np.remainder(np.diff(lon) + np.pi, 2.0 * np.pi) - np.pi)
        north, widest = np.abs(np.diff(lat)), np.maximum(np.cos(lat[:-1]), np.cos(lat[1:]))
        widest[lat[:-1] * lat[1:] <= 0.0] = 1.0
        # No leg is longer than the way along a meridian and a parallel, or shorter than 0.99 of the one on the sphere.
        most_m = _MOST_RADIUS_M * (north + widest * east)
        least_m = 0.99 * shortest_m(positions_deg)
        planned_s = np.diff(times_us) / 1e6
        slowest = np.fmin(self.min_speed_mps, least_m / planned_s)
        slowest[slowest <= 0.0] = np.inf  # it stands, as planned
        legs_s, arcs_s = np.maximum(planned_s, most_m / slowest), 0.0
        if self.turn_radius_m.any():
            moves = np.isfinite(slowest[:-1]) & np.isfinite(slowest[1:])
            arcs_s = np.minimum(most_m[:-1], most_m[1:]) / np.minimum(slowest[:-1], slowest[1:])
            arcs_s = float(arcs_s[moves].sum())
        lasts_s = min(float(legs_s.sum()) + arcs_s, _LONGEST_S)
        return int(self.departure_us[1]) + round(1e6 * lasts_s)


def tolerances_of(who: str, given: Mapping[str, Any], times_us: NDArray[np.int64]) -> Tolerances:
    """Return the tolerances that members give for a track with such waypoints; raises InvalidInput."""
    if not isinstance(given, Mapping):
        raise InvalidInput(who, "tolerances", f"must be an object with members {', '.join(MEMBERS)}; got {given!r:.60}")
    unknown = [name for name in given if name not in MEMBERS]
    if unknown:
        raise InvalidInput(who, f"tolerances.{unknown[0]}", f"is not known; known: {', '.join(MEMBERS)}")
    legs = len(times_us) - 1
    port, starboard = (
        _numbers(who, name, given.get(name, 0.0), legs, "leg", MOST_XTD_M) for name in ("xtd_port_m", "xtd_starboard_m")
    )
    slowest, fastest = (
        _numbers(who, name, given[name], legs, "leg", MOST_SPEED_KN) if given.get(name) is not None
        else np.full(legs, np.nan)
        for name in ("min_speed_kn", "max_speed_kn")
    )  # fmt: skip
    if (fastest <= 0.0).any():
        raise InvalidInput(who, "max_speed_kn", "must be greater than 0")
    crossed = np.flatnonzero(slowest > fastest)
    if crossed.size:
        k = int(crossed[0])
        rule = f"must not be greater than max_speed_kn on leg {k} ({fastest[k]:g}); got {slowest[k]:g}"
        raise InvalidInput(who, "min_speed_kn", rule)
    radius = _numbers(who, "turn_radius_m", given.get("turn_radius_m", 0.0), max(legs - 1, 0), "turn", MOST_RADIUS_M)
    departure, arrival = (
        _window(who, name, given.get(name), int(times_us[at])) for name, at in zip(WINDOWS, (0, -1), strict=True)
    )
    if arrival is None and (slowest == 0.0).any():
        raise InvalidInput(who, "min_speed_kn", "must be greater than 0 without an arrival_window")
    return Tolerances(
        port,
        starboard,
        slowest * MPS_PER_KNOT,
        fastest * MPS_PER_KNOT,
        radius,
        np.array([times_us[0]] * 2, np.int64) if departure is None else departure,
        arrival,
    )


def as_members(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return valid tolerances as JSON has them: lists of numbers, and windows in ISO 8601."""
    found: dict[str, Any] = {}
    for name, value in given.items():
        if value is None:
            continue
        if name in WINDOWS:
            found[name] = [one if isinstance(one, str) else _written(name, one) for one in value]
        else:
            found[name] = [float(one) for one in value] if isinstance(value, Sequence | np.ndarray) else float(value)
    return found


def windows_later(given: Mapping[str, Any], by_us: int) -> dict[str, Any]:
    """Return valid tolerances with their windows later by some microseconds, in UTC."""
    moved: dict[str, Any] = dict(given)
    for name in WINDOWS:
        if given.get(name) is not None:
            ends_us = inputs.instants_us("tolerances", name, [datetime.fromisoformat(one) for one in given[name]])
            moved[name] = [_written(name, one) for one in inputs.all_certain(ends_us + by_us)]
    return moved


def _written(name: str, instant: inputs.Instant) -> str:
    return inputs.moment("tolerances", name, instant).isoformat().replace("+00:00", "Z")


def _numbers(who: str, name: str, value: Any, count: int, each: str, most: float) -> NDArray[np.float64]:
    many = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str)
    values = list(value) if many else [value]
    if many and len(values) != count:
        raise InvalidInput(who, name, f"must be one number, or one per {each}: {count}; got {len(values)}")
    for i, one in enumerate(values):
        where = f"{name}[{i}]" if many else name
        if isinstance(one, bool) or not isinstance(one, int | float | np.number) or not 0.0 <= one < np.inf:
            raise InvalidInput(who, where, f"must be a finite number, 0 or more; got {one!r:.60}")
        if one > most:
            hint = " (a limit in metres read as nautical miles?)" if name.startswith("xtd") else ""
            raise InvalidInput(who, where, f"must be at most {most:g}; got {one!r:.60}{hint}")
    found = np.array(values, dtype=np.float64)
    return found if many else np.full(count, found[0])


def _window(who: str, name: str, value: Any, planned_us: int) -> NDArray[np.int64] | None:
    if value is None:
        return None
    if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray) or len(value) != 2:
        raise InvalidInput(who, name, f"must be [earliest, latest]; got {value!r:.60}")
    instants = []
    for i, one in enumerate(value):
        if isinstance(one, str):
            try:
                one = datetime.fromisoformat(one)
            except ValueError:
                raise InvalidInput(who, f"{name}[{i}]", f"must be ISO 8601 with an offset; got {one!r:.60}") from None
        instants.append(one)
    window = inputs.instants_us(who, name, instants)
    if not window[0] <= planned_us <= window[1]:
        raise InvalidInput(who, name, "must contain the planned time of its waypoint")
    if window[1] - window[0] > _LONGEST_WINDOW_US:
        raise InvalidInput(who, name, "must not be longer than a year")
    return window
