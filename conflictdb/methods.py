"""The methods of detection, one table: where each stops, and what it needs, costs and promises. Imports no library.

It stands below `pipeline`, for `model` refuses settings by it and stage 4 chooses its solver by it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from types import MappingProxyType
from typing import Final


class Method(StrEnum):
    """Where a detection stops: the trade between speed and accuracy."""

    SCREEN = "screen"  # who might meet
    WINDOW = "window"  # a safe time window
    EXACT = "exact"  # certified times
    NLP = "nlp"  # certified times, found by the published program


class Solver(Enum):
    """What stage 4 is done with."""

    CERTIFIED = auto()  # proofs and bracketed roots
    PROGRAMS = auto()  # the published linear and nonlinear programs say where to look


class Tried(Enum):
    """How `advise` tries a method."""

    WIDELY = auto()  # at all tolerances, and on the other earth
    SPARINGLY = auto()  # with the scene's own settings and on few pairs


@dataclass(frozen=True, slots=True)
class MethodSpec:
    """What a method does, needs, costs and promises.

    last_stage : 2, 3 or 4
    needs_regions : stage 3 narrows the time in which pairs can meet, by the regions of stage 2; otherwise it is all
        the time they share, and no region is computed
    solver : of stage 4; None without it, when neither places nor closest approaches are known
    tried : by `advise`
    says, promises, costs : as users read it (the command line, docs/explanation/accuracy.md, the catalog)
    """

    last_stage: int
    needs_regions: bool
    solver: Solver | None
    tried: Tried
    says: str
    promises: str
    costs: str


METHODS: Final[Mapping[Method, MethodSpec]] = MappingProxyType(
    {
        Method.SCREEN: MethodSpec(
            2,
            needs_regions=False,
            solver=None,
            tried=Tried.WIDELY,
            says="who might meet",
            promises="no conflict is missed; periods are the time that swept hulls share",
            costs="stages 1 and 2 alone",
        ),
        Method.WINDOW: MethodSpec(
            3,
            needs_regions=True,
            solver=None,
            tried=Tried.WIDELY,
            says="a safe time window",
            promises="no conflict is missed; every contact lies in the period",
            costs="three to four times `exact`",
        ),
        Method.EXACT: MethodSpec(
            4,
            needs_regions=False,  # its certified windows cost less than the regions of stage 2
            solver=Solver.CERTIFIED,
            tried=Tried.WIDELY,
            says="certified times",
            promises="no conflict is missed and none is false, up to `tolerance_m`; every period is proven to be "
            "contact throughout, and holds the true one, which is shorter by at most `time_error_s` at either end",
            costs="one to four microseconds a pair in full batches, some ten in small ones",
        ),
        Method.NLP: MethodSpec(
            4,
            needs_regions=True,
            solver=Solver.PROGRAMS,
            tried=Tried.SPARINGLY,
            says="certified times, found by the published program",
            promises="the same as `exact`",
            costs="300 to 600 times `exact`",
        ),
    }
)
