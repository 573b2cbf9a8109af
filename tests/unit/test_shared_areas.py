"""Areas of many parts that share edges are put together, whatever rounding did to the corners of the parts."""

import logging
from dataclasses import replace

import numpy as np
import pytest
import shapely

from conflictdb import Area, Scene
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.shared_areas import common_area
from conflictdb.earth.registry import Setup


def star(rng: np.random.Generator, lon: float, lat: float, corners: int) -> shapely.MultiPolygon:
    """A polygon with many parts."""
    angle, reach = np.sort(rng.uniform(0, 2 * np.pi, corners)), rng.uniform(0.1, 0.5, corners)
    ring = np.stack([lon + reach * np.cos(angle), lat + reach * np.sin(angle)], axis=1)
    return shapely.MultiPolygon([shapely.Polygon(ring)])


def moved(rng: np.random.Generator, pieces: Pieces, by_m: float) -> Pieces:
    """The pieces with each corner of each part elsewhere: parts that shared an edge overlap, or leave a gap."""
    xy = pieces.shape_xy + rng.uniform(-by_m, by_m, pieces.shape_xy.shape)
    return replace(pieces, shape_xy=xy, shape_to_xy=xy)


@pytest.mark.parametrize("by_m", [0.0, 1e-10, 1e-9, 1e-8, 1e-7])
def test_areas_whose_parts_differ_by_rounding_keep_their_intersection(
    by_m: float, caplog: pytest.LogCaptureFixture
) -> None:
    rng, setup = np.random.default_rng(4), Setup.of(Scene("s"))
    for number in range(12):
        one = star(rng, 5.0, 50.0, 40 + number)
        # Two stars, or a part of the first one, with which it shares edges.
        other = star(rng, 5.1, 50.0, 60) if number % 2 else shapely.intersection(one, shapely.box(4.9, 49.9, 5.6, 50.6))
        areas = [Area("a", one), Area("b", other)]
        pieces = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of([]))
        a, b = (PieceRows(np.flatnonzero(pieces.object_id == k)) for k in (0, 1))
        exact = common_area(setup.plane, pieces, a, b)
        found = common_area(setup.plane, moved(rng, pieces, by_m), a, b)
        length_m = shapely.length(exact) + sum(
            shapely.length(shapely.polygons(pieces.shape_xy[first:last]))
            for first, last in zip(pieces.shape_offset[:-1], pieces.shape_offset[1:], strict=True)
        )
        assert shapely.is_valid(found)
        assert shapely.area(shapely.symmetric_difference(exact, found)) <= (by_m + 2e-6) * length_m
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_parts_that_overlap_are_put_together() -> None:
    """As hulls of an object that cannot be cut do."""
    setup = Setup.of(Scene("s"))
    rng = np.random.default_rng(8)
    areas = [Area(f"{n}", star(rng, 5.0 + 0.01 * n, 50.0, 12)) for n in range(6)]
    pieces = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of([]))
    every = PieceRows(np.arange(len(pieces)))
    parts = [
        shapely.polygons(pieces.shape_xy[first:last])
        for first, last in zip(pieces.shape_offset[:-1], pieces.shape_offset[1:], strict=True)
    ]
    found = common_area(setup.plane, pieces, every, every)
    assert shapely.area(found) == pytest.approx(shapely.area(shapely.union_all(parts)), rel=1e-9)
