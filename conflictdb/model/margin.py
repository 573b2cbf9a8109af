"""Margins: separations that a question wants on top of those of a scene."""

from dataclasses import dataclass, replace
from typing import Any, Final, Self

from conflictdb.errors import InvalidInput
from conflictdb.model import inputs
from conflictdb.model.departure_text import duration_text
from conflictdb.model.methods import Method
from conflictdb.model.rules import Rule
from conflictdb.model.scene import Scene
from conflictdb.model.units import Units

_US: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Margin:
    """How much more than the required separations a question wants.

    time_us : added to the separation in time of each pair, microseconds
    distance_m : added to the separation of each pair, metres
    """

    time_us: int = 0
    distance_m: float = 0.0

    @classmethod
    def of(cls, who: str, margin_s: Any, margin_m: Any) -> Self:
        """Return a margin. Raises InvalidInput."""
        time_us = round(_US * inputs.seconds(who, "margin_s", margin_s))
        return cls(time_us, inputs.reach_m(who, "margin_m", margin_m))

    def __bool__(self) -> bool:
        return self.time_us > 0 or self.distance_m > 0.0

    def added_to(self, scene: Scene) -> Scene:
        """Return settings whose separations are larger by the margin. Raises InvalidInput where they exceed a limit."""
        if not self:
            return scene
        try:
            return replace(
                scene,
                method=Method.EXACT,
                separation_m=scene.separation_m + self.distance_m,
                time_separation_s=(scene.time_separation_us + self.time_us) / _US,
                rules=tuple(map(self._added_to_rule, scene.rules)),
            )
        except InvalidInput as error:
            raise InvalidInput("margin", error.field, f"with the margin it {error.rule}") from None

    def _added_to_rule(self, rule: Rule) -> Rule:
        """Return a rule whose separations are larger; what it does not say follows from the scene."""
        return replace(
            rule,
            separation_m=None if rule.separation_m is None else rule.separation_m + self.distance_m,
            time_s=None if rule.time_s is None else (round(_US * rule.time_s) + self.time_us) / _US,
        )

    def text(self, units: Units = Units.NAUTICAL) -> str:
        """Return by how much proposed times are clear: ``clear by 5 min``."""
        parts = [duration_text(self.time_us)] if self.time_us else []
        parts += [units.given_distance(self.distance_m)] if self.distance_m else []
        return f"clear by {' and '.join(parts)}" if parts else "clear, no margin"


NO_MARGIN: Final = Margin()
