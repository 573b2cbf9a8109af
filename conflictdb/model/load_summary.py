"""What a load brought, in one line: how many, where, when, how fast and how high."""

from dataclasses import dataclass
from datetime import UTC, datetime, tzinfo

from conflictdb.model.units import Units


@dataclass(frozen=True, slots=True)
class LoadSummary:
    """The objects of a load. None: unknown, or no limit. False if there are none.

    scheduled : objects with a schedule
    west, south, east, north : extent, degrees; 360 or more from west to east: all longitudes
    since, until : first start and last end
    slowest_kn, fastest_kn : of the fastest legs of the tracks
    lowest_m, highest_m : least floor or ceiling, and the largest
    """

    areas: int = 0
    tracks: int = 0
    scheduled: int = 0
    west: float = 0.0
    south: float = 0.0
    east: float = 0.0
    north: float = 0.0
    since: datetime | None = None
    until: datetime | None = None
    slowest_kn: float | None = None
    fastest_kn: float | None = None
    lowest_m: float | None = None
    highest_m: float | None = None

    def __bool__(self) -> bool:
        return bool(self.areas or self.tracks)

    def __str__(self) -> str:
        return self.text()

    def text(self, units: Units = Units.NAUTICAL, zone: tzinfo = UTC) -> str:
        """Return a line in units and a time zone; empty if there are no objects."""
        if not self:
            return ""
        counts = [(self.areas, "area"), (self.tracks, "track")]
        parts = [" and ".join(f"{n:,} {kind}{'' if n == 1 else 's'}" for n, kind in counts if n)]
        parts.append(_ends(units.bound(self.south, "NS"), units.bound(self.north, "NS")))
        is_around = self.east - self.west >= 360.0
        parts.append(
            "all longitudes" if is_around else _ends(units.bound(self.west, "EW"), units.bound(self.east, "EW"))
        )
        parts += self._times(zone)
        if self.scheduled:
            parts.append(f"{self.scheduled:,} by schedule")
        if self.slowest_kn is not None and self.fastest_kn is not None:
            slowest, fastest = (units.speed(one) for one in (self.slowest_kn, self.fastest_kn))
            parts.append(f"{_ends(f'{slowest:,.0f}', f'{fastest:,.0f}')} {units.speed_unit}")
        if self.lowest_m is None or self.highest_m is None:
            parts.append("no heights")
        else:
            parts.append(f"{_ends(f'{self.lowest_m:,.0f}', f'{self.highest_m:,.0f}')} m high")
        return ", ".join(parts)

    def _times(self, zone: tzinfo) -> list[str]:
        name = "UTC" if zone is UTC else str(zone)
        since, until = (
            None if one is None else f"{one.astimezone(zone):%Y-%m-%d %H:%M}" for one in (self.since, self.until)
        )
        if since is not None and until is not None:
            return [f"{_ends(since, until)} {name}"]
        if since is not None or until is not None:
            return [f"until {until} {name}" if since is None else f"from {since} {name} on"]
        return ["at all times"] if self.scheduled < self.areas + self.tracks else []


def _ends(least: str, most: str) -> str:
    return least if least == most else f"{least} to {most}"
