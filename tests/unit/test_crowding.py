"""Cells of space and time in which the pieces of a scene are joined."""

import numpy as np

from conflictdb.spark.crowding import Cells


def boxes(rng: np.random.Generator, count: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Boxes of some size, thrown into the unit cube."""
    low = rng.uniform(0.0, 1.0, (count, 3))
    return low, low + rng.uniform(0.0, size, (count, 3))


def test_every_place_is_in_one_cell() -> None:
    """Cells fill space and time, also far outside of what they were made of, and do not overlap."""
    rng = np.random.default_rng(1)
    low, high = boxes(rng, 3_000, 0.4)
    low[:40, 2], high[:40, 2] = -(2.0**63), 2.0**63  # there for ever
    cells = Cells.of(low, high, 1.0)
    places = np.concatenate([rng.uniform(-0.5, 1.5, (3_000, 3)), low, cells.low[np.isfinite(cells.low).all(axis=1)]])
    within = ((places[:, None] >= cells.low) & (places[:, None] < cells.high)).all(axis=2)
    assert len(cells.lots) > 30
    assert (within.sum(axis=1) == 1).all()


def test_a_crowd_falls_into_lots() -> None:
    """Where 500 are in one place there are as many lots as bring each row near eight; elsewhere there is one."""
    rng = np.random.default_rng(2)
    low, high = boxes(rng, 2_000, 0.01)
    low[:500], high[:500] = 0.4, 0.5
    cells = Cells.of(low, high, 1.0)
    crowded = ((cells.low <= 0.4) & (cells.high > 0.4)).all(axis=1)
    assert 40 <= cells.lots[crowded][0] <= 64
    assert (cells.lots[~crowded] == 1).all()


def test_a_sample_tells_of_all() -> None:
    """Of a tenth of the pieces about as many lots follow as of all of them."""
    low, high = np.full((3_000, 3), 0.2), np.full((3_000, 3), 0.3)
    of_all, of_some = Cells.of(low[:600], high[:600], 1.0), Cells.of(low[:60], high[:60], 0.1)
    assert abs(of_all.lots[0] - of_some.lots[0]) <= 1
    assert Cells.of(low, high, 1.0).lots[0] == 256


def test_a_scene_that_is_crowded_nowhere_is_one_cell() -> None:
    """Cells cost copies of what is in several; and that two in a sample meet by chance makes no crowd."""
    low, high = boxes(np.random.default_rng(3), 4_000, 0.03)
    cells = Cells.of(low, high, 0.01)
    assert cells.lots.tolist() == [1]
    assert Cells.share(2_000) == 1.0
    assert Cells.share(400_000) == 0.01
    assert Cells.share(40_000_000) == 0.001


def test_a_scene_of_nothing_is_one_cell() -> None:
    """No pieces have one cell, in one lot."""
    cells = Cells.of(np.empty((0, 3)), np.empty((0, 3)), 1.0)
    assert cells.lots.tolist() == [1]
    assert (cells.low == -np.inf).all()
    assert (cells.high == np.inf).all()
