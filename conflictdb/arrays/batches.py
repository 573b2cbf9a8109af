"""Objects, pieces, pairs and results as arrays: what passes between the database and the stages.

Ragged data is concatenated: item i owns rows [offset[i], offset[i + 1]).
Units: metres, degrees for longitude, latitude and bearings, microseconds since 1970 for instants.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.model import FOR_EVER_US, SINCE_EVER_US, Area, Track
from conflictdb.outlines import mitred


@dataclass(frozen=True, slots=True)
class AreaBatch:
    """n areas as arrays.

    area_id, version : (n,) int64
    footprint : (n,) object, shapely MultiPolygon in degrees
    start_us, end_us : (n,) int64, SINCE_EVER_US and FOR_EVER_US where unbounded
    floor_m, ceiling_m : (n,) float64, -inf and +inf where unbounded
    """

    area_id: NDArray[np.int64]
    version: NDArray[np.int64]
    footprint: NDArray[np.object_]
    start_us: NDArray[np.int64]
    end_us: NDArray[np.int64]
    floor_m: NDArray[np.float64]
    ceiling_m: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.area_id)

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the areas of some rows."""
        return type(self)(*(getattr(self, column.name)[rows] for column in fields(self)))

    @classmethod
    def of(cls, areas: Sequence[Area]) -> "AreaBatch":
        """Return the batch of some areas, numbered from 0."""
        footprint = np.empty(len(areas), dtype=object)
        footprint[:] = [area.footprint for area in areas]
        return cls(
            np.arange(len(areas), dtype=np.int64),
            np.ones(len(areas), dtype=np.int64),
            footprint,
            np.array([SINCE_EVER_US if a.start_us is None else a.start_us for a in areas], dtype=np.int64),
            np.array([FOR_EVER_US if a.end_us is None else a.end_us for a in areas], dtype=np.int64),
            np.array([-np.inf if a.floor_m is None else a.floor_m for a in areas], dtype=np.float64),
            np.array([np.inf if a.ceiling_m is None else a.ceiling_m for a in areas], dtype=np.float64),
        )


@dataclass(frozen=True, slots=True)
class TrackBatch:
    """n tracks as arrays; waypoints and outlines are concatenated, track i owning [offset[i], offset[i + 1]).

    track_id, version : (n,) int64
    waypoint_offset : (n + 1,) int64
    positions_deg : (w, 2) float64, longitude and latitude
    times_us : (w,) int64
    outline_offset : (n + 1,) int64
    outline_m : (v, 2) float64, starboard and forward
    floor_m, ceiling_m : (w - n,) float64, of each leg, -inf and +inf where unbounded
    grow_mps : (n,) float64, outward speed of every side; 0 where the haven does not grow
    outlines_offset : (n + 1,) int64
    outlines_m : (u, 2) float64, the outlines of tracks that have one per waypoint, one after the other; else no rows
    """

    track_id: NDArray[np.int64]
    version: NDArray[np.int64]
    waypoint_offset: NDArray[np.int64]
    positions_deg: NDArray[np.float64]
    times_us: NDArray[np.int64]
    outline_offset: NDArray[np.int64]
    outline_m: NDArray[np.float64]
    floor_m: NDArray[np.float64]
    ceiling_m: NDArray[np.float64]
    grow_mps: NDArray[np.float64]
    outlines_offset: NDArray[np.int64]
    outlines_m: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.track_id)

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the tracks of some rows."""
        legs = ragged_rows(self.waypoint_offset - np.arange(len(self) + 1), rows)[1]
        positions_deg, waypoint_offset = _taken(self.waypoint_offset, self.positions_deg, rows)
        outline_m, outline_offset = _taken(self.outline_offset, self.outline_m, rows)
        outlines_m, outlines_offset = _taken(self.outlines_offset, self.outlines_m, rows)
        return type(self)(
            self.track_id[rows],
            self.version[rows],
            waypoint_offset,
            positions_deg,
            self.times_us[ragged_rows(self.waypoint_offset, rows)[1]],
            outline_offset,
            outline_m,
            self.floor_m[legs],
            self.ceiling_m[legs],
            self.grow_mps[rows],
            outlines_offset,
            outlines_m,
        )

    @classmethod
    def of(cls, tracks: Sequence[Track]) -> "TrackBatch":
        """Return the batch of some tracks, numbered from 0."""
        heights = [t.heights_m() for t in tracks]
        return cls(
            np.arange(len(tracks), dtype=np.int64),
            np.ones(len(tracks), dtype=np.int64),
            _offsets([len(t.times_us) for t in tracks]),
            _stacked([t.positions_deg for t in tracks]),
            np.concatenate([np.empty(0, np.int64), *(t.times_us for t in tracks)]),
            _offsets([len(t.outline_m) for t in tracks]),
            _stacked([t.outline_m for t in tracks]),
            np.concatenate([np.empty(0), *(floors_m for floors_m, _ in heights)]),
            np.concatenate([np.empty(0), *(ceilings_m for _, ceilings_m in heights)]),
            np.array([t.grow_mps for t in tracks], dtype=np.float64),
            _offsets([0 if t.outlines_m is None else t.outlines_m[..., 0].size for t in tracks]),
            _stacked([t.outlines_m.reshape(-1, 2) for t in tracks if t.outlines_m is not None]),
        )

    def outlines_on(
        self, track: NDArray[np.int64], waypoint: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the outlines of havens at both ends of legs: offset (m + 1,), start and end (s, 2) metres.

        Vertex i of a start moves straight to vertex i of the end. Where nothing changes on any leg the end is the same
        array as the start.

        track, waypoint : (m,) rows of the legs' tracks, and of their first waypoints
        """
        if not self.grow_mps.any() and not len(self.outlines_m):
            offset, index = ragged_rows(self.outline_offset, track)
            start = self.outline_m[index]
            return offset, start, start
        grows = self.grow_mps > 0.0
        growing, steady = np.flatnonzero(grows), np.flatnonzero(~grows)
        corners, rate, corner_offset = mitred(*_taken(self.outline_offset, self.outline_m, growing))
        count = np.diff(self.outline_offset)
        count[growing] = np.diff(corner_offset)
        body = _offsets(count)
        of_growing, of_steady = (ragged_rows(body, rows)[1] for rows in (growing, steady))
        outline, speed = np.empty((body[-1], 2)), np.zeros((body[-1], 2))
        outline[of_growing], outline[of_steady] = corners, _taken(self.outline_offset, self.outline_m, steady)[0]
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


