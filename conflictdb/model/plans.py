"""Scenes, areas and tracks, and the rules they must keep.

Units: metres, degrees for longitude and latitude, whole microseconds since 1970-01-01T00:00Z for instants
(PostgreSQL's own resolution, so that nothing is rounded twice).
"""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import InitVar, dataclass, field, fields
from itertools import compress
from operator import attrgetter, is_, is_not
from typing import TYPE_CHECKING, Any, ClassVar, Final, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.model import inputs, plan_rules
from conflictdb.model.activations import INFINITY_US as INFINITY_US
from conflictdb.model.activations import MINUS_INFINITY_US as MINUS_INFINITY_US
from conflictdb.model.few_rules import AREA_FEW, TRACK_FEW, FewColumns
from conflictdb.model.few_rules import MAX_GROWTH_MPS as MAX_GROWTH_MPS
from conflictdb.model.plan_columns import AREA, HEIGHT_LIMITS, TRACK, PlanColumn, checked_columns, columns_of
from conflictdb.model.plan_rows import One
from conflictdb.model.plan_rules import MAX_HAVEN_CORNERS as MAX_HAVEN_CORNERS
from conflictdb.model.plan_rules import MAX_HAVEN_M as MAX_HAVEN_M
from conflictdb.model.plan_rules import MAX_INSTANT_US as MAX_INSTANT_US
from conflictdb.model.plan_rules import MAX_LONGITUDE_DEG as MAX_LONGITUDE_DEG
from conflictdb.model.plan_rules import MAX_POINTS as MAX_POINTS
from conflictdb.model.plan_rules import MIN_INSTANT_US as MIN_INSTANT_US
from conflictdb.model.plan_rules import POLE_RULE as POLE_RULE
from conflictdb.model.rules import check_word
from conflictdb.model.scene import MAX_LATITUDE_DEG as MAX_LATITUDE_DEG
from conflictdb.model.scene import Scene as Scene
from conflictdb.model.settings import MOST_M, datum_named
from conflictdb.model.settings import EarthModel as EarthModel
from conflictdb.model.settings import Intervals as Intervals
from conflictdb.model.settings import Motion as Motion
from conflictdb.model.settings import VerticalDatum as VerticalDatum
from conflictdb.model.speed_limits import MAX_SPEED_KN, check_speed
from conflictdb.model.units import METRES_PER_NMI as METRES_PER_NMI

MAX_RHUMB_LATITUDE_DEG: Final = 89.0  # the Mercator plane stretches without limit towards the poles
MAX_FROM_CENTRE_DEG: Final = 60.0  # the gnomonic plane stretches by 4 there, and without limit towards 90

MAX_DISTANCE_M: Final = MOST_M

LINES: Final = {Motion.RHUMB: "rhumb lines", Motion.GREAT_CIRCLE: "great circles"}

_AREA_COLUMNS: Final = checked_columns(AREA)
_TRACK_COLUMNS: Final = checked_columns(TRACK)
_ONE: Final = One(1)
_AREA_FEW_FIELDS, _TRACK_FEW_FIELDS = (
    attrgetter(*(name for few in columns for name in few.fields)) for columns in (AREA_FEW, TRACK_FEW)
)
# The columns of each of these fields.
_OF_AREA_FIELDS, _OF_TRACK_FIELDS = ([few for few in columns for _ in few.fields] for columns in (AREA_FEW, TRACK_FEW))
_SOUND: Final = {"": True}
_Class = TypeVar("_Class")


def _with_columns(kind: str) -> Callable[[type[_Class]], type[_Class]]:
    """Return a decorator that gives a class a field for each column that it does not have."""

    def decorated(of: type[_Class]) -> type[_Class]:
        for column in columns_of(kind):
            if column.field not in of.__annotations__:
                of.__annotations__[column.field] = Any
                setattr(of, column.field, column.absent)
        return of

    return decorated


