"""Where a measure changes its sign: beyond doubt on either side, and no nearer to it than that."""

import numpy as np
import pytest

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.constants import MOST_TOUCHES
from conflictdb.stage4.roots import roots

TOUCH = 1e-3


@pytest.mark.parametrize("power", [1, 3, 7])
def test_ends_are_beyond_doubt_and_no_further(power: int) -> None:
    """Falling evenly, or hardly at all for most of the way; in either direction of time."""
    zero = np.array([0.5, 0.01, 0.99, 0.7])
    way = np.array([1.0, 1.0, 1.0, -1.0])

    def measure(rows: np.ndarray, t: Floats) -> Floats:
        return np.asarray(way[rows] * (zero[rows] ** power - t**power))

    outside, inside = np.where(way > 0.0, 0.0, 1.0), np.where(way > 0.0, 1.0, 0.0)
    rows = np.arange(len(zero))
    touch = np.full(len(zero), 1e-9 if power > 1 else TOUCH)
    found = roots(measure, outside, measure(rows, outside), inside, measure(rows, inside), touch)
    wide = measure(rows, outside) > touch
    assert found.is_found[wide].all()
    assert wide.sum() >= 3
    for at, sign in ((found.outer, 1.0), (found.inner, -1.0)):
        value = sign * measure(rows, at)[wide]
        assert (value > touch[wide]).all()
        assert (value < MOST_TOUCHES * touch[wide]).all()


def test_an_outer_end_that_is_beyond_doubt_already_stays_where_it_is() -> None:
    """It is not looked for again: the measure is asked on the inner side alone."""
    asked: list[float] = []

    def measure(rows: np.ndarray, t: Floats) -> Floats:
        asked.extend(t.tolist())
        return np.asarray(1.5 * TOUCH - t)

    (outside, inside), (gap, depth) = np.array([[0.0], [1.0]]), np.array([[1.5 * TOUCH], [1.5 * TOUCH - 1.0]])
    found = roots(measure, outside, gap, inside, depth, np.full(1, TOUCH))
    assert found.is_found.all()
    assert found.outer.tolist() == [0.0]
    assert -MOST_TOUCHES * TOUCH < 1.5 * TOUCH - found.inner[0] < -TOUCH
    assert min(asked) >= 0.5 * TOUCH
