"""Compute the regions of conflicts, in longitude and latitude."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.polygons import SRID, Polygons
from conflictdb.arrays.ragged import offsets, ragged_rows, ragged_take
from conflictdb.core.covering import covering, placed
from conflictdb.core.pieces.convex_parts import convex_parts
from conflictdb.core.pieces.covers import COVER
from conflictdb.core.shared_areas import beyond, common_area, united
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.kernel.regions import OutlineKind, RegionKind, joined, outlines, regions
from conflictdb.model.results import Kind

# Increase it if the regions of unchanged answers change: databases then rewrite theirs.
EDITION: Final = 6
# A union of at most this many parts is exact. Of more, neighbours in time are merged first: a track that lies still for
# hours has thousands of nearly equal parts.
_FEW_PARTS: Final = 8
# Two areas with more contacts are intersected as whole areas: a union of 10,000 parts takes 12 s.
_MANY_PARTS: Final = 64
# A region reaches beyond its sides in the plane by at most the tolerance, or by this if that is larger, metres:
# with less, regions have more corners.
BEYOND_M: Final = 1.0
# By no more than this either, metres: outlines next to a pole would cross it.
_MOST_BEYOND_M: Final = 1_000.0


@dataclass(frozen=True, slots=True)
class Meetings:
    """The contacts of n pairs of objects, from which regions are computed on request.

    prepared : the pieces of the contacts
    a, b : (m,) the prepared pieces of each contact
    start_s, end_s : (m,) seconds after the start of the shared span; infinite for areas that are always there
    offset : (n + 1,) the contacts of pair i are [offset[i], offset[i + 1]), at least one
    meet : (n,) whether they are nearer than the separation, not only within the tolerance of it
    first_deg : (n, 2) longitude and latitude of the first contact; NaN if the method does not find it
    threads : of the kernel
    """

    setup: Setup
    prepared: kernel.KernelScene
    a: PieceRows
    b: PieceRows
    start_s: Floats
    end_s: Floats
    offset: NDArray[np.int64]
    meet: NDArray[np.bool_]
    first_deg: Floats
    threads: int

    def regions(self, rows: NDArray[np.int64]) -> Polygons:
        """Return the regions of pairs (k,): valid, cut at the seam. Each covers its first contact.

        Rows from n on are pairs without a contact, whose regions are unknown.
        """
        in_contact = rows < len(self.offset) - 1
        offset, contacts = ragged_rows(self.offset, rows[in_contact])
        # Pairs without a contact get no region.
        count = np.zeros(len(rows), np.int64)
        count[in_contact] = np.diff(offset)
        times = self.start_s[contacts], self.end_s[contacts]
        a, b = PieceRows(self.a[contacts]), PieceRows(self.b[contacts])
        place = np.full((len(rows), 2), np.nan)
        place[in_contact] = self.first_deg[rows[in_contact]]
        return regions_of(self.setup, self.prepared, a, b, times, offsets(count), place_deg=place, threads=self.threads)


def regions_of(
    setup: Setup,
    prepared: kernel.KernelScene,
    a: PieceRows,
    b: PieceRows,
    seconds: tuple[Floats, Floats],
    offset: NDArray[np.int64],
    *,
    place_deg: Floats,
    threads: int = 1,
) -> Polygons:
    """Return the regions of n pairs of objects: valid, cut at the seam, each with a place in it.

    A region contains the intersection of two areas, of other pairs the area that both sweep during their contacts. It
    reaches beyond that by at most the tolerance, or `BEYOND_M`. It is unknown near a pole, on great circles, and for
    objects that could not be cut; the database then computes it from the hulls of pieces.

    a, b : (m,) the prepared pieces of each contact
    seconds : (m,) start and end, seconds after the start of the shared span; infinite for areas without times
    offset : (n + 1,) the contacts of pair i are [offset[i], offset[i + 1]); the region is unknown without contacts
    place_deg : (n, 2) longitude and latitude; NaN: not known
    """
    pieces, plane = prepared.pieces, setup.plane
    count = np.diff(offset)
    is_known = count > 0
    if not is_known.any():
        return Polygons.none(len(count))
    group = np.repeat(np.arange(len(count)), count)
    has_cover = (pieces.part[a] == COVER) | (pieces.part[b] == COVER)
    asked = np.flatnonzero(~has_cover)
    zero_us, _ = pieces.shared_span(a, b)
    low_s, high_s = (np.where(np.isfinite(one), one, 0.0)[asked] for one in seconds)
    reach_m = setup.scene.tolerance_m + setup.scene.separation_m
    ring, ring_offset, kind = regions(prepared, a[asked], b[asked], zero_us[asked], low_s, high_s, reach_m, threads)
    is_known[group[has_cover]] = False
    is_known[group[asked[kind == RegionKind.UNKNOWN]]] = False
    moves = np.zeros(len(count), np.bool_)
    moves[group[(pieces.kind[a] == Kind.TRACK.code) | (pieces.kind[b] == Kind.TRACK.code)]] = True
    is_crowded = is_known & ~moves & (count > _MANY_PARTS)
    of_ring = np.repeat(group[asked], 2)  # of each ring: each contact has two rings, which may be empty
    wanted = is_known[of_ring] & ~(is_crowded[of_ring] & np.repeat(kind == RegionKind.COMMON, 2))
    filled = np.flatnonzero((np.diff(ring_offset) > 0) & wanted)
    (ring, ring_offset), of_ring = ragged_take(ring_offset, ring, filled), of_ring[filled]

    limit_m = min(max(setup.scene.tolerance_m, BEYOND_M), _MOST_BEYOND_M)
    crowded = np.flatnonzero(is_crowded)
    of_crowded = np.flatnonzero(is_crowded[of_ring])
    near, near_offset = ragged_take(ring_offset, ring, of_crowded)
    near_end = np.searchsorted(of_ring[of_crowded], [crowded, crowded + 1])

    def of_areas(wanted: NDArray[np.int64]) -> NDArray[np.object_]:
        found = np.full(len(wanted), None, dtype=object)
        for k, pair in enumerate(wanted.tolist()):
            mine = slice(offset[crowded[pair]], offset[crowded[pair] + 1])
            parts = ragged_take(near_offset, near, np.arange(*near_end[:, pair]))
            found[k] = _of_areas(setup, pieces, PieceRows(a[mine]), PieceRows(b[mine]), *parts)
        return in_degrees(plane, found, limit_m)

    areas = Polygons.of(_each_alone(len(crowded), of_areas))
    if len(crowded):
        rest = np.flatnonzero(~is_crowded[of_ring])
        (ring, ring_offset), of_ring = ragged_take(ring_offset, ring, rest), of_ring[rest]
    ring, ring_offset, of_ring = _put_together(ring, ring_offset, of_ring, moves)
    at = offsets(np.bincount(of_ring, minlength=len(count)))
    data, end, what = outlines(plane.kernel_plane, ring, ring_offset, at, limit_m, place_deg=place_deg)
    found, doubtful = Polygons(data, end), np.flatnonzero(what > OutlineKind.AWAY)
    if not len(doubtful) and not len(crowded) and not (what == OutlineKind.AWAY).any():
        return found

    def of_pairs(wanted: NDArray[np.int64]) -> NDArray[np.object_]:
        taken, of = ragged_rows(at, doubtful[wanted])
        rings, ends = ragged_take(ring_offset, ring, of)
        return _united_in_degrees(plane, rings, ends, taken, limit_m)

    sure = np.flatnonzero((what <= OutlineKind.AWAY) & ~is_crowded)
    made = Polygons.of(_each_alone(len(doubtful), of_pairs))
    found = placed(len(count), (sure, found.take(sure)), (doubtful, made), (crowded, areas))
    away = np.flatnonzero((what != OutlineKind.SOUND) | is_crowded)
    kept = np.flatnonzero((what == OutlineKind.SOUND) & ~is_crowded)
    return placed(len(count), (kept, found.take(kept)), (away, covering(found.take(away), place_deg[away])))


def _of_areas(
    setup: Setup, pieces: Pieces, a: PieceRows, b: PieceRows, ring: Floats, offset: NDArray[np.int64]
) -> shapely.Geometry:
    """Return the region of two areas of many parts: their intersection, and where else they come near.

    a, b : (m,) the parts in contact
    ring, offset : the regions of parts that do not intersect
    """
    turned = pieces.object_id[a] != pieces.object_id[a[0]]
    a, b = PieceRows(np.where(turned, b, a)), PieceRows(np.where(turned, a, b))
    common = common_area(setup.plane, pieces, a, b)
    near = beyond(setup.plane, common, _polygons(ring, np.diff(offset)), setup.scene.tolerance_m)
    if not len(near):
        return common
    xy, at = ragged_take(offset, ring, near)
    if len(near) > _FEW_PARTS:
        xy, at, _ = joined(xy, at, np.zeros(len(near), np.int64))
    return united(np.array([[common, *_polygons(xy, np.diff(at))]], dtype=object), np.array([True]))[0]


def _put_together(
    ring: Floats, offset: NDArray[np.int64], of_ring: NDArray[np.int64], is_superset: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Return rings, offsets and groups; many rings of one group are merged into a slightly larger superset.

    of_ring : (n,) the group of each ring, not decreasing
    is_superset : (groups,) whether a superset is allowed
    """
    many = (is_superset & (np.bincount(of_ring, minlength=len(is_superset)) > _FEW_PARTS))[of_ring]
    apart, together = np.flatnonzero(~many), np.flatnonzero(many)
    if not len(together):
        return ring, offset, of_ring
    taken = [ragged_take(offset, ring, rows) for rows in (apart, together)]
    parts = [(*taken[0], of_ring[apart]), joined(*taken[1], of_ring[together])]
    rings, sizes, groups = (
        np.concatenate(one) for one in zip(*((r, np.diff(o), of) for r, o, of in parts), strict=True)
    )
    order = np.argsort(groups, kind="stable")
    return *ragged_take(offsets(sizes), rings, order), groups[order]


