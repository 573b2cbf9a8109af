"""What a file holds, and what of it was left out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from conflictdb.model import Area, Scene, Track


@dataclass(frozen=True, slots=True)
class Skipped:
    """Rows of one object that were left out of a file of observations, and why.

    Plans are refused as a whole when something is wrong with them; observations (AIS, ADS-B) are always a little dirty,
    so what cannot be used is left out and named here.

    key : the object, as in the file
    reason : the rule that the rows break
    lines : their line numbers in the file, counted from 1
    is_whole : whether the object is left out altogether
    """

    source: str
    key: str
    reason: str
    lines: tuple[int, ...]
    is_whole: bool


@dataclass(frozen=True, slots=True)
class Remark:
    """Something in a file that breaks no rule, but may not be what its author meant.

    source : the file
    key : the object, as in a refusal: ``track 'T1'``; ``file`` for all of it
    text : what is odd, and what it might mean
    """

    source: str
    key: str
    text: str

    def __str__(self) -> str:
        return f"{self.source}: {self.key}: {self.text}"


class _Contents(NamedTuple):
    scene: Scene | None
    areas: list[Area]
    tracks: list[Track]
    skipped: list[Skipped]


class Contents(_Contents):
    """The objects of one file: ``scene, areas, tracks, skipped = read(path)``.

    scene : its settings, None if the file names no scene
    skipped : rows and objects that were left out
    remarks : beside the four, what is odd about the rest
    """

    remarks: Sequence[Remark] = ()