def _taken(
    offset: NDArray[np.int64], items: NDArray[np.float64], rows: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    taken, index = ragged_rows(offset, rows)
    return items[index], taken


def _offsets(lengths: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(np.asarray(lengths, dtype=np.int64))]).astype(np.int64)


def ragged_rows(offset: NDArray[np.int64], rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the offsets of some rows of ragged data, and where their items stand."""
    length = offset[rows + 1] - offset[rows]
    taken = _offsets(length)
    return taken, np.repeat(offset[rows] - taken[:-1], length) + np.arange(taken[-1])


def _stacked(arrays: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate([np.empty((0, 2)), *arrays])


@dataclass(frozen=True, slots=True)
class Pieces:
    """n pieces: the unit that stages 1 to 4 work on.

    piece_id : (n,) int64         database id; -1 before it has one
    kind : (n,) int8              Kind of the object: 0 area, 1 track
    object_id, version : (n,) int64
    part : (n,) int32             number of the piece within its object, from 0; the seam copy shares it
    turn : (n,) int16             0, or -1, -2, ... for a seam copy: shifted by this many whole turns of longitude
    start_us, end_us : (n,) int64 SINCE_EVER_US, FOR_EVER_US where unbounded
    end_inclusive : (n,) bool     whether the instant end_us belongs to the piece (inner slices: yes, the object's
        end: no)
    floor_m, ceiling_m : (n,) float64   -inf, +inf where unbounded
    hull_xy, hull_offset : (h, 2) float64, (n + 1,) int64   padded convex hull of everything the piece covers, closed
        ring, plane coordinates in metres, shifted by `turn`
    shape_xy, shape_offset : (s, 2) float64, (n + 1,) int64  open ring, counter-clockwise, not shifted. Area: the exact
        convex part in the plane, metres. Track: the outline (starboard, forward) at the start of the leg, metres
    shape_to_xy : (s, 2) float64  the same vertices at the end of the leg; the very same array where nothing changes
    leg_start_us, leg_end_us : (n,) int64   tracks: the whole leg that the slice is cut from (areas: 0)
    leg_start_deg, leg_end_deg : (n, 2) float64   tracks: longitude (unwrapped, not shifted) and latitude (areas: 0)
    bearing_deg : (n,) float64    tracks: heading of the haven, clockwise from north (areas: 0)
    """

    piece_id: NDArray[np.int64]
    kind: NDArray[np.int8]
    object_id: NDArray[np.int64]
    version: NDArray[np.int64]
    part: NDArray[np.int32]
    turn: NDArray[np.int16]
    start_us: NDArray[np.int64]
    end_us: NDArray[np.int64]
    end_inclusive: NDArray[np.bool_]
    floor_m: NDArray[np.float64]
    ceiling_m: NDArray[np.float64]
    hull_xy: NDArray[np.float64]
    hull_offset: NDArray[np.int64]
    shape_xy: NDArray[np.float64]
    shape_to_xy: NDArray[np.float64]
    shape_offset: NDArray[np.int64]
    leg_start_us: NDArray[np.int64]
    leg_end_us: NDArray[np.int64]
    leg_start_deg: NDArray[np.float64]
    leg_end_deg: NDArray[np.float64]
    bearing_deg: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.piece_id)

    @property
    def changes(self) -> bool:
        """Whether any haven has another outline at the end of its leg than at the start."""
        return self.shape_to_xy is not self.shape_xy

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the pieces of some rows."""
        columns: dict[str, Any] = {}
        for column in fields(self):
            if column.name.endswith("_offset"):
                ragged = column.name.replace("_offset", "_xy")
                columns[column.name], index = ragged_rows(getattr(self, column.name), rows)
                columns[ragged] = getattr(self, ragged)[index]
                if ragged == "shape_xy":
                    columns["shape_to_xy"] = self.shape_to_xy[index] if self.changes else columns[ragged]
            elif not column.name.endswith("_xy"):
                columns[column.name] = getattr(self, column.name)[rows]
        return type(self)(**columns)

    @classmethod
    def concatenate(cls, batches: Sequence["Pieces"]) -> Self:
        """Return the pieces of all batches in one; at least one batch."""
        columns: dict[str, Any] = {}
        for column in fields(cls):
            parts = [getattr(batch, column.name) for batch in batches]
            if column.name.endswith("_offset"):
                ends = np.cumsum([0, *(part[-1] for part in parts)])
                parts = [np.zeros(1, np.int64), *(part[1:] + end for part, end in zip(parts, ends, strict=False))]
            columns[column.name] = np.concatenate(parts)
        if not any(batch.changes for batch in batches):
            columns["shape_to_xy"] = columns["shape_xy"]
        return cls(**columns)


@dataclass(frozen=True, slots=True)
class Pairs:
    """n pairs of pieces that passed stage 2.

    a, b : (n,) int64   row numbers in a `Pieces` batch (not database ids)
    region_xy, region_offset : (r, 2) float64, (n + 1,) int64   vertices of the intersection of the two hulls, plane
        coordinates in metres (shifted like the hulls); none where it was not computed (static pairs)
    company : (n,) int64   how many of the pairs are of the same two objects, which share the work that may be done for
        these; None is one each
    """

    a: NDArray[np.int64]
    b: NDArray[np.int64]
    region_xy: NDArray[np.float64]
    region_offset: NDArray[np.int64]
    company: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.a)

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return some of the pairs."""
        offset, index = ragged_rows(self.region_offset, rows)
        company = None if self.company is None else self.company[rows]
        return type(self)(self.a[rows], self.b[rows], self.region_xy[index], offset, company)


@dataclass(frozen=True, slots=True)
class Conflicts:
    """n pairs of objects that interfere, or might, or come near each other (these have no periods).

    The order of a and b within a pair is free: the store puts the area, else the smaller key, first.

    a_kind, b_kind : (n,) int8
    a_id, b_id, a_version, b_version : (n,) int64
    period_us, period_offset : (p, 2) int64, (n + 1,) int64   inclusive, increasing, disjoint; SINCE_EVER_US and
        FOR_EVER_US where unbounded
    verdict : (n,) int8            Verdict.code
    first_contact_deg : (n, 2) float64   longitude and latitude of the first contact; NaN if not computed
    time_error_s : (n,) float64    bound on the error of every end of every period, seconds; 0 if exact
    closest_us : (n,) int64        instant of the closest approach; SINCE_EVER_US where there is none
    closest_m, closest_error_m : (n,) float64   distance then, metres on the earth, and how much less the least distance
        may be; NaN if not computed
    closest_a_deg, closest_b_deg : (n, 2) float64   longitude and latitude of the nearest points then; NaN if not
        computed
    """

    a_kind: NDArray[np.int8]
    a_id: NDArray[np.int64]
    a_version: NDArray[np.int64]
    b_kind: NDArray[np.int8]
    b_id: NDArray[np.int64]
    b_version: NDArray[np.int64]
    period_us: NDArray[np.int64]
    period_offset: NDArray[np.int64]
    verdict: NDArray[np.int8]
    first_contact_deg: NDArray[np.float64]
    time_error_s: NDArray[np.float64]
    closest_us: NDArray[np.int64]
    closest_m: NDArray[np.float64]
    closest_error_m: NDArray[np.float64]
    closest_a_deg: NDArray[np.float64]
    closest_b_deg: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.a_id)


@dataclass(frozen=True, slots=True)
class Contacts:
    """m intervals during which pairs of pieces interfere, or might.

    pair : (m,) int64          row number of the pair, not decreasing
    start_s, end_s : (m,) float64   seconds after the start of the pair's shared span; the true interval lies within
    error_s : (m,) float64     bound on how far either end may lie outside of the true one, seconds
    verdict : (m,) int8        Verdict.code
    touches : (m,) bool        whether they meet during it, not only come within the tolerance
    """

    pair: NDArray[np.int64]
    start_s: NDArray[np.float64]
    end_s: NDArray[np.float64]
    error_s: NDArray[np.float64]
    verdict: NDArray[np.int8]
    touches: NDArray[np.bool_]

    def of_pairs(self, rows: NDArray[np.int64]) -> "Contacts":
        """Return the same contacts where pair k is number rows[k] elsewhere."""
        return replace(self, pair=rows[self.pair])

    def __len__(self) -> int:
        return len(self.pair)

    @classmethod
    def concatenate(cls, batches: Sequence["Contacts"]) -> Self:
        """Return all contacts in one, sorted by pair and start; at least one batch."""
        columns = [np.concatenate([getattr(batch, column.name) for batch in batches]) for column in fields(cls)]
        order = np.lexsort((columns[1], columns[0]))
        return cls(*(column[order] for column in columns))
