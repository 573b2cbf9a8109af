"""Build areas and tracks from a GeoDataFrame of geopandas, and tracks from trajectories of MovingPandas.

Columns named like members of scene files are read as these members, in upper or lower case; other columns become
properties, of fixes the first value. Without a column `id` the index is the id. A missing value (NaN, NaT, None) is an
absent member; any other value is kept, or refused by column and type. Instants are datetimes with a zone, or ISO 8601
texts with an offset. The reference system must be known; systems other than longitude and latitude on WGS84 are
transformed vertex by vertex.
"""

import warnings
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely

from conflictdb.errors import InvalidInput, Refusals
from conflictdb.formats import file_objects
from conflictdb.formats.features import LINES, area_of_polygon, track_of_line
from conflictdb.formats.fields import number_as_key
from conflictdb.formats.fixes import reached
from conflictdb.formats.frame_values import TimeZone as TimeZone
from conflictdb.formats.frame_values import is_of, plain
from conflictdb.formats.names import RENAME_COLUMN
from conflictdb.formats.reference import ToDegrees, of_name
from conflictdb.formats.track_times import TrackAtSpeed, timed
from conflictdb.model.plan_columns import PLAN_COLUMNS
from conflictdb.model.plans import METRES_PER_NMI, Area, Scene, Track
from conflictdb.model.speed_limits import AIS_MAX_SPEED_KN, MAX_SPEED_KN

if TYPE_CHECKING:
    import geopandas
    from movingpandas import TrajectoryCollection

HAVEN: Final = frozenset({"outline_m", "outlines_m", "grow_mps", *file_objects.SIZES})
# Columns of a frame of fixes that belong to each fix, not to the track.
# Trajectories that a remark names.
_MOST_NAMED: Final = 3
_OF_FIXES: Final = frozenset({"id", "time", "end", *file_objects.TIMES, *file_objects.SPEED})
# Members of fixes that may differ, and how the track has them.
_WIDEST: Final[Mapping[str, Callable[..., float]]] = {
    "floor_m": min,
    "ceiling_m": max,
    "grow_mps": max,
    **dict.fromkeys(file_objects.SIZES, max),
}
_BANDS: Final = frozenset({"floor_m", "ceiling_m"})
# Fields of Area and Track that members of other names have.
_FIELDS: Final = {
    **{one.field: one.members[0] for one in PLAN_COLUMNS if one.is_member and one.field not in one.members},
    "tolerances": "its members, such as xtd_port_m",
    **{f"{name}_us": name for name in ("start", "end", "spans", "times", "departures")},
    **{f"{name}s_m": f"{name}_m" for name in ("floor", "ceiling")},
}
_GUARDED: Final = {*file_objects.AREA_GUARDED, *file_objects.TRACK_GUARDED, "owner"}
NO_HAVEN: Final[Mapping[str, Any]] = MappingProxyType({})


def is_frame(given: object) -> bool:
    """Return whether an object is a frame of pandas or geopandas, or of trajectories; imports none of them."""
    return is_of(given, "pandas", "DataFrame") or is_trajectories(given)


def is_trajectories(given: object) -> bool:
    """Return whether an object is a Trajectory or a TrajectoryCollection of MovingPandas."""
    return is_of(given, "movingpandas", "TrajectoryCollection", "Trajectory")


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
    """Return the tracks of trajectories, each a frame of fixes.

    Sizes are those of each fix, heights of a leg the wider of those at its ends; other members that differ are refused.
    """
    refusals = Refusals()
    found: list[Track | TrackAtSpeed] = []
    left_out: dict[str, int] = {}
    for trajectory in getattr(given, "trajectories", [given]):
        key = _as_key(trajectory.id)
        who = f"trajectory {key!r}"
        with refusals:
            frame = trajectory.to_point_gdf()
            setting = file_objects.FileContext.of_settings(scene, "", (), _to_degrees(who, frame), RENAME_COLUMN)
            fixes, frame = len(frame), _reached(frame)
            if len(frame) < fixes:
                left_out[key] = fixes - len(frame)
            own = _of_all_fixes(who, frame, zone, haven)
            times = plain(who, "times", _instants_of_fixes(who, trajectory, frame), zone)
            members = {"times": times, **own}
            line = shapely.LineString(shapely.get_coordinates(np.asarray(frame.geometry.array, dtype=np.object_)))
            found.append(track_of_line(who, key, _with_haven(members, haven), line, setting))
    _, tracks = timed(found, scene, MAX_SPEED_KN, refusals)
    refusals.raise_found()
    if left_out:
        text = f"{sum(left_out.values()):,} fixes that are not reached from the fixes around them are left out"
        named = ", ".join(f"{key!r} ({count:,})" for key, count in list(left_out.items())[:_MOST_NAMED])
        more = ", …" if len(left_out) > _MOST_NAMED else ""
        warnings.warn(f"trajectories: {text}: {named}{more}", UserWarning, stacklevel=2)
    return tracks


def _reached(frame: Any) -> Any:
    """Return the fixes of a frame, in the order of time, that one object reaches."""
    is_ais = any(str(name).lower() == "mmsi" for name in frame.columns)
    times_us = np.asarray(frame.index.values, "datetime64[us]").astype(np.int64)
    places = shapely.get_coordinates(np.asarray(frame.to_crs(4326).geometry.array, dtype=np.object_))
    if len(places) != len(times_us) or not np.isfinite(places).all():
        return frame  # refused later
    kept = reached(times_us, places, AIS_MAX_SPEED_KN if is_ais else MAX_SPEED_KN)
    return frame[kept] if kept.sum() > 1 else frame


