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


PATH_LIMITS: Final[tuple[PathLimit, ...]] = ()
