"""Distinct values of arrays: `np.unique` with the inverse, in a fifth of its time for few values."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

_Int = TypeVar("_Int", bound=np.integer[Any])


def distinct(values: NDArray[_Int]) -> tuple[NDArray[_Int], NDArray[np.int64]]:
    """Return the distinct values (k,), in order, and the place (n,) of each value among them."""
    order = values.argsort()
    along = values[order]
    is_new = np.ones(len(order), np.bool_)
    np.not_equal(along[1:], along[:-1], out=is_new[1:])
    place = np.empty(len(order), np.int64)
    place[order] = is_new.cumsum() - 1
    return along[is_new], place


def is_in(values: NDArray[_Int], among: NDArray[_Int]) -> NDArray[np.bool_]:
    """Return (n,) whether values are among others, as `np.isin` does."""
    if not among.size:
        return np.zeros(len(values), np.bool_)
    known = np.sort(among)
    return known[np.minimum(known.searchsorted(values), len(known) - 1)] == values
