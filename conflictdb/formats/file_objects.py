"""Convert the members of objects in files, of any format, to areas and tracks, and back.

Includes the reading of havens and speeds that other formats share.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Self

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.formats.discs import Corners, disc
from conflictdb.formats.fields import Fields, finite, instant, instants
from conflictdb.formats.geometry import (
    AREA_TYPES,
    CIRCLE_TYPE,
    TRACK_TYPE,
    joined,
    line,
    lines,
    multipolygon,
    of_joined,
    pairs,
    point,
)
from conflictdb.formats.hints import given_haven, vertical_datum
from conflictdb.formats.instants import format_instant
from conflictdb.formats.json_text import check_storable
from conflictdb.formats.names import RENAME_MEMBER, SETTING_RULE, SETTINGS, misnamed
from conflictdb.formats.reference import Systems, ToDegrees
from conflictdb.formats.rings import LongSides
from conflictdb.formats.standards import Standard
from conflictdb.formats.track_times import TrackAtSpeed
from conflictdb.model import tolerances
from conflictdb.model.activations import check_schedule
from conflictdb.model.inputs import all_certain, certain
from conflictdb.model.plan_columns import AREA, HEIGHT_LIMITS, PLAN_COLUMNS, TRACK, Form, HeightLimit, columns_of
from conflictdb.model.plans import (
    METRES_PER_NMI,
    Area,
    Scene,
    Track,
    VerticalDatum,
    datum_rule,
    has_heights,
    rectangle_outline_m,
)
from conflictdb.model.speed_limits import MPS_PER_KNOT

SIDES: Final = ("fore", "aft", "port", "starboard")
# How to give tracks a size that their source does not say.
HAVEN_OPTION: Final = "--haven, in Python `haven`, gives a size to all without"
# The members of a rectangular haven.
SIZES: Final = tuple(f"{side}_{unit}" for side in SIDES for unit in ("m", "nmi"))
TIMES: Final = ("times", "datetimes")
SPEED: Final = ("start", "speed_kn", "speed_mps")
# Members that are words, such as class and owner.
WORDS: Final = tuple(dict.fromkeys(one.members[0] for one in PLAN_COLUMNS if one.form is Form.WORD))
# Members with a value for each position, or each leg.
_OF_POSITIONS: Final = frozenset(
    {*TIMES, "speed_kn", "speed_mps", "floor_m", "ceiling_m", "outlines_m", *tolerances.PER_LEG}
)
# The vertical datum of an object; another one than the scene's is refused.
DATUM: Final = "vertical_datum"
TOLERANCES: Final = tolerances.MEMBERS
# No members of properties.
_ELSEWHERE: Final = frozenset({"geometry", "properties"})
# Members that the readers of heights of legs and of schedules read.
_READ_ELSEWHERE: Final = {AREA: ("schedule",), TRACK: ("schedule", "floor_m", "ceiling_m")}


def _members(kind: str) -> frozenset[str]:
    return frozenset({"kind"} | {name for one in columns_of(kind) for name in one.members} - _ELSEWHERE)


def _guarded(kind: str) -> tuple[str, ...]:
    """Return the members whose loss would change conflicts, but owner."""
    names = {name for one in columns_of(kind) if one.changes_answers for name in one.members}
    return tuple(sorted((names | {DATUM}) - _ELSEWHERE - {"owner"}))


# Plain columns of areas but heights and schedules, which other forms have in their way.
_ASIDE: Final = tuple(
    one for one in columns_of(AREA) if one.is_member and one.name not in ("floor_m", "ceiling_m", "schedule")
)
# Names that the reader uses; a property with such a name, set by SQL, would not be read back as a property.
AREA_MEMBERS: Final = _members(AREA)
TRACK_MEMBERS: Final = _members(TRACK)
SCENE: Final = Standard(
    "scene file, and columns of GeoParquet and of what OGR opens",
    read={
        "start end spans schedule": "when an area is active",
        "times datetimes departures": "times of a track",
        "radius_m": "circles",
        "floor_m ceiling_m": "heights, also of legs",
        DATUM: "refused if it is not that of the scene",
        " ".join(SIZES): "havens",
        "outline_m outlines_m grow_mps": "havens that change",
        "speed_kn speed_mps": "speeds of legs",
        " ".join(TOLERANCES): "tolerances",
    },
    unread={
        "valid_from": "properties that look like times, of areas without start or end",
        "lowerLimit": "properties that look like heights, of objects without floor and ceiling",
        "length": "properties that look like sizes, of tracks that are points",
    },
)
# Members whose loss would change conflicts, and where else they belong.
AREA_GUARDED: Final = _guarded(AREA)
TRACK_GUARDED: Final = _guarded(TRACK)
_SETTINGS: Final = dict.fromkeys(SETTINGS, SETTING_RULE)
AREA_ELSEWHERE: Final = _SETTINGS | dict.fromkeys(
    TRACK_MEMBERS - AREA_MEMBERS, "has a meaning for tracks only; an area stays as it is from start to end"
)
AREA_ELSEWHERE["radius_m"] = "has a meaning for a Point only, which it makes a circle"
TRACK_ELSEWHERE: Final = _SETTINGS | {
    "radius_m": "has a meaning for areas only: the haven of a track has four sides, or an outline",
    "spans": "has a meaning for areas only: a track that sails several times has departures",
    "end": "has a meaning for areas only: a track ends with its last waypoint; to stay, give that twice, with times",
}


@dataclass(frozen=True, slots=True)
class FileContext:
    """Context of a file for reading its objects.

    scene : its settings, or defaults
    foreign : names of members to ignore
    to_degrees : conversion of coordinates to longitude and latitude
    remedy : advice for a name that resembles a known one
    systems : reference systems that it names
    corners : count of all circles' corners
    datum : what its heights are above
    row_ids : begins the ids of objects without one; empty: they are refused
    long_sides : of areas whose sides are straight in longitude and latitude; None: they are lines of the scene
    """

    scene: Scene
    foreign: Collection[str] = ()
    to_degrees: ToDegrees = None
    remedy: str = RENAME_MEMBER
    systems: Systems = field(default_factory=dict)
    corners: Corners = field(default_factory=Corners)
    datum: Callable[[], VerticalDatum] = vertical_datum
    row_ids: str = ""
    long_sides: LongSides | None = None

    @classmethod
    def of_settings(cls, settings: Scene | None, stem: str, *rest: Any, **more: Any) -> Self:
        """Return the context of a file with settings, or without; other arguments are fields."""
        if settings is None:
            return cls(Scene(stem), *rest, **more)
        return replace(cls(settings, *rest, **more), datum=lambda: settings.vertical_datum)


def area(key: str, geometry: dict[str, Any], fields: Fields, setting: FileContext) -> Area:
    """Return the area of a feature; raises InvalidInput with all errors."""
    with fields.refusals:
        footprint = _footprint(geometry, fields, setting)
    members = area_members(fields, setting)
    fields.raise_found()
    return Area(key, footprint, **members)


def _footprint(geometry: dict[str, Any], fields: Fields, setting: FileContext) -> shapely.MultiPolygon:
    """Return the polygon of an area, or one that contains its circle."""
    if geometry["type"] in AREA_TYPES:
        return in_degrees(fields.who, multipolygon(fields.who, geometry), setting)
    if not fields.has("radius_m"):
        rule = f"must be a {' or '.join(AREA_TYPES)} (an area) or a LineString (a track); got '{CIRCLE_TYPE}'"
        raise fields.refusal("geometry", f"{rule}, which needs radius_m to be a circle; fixes are read from CSV")
    place = point(fields.who, geometry.get("coordinates"))
    if setting.to_degrees is not None:
        place = setting.to_degrees(place)
    radius_m = fields.number("radius_m")
    if radius_m is None:
        return shapely.MultiPolygon()
    return disc(fields.who, float(place[0, 0]), float(place[0, 1]), radius_m, setting.scene, setting.corners)


def in_degrees(who: str, footprint: shapely.MultiPolygon, setting: FileContext) -> shapely.MultiPolygon:
    """Return a footprint of a file in longitude and latitude, with vertices along sides that are straight in these."""
    if setting.to_degrees is not None:
        return shapely.transform(footprint, setting.to_degrees)
    return footprint if setting.long_sides is None else setting.long_sides.straight(who, footprint)


def area_members(fields: Fields, setting: FileContext) -> dict[str, Any]:
    """Return the members of an area besides key and footprint; errors are added to the fields' refusals."""
    members = {
        "start_us": certain(fields.instant("start")),
        "end_us": certain(fields.instant("end")),
        **_plain(fields, AREA, setting),
        **activations(fields),
        "properties": fields.rest(),
    }
    known = (*AREA_GUARDED, *(fields.known & {"radius_m"}))  # only for circles
    rest = setting.foreign, setting.remedy
    fields.refusals.extend(misnamed(fields.who, fields.values, known, AREA_ELSEWHERE, *rest))
    return members


