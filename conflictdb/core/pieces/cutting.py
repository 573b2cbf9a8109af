"""Cut objects into convex pieces in the scene's plane, with tight boxes in space and time.

An area becomes convex parts, a track leg one or more time slices. Each piece has a convex hull that covers it during
all of its time, padded so that the hulls of two pieces intersect wherever the pieces come within the scene's reach
(`Scene.reach_m`). Slices only tighten the boxes; stage 4 uses the true motion.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.column_numbers import piece_numbers
from conflictdb.arrays.distinct import distinct
from conflictdb.arrays.objects import Activations, AreaBatch, Legs, TrackBatch
from conflictdb.arrays.pieces import OF_TOLERANCES, Pieces, level_m
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.core.pieces.convex_parts import convex_parts, is_thread
from conflictdb.core.pieces.ribbons import with_ribbons
from conflictdb.earth.geodesy import shorter_way_deg
from conflictdb.earth.plane import ROUNDING_ALLOWANCE_M, Plane
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import MINUS_INFINITY_US, Area, Track, check_legs
from conflictdb.model.results import Kind

# A leg up to this many times as long as its haven (with the scene's reach around it) is one slice; one n times longer
# has about sqrt(n) slices. With n slices the boxes of a leg cover an area proportional to 1 / n, so that pieces and
# their candidates cost c n + d / n, least at the root of the leg's length. The density of the scene matters little: the
# minimum is flat (benchmarks/slicing.py). Smaller values give more pieces, larger values more candidates.
WHOLE_LEG_HAVENS: Final = 32.0
MAX_SLICES: Final = 16
# Limit of the chord deviation that pads a hull, as a share of the haven's reach. A leg above it is cut into shorter
# slices, at most MAX_SLICES_FOR_DEVIATION more per track. Only havens of hundreds of kilometres close to a pole reach
# that number. Their hulls are wider than necessary, and stages 1 and 2 leave more pairs.
MAX_DEVIATION_SHARE: Final = 0.25
MAX_SLICES_FOR_DEVIATION: Final = 1024
# An object with more pieces is not cut: they would take a gigabyte; real tracks have some thousands.
MAX_PIECES: Final = 1_000_000


def check_plane(
    plane: Plane, areas: Sequence[Area], tracks: Sequence[Track]
) -> tuple[NDArray[np.object_], TrackBatch | None]:
    """Raise InvalidInput for the first object that does not fit the plane; return what the check computes.

    These are the footprints of areas in the plane, and the tracks, each on one voyage, with their legs; None without
    tracks.
    """
    flat = np.array([area.footprint for area in areas], dtype=object)
    if len(flat):
        corners, row_of = shapely.get_coordinates(flat, return_index=True)
        x, y, holds = plane.project(*corners.T)
        if not holds.all():
            raise InvalidInput(f"area {areas[row_of[~holds][0]].key!r}", "geometry", plane.limit)
        flat = shapely.set_coordinates(flat.copy(), np.stack([x, y], axis=1))
        if not plane.turn_m:
            flat = _stitched(flat, corners, row_of)
        for i in np.flatnonzero(~shapely.is_valid(flat)).tolist():
            if not is_thread(flat[i]):
                why = shapely.is_valid_reason(flat[i]).split("[")[0]
                rule = f"crosses itself when its edges are {plane.lines} ({why})"
                raise InvalidInput(f"area {areas[i].key!r}", "geometry", rule)
    if not tracks:
        return flat, None
    check_legs(plane.lines, tracks)
    batch = TrackBatch.of(tracks, once=True)
    outside = np.flatnonzero(~plane.holds(*batch.positions_deg.T))
    if outside.size:
        first = np.searchsorted(batch.waypoint_offset, outside[0], side="right") - 1
        raise InvalidInput(f"track {tracks[int(first)].key!r}", "geometry", plane.limit)
    legs = _legs(plane, batch)
    whole, _ = _slices(batch, legs, np.ones(len(legs.track), np.int64))
    beyond = np.flatnonzero(~plane.holds_havens(whole))
    if beyond.size:
        track = tracks[int(legs.track[beyond[0]])]
        field = "grow_mps" if track.grow_mps else "outline_m" if track.outlines_m is None else "outlines_m"
        raise InvalidInput(f"track {track.key!r}", field, plane.haven_limit)
    return flat, replace(batch, legs=replace(legs, whole=whole))


def planar(plane: Plane, footprints: NDArray[np.object_]) -> NDArray[np.object_]:
    """Return footprints (degrees) in the scene's plane (metres)."""

    def project(lonlat: Floats) -> Floats:
        return np.stack(plane.to_plane(lonlat[:, 0], lonlat[:, 1]), axis=1)

    flat = shapely.transform(footprints, project)
    return flat if plane.turn_m else _stitched(flat, *shapely.get_coordinates(footprints, return_index=True))


