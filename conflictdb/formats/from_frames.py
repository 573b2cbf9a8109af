"""Build areas and tracks from a GeoDataFrame of geopandas, and tracks from trajectories of MovingPandas.

Columns named like members of scene files are read as these members, in upper or lower case; other columns become
properties, of fixes those of the first one. Names close to a member are refused. Without a column `id` the index is the
id. A missing value (NaN, NaT, None) is an absent member. Instants are datetimes with a zone, or ISO 8601 texts with an
offset. The reference system must be known; systems other than longitude and latitude on WGS84 are transformed vertex by
vertex.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from datetime import datetime, tzinfo
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import numpy as np
import shapely

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.formats import file_objects
from conflictdb.formats.features import LINES, area_of_polygon, track_of_line
from conflictdb.formats.fields import number_as_key
from conflictdb.formats.instants import format_instant
from conflictdb.formats.names import RENAME_COLUMN
from conflictdb.formats.reference import ToDegrees, of_name
from conflictdb.formats.track_times import TrackAtSpeed, timed
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.speed_limits import MAX_SPEED_KN

if TYPE_CHECKING:
    import geopandas
    from movingpandas import TrajectoryCollection

HAVEN: Final = frozenset({"outline_m", "outlines_m", "grow_mps", *file_objects.SIZES})
_INSTANTS: Final = frozenset({"start", "end", "time", *file_objects.TIMES})
# Columns of a frame of fixes that belong to each fix, not to the track.
_OF_FIXES: Final = frozenset({"id", "time", "end", *file_objects.TIMES, *file_objects.SPEED})
NO_HAVEN: Final[Mapping[str, Any]] = MappingProxyType({})


class TimeZone:
    """The zone for instants without one; if it is None they are refused."""

    def __init__(self, given: str | tzinfo | None) -> None:
        given = getattr(given, "zone", None) or given  # pytz zones would give offsets of a century ago
        self._zone = given if isinstance(given, tzinfo) else None
        if isinstance(given, str):
            try:
                self._zone = ZoneInfo(given)
            except (ZoneInfoNotFoundError, ValueError):
                raise InvalidInput("solve", "time_zone", f"must be the name of a zone; got {given!r:.60}") from None
        elif not isinstance(given, tzinfo | None):
            raise InvalidInput("solve", "time_zone", f"must be the name of a zone, or a tzinfo; got {given!r:.60}")

    def text(self, who: str, field: str, instant: datetime) -> str:
        """Return an instant as ISO 8601 UTC with microseconds, truncated; raises InvalidInput."""
        if instant.utcoffset() is None:
            instant = self._with_zone(who, field, instant)
        return format_instant(int((instant - EPOCH) // MICROSECOND))

    def _with_zone(self, who: str, field: str, instant: datetime) -> datetime:
        if self._zone is None:
            rule = (
                "has no time zone: give it one with tz_localize, or all that have none with solve(..., time_zone=...)"
            )
            raise InvalidInput(who, field, f"{rule}; got {instant.isoformat()}")
        early, late = (instant.replace(tzinfo=self._zone, fold=fold) for fold in (0, 1))
        if early.utcoffset() != late.utcoffset():
            rule = f"is there twice, or not at all, in {self._zone}, where clocks are set: give instants in UTC"
            raise InvalidInput(who, field, f"{rule}; got {instant.isoformat()}")
        return early


def is_frame(given: object) -> bool:
    """Return whether an object is a frame of pandas or geopandas, or of trajectories; imports none of them."""
    return _is(given, "pandas", "DataFrame") or is_trajectories(given)


def is_trajectories(given: object) -> bool:
    """Return whether an object is a Trajectory or a TrajectoryCollection of MovingPandas."""
    return _is(given, "movingpandas", "TrajectoryCollection", "Trajectory")


def _is(given: object, library: str, *names: str) -> bool:
    return any(one.__name__ in names and one.__module__.split(".")[0] == library for one in type(given).__mro__)


def areas_of(frame: "geopandas.GeoDataFrame", scene: Scene, zone: TimeZone) -> list[Area]:
    """Return the areas of a frame with a Polygon or MultiPolygon in each row; raises InvalidInput with all errors."""
    setting = _setting("areas", frame, scene)
    refusals = Refusals()
    areas = []
    for where, label, values, shape in _rows("areas", frame):
        with refusals:
            areas.append(area_of_polygon(where, label, _plain(where, values, zone), shape, setting))
    refusals.raise_found()
    return areas


def tracks_of(
    given: "geopandas.GeoDataFrame | TrajectoryCollection", scene: Scene, haven: Mapping[str, Any], zone: TimeZone
) -> list[Track]:
    """Return the tracks of a frame with a LineString in each row, or of trajectories; raises InvalidInput.

    haven : default members for the size of tracks that have none
    """
    read = _tracks_of_trajectories if is_trajectories(given) else _tracks_of_lines
    return read(given, scene, haven, zone)


def _tracks_of_trajectories(given: Any, scene: Scene, haven: Mapping[str, Any], zone: TimeZone) -> list[Track]:
    """Return the tracks of trajectories, each a frame of fixes; sizes and heights are those of the first fix.

    MovingPandas removes the zone from the instants and stores it in an attribute.
    """
    refusals = Refusals()
    found: list[Track | TrackAtSpeed] = []
    for trajectory in getattr(given, "trajectories", [given]):
        key = _as_key(trajectory.id)
        who = f"trajectory {key!r}"
        with refusals:
            frame = trajectory.to_point_gdf()
            setting = file_objects.FileContext.of_settings(scene, "", (), _to_degrees(who, frame), RENAME_COLUMN)
            first = next(_rows(who, frame))[2]
            own = {name: value for name, value in first.items() if str(name).lower() not in _OF_FIXES}
            times = _instants(who, "times", _instants_of_fixes(who, trajectory, frame), zone)
            members = {"times": times, **_plain(who, own, zone)}
            line = shapely.LineString(shapely.get_coordinates(np.asarray(frame.geometry.array, dtype=np.object_)))
            found.append(track_of_line(who, key, _with_haven(members, haven), line, setting))
    _, tracks = timed(found, scene, MAX_SPEED_KN, refusals)
    refusals.raise_found()
    return tracks


def _instants_of_fixes(who: str, trajectory: Any, frame: Any) -> Any:
    """Return the instants of a trajectory's fixes, in their original zone; raises InvalidInput."""
    zone = getattr(trajectory, "df_orig_tz", None)
    if zone is None:
        return frame.index
    when = frame.index.tz_localize(zone, ambiguous="NaT", nonexistent="NaT")
    if when.isna().any():
        rule = f"are there twice, or not at all, in {zone}, where clocks are set"
        raise InvalidInput(who, "times", f"{rule}: make the trajectory of instants in UTC")
    return when


