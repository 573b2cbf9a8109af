"""Rings of polygons as files have them: long sides, the antimeridian, and the poles."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.earth.geodesy import MEAN_RADIUS_M, WGS84_RADIUS_M
from conflictdb.earth.registry import Setup
from conflictdb.formats.contents import Remark
from conflictdb.formats.hints import scene_read_for
from conflictdb.model.plans import LINES, Area, Motion

Floats = NDArray[np.float64]

# The least tolerance that counts: lines of the scene may deviate by this from sides straight in longitude and latitude.
DEVIATION_M: Final = 1.0
# Vertices of a ring beyond which its sides stay as they are.
MOST_VERTICES: Final = 1_000
_HALF_TURN_DEG: Final = 180.0
_POLE_DEG: Final = 89.999
# Beyond this latitude the formula of the deviation is of no use.
_HIGHEST_DEG: Final = 89.0


class LongSides:
    """Sides of rings that the standard of their file draws straight in longitude and latitude, not as the scene does.

    A scene draws rhumb lines or great circles.
    """

    def __init__(self) -> None:
        self._changed: list[str] = []
        self._kept: list[tuple[float, str]] = []
        self._lines = ""

    def straight(self, key: str, footprint: shapely.MultiPolygon) -> shapely.MultiPolygon:
        """Return a footprint with vertices along long sides, so that lines of the scene deviate by half its tolerance.

        The tolerance counts as at least DEVIATION_M. A ring that would have more than MOST_VERTICES stays as it is.
        """
        if footprint.is_empty or not np.isfinite(shapely.get_coordinates(footprint)).all():
            return footprint  # refused later
        kind, lonlat, (of_rings, *within) = shapely.to_ragged_array([footprint])
        changed, of_changed = self.straight_rings([key], lonlat, of_rings, np.zeros(len(of_rings) - 1, np.int64))
        if changed is lonlat:
            return footprint
        whole: shapely.MultiPolygon = shapely.from_ragged_array(kind, changed, (of_changed, *within))[0]
        return whole

    def straight_rings(
        self, keys: Sequence[str], lonlat: Floats, offset: NDArray[np.int64], owner: NDArray[np.int64]
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Return the rings of many footprints as `straight` does, and their offsets; the same arrays if none changes.

        lonlat : (v, 2) finite, of all rings; ring i has the positions [offset[i], offset[i + 1])
        owner : (n,) the place of the key of each ring
        """
        last, first = offset[1:] - 1, offset[:-1]
        with np.errstate(all="ignore"):  # coordinates beyond the earth are refused later
            far_m = {motion: of(lonlat) for motion, of in _DEVIATIONS_M.items()}
        between = last[:-1]  # from one ring to the next
        for one in far_m.values():
            one[between] = 0.0
        if not any((one > DEVIATION_M).any() for one in far_m.values()):
            return lonlat, offset
        scene = scene_read_for()
        most_m = max(DEVIATION_M, scene.tolerance_m)
        deviation_m = np.append(far_m[scene.motion], 0.0)
        farthest_m = np.maximum.reduceat(deviation_m, first)
        ring = np.repeat(np.arange(len(first)), np.diff(offset))
        wanted = np.ceil(np.sqrt(np.nan_to_num(deviation_m) / (0.5 * most_m)))
        parts = np.clip(wanted, 1.0, MOST_VERTICES + 1.0).astype(np.int64)
        is_long = farthest_m > most_m
        # The last position of a ring is one part.
        is_kept = is_long & (np.add.reduceat(parts, first) - 1 > MOST_VERTICES)
        parts[~(is_long & ~is_kept)[ring]] = 1
        for i in np.unique(owner[is_kept]).tolist():
            self._kept.append((float(farthest_m[is_kept & (owner == i)].max()), keys[i]))
            self._lines = LINES[scene.motion]
        is_changed = is_long & ~is_kept
        if not is_changed.any():
            return lonlat, offset
        self._changed += [keys[i] for i in np.unique(owner[is_changed]).tolist()]
        side = np.repeat(np.arange(len(lonlat)), parts)
        share = (np.arange(len(side)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[side]
        step = np.append(np.diff(lonlat, axis=0), np.zeros((1, 2)), axis=0)
        straight = np.where((share > 0.0)[:, None], lonlat[side] + share[:, None] * step[side], lonlat[side])
        return straight, np.append(0, np.cumsum(np.add.reduceat(parts, first)))

    def remarks(self, source: str) -> Iterator[Remark]:
        """Yield remarks on the footprints that were changed, and on those that were not."""
        if self._changed:
            text = f"{len(self._changed):,} areas have long sides, straight in longitude and latitude by the standard"
            why = f"vertices are added along them, which exports have, such as of {self._changed[0]:.60}"
            yield Remark(source, "file", f"{text}: {why}")
        if self._kept:
            worst_m, key = max(self._kept)
            text = (
                f"{len(self._kept):,} areas have so long sides that they are taken as {self._lines}, not as straight in"
            )
            yield Remark(source, "file", f"{text} longitude and latitude: they differ by {worst_m:,.0f} m in {key:.60}")


def along_lines(setup: Setup, footprint: shapely.MultiPolygon) -> shapely.MultiPolygon:
    """Return a footprint for formats whose sides are straight in longitude and latitude; itself if it needs no change.

    It has vertices along sides that deviate from the lines of the scene by more than DEVIATION_M, but for rings that
    would have more than MOST_VERTICES.
    """
    is_changed = False

    def along(ring: Floats) -> Floats:
        nonlocal is_changed
        deviation_m = _DEVIATIONS_M[setup.scene.motion](ring)
        places = _places(deviation_m, DEVIATION_M) if (deviation_m > DEVIATION_M).any() else None
        if places is None:
            return ring
        is_changed = True
        straight = _between(ring, *places)
        flat = np.column_stack(setup.plane.to_plane(*ring.T))
        added = np.column_stack(setup.plane.from_plane(*_between(flat, *places).T))
        added[:, 0] += 360.0 * np.round((straight[:, 0] - added[:, 0]) / 360.0)
        return np.where(np.append(places[1] == 0.0, True)[:, None], straight, added)

    changed = _of_rings(footprint, along)
    return changed if is_changed else footprint


def _of_rings(footprint: shapely.MultiPolygon, along: Callable[[Floats], Floats]) -> shapely.MultiPolygon:
    return shapely.MultiPolygon(
        [
            shapely.Polygon(
                along(shapely.get_coordinates(part.exterior)),
                [along(shapely.get_coordinates(ring)) for ring in part.interiors],
            )
            for part in footprint.geoms
        ]
    )


def _places(deviation_m: Floats, most_m: float) -> tuple[NDArray[np.int64], Floats] | None:
    """Return the sides of the vertices of a ring, and where along them; None: they would be more than MOST_VERTICES.

    The parts of a side deviate by at most half of `most_m`.
    """
    parts = np.maximum(np.ceil(np.sqrt(deviation_m / (0.5 * most_m))), 1.0).astype(np.int64)
    if parts.sum() > MOST_VERTICES:
        return None
    side = np.repeat(np.arange(len(parts)), parts)
    return side, (np.arange(len(side)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[side]


def _between(ring: Floats, side: NDArray[np.int64], share: Floats) -> Floats:
    return np.concatenate([ring[side] + share[:, None] * np.diff(ring, axis=0)[side], ring[-1:]])


def _from_rhumb_lines_m(ring: Floats) -> Floats:
    """Return how far the sides of a ring (n, 2) are from rhumb lines between its vertices, metres, at most (n - 1,).

    Where the latitude changes evenly with the longitude, the isometric latitude does not: by 1/8 of its second
    derivative, sec(lat) tan(lat), times the square of the change.
    """
    lon, lat = np.radians(ring).T
    east, north = np.abs(np.diff(lon)), np.abs(np.diff(lat))
    highest = np.maximum(np.abs(lat[:-1]), np.abs(lat[1:]))
    middle = 0.5 * (lat[:-1] + lat[1:])
    slope = east / np.maximum(np.hypot(east, north / np.cos(middle)), 1e-300)
    found = WGS84_RADIUS_M * north**2 * np.tan(np.minimum(highest, np.radians(_HIGHEST_DEG))) / 8.0 * slope
    return np.where(highest > np.radians(_HIGHEST_DEG), 0.0, found)


def _from_great_circles_m(ring: Floats) -> Floats:
    """Return how far the sides of a ring (n, 2) are from great circles between its vertices, metres, at most (n - 1,).

    By the geodesic curvature of a line straight in longitude and latitude, tan(lat) sin(azimuth) (1 + cos(azimuth)^2).
    """
    lon, lat = np.radians(ring).T
    east, north = np.abs(np.diff(lon)), np.abs(np.diff(lat))
    highest = np.maximum(np.abs(lat[:-1]), np.abs(lat[1:]))
    lowest = np.where(lat[:-1] * lat[1:] <= 0.0, 0.0, np.minimum(np.abs(lat[:-1]), np.abs(lat[1:])))
    widest = np.maximum(np.hypot(north, np.cos(lowest) * east), 1e-300)
    steepest = north / np.maximum(np.hypot(north, np.cos(highest) * east), 1e-300)
    curvature = np.tan(np.minimum(highest, np.radians(_HIGHEST_DEG))) * np.cos(lowest) * east / widest
    found = MEAN_RADIUS_M * curvature * (1.0 + steepest**2) * widest**2 / 8.0
    return np.where(highest > np.radians(_HIGHEST_DEG), 0.0, found)


_DEVIATIONS_M: Final = {Motion.RHUMB: _from_rhumb_lines_m, Motion.GREAT_CIRCLE: _from_great_circles_m}


class HalfTurns:
    """Areas with sides of more than half a turn of longitude, which are probably meant the other way."""

    def __init__(self) -> None:
        self._keys: list[str] = []
        self._around_poles: list[str] = []

    def add(self, areas: Iterable[Area]) -> None:
        """Check some areas; sides along a pole may be of any length."""
        for area in areas:
            west, south, east, north = area.footprint.bounds
            if east - west <= _HALF_TURN_DEG:
                continue
            sides = [
                np.abs(np.diff(ring[:, 0])) * (np.abs(ring[:-1, 1]) < _POLE_DEG) * (np.abs(ring[1:, 1]) < _POLE_DEG)
                for ring in map(shapely.get_coordinates, _rings(area.footprint))
            ]
            if max(float(one.max(initial=0.0)) for one in sides) > _HALF_TURN_DEG:
                (self._around_poles if max(-south, north) > _POLE_DEG else self._keys).append(area.key)

    def remarks(self, source: str) -> Iterator[Remark]:
        """Yield one remark for each of the two kinds."""
        if self._keys:
            text = f"{len(self._keys):,} areas have sides of more than 180 degrees, such as {self._keys[0]!r:.60}"
            rule = (
                "an area across the antimeridian is cut there (RFC 7946, 3.1.9), or has longitudes beyond 180 degrees"
            )
            yield Remark(source, "file", f"{text}: they lead the long way round, and {rule}")
        if self._around_poles:
            text = f"{len(self._around_poles):,} areas around a pole, such as {self._around_poles[0]!r:.60}, have sides"
            rule = "only the sides along latitude 90 may be so long; give the others vertices at most 90 degrees apart"
            yield Remark(source, "file", f"{text} of more than 180 degrees of longitude: {rule}")


def _rings(footprint: shapely.MultiPolygon) -> Iterator[shapely.LinearRing]:
    for part in footprint.geoms:
        yield part.exterior
        yield from part.interiors
