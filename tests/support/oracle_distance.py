"""The least distance on the earth between two polygons whose edges are rhumb lines: brute force, for the oracle.

The nearest places on the earth are not the nearest in the Mercator plane: a strip between two meridians is narrowest at
its end nearer the pole, wherever the plane measures. So points all along both boundaries are compared through the
earth (straight chords in space are least where geodesics are), the best are refined along their edges, and the
geodesic between what is found is measured by PROJ (C. F. F. Karney, "Algorithms for geodesics", 2013).

Shares nothing with the package. Chords and geodesics rank nearly equal distances differently by 1e-9 of them at
100 km: that, less than a millimetre per 100 km, is the accuracy.
"""

from functools import cache
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from oracle_motion import Globe
from pyproj import Geod

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CELLS: Final = 16  # parts of an edge between the points that are compared
# Gauss-Newton steps to the nearest point of an edge, each worth a factor of distance * tan(lat) / R; fewer nearby.
STEPS: Final = 8
STEPS_ON: Final = 3
HALVINGS: Final = 24  # of two parts of an edge, to millimetres, which change a least distance by nanometres
ROUNDING_M: Final = 1.0  # of the first comparison, which only says where to look
ARC_PER_CHORD: Final = 1.01
NUMBERS_AT_ONCE: Final = 4_000_000


def edges_of(geometry: shapely.Polygon | shapely.MultiPolygon) -> Floats:
    """Edges (e, 2, 2) of all rings of a polygon or several."""
    xy, owner = shapely.get_coordinates(shapely.get_rings(shapely.get_parts(geometry)), return_index=True)
    inner = owner[1:] == owner[:-1]
    return np.stack([xy[:-1][inner], xy[1:][inner]], axis=1)


def edges_of_hulls(hulls: NDArray[np.object_]) -> Floats:
    """Edges (n, e, 2, 2) of polygons without holes, lines and points; the last point is repeated to fill up."""
    xy, owner = shapely.get_coordinates(hulls, return_index=True)
    first = np.searchsorted(owner, np.arange(len(hulls)))
    count = np.diff(np.append(first, len(xy)))
    number = first[:, None] + np.minimum(np.arange(max(count.max(), 2)), count[:, None] - 1)
    ring = xy[number]
    return np.stack([ring[:, :-1], ring[:, 1:]], axis=2)


