"""Which plane a scene lives in: one row for each motion."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

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

    Of places all around the earth, which have none, it is the first: objects as far apart as these are within reach of
    no centre, and the check of that names them.
    """
    if scene.motion != Motion.GREAT_CIRCLE or scene.centre is not None or not (areas or tracks):
        return scene
    places = places_of(areas, tracks)
    middle = middle_deg(summed_directions(places))
    if middle is None:
        lon, lat = np.remainder(places[0, 0] + 180.0, 360.0) - 180.0, places[0, 1]
        middle = round(float(lon), 6), round(float(lat), 6)
    return replace(scene, centre=middle)


def places_of(areas: Sequence[Area], tracks: Sequence[Track]) -> NDArray[np.float64]:
    """Return the corners and waypoints of objects (n, 2), longitude and latitude."""
    corners = [shapely.get_coordinates(area.footprint) for area in areas]
    return np.concatenate([np.empty((0, 2)), *corners, *(track.positions_deg for track in tracks)])


def summed_directions(places_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (4,) how many places (n, 2), in degrees, there are, and the sums of their directions in space.

    These of several parts are added to those of all.
    """
    (sine, cosine), (sine_lat, cosine_lat) = direction_of(places_deg[:, 0]), direction_of(places_deg[:, 1])
    sums = map(math.fsum, (cosine_lat * cosine, cosine_lat * sine, sine_lat))
    return np.array([len(places_deg), *sums])


def middle_deg(sums: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the middle of places, the mean of their directions, by their sums (4,): to a millionth of a degree.

    None if the mean has no direction. Then the places are within 60 degrees of no centre: towards it the mean of such
    is half as long as a direction, or more.
    """
    count, x, y, z = sums.tolist()
    if math.hypot(x, y, z) < 1e-6 * count:
        return None
    lon, lat = math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))
    return round(lon, 6), round(lat, 6)
