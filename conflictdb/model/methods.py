"""The methods of detection, one table: what each stops after, promises and costs. Imports no library."""

from collections.abc import Mapping
from enum import Enum, StrEnum, auto
from types import MappingProxyType
from typing import Final, NamedTuple

# Messages about methods of earlier releases.
REMOVED: Final[Mapping[str, str]] = MappingProxyType({"window": "was removed: use exact, which is quicker and decides"})


class Method(StrEnum):
    """Where a detection stops: the trade between speed and accuracy."""

    SCREEN = "screen"  # who might meet
    EXACT = "exact"  # certified times
    NLP = "nlp"  # certified times, found by the published program


class Solver(Enum):
    """What stage 4 is done with."""

    CERTIFIED = auto()  # proofs and bracketed roots
    PROGRAMS = auto()  # the published linear and nonlinear programs say where to look


class MethodSpec(NamedTuple):
    """What a method does, costs and promises.

    solver : of stage 4; None: the method stops after stage 2, and finds neither places nor closest approaches
    says, promises, costs : as users read it (the command line, docs/explanation/accuracy.md, the catalog)
    """

    solver: Solver | None
    says: str
    promises: str
    costs: str

    @property
    def needs_regions(self) -> bool:
        """Whether stage 3 projects the regions of stage 2, to narrow the time in which the programs look."""
        return self.solver is Solver.PROGRAMS


METHODS: Final[Mapping[Method, MethodSpec]] = MappingProxyType(
    {
        Method.SCREEN: MethodSpec(
            solver=None,
            says="who might meet",
            promises="no conflict is missed; periods are the time that swept hulls share; no places",
            costs="stages 1 and 2 alone",
        ),
        Method.EXACT: MethodSpec(
            solver=Solver.CERTIFIED,
            says="certified times",
            promises="no conflict is missed and none is false, up to `tolerance_m`; every period is proven to be "
            "contact throughout, and holds the true one, which is shorter by at most `time_error_s` at either end",
            costs="one to four microseconds a pair in full batches, some ten in small ones",
        ),
        Method.NLP: MethodSpec(
            solver=Solver.PROGRAMS,
            says="certified times, found by the published program",
            promises="the same as `exact`",
            costs="300 to 600 times `exact` a pair, 3 to 49 times a whole detection",
        ),
    }
)
