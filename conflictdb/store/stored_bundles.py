"""Encode and decode rows of table `piece`.

A row stores one piece, or a bundle: several pieces of one object with similar bounds. A bundle stores the common
bounding box and time span, plus one array per attribute that varies.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.column_numbers import IN_PIECES
from conflictdb.arrays.pieces import Bundles, Pieces, level_m
from conflictdb.arrays.ragged import offsets, ragged_take
from conflictdb.kernel.boxes import boxes_of
from conflictdb.kernel.bundles import wkb_rings
from conflictdb.model.results import Kind
from conflictdb.store import copy_binary

# The columns of _pieces and _put_pieces in their order, by the names of `Pieces`: numbers, then all others, as bytes.
PIECE_COLUMNS = [
    ("piece_id", "i8"), ("rank", "i8"), ("kind", "i2"), ("object_id", "i8"), ("version", "i8"), ("pieces", "i4"),
    ("part", "i4"), ("turn", "i2"), ("start_us", "i8"), ("end_us", "i8"), ("end_inclusive", "b1"), ("floor_m", "f8"),
    ("ceiling_m", "f8"), ("leg_start_us", "i8"), ("leg_end_us", "i8"), ("start_lon_deg", "f8"),
    ("start_lat_deg", "f8"), ("end_lon_deg", "f8"), ("end_lat_deg", "f8"), ("bearing_deg", "f8"),
    *((name, "i8") for name in IN_PIECES),
]  # fmt: skip
PIECE_STRINGS = ["hull", "shape", "shape_to", "parts", "cuts", "leg_times", "legs", "climb"]
_LEG_NUMBERS = ("start_lon_deg", "start_lat_deg", "end_lon_deg", "end_lat_deg", "bearing_deg")


def scalars(bundles: Bundles, srid: int) -> dict[str, copy_binary.Column]:
    """Return the columns that every row fills, and those that only single-piece rows fill."""
    pieces, size = bundles.pieces, np.diff(bundles.offset)
    is_bundle = size > 1
    first, last = bundles.offset[:-1], bundles.offset[1:] - 1
    is_track = pieces.kind[first] == Kind.TRACK.code
    has_shape = is_track | ~is_bundle
    shapes_xy, shapes_offset = ragged_take(pieces.shape_offset, pieces.shape_xy, first[has_shape])
    shape = copy_binary.polygons(*copy_binary.closed_rings(shapes_xy, shapes_offset), 0)
    alone = is_track & ~is_bundle
    found: dict[str, copy_binary.Column] = {
        "object_kind": copy_binary.fixed(pieces.kind[first], "i2"),
        "object_id": copy_binary.fixed(pieces.object_id[first], "i8"),
        "version": copy_binary.fixed(pieces.version[first], "i8"),
        "pieces": copy_binary.fixed(size, "i4"),
        "part": copy_binary.fixed(pieces.part[first], "i4"),
        "turn": copy_binary.fixed(pieces.turn[first], "i2"),
        "hull": copy_binary.polygons(*_hulls(bundles), srid),
        "span": copy_binary.spans(pieces.start_us[first], pieces.end_us[last], pieces.end_inclusive[last]),
        "floor_m": copy_binary.fixed(pieces.floor_m[first], "f8"),
        "ceiling_m": copy_binary.fixed(pieces.ceiling_m[first], "f8"),
        **{name: copy_binary.fixed(pieces.numbers[first, k], "i8") for k, name in enumerate(IN_PIECES)},
        "shape": copy_binary.where(shape, has_shape),
        "leg_start": copy_binary.nullable(copy_binary.instants(pieces.leg_start_us[first]), ~alone),
        "leg_end": copy_binary.nullable(copy_binary.instants(pieces.leg_end_us[first]), ~alone),
    }
    for name, numbers in zip(_LEG_NUMBERS, _legs(pieces, first).T, strict=True):
        found[name] = copy_binary.nullable(copy_binary.fixed(numbers, "f8"), ~alone)
    found["shape_to"] = _changed_shapes(pieces, first)
    return found


def climbs(bundles: Bundles) -> NDArray[np.bool_]:
    """Return (m,) whether the heights of a row change; it is a single piece then."""
    return bundles.pieces.climbs()[bundles.offset[:-1]]


def climb(pieces: Pieces) -> copy_binary.Bytes:
    """Return `Pieces.climb_m` as numbers, four a piece, infinite where unbounded."""
    return copy_binary.fixed(pieces.climb_m.reshape(-1), "f8")


def columns(bundles: Bundles, scene_id: int, srid: int) -> dict[str, copy_binary.Column]:
    """Return the columns of rows of table `piece`; columns that are null in all rows may be missing."""
    found = {"scene_id": copy_binary.fixed(np.full(len(bundles), scene_id), "i8"), **scalars(bundles, srid)}
    is_bundle, is_climbing = np.diff(bundles.offset) > 1, climbs(bundles)
    if is_climbing.any():
        of = bundles.take(np.flatnonzero(is_climbing)).pieces
        arrays = copy_binary.arrays(climb(of), 4 * np.arange(len(of) + 1), "double precision")
        found["climb"] = copy_binary.where(arrays, is_climbing)
    some = bundles.take(np.flatnonzero(is_bundle))
    if not len(some):
        return found
    pieces, offset = some.pieces, some.offset
    found["parts"] = copy_binary.where(
        copy_binary.arrays(copy_binary.fixed(pieces.part, "i4"), offset, "integer"), is_bundle
    )
    found["hulls"] = copy_binary.where(hulls(some, srid), is_bundle)
    is_track = pieces.kind[offset[:-1]] == Kind.TRACK.code
    for name, is_kind in (("shapes", ~is_track), ("cuts", is_track), ("leg_times", is_track), ("legs", is_track)):
        of_kind = some.take(np.flatnonzero(is_kind))
        if len(of_kind):
            is_there = is_bundle.copy()
            is_there[is_bundle] = is_kind
            found[name] = copy_binary.where(_OF_BUNDLES[name](of_kind), is_there)
    return found


def hulls(bundles: Bundles, srid: int) -> copy_binary.Ragged:
    """Return the hulls of the pieces of each bundle, as a multipolygon."""
    pieces = bundles.pieces
    return copy_binary.multipolygons(pieces.hull_xy, pieces.hull_offset, bundles.offset, srid)


def shapes(bundles: Bundles) -> copy_binary.Ragged:
    """Return the shapes of the pieces of each bundle, as a multipolygon."""
    pieces = bundles.pieces
    rings = copy_binary.closed_rings(pieces.shape_xy, pieces.shape_offset)
    return copy_binary.multipolygons(*rings, bundles.offset, 0)


def leg_times(pieces: Pieces) -> copy_binary.Bytes:
    """Return start and end of the leg of each slice: two instants a slice."""
    return copy_binary.instants(np.stack([pieces.leg_start_us, pieces.leg_end_us], axis=1).reshape(-1))


def legs(pieces: Pieces) -> copy_binary.Bytes:
    """Return both ends of the leg of each slice and its bearing: five numbers a slice, degrees."""
    return copy_binary.fixed(_legs(pieces, np.arange(len(pieces))).reshape(-1), "f8")


def _cuts(bundles: Bundles) -> copy_binary.Ragged:
    # The start of each slice, and the end of the last.
    pieces, offset = bundles.pieces, bundles.offset
    instants = np.insert(pieces.start_us, offset[1:], pieces.end_us[offset[1:] - 1])
    return copy_binary.arrays(copy_binary.instants(instants), offset + np.arange(len(offset)), "timestamptz")


_OF_BUNDLES: dict[str, Callable[[Bundles], copy_binary.Ragged]] = {
    "shapes": shapes,
    "cuts": _cuts,
    "leg_times": lambda some: copy_binary.arrays(leg_times(some.pieces), 2 * some.offset, "timestamptz"),
    "legs": lambda some: copy_binary.arrays(legs(some.pieces), 5 * some.offset, "double precision"),
}


def _legs(pieces: Pieces, rows: NDArray[np.int64]) -> Floats:
    return np.concatenate(
        [pieces.leg_start_deg[rows], pieces.leg_end_deg[rows], pieces.bearing_deg[rows, None]], axis=1
    )


def _hulls(bundles: Bundles) -> tuple[Floats, NDArray[np.int64]]:
    """Return the indexed geometry of each row: the hull of a piece, or the bounding box of a bundle's hulls."""
    pieces, first = bundles.pieces, bundles.offset[:-1]
    is_bundle = np.diff(bundles.offset) > 1
    if not is_bundle.any():
        return pieces.hull_xy, pieces.hull_offset
    boxes = boxes_of(pieces)
    low, high = np.minimum.reduceat(boxes[:, :2], first), np.maximum.reduceat(boxes[:, 2:], first)
    low, high = low[is_bundle], high[is_bundle]
    corners = np.stack([low, np.stack([high[:, 0], low[:, 1]], 1), high, np.stack([low[:, 0], high[:, 1]], 1), low], 1)
    # Append the rings of bundles to those of all pieces; then take the ring of each row.
    of_bundle = len(pieces) + np.cumsum(is_bundle) - 1
    count = np.append(np.diff(pieces.hull_offset), np.full(len(corners), 5))
    every = np.concatenate([pieces.hull_xy, corners.reshape(-1, 2)])
    return ragged_take(offsets(count), every, np.where(is_bundle, of_bundle, first))


