"""Number classes and owners, as `_word_number` does in SQL: words cost too much in arrays of pieces."""

from collections.abc import Sequence
from functools import lru_cache
from hashlib import md5

import numpy as np
from numpy.typing import NDArray


@lru_cache(maxsize=4096)
def number_of(word: str | None) -> int:
    """Return a 64-bit digest of a word, 0 for None; collision probability 2^-64 per pair of words."""
    if word is None:
        return 0
    return int.from_bytes(md5(word.encode(), usedforsecurity=False).digest()[:8], signed=True)


def numbers_of_words(words: Sequence[str | None]) -> NDArray[np.int64]:
    """Return the numbers (n,) of words."""
    return np.array([number_of(word) for word in words], np.int64)
