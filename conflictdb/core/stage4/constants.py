"""Tuning constants of stage 4, each with its unit and the effect of a change.

Lengths are metres on the earth unless stated.
"""

from typing import Final

# --- What counts as the same -----------------------------------------------------------------------------------------

# Polygons this close touch. Coordinates are rounded to 1e-8 m: with less, a touch may become a miss; with more, ends of
# contacts are stated with more doubt.
TOUCH_M: Final = 5e-8
# Up to this distance the nearest points in a conformal plane are those on the earth. The scale differs along it by a
# share of 1e-8 at 89 degrees of latitude. With more, a distance may be found too large; with less, more pairs are
# measured along geodesics, which is slower.
SHORT_M: Final = 1e-3

# --- Arrays ----------------------------------------------------------------------------------------------------------

# None of these changes an answer: they keep arrays within memory and the processor's cache.
# Pairs taken together: enough to fill the arrays, few enough to keep them in memory.
PAIRS_AT_ONCE: Final = 20_000
