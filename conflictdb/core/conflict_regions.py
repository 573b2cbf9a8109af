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
from conflictdb.core.pieces.covers import COVER
from conflictdb.core.shared_areas import beyond, common_area, united
from conflictdb.earth.plane import Plane
from conflictdb.earth.registry import Setup
from conflictdb.kernel.regions import RegionKind, joined, regions
from conflictdb.kernel.rows import interleaved
from conflictdb.model.results import Kind

# Increase it if the regions of unchanged answers change: databases then rewrite theirs.
EDITION: Final = 5
# A union of at most this many parts is exact. Of more, neighbours in time are merged first: a track that lies still for
# hours has thousands of nearly equal parts.
_FEW_PARTS: Final = 8
# Two areas with more contacts are intersected as whole areas: a union of 10,000 parts takes 12 s.
_MANY_PARTS: Final = 64
# Sides that are straight in the plane and in degrees agree to the tolerance, or to this, metres. With less, regions
# have more corners; with more, a point of contact may lie further outside.
AGREE_M: Final = 1.0
# Sides bend in degrees by less than a millimetre if no longer than this, metres (to 78 degrees; 11 mm at 89).
_STRAIGHT_M = 100.0
# At most about this many corners are added to a region. A track around the earth had 12 million, more than PostgreSQL
# can print. With fewer, sides of large regions bend by some metres.
_MOST_CORNERS = 20_000
# Head of a polygon in EWKB: little-endian, type with SRID, the SRID, one ring.
_HEAD: Final = b"\x01" + np.array([3 | 0x2000_0000, SRID, 1], "<u4").tobytes()
# Rounding error of a cross product, relative to its terms: sides are rounded once, then three more roundings.
_ROUNDING: Final = 1e-15
# Longest side on a great circle before it is cut, metres of the plane, as in sql/11_plane.sql.
_SIDE_M: Final = 25_000.0
# A region may contain a pole above this latitude, or if longitudes differ by more along such a side.
_HIGHEST_DEG: Final = 89.5
_LARGEST_STEP_DEG: Final = 90.0
_BEYOND_M: Final = 1e8  # five times as far as a gnomonic plane reaches
_SEAM_DEG = 1e-11  # a micrometre: rounded corners on the seam miss it by less


