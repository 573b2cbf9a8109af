"""Represent areas and tracks as arrays.

Units: metres, degrees, microseconds since 1970. Waypoints and outlines are ragged (`ragged`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.column_numbers import numbers_of_plans, values_in
from conflictdb.arrays.pieces import Pieces
from conflictdb.arrays.ragged import followed_by, offsets, ragged_rows, ragged_take, stacked
from conflictdb.errors import InvalidInput
from conflictdb.model.outlines import mitred
from conflictdb.model.plan_columns import AREA, HEIGHT_LIMITS, TRACK, HeightLimit
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Track, has_unknown_times, heights_of_legs


@dataclass(frozen=True, slots=True)
class Activations:
    """When n objects are active: object i has rows [offset[i], offset[i + 1]), perhaps none.

    offset : (n + 1,) int64
    at_us : (s, 2) int64, spans of areas, MINUS_INFINITY_US and INFINITY_US where unbounded; or (s,) int64, departures
        of tracks
    is_unknown : (n,) whether the object may be active at any of these times, or depart at any time at all
    """

    offset: NDArray[np.int64]
    at_us: NDArray[np.int64]
    is_unknown: NDArray[np.bool_]

    def take(self, rows: NDArray[np.int64]) -> "Activations":
        """Return the activations of some objects."""
        offset, index = ragged_rows(self.offset, rows)
        return Activations(offset, self.at_us[index], self.is_unknown[rows])

    def but(self, given: Mapping[int, NDArray[np.int64]]) -> "Activations":
        """Return these activations, with given ones in the form of `at_us` for the objects of some rows."""
        each = [given.get(i, at) for i, at in enumerate(np.split(self.at_us, self.offset[1:-1]))]
        is_unknown = self.is_unknown.copy()
        is_unknown[list(given)] = False
        return Activations(offsets([len(at) for at in each]), np.concatenate(each), is_unknown)

    def followed_by(self, other: "Activations") -> "Activations":
        """Return the activations of these objects, then of others."""
        return Activations(
            followed_by([self.offset, other.offset]),
            np.concatenate([self.at_us, other.at_us]),
            np.concatenate([self.is_unknown, other.is_unknown]),
        )

    @classmethod
    def once(cls, at_us: NDArray[np.int64]) -> "Activations":
        """Return one activation for each object: spans (n, 2) or departures (n,)."""
        return cls(np.arange(len(at_us) + 1), at_us, np.zeros(len(at_us), np.bool_))

    @classmethod
    def of(cls, each: Sequence[Sequence[Any] | None], once: NDArray[np.int64]) -> "Activations":
        """Return given activations, in the form of `at_us`; None: that of `once`, one for each object."""
        if not any(one is not None for one in each):
            return cls.once(once)
        found = [once[i : i + 1] if one is None else np.array(one, np.int64) for i, one in enumerate(each)]
        shape = (-1, *once.shape[1:])
        at_us = np.concatenate([np.empty((0, *once.shape[1:]), np.int64), *(one.reshape(shape) for one in found)])
        return cls(offsets([len(one.reshape(shape)) for one in found]), at_us, np.zeros(len(found), np.bool_))


def _unless_scheduled(item: Area | Track, given: Any) -> Any:
    """Return activations that are given; raises InvalidInput for a schedule that is not expanded, unless stored."""
    if item.schedule is not None and given is None and not item.is_stored:
        kind = "area" if isinstance(item, Area) else "track"
        raise InvalidInput(
            f"{kind} {item.key!r}",
            "schedule",
            "is not expanded: detect the scene that holds it, or give its activations",
        )
    return given


@dataclass(frozen=True, slots=True)
class AreaBatch:
    """n areas as arrays.

    area_id, version : (n,) int64
    footprint : (n,) object, shapely MultiPolygon in degrees
    active : spans; none: the area is never active
    floor_m, ceiling_m : (n,) float64, -inf and +inf where unbounded
    numbers : (n, k) int64, numbers of the values of NUMBERED, 0 without
    flat : (n,) object, the footprints in the scene's plane; None: not computed
    """

    area_id: NDArray[np.int64]
    version: NDArray[np.int64]
    footprint: NDArray[np.object_]
    active: Activations
    floor_m: NDArray[np.float64]
    ceiling_m: NDArray[np.float64]
    numbers: NDArray[np.int64]
    flat: NDArray[np.object_] | None = None

    def __len__(self) -> int:
        return len(self.area_id)

    def values(self, name: str) -> NDArray[np.float64]:
        """Return the values (n,) of a column of numbers that change answers, NaN without."""
        return values_in(AREA, self.numbers, name)

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the areas of some rows."""
        columns = {column.name: getattr(self, column.name) for column in fields(self)}
        taken = {
            name: of.take(rows) if name == "active" else of[rows] for name, of in columns.items() if of is not None
        }
        return type(self)(**taken)

    @classmethod
    def of(cls, areas: Sequence[Area], flat: NDArray[np.object_] | None = None) -> "AreaBatch":
        """Return the batch of some areas, numbered from 0."""
        footprint = np.empty(len(areas), dtype=object)
        footprint[:] = [area.footprint for area in areas]
        return cls(
            np.arange(len(areas), dtype=np.int64),
            np.ones(len(areas), dtype=np.int64),
            footprint,
            _activations(areas, [None if a.spans_us is None else _spans(a) for a in areas], outer_spans(areas)),
            numbers=numbers_of_plans(AREA, areas),
            flat=flat,
            **{one.whole: _heights(areas, one) for one in HEIGHT_LIMITS},
        )


