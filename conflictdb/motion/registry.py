"""Which plane a scene lives in: one row for each motion."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final

import numpy as np
import shapely

from conflictdb.earth.geodesy import direction_of, earth_of
from conflictdb.model import Area, Motion, Scene, Track
from conflictdb.motion.contract import Plane
from conflictdb.motion.gnomonic import Gnomonic
from conflictdb.motion.mercator import Mercator

PLANES: Final[Mapping[Motion, Callable[[Scene], Plane]]] = MappingProxyType(
    {
        Motion.RHUMB: lambda scene: Mercator(earth_of(scene.earth)),
        # Without a centre yet it is without objects.
        Motion.GREAT_CIRCLE: lambda scene: Gnomonic(*(scene.centre or (0.0, 0.0))),
    }
)


def plane_of(scene: Scene) -> Plane:
    """Return the plane in which the tracks and edges of a scene are straight."""
    return PLANES[scene.motion](scene)


def centred(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Scene:
    """Return the scene with a centre, if its motion needs one: the middle of the objects, to a millionth of a degree.

    The mean of all corners and waypoints in space; of places all around the earth that has no direction, and the first
    of them will do.
    """
    if scene.motion != Motion.GREAT_CIRCLE or scene.centre is not None or not (areas or tracks):
        return scene
    corners = [shapely.get_coordinates(area.footprint) for area in areas]
    places = np.concatenate([*corners, *(track.positions_deg for track in tracks)])
    (sine, cosine), (sine_lat, cosine_lat) = direction_of(places[:, 0]), direction_of(places[:, 1])
    x, y, z = (cosine_lat * cosine).mean(), (cosine_lat * sine).mean(), sine_lat.mean()
    if np.hypot(np.hypot(x, y), z) < 1e-6:
        lon, lat = np.remainder(places[0, 0] + 180.0, 360.0) - 180.0, places[0, 1]
    else:
        lon, lat = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
    return replace(scene, centre=(round(float(lon), 6), round(float(lat), 6)))
