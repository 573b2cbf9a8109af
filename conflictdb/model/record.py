"""The columns of a conflict: one table, which every output reads.

The views `conflicts` and `approaches`, CSV, JSON, GeoJSON, data frames, Arrow and GeoParquet have these columns, by
these names. To add a column, change these files:

- model/record.py: a row of the table here
- model/results.py: a field of `Conflict`
- where it is computed, and arrays/answers.py: a field of `Conflicts`
- a revision: a column of the table
- sql/70_conflicts.sql: a column of the view, with its comment, and of the rows that Python reads
- sql/60_write_back.sql: the rows that are written (MEASURED is in the order of its parameters)
- sql/79_requests.sql: the replies to probes

docs/generate.py writes the models and the reference pages.
"""

from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Final


class ColumnType(Enum):
    """Type of a column; what a cell looks like follows from it in each output."""

    TEXT = auto()  # text of a user: keys, names, reasons
    NAME = auto()  # a word of ours, such as a verdict
    INSTANT = auto()  # to the microsecond, UTC
    PERIODS = auto()  # (start, end) inclusive, in order; unbounded is None
    NUMBER = auto()  # binary64
    WHOLE = auto()  # 64 bits
    TRUTH = auto()
    POINT = auto()  # longitude and latitude
    REGION = auto()  # a geometry
    JSON = auto()  # an object


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a conflict.

    meaning : one sentence, for reference pages
    unit : s, m or deg; empty: none
    required : whether every conflict has a value, also without a database
    field : the attribute of a `Conflict`; empty: the name
    array : the field of the arrays `Conflicts` that it is computed from: its type says how, and unknown is NaN, for an
        instant MINUS_INFINITY_US, for a name, of which arrays have codes, -1; empty: it follows from other columns,
        from the scene, or a database alone knows it
    remark : format of a value in reports, which show it beside the verdict; tables have the column if a row has a value
    """

    name: str
    type: ColumnType
    meaning: str
    unit: str = ""
    required: bool = False
    field: str = ""
    array: str = ""
    remark: str = ""

    def __post_init__(self) -> None:
        if not self.field:
            object.__setattr__(self, "field", self.name)


COLUMNS: Final = (
    Column("scene", ColumnType.TEXT, "Name of the scene.", required=True),
    Column("a_key", ColumnType.TEXT, "Key of the first object.", required=True),
    Column("a_kind", ColumnType.NAME, "area or track.", required=True),
    Column("b_key", ColumnType.TEXT, "Key of the second object.", required=True),
    Column("b_kind", ColumnType.NAME, "area or track.", required=True),
    Column(
        "periods",
        ColumnType.PERIODS,
        "When they conflict: bounds inclusive, rounded outward to the microsecond; a missing bound is unbounded.",
        required=True,
    ),
    Column("first_contact", ColumnType.INSTANT, "Start of the first period; null if unbounded."),
    Column("last_contact", ColumnType.INSTANT, "End of the last period; null if unbounded."),
    Column(
        "verdict",
        ColumnType.NAME,
        "conflict: they meet; grazing: within the tolerance of the limit; unresolved: neither proven apart "
        "nor decided, periods then say when they might meet.",
        required=True,
    ),
    Column(
        "region",
        ColumnType.REGION,
        "Region of the conflict, longitude and latitude in degrees, split at the antimeridian.",
        "deg",
    ),
    Column(
        "first_contact_point",
        ColumnType.POINT,
        "First contact, longitude and latitude in degrees; null if not computed.",
        "deg",
        field="first_contact_deg",
        array="first_contact_deg",
    ),
    Column("method", ColumnType.NAME, "Method of the detection that found it.", required=True),
    Column(
        "time_error_s",
        ColumnType.NUMBER,
        "Error bound of every period's start and end, seconds.",
        "s",
        required=True,
        array="time_error_s",
    ),
    Column(
        "is_current",
        ColumnType.TRUTH,
        "Whether neither object nor the scene's settings changed since; scene_is_current says whether pairs may be "
        "missing.",
    ),
    Column("run_id", ColumnType.WHOLE, "Run that found it; later runs confirmed it unchanged."),
    Column("found_at", ColumnType.INSTANT, "When the pair was first found in conflict."),
    Column(
        "closest_at",
        ColumnType.INSTANT,
        "Closest approach: its time, the first if several; null if not computed, or for areas that are always active.",
        array="closest_us",
    ),
    Column(
        "closest_m",
        ColumnType.NUMBER,
        "Closest approach: least distance of the polygons, metres on the earth, 0 if they touch; null if not computed.",
        "m",
        array="closest_m",
    ),
    Column(
        "closest_error_m",
        ColumnType.NUMBER,
        "Closest approach: error bound of closest_m, metres; null if not computed.",
        "m",
        array="closest_error_m",
    ),
    Column(
        "closest_a_point",
        ColumnType.POINT,
        "Closest approach: nearest point of the first object, longitude and latitude in degrees; null if not computed.",
        "deg",
        field="closest_a_deg",
        array="closest_a_deg",
    ),
    Column(
        "closest_b_point",
        ColumnType.POINT,
        "Closest approach: nearest point of the second object, longitude and latitude in degrees; null "
        "if not computed.",
        "deg",
        field="closest_b_deg",
        array="closest_b_deg",
    ),
    Column(
        "scene_is_current",
        ColumnType.TRUTH,
        "Whether the conflicts of the scene are complete: nothing waits for detection (see the view scenes).",
    ),
    Column(
        "conflict_id", ColumnType.WHOLE, "Id of the conflict, the same from opening to closing (see conflict_events)."
    ),
    Column("opened_at", ColumnType.INSTANT, "When it opened; equal to found_at."),
    Column(
        "changed_at",
        ColumnType.INSTANT,
        "When its verdict or a key last changed, or its periods by more than their error; null if they never did.",
    ),
    Column(
        "acknowledged_by",
        ColumnType.TEXT,
        "User whose acknowledgement holds; null if there is none, or if it has ended, expired or been outgrown.",
    ),
    Column("acknowledged_at", ColumnType.INSTANT, "When it was acknowledged; null if acknowledged_by is null."),
    Column("acknowledged_for", ColumnType.TEXT, "Reason given; null if acknowledged_by is null."),
    Column(
        "acknowledged_until",
        ColumnType.INSTANT,
        "Expiry of the acknowledgement; null: valid while the conflict lasts, or acknowledged_by is null.",
    ),
    Column(
        "first_contact_lon_deg", ColumnType.NUMBER, "First contact: longitude, degrees; null if not computed.", "deg"
    ),
    Column(
        "first_contact_lat_deg", ColumnType.NUMBER, "First contact: latitude, degrees; null if not computed.", "deg"
    ),
    Column("a_name", ColumnType.TEXT, "Name of the first object; null if it has none, or it is not known."),
    Column("b_name", ColumnType.TEXT, "Name of the second object; null if it has none, or it is not known."),
    Column(
        "lacking_s",
        ColumnType.NUMBER,
        "Separation in time: seconds by which it is missed, within time_error_s; null if none is required, or if the "
        "verdict is unresolved.",
        "s",
        array="lacking_s",
        remark="{:.6g} s lacking",
    ),
    Column(
        "certainty",
        ColumnType.NAME,
        "must: all voyages within the tolerances of both objects conflict; may: it is not proven that all do; null if "
        "neither has tolerances, or if the verdict is unresolved.",
        array="certainty",
        remark="{} happen",
    ),
)
# Rows of attached tables: columns of the view `conflicts` only, for joins in SQL.
ATTACHED: Final = tuple(
    Column(f"{side}_{name}", kind, meaning)
    for side, which in (("a", "first"), ("b", "second"))
    for name, kind, meaning in (
        (
            "table",
            ColumnType.TEXT,
            f"Attached table that the {which} object comes from, as SCHEMA.TABLE; null if it comes from none.",
        ),
        (
            "row",
            ColumnType.JSON,
            f'Values of the columns of its key there, by name, such as {{"nr": 7}}; null if {side}_table is null.',
        ),
    )
)
# The objects, and their states, that it was found of: columns of Arrow and GeoParquet only.
STATES: Final = tuple(
    Column(f"{side}_{name}", ColumnType.WHOLE, meaning, array=f"{side}_{name}")
    for side, which in (("a", "first"), ("b", "second"))
    for name, meaning in (
        ("id", f"Number of the {which} object; null where it is not known."),
        ("version", f"Version of the {which} object that the conflict was found of; null where it is not known."),
    )
)


# Computed from arrays: neither kinds, verdict and periods, which are arrays of their own, nor what follows from others.
MEASURED: Final = tuple(column for column in COLUMNS if column.array)
REMARKS: Final = tuple(column for column in COLUMNS if column.remark)
_BY_NAME: Final = {column.name: column for column in COLUMNS} | {
    column.name.removeprefix("closest_"): replace(column, name=column.name.removeprefix("closest_"))
    for column in COLUMNS
    if column.name in ("closest_a_point", "closest_b_point")
}
# An approach has these, in the order of its view: no periods, and what follows from periods.
APPROACH_COLUMNS: Final = tuple(
    _BY_NAME[name]
    for name in (
        *("scene", "a_key", "a_kind", "b_key", "b_kind", "closest_at", "closest_m", "closest_error_m", "a_point"),
        *("b_point", "verdict", "is_current", "run_id", "found_at", "scene_is_current", "method", "time_error_s"),
        *("a_name", "b_name"),
    )
)
