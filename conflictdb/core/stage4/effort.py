"""Counts of the work of stage 4."""

from dataclasses import asdict, dataclass, field

from conflictdb import kernel


@dataclass(slots=True)
class Programs:
    """Calls of each published program, and calls that missed a contact."""

    lp_calls: int = 0
    nlp_calls: int = 0
    failed_calls: int = 0


@dataclass(slots=True)
class Effort:
    """The work of the kernel and the calls of the published programs."""

    exact: kernel.Work = field(default_factory=kernel.Work)
    programs: Programs = field(default_factory=Programs)

    def add(self, other: "Effort") -> None:
        """Add the counts of another effort."""
        for mine, theirs in ((self.exact, other.exact), (self.programs, other.programs)):
            for name in theirs.__slots__:
                setattr(mine, name, getattr(mine, name) + getattr(theirs, name))

    def counts(self) -> dict[str, int]:
        """Return all counts by name, without seconds."""
        counted = {**asdict(self.exact), **asdict(self.programs)}
        return {name: count for name, count in counted.items() if isinstance(count, int)}