@dataclass(frozen=True, slots=True)
@_with_columns(AREA)
class Area:
    """A polygon that is closed for a time.

    footprint : MultiPolygon of longitude, latitude in degrees; edges are straight in the scene's plane. May be given as
        a Polygon, or as the vertices of a ring
    start_us, end_us : active during [start, end), microseconds since 1970; None is unbounded. May be given as aware
        datetimes or datetime64 (UTC)
    floor_m, ceiling_m : height band [floor, ceiling), metres above the scene's `vertical_datum`; None is unbounded
    properties : other members of the file, exported again
    object_class : the class that separation rules name; None: no class
    owner : objects of one owner are not compared with each other; None: no owner
    spans_us : several spans instead of start and end, sorted and joined where they touch: pairs of start and end. With
        a schedule: its expansion
    schedule : JSON of `model.schedules`: active at those times of [start, end), expanded for the scene's horizon
    """

    key: str
    footprint: shapely.MultiPolygon
    name: str | None = None
    start_us: int | None = None
    end_us: int | None = None
    floor_m: float | None = None
    ceiling_m: float | None = None
    properties: Mapping[str, Any] = field(default_factory=dict)
    object_class: str | None = None
    owner: str | None = None
    spans_us: tuple[tuple[int | None, int | None], ...] | None = None
    schedule: Any = None
    is_stored: ClassVar[bool] = False

    if TYPE_CHECKING:  # accepted types; __post_init__ converts them to the stored ones

        def __init__(
            self,
            key: str,
            footprint: inputs.Footprint,
            name: str | None = None,
            start_us: inputs.Instant | None = None,
            end_us: inputs.Instant | None = None,
            floor_m: float | None = None,
            ceiling_m: float | None = None,
            properties: Mapping[str, Any] = ...,
            object_class: str | None = None,
            owner: str | None = None,
            spans_us: Sequence[Sequence[inputs.Instant | None]] | None = None,
            schedule: Any = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        who = _named("area", self.key)
        refusals = Refusals()
        with refusals:
            _keep(self, footprint=inputs.footprint(who, self.footprint))
            plan_rules.footprints(self.footprint).raise_for(0, who)
        with refusals:
            if self.start_us is not None or self.end_us is not None:
                start_us, end_us = inputs.span_us(who, self.start_us, self.end_us)
                _keep(self, start_us=start_us, end_us=end_us)
                plan_rules.spans(*_bounds(start_us, end_us), _ONE).raise_for(0, who)
        few = _AREA_FEW_FIELDS(self)
        if not all(map(is_, few, _AREA_ABSENT)):
            _check_few(who, self, compress(_OF_AREA_FIELDS, map(is_not, few, _AREA_ABSENT)), _SOUND, refusals)
        _keep_heights(who, self, refusals)
        with refusals:
            _check_properties(who, self.properties)
        _check_columns(who, self, _AREA_COLUMNS, refusals)
        refusals.raise_found()
        with refusals:
            _check_heights(who, self)
        refusals.raise_found()


@dataclass(frozen=True, slots=True)
@_with_columns(TRACK)
class Track:
    """A convex polygon (the haven) carried along waypoints at constant speed on each leg.

    Arrays may be given as lists too, positions as a LineString, outlines as Polygons, and times as aware datetimes or
    as datetime64 (UTC).

    positions_deg : (n, 2) float64, longitude and latitude of the waypoints, n >= 2
    times_us : (n,) int64, strictly increasing, microseconds since 1970
    outline_m : (m, 2) float64, convex haven as (starboard, forward) metres about the reference point, not closed;
        one vertex (usually the origin) is a point haven, two are a line; of a haven that changes: at the first waypoint
    floor_m, ceiling_m : height band [floor, ceiling), metres above the scene's `vertical_datum`; None is unbounded
    properties : other members of the file, exported again
    grow_mps : metres per second, >= 0, at which every side of the haven moves outward from the first waypoint's time on
    outlines_m : (n, m, 2) float64, instead: the haven at every waypoint, outline_m the first; on a leg each vertex
        moves straight, and steadily, from its place in one to that in the next; None: it keeps its outline, or grows
    floors_m, ceilings_m : float64, instead of floor_m or ceiling_m: (n - 1,) one per leg, or (n,) one per waypoint,
        between which it changes linearly; -inf and +inf where unbounded (at a waypoint: on both its legs). floor_m and
        ceiling_m are then the lowest and the highest of them. At a waypoint the bands of both legs count
    object_class : the class that separation rules name; None: no class
    owner : objects of one owner are not compared with each other; None: no owner
    tolerances : members of `conflictdb.model.tolerances`, such as {"xtd_port_m": 500}: how far voyages may differ from
        the plan; the haven of a detection contains all of them. None: not at all
    departures_us : the voyage is repeated: it departs at each of these instants, increasing, instead of at the first of
        `times_us`, and all its times are moved with it. A voyage ends before the next departs. With a schedule: its
        expansion
    schedule : JSON of `model.schedules`, instead: the voyage departs at each start of an activation, whose end has no
        meaning; expanded for the scene's horizon
    legs : the lines that its legs follow, if its source says so: a scene of another motion refuses the track. It is not
        stored. None: those of the scene
    max_speed_kn : a track that is faster on a leg, over the shortest way, is refused: 2,000 knots unless given here.
        math.inf takes every speed. It is not kept
    """

    key: str
    positions_deg: NDArray[np.float64]
    times_us: NDArray[np.int64]
    outline_m: NDArray[np.float64]
    name: str | None = None
    floor_m: float | None = None
    ceiling_m: float | None = None
    properties: Mapping[str, Any] = field(default_factory=dict)
    grow_mps: float = 0.0
    outlines_m: NDArray[np.float64] | None = None
    floors_m: NDArray[np.float64] | None = None
    ceilings_m: NDArray[np.float64] | None = None
    object_class: str | None = None
    owner: str | None = None
    tolerances: Mapping[str, Any] | None = None
    departures_us: tuple[int, ...] | None = None
    schedule: Any = None
    legs: Motion | None = None
    max_speed_kn: InitVar[float] = MAX_SPEED_KN
    is_stored: ClassVar[bool] = False

    if TYPE_CHECKING:  # accepted types; __post_init__ converts them to the stored ones

        def __init__(
            self,
            key: str,
            positions_deg: inputs.Positions,
            times_us: inputs.Instants,
            outline_m: inputs.Outline,
            name: str | None = None,
            floor_m: float | None = None,
            ceiling_m: float | None = None,
            properties: Mapping[str, Any] = ...,
            grow_mps: float = 0.0,
            outlines_m: inputs.Outlines | None = None,
            floors_m: inputs.Heights | None = None,
            ceilings_m: inputs.Heights | None = None,
            object_class: str | None = None,
            owner: str | None = None,
            tolerances: Mapping[str, Any] | None = None,
            departures_us: inputs.Instants | None = None,
            schedule: Any = None,
            legs: Motion | None = None,
            max_speed_kn: float = MAX_SPEED_KN,
        ) -> None: ...

    def __post_init__(self, max_speed_kn: float) -> None:
        who = _named("track", self.key)
        refusals = Refusals()
        with refusals:
            _keep(self, positions_deg=inputs.positions_deg(who, self.positions_deg))
        with refusals:
            _keep(self, times_us=inputs.instants_us(who, "times", self.times_us))
        with refusals:
            _keep(self, outline_m=inputs.outline_m(who, "outline_m", self.outline_m))
        _keep_heights(who, self, refusals)
        with refusals:
            _check_properties(who, self.properties)
        _check_columns(who, self, _TRACK_COLUMNS, refusals)
        refusals.raise_found()
        way, clock = One(len(self.positions_deg)), One(len(self.times_us))
        course = plan_rules.courses(self.positions_deg, way, self.times_us, clock)
        if min(way.count, clock.count) < 2:
            course.raise_for(0, who)  # there are no legs to check other fields by
        outline = plan_rules.outlines(self.outline_m, One(len(self.outline_m)), lambda _: "outline_m")
        for rules in (course, outline):
            if not rules.is_sound:
                with refusals:
                    rules.raise_for(0, who)
        if course.is_sound:
            with refusals:
                limit_kn = inputs.speed_limit_kn(who, "max_speed_kn", max_speed_kn)
                check_speed(who, self.positions_deg, self.times_us, limit_kn)
        few = _TRACK_FEW_FIELDS(self)
        if not all(map(is_, few, _TRACK_ABSENT)):
            sound = _SOUND | {"path": bool(course.is_sound), "outline": bool(outline.is_sound)}
            _check_few(who, self, compress(_OF_TRACK_FIELDS, map(is_not, few, _TRACK_ABSENT)), sound, refusals)
        if self.floors_m is None and self.ceilings_m is None:
            with refusals:
                _check_heights(who, self)
        refusals.raise_found()

    def heights_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the floor and the ceiling at both ends of each leg, (n - 1, 2) metres, infinite where unbounded."""
        legs = len(self.positions_deg) - 1
        floor_m = -np.inf if self.floor_m is None else self.floor_m
        ceiling_m = np.inf if self.ceiling_m is None else self.ceiling_m
        return (
            np.full((legs, 2), floor_m) if self.floors_m is None else heights_of_legs(self.floors_m, legs),
            np.full((legs, 2), ceiling_m) if self.ceilings_m is None else heights_of_legs(self.ceilings_m, legs),
        )


# Of plans that give none of these columns.
_AREA_ABSENT, _TRACK_ABSENT = (
    [{one.name: one.default for one in fields(kind)}[name] for few in columns for name in few.fields]
    for kind, columns in ((Area, AREA_FEW), (Track, TRACK_FEW))
)


class StoredArea(Area):
    """An area of a database: if its schedule is not understood, it may be active from its start to its end."""

    __slots__ = ()
    is_stored: ClassVar[bool] = True

    def __eq__(self, other: object) -> bool:
        names = [one.name for one in fields(Area)]
        return isinstance(other, Area) and all(getattr(self, name) == getattr(other, name) for name in names)

    __hash__ = Area.__hash__


class StoredTrack(Track):
    """A track of a database: if its schedule is not understood, it may depart at any time."""

    __slots__ = ()
    is_stored: ClassVar[bool] = True


def has_unknown_times(plan: Area | Track) -> bool:
    """Return whether a stored plan has a schedule that is not expanded, or not understood."""
    if not plan.is_stored or plan.schedule is None:
        return False
    return (plan.spans_us if isinstance(plan, Area) else plan.departures_us) is None


def is_idle(plan: Area | Track) -> bool:
    """Return whether the schedule of a plan is expanded, and has no activation."""
    return plan.schedule is not None and (plan.spans_us if isinstance(plan, Area) else plan.departures_us) == ()


def has_heights(plan: Area | Track) -> bool:
    """Return whether a plan has a floor or a ceiling, also of single legs."""
    return any(getattr(plan, name, None) is not None for one in HEIGHT_LIMITS for name in (one.whole, one.of_legs))


def has_size(track: Track) -> bool:
    """Return whether the haven of a track is more than one point."""
    outlines_m = track.outline_m if track.outlines_m is None else track.outlines_m
    return track.grow_mps != 0.0 or bool(np.any(outlines_m))


def is_by_legs(track: Track) -> bool:
    """Return whether size, heights or tolerances of a track are given by leg or waypoint."""
    return any(one is not None for one in (track.outlines_m, track.floors_m, track.ceilings_m, track.tolerances))


def heights_of_legs(heights_m: NDArray[np.float64], legs: int) -> NDArray[np.float64]:
    """Return heights per leg or waypoint as those at both ends of each leg, (legs, 2); infinite ones on whole legs."""
    if len(heights_m) == legs:
        return np.stack([heights_m, heights_m], axis=1)
    ends = np.stack([heights_m[:-1], heights_m[1:]], axis=1)
    return np.where(np.isinf(ends[:, ::-1]), ends[:, ::-1], ends)


def rectangle_outline_m(fore_m: float, aft_m: float, port_m: float, starboard_m: float) -> NDArray[np.float64]:
    """Return the (m, 2) outline (starboard, forward) of a rectangular haven; sizes in metres, each >= 0.

    Sides of zero length leave no duplicate vertices: all zero is one point. Raises InvalidInput for what is no number.
    """
    for name, value in (("fore_m", fore_m), ("aft_m", aft_m), ("port_m", port_m), ("starboard_m", starboard_m)):
        if not inputs.is_number(value) or (isinstance(value, int) and abs(value) > sys.float_info.max):
            raise InvalidInput("rectangle_outline_m", name, f"must be a number; got {str(value)[:60]}")
    corners = [(starboard_m, fore_m), (starboard_m, -aft_m), (-port_m, -aft_m), (-port_m, fore_m)]
    return np.array(list(dict.fromkeys((x + 0.0, y + 0.0) for x, y in corners)), dtype=np.float64)


def check_keys(keys: Iterable[str]) -> None:
    """Raise InvalidInput for a key that occurs twice, or that files and the database cannot store."""
    seen: set[str] = set()
    for key in keys:
        if key in seen:
            raise InvalidInput(f"object {key!r}", "key", "occurs more than once: keys must be unique")
        seen.add(key)
        try:
            key.encode()  # as stored by files and the database, and the order of rows
        except UnicodeEncodeError:
            raise InvalidInput(f"object {key!r}", "key", "contains half of a surrogate pair, no character") from None


def _named(kind: str, key: object) -> str:
    if not isinstance(key, str) or not key:
        raise InvalidInput(kind, "id", f"must be a non-empty string; got {key!r:.60}")
    return f"{kind} {key!r}"


def _keep(one: Area | Track, **values: object) -> None:
    """Replace fields of an object that is being made."""
    for name, value in values.items():
        object.__setattr__(one, name, value)


def owned_by(plan: Area | Track, owner: str) -> Area | Track:
    """Return a plan with another owner, not checked again otherwise; raises InvalidInput for the owner."""
    check_word(_named("area" if isinstance(plan, Area) else "track", plan.key), "owner", owner)
    owned = copy(plan)
    _keep(owned, owner=owner)
    return owned


def _keep_heights(who: str, one: Area | Track, refusals: Refusals) -> None:
    for name in ("floor_m", "ceiling_m"):
        given = getattr(one, name)
        if given is not None:
            with refusals:
                object.__setattr__(one, name, inputs.metres(who, name, given))


def check_legs(lines: str, tracks: Iterable[Track]) -> None:
    """Raise InvalidInput for the first track whose legs are other lines than those of a scene, one of LINES."""
    for track in tracks:
        if track.legs is not None and LINES[track.legs] != lines:
            rule = f"are {LINES[track.legs]}, and the scene follows {lines}"
            raise InvalidInput(
                _named("track", track.key), "legs", f"{rule}: use a scene with motion {track.legs.value}"
            )


def check_datums(scene: Scene, objects: Iterable[Area | Track]) -> None:
    """Raise InvalidInput for the first object with heights whose properties name another datum than the scene's."""
    for one in objects:
        stated = one.properties.get("vertical_datum")
        if stated is not None and (one.floor_m is not None or one.ceiling_m is not None):
            rule = datum_rule(stated, scene.vertical_datum)
            if rule:
                raise InvalidInput(
                    _named("area" if isinstance(one, Area) else "track", one.key), "vertical_datum", rule
                )


def datum_rule(stated: Any, datum: VerticalDatum) -> str:
    """Return the rule that heights above a stated datum break in a scene with another one; empty: they fit."""
    known = datum_named(stated)
    if known is datum:
        return ""
    remedy = "convert them" if known is None else f"convert them, or use a scene with vertical_datum {known}"
    return f"must be {datum.value!r}, the scene's, for an object with heights: {remedy}; got {stated!r:.60}"


def _check_properties(who: str, properties: object) -> None:
    if not isinstance(properties, Mapping):
        raise InvalidInput(who, "properties", f"must be a mapping of names to values; got {properties!r:.60}")


def _check_columns(who: str, one: Area | Track, columns: tuple[PlanColumn, ...], refusals: Refusals) -> None:
    """Check the columns whose rule needs no other; errors are added."""
    for column in columns:
        value = getattr(one, column.field)
        rule = None if value is None else column.broken(value)
        if rule is not None:
            with refusals:
                raise InvalidInput(who, column.members[0], rule)


def _bounds(first: float | None, last: float | None) -> tuple[float, float, bool, bool]:
    """Return two bounds, 0 where there is none, and whether they are given."""
    return 0 if first is None else first, 0 if last is None else last, first is not None, last is not None


def _check_heights(who: str, plan: "Area | Track") -> None:
    if plan.floor_m is not None or plan.ceiling_m is not None:
        plan_rules.heights(*_bounds(plan.floor_m, plan.ceiling_m), _ONE).raise_for(0, who)


def _check_few(
    who: str, plan: "Area | Track", columns: Iterable[FewColumns], sound: Mapping[str, bool], refusals: Refusals
) -> None:
    """Check columns that few plans have, and that this plan may give; errors are added.

    sound : whether the columns that others need keep their rules
    """
    for few in dict.fromkeys(columns):
        if sound[few.needs] and few.is_of(plan):
            with refusals:
                few.check(who, plan)
