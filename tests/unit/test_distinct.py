"""Distinct values, addresses of arrays, and legs that a check computes are those of the plain way."""

from dataclasses import fields

import numpy as np
import pytest
from layouts import ARCTIC, HARBOUR, LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene

from conflictdb.arrays.distinct import distinct, is_in
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.pieces.cutting import check_plane
from conflictdb.earth.registry import Setup, centred
from conflictdb.kernel.library import address


@pytest.mark.parametrize("n", [0, 1, 2, 7, 500])
def test_distinct_values_are_those_of_numpy(n: int) -> None:
    rng = np.random.default_rng(n)
    for most in (1, 5, 2**62):
        values, others = (rng.integers(-most, most, size) for size in (n, int(rng.integers(0, 20))))
        known, place = distinct(values)
        expected, inverse = np.unique(values, return_inverse=True)
        assert np.array_equal(known, expected)
        assert np.array_equal(place, inverse)
        assert np.array_equal(is_in(values, others), np.isin(values, others))


def test_addresses_are_those_of_numpy() -> None:
    frozen = np.arange(3)
    frozen.setflags(write=False)
    for array in (np.arange(4.0), np.arange(9)[3:6], np.ones(2, np.bool_), frozen, np.zeros(2, "M8[us]")):
        assert address(array) == array.ctypes.data
    assert isinstance(address(np.empty(0)), int)


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, OCEAN, HARBOUR, ARCTIC])
def test_pieces_of_checked_plans_are_those_of_plans(workload: Workload) -> None:
    for seed in range(4):
        scene, areas, tracks = plain_scene(workload, seed, 6, 8)
        scene = centred(scene, areas, tracks)
        setup = Setup.of(scene)
        flat, once = check_plane(setup.plane, areas, tracks)
        assert once is not None
        assert once.legs is not None
        known = pieces_of(setup, AreaBatch.of(areas, flat), once.departing(tracks))
        plain = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of(tracks))
        for column in fields(Pieces):
            one, other = (getattr(pieces, column.name) for pieces in (known, plain))
            assert one.dtype == other.dtype, column.name
            assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f"), column.name
