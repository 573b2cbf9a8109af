"""What a brief of one plan says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, tzinfo

from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Conflict, Delays, SceneState
from conflictdb.model.units import Units


@dataclass(frozen=True, slots=True)
class Proposed:
    """The move of a plan in a stored proposal.

    text : the move in one sentence
    changes : what changed in the scene since it was computed
    """

    proposal_id: int
    state: str
    text: str
    delay_s: float
    changes: Sequence[str]


@dataclass(frozen=True, slots=True)
class Brief:
    """What a brief is of.

    activations : of an area: the spans at which it is active
    others : the plans that it meets, by key
    delays : when it could depart instead; None: not known
    proposed : its move in the last proposal that has one, open or applied; None: none
    zone : of local times; UTC: these alone
    """

    scene: Scene
    plan: Area | Track
    activations: Sequence[tuple[datetime | None, datetime | None]]
    others: Mapping[str, Area | Track]
    conflicts: Sequence[Conflict]
    state: SceneState
    delays: Delays | None
    proposed: Proposed | None
    zone: tzinfo = UTC
    units: Units = Units.NAUTICAL
