"""Move an area or a track by distance and bearing at its true size, and let two plans exchange their times."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.earth import geodesy
from conflictdb.earth.geodesy import Earth, earth_of
from conflictdb.errors import InvalidInput
from conflictdb.model.inputs import certain
from conflictdb.model.plans import Area, Motion, Scene, Track, is_idle
from conflictdb.model.recurring_plans import later

_Floats = NDArray[np.float64]
# Half the way round the earth: more is a wrong unit.
_MOST_M = 20_000_000.0


def moved(plan: Area | Track, distance_m: float, bearing_deg: float, scene: Scene) -> Area | Track:
    """Return a plan elsewhere, in the frame of its scene: along rhumb lines, or turned on the sphere.

    A track's first waypoint, or the middle of an area's bounding box, moves by the distance along the bearing. With
    rhumb lines each leg keeps its length and course, and each vertex of an area its distance and bearing from the
    middle. With great circles all distances stay.

    distance_m : metres, 0 or more
    bearing_deg : degrees clockwise from north

    Raises InvalidInput for distances beyond half the earth, and where the plan would reach beyond a pole.
    """
    places = _positions(plan)
    at = places[0] if isinstance(plan, Track) else 0.5 * (places.min(axis=0) + places.max(axis=0))
    return _elsewhere(plan, places, at, distance_m, bearing_deg, scene)


def dragged(area: Area, from_deg: Sequence[float], to_deg: Sequence[float], scene: Scene) -> Area | Track:
    """Return an area elsewhere, as `moved`, when one place of it goes to another; longitudes and latitudes, degrees."""
    at, to = np.array(from_deg), np.array(to_deg)
    if scene.motion == Motion.GREAT_CIRCLE:
        east, north, _ = geodesy.great_circle_step(*at, *to)
        distance_m = geodesy.great_circle_distance(*at, *to)
        bearing_deg = np.degrees(np.arctan2(east, north))
    else:
        distance_m, bearing_deg = geodesy.rhumb_inverse(earth_of(scene.earth), *at, *to)
    return _elsewhere(area, _positions(area), at, float(distance_m), float(bearing_deg), scene)


def _elsewhere(
    plan: Area | Track, places: _Floats, at: _Floats, distance_m: float, bearing_deg: float, scene: Scene
) -> Area | Track:
    """Return a plan with one place moved by a distance along a bearing."""
    who = f"{'area' if isinstance(plan, Area) else 'track'} {plan.key!r}"
    if not (0.0 <= distance_m <= _MOST_M and np.isfinite(bearing_deg)):
        rule = "must be a distance from 0 to 20,000 km and a bearing in degrees"
        raise InvalidInput(who, "move", f"{rule}; got {distance_m:g} m, {bearing_deg:g}")
    if scene.motion == Motion.GREAT_CIRCLE:
        new = _turned(places, at, distance_m, bearing_deg)
        if isinstance(plan, Area):
            new = _closed(plan.footprint, new)
    elif isinstance(plan, Track):
        new = _along_legs(earth_of(scene.earth), places, distance_m, bearing_deg)
    else:
        new = _around(earth_of(scene.earth), places, at, distance_m, bearing_deg)
    if not np.isfinite(new).all():
        raise InvalidInput(who, "move", f"would reach beyond a pole, {distance_m / 1000.0:g} km on {bearing_deg:g}°")
    if isinstance(plan, Track):
        given: Any = new
        return replace(plan, positions_deg=given, max_speed_kn=np.inf)
    return replace(plan, footprint=shapely.set_coordinates(shapely.from_wkb(plan.footprint.wkb), new))


def delayed(plan: Area | Track, by_us: int) -> Area | Track:
    """Return a plan later by some microseconds; see `recurring_plans.later`."""
    if isinstance(plan, Track):
        return later(plan, by_us)
    return later(plan, by_us)


def exchanged(a: Area | Track, b: Area | Track) -> tuple[Area | Track, Area | Track]:
    """Return two tracks with their departures exchanged, at their own speeds, or two areas with their times exchanged.

    Raises InvalidInput for an area and a track, and for tracks that do not depart once.
    """
    who = f"{a.key!r} and {b.key!r}"
    if a.key == b.key:
        raise InvalidInput(who, "swap", "must be two plans; got one twice")
    if isinstance(a, Track) and isinstance(b, Track):
        for track in (a, b):
            if track.departures_us is not None or is_idle(track):
                raise InvalidInput(who, "swap", f"{track.key!r} has departures of its own: it cannot be exchanged")
        by_us = int(b.times_us[0] - a.times_us[0])
        return later(a, by_us), later(b, -by_us)
    if isinstance(a, Area) and isinstance(b, Area):
        return _active_as(a, b), _active_as(b, a)
    raise InvalidInput(who, "swap", "must be two tracks or two areas")


def _active_as(area: Area, other: Area) -> Area:
    start: Any = None if other.start_us is None else certain(other.start_us)
    end: Any = None if other.end_us is None else certain(other.end_us)
    spans: Any = other.spans_us and [[None if at is None else certain(at) for at in span] for span in other.spans_us]
    if spans is not None:
        start = end = None
    return replace(area, start_us=start, end_us=end, spans_us=spans, schedule=None)


def _positions(plan: Area | Track) -> _Floats:
    return np.array(plan.positions_deg if isinstance(plan, Track) else shapely.get_coordinates(plan.footprint))


def _along_legs(earth: Earth, places: _Floats, distance_m: float, bearing_deg: float) -> _Floats:
    lengths_m, bearings = geodesy.rhumb_inverse(earth, places[:-1, 0], places[:-1, 1], places[1:, 0], places[1:, 1])
    new = np.empty_like(places)
    new[0] = _step(earth, places[0], bearing_deg, distance_m)
    for i in range(len(places) - 1):
        new[i + 1] = _step(earth, new[i], float(bearings[i]), float(lengths_m[i]))
    return new


def _around(earth: Earth, places: _Floats, at: _Floats, distance_m: float, bearing_deg: float) -> _Floats:
    from_m, bearings = geodesy.rhumb_inverse(earth, at[0], at[1], places[:, 0], places[:, 1])
    middle = _step(earth, at, bearing_deg, distance_m)
    return np.stack(geodesy.rhumb_direct(earth, middle[0], middle[1], bearings, from_m), axis=1)


def _step(earth: Earth, at: _Floats, bearing_deg: float, distance_m: float) -> _Floats:
    return np.array(geodesy.rhumb_direct(earth, at[0], at[1], bearing_deg, distance_m))


def _closed(footprint: shapely.Geometry, new: _Floats) -> _Floats:
    """Return the vertices of a footprint, turned, with rings that close; NaN where one goes round a pole.

    Longitudes of a ring are near each other, and its first one near that of the first ring.
    """
    rings = shapely.get_rings(shapely.get_parts(footprint))
    ends = np.cumsum(shapely.get_num_coordinates(rings))
    new = new.copy()
    for first, end in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=True):
        way_round = geodesy.shorter_way_deg(np.diff(new[first:end, 0])).sum()
        begin = new[0, 0] + geodesy.shorter_way_deg(new[first, 0] - new[0, 0])
        steps = geodesy.shorter_way_deg(np.diff(new[first : end - 1, 0]))
        new[first : end - 1, 0] = begin + np.concatenate([[0.0], np.cumsum(steps)])
        new[end - 1] = new[first] if abs(way_round) < 180.0 else np.nan
    return new


def _turned(places: _Floats, at: _Floats, distance_m: float, bearing_deg: float) -> _Floats:
    """Return places turned on the sphere, such that `at` moves along a great circle; longitudes near the former."""
    lon, lat = np.radians(at)
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    ahead_east, ahead_north = (float(one) for one in geodesy.direction_of(bearing_deg))
    axis = np.cross(geodesy.unit_vectors(at[None])[0], ahead_east * east + ahead_north * north)
    angle = distance_m / geodesy.MEAN_RADIUS_M
    vectors = geodesy.unit_vectors(places)
    along = (vectors @ axis)[:, None] * axis
    turned = along + (vectors - along) * np.cos(angle) + np.cross(axis, vectors) * np.sin(angle)
    new_lon = np.degrees(np.arctan2(turned[:, 1], turned[:, 0]))
    new_lat = np.degrees(np.arctan2(turned[:, 2], np.hypot(turned[:, 0], turned[:, 1])))
    steps = np.concatenate([[0.0], np.cumsum(geodesy.shorter_way_deg(np.diff(new_lon)))])
    return np.stack([new_lon[0] + steps, new_lat], axis=1)
