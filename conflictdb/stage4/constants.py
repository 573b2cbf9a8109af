"""The numbers that tune stage 4, each with its unit and what breaks when it is changed.

Lengths are metres on the earth where nothing else is said. Those of the published programs stand with them.
"""

from typing import Final

# --- What counts as the same -----------------------------------------------------------------------------------------

# Polygons this close touch. Coordinates are rounded to 1e-8 m: with less, a touch may become a miss; with more, ends of
# contacts are stated with more doubt.
TOUCH_M: Final = 5e-8
# Up to this distance the nearest points in a conformal plane are those on the earth: the scale differs along it by a
# share of 1e-8 at 89 degrees of latitude. With more, a distance may be found too large; with less, more pairs are
# measured along geodesics, which is slower.
SHORT_M: Final = 1e-3

# --- Arrays ----------------------------------------------------------------------------------------------------------

# None of these changes an answer: they keep arrays within memory and the processor's cache.
# Pairs taken together: enough to fill the arrays, few enough to keep them in memory.
PAIRS_AT_ONCE: Final = 20_000
