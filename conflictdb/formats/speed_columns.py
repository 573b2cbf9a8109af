"""Check the speeds of many tracks at once, over the ground along the lines of their scene."""

from collections.abc import Sequence

import numpy as np

from conflictdb.earth import geodesy
from conflictdb.errors import Refusals
from conflictdb.model.plans import MAX_RHUMB_LATITUDE_DEG, EarthModel, Motion, Track
from conflictdb.model.speeds import MPS_PER_KNOT, leg_refused, legs_too_fast


def within_speed(tracks: Sequence[Track], motion: Motion, max_speed_kn: float, refusals: Refusals) -> list[Track]:
    """Return the tracks that never exceed `max_speed_kn` (knots over the ground); the others are refused."""
    if not tracks or not np.isfinite(max_speed_kn):
        return list(tracks)
    count = np.array([len(track.positions_deg) for track in tracks])
    first = np.cumsum(count) - count
    positions = np.concatenate([track.positions_deg for track in tracks])
    lon, lat = positions[:, 0], positions[:, 1]
    if motion == Motion.GREAT_CIRCLE:
        length_m = geodesy.great_circle_distance(lon[:-1], lat[:-1], lon[1:], lat[1:])
    else:
        lat = np.clip(lat, -MAX_RHUMB_LATITUDE_DEG, MAX_RHUMB_LATITUDE_DEG)  # latitudes beyond are refused later
        length_m = geodesy.rhumb_distance(geodesy.earth_of(EarthModel.WGS84), lon[:-1], lat[:-1], lon[1:], lat[1:])
    seconds = np.diff(np.concatenate([track.times_us for track in tracks])) * 1e-6
    seconds[first[1:] - 1] = np.inf  # from one track to the next
    with np.errstate(over="ignore"):
        speed_kn = length_m / seconds / MPS_PER_KNOT
    beyond = legs_too_fast(speed_kn, max_speed_kn)
    owner = np.searchsorted(first, beyond, side="right") - 1
    fast = set(owner.tolist())
    for i, n in zip(*np.unique(owner, return_index=True), strict=True):
        leg = int(beyond[n])
        who, k = tracks[int(i)], leg - int(first[i])
        with refusals:
            raise leg_refused(f"track {who.key!r}", k, float(speed_kn[leg]), max_speed_kn)
    return [track for i, track in enumerate(tracks) if i not in fast]
