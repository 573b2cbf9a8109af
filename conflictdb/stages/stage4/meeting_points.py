"""Stage 4: find where pieces meet at a given instant."""

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pieces import PieceRows
from conflictdb.kernel.meeting import meetings


def meeting_points(prepared: kernel.KernelScene, a: PieceRows, b: PieceRows, at_s: Floats, threads: int = 1) -> Floats:
    """Return (n, 2) longitude and latitude, degrees, of a point at which pieces a and b (n,) meet at an instant.

    It is the point of touch, or a point inside both polygons if they overlap; NaN if a piece is invalid.

    at_s : (n,) seconds after the start of the shared span
    """
    start_us, _ = prepared.pieces.shared_span(a, b)
    return meetings(prepared, a, b, start_us, at_s, threads)
