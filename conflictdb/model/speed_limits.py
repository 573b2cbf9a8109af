"""Check speeds: a leg faster than anything moves has a wrong time or a wrong place."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model.units import METRES_PER_NMI

MPS_PER_KNOT: Final = METRES_PER_NMI / 3600.0
MAX_SPEED_KN: Final = 2000.0  # faster than any aircraft in service; as in sql/12_checks.sql, _limit
AIS_MAX_SPEED_KN: Final = 102.2  # the highest speed in an AIS message
# Relative tolerance of the check: the lengths and times of legs are rounded, and the scene's earth may differ.
SPEED_SLACK: Final = 0.01
_MEAN_RADIUS_M: Final = 6_371_008.8


def too_fast(speed_kn: float, max_speed_kn: float) -> str:
    """Return the text on a speed, the rule that it breaks, and the remedy if it is right."""
    speed = f"{speed_kn:,.0f}" if speed_kn < 1e9 else f"{speed_kn:.3g}"
    return f"{speed} kn, beyond {max_speed_kn:g} kn; if that is meant, raise --max-speed-kn (max_speed_kn in Python)"


def legs_too_fast(speed_kn: NDArray[np.float64], max_speed_kn: float) -> NDArray[np.intp]:
    """Return the indices of the legs above the speed limit."""
    return np.flatnonzero(speed_kn > (1.0 + SPEED_SLACK) * max_speed_kn)


def leg_refused(who: str, leg: int, speed_kn: float, max_speed_kn: float) -> InvalidInput:
    """Return the error for a leg (from 0): it names the waypoint at the leg's end, its speed, and the limit.

    who : the leg's track, such as ``track 'T'``
    """
    rule = f"the leg to this waypoint is travelled at {too_fast(speed_kn, max_speed_kn)}"
    return InvalidInput(who, f"times[{leg + 1}]", rule)


def shortest_m(positions_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths (n - 1,) of the shortest ways between positions (n, 2) on the mean sphere, metres."""
    lonlat = np.radians(positions_deg)
    sine = np.sin((lonlat[1:] - lonlat[:-1]) / 2.0)
    across = np.cos(lonlat[:, 1])
    half = sine[:, 1] ** 2 + across[:-1] * across[1:] * sine[:, 0] ** 2
    return np.asarray(2.0 * _MEAN_RADIUS_M * np.arcsin(np.sqrt(np.minimum(half, 1.0))))


def check_speed(who: str, positions_deg: NDArray[np.float64], times_us: NDArray[np.int64], max_speed_kn: float) -> None:
    """Refuse a track with a leg whose speed exceeds the limit, knots, even along the shortest path.

    positions_deg : (n, 2) longitude and latitude
    times_us : (n,) microseconds, increasing

    Raises InvalidInput for the first such leg.
    """
    if not max_speed_kn < np.inf:
        return
    speed_kn = shortest_m(positions_deg) / ((times_us[1:] - times_us[:-1]) * 1e-6) / MPS_PER_KNOT
    fast = legs_too_fast(speed_kn, max_speed_kn)
    if fast.size:
        raise leg_refused(who, int(fast[0]), float(speed_kn[fast[0]]), max_speed_kn)
