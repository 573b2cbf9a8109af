"""The settings of a scene: one table, which everything that carries settings reads.

The rules of `Scene`, options of the command line, scene files, GeoParquet, Spark, the store, reports and the map's page
loop over it; docs/generate.py writes the models of SQLAlchemy. To add a setting: add a row here, a field to `Scene`
(model/scene.py), a column to the table `scene` (a revision) and to the view `scenes` (sql/65_scenes.sql), a parameter
to `create_scene` (sql/15_editing.sql; sql/06_retired.sql has its former parameters), and act on it.
"""

from enum import Enum, StrEnum, auto
from numbers import Real
from typing import Any, Final, NamedTuple, TypeAlias, TypedDict

from conflictdb.errors import InvalidInput
from conflictdb.model.methods import REMOVED, Method


class Motion(StrEnum):
    """How tracks and edges run between their points."""

    RHUMB = "rhumb"  # at constant bearing
    GREAT_CIRCLE = "great_circle"  # the shortest way, on the sphere


class EarthModel(StrEnum):
    """Figure of the earth."""

    WGS84 = "wgs84"
    SPHERE = "sphere"


class Intervals(StrEnum):
    """Whether the last instant of a span and the ceiling of a height band belong to an object."""

    HALF_OPEN = "half_open"  # they do not: objects that only touch in time or height are apart
    CLOSED = "closed"  # they do


class VerticalDatum(StrEnum):
    """What the heights of a scene are above."""

    MSL = "msl"  # mean sea level
    WGS84 = "wgs84"  # the ellipsoid
    FLIGHT_LEVEL = "flight_level"  # where the pressure is 1013.25 hPa: metres of the standard atmosphere

    @property
    def phrase(self) -> str:
        """Its name in a sentence."""
        return _DATUM_PHRASES[self]


_DATUM_PHRASES: Final = {
    VerticalDatum.MSL: "mean sea level",
    VerticalDatum.WGS84: "the ellipsoid",
    VerticalDatum.FLIGHT_LEVEL: "a surface of constant pressure",
}
# How formats name them; as in sql/12_checks.sql, _vertical_datum.
_DATUM_NAMES: Final = {
    **dict.fromkeys(("MSL", "AMSL"), VerticalDatum.MSL),
    **dict.fromkeys(("WGS84", "W84"), VerticalDatum.WGS84),
    **dict.fromkeys(("FLIGHT_LEVEL", "FL", "STD"), VerticalDatum.FLIGHT_LEVEL),
}


def datum_named(name: Any) -> VerticalDatum | None:
    """Return the vertical datum of a name, in upper or lower case; None for any other value."""
    return _DATUM_NAMES.get(name.strip().upper()) if isinstance(name, str) else None


class Regions(StrEnum):
    """Whether detections compute and store where each conflict is."""

    ON = "on"
    OFF = "off"  # quicker and smaller: maps show first contacts, queries by place compare swept hulls


class SettingType(Enum):
    """Type of a setting; its rules, its option and its column follow from it."""

    CHOICE = auto()  # one of some names
    METRES = auto()  # a distance, 0 to MOST_M
    SECONDS = auto()  # whole microseconds, 0 to MOST_S
    DAYS = auto()  # 0 to MOST_DAYS
    PLACE = auto()  # longitude and latitude in degrees; in the database two columns, `_lon` and `_lat`


# Half the circumference of the earth, metres: the largest distance, and so the largest setting.
MOST_M: Final = 20_000_000.0
# Thirty days: spans that are widened by it stay within the instants of PostgreSQL.
MOST_S: Final = 2_592_000.0

# Decimal seconds of thirty days are doubles within this of whole microseconds.
_ROUNDING_US: Final = 1e-3
# A century.
MOST_DAYS: Final = 36_525.0

_UNITS: Final = {SettingType.METRES: "metres", SettingType.SECONDS: "seconds", SettingType.DAYS: "days"}

Choices: TypeAlias = type[StrEnum]


