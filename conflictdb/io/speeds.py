"""Speeds beyond reason: a leg that is faster than anything moves has a wrong time or a wrong place."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from conflictdb.earth import geodesy
from conflictdb.errors import InvalidInput, Refusals
from conflictdb.model import MAX_RHUMB_LATITUDE_DEG, MPS_PER_KNOT, EarthModel, Motion, Track

AIS_MAX_SPEED_KN: Final = 102.2  # the highest speed that an AIS message can carry
MAX_SPEED_KN: Final = 2000.0  # for all other objects: faster than any aircraft in service
# Speeds are judged to this share: the lengths and times of legs are rounded, and the earth may be another.
SLACK: Final = 0.01


def too_fast(speed_kn: float, max_speed_kn: float) -> str:
    """Return a speed, the rule that it breaks, and what to do if it is right all the same."""
    speed = f"{speed_kn:,.0f}" if speed_kn < 1e9 else f"{speed_kn:.3g}"
    return f"{speed} kn, beyond {max_speed_kn:g} kn; if that is meant, raise --max-speed-kn (max_speed_kn in Python)"


def within_speed(tracks: Sequence[Track], motion: Motion, max_speed_kn: float, refusals: Refusals) -> list[Track]:
    """Return the tracks that are nowhere faster than `max_speed_kn` (knots over the ground); the rest is refused."""
    if not tracks or not np.isfinite(max_speed_kn):
        return list(tracks)
    count = np.array([len(track.positions_deg) for track in tracks])
    first = np.cumsum(count) - count
    positions = np.concatenate([track.positions_deg for track in tracks])
    lon, lat = positions[:, 0], positions[:, 1]
    if motion == Motion.GREAT_CIRCLE:
        length_m = geodesy.great_circle_distance(lon[:-1], lat[:-1], lon[1:], lat[1:])
    else:
        lat = np.clip(lat, -MAX_RHUMB_LATITUDE_DEG, MAX_RHUMB_LATITUDE_DEG)  # what lies beyond is refused later
        length_m = geodesy.rhumb_distance(geodesy.earth_of(EarthModel.WGS84), lon[:-1], lat[:-1], lon[1:], lat[1:])
    seconds = np.diff(np.concatenate([track.times_us for track in tracks])) * 1e-6
    seconds[first[1:] - 1] = np.inf  # from one track to the next
    with np.errstate(over="ignore"):
        speed_kn = length_m / seconds / MPS_PER_KNOT
    beyond = np.flatnonzero(speed_kn > (1.0 + SLACK) * max_speed_kn)
    owner = np.searchsorted(first, beyond, side="right") - 1
    fast = set(owner.tolist())
    for i, n in zip(*np.unique(owner, return_index=True), strict=True):
        leg = int(beyond[n])
        who, k = tracks[int(i)], leg - int(first[i])
        rule = f"the leg to this waypoint is travelled at {too_fast(float(speed_kn[leg]), max_speed_kn)}"
        with refusals:
            raise InvalidInput(f"track {who.key!r}", f"times[{k + 1}]", rule)
    return [track for i, track in enumerate(tracks) if i not in fast]
