"""Random scenes of a given size: the paper's box, and a sea of constant density.

The paper's random workload (Bienkowski, Sidoti, Pattipati 2021): latitudes 0 to 30, longitudes 45 to 15 west; areas of
3 to 10 vertices, each 50 to 100 nmi from the middle; tracks of one leg of 50 to 100 nmi; rectangular havens with sides
of 20 to 40 nmi. Areas have no time limits; tracks begin within six hours.

Choices of this file, not of the paper: vertices have random bearings from a middle that lies between them, and the area
is their convex hull. Reference points keep a tenth of each side away from the sides. Speeds are 5 to 25 kn. One track
in seven waits for up to two hours at the end of its leg.
"""

import copy
import sys
from collections.abc import Iterator
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene

from conflictdb import Area, Scene, Track


class Kind(StrEnum):
    """Kinds of objects in a scene of the study."""

    STATIC = "static"  # areas alone
    MIXED = "mixed"  # as many areas as tracks
    TRACKS = "tracks"  # tracks alone

    def split(self, objects: int) -> tuple[int, int]:
        """Return the number of areas and of tracks for a number of objects."""
        areas = {Kind.STATIC: objects, Kind.MIXED: objects - objects // 2, Kind.TRACKS: 0}[self]
        return areas, objects - areas


BOX: Final = replace(
    LOW_LATITUDE,
    latitudes=(15.0, 15.0),
    longitudes=(-30.0, -30.0),
    window=30.0,
    legs=(1, 2),
    radius_area=(50.0, 100.0),
    side_haven=(20.0, 40.0),
    odd_share=0.0,
)

# Ships, drones and closed areas of some miles: some ten slices, three candidates and half a conflict an object.
SEA: Final = replace(
    LOW_LATITUDE,
    latitudes=(0.0, 0.0),
    longitudes=(0.0, 0.0),
    leg=(15.0, 40.0),
    around_area=(4.0, 12.0),
    around_haven=(0.4, 1.6),
    odd_share=0.6,
)
# Side of the sea of one object, degrees of latitude: a million of them reach from 60 south to 60 north.
DEGREES_PER_ROOT: Final = 0.12
AT_ONCE: Final = 20_000

Objects = tuple[list[Area], list[Track]]
Plan = TypeVar("Plan", Area, Track)


def box(kind: Kind, objects: int, seed: int) -> tuple[Scene, list[Area], list[Track]]:
    """Return a scene of the paper's random workload."""
    scene, areas, tracks = plain_scene(BOX, seed, *kind.split(objects))
    return scene, [replace(area, start_us=None, end_us=None) for area in areas], tracks


def sea(objects: int, seed: int) -> Iterator[Objects]:
    """Yield the objects, half of them areas, of a scene that is as dense as any other of this kind, some at a time."""
    window = DEGREES_PER_ROOT * objects**0.5
    for first in range(0, objects, AT_ONCE):
        areas, tracks = Kind.MIXED.split(min(AT_ONCE, objects - first))
        _, standing, moving = plain_scene(replace(SEA, window=window), seed + first, areas, tracks)
        for plan in (*standing, *moving):
            # Nobody else has these plans: a copy would check each a second time, which takes half of the making.
            object.__setattr__(plan, "key", f"{first}-{plan.key}")
        yield standing, moving


def repeated_sea(objects: int, seed: int) -> Iterator[Objects]:
    """Yield the objects of a sea that takes a tenth of the time to make.

    Those of the first part are as in `sea`. Each further part repeats their shapes, latitudes and times, each object at
    another longitude of the window.
    """
    window = DEGREES_PER_ROOT * objects**0.5
    areas, tracks = Kind.MIXED.split(min(AT_ONCE, objects))
    _, standing, moving = plain_scene(replace(SEA, window=window), seed, areas, tracks)
    rng = np.random.default_rng(seed)
    footprints = np.array([area.footprint for area in standing], np.object_)
    corners, of_area = shapely.get_coordinates(footprints, return_index=True)
    middles = shapely.get_coordinates(shapely.centroid(footprints))
    starts = np.array([track.positions_deg[0] for track in moving])
    for first in range(0, objects, AT_ONCE):
        some = [one[: max(objects - first, 0) // 2] for one in (standing, moving)]
        east = _eastward(rng, middles, window) if first else np.zeros(areas)
        moved = shapely.set_coordinates(footprints.copy(), corners + np.stack([east[of_area], 0.0 * of_area], axis=1))
        own_areas = [_copy(area, key=f"{first}-{area.key}", footprint=moved[i]) for i, area in enumerate(some[0])]
        east = _eastward(rng, starts, window) if first else np.zeros(tracks)
        own_tracks = []
        for i, track in enumerate(some[1]):
            lonlat = track.positions_deg + np.array([east[i], 0.0])
            lonlat[:, 0] = (lonlat[:, 0] + 180.0) % 360.0 - 180.0
            own_tracks.append(_copy(track, key=f"{first}-{track.key}", positions_deg=lonlat))
        yield own_areas, own_tracks


def _eastward(rng: np.random.Generator, lonlat: NDArray[np.float64], window: float) -> NDArray[np.float64]:
    """Return the degrees of longitude from each place to a random one of the window."""
    half = window / 2 / np.cos(np.radians(lonlat[:, 1]))
    return rng.uniform(-half, half) - lonlat[:, 0]


def _copy(plan: Plan, **fields: Any) -> Plan:
    """Return a plan with other fields, unchecked: a check takes three times as long as to store the plan."""
    other = copy.copy(plan)
    for name, value in fields.items():
        object.__setattr__(other, name, value)
    return other
