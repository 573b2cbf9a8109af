"""Cut objects into pieces; cover an object whose cutting fails by one piece, which is reported and stops no other.

A cover is one piece as wide as the plane, during all of the object's time and at all of its heights, with part number
COVER. It is a candidate with everything, and is not solved: its pairs are `unresolved` while they share time and
height. It is replaced like other pieces when the object changes. (A polygon that merely cannot be triangulated is
replaced by its hull instead, see `convex_parts`.) The pieces of an object whose times are unknown are covers, too, as
wide as they are.
"""

from collections.abc import Callable
from typing import Final, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.column_numbers import CLASS, piece_numbers
from conflictdb.arrays.distinct import is_in
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.objects import Activations, AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces, level_m
from conflictdb.core.pieces.cutting import area_pieces, track_pieces
from conflictdb.core.separations import Separations, with_closed_heights, with_margin
from conflictdb.earth.geodesy import MEAN_RADIUS_M
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import MAX_FROM_CENTRE_DEG, MAX_INSTANT_US, MIN_INSTANT_US, Intervals
from conflictdb.model.results import Kind

# Part number of covers.
COVER: Final = -1
# No object lies wholly beyond this latitude in a Mercator plane.
_HIGHEST_DEG: Final = 89.5

Batch = TypeVar("Batch", AreaBatch, TrackBatch)
# Annotations of inner functions are computed whenever these are made.
_Rows: TypeAlias = NDArray[np.int64]


def pieces_of(setup: Setup, areas: AreaBatch, tracks: TrackBatch) -> Pieces:
    """Return the pieces of objects; an object that cannot be cut is covered.

    Each end of their heights is half of the vertical separation further out, rounded to the nanometre, so that two of
    them overlap where the objects' heights are closer than that. By separation rules the distances are the largest that
    an object can need. In a scene with closed intervals, their ends belong to them.
    """
    if setup.scene.rules:
        return _pieces_by_rules(setup, areas, tracks)
    made = [
        *_pieces(setup, areas, areas.area_id, area_pieces, _area_covers),
        *_pieces(setup, tracks, tracks.track_id, track_pieces, _track_covers),
    ]
    pieces = Pieces.concatenate(made or [area_pieces(setup, areas)])
    if setup.scene.vertical_separation_m > 0.0:
        pieces = with_margin(pieces, 0.5 * setup.scene.vertical_separation_m)
    if setup.scene.intervals == Intervals.HALF_OPEN:
        return pieces
    return with_closed_heights(pieces.having(end_inclusive=np.ones(len(pieces), np.bool_)))


def _pieces_by_rules(setup: Setup, areas: AreaBatch, tracks: TrackBatch) -> Pieces:
    """Return the pieces of objects, by the largest separations that each can need."""
    separations, made = Separations.of(setup.scene), []
    needs = [separations.padding(one) for one in range(len(separations.of_types))]
    distinct = list(dict.fromkeys(needs))
    of_type = np.array([distinct.index(one) for one in needs])
    for kind, batch in ((Kind.AREA, areas), (Kind.TRACK, tracks)):
        classes = batch.numbers[:, CLASS]
        number = of_type[separations.types(np.full(len(batch), kind.code, np.int8), classes)]
        for i in np.unique(number).tolist():
            some, nothing = batch.take(np.flatnonzero(number == i)), np.empty(0, np.int64)
            both = (some, tracks.take(nothing)) if isinstance(some, AreaBatch) else (areas.take(nothing), some)
            made.append(pieces_of(setup.under(distinct[i]), *both))
    return Pieces.concatenate(made) if made else pieces_of(setup.under(separations.settings[0]), areas, tracks)


def is_covered(pieces: Pieces, a: PieceRows, b: PieceRows) -> NDArray[np.bool_]:
    """Return (n,) whether piece a or b (n,) is a cover: only its time and heights are known."""
    return (pieces.part[a] == COVER) | (pieces.part[b] == COVER)


def _pieces(
    setup: Setup,
    batch: Batch,
    ids: NDArray[np.int64],
    cut: Callable[[Setup, Batch], Pieces],
    covers: Callable[[Plane, Batch], Pieces],
) -> list[Pieces]:
    kind = "area" if isinstance(batch, AreaBatch) else "track"
    if not len(batch):
        return []
    # An object that is never active has no pieces.
    activations = batch.active if isinstance(batch, AreaBatch) else batch.departs
    every, unknown = np.flatnonzero(np.diff(activations.offset)), ids[activations.is_unknown]

    def cut_some(rows: _Rows) -> Pieces:
        return _of_any_time(cut(setup, batch if len(rows) == len(batch) else batch.take(rows)), unknown)

    def cover(rows: _Rows) -> Pieces:
        return _of_any_time(covers(setup.plane, batch.take(rows)), unknown)

    found = []
    for rows, pieces in isolated(every, cut_some, cover, f"{kind} in row"):
        unsound = rows[~is_in(ids[rows], _sound(pieces))]
        if unsound.size:
            found.append(pieces.take(np.flatnonzero(~np.isin(pieces.object_id, ids[unsound]))))
            found.append(cover(unsound))
        else:
            found.append(pieces)
    return found


