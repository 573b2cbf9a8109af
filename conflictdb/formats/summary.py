"""Remember the objects of a file that is read in parts: some sixty bytes each, plus their keys."""

from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from conflictdb.errors import InvalidInput
from conflictdb.formats import places
from conflictdb.formats.contents import Remark, given_twice, name_of, rows_apart
from conflictdb.model.plans import Area, Track

_UTF_8: Final = "utf-8", "surrogatepass"


@dataclass(slots=True)
class Summary:
    """For n objects, in file order: concatenated names, hashes of keys, rows and extents.

    apart : returns the places of two rows as text
    """

    apart: Callable[[int, int], str] = rows_apart
    _of_part: dict[str, int] = field(default_factory=dict)
    _names: bytearray = field(default_factory=bytearray)
    _ends: "array[int]" = field(default_factory=lambda: array("q"))
    _hashes: "array[int]" = field(default_factory=lambda: array("q"))
    _rows: "array[int]" = field(default_factory=lambda: array("q"))
    _extents: "array[float]" = field(default_factory=lambda: array("d"))

    def __len__(self) -> int:
        return len(self._rows)

    def first(self, key: str, row: int) -> int:
        """Return the first row of the present part that has a key; `row` if there is none."""
        return self._of_part.setdefault(key, row)

    def add(self, areas: Sequence[Area], tracks: Sequence[Track]) -> None:
        """Remember the objects of a part, and begin the next part."""
        self._extents.extend(places.extents(areas, tracks).ravel().tolist())
        items: list[Area | Track] = [*areas, *tracks]
        for item in items:
            self._names += name_of(item).encode(*_UTF_8)
            self._ends.append(len(self._names))
            self._hashes.append(hash(item.key))
            self._rows.append(self._of_part.get(item.key, len(self._rows)))
        self._of_part.clear()

    def name(self, i: int) -> str:
        """Return the name of an object in errors and remarks."""
        return self._names[self._ends[i - 1] if i else 0 : self._ends[i]].decode(*_UTF_8)

    def twice(self) -> Iterator[InvalidInput]:
        """Yield a refusal for each object with the key of an earlier one."""
        hashes = np.array(self._hashes)
        order = np.argsort(hashes, kind="stable")
        same = np.flatnonzero(hashes[order[1:]] == hashes[order[:-1]])
        first: dict[str, int] = {}
        for i in np.unique([order[same], order[same + 1]]).astype(int).tolist():
            name = self.name(i)
            row = first.setdefault(name.partition(" ")[2], self._rows[i])
            if row != self._rows[i]:
                yield given_twice(name, self.apart(row, self._rows[i]))

    def remarks(self, source: str) -> Iterator[Remark]:
        """Yield a remark on each object that lies far from all others."""
        yield from places.far(source, np.array(self._extents).reshape(-1, 4), self.name)