def _stitched(flat: NDArray[np.object_], lonlat: Floats, row_of: NDArray[np.int64]) -> NDArray[np.object_]:
    """Return footprints in a plane without seam, with parts cut at +-180 degrees or along a pole joined again.

    lonlat, row_of : (v, 2) their corners in degrees, and the row (v,) of each
    """
    cut = row_of[(np.remainder(lonlat[:, 0], 360.0) == 180.0) | (np.abs(lonlat[:, 1]) == 90.0)]
    if not cut.size:
        return flat
    whole = flat.copy()
    for i in np.unique(cut).tolist():
        parts = shapely.make_valid(shapely.get_parts(flat[i]), method="structure", keep_collapsed=False)
        whole[i] = shapely.union_all(parts)
    return whole


def area_pieces(setup: Setup, areas: AreaBatch) -> Pieces:
    """Return the pieces of some areas: their convex parts, and seam copies; ValueError for NaN corners."""
    flat = areas.flat
    if flat is None:
        with np.errstate(invalid="ignore"):
            flat = planar(setup.plane, areas.footprint)
        # GEOS drops such corners from hulls, which are then too small.
        if not np.isfinite(shapely.get_coordinates(flat)).all():
            raise ValueError("a corner has no place in the plane")
    row_of, xy, offset = convex_parts(flat)
    n = len(row_of)
    nothing, none_us = np.zeros((n, 2)), np.zeros(n, np.int64)
    pieces = Pieces(
        piece_id=np.full(n, -1, np.int64),
        kind=np.full(n, Kind.AREA.code, np.int8),
        object_id=areas.area_id[row_of],
        version=areas.version[row_of],
        part=_numbered(row_of),
        turn=np.zeros(n, np.int16),
        start_us=none_us,
        end_us=none_us,
        end_inclusive=np.zeros(n, np.bool_),
        floor_m=areas.floor_m[row_of],
        ceiling_m=areas.ceiling_m[row_of],
        climb_m=level_m(areas.floor_m[row_of], areas.ceiling_m[row_of]),
        hull_xy=np.empty((0, 2)),
        hull_offset=np.zeros(n + 1, np.int64),
        shape_xy=xy,
        shape_to_xy=xy,
        shape_offset=offset,
        leg_start_us=none_us,
        leg_end_us=none_us,
        leg_start_deg=nothing,
        leg_end_deg=nothing,
        bearing_deg=np.zeros(n),
        numbers=piece_numbers(areas.numbers, row_of),
    )
    hulls = kernel.hulls(setup.plane.kernel_plane, pieces, setup.scene.reach_m)
    # Shift coordinates beyond the seam back by whole turns, so that the copy below is always one turn west.
    turns = _turns_from_home(setup.plane, hulls)
    if turns.any():
        shift = -setup.plane.turn_m * turns
        xy[:, 0] += np.repeat(shift, np.diff(offset))
        hulls.xy[:, 0] += np.repeat(shift, np.diff(hulls.offset))
    return _active(with_seam_copies(setup.plane, pieces.having(hull_xy=hulls.xy, hull_offset=hulls.offset)), areas)


