"""Ragged data: items of varying number for each row, concatenated; row i owns items [offset[i], offset[i + 1])."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def offsets(lengths: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the offsets (n + 1,) of rows with these lengths (n,)."""
    found = np.zeros(len(lengths) + 1, np.int64)
    np.add.accumulate(np.asarray(lengths, np.int64), out=found[1:])
    return found


def followed_by(each: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Return the offsets of the rows of several arrays, one after the other."""
    rows, end = [each[0][:1]], 0
    for one in each:
        rows.append(one[1:] + end)
        end += int(one[-1])
    return np.concatenate(rows)


def ragged_rows(offset: NDArray[np.int64], rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the offsets of some rows of ragged data, and the indices of their items."""
    first = offset[rows]
    length = offset[rows + 1] - first
    taken = offsets(length)
    return taken, (first - taken[:-1]).repeat(length) + np.arange(taken[-1])


def ragged_take(
    offset: NDArray[np.int64], items: NDArray[np.float64], rows: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the items of some rows, and their offsets."""
    of_rows, index = ragged_rows(offset, rows)
    return items[index], of_rows


def stacked(arrays: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return the concatenated rows (k, 2) of all arrays; (0, 2) for no arrays."""
    return np.concatenate([np.empty((0, 2)), *arrays])