def least_m(globe: Globe, one: Floats, two: Floats, beyond_m: float = np.inf) -> Floats:
    """Least geodesic distance (n,) in metres between edges (n or 1, e, 2, 2) and (n, f, 2, 2) in plane metres.

    The edges must not cross. Distances that are certainly more than `beyond_m` are only roughly right.
    """
    step = max(1, NUMBERS_AT_ONCE // (one.shape[1] * two.shape[1] * (CELLS + 1) ** 2))
    blocks = [slice(k, k + step) for k in range(0, len(two), step)]
    return np.concatenate([_least_m(globe, one if len(one) == 1 else one[b], two[b], beyond_m) for b in blocks])


def _least_m(globe: Globe, one: Floats, two: Floats, beyond_m: float) -> Floats:
    n = len(two)
    share = np.linspace(0.0, 1.0, CELLS + 1)
    a, b = (_points(globe, edges[..., None, :, :], share)[0] for edges in (one, two))
    middle = b.reshape(n, -1, 3).mean(axis=1)[:, None, None]
    length_a, length_b = (
        ARC_PER_CHORD * np.sqrt(((p[..., 1:, :] - p[..., :-1, :]) ** 2).sum(axis=-1)).max(axis=-1) for p in (a, b)
    )
    a, b = np.broadcast_to(a, (n, *a.shape[1:])) - middle, b - middle
    square = (a**2).sum(axis=-1)[:, :, :, None, None] + (b**2).sum(axis=-1)[:, None, None]
    square = square - 2.0 * np.einsum("nixk,njyk->nixjy", a, b, optimize=True)
    chord = np.sqrt(np.maximum(square, 0.0))  # (n, e, samples, f, samples)
    nearest = chord.min(axis=(2, 4))
    upper = nearest.min(axis=(1, 2))
    lower = nearest - (length_a[:, :, None] + length_b[:, None]) / 2 - ROUNDING_M
    found = np.where(upper < np.inf, upper, np.inf)
    close = lower.min(axis=(1, 2)) <= beyond_m
    row, i, j = np.nonzero((lower <= upper[:, None, None] + ROUNDING_M) & close[:, None, None])
    if not len(row):
        return found

    # From every point of one edge to the nearest of the other.
    edge_a, edge_b = one[row % len(one), i], two[row, j]
    start = chord[row, i, :, j].argmin(axis=2) / CELLS
    s = np.broadcast_to(share, start.shape)
    gap, _, _ = _nearest(globe, edge_a[:, None], edge_b[:, None], s, start)
    best = np.full(n, np.inf)
    np.minimum.at(best, row, gap.min(axis=1))
    padded = np.pad(gap, ((0, 0), (1, 1)), constant_values=np.inf)
    dip = (gap <= padded[:, :-2]) & (gap <= padded[:, 2:])
    dip &= gap - (np.broadcast_to(length_a, (n, one.shape[1]))[row, i])[:, None] <= best[row][:, None]
    pair, k = np.nonzero(dip)
    row, edge_a, edge_b = row[pair], edge_a[pair], edge_b[pair]

    # Where along the first edge that is least: the way to the nearest point is square to the edge there.
    low, high = share[np.maximum(k - 1, 0)], share[np.minimum(k + 1, CELLS)]
    t = start[pair, k]
    for _ in range(HALVINGS):
        middle_s = (low + high) / 2
        _, t, slope = _nearest(globe, edge_a, edge_b, middle_s, t, STEPS_ON)
        low, high = np.where(slope < 0.0, middle_s, low), np.where(slope < 0.0, high, middle_s)
    geodesic = _geodesic(globe)
    found[close] = np.inf
    for s in ((low + high) / 2, share[k]):
        _, t, _ = _nearest(globe, edge_a, edge_b, s, start[pair, k])
        (_, lon1, lat1, _), (_, lon2, lat2, _) = _points(globe, edge_a, s), _points(globe, edge_b, t)
        metres = geodesic.inv(np.degrees(lon1), np.degrees(lat1), np.degrees(lon2), np.degrees(lat2))[2]
        np.minimum.at(found, row, metres)
    return found


def _nearest(
    globe: Globe, edge_a: Floats, edge_b: Floats, s: Floats, t: Floats, steps: int = STEPS
) -> tuple[Floats, Floats, Floats]:
    """From points at s of edges a: the chord to the nearest point of edges b, and where (t) that is, looked for from t.

    And half the slope in s of the chord's square.
    """
    here, _, _, along = _points(globe, edge_a, s)
    for _ in range(steps):
        there, _, _, ahead = _points(globe, edge_b, t)
        square = (ahead**2).sum(axis=-1)
        move = ((here - there) * ahead).sum(axis=-1) / np.where(square > 0.0, square, 1.0)
        t = np.clip(t + move, 0.0, 1.0)
    between = here - _points(globe, edge_b, t)[0]
    return np.sqrt((between**2).sum(axis=-1)), t, (between * along).sum(axis=-1)


def _points(globe: Globe, edges: Floats, share: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Points at shares of edges (..., 2, 2) in space, their longitudes and latitudes (radians), and the way ahead."""
    step = (edges[..., 1, :] - edges[..., 0, :]) / globe.a
    at = edges[..., 0, :] / globe.a + share[..., None] * step
    lon, lat = at[..., 0], latitude_of_isometric(globe, at[..., 1])
    lon, lat = np.broadcast_arrays(lon, lat)
    sin, cos = np.sin(lat), np.cos(lat)
    normal = globe.a / np.sqrt(1.0 - globe.e2 * sin**2)
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros_like(lon)], axis=-1)
    out = np.stack([np.cos(lon), np.sin(lon), np.zeros_like(lon)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    point = (normal * cos)[..., None] * out + (normal * (1.0 - globe.e2) * sin)[..., None] * up
    north = cos[..., None] * up - sin[..., None] * out
    # The plane is conformal: a radian of either coordinate is `across` metres there.
    ahead = (normal * cos)[..., None] * (step[..., :1] * east + step[..., 1:] * north)
    return point, lon, lat, ahead


def latitude_of_isometric(globe: Globe, psi: Floats) -> Floats:
    """`Globe.latitude_of_isometric` by Newton's method: three steps instead of twelve."""
    e = np.sqrt(globe.e2)
    lat = np.arctan(np.sinh(psi))
    for _ in range(3 if globe.e2 else 0):
        sin = np.sin(lat)
        off = psi - np.arcsinh(np.tan(lat)) + e * np.arctanh(e * sin)
        lat = lat + off * np.cos(lat) * (1.0 - globe.e2 * sin**2) / (1.0 - globe.e2)
    return lat


@cache
def _geodesic(globe: Globe) -> Geod:
    return Geod(a=globe.a, b=globe.a * float(np.sqrt(1.0 - globe.e2)))
