"""Stage 4: where pieces meet, at an instant that is known."""

from conflictdb import kernel
from conflictdb.arrays.pairs import Pairs
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.meeting import meetings


def meeting_points(prepared: kernel.Scene, pairs: Pairs, at_s: Floats) -> Floats:
    """Return (n, 2) longitude and latitude, degrees, of where each pair meets at an instant of its shared span.

    Where the polygons touch it is the point of touch, where they overlap a point of both; NaN where a piece cannot be.
    """
    start_us, _ = prepared.pieces.shared_span(pairs.a, pairs.b)
    return meetings(prepared, pairs.a, pairs.b, start_us, at_s)
