"""Find objects that lie far from all others, and legs that last long: signs of wrong digits or swapped coordinates."""

from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.ragged import offsets
from conflictdb.earth import geodesy
from conflictdb.formats.contents import Remark, name_of
from conflictdb.formats.fixes import lasts
from conflictdb.model.plans import Area, Track

# An object gets a remark if it lies FAR times as far from the middle as nine of ten other objects, and at least
# _LEAST_M away. At more than _PLAINLY_FAR_M, three times as far is enough.
FAR: Final = 10.0
_LEAST_M: Final = 200_000.0
_PLAINLY_FAR_M: Final = 500_000.0
# Objects per chunk.
_AT_ONCE: Final = 50_000
# Corners of an extent, as columns of longitude and latitude.
_CORNERS: Final = ([0, 1], [0, 3], [2, 1], [2, 3])
_LONGEST_LEG_DAYS: Final = 31
_LONGEST_LEG_US: Final = _LONGEST_LEG_DAYS * 86_400_000_000
# A smaller factor suffices if swapping longitude and latitude puts the object among the others.
_FAR_IF_SWAPPED: Final = 3.0


def remarks(source: str, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[Remark]:
    """Yield a remark on each object that lies far from all others."""
    items: list[Area | Track] = [*areas, *tracks]
    yield from far(source, extents(areas, tracks), lambda i: name_of(items[i]))


def far(source: str, extents: NDArray[np.float64], name: Callable[[int], str]) -> Iterator[Remark]:
    """Yield a remark on each object that lies far from all others.

    extents : (n, 4) as `extents` returns them
    name : returns the name of an object, given its index
    """
    which, text = found_far(extents)
    for i in which.tolist():
        yield Remark(source, name(i), text(i))


def found_far(
    extents: NDArray[np.float64], others: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.intp], Callable[[int], str]]:
    """Return the objects that lie far from all others, and the text of each.

    extents, others : (n, 4) and (m, 4) as `extents` returns them; None: each object is compared with the rest
    """
    n = len(extents)
    if not n or len(extents if others is None else others) < (2 if others is None else 1):
        return np.empty(0, np.intp), str
    at = geodesy.unit_vectors(_middles(extents))
    of = at if others is None else geodesy.unit_vectors(_middles(others))
    middle = np.array([np.median(of[:, i]) for i in range(3)]) if len(of) > 2 else of[0]
    size_m, apart_m = _sizes_and_distances_m(extents, at, middle)
    distance_m = np.maximum(apart_m - size_m, 0.0)
    its_m = distance_m
    if others is not None:
        size_m, apart_m = _sizes_and_distances_m(others, of, middle)
        its_m = np.maximum(apart_m - size_m, 0.0)
    # Reach of the others: without the farthest, so that an object does not hide itself.
    nearer = np.argsort(its_m)[: max(1, min(len(of) - 1, int(0.9 * len(of))))]
    reach_m = float((apart_m + size_m)[nearer].max())
    remote = np.flatnonzero(distance_m > max(_FAR_IF_SWAPPED * reach_m, _LEAST_M))
    swapped_m = np.full(n, np.inf)
    places = _middles(extents)
    can_be_swapped = remote[np.abs(places[remote, 0]) <= 90.0]
    swapped_m[can_be_swapped] = _apart_m(geodesy.unit_vectors(places[can_be_swapped, ::-1]), middle)
    looks_swapped = swapped_m <= np.maximum(reach_m, distance_m / FAR)
    least_m = min(max(FAR * reach_m, _LEAST_M), max(_FAR_IF_SWAPPED * reach_m, _PLAINLY_FAR_M))
    is_far = (distance_m > least_m) & (len(of) > 2)
    whom = "the other objects" if others is None else "the objects of the scene"

    def text(i: int) -> str:
        apart = f"lies {distance_m[i] / 1000.0:,.0f} km from {whom}"
        if looks_swapped[i]:
            return f"{apart}, but among them if longitude and latitude are swapped: longitude comes first"
        within = f"{max(reach_m, 1000.0) / 1000.0:,.0f} km of each other"
        return f"{apart}, which lie within {within}; is its position right?"

    return np.flatnonzero(is_far | looks_swapped), text


def _middles(extents: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(0.5 * (extents[:, :2] + extents[:, 2:]))


def _sizes_and_distances_m(
    extents: NDArray[np.float64], at: NDArray[np.float64], middle: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far each extent reaches from its place `at`, and how far that is from the middle, metres."""
    size_m, apart_m = np.empty(len(at)), np.empty(len(at))
    # In chunks: there may be millions.
    for first in range(0, len(at), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        size_m[some] = np.max(
            [_apart_m(geodesy.unit_vectors(extents[some][:, corner]), at[some]) for corner in _CORNERS], axis=0
        )
        apart_m[some] = _apart_m(at[some], middle)
    return size_m, apart_m


def extents(areas: Sequence[Area], tracks: Sequence[Track]) -> NDArray[np.float64]:
    """Return the bounding boxes of areas, then tracks (n, 4): west, south, east, north, degrees."""
    of_areas = shapely.bounds([area.footprint for area in areas]).reshape(-1, 4)
    if not tracks:
        return np.asarray(of_areas)
    positions = np.concatenate([track.positions_deg for track in tracks])
    first = offsets([len(track.positions_deg) for track in tracks])[:-1]
    of_tracks = [np.minimum.reduceat(positions, first), np.maximum.reduceat(positions, first)]
    return np.concatenate([of_areas, np.concatenate(of_tracks, axis=1)])


def _apart_m(at: NDArray[np.float64], middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance of unit vectors along the earth, metres, to 1 %."""
    across = np.linalg.norm(np.cross(at, middle), axis=1)
    return np.asarray(geodesy.MEAN_RADIUS_M * np.arctan2(across, (at * middle).sum(axis=1)))


class LongLegs:
    """Legs that last longer than any voyage between two waypoints: a date is probably wrong."""

    def __init__(self) -> None:
        self._count, self._longest = 0, (0, "")

    def add(self, tracks: Sequence[Track]) -> None:
        """Check some tracks."""
        longest_us = [int(np.diff(track.times_us).max()) for track in tracks]
        late = [(us, track.key) for us, track in zip(longest_us, tracks, strict=True) if us > _LONGEST_LEG_US]
        self._count += len(late)
        self._longest = max([self._longest, *late])

    def remarks(self, source: str) -> Iterator[Remark]:
        """Yield a remark if there are any."""
        us, key = self._longest
        if key:
            has = "track has" if self._count == 1 else "tracks have"
            of = f"{self._count:,} {has} legs of more than {_LONGEST_LEG_DAYS} days"
            yield Remark(
                source, "file", f"{of}; the longest, of {lasts(us / 1e6)}, is that of {key!r:.60}: is a date wrong?"
            )
