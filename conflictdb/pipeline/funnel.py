"""What a run counts: how many pairs of pieces the stages left, how long they took, and what stage 4 did."""

from collections.abc import Callable
from dataclasses import dataclass, field

from conflictdb.stage4.contacts import Effort

# Told how many pairs stage 4 has decided, and of how many.
Progress = Callable[[int, int], None]


@dataclass(slots=True)
class Funnel:
    """How many pairs of pieces the stages left, the seconds they took, and what stage 4 did.

    projected_pairs : that stage 3 was run on
    window_pairs : with a time when they could meet, areas included
    solved_pairs : given to stage 4
    met_pairs : reported
    """

    projected_pairs: int = 0
    window_pairs: int = 0
    solved_pairs: int = 0
    met_pairs: int = 0
    stage3_s: float = 0.0
    stage4_s: float = 0.0
    effort: Effort = field(default_factory=Effort)