def track_pieces(setup: Setup, tracks: TrackBatch) -> Pieces:
    """Return the pieces of some tracks: time slices of their legs, and seam copies."""
    has_tolerances = np.array([one is not None for one in tracks.tolerances], np.bool_)
    of_tolerances = tracks.track_id[has_tolerances]
    tracks = with_ribbons(setup.plane, tracks)
    legs = tracks.legs or _legs(setup.plane, tracks)
    count = _slice_counts(legs, setup.scene.reach_m)
    straight = np.bincount(legs.track, count)
    while True:
        if np.bincount(legs.track, count).max(initial=0.0) > MAX_PIECES:
            raise OverflowError(f"a track needs more than {MAX_PIECES:,} pieces")
        if legs.whole is not None and (count == 1).all():
            pieces, leg = legs.whole, np.arange(len(count))
        else:
            pieces, leg = _slices(tracks, legs, count)
        hulls = kernel.hulls(setup.plane.kernel_plane, pieces, setup.scene.reach_m)
        # Near the poles the vertices of a wide haven deviate far from their chords: shorten the slices until the
        # padding is tight.
        loose = np.zeros(len(count), np.bool_)
        loose[leg[hulls.deviation_m > MAX_DEVIATION_SHARE * hulls.reach_m]] = True
        loose &= 2 * count <= legs.end_us - legs.start_us
        added = np.bincount(legs.track, np.where(loose, 2 * count, count)) - straight
        loose &= added[legs.track] <= MAX_SLICES_FOR_DEVIATION
        if not loose.any():
            break
        count = np.where(loose, 2 * count, count)
    turns = _turns_from_home(setup.plane, hulls)
    columns: dict[str, Any] = {"hull_xy": hulls.xy, "hull_offset": hulls.offset}
    if turns.any():
        hulls.xy[:, 0] -= np.repeat(setup.plane.turn_m * turns, np.diff(hulls.offset))
        away = np.stack([360.0 * turns, np.zeros(len(pieces))], axis=1)
        columns |= {name: getattr(pieces, name) - away for name in ("leg_start_deg", "leg_end_deg")}
    pieces = _departing(with_seam_copies(setup.plane, pieces.having(**columns)), tracks)
    if not of_tolerances.size:
        return pieces
    part = pieces.part + np.where(np.isin(pieces.object_id, of_tolerances), OF_TOLERANCES, 0)
    return pieces.having(part=part.astype(np.int32))


def _active(pieces: Pieces, areas: AreaBatch) -> Pieces:
    """Return the pieces of areas once for each of their spans."""
    repeated, at = _repeated(pieces, areas.area_id, areas.active)
    start_us, end_us = areas.active.at_us[at].T
    return repeated.having(start_us=start_us.copy(), end_us=end_us.copy())


def _departing(pieces: Pieces, tracks: TrackBatch) -> Pieces:
    """Return the pieces of tracks once for each of their departures, moved in time."""
    first_us = tracks.times_us[tracks.waypoint_offset[:-1]]
    departs = tracks.departs
    if len(departs.at_us) == len(tracks) and (departs.at_us == first_us).all():
        return pieces
    repeated, at = _repeated(pieces, tracks.track_id, departs)
    voyage = np.repeat(np.arange(len(tracks)), np.diff(departs.offset))
    later_us = (departs.at_us - first_us[voyage])[at]
    times = ("start_us", "end_us", "leg_start_us", "leg_end_us")
    return repeated.having(**{name: getattr(repeated, name) + later_us for name in times})


def _repeated(pieces: Pieces, ids: NDArray[np.int64], activations: Activations) -> tuple[Pieces, NDArray[np.int64]]:
    """Return pieces once for each activation of their object, with parts numbered on, and the activation of each.

    ids : (n,) of the objects, whose activations these are
    """
    by_id = np.argsort(ids, kind="stable")
    row_of = by_id[np.searchsorted(ids, pieces.object_id, sorter=by_id)]
    offset = activations.offset
    count = np.diff(offset)[row_of]
    if (count == 1).all():
        return pieces, offset[row_of]
    parts = np.zeros(len(ids), np.int64)
    np.maximum.at(parts, row_of, pieces.part + 1)
    most = int((parts * np.diff(offset)).max(initial=0))
    if most > MAX_PIECES:
        raise OverflowError(f"an object needs more than {MAX_PIECES:,} pieces")
    rows = np.repeat(np.arange(len(pieces)), count)
    nth = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
    part = pieces.part[rows] + nth * parts[row_of[rows]]
    # As without activations: copies after originals, then by object and part.
    order = np.lexsort((part, row_of[rows], -pieces.turn[rows]))
    rows, nth = rows[order], nth[order]
    return pieces.take(rows).having(part=part[order].astype(np.int32)), offset[row_of[rows]] + nth


