"""Stage 4: where pieces meet, at an instant that is known."""

from conflictdb import kernel
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.meeting import meetings
from conflictdb.motion.contract import Plane


def meeting_points(plane: Plane, pieces: Pieces, pairs: Pairs, at_s: Floats) -> Floats:
    """Return (n, 2) longitude and latitude, degrees, of where each pair meets at an instant of its shared span.

    Where the polygons touch it is the point of touch, where they overlap a point of both; NaN where a piece cannot be.
    """
    scene = kernel.Scene(plane.kernel_plane, pieces, pairs.a, pairs.b)
    start_us, _ = pieces.shared_span(pairs.a, pairs.b)
    return meetings(scene, pairs.a, pairs.b, start_us, at_s)