def _of_all_fixes(who: str, frame: Any, zone: TimeZone, haven: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the fixes of a trajectory say of the whole track; raises InvalidInput for members that differ."""
    rows = [values for _, _, values, _ in _rows(who, frame)]
    found: dict[str, Any] = {}
    refusals = Refusals()
    for name in rows[0]:
        text, lower = str(name), str(name).lower()
        if lower in _OF_FIXES:
            continue
        with refusals:
            values = [plain(who, text, row[name], zone) for row in rows]
            given = [value for value in values if value is not None]
            if not given:
                continue
            is_constant = all(value == given[0] for value in given)
            are_numbers = all(type(value) in (int, float) for value in given)
            found[text] = given[0]
            if lower in _BANDS and are_numbers and not (is_constant and len(given) == len(values)):
                found[text] = _of_legs(values, _WIDEST[lower])
            elif lower in _WIDEST and are_numbers:
                found[text] = _WIDEST[lower](given)
            elif not is_constant and lower in (*file_objects.TRACK_MEMBERS, file_objects.DATUM):
                raise InvalidInput(who, text, f"differs between fixes: {given[0]!r:.60} and others; a track has one")
    refusals.raise_found()
    return _with_outlines(who, found, rows, zone, haven)


def _with_outlines(
    who: str,
    found: dict[str, Any],
    rows: Sequence[Mapping[Hashable, Any]],
    zone: TimeZone,
    haven: Mapping[str, Any],
) -> dict[str, Any]:
    """Return members with an outline for each fix where sizes change; a fix without a size has the largest one.

    Members that allow no outlines (growth, tolerances) get the largest sizes, with a warning.
    """
    sizes = {name: name.lower() for name in found if name.lower() in file_objects.SIZES}
    given = {lower: [plain(who, name, row[name], zone) for row in rows] for name, lower in sizes.items()}
    if all(len({value for value in values if value is not None}) < 2 for values in given.values()):
        return found
    if {name.lower() for name in found} & {"grow_mps", *file_objects.TOLERANCES}:
        text = "sizes differ between fixes, and growth or tolerances need one size: the largest counts"
        warnings.warn(f"{who}: {text}", UserWarning, stacklevel=2)
        return found
    whole = {name.lower(): value for name, value in _with_haven({name: found[name] for name in sizes}, haven).items()}
    sides = []
    for side in file_objects.SIDES:
        unit = next((unit for unit in ("m", "nmi") if f"{side}_{unit}" in whole), None)
        if unit is None:
            return found  # refused later
        largest = whole[f"{side}_{unit}"]
        values = given.get(f"{side}_{unit}", [largest] * len(rows))
        scale = 1.0 if unit == "m" else METRES_PER_NMI
        sides.append([(largest if value is None else value) * scale for value in values])
    outlines = [
        [[starboard, fore], [starboard, -aft], [-port, -aft], [-port, fore]]
        for fore, aft, port, starboard in zip(*sides, strict=True)
    ]
    return {**{name: value for name, value in found.items() if name not in sizes}, "outlines_m": outlines}


def _of_legs(heights_m: Sequence[float | None], widest: Callable[[float, float], float]) -> list[float | None]:
    """Return the height of each leg, the wider of those at its ends; None: unbounded, as an end without a height is."""
    return [None if a is None or b is None else widest(a, b) for a, b in pairwise(heights_m)]


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
    return {name: plain("solve", f"haven[{name!r}]", value, TimeZone(None)) for name, value in haven.items()}


def _with_haven(values: dict[str, Any], haven: Mapping[str, Any]) -> dict[str, Any]:
    """Return members with the default haven in place of the sizes that are missing."""
    own = {name.lower() for name, value in values.items() if value is not None}
    if own & {"outline_m", "outlines_m"}:
        return values
    sides = {name.rpartition("_")[0] for name in own & set(file_objects.SIZES)}
    if not sides:
        return {**values, **{name: value for name, value in haven.items() if name not in own}}
    rest = {name: one for name, one in haven.items() if name in file_objects.SIZES}
    return {**values, **{name: one for name, one in rest.items() if name.rpartition("_")[0] not in sides}}


def _setting(who: str, frame: Any, scene: Scene) -> file_objects.FileContext:
    if not is_of(frame, "geopandas", "GeoDataFrame"):
        raise InvalidInput("solve", who, "must be a GeoDataFrame, which knows the reference system; got a DataFrame")
    _check_names(who, frame)
    return file_objects.FileContext.of_settings(scene, "", (), _to_degrees(who, frame), RENAME_COLUMN)


def _check_names(who: str, frame: Any) -> None:
    """Refuse columns whose members would be lost: fields of Area and Track, members in the index, and twice a name."""
    names = [str(name) for name in frame.columns]
    for name in names:
        if name in _FIELDS:
            raise InvalidInput(
                who, name, f"is a field of Area or Track; columns are named as in files: {_FIELDS[name]}"
            )
        if names.count(name) > 1:
            raise InvalidInput(who, name, "is the name of several columns: rename all but one")
    for name in frame.index.names:
        if str(name).lower() in _GUARDED:
            raise InvalidInput(who, str(name), "is in the index, which is the id: make it a column by reset_index")


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
    """Return the values of a row as JSON values, without absent ones; raises InvalidInput with all errors."""
    refusals = Refusals()
    found: dict[str, Any] = {}
    for name, value in values.items():
        with refusals:
            found[str(name)] = plain(where, str(name), value, zone)
    refusals.raise_found()
    return {name: value for name, value in found.items() if value is not None}
