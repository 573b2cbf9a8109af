"""The columns of a plan, an area or a track as it is written: one table, which every form and every path reads.

The tables `area` and `track` and the routines that list their columns, COPY, Arrow, GeoParquet, scene files, data
frames, requests, attached tables, branches, digests and the reference loop over it. To add a column:

- add a row here, at the end
- a revision: the column of the tables, and an attribute of the type `attached_plan`
- run `./run python docs/plan_sql.py`: it rewrites the lists in sql/
- act on it: where objects are cut (core/pieces), or in the rule of a pair, which reads pieces, not plans;
  CONTRIBUTING.md lists the files of a column of pieces
- model/plans.py: a field of `Area` or `Track`, for type checkers (without it the class has the field too)
- tests/support/full_plans.py: a value, which all borders then carry; docs/reference/arrow.md: a row; CHANGELOG.md
- a public routine of a release that it changes (put_area, put_track) is listed in sql/06_retired.sql

A column of a plain form (TEXT, WORD, NUMBER, DOCUMENT) needs no more: batches of objects have it, see
`arrays.column_numbers`. One of the form OWN needs a codec of its own in arrays/arrow/object_rows.py,
formats/file_objects.py, store/stored_objects.py and docs/plan_sql.py, and a digest in core/pieces/digests.py; so does a
DOCUMENT that changes answers.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, Final, NamedTuple

import numpy as np

from conflictdb.model import tolerances
from conflictdb.model.rules import KINDS, class_rule, word_rule

AREA, TRACK = KINDS

Check = Callable[[Any], str | None]


class Form(Enum):
    """How a value is written. Each way in and out has one codec for each form but OWN."""

    TEXT = auto()  # any text
    WORD = auto()  # a text of 1 to 200 bytes
    NUMBER = auto()  # a finite double
    DOCUMENT = auto()  # JSON
    OWN = auto()  # shapes, times, heights of legs, havens, activations, properties


def _text_rule(value: Any) -> str | None:
    return None if isinstance(value, str) else f"must be a text, or absent; got {value!r:.60}"


def _number_rule(value: Any) -> str | None:
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return None if is_number and np.isfinite(value) else f"must be a finite number, or absent; got {value!r:.60}"


def _document_rule(value: Any) -> str | None:
    try:
        json.dumps(value, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        return f"must be JSON: {error}"
    return None


def in_its_plan(_: Any) -> str | None:
    """Accept a value whose rule needs the rest of its plan; `Area` and `Track` check it."""
    return None


_CHECKS: Final[dict[Form, Check]] = {
    Form.TEXT: _text_rule,
    Form.WORD: word_rule,
    Form.NUMBER: _number_rule,
    Form.DOCUMENT: _document_rule,
    Form.OWN: in_its_plan,
}


@dataclass(frozen=True, slots=True)
class PlanColumn:
    """A column of a plan.

    name : of the tables `area` and `track`
    kinds : AREA, TRACK or both
    sql : type in the database
    doc : one sentence, for the catalog and reference pages
    python : its fields of `Area` and `Track`; empty: the name
    arrow : its columns in Arrow; empty: the members
    members : of scene files and data frames; empty: the name
    changes_answers : whether conflicts depend on it: it belongs to digests, and changing it makes a new version
    check : returns the rule that a value other than None breaks, as a sentence; None: valid. Empty: that of the form
    sqlstate : of an error in it
    absent : the value of a plan that does not give it
    default : of the parameter of put_area and put_track; empty: the parameter is required
    is_expansion : whether detections compute it from a schedule, if there is one; then it is not as written
    in_pieces : whether the rule of a pair reads it: pieces have its number (`arrays.column_numbers`)
    """

    name: str
    kinds: frozenset[str]
    form: Form
    sql: str
    doc: str
    unit: str | None = None
    python: tuple[str, ...] = ()
    arrow: tuple[str, ...] = ()
    members: tuple[str, ...] = ()
    changes_answers: bool = True
    check: Check | None = None
    sqlstate: str = "ZC008"
    absent: Any = None
    default: str = "NULL"
    is_expansion: bool = False
    in_pieces: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "python", self.python or (self.name,))
        object.__setattr__(self, "members", self.members or (self.name,))
        object.__setattr__(self, "arrow", self.arrow or self.members)
        object.__setattr__(self, "check", self.check or _CHECKS[self.form])

    @property
    def field(self) -> str:
        """Its only field of `Area` and `Track`, or the first."""
        return self.python[0]

    @property
    def is_member(self) -> bool:
        """Whether it is one member of a plain form in scene files."""
        return self.form is not Form.OWN and len(self.members) == 1

    def broken(self, value: Any) -> str | None:
        """Return the rule that a value other than None breaks, as a sentence; None: valid."""
        check = self.check
        assert check is not None  # noqa: S101
        return check(value)

    def rules(self, values: Sequence[Any]) -> dict[int, str]:
        """Return the rules that values break, as sentences, by their places among the values."""
        found = ((i, self.broken(value)) for i, value in enumerate(values) if value is not None)
        return {i: rule for i, rule in found if rule is not None}


_AREA: Final = frozenset({AREA})
_TRACK: Final = frozenset({TRACK})
_BOTH: Final = frozenset(KINDS)
_SIDES: Final = tuple(f"{side}_{unit}" for side in ("fore", "aft", "port", "starboard") for unit in ("m", "nmi"))
_DOUBLE: Final = "double precision"

# In the order of the parameters of put_area and put_track, and of all lists in sql/.
PLAN_COLUMNS: Final = (
    PlanColumn(
        "footprint", _AREA, Form.OWN, "geometry", "Polygons of longitude and latitude.", "deg",
        arrow=("geometry",), members=("geometry",), sqlstate="ZC001", default="",
    ),
    PlanColumn(
        "active_span", _AREA, Form.OWN, "tstzrange", "Active during [start, end); a missing bound is unbounded.",
        python=("start_us", "end_us"), members=("start", "end"), sqlstate="ZC003",
    ),
    PlanColumn(
        "path", _TRACK, Form.OWN, "geometry", "Waypoints, longitude and latitude, and when the track is there.", "deg",
        python=("positions_deg", "times_us"), arrow=("geometry", "times"),
        members=("geometry", "times", "datetimes", "start", "speed_kn", "speed_mps"), sqlstate="ZC001", default="",
    ),
    PlanColumn(
        "outline", _TRACK, Form.OWN, "geometry", "The haven: a convex ring of [starboard, forward].", "m",
        python=("outline_m",), arrow=("outline_m",), members=("outline_m", *_SIDES), sqlstate="ZC006", default="",
    ),
    PlanColumn(
        "floor_m", _BOTH, Form.NUMBER, _DOUBLE, "Lowest height above the vertical datum; null: no limit.", "m",
        check=in_its_plan, sqlstate="ZC004",
    ),
    PlanColumn(
        "ceiling_m", _BOTH, Form.NUMBER, _DOUBLE, "Height that it stays below; null: no limit.", "m",
        check=in_its_plan, sqlstate="ZC004",
    ),
    PlanColumn("name", _BOTH, Form.TEXT, "text", "Display name; null: none.", changes_answers=False),
    PlanColumn(
        "properties", _BOTH, Form.OWN, "jsonb", "Additional data of its source, a JSON object.",
        changes_answers=False, sqlstate="ZC012", default="'{}'",
    ),
    PlanColumn(
        "grow_mps", _TRACK, Form.NUMBER, _DOUBLE, "Speed at which every side of the haven moves outward.", "m/s",
        check=in_its_plan, sqlstate="ZC006", absent=0.0, default="0",
    ),
    PlanColumn(
        "outlines", _TRACK, Form.OWN, "geometry", "The haven at every waypoint, instead.", "m",
        python=("outlines_m",), members=("outlines_m",), sqlstate="ZC006",
    ),
    PlanColumn(
        "floors_m", _TRACK, Form.OWN, "double precision[]", "Lowest heights, one per leg or waypoint.", "m",
        arrow=("floors_m",), members=("floor_m",), sqlstate="ZC004",
    ),
    PlanColumn(
        "ceilings_m", _TRACK, Form.OWN, "double precision[]", "Heights that it stays below, one per leg or waypoint.",
        "m", arrow=("ceilings_m",), members=("ceiling_m",), sqlstate="ZC004",
    ),
    PlanColumn(
        "class", _BOTH, Form.WORD, "text", "Class that separation rules name; null: none.",
        python=("object_class",), check=class_rule, in_pieces=True,
    ),
    PlanColumn(
        "owner", _BOTH, Form.WORD, "text", "Owner, whose objects are not compared with each other; null: none.",
        in_pieces=True,
    ),
    PlanColumn(
        "tolerances", _TRACK, Form.DOCUMENT, "jsonb", "How far voyages may differ from the plan; null: not at all.",
        arrow=("tolerances",), members=tolerances.MEMBERS, check=in_its_plan, sqlstate="ZC007",
    ),
    PlanColumn(
        "activations", _AREA, Form.OWN, "tstzmultirange", "Several spans; of a schedule: its expansion.",
        python=("spans_us",), members=("spans",), sqlstate="ZC003", is_expansion=True,
    ),
    PlanColumn(
        "departures", _TRACK, Form.OWN, "timestamptz[]", "Departures of several voyages; of a schedule: its expansion.",
        python=("departures_us",), sqlstate="ZC003", members=("departures",), is_expansion=True,
    ),
    PlanColumn(
        "schedule", _BOTH, Form.DOCUMENT, "jsonb", "When it is active, or departs; null: once, or as listed.",
        check=in_its_plan, sqlstate="ZC012",
    ),
)  # fmt: skip


class HeightLimit(NamedTuple):
    """The columns of a floor or a ceiling: of a whole plan, and of the legs of a track; the height of no limit."""

    whole: str
    of_legs: str
    unbounded: float


HEIGHT_LIMITS: Final = (HeightLimit("floor_m", "floors_m", -np.inf), HeightLimit("ceiling_m", "ceilings_m", np.inf))


def columns_of(kind: str, *forms: Form) -> Iterator[PlanColumn]:
    """Yield the columns of areas or tracks, in order: of some forms, or all."""
    return (one for one in PLAN_COLUMNS if kind in one.kinds and (not forms or one.form in forms))


def checked_columns(kind: str) -> tuple[PlanColumn, ...]:
    """Return the columns of areas or tracks whose rule needs no other column."""
    return tuple(one for one in columns_of(kind) if one.check is not in_its_plan)


def bytes_columns(kind: str) -> Iterator[PlanColumn]:
    """Yield the columns of areas or tracks that clients get as bytes: shapes, and lists of times or heights."""
    return (one for one in columns_of(kind, Form.OWN) if one.sql not in ("tstzrange", "jsonb"))
