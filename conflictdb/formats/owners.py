"""Owners that objects of a file share: a layer may have a column `owner` that means something else."""

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Final

from conflictdb.formats.contents import Remark
from conflictdb.model.plans import Area, Track

_MOST_NAMED: Final = 3


class Owners:
    """The owners of objects, except those of volumes that are parts of one plan."""

    def __init__(self) -> None:
        self._objects: Counter[str] = Counter()
        self._without = 0

    def add(self, objects: Iterable[Area | Track]) -> None:
        """Count the objects of each owner. Keys of volumes begin with their owner, the key of their plan."""
        for one in objects:
            if one.owner is None:
                self._without += 1
            elif not one.key.startswith(one.owner):
                self._objects[one.owner] += 1

    def remarks(self, source: str) -> Iterator[Remark]:
        """Yield one remark if several objects have one owner."""
        shared = [(owner, count) for owner, count in self._objects.most_common() if count > 1]
        if shared:
            named = ", ".join(f"{owner!r:.60} ({count:,})" for owner, count in shared[:_MOST_NAMED])
            named += ", …" if len(shared) > _MOST_NAMED else ""
            text = f"objects of one owner are not compared with each other: {named}"
            if self._without:
                text += f"; {self._without:,} without owner {'is' if self._without == 1 else 'are'} compared with all"
            yield Remark(source, "file", f"{text}; if `owner` means something else, rename it")
