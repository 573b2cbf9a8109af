"""Cells of space and time, in which the pieces of a scene are joined."""

import numpy as np
import pytest

from conflictdb.spark.work_units import Cells, blocks_for, two_blocks


def boxes(rng: np.random.Generator, count: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Boxes of some size, thrown into the unit cube."""
    low = rng.uniform(0.0, 1.0, (count, 3))
    return low, low + rng.uniform(0.0, size, (count, 3))


def test_every_place_is_in_one_cell() -> None:
    """Cells fill space and time, also far outside of the sample, and do not overlap."""
    rng = np.random.default_rng(1)
    low, high = boxes(rng, 3_000, 0.4)
    low[:40, 2], high[:40, 2] = -(2.0**63), 2.0**63  # there for ever
    cells = Cells.of(low, high, 1.0, 100)
    places = np.concatenate([rng.uniform(-0.5, 1.5, (3_000, 3)), low, cells.low[np.isfinite(cells.low).all(axis=1)]])
    within = ((places[:, None] >= cells.low) & (places[:, None] < cells.high)).all(axis=2)
    assert len(cells.low) > 30
    assert (within.sum(axis=1) == 1).all()


def test_a_crowd_is_dealt_into_blocks() -> None:
    """A cell with 2,000 pieces is cut into blocks until its units are as large as others; other cells are one block."""
    rng = np.random.default_rng(2)
    low, high = boxes(rng, 10_000, 0.01)
    low[:2_000], high[:2_000] = 0.4, 0.5
    cells = Cells.of(low, high, 1.0, 50)
    crowded = ((cells.low <= 0.4) & (cells.high > 0.4)).all(axis=1)
    assert cells.pairs == pytest.approx(2_000**2 / 2, rel=0.2)
    assert 9 <= cells.blocks[crowded][0] <= 10  # 50 units of two blocks
    assert (cells.blocks[~crowded] == 1).all()


def test_units_are_twos_of_blocks() -> None:
    """Each two blocks of a cell, and each one, are a unit of its own, counted through all cells."""
    whole = np.full((3, 3), np.inf)
    cells = Cells(-whole, whole, np.array([2, 1, 3]), 0.0)
    assert cells.first_unit.tolist() == [0, 3, 4, 10]
    units = {}
    for cell, blocks in enumerate([2, 1, 3]):
        for later in range(blocks):
            for earlier in range(later + 1):
                units[int(cells.first_unit[cell]) + two_blocks(earlier, later)] = (cell, earlier != later)
    assert {number: cells.of_unit(number) for number in range(10)} == units
    assert [blocks_for(units) for units in (0, 1, 2, 3, 4, 6, 7, 66)] == [1, 1, 2, 2, 3, 3, 4, 11]


def test_a_sample_tells_of_all() -> None:
    """A tenth of the pieces gives about the same estimate of pairs as all pieces."""
    low, high = np.full((3_000, 3), 0.2), np.full((3_000, 3), 0.3)
    of_all, of_some = Cells.of(low, high, 1.0, 64), Cells.of(low[:300], high[:300], 0.1, 64)
    assert of_some.pairs == pytest.approx(of_all.pairs, rel=0.01)
    assert of_all.blocks.tolist() == of_some.blocks.tolist() == [11]
    assert Cells.share(2_000) == 1.0
    assert Cells.share(400_000) == 0.01
    assert Cells.share(40_000_000) == 0.001


def test_a_scene_that_is_crowded_nowhere_has_cells_of_equal_numbers() -> None:
    """About as many pieces each, most in one block: that few in a sample meet by chance makes no crowd."""
    low, high = boxes(np.random.default_rng(3), 4_000, 0.03)
    cells = Cells.of(low, high, 0.01, 32)
    meet = ((low[:, None] < cells.high) & (high[:, None] >= cells.low)).all(axis=2).sum(axis=0)
    assert 32 <= len(meet) <= 64
    assert meet.max() < 2.5 * meet.min()
    assert cells.blocks.mean() < 1.5


def test_a_scene_of_nothing_is_one_cell() -> None:
    """No pieces have one cell, in one block."""
    cells = Cells.of(np.empty((0, 3)), np.empty((0, 3)), 1.0, 32)
    assert (cells.blocks.tolist(), cells.pairs) == ([1], 0.0)
    assert (cells.low == -np.inf).all()
    assert (cells.high == np.inf).all()
