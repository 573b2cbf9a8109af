"""Which plane a scene lives in."""

from conflictdb.geodesy import earth_of
from conflictdb.mercator import Mercator
from conflictdb.model import Scene
from conflictdb.motion import Plane


def plane_of(scene: Scene) -> Plane:
    """Return the plane in which the tracks and edges of a scene are straight."""
    return Mercator(earth_of(scene.earth))
