"""Choose the plane of a scene: one row per motion."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, Self

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.earth.geodesy import direction_of, earth_of
from conflictdb.earth.gnomonic import Gnomonic
from conflictdb.earth.mercator import Mercator
from conflictdb.earth.plane import Plane
from conflictdb.model.plans import Area, Motion, Scene, Track

PLANES: Final[Mapping[Motion, Callable[[Scene], Plane]]] = MappingProxyType(
    {
        Motion.RHUMB: lambda scene: Mercator(earth_of(scene.earth)),
        # Only an empty scene has no centre.
        Motion.GREAT_CIRCLE: lambda scene: Gnomonic(*(scene.centre or (0.0, 0.0))),
    }
)


@dataclass(frozen=True, slots=True)
class Setup:
    """The settings of a scene, and the plane in which its tracks and edges are straight."""

    scene: Scene
    plane: Plane

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Return the setup of a scene; one of great circles has a centre, or no objects."""
        return cls(scene, PLANES[scene.motion](scene))

    def under(self, scene: Scene) -> Self:
        """Return the same plane with other settings; their motion, earth and centre are the same."""
        return replace(self, scene=scene)


def centred(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Scene:
    """Return the scene with a centre, if its motion needs one: the middle of the objects, to a millionth of a degree.

    If places all around the earth have no middle, the first place is used: such objects are out of reach of any centre,
    and `check_plane` names them.
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
    """Return (4,) the number of places (n, 2), in degrees, and the sums of their direction vectors.

    Sums of parts may be added.
    """
    (sine, cosine), (sine_lat, cosine_lat) = direction_of(places_deg[:, 0]), direction_of(places_deg[:, 1])
    sums = map(math.fsum, (cosine_lat * cosine, cosine_lat * sine, sine_lat))
    return np.array([len(places_deg), *sums])


def middle_deg(sums: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return the middle of places, the mean of their direction vectors, from their sums (4,): to 1e-6 degrees.

    None if the mean has no direction.
    """
    count, x, y, z = sums.tolist()
    if math.hypot(x, y, z) < 1e-6 * count:
        return None
    lon, lat = math.degrees(math.atan2(y, x)), math.degrees(math.atan2(z, math.hypot(x, y)))
    return round(lon, 6), round(lat, 6)
