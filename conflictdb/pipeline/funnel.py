"""What a run counts: how many pairs of pieces the stages left, how long they took, and what stage 4 did."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

from conflictdb.stage4.effort import Effort

# Told how many pairs stage 4 has decided, and of how many.
Progress = Callable[[int, int], None]


@dataclass(slots=True)
class Funnel:
    """How many pairs of pieces the stages left, the seconds they took, and what stage 4 did.

    candidate_pairs : whose boxes meet (stage 1)
    intersecting_pairs : whose hulls meet (stage 2)
    projected_pairs : handled by stage 3: decided in closed form (`exact`), or narrowed to a window (`nlp`)
    window_pairs : left by stage 3, which shows the others apart; pairs of areas included
    solved_pairs : given to stage 4: not decided in closed form
    met_pairs : reported
    """

    candidate_pairs: int = 0
    intersecting_pairs: int = 0
    projected_pairs: int = 0
    window_pairs: int = 0
    solved_pairs: int = 0
    met_pairs: int = 0
    pieces_s: float = 0.0
    stage1_s: float = 0.0
    stage2_s: float = 0.0
    stage3_s: float = 0.0
    stage4_s: float = 0.0
    effort: Effort = field(default_factory=Effort)

    def add(self, other: "Funnel") -> None:
        """Count another run in."""
        self.effort.add(other.effort)
        for name, count in other.counted().items():
            setattr(self, name, getattr(self, name) + count)

    def counted(self) -> dict[str, Any]:
        """Return all counts and seconds but those of stage 4 by name: that of the column of the table `run`, if any."""
        return {column.name: getattr(self, column.name) for column in fields(self) if column.name != "effort"}
