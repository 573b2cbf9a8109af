"""Objects of a scene in its plane, from which figures are drawn. Plane coordinates in metres."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.pairs import PairRows
from conflictdb.arrays.pieces import PieceRows
from conflictdb.core.climbs import bands_at
from conflictdb.core.near import Memory, Question
from conflictdb.core.pieces.covers import COVER
from conflictdb.core.published.stage3_projection import windows
from conflictdb.core.stage1_broad_phase import hulls_of
from conflictdb.core.stage2_intersection import intersections
from conflictdb.core.world import World, occupy
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Kind, distinct_labels

_Ints = NDArray[np.int64]
_TURN_DEG: Final = 360.0


class Sketch:
    """Areas and tracks of a scene, cut into pieces as a detection does, each whole and near the others on the page.

    Objects are numbered: the areas first, then the tracks, in the order given. Those that could not be cut have no
    shape (see `conflictdb.core.pieces.covers`).
    """

    def __init__(self, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> None:
        world = World.around(scene, areas, tracks)
        self.setup = world.setup
        self.keys = [*(area.key for area in areas), *(track.key for track in tracks)]
        objects: list[Area | Track] = [*areas, *tracks]
        labels = distinct_labels({one.key: one.name for one in objects})
        self.labels = [labels[key] for key in self.keys]
        self._areas, self._tracks = areas, tracks
        self.pieces = occupy(world, areas, tracks, is_lenient=True).pieces
        self._owner = self.pieces.object_id + np.where(self.pieces.kind == Kind.TRACK.code, len(areas), 0)
        self._prepared = kernel.KernelScene(self.setup.plane.kernel_plane, self.pieces)
        self._middle_m = self._middles()

    def is_track(self, number: int) -> bool:
        """Return whether an object is a track."""
        return number >= len(self._areas)

    def outline(self, number: int) -> shapely.Geometry:
        """Return an area."""
        return self.on_page(self._areas[number].footprint, number)

    def on_page(self, shape: shapely.Geometry, number: int) -> shapely.Geometry:
        """Return a shape in degrees, on the turn of an object."""
        parts = [self._beside(shapely.transform(part, self._in_plane), number) for part in shapely.get_parts(shape)]
        return parts[0] if len(parts) == 1 else shapely.union_all(parts)

    def way(self, number: int) -> Floats:
        """Return the waypoints (n, 2) of a track: straight in between."""
        places = self._waypoints_deg(number)
        return places if not len(places) else self._moved(self._in_plane(places), number)

    def rows(self, number: int) -> PieceRows:
        """Return the pieces of an object that are no copies, in the order of its parts, and no cover of it."""
        known = (self._owner == number) & (self.pieces.turn == 0) & (self.pieces.part != COVER)
        return PieceRows(np.flatnonzero(known))

    def span_us(self, number: int) -> tuple[int, int]:
        """Return from when to when an object is there; MINUS_INFINITY_US, INFINITY_US where unbounded."""
        rows = np.flatnonzero(self._owner == number)
        return int(self.pieces.start_us[rows].min()), int(self.pieces.end_us[rows].max())

    def heights_m(self, number: int, at_us: _Ints) -> tuple[Floats, Floats]:
        """Return (floor, ceiling) of an object at instants (n,), metres; infinite if unbounded, NaN if not there.

        As of its pieces: with half of the scene's vertical separation on either side.
        """
        rows = self.rows(number)
        rows = rows if self.is_track(number) else PieceRows(rows[:1])
        floor, ceiling = np.full(len(at_us), np.nan), np.full(len(at_us), np.nan)
        for row in rows:
            there = (self.pieces.start_us[row] <= at_us) & (at_us <= self.pieces.end_us[row])
            of_row = PieceRows(np.full(int(there.sum()), row))
            low, high = bands_at(self.pieces, of_row, at_us[there])
            floor[there], ceiling[there] = np.fmin(floor[there], low), np.fmax(ceiling[there], high)
        return floor, ceiling

    def shape_at(self, number: int, at_us: int) -> shapely.Geometry | None:
        """Return where an object is at an instant: an area, or the haven of a track; None if it is not there."""
        start_us, end_us = self.span_us(number)
        if not start_us <= at_us <= end_us:
            return None
        if not self.is_track(number):
            return self.outline(number)
        rows = self.rows(number)
        rows = PieceRows(rows[(self.pieces.start_us[rows] <= at_us) & (at_us <= self.pieces.end_us[rows])])
        if not len(rows):
            return None
        # With tolerances a track has several parts at one time.
        parts = rows[:1] if self._tracks[number - len(self._areas)].tolerances is None else rows
        shapes = [self._part_at(PieceRows(parts[[k]]), at_us) for k in range(len(parts))]
        return self._beside(shapely.union_all(shapes), number)

    def _part_at(self, row: PieceRows, at_us: int) -> shapely.Geometry:
        zero_us = self.pieces.start_us[row]
        corners = Movement.of(self._prepared, row, zero_us).positions((at_us - zero_us) / 1e6)[:, :, 0]
        return shapely.MultiPoint(corners.T).convex_hull

    def hulls(self, number: int) -> NDArray[np.object_]:
        """Return the swept hulls of the pieces of an object (stages 1 and 2: padded, convex)."""
        hulls = hulls_of(self.pieces.take(self.rows(number)))
        return np.array([self._beside(hull, number) for hull in hulls], dtype=object)

    def meetings(self, a: int, b: int) -> tuple[NDArray[np.object_], list[tuple[int, Floats]]]:
        """Return where stages 2 and 3 let two objects meet: the regions, and the projection lines.

        A projection line (2, 2) crosses the way of a track where its haven can first, or last, be in a region; with the
        number of the track.
        """
        rows, others = Memory(self.pieces).rows(Question())
        wanted = (np.minimum(self._owner[rows], self._owner[others]) == min(a, b)) & (
            np.maximum(self._owner[rows], self._owner[others]) == max(a, b)
        )
        pairs = intersections(self.pieces, PieceRows(rows[wanted]), PieceRows(others[wanted]), regions=True)
        pairs = pairs.take(PairRows(np.flatnonzero(self._is_whole(pairs.a) & self._is_whole(pairs.b))))
        rings = np.split(pairs.region_xy, pairs.region_offset[1:-1]) if len(pairs) else []
        first_s, last_s = windows(self.setup, self._prepared, pairs)
        regions, lines = [], []
        for k, ring in enumerate(rings):
            if len(ring) < 3 or not first_s[k] <= last_s[k]:
                continue
            regions.append(self._beside(shapely.Polygon(ring), int(self._owner[pairs.a[k]])))
            zero_us = self.pieces.shared_span(PieceRows(pairs.a[k : k + 1]), PieceRows(pairs.b[k : k + 1]))[0]
            for piece in (pairs.a[k], pairs.b[k]):
                if self.pieces.kind[piece] == Kind.TRACK.code:
                    lines += self._across(PieceRows(np.array([piece])), zero_us, (first_s[k], last_s[k]))
        return np.array(regions, dtype=object), lines

    def _across(self, piece: PieceRows, zero_us: _Ints, seconds: tuple[float, float]) -> list[tuple[int, Floats]]:
        """Return lines across the way of a piece of a track, as long as its haven is wide, where it is at times."""
        number = int(self._owner[piece[0]])
        moving = Movement.of(self._prepared, piece, zero_us)
        found = []
        for second in seconds:
            at = np.array([second])
            corners, (velocity,) = moving.positions(at)[:, :, 0], moving.bounds(at, at).velocity.T
            here = moving.reference(at)[:, 0]
            speed = float(np.hypot(*velocity))
            if speed == 0.0:
                continue
            right = np.array([velocity[1], -velocity[0]]) / speed
            reach = float(np.abs(right @ (corners - here[:, None])).max())
            middle = self._moved(here[None], number)[0]
            found.append((number, np.stack([middle - 1.5 * reach * right, middle + 1.5 * reach * right])))
        return found

    def _in_plane(self, deg: Floats) -> Floats:
        return np.stack(self.setup.plane.to_plane(deg[:, 0], deg[:, 1]), axis=1)

    def _waypoints_deg(self, number: int) -> Floats:
        """Return the waypoints (n, 2) of a track, longitudes running on across the date line."""
        rows = self.rows(number)
        _, first = np.unique(self.pieces.leg_start_us[rows], return_index=True)
        legs = rows[first]
        if not len(legs):
            return np.empty((0, 2))
        # A leg may end a turn further than the next one starts.
        places = np.concatenate([self.pieces.leg_start_deg[legs], self.pieces.leg_end_deg[legs[-1:]]])
        places[:, 0] = np.unwrap(places[:, 0], period=_TURN_DEG)
        return places

    def _moved(self, xy: Floats, number: int) -> Floats:
        """Return places (n, 2) of an object moved by whole turns of longitude, to where the object is on the page."""
        if self.setup.plane.turn_m == 0.0:
            return xy
        middle = 0.5 * (xy[:, 0].min() + xy[:, 0].max())
        turns = np.round((self._middle_m[number] - middle) / self.setup.plane.turn_m)
        return xy + np.array([turns * self.setup.plane.turn_m, 0.0])

    def _beside(self, shape: shapely.Geometry, number: int) -> shapely.Geometry:
        return shapely.transform(shape, lambda xy: self._moved(xy, number))

    def _is_whole(self, rows: PieceRows) -> NDArray[np.bool_]:
        return self.pieces.part[rows] != COVER

    def _span_deg(self, number: int) -> tuple[float, float]:
        """Return from which longitude to which an object reaches; NaN where it has no shape."""
        if self.is_track(number):
            lon = self._waypoints_deg(number)[:, 0]
            return (lon.min(), lon.max()) if len(lon) else (np.nan, np.nan)
        # Parts of an area that is cut at the date line belong side by side.
        bounds = shapely.bounds(shapely.get_parts(self._areas[number].footprint))
        middle = 0.5 * (bounds[:, 0] + bounds[:, 2])
        turns = np.round((middle[0] - middle) / _TURN_DEG) * _TURN_DEG
        return (bounds[:, 0] + turns).min(), (bounds[:, 2] + turns).max()

    def _middles(self) -> Floats:
        """Return (n,) where the middle of each object is on the page: east of the widest gap in longitude."""
        west, east = np.array([self._span_deg(number) for number in range(len(self.keys))]).reshape(-1, 2).T
        if self.setup.plane.turn_m == 0.0 or np.isnan(west).all():
            return np.zeros(len(west))
        around = np.sort(np.remainder(west[~np.isnan(west)], _TURN_DEG))
        gaps = np.diff(around, append=around[0] + _TURN_DEG)
        first = around[(int(np.argmax(gaps)) + 1) % len(around)]
        turns = np.floor((west - first) / _TURN_DEG + 1e-12)
        # As near to the usual longitudes as may be.
        turns += np.round(np.nanmean(west - turns * _TURN_DEG) / _TURN_DEG)
        middle = 0.5 * (west + east) / _TURN_DEG - turns
        return np.where(np.isnan(west), 0.0, middle * self.setup.plane.turn_m)
