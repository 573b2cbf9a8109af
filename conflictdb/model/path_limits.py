"""The features of plans that a way of asking refuses: one table, which the reference shows.

Every way of asking gives the answer of `solve`, or refuses. tests/paths puts scenes with all features to all of them:
a refusal without a row here fails, and so does a row without a refusal.
"""

from typing import Final, NamedTuple


class PathLimit(NamedTuple):
    """A refusal.

    path, feature : as in the table of paths
    sentence : part of the message
    reason : why it refuses
    """

    path: str
    feature: str
    sentence: str
    reason: str


_ONE_SPEED: Final = "has a meaning without tolerances only"
_ONE_TIME: Final = "speeds are not computed with a separation in time"
_WHY_ONE_TIME: Final = "The time between two uses of a place changes with both speeds; delays take it into account."

PATH_LIMITS: Final = (
    PathLimit("speeds", "separation in time", _ONE_TIME, _WHY_ONE_TIME),
    PathLimit("speeds", "separation in time by class", _ONE_TIME, _WHY_ONE_TIME),
    PathLimit("speeds of a stored scene", "separation in time", _ONE_TIME, _WHY_ONE_TIME),
    PathLimit("speeds of a stored scene", "separation in time by class", _ONE_TIME, _WHY_ONE_TIME),
)
