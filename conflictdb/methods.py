"""The methods of detection, one table: where each stops, and what it needs and gives. Imports no library."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from types import MappingProxyType
from typing import Final


class Method(StrEnum):
    """Where a detection stops: the trade between speed and accuracy."""

    SCREEN = "screen"  # stages 1-2: who might meet
    WINDOW = "window"  # stage 3: a time window that holds every contact
    EXACT = "exact"  # stage 4: times to the last digits, with a certificate
    NLP = "nlp"  # stage 4: the published nonlinear program (SLSQP), its answers certified


class Solver(Enum):
    """What stage 4 is done with."""

    CERTIFIED = auto()  # proofs and bracketed roots
    PROGRAMS = auto()  # the published linear and nonlinear programs say where to look


@dataclass(frozen=True, slots=True)
class Steps:
    """What a method does of stages 3 and 4.

    last_stage : 2, 3 or 4
    projects_regions : stage 3 narrows the time in which pairs can meet, by the regions of stage 2; otherwise it is all
        the time they share, and no region is computed
    solver : of stage 4; None without it, when neither places nor closest approaches are known
    pairs_per_job : pairs that a process of stage 4 gets at a time: some seconds of work, many times its start
    """

    last_stage: int
    projects_regions: bool
    solver: Solver | None
    pairs_per_job: int = 1


METHODS: Final[Mapping[Method, Steps]] = MappingProxyType(
    {
        Method.SCREEN: Steps(2, projects_regions=False, solver=None),
        Method.WINDOW: Steps(3, projects_regions=True, solver=None),
        # Its certified windows cost less than the regions of stage 2.
        Method.EXACT: Steps(4, projects_regions=False, solver=Solver.CERTIFIED, pairs_per_job=200_000),
        Method.NLP: Steps(4, projects_regions=True, solver=Solver.PROGRAMS, pairs_per_job=2_000),
    }
)
