"""Objects of a scene where they are in its plane: what figures are drawn from. Plane coordinates in metres."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import PairRows
from conflictdb.arrays.pieces import PieceRows
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.movement import Movement
from conflictdb.model import Area, Scene, Track
from conflictdb.motion.registry import centred, plane_of
from conflictdb.pieces.covers import COVER, pieces_of
from conflictdb.results import Kind
from conflictdb.stage1_broad_phase import candidates, hulls_of
from conflictdb.stage2_intersection import intersections
from conflictdb.stage3_projection import windows

_Ints = NDArray[np.int64]
_TURN_DEG: Final = 360.0


class Sketch:
    """Areas and tracks of a scene, cut into pieces as a detection does, each whole and near the others on the page.

    Objects are numbered: the areas first, then the tracks, in the order given. Those that could not be cut have no
    shape (see `conflictdb.pieces.covers`).
    """

    def __init__(self, scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> None:
        self.scene = centred(scene, areas, tracks)
        self.plane = plane_of(self.scene)
        self.keys = [*(area.key for area in areas), *(track.key for track in tracks)]
        self._areas, self._tracks = areas, tracks
        self.pieces = pieces_of(self.scene, self.plane, AreaBatch.of(areas), TrackBatch.of(tracks))
        self._owner = self.pieces.object_id + np.where(self.pieces.kind == Kind.TRACK.code, len(areas), 0)
        self._prepared = kernel.Scene(self.plane.kernel_plane, self.pieces)
        self._shift_m = self._shifts()

    def is_track(self, number: int) -> bool:
        """Return whether an object is a track."""
        return number >= len(self._areas)

    def _shift(self, number: int) -> Floats:
        """Return by how much an object is moved on the page: whole turns of longitude, so that all are near."""
        return np.array([self._shift_m[number], 0.0])

    def outline(self, number: int) -> shapely.Geometry:
        """Return an area."""
        return self.on_page(self._areas[number].footprint, number)

    def on_page(self, shape: shapely.Geometry, number: int) -> shapely.Geometry:
        """Return a shape in degrees, beside an object."""
        return shapely.transform(shape, lambda deg: self._placed(deg, number))

    def way(self, number: int) -> Floats:
        """Return the waypoints (n, 2) of a track: straight in between."""
        rows = self.rows(number)
        _, first = np.unique(self.pieces.leg_start_us[rows], return_index=True)
        legs = rows[first]
        if not len(legs):
            return np.empty((0, 2))
        places = np.concatenate([self.pieces.leg_start_deg[legs], self.pieces.leg_end_deg[legs[-1:]]])
        return self._placed(places, number)

    def rows(self, number: int) -> PieceRows:
        """Return the pieces of an object that are no copies, in the order of its parts, and no cover of it."""
        known = (self._owner == number) & (self.pieces.turn == 0) & (self.pieces.part != COVER)
        return PieceRows(np.flatnonzero(known))

    def span_us(self, number: int) -> tuple[int, int]:
        """Return from when to when an object is there; SINCE_EVER_US, FOR_EVER_US where unbounded."""
        rows = np.flatnonzero(self._owner == number)
        return int(self.pieces.start_us[rows].min()), int(self.pieces.end_us[rows].max())

    def shape_at(self, number: int, at_us: int) -> shapely.Geometry | None:
        """Return where an object is at an instant: an area, or the haven of a track; None if it is not there."""
        start_us, end_us = self.span_us(number)
        if not start_us <= at_us <= end_us:
            return None
        if not self.is_track(number):
            return self.outline(number)
        rows = self.rows(number)
        rows = PieceRows(rows[(self.pieces.start_us[rows] <= at_us) & (at_us <= self.pieces.end_us[rows])][:1])
        if not len(rows):
            return None
        zero_us = self.pieces.start_us[rows]
        corners = Movement.of(self._prepared, rows, zero_us).positions((at_us - zero_us) / 1e6)[:, :, 0]
        return shapely.MultiPoint(corners.T + self._shift(number)).convex_hull

    def hulls(self, number: int) -> NDArray[np.object_]:
        """Return what the pieces of an object sweep (stage 1 and 2: padded convex hulls)."""
        return self._moved(hulls_of(self.pieces.take(self.rows(number))), number)

    def meetings(self, a: int, b: int) -> tuple[NDArray[np.object_], list[tuple[int, Floats]]]:
        """Return where stages 2 and 3 let two objects meet: the regions, and the projection lines.

        A projection line (2, 2) crosses the way of a track where its haven can first, or last, be in a region; with the
        number of the track.
        """
        rows, others = candidates(self.pieces)
        wanted = (np.minimum(self._owner[rows], self._owner[others]) == min(a, b)) & (
            np.maximum(self._owner[rows], self._owner[others]) == max(a, b)
        )
        pairs = intersections(self.pieces, PieceRows(rows[wanted]), PieceRows(others[wanted]), regions=True)
        pairs = pairs.take(PairRows(np.flatnonzero(self._is_whole(pairs.a) & self._is_whole(pairs.b))))
        rings = np.split(pairs.region_xy, pairs.region_offset[1:-1]) if len(pairs) else []
        first_s, last_s = windows(self.scene, self.plane, self._prepared, pairs)
        regions, lines = [], []
        for k, ring in enumerate(rings):
            if len(ring) < 3 or not first_s[k] <= last_s[k]:
                continue
            # The page shows the piece that is no copy.
            anchor = pairs.a[k] if self.pieces.turn[pairs.a[k]] == 0 else pairs.b[k]
            regions.append(shapely.Polygon(ring + self._shift(int(self._owner[anchor]))))
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
            middle = here + self._shift(number)
            found.append((number, np.stack([middle - 1.5 * reach * right, middle + 1.5 * reach * right])))
        return found

    def _placed(self, deg: Floats, number: int) -> Floats:
        return np.stack(self.plane.to_plane(deg[:, 0], deg[:, 1]), axis=1) + self._shift(number)

    def _is_whole(self, rows: PieceRows) -> NDArray[np.bool_]:
        return self.pieces.part[rows] != COVER

    def _moved(self, shapes: NDArray[np.object_], number: int) -> NDArray[np.object_]:
        return np.asarray(shapely.transform(shapes, lambda xy: xy + self._shift(number)))

    def _shifts(self) -> Floats:
        """Return (n,) the shifts that put all objects east of the widest gap of longitudes that they leave."""
        west = np.full(len(self.keys), np.nan)
        for number in range(len(self.keys)):
            lon = (
                self.pieces.leg_start_deg[self.rows(number), 0]
                if self.is_track(number)
                else shapely.get_coordinates(self._areas[number].footprint)[:, 0]
            )
            west[number] = lon.min() if len(lon) else np.nan
        if self.plane.turn_m == 0.0 or np.isnan(west).all():
            return np.zeros(len(west))
        around = np.sort(np.remainder(west[~np.isnan(west)], _TURN_DEG))
        gaps = np.diff(around, append=around[0] + _TURN_DEG)
        first = around[(int(np.argmax(gaps)) + 1) % len(around)]
        turns = np.floor((west - first) / _TURN_DEG + 1e-12)
        # As near to the usual longitudes as may be.
        turns += np.round((first + np.nanmean(west - turns * _TURN_DEG - first)) / _TURN_DEG)
        return np.where(np.isnan(west), 0.0, -turns * self.plane.turn_m)