@dataclass(frozen=True, slots=True)
class Meetings:
    """The contacts of n pairs of objects, from which regions are computed on request.

    prepared : the pieces of the contacts
    a, b : (m,) the prepared pieces of each contact
    start_s, end_s : (m,) seconds after the start of the shared span; infinite for areas that are always there
    offset : (n + 1,) the contacts of pair i are [offset[i], offset[i + 1]), at least one
    meet : (n,) whether they are nearer than the separation, not only within the tolerance of it
    first_deg : (n, 2) longitude and latitude of the first contact; NaN if the method does not find it
    threads : of the kernel; the answer does not depend on it
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
        found = regions_of(self.setup, self.prepared, a, b, times, offsets(count), threads=self.threads)
        place = np.full((len(rows), 2), np.nan)
        place[in_contact] = self.first_deg[rows[in_contact]]
        return covering(found, place)


def regions_of(
    setup: Setup,
    prepared: kernel.KernelScene,
    a: PieceRows,
    b: PieceRows,
    seconds: tuple[Floats, Floats],
    offset: NDArray[np.int64],
    *,
    threads: int = 1,
) -> Polygons:
    """Return the regions of n pairs of objects: valid, cut at the seam.

    The region of two areas is their intersection, of other pairs a superset: the area that both sweep during their
    contacts. It is unknown near a pole, on great circles, and for objects that could not be cut; the database then
    computes it from the hulls of pieces.

    a, b : (m,) the prepared pieces of each contact
    seconds : (m,) start and end, seconds after the start of the shared span; infinite for areas without times
    offset : (n + 1,) the contacts of pair i are [offset[i], offset[i + 1]); the region is unknown without contacts
    """
    pieces = prepared.pieces
    count = np.diff(offset)
    is_known = count > 0
    if not is_known.any():
        return Polygons.none(len(count))
    group = np.repeat(np.arange(len(count)), count)
    has_cover = (pieces.part[a] == COVER) | (pieces.part[b] == COVER)
    asked = np.flatnonzero(~has_cover)
    zero_us, _ = pieces.shared_span(a, b)
    low_s, high_s = (np.where(np.isfinite(one), one, 0.0)[asked] for one in seconds)
    reach_m, agree_m = setup.scene.tolerance_m + setup.scene.separation_m, max(setup.scene.tolerance_m, AGREE_M)
    ring, ring_offset, kind = regions(prepared, a[asked], b[asked], zero_us[asked], low_s, high_s, reach_m, threads)
    is_known[group[has_cover]] = False
    is_known[group[asked[kind == RegionKind.UNKNOWN]]] = False
    moves = np.zeros(len(count), np.bool_)
    moves[group[(pieces.kind[a] == Kind.TRACK.code) | (pieces.kind[b] == Kind.TRACK.code)]] = True
    is_crowded = is_known & ~moves & (count > _MANY_PARTS)
    owner = np.repeat(group[asked], 2)  # of each ring: each contact has two rings, which may be empty
    wanted = is_known[owner] & ~(is_crowded[owner] & np.repeat(kind == RegionKind.COMMON, 2))
    filled = np.flatnonzero((np.diff(ring_offset) > 0) & wanted)
    (ring, ring_offset), owner = ragged_take(ring_offset, ring, filled), owner[filled]

    crowded = np.flatnonzero(is_crowded)
    of_crowded = np.flatnonzero(is_crowded[owner])
    near, near_offset = ragged_take(ring_offset, ring, of_crowded)
    near_end = np.searchsorted(owner[of_crowded], [crowded, crowded + 1])

    def of_areas(wanted: NDArray[np.int64]) -> NDArray[np.object_]:
        found = np.full(len(wanted), None, dtype=object)
        for k, pair in enumerate(wanted.tolist()):
            mine = slice(offset[crowded[pair]], offset[crowded[pair] + 1])
            parts = ragged_take(near_offset, near, np.arange(*near_end[:, pair]))
            found[k] = _of_areas(setup, pieces, PieceRows(a[mine]), PieceRows(b[mine]), *parts)
        return _to_degrees(setup.plane, found, agree_m)

    areas = _each_alone(len(crowded), of_areas)
    rest = np.flatnonzero(~is_crowded[owner])
    ring, ring_offset, owner = _put_together(*ragged_take(ring_offset, ring, rest), owner[rest], moves)

    # Nearly all are one ring that is also convex in degrees, and so valid; great circles bend in degrees.
    is_alone = (np.bincount(owner, minlength=len(count))[owner] == 1) & (setup.plane.turn_m > 0.0)
    alone = np.flatnonzero(is_alone)
    xy, at = ragged_take(ring_offset, ring, alone)
    convex = np.flatnonzero(_are_convex(_degrees(setup.plane, xy), at))
    xy, at, is_cut = _with_corners(setup.plane, *ragged_take(at, xy, convex), agree_m)
    plain = _of_rings(_degrees(setup.plane, xy), at)
    # Sides of thin parts may cross where they bend.
    is_valid = np.ones(len(convex), np.bool_)
    is_valid[is_cut] = shapely.is_valid(plain.take(np.flatnonzero(is_cut)).geometries())
    plain, convex = plain.take(np.flatnonzero(is_valid)), convex[is_valid]
    is_plain = np.zeros(len(count), np.bool_)
    is_plain[owner[alone[convex]]] = True

    others = np.unique(owner[~is_plain[owner]])
    xy, at = ragged_take(ring_offset, ring, np.flatnonzero(~is_plain[owner]))
    owner = np.searchsorted(others, owner[~is_plain[owner]])

    def of_pairs(wanted: NDArray[np.int64]) -> NDArray[np.object_]:
        first, last = np.searchsorted(owner, (wanted[0], wanted[-1] + 1))
        parts = _polygons(xy[at[first] : at[last]], np.diff(at[first : last + 1]))
        return _to_degrees(setup.plane, _unions(parts, owner[first:last] - wanted[0], ~moves[others[wanted]]), agree_m)

    made = _each_alone(len(others), of_pairs)
    parts = (np.flatnonzero(is_plain), plain), (others, Polygons.of(made)), (crowded, Polygons.of(areas))
    return placed(len(count), *parts)


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
    ring: Floats, offset: NDArray[np.int64], owner: NDArray[np.int64], is_superset: NDArray[np.bool_]
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Return rings, offsets and owners; many rings of one owner are merged into a slightly larger superset.

    owner : (n,) of each ring, not decreasing
    is_superset : (owners,) whether a superset is allowed
    """
    many = (is_superset & (np.bincount(owner, minlength=len(is_superset)) > _FEW_PARTS))[owner]
    apart, together = np.flatnonzero(~many), np.flatnonzero(many)
    if not len(together):
        return ring, offset, owner
    taken = [ragged_take(offset, ring, rows) for rows in (apart, together)]
    parts = [(*taken[0], owner[apart]), joined(*taken[1], owner[together])]
    rings, sizes, owners = (
        np.concatenate(one) for one in zip(*((r, np.diff(o), of) for r, o, of in parts), strict=True)
    )
    order = np.argsort(owners, kind="stable")
    return *ragged_take(offsets(sizes), rings, order), owners[order]


