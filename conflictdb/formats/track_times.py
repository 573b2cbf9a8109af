"""Compute the times of tracks from their speeds, and check speeds: many at once, along the lines of a scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.ragged import offsets
from conflictdb.earth import geodesy
from conflictdb.errors import InvalidInput, Refusals
from conflictdb.model import many
from conflictdb.model.inputs import all_certain
from conflictdb.model.plans import MAX_LATITUDE_DEG, MAX_RHUMB_LATITUDE_DEG, Area, EarthModel, Motion, Scene, Track
from conflictdb.model.speed_limits import MPS_PER_KNOT, SPEED_SLACK, leg_refused, legs_too_fast, too_fast

# A longer plan leaves the years 1 to 9999 anyway; below this limit, microseconds fit 64 bits.
MAX_DURATION_S: Final = 3.2e11


@dataclass(frozen=True, slots=True)
class TrackAtSpeed:
    """A track whose times are not yet computed from its start and the speed on each leg.

    positions_deg : (n, 2) float64, longitude and latitude of the waypoints
    speed_mps : (n - 1,) float64, on each leg, from field `speed`
    members : all but its key, positions and times
    """

    key: str
    positions_deg: NDArray[np.float64]
    start_us: int
    speed: str
    speed_mps: NDArray[np.float64]
    members: Mapping[str, Any]

    def refusal(self, field: str, rule: str) -> InvalidInput:
        """Return the error that refuses a field of this track."""
        return InvalidInput(f"track {self.key!r}", field, rule)

    def at_times(self, times_us: NDArray[np.int64]) -> Track:
        """Return the track with times; raises InvalidInput."""
        return Track(self.key, self.positions_deg, all_certain(times_us), **self.members, max_speed_kn=np.inf)


def timed(
    items: Sequence[Area | Track | TrackAtSpeed], scene: Scene, max_speed_kn: float, refusals: Refusals
) -> tuple[list[Area], list[Track]]:
    """Return the areas of a file, and its tracks with times; tracks faster than `max_speed_kn` are refused."""
    at_speed = [item for item in items if isinstance(item, TrackAtSpeed)]
    done = iter(_timed(at_speed, scene, max_speed_kn, refusals))
    moving = (item for item in items if not isinstance(item, Area))
    tracks = (next(done) if isinstance(item, TrackAtSpeed) else item for item in moving)
    checked = within_speed([track for track in tracks if track is not None], scene.motion, max_speed_kn, refusals)
    return [item for item in items if isinstance(item, Area)], checked


def _timed(tracks: Sequence[TrackAtSpeed], scene: Scene, max_speed_kn: float, refusals: Refusals) -> list[Track | None]:
    """Return tracks with times from their speeds and the lengths of their legs; None for each refused one."""
    if not tracks:
        return []
    times_us: dict[int, NDArray[np.int64]] = {}
    length_m, first = _legs(tracks, scene.motion, scene.earth)
    for k, (track, i) in enumerate(zip(tracks, first, strict=True)):
        with refusals:
            fastest_kn = float(track.speed_mps.max()) / MPS_PER_KNOT
            found = _times_us(track, length_m[i : i + len(track.speed_mps)], scene.motion)
            if fastest_kn > max_speed_kn * (1.0 + SPEED_SLACK):
                track.at_times(found)  # its other mistakes first
                raise track.refusal(track.speed, f"is {too_fast(fastest_kn, max_speed_kn)}")
            times_us[k] = found
    done: list[Track | None] = [None] * len(tracks)
    some = [(k, tracks[k], found) for k, found in times_us.items()]
    for (k, track, found), made in zip(some, _at_times([(track, at) for _, track, at in some]), strict=True):
        with refusals:
            done[k] = track.at_times(found) if made is None else made
    return done


def _at_times(given: Sequence[tuple[TrackAtSpeed, NDArray[np.int64]]]) -> list[Track | None]:
    """Return tracks with times; None for refused ones."""
    if not given:
        return []
    tracks = [track for track, _ in given]
    outlines = [track.members["outline_m"] for track in tracks]
    return many.tracks(
        [track.key for track in tracks],
        np.concatenate([track.positions_deg for track in tracks]),
        offsets([len(track.positions_deg) for track in tracks]),
        np.concatenate([times_us for _, times_us in given]),
        np.concatenate(outlines),
        offsets([len(one) for one in outlines]),
        [track.members for track in tracks],
    )


def _times_us(track: TrackAtSpeed, length_m: NDArray[np.float64], motion: Motion) -> NDArray[np.int64]:
    """Return the times of a track from the lengths of its legs; raises InvalidInput."""
    positions = track.positions_deg
    worst = float(np.abs(positions[:, 1]).max())
    if worst > MAX_LATITUDE_DEG:  # refused by Track
        return np.arange(len(positions), dtype=np.int64)
    if worst > MAX_RHUMB_LATITUDE_DEG and motion != Motion.GREAT_CIRCLE:
        rule = f"rhumb lines are followed up to {MAX_RHUMB_LATITUDE_DEG:g} degrees of latitude only; got {worst:g}"
        raise track.refusal("geometry", rule)
    with np.errstate(over="ignore"):
        elapsed_s = np.cumsum(length_m / track.speed_mps)
    if not elapsed_s[-1] < MAX_DURATION_S:
        raise track.refusal(track.speed, "is so slow that the track would leave the years 1 to 9999")
    times_us = np.concatenate([[0], np.rint(elapsed_s * 1e6).astype(np.int64)]) + track.start_us
    short = np.flatnonzero(times_us[1:] <= times_us[:-1])
    if short.size:
        i = int(short[0])
        where = f"waypoints {i} and {i + 1} (from 0)"
        if np.all(positions[i] == positions[i + 1]):
            rule = f"{where} are the same place: a speed cannot say how long to stay; give times"
        else:
            rule = f"{where} are less than a microsecond apart, the resolution of times"
        raise track.refusal(track.speed, rule)
    return times_us


def within_speed(tracks: Sequence[Track], motion: Motion, max_speed_kn: float, refusals: Refusals) -> list[Track]:
    """Return the tracks that never exceed `max_speed_kn` (knots over the ground); the others are refused."""
    if not tracks or not np.isfinite(max_speed_kn):
        return list(tracks)
    speed_kn, first = speeds_kn(tracks, motion, EarthModel.WGS84)
    beyond = legs_too_fast(speed_kn, max_speed_kn)
    owner = np.searchsorted(first, beyond, side="right") - 1
    fast = set(owner.tolist())
    for i, n in zip(*np.unique(owner, return_index=True), strict=True):
        leg = int(beyond[n])
        who, k = tracks[int(i)], leg - int(first[i])
        with refusals:
            raise leg_refused(f"track {who.key!r}", k, float(speed_kn[leg]), max_speed_kn)
    return [track for i, track in enumerate(tracks) if i not in fast]


def speeds_kn(
    tracks: Sequence[Track], motion: Motion, earth: EarthModel
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the speeds in knots on the legs between all waypoints, 0 between two tracks; and their first legs."""
    length_m, first = _legs(tracks, motion, earth)
    seconds = np.diff(np.concatenate([track.times_us for track in tracks])) * 1e-6
    seconds[first[1:] - 1] = np.inf  # from one track to the next
    with np.errstate(over="ignore"):
        return length_m / seconds / MPS_PER_KNOT, first


def _legs(
    tracks: Sequence[Track | TrackAtSpeed], motion: Motion, earth: EarthModel
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the lengths in metres of the legs between all waypoints, and the first leg of each track.

    A leg from one track to the next lies between theirs. Latitudes beyond the limit, refused elsewhere, are clipped.
    """
    count = np.array([len(track.positions_deg) for track in tracks], dtype=np.intp)
    lon, lat = np.concatenate([track.positions_deg for track in tracks]).T
    if motion == Motion.GREAT_CIRCLE:
        length_m = geodesy.great_circle_distance(lon[:-1], lat[:-1], lon[1:], lat[1:])
    else:
        lat = np.clip(lat, -MAX_RHUMB_LATITUDE_DEG, MAX_RHUMB_LATITUDE_DEG)
        length_m = geodesy.rhumb_distance(geodesy.earth_of(earth), lon[:-1], lat[:-1], lon[1:], lat[1:])
    return length_m, np.cumsum(count) - count
