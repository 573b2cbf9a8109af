"""The JSON Schema of scene files and of plans in requests, from the tables of columns, settings and rules.

The schema is narrower than the reader: it has no other programs' files, temporal geometries or reference systems.
"""

from typing import Any, Final

from conflictdb.formats.fields import MAX_KEY_BYTES
from conflictdb.formats.file_objects import SIDES, SIZES, SPEED, TIMES, TOLERANCES
from conflictdb.formats.geometry import CIRCLE_TYPE, CUT_TRACK_TYPE, TRACK_TYPE
from conflictdb.model import tolerances
from conflictdb.model.plan_columns import AREA, HEIGHT_LIMITS, TRACK, Form, PlanColumn, columns_of
from conflictdb.model.rules import MAX_RULES, MAX_WORD_BYTES, REPLACED, Rule
from conflictdb.model.settings import MOST_DAYS, MOST_M, MOST_S, SETTINGS, Setting, SettingType

# Identifies the form, in requests by their member `version`.
VERSION: Final = 1
ID: Final = f"urn:conflictdb:plans:{VERSION}"
DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"

Schema = dict[str, Any]

_NUMBER: Final[Schema] = {"type": "number"}
_INSTANT: Final[Schema] = {
    "type": "string",
    "format": "date-time",
    "pattern": "^[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}([.][0-9]+)?(Z|[+-][0-9]{2}:[0-9]{2})$",
}
_PAIR: Final[Schema] = {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 2}
_RING: Final[Schema] = {"type": "array", "items": _PAIR, "minItems": 1}
_NUMBER_OR_NULL: Final[Schema] = {"type": ["number", "null"]}
_POSITION: Final[Schema] = {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 3}
_POSITIONS: Final[Schema] = {"type": "array", "items": {"$ref": "#/$defs/position"}, "minItems": 2}
_RINGS: Final[Schema] = {
    "type": "array",
    "items": {"type": "array", "items": {"$ref": "#/$defs/position"}, "minItems": 4},
    "minItems": 1,
}


def _listed(of: Schema) -> Schema:
    return {"type": "array", "items": of}


def _each(of: Schema) -> Schema:
    """Return the schema of one value, or of a list of one for each leg or waypoint."""
    return {"anyOf": [of, _listed(of)]}


_WINDOW: Final[Schema] = {"type": "array", "items": _INSTANT, "minItems": 2, "maxItems": 2}
# Schema of members of each plain form; a word of a file may be a number.
_OF_FORM: Final[dict[Form, Schema]] = {
    Form.TEXT: {"type": "string"},
    Form.WORD: {"type": ["string", "number"], "maxLength": MAX_WORD_BYTES},
    Form.NUMBER: _NUMBER,
    Form.DOCUMENT: {},
}
# Schema of other members: of columns of the form OWN, and of documents with several members.
_OF_MEMBER: Final[dict[str, Schema]] = {
    "start": _INSTANT,
    "end": _INSTANT,
    "spans": _listed({**_WINDOW, "items": {**_INSTANT, "type": ["string", "null"]}}),
    "times": _listed(_INSTANT),
    "datetimes": _listed(_INSTANT),
    "speed_kn": _each({**_NUMBER, "exclusiveMinimum": 0}),
    "speed_mps": _each({**_NUMBER, "exclusiveMinimum": 0}),
    **{name: {**_NUMBER, "minimum": 0} for name in SIZES},
    "outline_m": _RING,
    "outlines_m": {"type": "array", "items": _RING, "minItems": 1},
    **{one.whole: _each(_NUMBER_OR_NULL) for one in HEIGHT_LIMITS},
    "departures": _listed(_INSTANT),
    "schedule": {"type": ["object", "array"], "minItems": 1},
    **{name: _each({**_NUMBER, "minimum": 0}) for name in (*tolerances.PER_LEG, "turn_radius_m")},
    **dict.fromkeys(tolerances.WINDOWS, _WINDOW),
}
# Members of a feature, not of its properties.
_OF_FEATURE: Final = ("geometry", "properties")


