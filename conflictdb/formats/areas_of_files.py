"""Build areas from what the readers of other formats find: volumes, and when they are active."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.earth.shortest_lines import NoShortestLineError, followed
from conflictdb.errors import InvalidInput
from conflictdb.formats.contents import Contents, FileRefusals, given_twice, left_out, name_of
from conflictdb.formats.discs import Corners, disc
from conflictdb.formats.fields import key as checked_key
from conflictdb.formats.json_text import check_storable, check_text
from conflictdb.model.plans import MAX_POINTS, Area, Scene, Track

# Circles of files without settings, as in the default scene.
_SCENE: Final = Scene("file")


@dataclass(frozen=True, slots=True)
class Volume:
    """A footprint with its heights, metres above mean sea level; None is unbounded."""

    footprint: shapely.MultiPolygon
    floor_m: float | None = None
    ceiling_m: float | None = None


@dataclass(frozen=True, slots=True)
class Active:
    """A span in which a zone is active, microseconds since 1970; None is unbounded.

    schedule : when it is active within the span, as scene files write it; None: all the time
    """

    start_us: int | None = None
    end_us: int | None = None
    schedule: Any = None


@dataclass(frozen=True, slots=True)
class Zone:
    """An object of a file that becomes one area for each of its volumes.

    active : spans; empty: at all times
    """

    key: str
    volumes: Sequence[Volume]
    name: str | None = None
    active: Sequence[Active] = ()
    properties: Mapping[str, Any] = field(default_factory=dict)


def areas_of(who: str, zone: Zone) -> Iterator[Area]:
    """Yield the areas of a zone, numbered after its key if there are several; raises InvalidInput.

    who : the zone, as the user knows it
    """
    key = checked_key(who, "id", zone.key)
    if zone.name is not None:
        check_text(who, "name", zone.name)
    check_storable(who, "", dict(zone.properties))
    if not zone.volumes:
        raise InvalidInput(who, "geometry", "is missing: an area needs a volume")
    if len(zone.active) > 1 or any(one.schedule is not None for one in zone.active):
        raise InvalidInput(who, "schedule", "is not read yet")
    active = zone.active[0] if zone.active else Active()
    for number, volume in enumerate(zone.volumes, 1):
        yield Area(
            key if len(zone.volumes) == 1 else f"{key}/{number}",
            volume.footprint,
            zone.name,
            active.start_us,
            active.end_us,
            volume.floor_m,
            volume.ceiling_m,
            zone.properties,
        )


class Gathered:
    """The objects of a file read one by one, with their refusals."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.refusals = FileRefusals()
        self.corners = Corners()
        self.areas: list[Area] = []
        self.tracks: list[Track] = []
        self._seen: dict[str, str] = {}

    def add_zone(self, where: str, zone: Zone) -> None:
        """Add the areas of a zone; raises InvalidInput, also for a key that an earlier object has.

        where : the place of the zone in the file
        """
        for area in areas_of(f"zone {zone.key!r}", zone):
            self._once(where, area)
            self.areas.append(area)

    def add_track(self, where: str, track: Track) -> None:
        """Add a track; raises InvalidInput for a key that an earlier object has."""
        self._once(where, track)
        self.tracks.append(track)

    def _once(self, where: str, item: Area | Track) -> None:
        if item.key in self._seen:
            raise given_twice(name_of(item), f"{self._seen[item.key]} and {where}")
        self._seen[item.key] = where

    def circle(self, who: str, lon_deg: float, lat_deg: float, radius_m: float) -> shapely.MultiPolygon:
        """Return a polygon that contains a circle; raises InvalidInput."""
        return disc(who, lon_deg, lat_deg, radius_m, _SCENE, self.corners)

    def contents(self, *, skip_invalid: bool) -> Contents:
        """Return the objects; refused ones are left out or raised."""
        if not skip_invalid:
            self.refusals.raise_found()
        return Contents(None, self.areas, self.tracks, left_out(self.source, self.refusals))


def along_shortest_lines(who: str, field: str, ring_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a ring or line (m, 2) whose rhumb lines follow the shortest lines between positions (n, 2).

    They deviate by at most half a metre. Raises InvalidInput for a line between opposite places.
    """
    try:
        line, _ = followed(ring_deg)
    except NoShortestLineError:
        raise InvalidInput(who, field, "has a line between opposite places: several are equally short") from None
    if len(line) > MAX_POINTS:
        raise InvalidInput(who, field, f"has more than {MAX_POINTS} vertices along its shortest lines")
    return line
