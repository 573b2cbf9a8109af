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
# A distance that is more than this above what is asked need not be known, so that cheaper bounds will do. With less,
# more intervals are split; with more, more distances are measured along geodesics.
NEAR_M: Final = 100.0

# --- Instants, seconds -----------------------------------------------------------------------------------------------

# Intervals are not split below a microsecond, the resolution of a timestamp. With more, grazing contacts stay
# undecided.
SHORTEST_INTERVAL_S: Final = 1e-6
# Ends are bracketed to this: a hundredth of what a timestamp can tell. With more, ends may be rounded to other
# microseconds.
BRACKET_S: Final = 1e-8

# --- Work that is done at most ---------------------------------------------------------------------------------------

# Halvings of a window: 64 reach a microsecond from a hundred thousand years. With fewer, long windows stay undecided.
MAX_LEVELS: Final = 64
# How often the search moves to an earlier contact that it passed over, and how often it cuts a contact. With fewer, the
# bounds of pairs that meet many times are wider.
MAX_ROUNDS: Final = 16
# Intervals under way for two objects, shared by their pairs of pieces, and for one pair of pieces at least and at most.
# Beyond it a pair is left undecided rather than let one take all memory and time.
MAX_INTERVALS: Final = 65_536
MIN_INTERVALS_PER_PAIR: Final = 64
MAX_INTERVALS_PER_PAIR: Final = 4096

# --- Arrays ----------------------------------------------------------------------------------------------------------

# None of these changes an answer: they keep arrays within memory and the processor's cache.
# Pairs taken together: enough to fill the arrays, few enough to keep them in memory.
PAIRS_AT_ONCE: Final = 20_000
# Numbers held at once by one array of an evaluation (8 bytes each; there are a few such arrays).
BATCH_NUMBERS: Final = 100_000
# The same of gaps between edges and vertices: polygons of thousands of vertices are taken some edges at a time.
EDGE_NUMBERS: Final = 32_768
