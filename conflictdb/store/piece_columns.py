"""The columns of the table `piece` in their order: sql/ (docs/plan_sql.py) and COPY loop over them."""

from typing import Final, NamedTuple

from conflictdb.arrays.column_numbers import IN_PIECES


class PieceColumn(NamedTuple):
    """A column of a row of pieces.

    sql : type
    is_scalar : whether each row has one value, which clients send; else the database makes it, or it is an array
    """

    name: str
    sql: str
    is_scalar: bool = True

    @property
    def sent(self) -> str:
        """Return the type of the parameter: shapes are bytes."""
        return "bytea" if self.sql == "geometry" else self.sql


PIECE_COLUMNS: Final = (
    PieceColumn("piece_id", "bigint", is_scalar=False),
    PieceColumn("scene_id", "bigint", is_scalar=False),
    PieceColumn("object_kind", "smallint"),
    PieceColumn("object_id", "bigint"),
    PieceColumn("version", "bigint"),
    PieceColumn("part", "integer"),
    PieceColumn("turn", "smallint"),
    PieceColumn("hull", "geometry"),
    PieceColumn("span", "tstzrange"),
    PieceColumn("floor_m", "double precision"),
    PieceColumn("ceiling_m", "double precision"),
    PieceColumn("shape", "geometry"),
    PieceColumn("leg_start", "timestamptz"),
    PieceColumn("leg_end", "timestamptz"),
    PieceColumn("start_lon_deg", "double precision"),
    PieceColumn("start_lat_deg", "double precision"),
    PieceColumn("end_lon_deg", "double precision"),
    PieceColumn("end_lat_deg", "double precision"),
    PieceColumn("bearing_deg", "double precision"),
    PieceColumn("shape_to", "geometry"),
    PieceColumn("pieces", "integer"),
    PieceColumn("parts", "integer[]", is_scalar=False),
    PieceColumn("hulls", "geometry", is_scalar=False),
    PieceColumn("shapes", "geometry", is_scalar=False),
    PieceColumn("cuts", "timestamptz[]", is_scalar=False),
    PieceColumn("leg_times", "timestamptz[]", is_scalar=False),
    PieceColumn("legs", "double precision[]", is_scalar=False),
    PieceColumn("climb", "double precision[]", is_scalar=False),
    *(PieceColumn(name, "bigint") for name in IN_PIECES),
)
# The columns that clients send as one value a row, in the order of the parameters of _put_pieces.
SCALARS: Final = tuple(one for one in PIECE_COLUMNS if one.is_scalar)