def _changed_shapes(pieces: Pieces, rows: NDArray[np.int64]) -> copy_binary.Ragged:
    """Return the shapes at the ends of legs; null for pieces whose shape does not change."""
    changed = pieces.changed()[rows]
    some = pieces.take(rows[changed])
    wkb = copy_binary.polygons(*copy_binary.closed_rings(some.shape_to_xy, some.shape_offset), 0)
    return copy_binary.where(wkb, changed)


def by_place(bundles: Bundles, most: int) -> Iterator[NDArray[np.int64]]:
    """Yield rows of bundles in Z-order of the first corners of their hulls, in chunks.

    A chunk has at most `most` pieces, or a single bundle.
    """
    pieces = bundles.pieces
    xy = pieces.hull_xy[pieces.hull_offset[bundles.offset[:-1]]]
    least, extent = xy.min(axis=0, initial=np.inf), np.ptp(xy, axis=0) if len(xy) else np.ones(2)
    cells = ((xy - least) / np.where(extent > 0.0, extent, 1.0) * 0xFFFF).astype(np.uint64)
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        cells = (cells | (cells << np.uint64(shift))) & np.uint64(mask)
    rows = np.argsort(cells[:, 0] | (cells[:, 1] << np.uint64(1)), kind="stable")
    ends = np.cumsum(np.diff(bundles.offset)[rows])
    first = 0
    while first < len(rows):
        before = int(ends[first - 1]) if first else 0
        end = max(int(np.searchsorted(ends, before + most, side="right")), first + 1)
        yield rows[first:end]
        first = end