def joined_track(
    who: str, geometry: Mapping[str, Any], properties: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the geometry and members of a track that is cut at the antimeridian, as one line; raises InvalidInput."""
    positions, counts = joined(who, lines(who, "geometry.coordinates", geometry.get("coordinates")))
    rest = {name: one for name, one in geometry.items() if name not in ("type", "coordinates")}
    members = {
        name: of_joined(who, name, one, counts) if name in _OF_POSITIONS else one for name, one in properties.items()
    }
    return {"type": TRACK_TYPE, "coordinates": positions.tolist(), **rest}, members


def with_nested_times(properties: dict[str, Any]) -> dict[str, Any]:
    """Return the properties of a line with the times that toGeoJSON nests: `coordTimes`, `coordinateProperties.times`.

    Its `time`, that of the first position, is left out.
    """
    nested = properties.get("coordinateProperties")
    times = properties.get("coordTimes") or (nested.get("times") if isinstance(nested, dict) else None)
    if not isinstance(times, list) or any(properties.get(name) is not None for name in (*TIMES, *SPEED)):
        return properties
    rest = {name: one for name, one in properties.items() if name not in ("coordTimes", "coordinateProperties")}
    first = times[0][0] if times and isinstance(times[0], list) and times[0] else next(iter(times), None)
    if rest.get("time") == first:
        del rest["time"]
    others = {name: one for name, one in nested.items() if name != "times"} if isinstance(nested, dict) else {}
    return {**rest, **({"coordinateProperties": others} if others else {}), "times": times}


def track(key: str, geometry: dict[str, Any], fields: Fields, setting: FileContext) -> Track | TrackAtSpeed:
    """Return the track of a feature; raises InvalidInput with all errors.

    Its times are given, one per waypoint (`times`, or `datetimes` as OGC Moving Features calls them), or follow from
    `start` and a speed over the ground. The latter needs the lengths of its legs, which `timed` computes for many
    tracks at once.
    """
    by_times = [name for name in TIMES if fields.has(name)]
    by_speed = [name for name in SPEED if fields.has(name)]
    positions: NDArray[np.float64] = np.empty((0, 2))
    with fields.refusals:
        positions = line(fields.who, "geometry.coordinates", geometry.get("coordinates"))
        if setting.to_degrees is not None:
            positions = setting.to_degrees(positions)
    with fields.refusals:
        if by_times and (by_speed or len(by_times) > 1):
            twice = (*by_speed, *by_times)[0]
            rule = f"must not be given together with {by_times[-1]}: give times, or start and a speed"
            raise fields.refusal(twice, rule)
        if not by_times and not by_speed:
            rule = "is missing: give times (one per waypoint), or start and speed_kn or speed_mps"
            raise fields.refusal("times", rule)
        if by_times:
            times_us = instants(fields.who, by_times[0], fields.get(by_times[0]))
        else:
            if not fields.has("start"):
                raise fields.refusal("start", "is missing: a track with a speed needs its start")
            start_us = fields.instant("start")
            speed, speed_mps = speeds_mps(fields, len(positions) - 1)
    members = track_members(fields, setting)
    fields.raise_found()
    if by_times:
        return Track(key, positions, all_certain(times_us), **members, max_speed_kn=np.inf)
    assert start_us is not None  # noqa: S101
    return TrackAtSpeed(key, positions, start_us, speed, speed_mps, members)


def track_members(fields: Fields, setting: FileContext) -> dict[str, Any]:
    """Return the members of a track besides key, positions and times: haven, name, heights, properties.

    Errors are added to the fields' refusals.
    """
    members = own_members(fields) | _plain(fields, TRACK, setting) | {"properties": fields.rest()}
    rest = setting.foreign, setting.remedy
    fields.refusals.extend(misnamed(fields.who, fields.values, TRACK_GUARDED, TRACK_ELSEWHERE, *rest))
    return members


def own_members(fields: Fields) -> dict[str, Any]:
    """Return the members of a track of forms of their own, but its course: haven, heights, tolerances, departures.

    Errors are added to the fields' refusals.
    """
    members: dict[str, Any] = {}
    with fields.refusals:
        outlines = havens(fields)
        members = {"outline_m": haven(fields) if outlines is None else outlines[0], "outlines_m": outlines}
    for one in HEIGHT_LIMITS:
        members |= _heights(fields, one)
    return {
        **members,
        "tolerances": {name: fields.get(name) for name in TOLERANCES if fields.has(name)} or None,
        **_recurring(fields, "departures", lambda who, value: all_certain(instants(who, "departures", value))),
    }


def activations(fields: Fields) -> dict[str, Any]:
    """Return the activations of an area, if it has several; errors are added to the fields' refusals."""
    return _recurring(fields, "spans", _spans)


def _check_datum(fields: Fields, setting: FileContext) -> None:
    """Refuse heights that are said to be above another vertical datum than the scene's; the member stays a property."""
    stated = fields.values.get(DATUM)
    if stated is not None and any(fields.has(one.whole) for one in HEIGHT_LIMITS):
        rule = datum_rule(stated, setting.datum())
        with fields.refusals:
            if rule:
                raise fields.refusal(DATUM, rule)


def _plain(fields: Fields, kind: str, setting: FileContext) -> dict[str, Any]:
    """Return the columns that are one member of a plain form; checks the vertical datum."""
    _check_datum(fields, setting)
    found: dict[str, Any] = {}
    for one in columns_of(kind):
        if one.is_member and one.name not in _READ_ELSEWHERE[kind]:
            value = _READ[one.form](fields, one.members[0])
            found[one.field] = one.absent if value is None else value
    return found


# How a member of each form is read.
_READ: Final[dict[Form, Callable[[Fields, str], Any]]] = {
    Form.TEXT: Fields.text,
    Form.WORD: Fields.word,
    Form.NUMBER: Fields.number,
    Form.DOCUMENT: Fields.document,
}


def _recurring(fields: Fields, name: str, read: Callable[[str, Any], Any]) -> dict[str, Any]:
    """Return several activations, or a schedule, without absent ones."""
    members: dict[str, Any] = {}
    with fields.refusals:
        if fields.has(name):
            if fields.has("schedule"):
                raise fields.refusal(name, "must not be given together with schedule")
            members[f"{name}_us"] = read(fields.who, fields.get(name))
    with fields.refusals:
        if fields.has("schedule"):
            members["schedule"] = fields.get("schedule")
            check_schedule(fields.who, members["schedule"])
            check_storable(fields.who, "", {"schedule": members["schedule"]})
    return members


def _spans(who: str, value: Any) -> list[list[Any]]:
    if not isinstance(value, list) or not all(isinstance(pair, list) and len(pair) == 2 for pair in value):
        raise InvalidInput(who, "spans", f"must be a list of pairs [start, end]; got {value!r:.60}")
    return [
        [
            None if at is None else certain(instant(who, f"spans[{i}][{side}]", at, is_end=side == 1))
            for side, at in enumerate(pair)
        ]
        for i, pair in enumerate(value)
    ]


def _heights(fields: Fields, limit: HeightLimit) -> dict[str, Any]:
    """Return a height of a track: one, or one per leg, null for unbounded."""
    name = limit.whole
    value = fields.get(name)
    if not isinstance(value, list):
        return {name: fields.number(name)}
    heights = []
    for i, height in enumerate(value):
        with fields.refusals:
            heights.append(limit.unbounded if height is None else finite(fields.who, f"{name}[{i}]", height))
    return {limit.of_legs: np.array(heights, dtype=np.float64)}


def haven(fields: Fields) -> NDArray[np.float64]:
    """Return the (m, 2) outline (starboard, forward) in metres of the haven in the fields.

    Sides that are missing are those of the hints. Raises InvalidInput if there is none, if it is given twice, or if a
    size is negative.
    """
    sides = [name for name in SIZES if fields.has(name)]
    if fields.has("outline_m"):
        if sides:
            raise fields.refusal(sides[0], "must not be given together with outline_m")
        outline = pairs(fields.who, "outline_m", fields.get("outline_m"), "[starboard, forward] in metres")
        return _opened(outline[None])[0]
    default = given_haven()
    if not sides and default is None:
        rule = "is missing: a track needs its haven, four sides in _m or _nmi, or outline_m (all 0 is a point)"
        raise fields.refusal("fore_m", f"{rule}; {HAVEN_OPTION}")
    sizes = [_side_m(fields, side, None if default is None else default[i]) for i, side in enumerate(SIDES)]
    return rectangle_outline_m(*(0.0 if size is None else size for size in sizes))


def havens(fields: Fields) -> NDArray[np.float64] | None:
    """Return the (n, m, 2) outlines (starboard, forward) in metres per waypoint, None for a constant haven.

    Raises InvalidInput if the haven is given twice, or if the outlines are not rings of equally many vertices.
    """
    if not fields.has("outlines_m"):
        return None
    given = [name for name in ("outline_m", "grow_mps", *SIZES) if fields.has(name)]
    if given:
        raise fields.refusal(given[0], "must not be given together with outlines_m")
    value = fields.get("outlines_m")
    if not isinstance(value, list) or not value:
        raise fields.refusal("outlines_m", f"must be a list of outlines, one per waypoint; got {value!r:.60}")
    meaning = "[starboard, forward] in metres"
    rings = [pairs(fields.who, f"outlines_m[{k}]", ring, meaning) for k, ring in enumerate(value)]
    for k, ring in enumerate(rings):
        if not len(ring):
            raise fields.refusal(f"outlines_m[{k}]", f"must be a ring of {meaning}")
        if len(ring) != len(rings[0]):
            rule = f"must have as many vertices as outlines_m[0]: {len(rings[0])}, not {len(ring)}"
            raise fields.refusal(f"outlines_m[{k}]", f"{rule} (a vertex may be given twice)")
    return _opened(np.stack(rings))


def _opened(outlines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return outlines (n, m, 2) without the last vertex if it is the first again, in all of them."""
    closed = outlines.shape[1] > 1 and bool(np.all(outlines[:, 0] == outlines[:, -1]))
    return outlines[:, :-1] if closed else outlines


def _side_m(fields: Fields, side: str, default_m: float | None) -> float | None:
    given = [name for name in (f"{side}_m", f"{side}_nmi") if fields.has(name)]
    with fields.refusals:
        if len(given) > 1:
            raise fields.refusal(given[1], f"must not be given together with {given[0]}")
        if not given and default_m is not None:
            return float(default_m)
        if not given:
            rule = "is missing: the other sides of the haven are given (0 is allowed)"
            raise fields.refusal(f"{side}_m", f"{rule}; {HAVEN_OPTION}")
        size = fields.number(given[0])
        if size is not None and size < 0.0:
            raise fields.refusal(given[0], f"must not be negative; got {size:g}")
        return size if size is None or given[0].endswith("_m") else size * METRES_PER_NMI
    return None


def speeds_mps(fields: Fields, legs: int) -> tuple[str, NDArray[np.float64]]:
    """Return the name of the speed field, and the speed on each leg (legs,) in metres per second."""
    given = [name for name in ("speed_kn", "speed_mps") if fields.has(name)]
    if not given:
        raise fields.refusal(
            "speed_kn", "is missing: a track with a start needs speed_kn or speed_mps (or give times instead)"
        )
    if len(given) > 1:
        raise fields.refusal("speed_mps", "must not be given together with speed_kn")
    name = given[0]
    value = fields.get(name)
    if isinstance(value, list):
        if len(value) != legs and legs > 0:  # without legs the waypoints are refused
            raise fields.refusal(name, f"must be one number, or one per leg: {legs} legs, {len(value)} speeds")
        named = [(f"{name}[{i}]", speed) for i, speed in enumerate(value)]
    else:
        named = [(name, value)] * legs
    speeds = np.array([finite(fields.who, where, speed) for where, speed in named])
    still = np.flatnonzero(speeds <= 0.0)
    if still.size:
        i = int(still[0])
        raise fields.refusal(named[i][0], f"must be greater than 0; got {speeds[i]:g} (to stay in place, give times)")
    return name, speeds * (MPS_PER_KNOT if name == "speed_kn" else 1.0)


def suspect_properties(item: Area | Track) -> Iterator[str]:
    """Yield the names of an object's properties that `area` or `track` would take for misspelt members."""
    is_track = isinstance(item, Track)
    members = track_properties(item) if isinstance(item, Track) else area_properties(item)
    known, elsewhere = (TRACK_GUARDED, TRACK_ELSEWHERE) if is_track else (AREA_GUARDED, AREA_ELSEWHERE)
    return (refused.field for refused in misnamed(item.key, members, known, elsewhere))


def datum_of(scene: Scene, item: Area | Track) -> dict[str, Any]:
    """Return the vertical datum as a member of an object with heights, for a file without settings; else nothing."""
    return {DATUM: scene.vertical_datum.value} if has_heights(item) else {}


def area_properties(item: Area) -> dict[str, Any]:
    """Return the properties from which `area` reads the same area."""
    return {
        **{name: value for name, value in item.properties.items() if name not in AREA_MEMBERS},
        "kind": AREA,
        **_active(item),
        **plain_properties(item),
    }


def track_properties(item: Track) -> dict[str, Any]:
    """Return the properties from which `track` reads the same track."""
    return {
        **{name: value for name, value in item.properties.items() if name not in TRACK_MEMBERS},
        "kind": TRACK,
        "times": [format_instant(int(t)) for t in item.times_us],
        **_departing(item),
        **_haven_properties(item),
        **(item.tolerances or {}),
        **plain_properties(item),
        **{one.whole: _listed(heights) for one in HEIGHT_LIMITS if (heights := getattr(item, one.of_legs)) is not None},
    }


def columns_aside(item: Area | Track) -> dict[str, Any]:
    """Return the columns that forms of other systems have no member for, as members of an extension of ours."""
    given = [(one, getattr(item, one.field, one.absent)) for one in _ASIDE]
    return {one.members[0]: value for one, value in given if value != one.absent}


def read_aside(fields: Fields) -> dict[str, Any]:
    """Return the members of `columns_aside` as fields of `Area`; errors are added to the fields' refusals."""
    return {one.field: _READ[one.form](fields, one.members[0]) for one in _ASIDE if fields.has(one.members[0])}


def plain_properties(item: Area | Track, *forms: Form) -> dict[str, Any]:
    """Return the columns that are one member of some plain forms, or all, without absent ones and the schedule."""
    columns = columns_of(AREA if isinstance(item, Area) else TRACK, *forms)
    given = [(one, getattr(item, one.field)) for one in columns if one.is_member and one.name != "schedule"]
    return {one.members[0]: value for one, value in given if value != one.absent}


def _departing(item: Track) -> dict[str, Any]:
    """Return the departures of a track, or its schedule, without absent ones."""
    if item.schedule is not None:
        return {"schedule": item.schedule}
    departures = item.departures_us
    return {} if departures is None else {"departures": [format_instant(at) for at in departures]}


def _active(item: Area) -> dict[str, Any]:
    """Return the spans of an area, or its only one, and its schedule, whose expansion is left out."""
    if item.spans_us is not None and item.schedule is None:
        return {"spans": [[_instant(at) for at in span] for span in item.spans_us]}
    return _present(start=_instant(item.start_us), end=_instant(item.end_us), schedule=item.schedule)


def _listed(heights: NDArray[np.float64]) -> list[float | None]:
    """Return heights as JSON values, null for unbounded."""
    return [height if np.isfinite(height) else None for height in heights.tolist()]


def _haven_properties(item: Track) -> Mapping[str, Any]:
    """Return the four sides if they give exactly this outline, else the outline or outlines."""
    if item.outlines_m is not None:
        rings = item.outlines_m
        if rings.shape[1] > 1 and np.all(rings[:, 0] == rings[:, -1]):
            rings = np.concatenate([rings, rings[:, :1]], axis=1)  # else they would be read as closed
        return {"outlines_m": rings.tolist()}
    outline_m = item.outline_m
    starboard, fore = (float(x) for x in outline_m.max(axis=0))
    port, aft = (-float(x) for x in outline_m.min(axis=0))
    sides = (fore, aft, port, starboard)
    if min(sides) >= 0.0 and np.array_equal(rectangle_outline_m(*sides), outline_m):
        return {f"{side}_m": size + 0.0 for side, size in zip(SIDES, sides, strict=True)}
    return {"outline_m": outline_m.tolist()}


def _instant(instant_us: int | None) -> str | None:
    return None if instant_us is None else format_instant(instant_us)


def _present(**members: Any) -> dict[str, Any]:
    return {name: value for name, value in members.items() if value is not None}