def _each_alone(n: int, work: Callable[[NDArray[np.int64]], NDArray[np.object_]]) -> NDArray[np.object_]:
    """Return the results of `work` for n pairs; if it fails on one, the database computes the region of that pair."""
    made = np.full(n, None, dtype=object)
    for wanted, some in isolated(np.arange(n), work, _unknown, "the region of pair"):
        made[wanted] = some
    return made


def _unknown(wanted: NDArray[np.int64]) -> NDArray[np.object_]:
    return np.full(len(wanted), None, dtype=object)


def in_degrees(plane: Plane, found: NDArray[np.object_], limit_m: float) -> NDArray[np.object_]:
    """Return polygons (n,) of the plane in longitude and latitude, valid, cut at the seam; None: unknown.

    Each contains the polygon in the plane, and reaches beyond it by at most limit_m, metres on the earth.
    """
    parts, of = shapely.get_parts(shapely.orient_polygons(found), return_index=True)
    rings, part = shapely.get_rings(parts, return_index=True)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    ends, region = (
        offsets(np.bincount(ring, minlength=len(rings))),
        offsets(np.bincount(of[part], minlength=len(found))),
    )
    is_hole = np.diff(part, prepend=-1) == 0
    data, end, what = outlines(plane.kernel_plane, xy, ends, region, limit_m, is_hole=is_hole)
    result = Polygons(data, end).geometries()
    for k in np.flatnonzero(what > OutlineKind.SOUND).tolist():
        # Sides of thin parts, or next to each other, cross where they move outward.
        _, corners, open_ends = convex_parts(found[k : k + 1])
        count = np.diff(open_ends)
        closed = ragged_rows(open_ends, np.arange(len(count)))[1]
        closed = np.insert(closed, open_ends[1:], open_ends[:-1])
        united = _united_in_degrees(plane, corners[closed], offsets(count + 1), np.array([0, len(count)]), limit_m)
        result[k] = united[0]
    return result


