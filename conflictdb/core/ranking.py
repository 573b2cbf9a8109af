"""Which conflicts come first, and in what words: one rank for the command line, reports and the page.

Both objects move before one moves; certain before possible; the soonest; then how much of the separation is missing.
"""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from conflictdb.model.results import Certainty, Conflict, Kind, Verdict
from conflictdb.model.units import Units

# A list of conflicts starts without numpy.
if TYPE_CHECKING:
    from conflictdb.core.depths import DeepestContact

Known: TypeAlias = "Mapping[tuple[str, str], DeepestContact]"

# Depths of more conflicts take seconds: a list does without them.
MOST_DEPTHS: Final = 2_000
_TOUCHES_M: Final = 0.05  # is 0.0 m when printed


class Facts(NamedTuple):
    """What the rank of a conflict reads.

    moving : how many of the two are tracks
    first_s : first contact, Unix seconds; -inf if unbounded
    """

    a_key: str
    b_key: str
    moving: int
    is_certain: bool
    first_s: float


def rank(one: Facts, known: Known) -> tuple[int, bool, float, float, str, str]:
    """Return the sort key of a conflict, the worst first; unknown depths come last among equals."""
    found = known.get((one.a_key, one.b_key))
    missing_m = -1.0 if found is None else max(0.0, found.depth_m)
    return -one.moving, not one.is_certain, one.first_s, -missing_m, one.a_key, one.b_key


def is_certain(verdict: Verdict, certainty: Certainty | None) -> bool:
    """Return whether a pair conflicts for certain, on all voyages within its tolerances."""
    return verdict is Verdict.CONFLICT and certainty is not Certainty.MAY


def facts_of(one: Conflict) -> Facts:
    """Return what the rank of a conflict reads."""
    first = one.first_contact
    moving = (one.a_kind is Kind.TRACK) + (one.b_kind is Kind.TRACK)
    first_s = float("-inf") if first is None else first.timestamp()
    return Facts(one.a_key, one.b_key, moving, is_certain(one.verdict, one.certainty), first_s)


def worst_first(conflicts: Iterable[Conflict], known: Known) -> list[Conflict]:
    """Return conflicts in the order of their rank; scenes stay in the order of their first conflicts."""
    conflicts = list(conflicts)
    scenes = {scene: n for n, scene in enumerate(dict.fromkeys(one.scene for one in conflicts))}
    return sorted(conflicts, key=lambda one: (scenes[one.scene], *rank(facts_of(one), known)))


def missing_text(moving: int, found: "DeepestContact | None", units: Units = Units.NAUTICAL) -> str:
    """Return how much of the separation is missing at most, in words: ``inside by 4.7 nmi``, ``too close by 0.4 nmi``.

    moving : how many of the two are tracks
    """
    if found is None:
        return ""
    words, by_m = missing(moving, found)
    return words if by_m is None else f"{words} by {units.most_distance(by_m)}"


def missing(moving: int, found: "DeepestContact") -> tuple[str, float | None]:
    """Return how the separation is missing, in words, and by how many metres; None: by none to speak of.

    moving : how many of the two are tracks
    """
    within_m = found.depth_m - found.separation_m
    if max(found.depth_m, 0.0) < _TOUCHES_M:
        return "just touching", None
    if moving == 2 or within_m < _TOUCHES_M:
        return "too close", found.depth_m
    return "inside" if moving else "overlapping", within_m
