"""Gather bundles of pieces that come in batches, without a second copy of them."""

from dataclasses import fields
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Bundles, Pieces

# Offsets, and the column that they count.
_OFFSETS: Final = {"hull_offset": "hull_xy", "shape_offset": "shape_xy"}
_COLUMNS: Final = tuple(one.name for one in fields(Pieces) if one.name not in (*_OFFSETS, "shape_to_xy"))
_FIRST_ROWS: Final = 1_024


class _Growing:
    """An array that grows by half when it is full: pages that are never written take no memory."""

    def __init__(self, like: NDArray[Any]) -> None:
        self._values = np.empty((_FIRST_ROWS, *like.shape[1:]), like.dtype)
        self.count = 0

    def append(self, some: NDArray[Any]) -> None:
        end = self.count + len(some)
        if end > len(self._values):
            grown = np.empty((max(end, len(self._values) * 3 // 2), *some.shape[1:]), self._values.dtype)
            grown[: self.count] = self.values()
            self._values = grown
        self._values[self.count : end] = some
        self.count = end

    def values(self) -> NDArray[Any]:
        return self._values[: self.count]


class GatheredBundles:
    """The bundles of several batches in one: each batch may be freed once it was added."""

    def __init__(self, first: Bundles) -> None:
        """Begin with a batch."""
        pieces = first.pieces
        names = [*_COLUMNS, *(["shape_to_xy"] if pieces.changes else [])]
        self._columns = {name: _Growing(getattr(pieces, name)) for name in names}
        self._offsets = {name: _Growing(first.offset) for name in (*_OFFSETS, "of_bundles")}
        for column in self._offsets.values():
            column.append(np.zeros(1, np.int64))
        self.add(first)

    def add(self, batch: Bundles) -> None:
        """Add a batch."""
        pieces, columns = batch.pieces, self._columns
        if pieces.changes and "shape_to_xy" not in columns:
            columns["shape_to_xy"] = _Growing(pieces.shape_to_xy)
            columns["shape_to_xy"].append(columns["shape_xy"].values())
        self._offsets["of_bundles"].append(batch.offset[1:] + columns["kind"].count)
        for name, of in _OFFSETS.items():
            self._offsets[name].append(getattr(pieces, name)[1:] + columns[of].count)
        for name, column in columns.items():
            column.append(getattr(pieces, name))

    def bundles(self) -> Bundles:
        """Return all bundles, which share their memory with this."""
        columns: dict[str, Any] = {name: column.values() for name, column in self._columns.items()}
        columns.setdefault("shape_to_xy", columns["shape_xy"])
        offsets = {name: column.values() for name, column in self._offsets.items()}
        offset = offsets.pop("of_bundles")
        return Bundles(Pieces(**columns, **offsets), offset)
