"""The settings of a scene, checked."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

from conflictdb.errors import InvalidInput
from conflictdb.model.methods import METHODS, Method
from conflictdb.model.rules import Rule
from conflictdb.model.settings import (
    NAMES,
    SETTINGS,
    EarthModel,
    Intervals,
    Motion,
    Regions,
    SettingType,
    VerticalDatum,
    checked,
)

MAX_LATITUDE_DEG: Final = 90.0
# A scene that does not say gets the earth of its motion.
_BY_MOTION: Final = cast(EarthModel, None)


@dataclass(frozen=True, slots=True)
class Scene:
    """Settings that every object of a scene shares.

    tolerance_m : closeness that is too close to call, metres, >= 0
    separation_m : minimum distance wanted between polygons, metres, >= 0 (0: they must touch to conflict)
    nearest_m : pairs without conflict that come within this are reported with their closest approach, metres, >= 0
        (0: they are not); methods that stop before stage 4 report none
    earth : by default wgs84, or for great circles sphere, the only one they are on
    centre : great circles: longitude and latitude, degrees, that all objects lie within 60 degrees of; None until it
        follows from the first objects
    vertical_separation_m : minimum distance wanted between heights, metres to the micrometre, >= 0 (0: they must
        overlap to conflict)
    time_separation_s : two objects conflict if they use one place within so many seconds, whole microseconds, 0 (at the
        same time) to 30 days; not with method nlp
    delays_within_s : detections store the delays of each track that are in conflict, up to so many seconds, whole
        microseconds, 0 (none) to 30 days. `delays` within these is computed with this horizon, so that the answer is
        the stored one
    intervals : closed: the last instant of a span and the ceiling of a height band belong to an object
    horizon_days : schedules are expanded from today to so many days ahead, 0 to 36,525, and over all voyages
    vertical_datum : what the heights of all objects are above
    regions : off: detections do not compute where each conflict is
    rules : separation rules by class, in place of `separation_m`, `vertical_separation_m` and `time_separation_s`
    """

    name: str
    motion: Motion = Motion.RHUMB
    earth: EarthModel = _BY_MOTION
    method: Method = Method.EXACT
    tolerance_m: float = 1.0
    separation_m: float = 0.0
    nearest_m: float = 0.0
    centre: tuple[float, float] | None = None
    vertical_separation_m: float = 0.0
    time_separation_s: float = 0.0
    delays_within_s: float = 0.0
    intervals: Intervals = Intervals.HALF_OPEN
    horizon_days: float = 366.0
    vertical_datum: VerticalDatum = VerticalDatum.MSL
    regions: Regions = Regions.ON
    rules: Sequence[Rule] = ()

    def __post_init__(self) -> None:
        who = f"scene {self.name!r}"
        if not isinstance(self.name, str) or not self.name.strip():
            raise InvalidInput("scene", "name", "must be a non-empty string")
        if self.earth is _BY_MOTION:
            is_round = self.motion == Motion.GREAT_CIRCLE
            object.__setattr__(self, "earth", EarthModel.SPHERE if is_round else EarthModel.WGS84)
        for setting in SETTINGS:
            if setting.type is not SettingType.PLACE:
                object.__setattr__(self, setting.name, checked(who, setting, getattr(self, setting.name)))
        if self.motion == Motion.GREAT_CIRCLE and self.earth != EarthModel.SPHERE:
            raise InvalidInput(
                who, "earth", f"must be 'sphere' with motion 'great_circle', or left out; got {self.earth.value!r}"
            )
        object.__setattr__(self, "rules", self._checked_rules())
        if self.method == Method.NLP and (self.time_separation_s > 0.0 or any(rule.time_s for rule in self.rules)):
            rule = "is not known to method 'nlp', whose program knows one time only: use 'exact', or 0"
            raise InvalidInput(who, "time_separation_s", f"{rule}; got {self.time_separation_s!r}")
        if self.centre is not None:
            object.__setattr__(self, "centre", self._checked_centre(who))

    def _checked_rules(self) -> tuple[Rule, ...]:
        if not self.rules:
            return ()
        from conflictdb.model.rule_table import RuleTable  # needs numpy

        return tuple(RuleTable.of(self.rules).rules)

    def _checked_centre(self, who: str) -> tuple[float, float]:
        if self.motion != Motion.GREAT_CIRCLE:
            raise InvalidInput(
                who, "centre", f"has a meaning with motion 'great_circle' only, not {self.motion.value!r}"
            )
        numbers: tuple[Any, ...] = tuple(self.centre) if isinstance(self.centre, list | tuple) else ()
        sound = len(numbers) == 2 and all(isinstance(x, int | float) and not isinstance(x, bool) for x in numbers)
        if not (sound and abs(numbers[0]) <= 180.0 and abs(numbers[1]) <= MAX_LATITUDE_DEG):
            rule = "must be [longitude, latitude] in degrees, within +-180 and +-90"
            raise InvalidInput(who, "centre", f"{rule}; got {self.centre!r:.60}")
        return float(numbers[0]) + 0.0, float(numbers[1]) + 0.0

    def differing(self, other: "Scene") -> list[str]:
        """Return the names of the settings that another scene has others of, rules among them; its name is none."""
        return [name for name in (*NAMES, "rules") if getattr(self, name) != getattr(other, name)]

    @property
    def reach_m(self) -> float:
        """How close two polygons must come to be of any interest, metres."""
        conflict_m = self.tolerance_m + self.separation_m
        return conflict_m if METHODS[self.method].solver is None else max(conflict_m, self.nearest_m)

    @property
    def has_regions(self) -> bool:
        """Whether detections store where conflicts are."""
        return self.regions is Regions.ON and METHODS[self.method].solver is not None

    @property
    def largest_separation_m(self) -> float:
        """The largest separation of any pair, by its rules too, metres."""
        return max([self.separation_m, *(rule.separation_m or 0.0 for rule in self.rules)])

    @property
    def longest_time_us(self) -> int:
        """The largest separation in time of any pair, by its rules too, microseconds."""
        own_us = self.time_separation_us
        return max(own_us, *(round(1e6 * (rule.time_s or 0.0)) for rule in self.rules)) if self.rules else own_us

    @property
    def time_separation_us(self) -> int:
        """The separation in time, microseconds."""
        return round(1e6 * self.time_separation_s)
