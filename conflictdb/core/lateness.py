"""How late tracks are: the delays at which a haven contains a position, by the narrow phase of delays.

A position is a small area, a disc of its error, that exists at its instant alone. A track that is late by d contains it
if the track, departing d later, is in contact with that area: `core.delays` says for which d.
"""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.objects import Activations, AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.core.delays import Spans, delays_of_pairs
from conflictdb.core.pieces.covers import COVER, pieces_of
from conflictdb.earth.geodesy import great_circle_distance
from conflictdb.earth.registry import Setup
from conflictdb.earth.shortest_lines import places_at
from conflictdb.kernel.boxes import BoxTree, RowBoxes, boxes_of

_Ints = NDArray[np.int64]
_NO_TRACKS: Final = TrackBatch.of([])
# A disc is a polygon of 16 corners on a circle that is 2 % wider.
_CORNERS: Final = 16
# The least radius of a disc, metres: more than places are rounded by.
_LEAST_ERROR_M: Final = 0.01
# How thick a disc with a height is, metres.
_THICK_M: Final = 1e-6


class Positions(NamedTuple):
    """n positions of tracks.

    track : (n,) ids
    at_us : (n,) instants, microseconds
    lonlat : (n, 2) degrees
    height_m : (n,) NaN where unknown
    error_m : (n,) how far off the places may be
    """

    track: _Ints
    at_us: _Ints
    lonlat: Floats
    height_m: Floats
    error_m: Floats

    def take(self, rows: _Ints | slice) -> "Positions":
        """Return some positions."""
        return Positions(self.track[rows], self.at_us[rows], self.lonlat[rows], self.height_m[rows], self.error_m[rows])


def lateness_of(setup: Setup, pieces: Pieces, positions: Positions) -> list[Spans]:
    """Return how late a track may be that is at a position, for each (n,): whole microseconds, negative: early.

    No interval: its haven contains the position at no time.

    setup : without separations, which the pieces were made with
    pieces : of the tracks, by their ids
    """
    discs = _discs(setup, positions)
    # A disc that leaves the plane is a cover, which meets everything: that says nothing about where the track is.
    discs = discs.take(np.flatnonzero(discs.part != COVER))
    both = Pieces.concatenate([pieces, discs])
    # A late track is elsewhere in its own time. Tracks take the place of times: a disc meets its own track, whenever.
    track = np.concatenate([pieces.object_id, positions.track[discs.object_id]])
    rows = replace(RowBoxes.of(both, boxes_of(both)), start_us=2 * track, end_us=2 * track + 1)
    disc, own = BoxTree(rows.take(np.arange(len(pieces)))).pairs(rows.take(np.arange(len(pieces), len(both))))
    a, b = PieceRows(own), PieceRows(len(pieces) + disc)
    if not len(a):
        return [Spans.union(a, a) for _ in range(len(positions.at_us))]
    number = np.concatenate([np.full(len(pieces), -1), discs.object_id])
    at_us = positions.at_us[number[b]]
    horizon_us = int(np.maximum(abs(both.end_us[a] - at_us), abs(at_us - both.start_us[a])).max()) + 1
    prepared = kernel.KernelScene(setup.plane.kernel_plane, both, a, b)
    found = delays_of_pairs(setup.scene, prepared, number, a, b, horizon_us, threads=1)
    order = np.argsort(found.other, kind="stable")
    cuts = np.searchsorted(found.other[order], np.arange(1, len(positions.at_us)))
    return [Spans.union(found.low[rows], found.high[rows]) for rows in np.split(order, cuts)]


def distances_off_m(setup: Setup, pieces: Pieces, positions: Positions) -> Floats:
    """Return how far positions (n,) are, less their errors, from all that the havens of their tracks sweep.

    Metres by the scale of the map at the position, or, where the map has no place for it, along a great circle; 0 where
    only the height differs; NaN for a track without pieces.
    """
    found = np.full(len(positions.at_us), np.nan)
    x, y, is_placed = setup.plane.project(positions.lonlat[:, 0], positions.lonlat[:, 1])
    scale = setup.plane.largest_scale(np.stack([x, y])[:, None])
    turn_m = setup.plane.turn_m
    for k, track in enumerate(positions.track.tolist()):
        rows = np.flatnonzero(pieces.object_id == track)
        if not rows.size:
            continue
        offset, index = ragged_rows(pieces.hull_offset, rows)
        if not is_placed[k]:
            lon, lat = setup.plane.from_plane(*pieces.hull_xy[index].T)
            away_m = great_circle_distance(positions.lonlat[k, 0], positions.lonlat[k, 1], lon, lat).min()
            found[k] = max(0.0, away_m - positions.error_m[k])
            continue
        hulls = shapely.union_all([shapely.Polygon(ring) for ring in np.split(pieces.hull_xy[index], offset[1:-1])])
        shifts = (-turn_m, 0.0, turn_m) if turn_m else (0.0,)
        away_m = min(shapely.distance(hulls, shapely.Point(x[k] + shift, y[k])) for shift in shifts)
        found[k] = max(0.0, away_m / scale[k] - positions.error_m[k])
    return found


def _discs(setup: Setup, positions: Positions) -> Pieces:
    """Return the pieces of positions, numbered from 0."""
    n = len(positions.at_us)
    radius_m = 1.001 * np.maximum(positions.error_m, _LEAST_ERROR_M) / np.cos(np.pi / _CORNERS)
    azimuth = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    lon_deg, lat_deg = positions.lonlat[:, :1], positions.lonlat[:, 1:]
    lon, lat = places_at(lon_deg, lat_deg, radius_m[:, None], azimuth, setup.scene.earth)
    rings = shapely.polygons(np.stack([lon, lat], axis=2))
    unknown = np.isnan(positions.height_m)
    areas = AreaBatch(
        np.arange(n),
        np.ones(n, np.int64),
        np.array(shapely.multipolygons(rings[:, None]), object).reshape(-1),
        Activations.once(np.stack([positions.at_us, positions.at_us + 1], axis=1)),
        np.where(unknown, -np.inf, positions.height_m),
        np.where(unknown, np.inf, positions.height_m + _THICK_M),
        np.zeros((n, AreaBatch.of([]).numbers.shape[1]), np.int64),
    )
    return pieces_of(setup, areas, _NO_TRACKS)
