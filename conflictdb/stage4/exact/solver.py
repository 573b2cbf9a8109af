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

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.exact.separated import Separated
from conflictdb.stage4.exact.touching import Touching
from conflictdb.stage4.exact.windows import Settled, Work

__all__ = ["Settled", "Work", "settle_exactly"]

# Pairs evaluated together: their arrays stay in the processor's cache.
BLOCK: Final = 2048


def settle_exactly(pairs: Encounters, low: Floats, high: Floats, margin_m: float, work: Work) -> Settled:
    """Return what is certain of like pairs during [low, high], seconds; margin_m >= TOUCH_M on the earth."""
    n = len(pairs)
    found = Settled(np.zeros(n, np.bool_), np.zeros(n, np.bool_), low.copy(), high.copy(), np.zeros(n))
    if max(pairs.a.vertex_count, pairs.b.vertex_count) < 3:
        return found
    kind = Touching if pairs.separation_m == 0.0 else Separated
    for first in range(0, n, BLOCK):
        rows = slice(first, first + BLOCK)
        block = kind(pairs.take(rows), low[rows], high[rows], margin_m, work)
        block.settle()
        found.is_clear[rows], found.is_solved[rows] = block.is_clear, block.is_solved
        found.start_s[rows], found.end_s[rows], found.error_s[rows] = block.start, block.end, block.error
    return found
