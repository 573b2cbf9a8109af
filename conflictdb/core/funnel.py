"""The counts and seconds of a run: one table, which its record and the columns of the table `run` follow.

To add a count: add a row here, a field to `Funnel` and to `Run` (jobs/detect.py), and count it. It is recorded with the
settings of the run. To give it a column: a revision, its comment, a field of `RunStatus` (store/listing.py), and the
two lists of columns in sql/60_write_back.sql. Counts of the kernel (`kernel.Work`) and the programs (`Programs`) need
no row: they are recorded by their names.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from conflictdb.core.stage4.effort import Effort
from conflictdb.model.plans import Scene


@dataclass(frozen=True, slots=True)
class Measure:
    """A count of pairs of pieces, or the seconds of a step.

    meaning : for reference pages and the comment of its column
    column : whether the table `run` has it; else it is recorded with the settings, if it is a count
    """

    name: str
    meaning: str
    column: bool = True


MEASURES: Final = (
    Measure("candidate_pairs", "Pairs of pieces after stage 1"),
    Measure("intersecting_pairs", "Pairs of pieces after stage 2"),
    Measure("projected_pairs", "Pairs of pieces that stage 3 worked on", column=False),
    Measure("window_pairs", "Pairs of pieces that stage 3 leaves, which shows the others apart, and pairs of areas"),
    Measure("solved_pairs", "Pairs of pieces that stage 4 decided"),
    Measure("met_pairs", "Pairs of pieces that are reported", column=False),
    Measure("pieces_s", "Seconds spent on pieces"),
    Measure("stage1_s", "Seconds spent in stage 1, broad phase"),
    Measure("stage2_s", "Seconds spent in stage 2, intersection"),
    Measure("stage3_s", "Seconds spent in stage 3: in closed form (exact), or projecting regions (nlp)"),
    Measure("stage4_s", "Seconds spent in stage 4, solver"),
)

# Told how many pairs stage 4 has decided, and of how many.
Progress = Callable[[int, int], None]


@dataclass(slots=True)
class Funnel:
    """The measures of a run (MEASURES), and what stage 4 did.

    settings : of all pairs of a part, if rules do not give them different ones
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
    settings: Scene | None = None

    def add(self, other: "Funnel") -> None:
        """Count another run in."""
        self.effort.add(other.effort)
        for name, count in other.counted().items():
            if count:
                setattr(self, name, getattr(self, name) + count)

    def counted(self) -> dict[str, Any]:
        """Return all counts and seconds but those of stage 4 by name: that of the column of the table `run`, if any."""
        return {one.name: getattr(self, one.name) for one in MEASURES}

    def without_column(self) -> dict[str, int]:
        """Return the counts that are recorded with the settings of a run, by name."""
        return {one.name: getattr(self, one.name) for one in MEASURES if not one.column} | self.effort.counts()
