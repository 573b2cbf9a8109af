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
from conflictdb.formats.instants import format_instant
from conflictdb.formats.json_text import check_storable, check_text
from conflictdb.formats.routes import Route, track_of
from conflictdb.model.inputs import certain
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
    object_class : that separation rules name
    owner : volumes of one owner are not compared; None: those of this zone
    more : other plain columns, by the fields of `Area`
    """

    key: str
    volumes: Sequence[Volume]
    name: str | None = None
    active: Sequence[Active] = ()
    properties: Mapping[str, Any] = field(default_factory=dict)
    object_class: str | None = None
    owner: str | None = None
    more: Mapping[str, Any] = field(default_factory=dict)


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
    active = _active(zone.active)
    for number, volume in enumerate(zone.volumes, 1):
        yield Area(
            key if len(zone.volumes) == 1 else f"{key}/{number}",
            volume.footprint,
            zone.name,
            floor_m=volume.floor_m,
            ceiling_m=volume.ceiling_m,
            properties=zone.properties,
            object_class=zone.object_class,
            owner=zone.owner or (key if len(zone.volumes) > 1 else None),
            **active,
            **zone.more,
        )


def _active(active: Sequence[Active]) -> dict[str, Any]:
    """Return when an area is active, as its members: one span with its schedule, several spans, or several of both."""
    if len(active) <= 1:
        only = active[0] if active else Active()
        return {"start_us": certain(only.start_us), "end_us": certain(only.end_us), "schedule": only.schedule}
    rules = [rule for one in active for rule in (one.schedule if isinstance(one.schedule, list) else [one.schedule])]
    if len({(one.start_us, one.end_us) for one in active}) == 1:
        schedule = None if None in rules else rules
        return {"start_us": certain(active[0].start_us), "end_us": certain(active[0].end_us), "schedule": schedule}
    if all(one.schedule is None for one in active):
        return {"spans_us": [[certain(one.start_us), certain(one.end_us)] for one in active]}
    # Each rule keeps to its own span; a span without one is active all of it.
    return {
        "schedule": [
            {**rule, **_within(rule, one)}
            for one in active
            for rule in (one.schedule if isinstance(one.schedule, list) else [one.schedule or {}])
        ]
    }


def _within(rule: Mapping[str, Any], active: Active) -> dict[str, str]:
    """Return the ends of a span as `from` and `until` of a rule, which has none of its own."""
    ends = {"from": active.start_us, "until": active.end_us}
    if wrong := [name for name, at in ends.items() if at is not None and name in rule]:
        raise InvalidInput("schedule", wrong[0], "is given twice: by the rule and by the span that it belongs to")
    return {name: format_instant(at) for name, at in ends.items() if at is not None}


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

    def add_route(self, where: str, who: str, route: Route, max_speed_kn: float) -> None:
        """Add the track of a route; raises InvalidInput as `add_track` and `routes.track_of`."""
        self.add_track(where, track_of(who, route, max_speed_kn))

    def _once(self, where: str, item: Area | Track) -> None:
        if item.key in self._seen:
            raise given_twice(name_of(item), f"{self._seen[item.key]} and {where}")
        self._seen[item.key] = where

    def circle(
        self, who: str, lon_deg: float, lat_deg: float, radius_m: float, field: str = "radius_m"
    ) -> shapely.MultiPolygon:
        """Return a polygon that contains a circle; raises InvalidInput for the field of its radius."""
        try:
            return disc(who, lon_deg, lat_deg, radius_m, _SCENE, self.corners)
        except InvalidInput as error:
            raise InvalidInput(who, field if error.field == "radius_m" else error.field, error.rule) from None

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
