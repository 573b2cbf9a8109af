"""Read the times of gx:Track in KML and KMZ, which the OGR library does not give."""

from collections import defaultdict
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.formats.instants import parse_instant
from conflictdb.formats.values_of_xml import number_of
from conflictdb.formats.xml_text import Element

_DIGITS: Final = 9  # of coordinates that are compared


class GxTracks:
    """The tracks of a file, found by their positions; raises InvalidInput."""

    def __init__(self, root: Element) -> None:
        self._times: dict[bytes, list[list[int]]] = defaultdict(list)
        for number, track in enumerate(root.all("Track"), 1):
            positions, times_us = _positions(f"gx:Track {number} in line {track.line}", track)
            self._times[_key(positions)].append(times_us)

    def times_us(self, positions_deg: NDArray[np.float64]) -> list[int] | None:
        """Return the times of the next track with positions (n, 2), None if there is none."""
        times = self._times.get(_key(positions_deg))
        return times.pop(0) if times else None


def _key(positions_deg: NDArray[np.float64]) -> bytes:
    return bytes((np.round(positions_deg, _DIGITS) + 0.0).tobytes())


def _positions(who: str, track: Element) -> tuple[NDArray[np.float64], list[int]]:
    """Return positions (n, 2) and times of a gx:Track; raises InvalidInput."""
    whens, coords = list(track.each("when")), list(track.each("coord"))
    if len(whens) != len(coords):
        rule = f"must have as many of when and gx:coord; got {len(whens)} and {len(coords)}"
        raise InvalidInput(who, "when", rule)
    positions = []
    for coord in coords:
        numbers = [number_of(who, f"gx:coord in line {coord.line}", one) for one in coord.text.split()]
        if len(numbers) not in (2, 3):
            raise InvalidInput(who, f"gx:coord in line {coord.line}", f"must be lon lat height; got {coord.text!r:.40}")
        if not (abs(numbers[0]) <= 360.0 and abs(numbers[1]) <= 90.0):
            rule = f"must lie within +-360 degrees of longitude and +-90 of latitude; got {coord.text!r:.40}"
            raise InvalidInput(who, f"gx:coord in line {coord.line}", rule)
        positions.append(numbers[:2])
    times = []
    for when in whens:
        try:
            times.append(parse_instant(when.text))
        except ValueError as error:
            raise InvalidInput(who, f"when in line {when.line}", str(error)) from None
        if len(times) > 1 and times[-1] < times[-2]:
            rule = f"must not be before the one above it; got {when.text!r:.40}"
            raise InvalidInput(who, f"when in line {when.line}", rule)
    return np.array(positions, np.float64).reshape(-1, 2), times