def decoded(rows: dict[str, NDArray[Any]], strings: dict[str, list[bytes]]) -> tuple[Bundles, NDArray[np.int64]]:
    """Decode the columns of rows (_pieces) to bundles, in the order of the rows.

    Also return the rank (n,) of each piece in the order of kind, key, part and turn.
    """
    size = rows["pieces"].astype(np.int64)
    offset = offsets(size)
    row = np.repeat(np.arange(len(size)), size)
    is_bundle = size > 1
    many = is_bundle[row]
    has_slices = is_bundle & (rows["kind"] == Kind.TRACK.code)
    slices = has_slices[row]
    of_piece = {name: values[row] for name, values in rows.items() if name not in ("rank", "pieces")}
    for name in ("start_us", "end_us", "leg_start_us", "leg_end_us"):
        of_piece[name] = copy_binary.microseconds(of_piece[name])
    if is_bundle.any():
        of_piece["part"][many] = copy_binary.array_values(strings["parts"], "i4")
        cuts = copy_binary.microseconds(copy_binary.array_values(strings["cuts"], "i8"))
        begins = np.flatnonzero(slices)
        # A row has one more instant than slices.
        at = np.arange(len(begins)) + np.cumsum(np.diff(row[begins], prepend=row[begins[:1]]) > 0)
        of_piece["start_us"][slices], of_piece["end_us"][slices] = cuts[at], cuts[at + 1]
        of_piece["end_inclusive"][slices] |= np.append(row[1:] == row[:-1], False)[slices]
        times = copy_binary.microseconds(copy_binary.array_values(strings["leg_times"], "i8")).reshape(-1, 2)
        of_piece["leg_start_us"][slices], of_piece["leg_end_us"][slices] = times.T
        numbers = copy_binary.array_values(strings["legs"], "f8").reshape(-1, 5)
        for name, values in zip(_LEG_NUMBERS, numbers.T, strict=True):
            of_piece[name][slices] = values
    hull_xy, hull_offset = wkb_rings(strings["hull"], len(row))
    shape_xy, shape_offset = wkb_rings(strings["shape"], int(np.where(has_slices, 1, size).sum()))
    if has_slices.any():
        # Slices of a bundle share the shape of their row.
        first_ring = offsets(np.where(has_slices, 1, size))[row]
        nth = np.where(slices, 0, np.arange(len(row)) - offset[row])
        shape_xy, shape_offset = ragged_take(shape_offset, shape_xy, first_ring + nth)
    changed = strings["shape_to"]
    if any(changed):
        # Only single-piece rows.
        is_changed = np.array([bool(one) for one in changed])
        shape_to_xy = shape_xy.copy()
        ends, _ = copy_binary.vertices([one for one in changed if one], copy_binary.WKB_POLYGON)
        shape_to_xy[np.repeat(is_changed[row], np.diff(shape_offset))] = ends
        # Open both rings together: a ring that collapses to a line or a point at one end only keeps all its vertices.
        both, shape_offset = copy_binary.open_rings(np.concatenate([shape_xy, shape_to_xy], axis=1), shape_offset)
        shape_xy, shape_to_xy = (np.ascontiguousarray(half) for half in np.split(both, 2, axis=1))
    else:
        shape_xy, shape_offset = copy_binary.open_rings(shape_xy, shape_offset)
        shape_to_xy = shape_xy
    start_deg, end_deg = (
        np.stack([of_piece.pop(f"{end}_lon_deg"), of_piece.pop(f"{end}_lat_deg")], axis=1) for end in ("start", "end")
    )
    climb_m = level_m(of_piece["floor_m"], of_piece["ceiling_m"])
    is_climbing = np.array([bool(one) for one in strings["climb"]], np.bool_)[row]
    if is_climbing.any():
        # Only single-piece rows.
        climb_m[is_climbing] = copy_binary.array_values(strings["climb"], "f8").reshape(-1, 4)
    numbers = np.stack([of_piece.pop(name) for name in IN_PIECES], axis=1)
    pieces = Pieces(
        **{**of_piece, "kind": of_piece["kind"].astype(np.int8)},
        climb_m=climb_m,
        numbers=numbers,
        hull_xy=hull_xy,
        hull_offset=hull_offset,
        shape_xy=shape_xy,
        shape_to_xy=shape_to_xy,
        shape_offset=shape_offset,
        leg_start_deg=start_deg,
        leg_end_deg=end_deg,
    )
    place = np.empty(len(pieces), np.int64)
    place[np.lexsort((-pieces.turn, pieces.part, rows["rank"][row]))] = np.arange(len(pieces))
    return Bundles(pieces, offset), place