def plans_schema() -> Schema:
    """Return the JSON Schema (draft 2020-12) of scene files, and of plans in requests: those have no `scene`.

    Each document that `write_scene_file` and `scene_text` write is valid. A valid document may break a rule about
    values, such as that a haven is convex.
    """
    return {
        "$schema": DIALECT,
        "$id": ID,
        "title": "Scene file of conflictdb",
        "description": "Areas and tracks as a GeoJSON FeatureCollection; plans in requests have no member scene.",
        "type": "object",
        "required": ["type", "features"],
        "properties": {
            "type": {"const": "FeatureCollection"},
            "version": {"const": VERSION, "description": "Of this form; absent: 1."},
            "scene": {"$ref": "#/$defs/scene"},
            "foreign": {
                **_listed({"type": "string"}),
                "description": "Names of members of properties that mean nothing here, however alike.",
            },
            "features": _listed({"$ref": "#/$defs/plan"}),
        },
        "additionalProperties": False,
        "$defs": {
            "position": {**_POSITION, "description": "Longitude and latitude, deg; an altitude is left aside."},
            "scene": _scene(),
            "plan": _plan(),
            AREA: _area(),
            TRACK: _track(),
        },
    }


def _plan() -> Schema:
    is_line = {"properties": {"geometry": {"properties": {"type": {"enum": [TRACK_TYPE, CUT_TRACK_TYPE]}}}}}
    return {
        "type": "object",
        "required": ["type", "id", "geometry", "properties"],
        "properties": {
            "type": {"const": "Feature"},
            "id": {
                "type": ["string", "number"],
                "minLength": 1,
                "maxLength": MAX_KEY_BYTES,
                "description": "Key, unique in the scene.",
            },
            "geometry": {"type": "object", "required": ["type", "coordinates"]},
            "properties": {"type": ["object", "null"]},
        },
        "additionalProperties": False,
        "if": is_line,
        "then": {"$ref": f"#/$defs/{TRACK}"},
        "else": {"$ref": f"#/$defs/{AREA}"},
    }


def _geometry(forms: dict[str, Schema]) -> Schema:
    return {
        "oneOf": [
            {
                "type": "object",
                "properties": {"type": {"const": name}, "coordinates": coordinates},
                "required": ["type", "coordinates"],
                "additionalProperties": False,
            }
            for name, coordinates in forms.items()
        ]
    }


def _area() -> Schema:
    forms = {"Polygon": _RINGS, "MultiPolygon": {"type": "array", "items": _RINGS, "minItems": 1}}
    circle = {CIRCLE_TYPE: {"$ref": "#/$defs/position"}}
    radius = {"radius_m": {"type": "number", "exclusiveMinimum": 0, "description": "Radius of a circle, m."}}
    return {
        "description": "An area: a polygon, or a circle.",
        "properties": {"properties": _members(AREA) | {"allOf": [_not_both("spans", "schedule")]}},
        "anyOf": [
            {"properties": {"geometry": _geometry(forms)}},
            {
                "properties": {
                    "geometry": _geometry(circle),
                    "properties": {"type": "object", "properties": radius, "required": ["radius_m"]},
                }
            },
        ],
    }


def _track() -> Schema:
    lines = {TRACK_TYPE: _POSITIONS, CUT_TRACK_TYPE: {"type": "array", "items": _POSITIONS, "minItems": 1}}
    by_speed = {"allOf": [_given("start"), {"oneOf": [_given("speed_kn"), _given("speed_mps")]}, *map(_absent, TIMES)]}
    others = {name: [one for one in (*TIMES, *SPEED) if one != name] for name in TIMES}
    by_times = [{"allOf": [_given(name), *map(_absent, others[name])]} for name in TIMES]
    side = {"allOf": [{"oneOf": [_given(f"{one}_m"), _given(f"{one}_nmi")]} for one in SIDES]}
    haven = [
        {"allOf": [side, _absent("outline_m"), _absent("outlines_m")]},
        {"allOf": [_given("outline_m"), _absent("outlines_m"), *map(_absent, SIZES)]},
        {"allOf": [_given("outlines_m"), *map(_absent, ("outline_m", "grow_mps", *SIZES))]},
    ]
    rules = [
        {"oneOf": [*by_times, by_speed], "description": "Times, or start and a speed over the ground."},
        {"oneOf": haven, "description": "Four sides, an outline, or one outline per waypoint."},
        _not_both("departures", "schedule"),
        *(
            _not_both(one, other)
            for one in TOLERANCES
            for other in ("grow_mps", "outlines_m", "departures", "schedule")
        ),
    ]
    return {
        "description": "A track: a line of waypoints.",
        "properties": {"geometry": _geometry(lines), "properties": _members(TRACK) | {"allOf": rules}},
    }


