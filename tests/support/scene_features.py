"""The features of plans that a random scene may have, and those that a scene has."""

from collections.abc import Iterable
from enum import StrEnum
from typing import Final

import numpy as np
import shapely

from conflictdb.model.plans import Area, EarthModel, Intervals, Motion, Scene, Track

Object = Area | Track
DAY_US: Final = 86_400_000_000


class Feature(StrEnum):
    """A property of objects or a setting that a scene may have."""

    UNBOUNDED = "unbounded areas"
    ACTIVATIONS = "several activations"
    SCHEDULE_OF_AREA = "schedules of areas"
    SCHEDULE_OF_TRACK = "schedules of tracks"
    FAR = "times beyond the expanded window"
    DEPARTURES = "departures"
    ZERO = "zero durations"
    DEPARTURE_WINDOW = "departure windows"
    ARRIVAL_WINDOW = "arrival windows"
    SPEED_WINDOW = "speed windows"
    CROSS_TRACK = "cross-track limits"
    TURN_RADIUS = "turn radii"
    HEIGHTS = "heights"
    LEG_HEIGHTS = "heights of legs"
    CLIMBS = "climbs"
    GROWTH = "growth"
    OUTLINES = "outlines that change"
    CLASSES = "separation by class"
    ALLOWED = "allowed pairs"
    CLASS_VERTICAL = "vertical separation by class"
    CLASS_TIME = "separation in time by class"
    OWNERS = "owners"
    SEPARATION = "separation"
    VERTICAL_SEPARATION = "vertical separation"
    TIME_SEPARATION = "separation in time"
    CLOSED = "closed intervals"
    NEAREST = "closest approaches"
    GREAT_CIRCLE = "great circles"
    SPHERE = "sphere"
    ANTIMERIDIAN = "antimeridian"
    HIGH_LATITUDE = "high latitude"


FEATURES: Final = tuple(Feature)
TOLERANCES: Final = {
    Feature.DEPARTURE_WINDOW,
    Feature.ARRIVAL_WINDOW,
    Feature.SPEED_WINDOW,
    Feature.CROSS_TRACK,
    Feature.TURN_RADIUS,
}
NEEDS: Final = {
    Feature.VERTICAL_SEPARATION: Feature.HEIGHTS,
    Feature.CLASS_VERTICAL: Feature.HEIGHTS,
    Feature.LEG_HEIGHTS: Feature.HEIGHTS,
    Feature.CLIMBS: Feature.HEIGHTS,
    Feature.FAR: Feature.SCHEDULE_OF_AREA,
    Feature.GREAT_CIRCLE: Feature.SPHERE,
}


def features_of(scene: Scene, areas: Iterable[Area], tracks: Iterable[Track]) -> frozenset[Feature]:
    """Return the features that a scene and its objects have; FAR: a track departs a hundred days from another one."""
    areas, tracks = list(areas), list(tracks)
    both: list[Object] = [*areas, *tracks]
    members = [track.tolerances for track in tracks if track.tolerances]
    classed = {one.object_class for one in both if one.object_class is not None}
    rules = [rule for rule in scene.rules if classed & {rule.a_class, rule.b_class}]
    departs = [int(track.times_us[0]) for track in tracks if track.schedule is None]
    per_leg = [track for track in tracks if track.floors_m is not None or track.ceilings_m is not None]
    points = [shapely.get_coordinates(area.footprint) for area in areas] + [track.positions_deg for track in tracks]
    everywhere = np.concatenate([np.zeros((0, 2)), *points])
    found = {
        Feature.UNBOUNDED: any(
            area.schedule is None and not area.spans_us and None in (area.start_us, area.end_us) for area in areas
        ),
        Feature.ACTIVATIONS: any(area.spans_us is not None and area.schedule is None for area in areas),
        Feature.SCHEDULE_OF_AREA: any(area.schedule is not None for area in areas),
        Feature.SCHEDULE_OF_TRACK: any(track.schedule is not None for track in tracks),
        Feature.FAR: bool(departs) and max(departs) - min(departs) > 100 * DAY_US,
        Feature.DEPARTURES: any(track.departures_us is not None and track.schedule is None for track in tracks),
        Feature.ZERO: any(_is_short(one) for one in both),
        Feature.DEPARTURE_WINDOW: any("departure_window" in given for given in members),
        Feature.ARRIVAL_WINDOW: any("arrival_window" in given for given in members),
        Feature.SPEED_WINDOW: any("min_speed_kn" in given or "max_speed_kn" in given for given in members),
        Feature.CROSS_TRACK: any("xtd_port_m" in given or "xtd_starboard_m" in given for given in members),
        Feature.TURN_RADIUS: any("turn_radius_m" in given for given in members),
        Feature.HEIGHTS: any(one.floor_m is not None or one.ceiling_m is not None for one in both),
        Feature.LEG_HEIGHTS: any(_heights(track) == len(track.times_us) - 1 for track in per_leg),
        Feature.CLIMBS: any(_heights(track) == len(track.times_us) for track in per_leg),
        Feature.GROWTH: any(track.grow_mps > 0.0 for track in tracks),
        Feature.OUTLINES: any(track.outlines_m is not None for track in tracks),
        Feature.CLASSES: any(rule.separation_m is not None for rule in rules),
        Feature.ALLOWED: any(rule.allowed for rule in rules),
        Feature.CLASS_VERTICAL: any(rule.vertical_m is not None for rule in rules),
        Feature.CLASS_TIME: any(rule.time_s is not None for rule in rules),
        Feature.OWNERS: any(one.owner is not None for one in both),
        Feature.SEPARATION: scene.separation_m > 0.0,
        Feature.VERTICAL_SEPARATION: scene.vertical_separation_m > 0.0,
        Feature.TIME_SEPARATION: scene.time_separation_s > 0.0,
        Feature.CLOSED: scene.intervals is Intervals.CLOSED,
        Feature.NEAREST: scene.nearest_m > 0.0,
        Feature.GREAT_CIRCLE: scene.motion is Motion.GREAT_CIRCLE,
        Feature.SPHERE: scene.earth is EarthModel.SPHERE,
        Feature.ANTIMERIDIAN: bool((np.abs(everywhere[:, 0]) > 179.0).any()),
        Feature.HIGH_LATITUDE: bool((np.abs(everywhere[:, 1]) > 75.0).any()),
    }
    return frozenset(feature for feature, is_there in found.items() if is_there)


def _is_short(one: Object) -> bool:
    """Return whether a span of an object, or a window, lasts a microsecond at most."""
    if isinstance(one, Area):
        spans = one.spans_us if one.spans_us is not None else ((one.start_us, one.end_us),)
        return any(start is not None and end is not None and end - start <= 1 for start, end in spans)
    windows = [(one.tolerances or {}).get(name) for name in ("departure_window", "arrival_window")]
    return any(window is not None and window[0] == window[1] for window in windows)


def _heights(track: Track) -> int:
    return len(track.floors_m if track.floors_m is not None else track.ceilings_m)