def _united_in_degrees(
    plane: Plane, ring: Floats, ring_offset: NDArray[np.int64], offset: NDArray[np.int64], limit_m: float
) -> NDArray[np.object_]:
    """Return the unions (n,) of convex rings of the plane, in longitude and latitude; None: a ring is unknown.

    ring, ring_offset, offset : see `outlines`
    """
    each = np.arange(len(ring_offset))
    data, end, what = outlines(plane.kernel_plane, ring, ring_offset, each, limit_m)
    parts = Polygons(data, end).geometries()
    crossed = np.flatnonzero(what > OutlineKind.AWAY)
    crossed = crossed[~shapely.is_valid(parts[crossed])]
    parts[crossed] = shapely.convex_hull(parts[crossed])
    found = np.full(len(offset) - 1, None, dtype=object)
    for k, (first, last) in enumerate(zip(offset[:-1].tolist(), offset[1:].tolist(), strict=True)):
        if not (what[first:last] == OutlineKind.UNKNOWN).any():
            found[k] = _home(shapely.union_all(parts[first:last]))
    return shapely.set_srid(found, SRID)


def _home(region: shapely.Geometry) -> shapely.Geometry:
    """Return a region within 180 degrees of longitude, cut at the seam where it reaches beyond it."""
    west, _, east, _ = region.bounds
    if west >= -180.0 and east <= 180.0:
        return region
    parts = []
    for turn in (-360.0, 0.0, 360.0):
        part = shapely.intersection(region, shapely.box(turn - 180.0, -90.0, turn + 180.0, 90.0))
        parts += [
            shapely.transform(one, lambda at, by=turn: np.clip(at - (by, 0.0), (-180.0, -90.0), (180.0, 90.0)))
            for one in shapely.get_parts(part).tolist()
            if one.geom_type == "Polygon"
        ]
    return shapely.union_all(parts)


def _polygons(ring: Floats, count: NDArray[np.int64]) -> NDArray[np.object_]:
    """Return polygons of consecutive closed rings with `count` vertices each."""
    if not len(count):
        return np.empty(0, dtype=object)
    rings = shapely.linearrings(ring, indices=np.repeat(np.arange(len(count)), count))
    return np.asarray(shapely.polygons(rings))
