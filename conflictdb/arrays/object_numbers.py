"""One number for an object of any kind, as SQL has it (`_object_number`): areas first, tracks above all of them."""

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_KIND_BIT: Final = 62  # above the numbers of all objects


def numbers_of(kind: NDArray[Any], ids: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return one number (n,) for each object by its kind (code) and id (n,), in the order of kinds, then ids."""
    return (kind.astype(np.int64) << _KIND_BIT) | ids


def kinds_and_ids(of: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the kinds and ids (n,) of objects by the numbers (n,) that `numbers_of` gave them."""
    return of >> _KIND_BIT, of & ((1 << _KIND_BIT) - 1)
