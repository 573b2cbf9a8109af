"""What is found: verdicts and kinds, by their names in results and by their codes in arrays and tables."""

from enum import StrEnum
from typing import Final


class Verdict(StrEnum):
    """What is known of a pair that is reported."""

    CONFLICT = "conflict"  # the polygons meet, deeper than the tolerance
    GRAZING = "grazing"  # the least separation is within the tolerance of zero: too close to call
    UNRESOLVED = "unresolved"  # not proven apart and not settled: the period is where they might meet
    NEAR = "near"  # no conflict: they come within the scene's nearest_m, and no closer than the separation

    @property
    def code(self) -> int:
        """The number that stands for it in arrays; the database knows names only."""
        return _VERDICT_CODES[self]

    @classmethod
    def of_code(cls, code: int) -> "Verdict":
        """Return the verdict that a number stands for."""
        return _VERDICTS[code]


class Kind(StrEnum):
    """Kind of an object."""

    AREA = "area"
    TRACK = "track"

    @property
    def code(self) -> int:
        """The number that stands for it in arrays, and in the tables of the database."""
        return _KIND_CODES[self]

    @classmethod
    def of_code(cls, code: int) -> "Kind":
        """Return the kind that a number stands for."""
        return _KINDS[code]


# Given, not counted: they stay what they are whatever the order of the names.
_VERDICT_CODES: Final = {Verdict.CONFLICT: 0, Verdict.GRAZING: 1, Verdict.UNRESOLVED: 2, Verdict.NEAR: 3}
_VERDICTS: Final = {code: verdict for verdict, code in _VERDICT_CODES.items()}
_KIND_CODES: Final = {Kind.AREA: 0, Kind.TRACK: 1}  # areas come first in a pair
_KINDS: Final = {code: kind for kind, code in _KIND_CODES.items()}
