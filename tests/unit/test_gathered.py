"""Gathered batches of bundles equal their concatenation, and each batch is freed."""

import gc
import weakref
from dataclasses import fields, replace
from itertools import chain
from typing import Any

import numpy as np
import pytest
from made_scenes import sea

from conflictdb import Scene
from conflictdb.arrays.gathered import GatheredBundles
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Bundles, Pieces
from conflictdb.core.pieces.bundling import bundles_of
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.registry import Setup, centred


@pytest.fixture(scope="module")
def batches() -> list[Bundles]:
    """Of areas, and of tracks."""
    areas, tracks = (list(chain.from_iterable(some)) for some in zip(*sea(400, 1), strict=True))
    setup = Setup.of(centred(Scene("s"), areas, tracks))
    none = AreaBatch.of([]), TrackBatch.of([])
    pieces = pieces_of(setup, AreaBatch.of(areas), none[1]), pieces_of(setup, none[0], TrackBatch.of(tracks))
    return [bundles_of(one) for one in pieces]


def gathered(batches: list[Bundles]) -> Bundles:
    found = GatheredBundles(batches[0])
    for batch in batches[1:]:
        found.add(batch)
    return found.bundles()


def assert_equal(one: Bundles, other: Bundles) -> None:
    np.testing.assert_array_equal(one.offset, other.offset)
    for column in fields(Pieces):
        mine, theirs = getattr(one.pieces, column.name), getattr(other.pieces, column.name)
        assert mine.dtype == theirs.dtype
        assert mine.flags.c_contiguous
        np.testing.assert_array_equal(mine, theirs)
    assert one.pieces.changes == other.pieces.changes


@pytest.mark.parametrize("times", [1, 2, 5])
@pytest.mark.parametrize("changing", [(), (0,), (1,), (0, 1)])
def test_gathered_batches_are_concatenated(batches: list[Bundles], times: int, changing: tuple[int, ...]) -> None:
    """Also if shapes of some batches change along their legs."""
    some = list(batches)
    for i in changing:
        pieces = some[i].pieces
        some[i] = Bundles(replace(pieces, shape_to_xy=2.0 * pieces.shape_xy), some[i].offset)
    assert_equal(gathered(some * times), Bundles.concatenate(some * times))


def test_a_batch_that_was_added_may_be_freed(batches: list[Bundles]) -> None:
    """No array of it is kept, unlike those of batches that wait until all can be concatenated."""
    found: GatheredBundles | None = None
    arrays: list[weakref.ref[Any]] = []
    for batch in batches:
        copy = batch.take(np.arange(len(batch)))
        arrays += [weakref.ref(getattr(copy.pieces, one.name)) for one in fields(Pieces)]
        if found is None:
            found = GatheredBundles(copy)
        else:
            found.add(copy)
        del copy
    gc.collect()
    assert found is not None
    assert not any(array() is not None for array in arrays)
    assert len(found.bundles()) == sum(map(len, batches))
