"""Number the values of plans that decide conflicts by being equal, as `_word_number` does in SQL.

Words cost too much in arrays of pieces.
"""

import struct
from collections.abc import Sequence
from functools import lru_cache
from hashlib import md5
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.model.plan_columns import Form, columns_of
from conflictdb.model.rules import KINDS

# Batches have arrays of these, which are no words.
_MEASURES: Final = ("floor_m", "ceiling_m", "grow_mps")
# The columns of areas and tracks with a number: class, owner, and others of a plain form that change answers.
WORDS: Final = {
    kind: tuple(
        one
        for one in columns_of(kind, Form.TEXT, Form.WORD, Form.NUMBER)
        if one.changes_answers and one.name not in _MEASURES
    )
    for kind in KINDS
}


@lru_cache(maxsize=4096)
def number_of(word: str | float | None) -> int:
    """Return a 64-bit digest of a word or number, 0 for None; collision probability 2^-64 per pair."""
    if word is None:
        return 0
    text = word if isinstance(word, str) else struct.pack(">d", word + 0.0).hex()  # -0.0 is 0.0
    return int.from_bytes(md5(text.encode(), usedforsecurity=False).digest()[:8], signed=True)


def numbers_of_words(words: Sequence[str | None]) -> NDArray[np.int64]:
    """Return the numbers (n,) of words."""
    return np.array([number_of(word) for word in words], np.int64)


def numbers_of_plans(kind: str, plans: Sequence[Any]) -> NDArray[np.int64]:
    """Return the numbers (n, k) of the values of WORDS of areas or tracks."""
    numbers = [[number_of(getattr(one, column.field)) for column in WORDS[kind]] for one in plans]
    return np.array(numbers, np.int64).reshape(len(plans), len(WORDS[kind]))
