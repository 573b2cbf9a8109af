"""Give values of plain columns that change answers 64-bit numbers: a word its digest (`_word_number` in SQL).

The number of a number has its bits. These have the order of numbers of at least 0, and those of NaN, for none, are
above them: the rule of a pair may compare them in C and in SQL.
"""

import math
import struct
from collections.abc import Iterator, Sequence
from functools import lru_cache
from hashlib import md5
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.model.plan_columns import PLAN_COLUMNS, Form, PlanColumn, columns_of
from conflictdb.model.rules import KINDS

# Batches have arrays of these.
_MEASURES: Final = ("floor_m", "ceiling_m", "grow_mps")
# The columns of areas and tracks with a number: those of pieces, and others of a plain form that change answers.
NUMBERED: Final = {
    kind: tuple(
        sorted(
            (
                one
                for one in columns_of(kind, Form.TEXT, Form.WORD, Form.NUMBER)
                if one.changes_answers and one.name not in _MEASURES
            ),
            key=lambda one: not one.in_pieces,
        )
    )
    for kind in KINDS
}
# Columns of pieces: the first of NUMBERED, which areas and tracks share.
IN_PIECES: Final = tuple(f"{one.name}_number" for one in PLAN_COLUMNS if one.in_pieces)
CLASS: Final = IN_PIECES.index("class_number")


def piece_numbers(numbers: NDArray[np.int64], rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return `Pieces.numbers` (m, k) of pieces whose objects are rows (m,) of numbers of NUMBERED."""
    return numbers[:, : len(IN_PIECES)][rows]


def measures(kind: str) -> Iterator[PlanColumn]:
    """Yield the columns of numbers that batches store as arrays."""
    return (one for one in columns_of(kind, Form.NUMBER) if one.name in _MEASURES)


@lru_cache(maxsize=4096)
def number_of(value: str | float | None, form: Form = Form.WORD) -> int:
    """Return a 64-bit digest of a word, 0 for None; of a number its bits, those of NaN for None.

    Collision probability of words: 2^-64 per pair.
    """
    if form is Form.NUMBER:
        number = math.nan if value is None else float(value) + 0.0  # -0.0 is 0.0
        return int.from_bytes(struct.pack(">d", number), signed=True)
    if value is None:
        return 0
    return int.from_bytes(md5(str(value).encode(), usedforsecurity=False).digest()[:8], signed=True)


def values_in(kind: str, numbers: NDArray[np.int64], name: str) -> NDArray[np.float64]:
    """Return the values (n,) of a column of the form NUMBER in numbers (n, k) of NUMBERED; NaN: none."""
    place = [column.name for column in NUMBERED[kind]].index(name)
    return np.ascontiguousarray(numbers[:, place]).view(np.float64)


def numbers_of_words(words: Sequence[str | None]) -> NDArray[np.int64]:
    """Return the numbers (n,) of words."""
    return np.array([number_of(word) for word in words], np.int64)


def numbers_of_plans(kind: str, plans: Sequence[Any]) -> NDArray[np.int64]:
    """Return the numbers (n, k) of the values of NUMBERED of areas or tracks."""
    numbers = np.empty((len(plans), len(NUMBERED[kind])), np.int64)
    for place, column in enumerate(NUMBERED[kind]):
        field, form = column.field, column.form
        values = [getattr(one, field) for one in plans]
        if form is Form.NUMBER:
            numbers[:, place] = [number_of(value, form) for value in values]
        else:
            # Many plans share a word, or have none.
            known = {value: number_of(value, form) for value in set(values)}
            numbers[:, place] = [known[value] for value in values]
    return numbers
