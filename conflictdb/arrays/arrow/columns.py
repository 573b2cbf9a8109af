"""Convert numpy arrays to Arrow columns and back; numbers bit by bit, without copying where possible.

Arrays converted from Arrow are read-only.
"""

from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from conflictdb.arrays.arrow.forms import INSTANT, Array
from conflictdb.arrays.ragged import offsets
from conflictdb.errors import InvalidInput

# Lists have 32-bit offsets, the only ones that engines support.
_MOST_ITEMS: Final = 2**31 - 1


def of_numbers(values: NDArray[Any]) -> Array:
    """Return numbers or booleans (n,) as a column."""
    return pa.array(np.ascontiguousarray(values))


def numbers(column: Array) -> NDArray[Any]:
    """Return a column without nulls as numbers or booleans (n,)."""
    return np.asarray(column.to_numpy(zero_copy_only=False))


def of_instants(instants_us: NDArray[np.int64], unbounded_us: int | None = None) -> Array:
    """Return instants (n,), microseconds since 1970, as a column; `unbounded_us` becomes null."""
    mask = None if unbounded_us is None else instants_us == unbounded_us
    return pa.array(np.ascontiguousarray(instants_us), mask=mask).view(INSTANT)


def instants(column: Array, unbounded_us: int = 0) -> NDArray[np.int64]:
    """Return a column of instants as microseconds since 1970 (n,); nulls become `unbounded_us`."""
    return numbers(_filled(column.view(pa.int64()), unbounded_us))


def of_measures(values: NDArray[np.float64], unknown: float) -> Array:
    """Return numbers (n,) as a column; `unknown`, an infinity or NaN, becomes null."""
    mask = np.isnan(values) if np.isnan(unknown) else values == unknown
    return pa.array(np.ascontiguousarray(values), mask=mask)


def measures(column: Array, unknown: float) -> NDArray[np.float64]:
    """Return a column of numbers (n,); nulls become `unknown`."""
    return numbers(_filled(column, unknown))


def _filled(column: Array, value: Any) -> Array:
    return column.fill_null(value) if column.null_count else column


def of_lists(items: NDArray[Any] | Array, offset: NDArray[np.int64], is_null: NDArray[np.bool_] | None = None) -> Array:
    """Return ragged items as a column of lists: row i is items[offset[i]:offset[i + 1]], flat if they are pairs.

    Raises InvalidInput for more items than a column of lists can contain.
    """
    if isinstance(items, np.ndarray):
        offset = offset * (items.size // max(len(items), 1) if items.ndim > 1 else 1)
        items = of_numbers(items.reshape(-1))
    if len(items) > _MOST_ITEMS:
        raise InvalidInput("Arrow", "lists", f"must have at most {_MOST_ITEMS} items in a batch; make smaller batches")
    mask = None if is_null is None else pa.array(is_null)
    return pa.ListArray.from_arrays(pa.array(offset.astype(np.int32)), items, mask=mask)


def lists(column: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return the concatenated items of a column of lists, and their offsets (n + 1,); a null has no items."""
    return column.flatten(), offsets(numbers(_filled(column.value_lengths(), 0)))