def _members(kind: str) -> Schema:
    """Return the schema of the properties of a kind; other members are kept as they are."""
    found: dict[str, Schema] = {"kind": {"enum": [kind, None]}}
    for column in columns_of(kind):
        for name in column.members:
            if name not in _OF_FEATURE:
                found[name] = _member(name, column)
    return {"type": ["object", "null"] if kind == AREA else "object", "properties": found}


def _member(name: str, column: PlanColumn) -> Schema:
    is_own = column.form is Form.OWN or len(column.members) > 1 or name == "schedule"
    schema = _OF_MEMBER[name] if is_own else _OF_FORM[column.form]
    unit = f" Unit: {column.unit}." if column.unit and name.endswith(f"_{column.unit}") else ""
    return _or_null(schema) | {"description": column.doc + unit}


def _or_null(schema: Schema) -> Schema:
    """Return the schema of a value, or null: as if absent."""
    if not schema:
        return {}
    if "anyOf" in schema:
        return {"anyOf": [*schema["anyOf"], {"type": "null"}]}
    given = schema["type"]
    return {**schema, "type": [*([given] if isinstance(given, str) else given), "null"]}


def _given(name: str) -> Schema:
    return {"required": [name], "properties": {name: {"not": {"type": "null"}}}}


def _absent(name: str) -> Schema:
    return {"properties": {name: {"type": "null"}}}


def _not_both(one: str, other: str) -> Schema:
    return {"anyOf": [_absent(one), _absent(other)]}


def _scene() -> Schema:
    name = {"type": ["string", "null"], "minLength": 1, "maxLength": MAX_KEY_BYTES, "description": "Name of the scene."}
    return {
        "type": "object",
        "description": "Settings of a scene; null and absent: the default.",
        "properties": {
            "name": name,
            **{one.name: _setting(one) for one in SETTINGS},
            "rules": {"type": ["array", "null"], "items": _rule(), "maxItems": MAX_RULES},
        },
        "additionalProperties": False,
    }


def _setting(setting: Setting) -> Schema:
    if setting.choices is not None:
        return {"enum": [*map(str, setting.choices), None], "description": setting.meaning}
    if setting.type is SettingType.PLACE:
        return {"type": ["array", "null"], "items": _NUMBER, "minItems": 2, "maxItems": 2} | {
            "description": setting.meaning
        }
    most = {SettingType.METRES: MOST_M, SettingType.SECONDS: MOST_S, SettingType.DAYS: MOST_DAYS}[setting.type]
    return {"type": ["number", "null"], "minimum": 0, "maximum": most, "description": setting.meaning}


def _rule() -> Schema:
    replaced = {one.name: _setting(one) for one in SETTINGS}
    members: dict[str, Schema] = {name: replaced[setting] for name, setting in REPLACED.items()}
    word: Schema = {"type": ["string", "null"], "minLength": 1, "maxLength": MAX_WORD_BYTES}
    members |= {"a_class": word, "b_class": word}
    members |= {"allowed": {"type": "boolean"}, "yields": {"enum": ["a", "b", None]}}
    return {
        "type": "object",
        "properties": {name: members[name] for name in Rule.__dataclass_fields__},
        "additionalProperties": False,
        "anyOf": [_given("a_class"), _given("b_class")],
    }
