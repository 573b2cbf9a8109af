"""Number objects of any kind, as routine `_object_number` does: areas first, tracks above all areas."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_KIND_BIT: Final = 62  # above all object ids


def numbers_of(kind: NDArray[Any], ids: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return one number (n,) for each object by its kind (code) and id (n,), in the order of kinds, then ids."""
    return (kind.astype(np.int64) << _KIND_BIT) | ids


def kinds_and_ids(of: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the kinds and ids (n,) of object numbers (n,)."""
    return of >> _KIND_BIT, of & ((1 << _KIND_BIT) - 1)
