"""Where pairs of objects interfere, in longitude and latitude."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.pieces import PieceRows
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.regions import regions
from conflictdb.model import Scene
from conflictdb.motion.contract import Plane
from conflictdb.pieces.covers import COVER

# Goes up where the regions of the same answers become others: what a database holds is then written anew.
EDITION: Final = 1
_SRID = 4326
# Sides bend in degrees by less than a millimetre if no longer than this, metres (to 78 degrees; 11 mm at 89).
_STRAIGHT_M = 100.0
# About so many corners are added to a region at most. Of a track around the earth there were 12 million, more than
# PostgreSQL can print. With fewer, sides of so large a region bend by some metres.
_MOST_CORNERS = 20_000
_SEAM_DEG = 1e-11  # a micrometre: by less do rounded corners on the seam miss it


@dataclass(frozen=True, slots=True)
class Meetings:
    """Where n pairs of objects interfere, found out for those that are asked for.

    prepared : the pieces of the contacts
    a, b : (m,) the prepared pieces of each contact
    start_s, end_s : (m,) from when to when after the start of what they share; infinite of areas that are always there
    offset : (n + 1,) the contacts of pair i are [offset[i], offset[i + 1]), one at least
    threads : of the kernel; the answer does not depend on it
    """

    scene: Scene
    plane: Plane
    prepared: kernel.Scene
    a: PieceRows
    b: PieceRows
    start_s: Floats
    end_s: Floats
    offset: NDArray[np.int64]
    threads: int

    def regions(self, rows: NDArray[np.int64]) -> NDArray[np.object_]:
        """Return the regions of pairs (k,): polygons, valid, cut at the seam; None where that is not known.

        Rows from n on are of pairs without a contact: nothing is known of where these are.
        """
        found = np.full(len(rows), None, dtype=object)
        in_contact = np.flatnonzero(rows < len(self.offset) - 1)
        offset, contacts = ragged_rows(self.offset, rows[in_contact])
        group = np.repeat(np.arange(len(in_contact)), np.diff(offset))
        times = self.start_s[contacts], self.end_s[contacts]
        a, b = PieceRows(self.a[contacts]), PieceRows(self.b[contacts])
        found[in_contact] = regions_of(self.scene, self.plane, self.prepared, a, b, times, group, threads=self.threads)
        return found


def regions_of(
    scene: Scene,
    plane: Plane,
    prepared: kernel.Scene,
    a: PieceRows,
    b: PieceRows,
    seconds: tuple[Floats, Floats],
    group: NDArray[np.int64],
    *,
    threads: int = 1,
) -> NDArray[np.object_]:
    """Return where pairs of objects interfere: polygons, valid, cut at the seam; None where that is not known.

    Of two areas it is what they have in common; else a superset, what both sweep during their contacts. Not known it
    is in a gnomonic plane, and of objects that could not be cut: the database finds it out from the hulls of pieces.

    a, b : (m,) the prepared pieces of each contact
    seconds : (m,) from when to when after the start of what they share; infinite of areas that are there for ever
    group : (m,) which pair of objects a contact is of, from 0, not decreasing; every pair has one
    """
    pieces = prepared.pieces
    found = np.full(group[-1] + 1 if len(group) else 0, None, dtype=object)
    known = ~((pieces.part[a] == COVER) | (pieces.part[b] == COVER))
    if plane.turn_m == 0.0:
        return found
    zero_us, _ = pieces.shared_span(a, b)
    low_s, high_s = (np.where(np.isfinite(one), one, 0.0)[known] for one in seconds)
    reach_m = scene.tolerance_m + scene.separation_m
    ring, offset, is_known = regions(prepared, a[known], b[known], zero_us[known], low_s, high_s, reach_m, threads)
    owner = np.repeat(group[known], 2)  # of each ring: a contact has two, or empty ones

    def of_pairs(wanted: NDArray[np.int64]) -> NDArray[np.object_]:
        first, last = np.searchsorted(owner, (wanted[0], wanted[-1] + 1))
        return _in_degrees(plane, ring, offset[first : last + 1], owner[first:last] - wanted[0], len(wanted))

    # Geometry may fail on a pair: the database finds that one's out, too.
    for wanted, some in isolated(np.arange(len(found)), of_pairs, _unknown, "the region of pair"):
        found[wanted] = some
    found[group[~known]] = None
    found[group[known][~is_known]] = None
    return found


def _unknown(wanted: NDArray[np.int64]) -> NDArray[np.object_]:
    return np.full(len(wanted), None, dtype=object)


def _in_degrees(
    plane: Plane, ring: Floats, offset: NDArray[np.int64], owner: NDArray[np.int64], n: int
) -> NDArray[np.object_]:
    """Return the regions (n,) of pairs in longitude and latitude; owner: of each ring, not decreasing."""
    found = np.full(n, None, dtype=object)
    count = np.diff(offset)
    filled = np.flatnonzero(count)
    parts = _polygons(ring[offset[0] : offset[-1]], count[filled])
    _put(found, parts, owner[filled])

    def degrees(xy: Floats) -> Floats:
        lon, lat = plane.from_plane(xy[:, 0], xy[:, 1])
        on_seam = np.abs(lon) > 180.0 - _SEAM_DEG
        return np.stack([np.where(on_seam, np.copysign(180.0, lon), lon), lat], axis=1)

    # Parts are put together in the plane, where their sides are straight: not in degrees.
    in_plane, found = found, shapely.set_srid(shapely.transform(found, degrees), _SRID)
    # Long sides of thin parts may cross in degrees, where they bend: with more corners they run as in the plane.
    crossed = np.flatnonzero(~shapely.is_valid(found) & ~shapely.is_missing(found))
    side_m = np.maximum(_STRAIGHT_M, shapely.length(in_plane[crossed]) / _MOST_CORNERS)
    straight = shapely.transform(shapely.segmentize(in_plane[crossed], side_m), degrees)
    # Parts of a union that all but touch may cross when they are rounded.
    crosses = ~shapely.is_valid(straight)
    straight[crosses] = shapely.make_valid(straight[crosses], method="structure", keep_collapsed=False)
    found[crossed] = shapely.set_srid(straight, _SRID)
    return np.asarray(found)


def _polygons(ring: Floats, count: NDArray[np.int64]) -> NDArray[np.object_]:
    """Return polygons of closed rings, one after the other, of so many vertices each."""
    if not len(count):
        return np.empty(0, dtype=object)
    rings = shapely.linearrings(ring, indices=np.repeat(np.arange(len(count)), count))
    return np.asarray(shapely.polygons(rings))


def _put(found: NDArray[np.object_], parts: NDArray[np.object_], owner: NDArray[np.int64]) -> None:
    """Put the unions of parts where they belong; owner : (p,) not decreasing."""
    start = np.flatnonzero(np.diff(owner, prepend=-1))
    size = np.diff(start, append=len(owner))
    for k in np.unique(size).tolist():
        rows = start[size == k]
        of_row = parts[rows[:, None] + np.arange(k)]
        found[owner[rows]] = of_row[:, 0] if k == 1 else shapely.union_all(of_row, axis=1)
