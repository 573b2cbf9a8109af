"""Pack pieces into bytes, one value each, for files, queues and shuffles.

A piece is a sequence of eight-byte words, little-endian, integers or doubles, with the values of `Pieces`:

    0 kind, 1 version, 2 part, 3 turn, 4 start_us, 5 end_us, 6 end_inclusive (0 or 1), 7 floor_m, 8 ceiling_m,
    9 leg_start_us, 10 leg_end_us, 11 and 12 leg_start_deg, 13 and 14 leg_end_deg, 15 bearing_deg,
    16 h vertices of the hull (closed ring), 17 s vertices of the shape (open ring), 18 whether the shape changes,
    19 object_id, 20 to 23 climb_m, from 24 numbers, then x, y of the hull (2 h), of the shape (2 s), and at the end of
    the leg (2 s) if it changes
"""

import sys
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.column_numbers import IN_PIECES
from conflictdb.arrays.pieces import Pieces
from conflictdb.arrays.ragged import offsets, ragged_take

# Bytes of a word, and the words that distinguish the pieces of an object.
WORD: Final = 8
PART: Final = 2
TURN: Final = 3
_NUMBERS: Final = 24
_HEAD: Final = _NUMBERS + len(IN_PIECES)
_INTEGERS: Final = {
    "kind": (0, np.int8), "version": (1, np.int64), "part": (PART, np.int32), "turn": (TURN, np.int16),
    "start_us": (4, np.int64), "end_us": (5, np.int64), "end_inclusive": (6, np.bool_), "leg_start_us": (9, np.int64),
    "leg_end_us": (10, np.int64), "object_id": (19, np.int64),
}  # fmt: skip
_DOUBLES: Final = {"floor_m": 7, "ceiling_m": 8, "bearing_deg": 15}
_PLACES: Final = {"leg_start_deg": (11, 2), "leg_end_deg": (13, 2), "climb_m": (20, 4)}
_HULL, _SHAPE, _CHANGES = 16, 17, 18

Words = NDArray[np.int64]


def packed(pieces: Pieces) -> tuple[Words, NDArray[np.int64]]:
    """Return pieces as words (w,), and the offset of each piece's words (n + 1,)."""
    n = len(pieces)
    changed = pieces.changed()
    hull, shape = np.diff(pieces.hull_offset), np.diff(pieces.shape_offset)
    offset = offsets(_HEAD + 2 * hull + 2 * shape * (1 + changed))
    words = np.empty(offset[-1], np.int64)
    doubles = words.view(np.float64)
    begin = offset[:-1]
    for name, (at, _) in _INTEGERS.items():
        words[begin + at] = getattr(pieces, name)
    for name, at in _DOUBLES.items():
        doubles[begin + at] = getattr(pieces, name)
    for name, (at, width) in _PLACES.items():
        doubles[begin[:, None] + at + np.arange(width)] = getattr(pieces, name)
    words[begin[:, None] + np.arange(_NUMBERS, _HEAD)] = pieces.numbers
    words[begin + _HULL], words[begin + _SHAPE], words[begin + _CHANGES] = hull, shape, changed
    every = np.arange(n)
    doubles[_places(begin + _HEAD, pieces.hull_offset, every)] = pieces.hull_xy.reshape(-1)
    at_shape = begin + _HEAD + 2 * hull
    doubles[_places(at_shape, pieces.shape_offset, every)] = pieces.shape_xy.reshape(-1)
    rows = np.flatnonzero(changed)
    if rows.size:
        end_xy, end = ragged_take(pieces.shape_offset, pieces.shape_to_xy, rows)
        at_end = (at_shape + 2 * shape)[rows]
        doubles[_places(at_end, end, np.arange(len(rows)))] = end_xy.reshape(-1)
    return _little_endian(words), offset


def unpacked(words: Words, begin: NDArray[np.int64]) -> Pieces:
    """Return the pieces (n,) whose words begin at `begin`.

    words : aligned, of any number of pieces
    """
    words = _little_endian(words)
    doubles = words.view(np.float64)
    hull, hull_xy = _ring(doubles, begin + _HEAD, words[begin + _HULL])
    at_shape = begin + _HEAD + 2 * words[begin + _HULL]
    count = words[begin + _SHAPE]
    shape, shape_xy = _ring(doubles, at_shape, count)
    changes = words[begin + _CHANGES] != 0
    shape_to_xy = _ring(doubles, at_shape + 2 * count * changes, count)[1] if changes.any() else shape_xy
    columns: dict[str, Any] = {name: words[begin + at].astype(of) for name, (at, of) in _INTEGERS.items()}
    columns |= {name: doubles[begin + at] for name, at in _DOUBLES.items()}
    columns |= {name: doubles[begin[:, None] + at + np.arange(width)] for name, (at, width) in _PLACES.items()}
    return Pieces(
        numbers=words[begin[:, None] + np.arange(_NUMBERS, _HEAD)],
        piece_id=np.full(len(begin), -1, np.int64),
        hull_xy=hull_xy,
        hull_offset=hull,
        shape_xy=shape_xy,
        shape_to_xy=shape_to_xy,
        shape_offset=shape,
        **columns,
    )


def begins_in(words: Words, begin: NDArray[np.int64], end: NDArray[np.int64]) -> tuple[Words, NDArray[np.int64]]:
    """Return where each piece begins in runs of words that contain pieces back to back: (m,), in order.

    Also return the pieces of each run, as offsets (n + 1,).

    begin, end : (n,) of the runs
    """
    words = _little_endian(words)
    found, of = [], []
    run, at = np.arange(len(begin)), begin
    while run.size:
        found.append(at)
        of.append(run)
        shape = words[at + _SHAPE]
        at = at + _HEAD + 2 * words[at + _HULL] + 2 * shape * (1 + (words[at + _CHANGES] != 0))
        more = at < end[run]
        run, at = run[more], at[more]
    runs = np.concatenate([np.empty(0, np.int64), *of])
    order = np.argsort(runs, kind="stable")
    begins = np.concatenate([np.empty(0, np.int64), *found])[order]
    return begins, offsets(np.bincount(runs, minlength=len(begin)))


def _places(begin: NDArray[np.int64], offset: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the word indices of the coordinates of some rings, which begin at `begin`."""
    count = 2 * (offset[rows + 1] - offset[rows])
    ends = offsets(count)
    return np.repeat(begin - ends[:-1], count) + np.arange(ends[-1])


def _ring(
    doubles: NDArray[np.float64], begin: NDArray[np.int64], count: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return rings of `count` vertices whose coordinates begin at `begin`: offset (n + 1,), (v, 2)."""
    offset = offsets(count)
    return offset, doubles[np.repeat(begin - 2 * offset[:-1], 2 * count) + np.arange(2 * offset[-1])].reshape(-1, 2)


def _little_endian(words: Words) -> Words:
    return words if sys.byteorder == "little" else words.byteswap()