def _of_any_time(pieces: Pieces, unknown: NDArray[np.int64]) -> Pieces:
    """Return pieces with those of objects (k,) whose times are unknown as covers: a track may be there at any time."""
    if not unknown.size:
        return pieces
    rows = np.isin(pieces.object_id, unknown)
    at_us = {name: getattr(pieces, name) for name in ("start_us", "end_us", "leg_start_us", "leg_end_us")}
    moves = rows & (pieces.kind == Kind.TRACK.code)
    for name, times_us in at_us.items():
        at_us[name] = np.where(moves, MIN_INSTANT_US if "start" in name else MAX_INSTANT_US, times_us)
    return pieces.having(part=np.where(rows, COVER, pieces.part).astype(np.int32), **at_us)


def _sound(pieces: Pieces) -> NDArray[np.int64]:
    """Return the objects that have pieces, all with finite coordinates."""
    bad = np.zeros(len(pieces), np.bool_)
    for xy, offset in ((pieces.hull_xy, pieces.hull_offset), (pieces.shape_xy, pieces.shape_offset)):
        finite = np.isfinite(xy)
        if not finite.all():
            bad[np.repeat(np.arange(len(pieces)), np.diff(offset))[~finite.all(axis=1)]] = True
        bad |= offset[1:] == offset[:-1]
    if not bad.any():
        return pieces.object_id
    return np.setdiff1d(pieces.object_id, pieces.object_id[bad])


def _ends(activations: Activations) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and the last activation of objects that have one at least."""
    return activations.offset[:-1], activations.offset[1:] - 1


def _area_covers(plane: Plane, areas: AreaBatch) -> Pieces:
    # From the first to the last activation.
    start_us, end_us = (areas.active.at_us[row, side] for side, row in enumerate(_ends(areas.active)))
    return _covers(plane, Kind.AREA, areas, areas.area_id, start_us, end_us, areas.floor_m, areas.ceiling_m)


def _track_covers(plane: Plane, tracks: TrackBatch) -> Pieces:
    lasts_us = tracks.times_us[tracks.waypoint_offset[1:] - 1] - tracks.times_us[tracks.waypoint_offset[:-1]]
    first, last = _ends(tracks.departs)
    start, end = tracks.departs.at_us[first], tracks.departs.at_us[last] + lasts_us
    # The lowest floor and highest ceiling of all legs.
    first_leg = tracks.waypoint_offset[:-1] - np.arange(len(tracks))
    floor_m = np.minimum.reduceat(tracks.floor_m.min(axis=1), first_leg)
    ceiling_m = np.maximum.reduceat(tracks.ceiling_m.max(axis=1), first_leg)
    return _covers(plane, Kind.TRACK, tracks, tracks.track_id, start, end, floor_m, ceiling_m)


def _covers(
    plane: Plane,
    kind: Kind,
    batch: AreaBatch | TrackBatch,
    ids: NDArray[np.int64],
    start_us: NDArray[np.int64],
    end_us: NDArray[np.int64],
    floor_m: Floats,
    ceiling_m: Floats,
) -> Pieces:
    n = len(ids)
    corners = _whole(plane)
    shape = corners if kind is Kind.AREA else np.zeros((1, 2))
    shape_xy = np.tile(shape, (n, 1))
    nothing, none_us = np.zeros((n, 2)), np.zeros(n, np.int64)
    is_track = kind is Kind.TRACK
    return Pieces(
        piece_id=np.full(n, -1, np.int64),
        kind=np.full(n, kind.code, np.int8),
        object_id=ids,
        version=batch.version,
        part=np.full(n, COVER, np.int32),
        turn=np.zeros(n, np.int16),
        start_us=start_us,
        end_us=end_us,
        end_inclusive=np.zeros(n, np.bool_),
        floor_m=floor_m,
        ceiling_m=ceiling_m,
        climb_m=level_m(floor_m, ceiling_m),
        hull_xy=np.tile(np.concatenate([corners, corners[:1]]), (n, 1)),
        hull_offset=np.arange(n + 1, dtype=np.int64) * (len(corners) + 1),
        shape_xy=shape_xy,
        shape_to_xy=shape_xy,
        shape_offset=np.arange(n + 1, dtype=np.int64) * len(shape),
        leg_start_us=start_us if is_track else none_us,
        leg_end_us=end_us if is_track else none_us,
        leg_start_deg=nothing,
        leg_end_deg=nothing,
        bearing_deg=np.zeros(n),
        numbers=piece_numbers(batch.numbers, np.arange(n)),
    )


def _whole(plane: Plane) -> Floats:
    """Return the corners (4, 2) of a box that all hulls of the plane meet, counter-clockwise, plane metres."""
    if plane.turn_m:
        x, y = 0.5 * plane.turn_m, float(plane.to_plane(0.0, _HIGHEST_DEG)[1])
    else:
        x = y = MEAN_RADIUS_M * float(np.tan(np.radians(MAX_FROM_CENTRE_DEG)))
    return np.array([(-x, -y), (x, -y), (x, y), (-x, y)])
