"""Stage 4, exact: contact times with a certificate, for many pairs at once.

Of each pair, in this order and only as far as it is needed:

1. *Closed form.* Where both polygons move uniformly and rigidly but for a trace, gaps along the normals of their edges
   are linear in time: the contact is one interval, and the trace bounds its error.
2. *Certified window.* Along a fixed direction the gap of polygons whose vertices move along their chords is concave in
   time: its chord, less the bound on how far vertices leave theirs, shows when the pair is apart for certain.
3. *Ends.* Between a window's end and an instant of conflict the signed separation is brought to zero on the true motion
   (regula falsi), and evaluated on both sides of the answer, beyond what rounding could be worth.
4. *Certificate.* That the pair is apart from the window's end to there follows again from a chord; that it is in
   conflict from there on, from the convexity of the separation of rigid polygons in uniform motion.

What this does not settle (grazing, several contacts, polygons without an inside) is left to `stage4.search`, which
takes any pair apart by branch and bound.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.exact.separated import Separated
from conflictdb.stage4.exact.touching import Touching, depth_of
from conflictdb.stage4.exact.windows import Work
from conflictdb.stage4.outcomes import Outcome, Solution

__all__ = ["Work", "solve_depth", "solve_exactly"]

# Pairs evaluated together: their arrays stay in the processor's cache.
BLOCK: Final = 2048


def solve_exactly(pairs: Encounters, low: Floats, high: Floats, margin_m: float, work: Work) -> Solution:
    """Return what is certain of like pairs during [low, high], seconds.

    margin_m : >= TOUCH_M on the earth. SEPARATED is further apart than the separation by more than this throughout;
        CONTACT is nearer by more than this at some instant, nearer than the separation from start_s to end_s, and not
        before or after.
    """
    n = len(pairs)
    found = Solution.undecided(low, high)
    if max(pairs.a.vertex_count, pairs.b.vertex_count) < 3:
        return found
    kind = Touching if pairs.separation_m == 0.0 else Separated
    for first in range(0, n, BLOCK):
        rows = slice(first, first + BLOCK)
        block = kind(pairs.take(rows), low[rows], high[rows], margin_m, work)
        block.settle()
        found.outcome[rows] = _outcome(block.is_clear, block.is_solved)
        found.start_s[rows], found.end_s[rows], found.error_s[rows] = block.start, block.end, block.error
    return found


def solve_depth(pairs: Encounters, start: Floats, end: Floats, margin_m: float) -> NDArray[np.int8]:
    """Return (n,) the outcome of asking whether pairs overlap by more than a margin during [start, end], seconds."""
    return _outcome(*depth_of(pairs, start, end, margin_m))


def _outcome(is_separated: NDArray[np.bool_], is_contact: NDArray[np.bool_]) -> NDArray[np.int8]:
    outcome = np.where(is_contact, Outcome.CONTACT, np.where(is_separated, Outcome.SEPARATED, Outcome.UNDECIDED))
    return outcome.astype(np.int8)
