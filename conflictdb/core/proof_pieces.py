"""Number the pieces of a scene as proofs do, so that a checker builds the same ones from the objects alone.

Pieces count from 0 in the order of objects. A track has, for each departure, its slices in order of time; an area has,
for each span, its parts.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.objects import AreaBatch
from conflictdb.arrays.pieces import OF_TOLERANCES, PieceRows, Pieces
from conflictdb.arrays.ragged import offsets
from conflictdb.core.pieces.convex_parts import convex_parts
from conflictdb.core.pieces.covers import COVER
from conflictdb.core.pieces.cutting import planar, with_seam_copies
from conflictdb.core.world import Occupied
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.kernel.directions import proof_boxes
from conflictdb.kernel.kernel_scene import KernelScene
from conflictdb.kernel.movement import Movement
from conflictdb.model.results import Kind

_Ints = NDArray[np.int64]

# A checker's boxes may be larger by rounding, plane metres.
_BOX_MARGIN_M = 0.01


@dataclass(frozen=True, slots=True)
class Cuts:
    """How the objects of a scene are cut, areas first: by place among all objects.

    cuts_us : of tracks: instants between waypoints at which slices meet, after the first waypoint
    parts : of areas in several parts: corners of each part, as places among all corners of the area
    unproven : objects that no proof is about: with tolerances, or that were not cut
    """

    cuts_us: dict[int, list[int]]
    parts: dict[int, list[list[int]]]
    unproven: list[int]


@dataclass(frozen=True, slots=True)
class ProofPieces:
    """Pieces (n,) of objects that proofs are about.

    pieces : their `piece_id` is a row of the other arrays
    number : (n,) of each piece, the same for seam copies
    turns : (n,) whole turns of longitude from the coordinates of the objects to those of the piece
    """

    pieces: Pieces
    number: _Ints
    turns: _Ints
    cuts: Cuts


def proof_pieces(setup: Setup, occupied: Occupied, reach_m: float) -> ProofPieces:
    """Return the pieces of a scene with the boxes of docs/reference/proof.md as hulls.

    reach_m : pieces whose boxes do not meet are farther apart
    """
    areas, _ = occupied.batches
    pieces = occupied.pieces.take(np.flatnonzero(occupied.pieces.turn == 0))
    place = np.where(pieces.kind == Kind.AREA.code, 0, len(areas)) + pieces.object_id
    is_out = (pieces.part == COVER) | (pieces.part >= OF_TOLERANCES)
    unproven = np.unique(place[is_out]).tolist()
    pieces = pieces.take(np.flatnonzero(~np.isin(place, unproven)))
    pieces, parts, east = _with_parts(setup, pieces, areas)
    place = np.where(pieces.kind == Kind.AREA.code, 0, len(areas)) + pieces.object_id
    order = np.lexsort((pieces.part, place))
    pieces, place, east = pieces.take(order), place[order], east[order]
    counts = np.bincount(place, minlength=len(areas) + len(occupied.tracks))
    number = offsets(counts)[place] + pieces.part
    turns, cuts_us = _turns_and_cuts(setup.plane, pieces, place, east, occupied)
    # The copies of a piece have its number and, beyond its own turn, its turns.
    boxed, shifted = _boxed(setup.plane, pieces, reach_m)
    marked = with_seam_copies(setup.plane, replace(boxed, piece_id=np.arange(len(boxed))))
    row = marked.piece_id
    marked = replace(marked, piece_id=np.arange(len(marked)))
    return ProofPieces(marked, number[row], (turns + shifted)[row] + marked.turn, Cuts(cuts_us, parts, unproven))


def _with_parts(setup: Setup, pieces: Pieces, areas: AreaBatch) -> tuple[Pieces, dict[int, list[list[int]]], Floats]:
    """Return pieces, the corners of parts, and about how far east (n,) pieces of areas lie of where they were written.

    An area whose parts have other corners than itself becomes one piece, its hull.
    """
    is_area = pieces.kind == Kind.AREA.code
    flat = planar(setup.plane, areas.footprint) if areas.flat is None else areas.flat
    several = np.unique(pieces.object_id[is_area & (pieces.part > 0)])
    parts = dict(zip(several.tolist(), _corners_of_parts(flat[several], areas.footprint[several]), strict=True))
    whole = [number for number, found in parts.items() if not found]
    for number in whole:
        del parts[number]
    # Areas with several spans have more pieces than parts.
    of_area = np.flatnonzero(is_area)
    parts = {number: found for number, found in parts.items() if len(found) > 1}
    if whole:
        hulls = dict(zip(whole, shapely.convex_hull(flat[whole]), strict=True))
        pieces = _as_one_piece(pieces, hulls)
        is_area = pieces.kind == Kind.AREA.code
        of_area = np.flatnonzero(is_area)
    east = np.zeros(len(pieces))
    if setup.plane.turn_m and len(of_area):
        west = shapely.bounds(flat)[:, 0][pieces.object_id[of_area]]
        corners = {number: _corners(shapely.get_parts(flat[[number]]))[0][:, 0] for number in parts}
        for k in np.flatnonzero(np.isin(pieces.object_id[of_area], list(parts))).tolist():
            number = int(pieces.object_id[of_area[k]])
            part = parts[number][int(pieces.part[of_area[k]]) % len(parts[number])]
            west[k] = corners[number][part].min()
        east[of_area] = np.minimum.reduceat(pieces.shape_xy[:, 0], pieces.shape_offset[:-1])[of_area] - west
    return pieces, parts, east


def _corners_of_parts(flat: NDArray[np.object_], footprint: NDArray[np.object_]) -> list[list[list[int]]]:
    """Return corners of the parts of each area (n,), as places among the corners of its rings; []: they are others."""
    polygons, area_of = shapely.get_parts(flat, return_index=True)
    polygon_of, xy, offset = convex_parts(polygons)
    corners, corner_offset = _corners(polygons)
    polygon_offset, part_offset = (
        offsets(np.bincount(of, minlength=count)) for of, count in ((area_of, len(flat)), (polygon_of, len(polygons)))
    )
    first = corner_offset[:-1] - corner_offset[polygon_offset[area_of]]
    is_whole = (np.diff(part_offset) == 1) & (shapely.get_num_interior_rings(polygons) == 0)
    is_ccw = shapely.is_ccw(shapely.get_exterior_ring(polygons))
    found: list[list[list[int]]] = [[] for _ in flat]
    is_other = np.diff(polygon_offset) != shapely.get_num_geometries(footprint)
    for k, area in enumerate(area_of.tolist()):
        own = slice(int(corner_offset[k]), int(corner_offset[k + 1]))
        ring = range(int(first[k]), int(first[k]) + own.stop - own.start)
        if is_whole[k]:
            found[area].append(list(ring if is_ccw[k] else ring[::-1]))
            continue
        places = dict(zip(map(tuple, corners[own].tolist()), ring, strict=True))
        for part in range(int(part_offset[k]), int(part_offset[k + 1])):
            vertices = [places.get((x, y), -1) for x, y in xy[offset[part] : offset[part + 1]].tolist()]
            is_other[area] |= min(vertices) < 0
            found[area].append(vertices)
    return [[] if other else parts for other, parts in zip(is_other.tolist(), found, strict=True)]


def _corners(polygons: NDArray[np.object_]) -> tuple[Floats, _Ints]:
    """Return the corners of polygons in the order of their rings, without closing ones; and their offsets (n + 1,)."""
    rings, polygon_of = shapely.get_rings(polygons, return_index=True)
    xy, ring_of = shapely.get_coordinates(rings, return_index=True)
    is_corner = np.zeros(len(xy), np.bool_)
    is_corner[:-1] = ring_of[1:] == ring_of[:-1]
    counts = np.bincount(polygon_of[ring_of[is_corner]], minlength=len(polygons))
    return xy[is_corner], offsets(counts)


def _as_one_piece(pieces: Pieces, hulls: dict[int, shapely.Geometry]) -> Pieces:
    """Return pieces in which some areas have one piece for each span, of these shapes."""
    rows, shapes = [], []
    is_area = pieces.kind == Kind.AREA.code
    seen: dict[tuple[int, int, int], int] = {}
    part = pieces.part.copy()
    for row in range(len(pieces)):
        number = int(pieces.object_id[row])
        shape = pieces.shape_xy[pieces.shape_offset[row] : pieces.shape_offset[row + 1]]
        if is_area[row] and number in hulls:
            span = number, int(pieces.start_us[row]), int(pieces.end_us[row])
            if span in seen:
                continue
            part[row] = seen[span] = sum(one[0] == number for one in seen)
            shape = shapely.get_coordinates(shapely.orient_polygons(hulls[number]))[:-1]
        rows.append(row)
        shapes.append(shape)
    found = replace(pieces, part=part).take(np.array(rows, np.int64))
    shape_xy = np.concatenate([np.empty((0, 2)), *shapes])
    return replace(
        found, shape_xy=shape_xy, shape_to_xy=shape_xy, shape_offset=offsets([len(shape) for shape in shapes])
    )


def _turns_and_cuts(
    plane: Plane, pieces: Pieces, place: _Ints, east: Floats, occupied: Occupied
) -> tuple[_Ints, dict[int, list[int]]]:
    """Return how many turns pieces (n,) lie from where their objects were written, and the cuts of tracks."""
    areas, tracks = occupied.batches
    turns = np.zeros(len(pieces), np.int64)
    if plane.turn_m:
        turns = np.round(east / plane.turn_m).astype(np.int64)
    cuts_us: dict[int, list[int]] = {}
    first = np.searchsorted(place, np.arange(len(areas), len(areas) + len(tracks) + 1))
    for k in range(len(tracks)):
        rows = slice(int(first[k]), int(first[k + 1]))
        if rows.start == rows.stop:
            continue
        times_us = tracks.times_us[tracks.waypoint_offset[k] : tracks.waypoint_offset[k + 1]]
        start_us, leg_us = pieces.start_us[rows], pieces.leg_start_us[rows]
        # Only the first voyage is read.
        voyage = int(np.searchsorted(start_us, start_us[0] + int(times_us[-1] - times_us[0])))
        since = start_us[:voyage] - start_us[0]
        cuts = since[~np.isin(since, times_us - times_us[0])]
        if cuts.size:
            cuts_us[len(areas) + k] = cuts.tolist()
        if plane.turn_m:
            leg = np.searchsorted(times_us - times_us[0], leg_us[:voyage] - start_us[0])
            lon = tracks.positions_deg[tracks.waypoint_offset[k] : tracks.waypoint_offset[k + 1], 0]
            moved = np.round((pieces.leg_start_deg[rows][:voyage, 0] - unwrapped_deg(lon)[leg]) / 360.0)
            turns[rows] = np.tile(moved.astype(np.int64), (rows.stop - rows.start) // voyage)
    return turns, cuts_us


def unwrapped_deg(lon_deg: Floats) -> Floats:
    """Return longitudes (n,) of waypoints, each within half a turn of the one before."""
    step = np.diff(lon_deg)
    step = np.where(np.abs(step) > 180.0, step - 360.0 * np.round(step / 360.0), step)
    gone = lon_deg[0] + np.append(0.0, np.cumsum(step))
    return np.asarray(lon_deg + 360.0 * np.round((gone - lon_deg) / 360.0))


def _boxed(plane: Plane, pieces: Pieces, reach_m: float) -> tuple[Pieces, _Ints]:
    """Return pieces with their boxes as hulls, moved by whole turns to west ends in [-180, 180); and the turns (n,)."""
    moves = pieces.kind == Kind.TRACK.code
    zero_us = np.where(moves, pieces.start_us, 0)
    last_s = np.where(moves, pieces.end_us - zero_us, 0) / 1e6
    scene = KernelScene(plane.kernel_plane, pieces)
    movement = Movement.of(scene, PieceRows(np.arange(len(pieces))), zero_us)
    boxes = proof_boxes(movement, np.zeros(len(pieces)), last_s, reach_m)
    boxes += np.array([-1.0, -1.0, 1.0, 1.0]) * _BOX_MARGIN_M
    # A piece without a box may be anywhere.
    width = 0.5 * plane.turn_m if plane.turn_m else 4e7
    boxes = np.where(np.isnan(boxes), np.array([-width, -4e8, width, 4e8]), boxes)
    turns = np.zeros(len(pieces), np.int64)
    if plane.turn_m:
        turns = -np.floor(boxes[:, 0] / plane.turn_m + 0.5).astype(np.int64)
        boxes[:, [0, 2]] += plane.turn_m * turns[:, None]
        away = np.stack([360.0 * turns, np.zeros(len(pieces))], axis=1)
        columns = {name: getattr(pieces, name) + away * moves[:, None] for name in ("leg_start_deg", "leg_end_deg")}
        shape = pieces.shape_xy.copy()
        shape[:, 0] += np.repeat(np.where(moves, 0.0, plane.turn_m * turns), np.diff(pieces.shape_offset))
        changed = {} if not pieces.changes else {"shape_to_xy": pieces.shape_to_xy}
        pieces = replace(pieces, **({"shape_xy": shape, "shape_to_xy": shape} | changed | columns))
    west, south, east, north = boxes.T
    ring = np.stack([west, south, east, south, east, north, west, north, west, south], axis=1).reshape(-1, 2)
    return replace(pieces, hull_xy=ring, hull_offset=np.arange(len(pieces) + 1) * 5), turns