def _each_alone(n: int, work: Callable[[NDArray[np.int64]], NDArray[np.object_]]) -> NDArray[np.object_]:
    """Return the results of `work` for n pairs; if it fails on one, the database computes the region of that pair."""
    made = np.full(n, None, dtype=object)
    for wanted, some in isolated(np.arange(n), work, _unknown, "the region of pair"):
        made[wanted] = some
    return made


def _unknown(wanted: NDArray[np.int64]) -> NDArray[np.object_]:
    return np.full(len(wanted), None, dtype=object)


def _degrees(plane: Plane, xy: Floats) -> Floats:
    """Return longitude and latitude of places in the plane (n, 2); places within rounding of the seam are on it."""
    lon, lat = plane.from_plane(xy[:, 0], xy[:, 1])
    on_seam = np.abs(np.abs(lon) - 180.0) < _SEAM_DEG
    return np.stack([np.where(on_seam, np.copysign(180.0, lon), lon), lat], axis=1)


def _are_convex(xy: Floats, offset: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (n,) whether closed rings that were convex in the plane certainly turn left at every vertex.

    East and west are the same in degrees: a ring that always turns left goes around once.
    """
    if not len(xy):
        return np.zeros(len(offset) - 1, np.bool_)
    # The side from each vertex to the next; the last vertex is the first again, and has its side.
    side = np.roll(xy, -1, axis=0) - xy
    side[offset[1:] - 1] = side[offset[:-1]]
    after = np.roll(side, -1, axis=0)
    one, other = side[:, 0] * after[:, 1], side[:, 1] * after[:, 0]
    left = one - other > _ROUNDING * (np.abs(one) + np.abs(other))
    left[offset[1:] - 1] = True
    return np.logical_and.reduceat(left, offset[:-1])


def _of_rings(lonlat: Floats, offset: NDArray[np.int64]) -> Polygons:
    """Return a polygon for each closed ring; ring i has the vertices lonlat[offset[i]:offset[i + 1]]."""
    count = np.diff(offset)
    head = np.tile(np.frombuffer(_HEAD, np.uint8), (len(count), 1))
    vertices = lonlat.astype("<f8").view(np.uint8).reshape(-1)
    data = interleaved([head, count.astype("<u4").view(np.uint8).reshape(-1, 4), (vertices, 16 * offset)])
    return Polygons(data, offsets(len(_HEAD) + 4 + 16 * count))


def _to_degrees(plane: Plane, found: NDArray[np.object_], agree_m: float) -> NDArray[np.object_]:
    """Return polygons (n,) of the plane in degrees. Parts are united in the plane, where their sides are straight.

    agree_m : largest distance between a side in degrees and the side in the plane, metres
    """
    if not plane.turn_m:
        return _on_great_circles(plane, found, agree_m)
    side_m = np.maximum(_longest_rhumb_m(plane, agree_m), shapely.length(found) / _MOST_CORNERS)
    return _straight_in_degrees(plane, shapely.segmentize(found, np.nan_to_num(side_m, nan=np.inf)))


def _longest_rhumb_m(plane: Plane, agree_m: float) -> float:
    """Return how far north a side of the Mercator plane may go, plane metres.

    Latitude has the second derivative -sin cos, at most 1/2, in psi: a chord leaves it by at most psi^2 / 16.
    """
    return float(np.sqrt(16.0 * plane.kernel_plane.radius_m * agree_m))


def _with_corners(
    plane: Plane, ring: Floats, offset: NDArray[np.int64], agree_m: float
) -> tuple[Floats, NDArray[np.int64], NDArray[np.bool_]]:
    """Return closed rings of the Mercator plane with corners added to long sides, offsets, and (n,) which have some."""
    if not len(ring):
        return ring, offset, np.zeros(0, np.bool_)
    side = np.roll(ring, -1, axis=0) - ring
    side[offset[1:] - 1] = 0.0
    parts = np.maximum(np.ceil(np.abs(side[:, 1]) / _longest_rhumb_m(plane, agree_m)), 1.0)
    total = np.repeat(np.add.reduceat(parts, offset[:-1]), np.diff(offset))
    count = np.ceil(parts * np.minimum(1.0, _MOST_CORNERS / total)).astype(np.int64)
    bounds = offsets(count)
    share = (np.arange(bounds[-1]) - np.repeat(bounds[:-1], count)) / np.repeat(count, count)
    more = np.repeat(ring, count, axis=0) + share[:, None] * np.repeat(side, count, axis=0)
    return more, bounds[offset], np.maximum.reduceat(count, offset[:-1]) > 1


def _straight_in_degrees(plane: Plane, found: NDArray[np.object_]) -> NDArray[np.object_]:
    """Return polygons (n,) of the plane in longitude and latitude, valid."""

    def degrees(xy: Floats) -> Floats:
        return _degrees(plane, xy)

    in_plane, found = found, shapely.set_srid(shapely.transform(found, degrees), SRID)
    # Long sides of thin parts bend in degrees and may cross: more corners keep them as in the plane.
    crossed = np.flatnonzero(~shapely.is_valid(found) & ~shapely.is_missing(found))
    side_m = np.maximum(_STRAIGHT_M, shapely.length(in_plane[crossed]) / _MOST_CORNERS)
    straight = shapely.transform(shapely.segmentize(in_plane[crossed], side_m), degrees)
    # Parts of a union that nearly touch may cross after rounding.
    crosses = ~shapely.is_valid(straight)
    straight[crosses] = shapely.make_valid(straight[crosses], method="structure", keep_collapsed=False)
    found[crossed] = shapely.set_srid(straight, SRID)
    return np.asarray(found)


def _on_great_circles(plane: Plane, found: NDArray[np.object_], agree_m: float) -> NDArray[np.object_]:
    """Return polygons (n,) of a gnomonic plane in longitude and latitude, cut at the seam; None near a pole."""
    lonlat, of = shapely.get_coordinates(
        shapely.transform(shapely.segmentize(found, _SIDE_M), lambda xy: _degrees(plane, xy)), return_index=True
    )
    # Longitudes jump at the meridian opposite to the centre's, which is reached across a pole.
    jumps = (np.abs(np.diff(lonlat[:, 0])) > _LARGEST_STEP_DEG) & (of[1:] == of[:-1])
    is_known = ~shapely.is_missing(found)
    is_known[of[1:][jumps]] = False
    is_known[of[np.abs(lonlat[:, 1]) > _HIGHEST_DEG]] = False
    furthest = np.zeros(len(found))
    np.maximum.at(furthest, of, np.abs(lonlat[:, 0]))
    result = np.full(len(found), None, dtype=object)
    highest = np.zeros(len(found))
    np.maximum.at(highest, of, np.abs(lonlat[:, 1]))
    # Along a great circle longitude and latitude curve by at most 1.16 tan(latitude) of its length.
    curve = 1.16 * np.maximum(np.tan(np.radians(highest)), 1e-3) / plane.kernel_plane.radius_m
    side_m = np.sqrt(8.0 * agree_m / curve)
    side_m = np.minimum(_SIDE_M, np.maximum(side_m, shapely.length(found) / _MOST_CORNERS))
    within = is_known & (furthest <= 180.0)
    result[within] = _straight_in_degrees(plane, shapely.segmentize(found[within], side_m[within]))
    for k in np.flatnonzero(is_known & (furthest > 180.0)).tolist():
        sides = shapely.segmentize(shapely.intersection(found[k], _sides_of_seam(plane)), side_m[k])
        parts = []
        for side in _straight_in_degrees(plane, sides[~shapely.is_empty(sides)]):
            west, _, east, _ = side.bounds
            home = -360.0 * np.round(0.5 * (west + east) / 360.0)
            moved = shapely.transform(side, lambda at, by=home: at + np.array([by, 0.0]))
            parts += [part for part in shapely.get_parts(moved).tolist() if part.geom_type == "Polygon"]
        result[k] = shapely.set_srid(shapely.MultiPolygon(parts) if len(parts) > 1 else parts[0], SRID)
    return result


def _sides_of_seam(plane: Plane) -> NDArray[np.object_]:
    """Return the two half planes (2,) on either side of the meridian 180, a line in a gnomonic plane."""
    lat = np.linspace(-89.0, 89.0, 179)
    places = np.stack(plane.to_plane(np.full(len(lat), 180.0), lat), axis=1)
    places = places[np.isfinite(places[:, 0])]  # within the horizon of the plane
    one, other = places[np.argsort(np.hypot(*places.T))[:2]]
    along = (other - one) / np.hypot(*(other - one)) * _BEYOND_M
    across = np.array([-along[1], along[0]])
    sides = (across, -across)
    return shapely.polygons([[one - along, one + along, one + along + by, one - along + by] for by in sides])


def _polygons(ring: Floats, count: NDArray[np.int64]) -> NDArray[np.object_]:
    """Return polygons of consecutive closed rings with `count` vertices each."""
    if not len(count):
        return np.empty(0, dtype=object)
    rings = shapely.linearrings(ring, indices=np.repeat(np.arange(len(count)), count))
    return np.asarray(shapely.polygons(rings))


def _unions(parts: NDArray[np.object_], owner: NDArray[np.int64], stand: NDArray[np.bool_]) -> NDArray[np.object_]:
    """Return the union of the parts of each pair (n,).

    owner : the pair of each part, not decreasing
    stand : (n,) whether both objects of a pair are areas
    """
    found = np.full(len(stand), None, dtype=object)
    start = np.flatnonzero(np.diff(owner, prepend=-1))
    size = np.diff(start, append=len(owner))
    for k in np.unique(size).tolist():
        rows = start[size == k]
        of_row = parts[rows[:, None] + np.arange(k)]
        found[owner[rows]] = of_row[:, 0] if k == 1 else united(of_row, stand[owner[rows]])
    return found
