"""What a file holds, and what of it was left out."""

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


class Contents(NamedTuple):
    """The objects of one file.

    scene : its settings, None if the file names no scene
    """

    scene: Scene | None
    areas: list[Area]
    tracks: list[Track]
    skipped: list[Skipped]
