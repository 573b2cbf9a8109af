"""Send pieces that are not stored to routines that compare them with those of a scene."""

from typing import Any

import shapely

from conflictdb.arrays.pieces import Pieces
from conflictdb.core.stage1_broad_phase import hulls_of


def given(pieces: Pieces) -> tuple[list[Any], ...]:
    """Return pieces as the last parameters of such a routine (`_given_pieces`)."""
    numbers = (pieces.kind, pieces.numbers, pieces.turn)
    ends = (pieces.start_us, pieces.end_us, pieces.end_inclusive, pieces.floor_m, pieces.ceiling_m)
    hulls = list(shapely.to_wkb(hulls_of(pieces)))
    return *(column.tolist() for column in numbers), hulls, *(column.tolist() for column in ends)