def _tracks_of_lines(frame: Any, scene: Scene, haven: Mapping[str, Any], zone: TimeZone) -> list[Track]:
    setting = _setting("tracks", frame, scene)
    refusals = Refusals()
    found: list[Track | TrackAtSpeed] = []
    for where, label, values, shape in _rows("tracks", frame):
        with refusals:
            if shape is None or shapely.get_type_id(shape) not in LINES:
                got = "none" if shape is None else f"a {shape.geom_type}"
                raise InvalidInput(where, "geometry", f"must be a LineString; got {got}")
            members = _with_haven(_plain(where, values, zone), haven)
            found.append(track_of_line(where, label, members, shape, setting))
    _, tracks = timed(found, scene, MAX_SPEED_KN, refusals)
    refusals.raise_found()
    return tracks


def checked_haven(haven: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Return the members that give the size of a track; raises InvalidInput for others."""
    if haven is None:
        return NO_HAVEN
    if not isinstance(haven, Mapping):
        raise InvalidInput("solve", "haven", f"must be a dict, such as {{'fore_m': 50, ...}}; got {haven!r:.60}")
    unknown = [name for name in haven if name not in HAVEN]
    if unknown:
        raise InvalidInput("solve", f"haven[{unknown[0]!r:.60}]", f"is not known; known are {', '.join(sorted(HAVEN))}")
    return {name: _as_json(value) for name, value in haven.items()}


def _with_haven(values: dict[str, Any], haven: Mapping[str, Any]) -> dict[str, Any]:
    own = {name for name in values if name.lower() in HAVEN and values[name] is not None}
    return values if own else {**values, **haven}


def _setting(who: str, frame: Any, scene: Scene) -> file_objects.FileContext:
    if not _is(frame, "geopandas", "GeoDataFrame"):
        raise InvalidInput("solve", who, "must be a GeoDataFrame, which knows the reference system; got a DataFrame")
    return file_objects.FileContext.of_settings(scene, "", (), _to_degrees(who, frame), RENAME_COLUMN)


def _to_degrees(who: str, frame: Any) -> ToDegrees:
    try:
        crs = frame.crs
    except AttributeError:
        raise InvalidInput(who, "", "has no geometry column: say which with set_geometry") from None
    if crs is None:
        raise InvalidInput(who, "", "has no reference system: say which with set_crs, such as set_crs(4326)")
    return of_name(who, crs.to_string(), "crs")


def _rows(who: str, frame: Any) -> Iterator[tuple[str, str, dict[Hashable, Any], Any]]:
    """Yield for each row its place, its label as a key, its other columns, and its geometry (None if missing)."""
    names = [name for name in frame.columns if name != frame.geometry.name]
    columns = [frame[name].array for name in names]
    shapes = np.asarray(frame.geometry.array, dtype=np.object_)
    for i, (label, shape) in enumerate(zip(frame.index, shapes, strict=True)):
        values = {name: column[i] for name, column in zip(names, columns, strict=True)}
        yield f"{who}.iloc[{i}]", _as_key(label), values, shape


def _as_key(label: Any) -> str:
    return str(number_as_key(label.item() if isinstance(label, np.generic) else label))


def _plain(where: str, values: Mapping[Hashable, Any], zone: TimeZone) -> dict[str, Any]:
    """Return the values of a row as JSON values, without absent ones."""
    plain: dict[str, Any] = {}
    for name, value in values.items():
        text = str(name)
        if text.lower() in _INSTANTS:
            plain[text] = _instants(where, text, value, zone)
        else:
            plain[text] = _as_json(value)
    return {name: value for name, value in plain.items() if value is not None}


def _instants(where: str, field: str, value: Any, zone: TimeZone) -> Any:
    """Return an instant, or a list of them, as ISO 8601; other values unchanged, to be refused later."""
    if isinstance(value, np.datetime64):
        value = None if np.isnat(value) else value.astype("datetime64[us]").item()
    if isinstance(value, datetime):
        return None if value != value else zone.text(where, field, value)  # NaT is not itself
    if isinstance(value, str) or not isinstance(value, Iterable):
        return _as_json(value)
    return [_instants(where, f"{field}[{i}]", one, zone) for i, one in enumerate(value)]


def _as_json(value: Any) -> Any:
    """Return a value as a JSON value; None for missing values and for types that JSON lacks."""
    if isinstance(value, np.ndarray | list | tuple):
        return [_as_json(one) for one in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and np.isnan(value):
        return None
    return value if isinstance(value, str | bool | int | float) else None