def _departures(tracks: Sequence[Track], first_us: NDArray[np.int64]) -> Activations:
    """Return the departures of tracks; without tracks, one each at the times of their first waypoints."""
    return _activations(tracks, [one.departures_us for one in tracks], first_us)


def _activations(
    items: Sequence[Area | Track], given: Sequence[Sequence[Any] | None], once: NDArray[np.int64]
) -> Activations:
    """Return activations as of `Activations.of`; times of stored plans with a schedule without any are unknown."""
    found = Activations.of([_unless_scheduled(*one) for one in zip(items, given, strict=True)], once)
    unknown = [i for i, one in enumerate(items) if has_unknown_times(one)]
    found.is_unknown[unknown] = True
    return found


def outer_spans(areas: Sequence[Area]) -> NDArray[np.int64]:
    """Return (n, 2) start and end of areas, from the first to the last of several spans."""
    start = [MINUS_INFINITY_US if a.start_us is None else a.start_us for a in areas]
    end = [INFINITY_US if a.end_us is None else a.end_us for a in areas]
    return np.array([start, end], np.int64).T.reshape(-1, 2)


def _spans(area: Area) -> list[tuple[int, int]]:
    return [
        (MINUS_INFINITY_US if start is None else start, INFINITY_US if end is None else end)
        for start, end in area.spans_us or ()
    ]


def _heights(plans: Sequence[Area | Track], limit: HeightLimit) -> NDArray[np.float64]:
    """Return a height of plans (n,), infinite where unbounded."""
    given = [getattr(one, limit.whole) for one in plans]
    return np.array([limit.unbounded if height is None else height for height in given], np.float64)