def _slices(tracks: TrackBatch, legs: Legs, count: NDArray[np.int64]) -> tuple[Pieces, NDArray[np.int64]]:
    """Return the slices of all legs, without hulls, and the leg of each."""
    leg = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(leg)) - np.repeat(np.cumsum(count) - count, count)
    n = len(leg)
    track = legs.track[leg]
    shape_offset, index = ragged_rows(legs.outline_offset, leg)
    shape = legs.outline_m[index]
    changes = legs.outline_to_m is not legs.outline_m
    pieces = Pieces(
        piece_id=np.full(n, -1, np.int64),
        kind=np.full(n, Kind.TRACK.code, np.int8),
        object_id=tracks.track_id[track],
        version=tracks.version[track],
        part=_numbered(tracks.track_id[track]),
        turn=np.zeros(n, np.int16),
        start_us=_cut(legs, count, leg, nth),
        end_us=_cut(legs, count, leg, nth + 1),
        end_inclusive=_ends_inside(tracks)[track] | np.append(track[1:] == track[:-1], False)[:n],
        floor_m=tracks.floor_m[leg].min(axis=1),
        ceiling_m=tracks.ceiling_m[leg].max(axis=1),
        climb_m=np.concatenate([tracks.floor_m[leg], tracks.ceiling_m[leg]], axis=1),
        hull_xy=np.empty((0, 2)),
        hull_offset=np.zeros(n + 1, np.int64),
        shape_xy=shape,
        shape_to_xy=legs.outline_to_m[index] if changes else shape,
        shape_offset=shape_offset,
        leg_start_us=legs.start_us[leg],
        leg_end_us=legs.end_us[leg],
        leg_start_deg=legs.start_deg[leg],
        leg_end_deg=legs.end_deg[leg],
        bearing_deg=legs.bearing_deg[leg],
        numbers=piece_numbers(tracks.numbers, track),
    )
    return pieces, leg


def _ends_inside(tracks: TrackBatch) -> NDArray[np.bool_]:
    """Return (n,) whether a row ends before the last row of the same track does."""
    if (tracks.track_id[1:] > tracks.track_id[:-1]).all():
        return np.zeros(len(tracks), np.bool_)
    end_us = tracks.times_us[tracks.waypoint_offset[1:] - 1]
    one = distinct(tracks.track_id)[1]
    last_us = np.full(len(tracks), MINUS_INFINITY_US)
    np.maximum.at(last_us, one, end_us)
    return np.asarray(end_us < last_us[one])


def _legs(plane: Plane, tracks: TrackBatch) -> Legs:
    waypoints = np.diff(tracks.waypoint_offset)
    of_waypoint = np.repeat(np.arange(len(tracks)), waypoints)
    lon = tracks.positions_deg[:, 0]
    step = np.append(0.0, shorter_way_deg(np.diff(lon)))[: len(lon)]
    gone = np.cumsum(step)
    first = tracks.waypoint_offset[:-1][of_waypoint]
    unwrapped = lon[first] + gone - gone[first]
    # Add only whole turns, so that a longitude keeps its digits.
    positions = np.stack([lon + 360.0 * np.round((unwrapped - lon) / 360.0), tracks.positions_deg[:, 1]], axis=1)
    inner = np.flatnonzero(of_waypoint[1:] == of_waypoint[:-1])
    start, end = positions[inner], positions[inner + 1]
    length_m, first_deg, last_deg = plane.courses(start, end)
    track = of_waypoint[inner]
    outline_offset, outline, outline_to = _counter_clockwise(*tracks.outlines_on(track, inner))
    return Legs(
        track=track,
        start_us=tracks.times_us[inner],
        end_us=tracks.times_us[inner + 1],
        start_deg=start,
        end_deg=end,
        bearing_deg=_headings(track, start, end, first_deg, last_deg, length_m > 0.0),
        length_m=length_m,
        outline_m=outline,
        outline_to_m=outline_to,
        outline_offset=outline_offset,
    )


def _headings(
    track: NDArray[np.int64],
    start_deg: Floats,
    end_deg: Floats,
    first_deg: Floats,
    last_deg: Floats,
    moves: NDArray[np.bool_],
) -> Floats:
    """Return the heading of each leg at its start, degrees.

    A loiter keeps that of the leg before it (at its end), else of the next moving leg (at its start), else north.
    """
    if moves.all():
        return first_deg
    rows = np.arange(len(track))
    before = np.maximum.accumulate(np.where(moves, rows, -1))
    after = np.minimum.accumulate(np.where(moves, rows, len(rows))[::-1])[::-1]
    has_before = (before >= 0) & (track[before] == track)
    after = np.minimum(after, len(rows) - 1)
    has_after = moves[after] & (track[after] == track)
    kept = last_deg[before] + _meridians_apart(start_deg, end_deg[before])
    left = first_deg[after] + _meridians_apart(start_deg, start_deg[after])
    return np.where(moves, first_deg, np.where(has_before, kept, np.where(has_after, left, 0.0)))


def _meridians_apart(place_deg: Floats, same_place_deg: Floats) -> Floats:
    """Return the difference of a bearing between two notations of a place."""
    return np.sign(place_deg[:, 1]) * (place_deg[:, 0] - same_place_deg[:, 0])


