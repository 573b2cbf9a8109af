"""Stage 4: where pieces meet, at an instant that is known."""

from conflictdb import kernel
from conflictdb.arrays.pieces import PieceRows
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.meeting import meetings


def meeting_points(prepared: kernel.Scene, a: PieceRows, b: PieceRows, at_s: Floats, threads: int = 1) -> Floats:
    """Return (n, 2) longitude and latitude, degrees, of where pieces a and b (n,) meet at an instant of their time.

    Where the polygons touch it is the point of touch, where they overlap a point of both; NaN where a piece cannot be.
    """
    start_us, _ = prepared.pieces.shared_span(a, b)
    return meetings(prepared, a, b, start_us, at_s, threads)