def leg_heights(
    whole_m: NDArray[np.float64], of_legs: Sequence[NDArray[np.float64] | None], legs: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return a height at both ends of all legs of tracks (m, 2): those of legs or waypoints, else of the whole track.

    whole_m, of_legs, legs : for each track; legs: their count
    """
    heights = np.repeat(whole_m, 2 * legs).reshape(-1, 2)
    given = {i: own for i, own in enumerate(of_legs) if own is not None}
    end = np.cumsum(legs) if given else legs
    for i, own in given.items():
        heights[end[i] - legs[i] : end[i]] = heights_of_legs(own, int(legs[i]))
    return heights


@dataclass(frozen=True, slots=True)
class Legs:
    """m legs: track (m,) row of the batch, times in microseconds, ends in degrees (longitudes unwrapped), bearing.

    outline_m, outline_to_m, outline_offset : ragged, (starboard, forward) metres at the leg's start and end,
        counter-clockwise; the same array object if no haven changes
    whole : each leg as one slice, without hulls; None: not computed
    """

    track: NDArray[np.int64]
    start_us: NDArray[np.int64]
    end_us: NDArray[np.int64]
    start_deg: NDArray[np.float64]
    end_deg: NDArray[np.float64]
    bearing_deg: NDArray[np.float64]
    length_m: NDArray[np.float64]
    outline_m: NDArray[np.float64]
    outline_to_m: NDArray[np.float64]
    outline_offset: NDArray[np.int64]
    whole: Pieces | None = None


# The columns of tracks with several rows each: one for each waypoint, or vertex of an outline, or leg.
_RAGGED: Final = {
    "positions_deg": "waypoint_offset",
    "times_us": "waypoint_offset",
    "outline_m": "outline_offset",
    "outlines_m": "outlines_offset",
    "floor_m": "leg_offset",
    "ceiling_m": "leg_offset",
}


@dataclass(frozen=True, slots=True)
class TrackBatch:
    """n tracks as arrays; waypoints and outlines are concatenated, track i has [offset[i], offset[i + 1]).

    Digests have the columns in this order.

    track_id, version : (n,) int64
    waypoint_offset, outline_offset, outlines_offset : (n + 1,) int64
    grow_mps : (n,) float64, outward speed of every side; 0 for a haven that does not grow
    numbers : (n, k) int64, numbers of the values of NUMBERED, 0 without
    positions_deg : (w, 2) float64, longitude and latitude
    times_us : (w,) int64
    departs : departures, at which each voyage begins instead of at its first waypoint's time; none: there is no voyage
    outline_m : (v, 2) float64, starboard and forward
    outlines_m : (u, 2) float64, concatenated outlines of tracks that have one per waypoint; no rows for other tracks
    floor_m, ceiling_m : (w - n, 2) float64, at both ends of each leg, -inf and +inf where unbounded
    tolerances : (n,) object, members of tolerances (`model.tolerances`), or None
    legs : the legs of all tracks in the scene's plane; None: not computed
    """

    track_id: NDArray[np.int64]
    version: NDArray[np.int64]
    waypoint_offset: NDArray[np.int64]
    outline_offset: NDArray[np.int64]
    outlines_offset: NDArray[np.int64]
    grow_mps: NDArray[np.float64]
    numbers: NDArray[np.int64]
    positions_deg: NDArray[np.float64]
    times_us: NDArray[np.int64]
    departs: Activations
    outline_m: NDArray[np.float64]
    outlines_m: NDArray[np.float64]
    floor_m: NDArray[np.float64]
    ceiling_m: NDArray[np.float64]
    tolerances: NDArray[np.object_]
    legs: Legs | None = None

    def __len__(self) -> int:
        return len(self.track_id)

    def values(self, name: str) -> NDArray[np.float64]:
        """Return the values (n,) of a column of numbers that change answers, NaN without."""
        return values_in(TRACK, self.numbers, name)

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the tracks of some rows."""
        taken = {name: ragged_rows(getattr(self, name), rows) for name in dict.fromkeys(_RAGGED.values())}
        columns: dict[str, Any] = {}
        for name, values in self.columns():
            if name in taken:
                columns[name] = taken[name][0]
            elif isinstance(values, Activations):
                columns[name] = values.take(rows)
            else:
                columns[name] = values[taken[_RAGGED[name]][1] if name in _RAGGED else rows]
        return type(self)(**columns)

    @property
    def leg_offset(self) -> NDArray[np.int64]:
        """Return the offsets (n + 1,) of the legs of tracks."""
        return self.waypoint_offset - np.arange(len(self) + 1)

    def columns(self) -> Iterator[tuple[str, Any]]:
        """Yield the columns but `legs`, with their names."""
        return ((column.name, getattr(self, column.name)) for column in fields(self) if column.name != "legs")

    def offset_of(self, name: str) -> NDArray[np.int64] | None:
        """Return the offsets (n + 1,) of tracks in a column, None for one row each."""
        return getattr(self, _RAGGED[name]) if name in _RAGGED else None

    def followed_by(self, other: "TrackBatch") -> "TrackBatch":
        """Return these tracks, then others."""
        columns: dict[str, Any] = {}
        for (name, first), (_, second) in zip(self.columns(), other.columns(), strict=True):
            if isinstance(first, Activations):
                columns[name] = first.followed_by(second)
            elif name in _RAGGED.values():
                columns[name] = followed_by([first, second])
            else:
                columns[name] = np.concatenate([first, second])
        return TrackBatch(**columns)

    @classmethod
    def of(cls, tracks: Sequence[Track], *, once: bool = False) -> "TrackBatch":
        """Return the batch of some tracks, numbered from 0.

        once : each makes one voyage, at the times of its waypoints, whatever its departures are
        """
        waypoint_offset = offsets([len(t.times_us) for t in tracks])
        legs = np.diff(waypoint_offset) - 1
        heights: dict[str, Any] = {
            one.whole: leg_heights(_heights(tracks, one), [getattr(t, one.of_legs) for t in tracks], legs)
            for one in HEIGHT_LIMITS
        }
        tolerances = np.empty(len(tracks), dtype=object)
        tolerances[:] = [track.tolerances for track in tracks]
        return cls(
            track_id=np.arange(len(tracks), dtype=np.int64),
            version=np.ones(len(tracks), dtype=np.int64),
            waypoint_offset=waypoint_offset,
            outline_offset=offsets([len(t.outline_m) for t in tracks]),
            outlines_offset=offsets([0 if t.outlines_m is None else t.outlines_m[..., 0].size for t in tracks]),
            grow_mps=np.array([t.grow_mps for t in tracks], dtype=np.float64),
            numbers=numbers_of_plans(TRACK, tracks),
            positions_deg=stacked([t.positions_deg for t in tracks]),
            times_us=np.concatenate([np.empty(0, np.int64), *(t.times_us for t in tracks)]),
            departs=_departures([] if once else tracks, np.array([t.times_us[0] for t in tracks], np.int64)),
            outline_m=stacked([t.outline_m for t in tracks]),
            outlines_m=stacked([t.outlines_m.reshape(-1, 2) for t in tracks if t.outlines_m is not None]),
            tolerances=tolerances,
            **heights,
        )

    def departing(self, tracks: Sequence[Track]) -> Self:
        """Return these tracks, each of one voyage, with their departures."""
        return replace(self, departs=_departures(tracks, self.departs.at_us))

    def outlines_on(
        self, track: NDArray[np.int64], waypoint: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the outlines of havens at both ends of legs: offset (m + 1,), start and end (s, 2) metres.

        Vertex i of a start moves straight to vertex i of the end. If no haven changes, the end is the same array as the
        start.

        track, waypoint : (m,) rows of the legs' tracks, and of their first waypoints
        """
        if not self.grow_mps.any() and not len(self.outlines_m):
            offset, index = ragged_rows(self.outline_offset, track)
            start = self.outline_m[index]
            return offset, start, start
        return self._changing_outlines(track, waypoint)

    def _changing_outlines(
        self, track: NDArray[np.int64], waypoint: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the outlines of havens that grow, or are given for each waypoint, as `outlines_on`."""
        grows = self.grow_mps > 0.0
        growing, steady = np.flatnonzero(grows), np.flatnonzero(~grows)
        corners, rate, corner_offset = mitred(*ragged_take(self.outline_offset, self.outline_m, growing))
        count = np.diff(self.outline_offset)
        count[growing] = np.diff(corner_offset)
        body = offsets(count)
        of_growing, of_steady = (ragged_rows(body, rows)[1] for rows in (growing, steady))
        outline, speed = np.empty((body[-1], 2)), np.zeros((body[-1], 2))
        outline[of_growing], outline[of_steady] = corners, ragged_take(self.outline_offset, self.outline_m, steady)[0]
        speed[of_growing] = rate * np.repeat(self.grow_mps[growing], count[growing])[:, None]

        offset, index = ragged_rows(body, track)
        leg = np.repeat(np.arange(len(track)), np.diff(offset))
        first = self.waypoint_offset[track]
        ends = []
        for at in (waypoint, waypoint + 1):
            age_s = (self.times_us[at] - self.times_us[first]) / 1e6
            vertices = outline[index] + speed[index] * age_s[leg, None]
            given = np.flatnonzero((np.diff(self.outlines_offset)[track] > 0)[leg])
            of = leg[given]
            nth = given - offset[of] + (at - first)[of] * count[track[of]]
            vertices[given] = self.outlines_m[self.outlines_offset[track[of]] + nth]
            ends.append(vertices)
        start, end = ends
        return offset, start, start if np.array_equal(start, end) else end