def _slice_counts(legs: Legs, reach_m: float) -> NDArray[np.int64]:
    """Return (m,) the number of slices of each leg, from its length relative to its haven's (the mean of both ends)."""
    radius = np.hypot(legs.outline_m[:, 0], legs.outline_m[:, 1])
    first = legs.outline_offset[:-1]
    haven = 2.0 * np.maximum.reduceat(radius, first)
    if legs.outline_to_m is not legs.outline_m:
        radius_to = np.hypot(legs.outline_to_m[:, 0], legs.outline_to_m[:, 1])
        haven = 0.5 * haven + np.maximum.reduceat(radius_to, first)
    whole_m = WHOLE_LEG_HAVENS * (haven + reach_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        count = np.sqrt(np.where(legs.length_m > 0.0, legs.length_m / whole_m, 0.0))
    count = np.clip(np.ceil(count), 1.0, MAX_SLICES).astype(np.int64)
    return np.minimum(count, legs.end_us - legs.start_us)


def _cut(legs: Legs, count: NDArray[np.int64], leg: NDArray[np.int64], nth: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the instants (whole microseconds) at nth / count of legs, without overflow of 64 bits."""
    whole, rest = np.divmod((legs.end_us - legs.start_us)[leg], count[leg])
    return legs.start_us[leg] + whole * nth + rest * nth // count[leg]


def _counter_clockwise(
    offset: NDArray[np.int64], start: Floats, end: Floats
) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return outlines (at the start and end of legs) turned counter-clockwise; identical arrays stay identical."""
    row_of = np.repeat(np.arange(len(offset) - 1), np.diff(offset))
    after = np.arange(len(start)) + 1
    after[offset[1:] - 1] = offset[:-1]
    doubled = np.zeros(len(offset) - 1)
    # Both ends turn the same way, if they are more than a line: a haven that stays convex does not turn over.
    for outline in (start,) if end is start else (start, end):
        np.add.at(doubled, row_of, outline[:, 0] * outline[after, 1] - outline[:, 1] * outline[after, 0])
    mirrored = offset[:-1][row_of] + offset[1:][row_of] - 1 - np.arange(len(start))
    order = np.where((doubled < 0.0)[row_of], mirrored, np.arange(len(start)))
    turned = start[order]
    return offset, turned, turned if end is start else end[order]


def _turns_from_home(plane: Plane, hulls: kernel.Hulls) -> Floats:
    """Return (n,) by how many whole turns the west end of each hull lies outside [-180, 180) degrees."""
    turns = np.zeros(len(hulls.offset) - 1)
    if plane.turn_m:
        rows = (hulls.offset[1:] > hulls.offset[:-1]).nonzero()[0]
        turns[rows] = np.floor(_extreme(np.minimum, hulls.xy, hulls.offset, rows) / plane.turn_m + 0.5)
    return turns


def _extreme(least_or_most: np.ufunc, xy: Floats, offset: NDArray[np.int64], rows: NDArray[np.int64]) -> Floats:
    """Return the least or the largest x of the hulls in `rows`, which are all hulls with vertices."""
    return np.asarray(least_or_most.reduceat(xy[:, 0], offset[rows])) if rows.size else np.empty(0)


def with_seam_copies(plane: Plane, pieces: Pieces) -> Pieces:
    """Return the pieces and, for those that reach +180 degrees, copies one turn west, or more for wider ones."""
    turn_m = plane.turn_m
    if not len(pieces) or not turn_m:
        return pieces
    there = (pieces.hull_offset[1:] > pieces.hull_offset[:-1]).nonzero()[0]
    east = _extreme(np.maximum, pieces.hull_xy, pieces.hull_offset, there)
    # A contact on the seam must be found from both sides.
    beyond = np.zeros(len(pieces), np.int64)
    beyond[there] = np.floor((east + ROUNDING_ALLOWANCE_M) / turn_m + 0.5)
    if not beyond.any():
        return pieces
    found = [pieces]
    for turn in range(1, int(beyond.max()) + 1):
        copies = pieces.take(np.flatnonzero(beyond >= turn))
        shifted = copies.hull_xy - np.array([turn * turn_m, 0.0])
        found.append(copies.having(hull_xy=shifted, turn=copies.turn - np.int16(turn)))
    return Pieces.concatenate(found)


def _numbered(row_of: NDArray[np.int64]) -> NDArray[np.int32]:
    """Return for sorted rows the running number within each."""
    if not len(row_of):
        return np.empty(0, np.int32)
    is_new = np.ones(len(row_of), np.bool_)
    np.not_equal(row_of[1:], row_of[:-1], out=is_new[1:])
    return (np.arange(len(row_of)) - is_new.nonzero()[0][is_new.cumsum() - 1]).astype(np.int32)
