"""Convert pieces and pairs of pieces to and from Arrow: the columns are the fields of `Pieces` and `Pairs`.

Vertices are flat lists, x, y, x, y, …; places are two columns; instants are whole microseconds since 1970, as in the
arrays, unbounded ones MINUS_INFINITY_US and INFINITY_US.
"""

from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from conflictdb.arrays.arrow.columns import numbers, of_lists, of_numbers, pairs
from conflictdb.arrays.arrow.forms import Array, Batch, Form
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.errors import InvalidInput

_XY: Final = pa.list_(pa.float64())
_NUMBERS: Final = {
    "piece_id": pa.int64(),
    "kind": pa.int8(),
    "object_id": pa.int64(),
    "version": pa.int64(),
    "part": pa.int32(),
    "turn": pa.int16(),
    "start_us": pa.int64(),
    "end_us": pa.int64(),
    "end_inclusive": pa.bool_(),
    "floor_m": pa.float64(),
    "ceiling_m": pa.float64(),
    "leg_start_us": pa.int64(),
    "leg_end_us": pa.int64(),
    "bearing_deg": pa.float64(),
}
_PLACES: Final = {name: (f"{name}_lon_deg", f"{name}_lat_deg") for name in ("leg_start", "leg_end")}

PIECES: Final = Form.of(
    "pieces",
    1,
    [
        *(pa.field(name, of, nullable=False) for name, of in _NUMBERS.items()),
        *(pa.field(name, pa.float64(), nullable=False) for names in _PLACES.values() for name in names),
        pa.field("hull_xy", _XY, nullable=False),
        pa.field("shape_xy", _XY, nullable=False),
        pa.field("shape_to_xy", _XY),  # null: the shape is constant
    ],
)
PAIRS: Final = Form.of(
    "pairs",
    1,
    [
        pa.field("a", pa.int64(), nullable=False),
        pa.field("b", pa.int64(), nullable=False),
        pa.field("region_xy", _XY, nullable=False),
        pa.field("company", pa.int64()),
    ],
)


def of_pieces(pieces: Pieces) -> "pa.RecordBatch":
    """Return pieces as a batch of the form PIECES."""
    columns: dict[str, Array] = {name: of_numbers(getattr(pieces, name)) for name in _NUMBERS}
    for name, (lon, lat) in _PLACES.items():
        places_deg = getattr(pieces, f"{name}_deg")
        columns |= {lon: of_numbers(places_deg[:, 0]), lat: of_numbers(places_deg[:, 1])}
    columns["hull_xy"] = of_lists(pieces.hull_xy, pieces.hull_offset)
    columns["shape_xy"] = of_lists(pieces.shape_xy, pieces.shape_offset)
    if pieces.changes:
        columns["shape_to_xy"] = of_lists(pieces.shape_to_xy, pieces.shape_offset)
    else:
        columns["shape_to_xy"] = pa.nulls(len(pieces), _XY)
    return PIECES.batch(columns)


def to_pieces(given: Batch) -> Pieces:
    """Return the pieces of a batch or table of the form PIECES; raises InvalidInput if it does not fit."""
    columns = PIECES.columns(given)
    who = f"Arrow form {PIECES.name!r}"
    hull_xy, hull_offset = pairs(columns["hull_xy"], who, "hull_xy")
    shape_xy, shape_offset = pairs(columns["shape_xy"], who, "shape_xy")
    places: dict[str, Any] = {
        f"{name}_deg": np.column_stack([numbers(columns[lon]), numbers(columns[lat])])
        for name, (lon, lat) in _PLACES.items()
    }
    return Pieces(
        **{name: numbers(columns[name]) for name in _NUMBERS},
        **places,
        hull_xy=hull_xy,
        hull_offset=hull_offset,
        shape_xy=shape_xy,
        shape_to_xy=_shapes_to(columns["shape_to_xy"], shape_xy, shape_offset, who),
        shape_offset=shape_offset,
    )


def _shapes_to(
    column: Array, shape_xy: NDArray[np.float64], shape_offset: NDArray[np.int64], who: str
) -> NDArray[np.float64]:
    """Return shapes at the ends of legs; the same array if none changes."""
    if column.null_count == len(column):
        return shape_xy
    changed_xy, offset = pairs(column, who, "shape_to_xy")
    is_known = ~numbers(column.is_null())
    if not np.array_equal(np.diff(offset)[is_known], np.diff(shape_offset)[is_known]):
        raise InvalidInput(who, "shape_to_xy", "must have as many vertices as shape_xy, or be null")
    if is_known.all():
        return changed_xy
    shapes = shape_xy.copy()
    shapes[np.repeat(is_known, np.diff(shape_offset))] = changed_xy
    return shapes


def of_pairs(given: Pairs) -> "pa.RecordBatch":
    """Return pairs of pieces as a batch of the form PAIRS."""
    company = pa.nulls(len(given), pa.int64()) if given.company is None else of_numbers(given.company)
    return PAIRS.batch(
        {
            "a": of_numbers(given.a),
            "b": of_numbers(given.b),
            "region_xy": of_lists(given.region_xy, given.region_offset),
            "company": company,
        }
    )


def to_pairs(given: Batch) -> Pairs:
    """Return the pairs of a batch or table of the form PAIRS; raises InvalidInput if it does not fit."""
    columns = PAIRS.columns(given)
    who = f"Arrow form {PAIRS.name!r}"
    company = columns["company"]
    if company.null_count not in (0, len(company)):
        raise InvalidInput(who, "company", "must be known of all pairs, or of none")
    return Pairs(
        PieceRows(numbers(columns["a"])),
        PieceRows(numbers(columns["b"])),
        *pairs(columns["region_xy"], who, "region_xy"),
        None if len(company) and company.null_count else numbers(company),
    )