class Setting(NamedTuple):
    """A setting of a scene.

    meaning : one sentence, for the catalog and reference pages; a place has one for its longitude and its latitude
    default : None: it follows from the motion and the objects
    help : of its option on the command line
    choices : of a CHOICE
    label, says, says_zero : its row in a report, for a value, and for 0 unless empty; no row without a label
    is_stored_by_detect : whether `detect` takes it too; the others need other pieces or planes, and belong into files
    decides_conflicts : whether a pair's conflict may depend on it
    """

    name: str
    type: SettingType
    meaning: str
    default: StrEnum | float | None
    help: str
    choices: Choices | None = None
    label: str = ""
    says: str = "{:g} m"
    says_zero: str = ""
    is_stored_by_detect: bool = False
    decides_conflicts: bool = True

    @property
    def option(self) -> str:
        """The option of the command line."""
        return f"--{self.name.replace('_', '-')}"

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the table `scene` and the view `scenes`."""
        return (f"{self.name}_lon", f"{self.name}_lat") if self.type is SettingType.PLACE else (self.name,)


# In the order of the fields of `Scene`.
SETTINGS: Final = (
    Setting(
        "motion",
        SettingType.CHOICE,
        "Shape of tracks and edges between their points: rhumb or great_circle.",
        Motion.RHUMB,
        "shape of tracks between waypoints (default: rhumb)",
        choices=Motion,
    ),
    Setting(
        "earth",
        SettingType.CHOICE,
        "Figure of the earth: wgs84, or sphere (mean radius 6371008.771415 m).",
        None,
        "figure of the earth (default: wgs84; for great circles sphere)",
        choices=EarthModel,
    ),
    Setting(
        "method",
        SettingType.CHOICE,
        "Where a detection stops: screen (who might meet), exact (certified times), "
        "nlp (certified times, found by the published program).",
        Method.EXACT,
        "screen: who might meet; exact: certified times; nlp: by the published program (default: exact)",
        choices=Method,
        is_stored_by_detect=True,
    ),
    Setting(
        "tolerance_m",
        SettingType.METRES,
        "Tolerance, metres: pairs whose clearance is within it may be reported as grazing.",
        1.0,
        "clearance within which a pair is too close to call, and may be grazing (default: 1 m)",
        label="Tolerance",
        says="{:g} m: closer to touching than that is too close to call",
        is_stored_by_detect=True,
    ),
    Setting(
        "separation_m",
        SettingType.METRES,
        "Required separation between polygons, metres; 0: they conflict if they touch.",
        0.0,
        "required separation of polygons (default: 0: they touch)",
        label="Separation wanted",
        says_zero="none: they must touch",
        is_stored_by_detect=True,
    ),
    Setting(
        "nearest_m",
        SettingType.METRES,
        "Pairs without conflict that come within this distance (metres) are stored with their closest approach; "
        "0: none.",
        0.0,
        "also store pairs without conflict that come within this (default: 0: none)",
        label="Near is",
        says="within {:g} m",
        says_zero="not reported",
        is_stored_by_detect=True,
    ),
    Setting(
        "centre",
        SettingType.PLACE,
        "great_circle: the centre, degrees; all objects lie within 60 degrees of it.",
        None,
        "centre of a scene of great circles (default: the middle)",
    ),
    Setting(
        "vertical_separation_m",
        SettingType.METRES,
        "Required vertical separation, metres to the micrometre: objects whose heights are that far apart do not "
        "conflict; 0: height bands that touch are apart.",
        0.0,
        "required vertical separation (default: 0: height bands overlap)",
        label="Vertical separation wanted",
        says_zero="none: heights must overlap",
        is_stored_by_detect=True,
    ),
    Setting(
        "time_separation_s",
        SettingType.SECONDS,
        "Required separation in time, whole microseconds in seconds: two objects conflict if they use one place "
        "within so many seconds; 0: at the same time.",
        0.0,
        "required time between two uses of a place (default: 0: at the same time)",
        label="Separation in time wanted",
        says="{:g} s between two uses of a place",
        says_zero="none: only the same time counts",
        is_stored_by_detect=True,
    ),
    Setting(
        "delays_within_s",
        SettingType.SECONDS,
        "Detections store which delays of each track, up to this many seconds either way, are in conflict; 0: none.",
        0.0,
        "store which delays of each track, up to this, are in conflict (default: 0: none)",
        is_stored_by_detect=True,
        decides_conflicts=False,
    ),
    Setting(
        "intervals",
        SettingType.CHOICE,
        "Whether spans and height bands contain their upper ends: half_open (they do not) or closed (they do, as "
        "volumes of ASTM F3548).",
        Intervals.HALF_OPEN,
        "whether spans and height bands contain their upper ends (default: half_open)",
        choices=Intervals,
    ),
    Setting(
        "horizon_days",
        SettingType.DAYS,
        "How many days ahead of today schedules are expanded; they are over all voyages, too.",
        366.0,
        "days ahead that schedules are expanded for (default: 366)",
        is_stored_by_detect=True,
        decides_conflicts=False,
    ),
    Setting(
        "vertical_datum",
        SettingType.CHOICE,
        "What heights are above: msl (mean sea level), wgs84 (the ellipsoid) or flight_level (the surface of 1013.25 "
        "hPa, in metres of the standard atmosphere).",
        VerticalDatum.MSL,
        "what heights are above (default: msl)",
        choices=VerticalDatum,
        decides_conflicts=False,
    ),
    Setting(
        "regions",
        SettingType.CHOICE,
        "Whether detections store the region of each conflict: on, or off (quicker and smaller; queries by place then "
        "compare swept hulls).",
        Regions.ON,
        "off: store no regions of conflicts, which is quicker and smaller (default: on)",
        choices=Regions,
        label="Regions",
        says="{}",
        is_stored_by_detect=True,
        decides_conflicts=False,
    ),
)
NAMES: Final = tuple(setting.name for setting in SETTINGS)
METRES: Final = tuple(setting.name for setting in SETTINGS if setting.type is SettingType.METRES)
NUMBERS: Final = tuple(
    setting.name for setting in SETTINGS if setting.type in (SettingType.METRES, SettingType.SECONDS, SettingType.DAYS)
)
STORED_BY_DETECT: Final = tuple(setting for setting in SETTINGS if setting.is_stored_by_detect)


class Changes(TypedDict, total=False):
    """Settings that a detection stores first, for type checkers; None leaves one as it is."""

    method: Method | str | None
    tolerance_m: float | None
    separation_m: float | None
    nearest_m: float | None
    vertical_separation_m: float | None
    time_separation_s: float | None
    delays_within_s: float | None
    horizon_days: float | None
    regions: Regions | str | None


def given(values: Any, settings: tuple[Setting, ...] = SETTINGS) -> dict[str, Any]:
    """Return the settings that an object, such as a namespace of argparse, has as attributes and that are not None."""
    named = {setting.name: getattr(values, setting.name) for setting in settings}
    return {name: value for name, value in named.items() if value is not None}


def checked(who: str, setting: Setting, value: Any, name: str = "") -> StrEnum | float:
    """Return a choice, distance or time by the rule of its setting; raises InvalidInput, naming it or `name`."""
    name = name or setting.name
    if setting.choices is not None:
        try:
            return setting.choices(value)
        except ValueError:
            removed = REMOVED.get(value) if setting.choices is Method and isinstance(value, str) else None
            rule = f"must be one of {', '.join(setting.choices)}; got {value!r}"
            raise InvalidInput(who, name, f"{rule}, which {removed}" if removed else rule) from None
    unit = _UNITS[setting.type]
    is_number = isinstance(value, Real) and not isinstance(value, bool)  # also of numpy
    if not is_number or not 0.0 <= value < float("inf"):
        raise InvalidInput(who, name, f"must be a finite number of {unit}, 0 or more; got {value!r}")
    if setting.type is SettingType.SECONDS:
        if value > MOST_S:
            raise InvalidInput(who, name, f"must be at most {MOST_S:.0f} seconds, 30 days; got {value!r}")
        if abs(1e6 * value - round(1e6 * value)) > _ROUNDING_US:
            raise InvalidInput(who, name, f"must be whole microseconds; got {value!r}")
        return round(1e6 * value) / 1e6
    if setting.type is SettingType.DAYS:
        if value > MOST_DAYS:
            raise InvalidInput(who, name, f"must be at most {MOST_DAYS:.0f} days, a century; got {value!r}")
        return float(value)
    if value > MOST_M:
        rule = f"must be at most {MOST_M:.0f} metres, half the way around the earth"
        raise InvalidInput(who, name, f"{rule}; got {value!r} (is it in metres?)")
    return float(value)
