"""Proposals: what `resolve` returns, changes of plans that clear a scene."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from enum import StrEnum
from typing import Any, Final

from conflictdb.model.clock import Clock
from conflictdb.model.plans import Track
from conflictdb.model.results import format_moment, labelled
from conflictdb.model.units import Units

_EXACT: Final = Clock(step_us=0)


class Goal(StrEnum):
    """What a proposal makes least."""

    TOTAL = "total"  # the sum of all delays, each times its weight
    LARGEST = "largest"  # the largest of them


class Side(StrEnum):
    """How a moved track passes another object."""

    ASTERN = "astern"  # it comes to the common place later than the other track
    AHEAD = "ahead"  # earlier
    AFTER = "after"  # it comes to an area after that ends
    BEFORE = "before"  # it has left an area before that begins
    CLEAR = "clear"  # on another way


@dataclass(frozen=True, slots=True)
class Passing:
    """How a moved track passes an object that it would meet otherwise.

    key : of the other object
    closest_m : distance at the closest approach, metres on the earth; None if that is not within 10 nautical miles
        beyond the required separation
    closest_at : when that is; None as before
    """

    key: str
    side: Side
    closest_m: float | None
    closest_at: datetime | None


@dataclass(frozen=True, slots=True)
class NewWaypoints:
    """Waypoints that a track gets on one of its legs, departing as planned and at the speed of the leg.

    leg : of the planned track, 1 the first
    waypoints_deg : one or two, longitude and latitude
    longer_m : how much longer the way is, metres
    later_s : how much later the track arrives, seconds
    """

    leg: int
    waypoints_deg: tuple[tuple[float, float], ...]
    longer_m: float
    later_s: float


@dataclass(frozen=True, slots=True)
class NewPlace:
    """Where an area goes, at its true size: how far, metres, on which bearing, degrees from north."""

    distance_m: float
    bearing_deg: float

    def text(self, units: Units = Units.NAUTICAL) -> str:
        """Return it in words: ``2.4 nmi on 270°``, in metres if it is no whole number of tenths of the unit."""
        return f"{units.exact_distance(self.distance_m)} on {self.bearing_deg % 360.0:03.0f}°"


@dataclass(frozen=True, slots=True)
class Move:
    """A change of one track, or of the times or the place of one area.

    delay_s : seconds by which all of its times are later, negative: earlier; whole microseconds
    speed : factor of its planned speed, on all legs, departing as planned; 1: as planned
    clears : the keys of the objects that it is in conflict with as planned, and no longer
    passes : how it passes these, and others that keep it from a smaller delay
    detour : its new waypoints; None: it has the planned ones
    departs_at : when it departs, or is active first, then; None: an area without a start
    is_area : whether it is an area
    place : where an area goes; None: it stays where it is
    """

    key: str
    delay_s: float
    speed: float
    clears: tuple[str, ...]
    passes: tuple[Passing, ...]
    detour: NewWaypoints | None = None
    departs_at: datetime | None = None
    is_area: bool = False
    place: NewPlace | None = None

    def text(self, names: Mapping[str, str] | None = None, clock: Clock = _EXACT, units: Units = Units.NAUTICAL) -> str:
        """Return the move in one sentence; names: of objects, by key."""
        label = {} if names is None else names
        parts = [_change(self, clock, units)]
        for one in self.passes:
            where = "" if one.closest_m is None else f" by {units.least_distance(one.closest_m)}"
            other = labelled(one.key, label.get(one.key))
            verb = {
                Side.ASTERN: "passes astern of",
                Side.AHEAD: "passes ahead of",
                Side.AFTER: "comes after",
                Side.BEFORE: "ends before" if self.is_area else "leaves before",
                Side.CLEAR: "keeps clear of",
            }[one.side]
            parts.append(f"{verb} {other}{where if one.side not in (Side.AFTER, Side.BEFORE) else ''}")
        count = len(self.clears)
        cleared = f"clears {count} conflict{'' if count == 1 else 's'}" if count else "clears none"
        how = ", ".join(parts[1:])
        return f"{labelled(self.key, label.get(self.key))} {parts[0]}: {how + '; ' if how else ''}{cleared}, makes none"


@dataclass(frozen=True, slots=True)
class Left:
    """A plan that may move and stays as planned although it is in conflict.

    blocked_by : the keys of objects that together forbid every change that it may make
    """

    key: str
    blocked_by: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Proposal:
    """Changes that clear a scene: what `resolve` returns. A detection of the whole changed scene has verified it.

    moves : by key; after them, no track that moved or was in conflict meets anything, but those of `left`
    left : by key; none of them meets anything that it did not meet before
    goal : what was made least
    objective_s : the sum of all delays, each times its weight, or the largest; seconds
    bound_s : no choice of delays that leaves so few tracks has a lower objective
    is_least : whether that is proven, to a millisecond: no other choice leaves fewer tracks, or as many for less
    proposal_id : its id in the database; None in memory
    notes : sentences on wishes that it cannot fulfil: areas that yield by a rule, tracks that get no new waypoints
    margin_s, margin_m : by how much more than the required separations the scene is clear
    """

    moves: tuple[Move, ...]
    left: tuple[Left, ...]
    goal: Goal
    objective_s: float
    bound_s: float
    is_least: bool
    proposal_id: int | None = None
    notes: tuple[str, ...] = ()
    margin_s: float = 0.0
    margin_m: float = 0.0

    def as_json(self) -> dict[str, Any]:
        """Return this as an object of JSON."""
        found = asdict(self)
        for move, row in zip(self.moves, found["moves"], strict=True):
            for passing in row["passes"]:
                passing["closest_at"] = format_moment(passing["closest_at"])
            row["departs_at"] = format_moment(move.departs_at)
            row["text"] = move.text()
        return found


@dataclass(frozen=True, slots=True)
class Detour:
    """Another way of a track, on which it meets nothing: what `detours` returns.

    leg : of the planned track, 1 the first, that has more waypoints
    waypoints_deg : these, longitude and latitude
    longer_m : how much longer the way is, metres
    later_s : how much later the track arrives, seconds
    track : the track on this way
    """

    key: str
    leg: int
    waypoints_deg: tuple[tuple[float, float], ...]
    longer_m: float
    later_s: float
    track: Track


def duration_text(seconds: float) -> str:
    """Return a duration in hours, minutes and seconds, rounded up to the second: ``4 min 12 s``."""
    whole = int(-(-seconds // 1))
    parts = [(whole // 3600, "h"), (whole // 60 % 60, "min"), (whole % 60, "s")]
    return " ".join(f"{count} {unit}" for count, unit in parts if count) or "0 s"


def _change(move: Move, clock: Clock, units: Units) -> str:
    if move.place is not None:
        return f"goes {move.place.text(units)}"
    if move.detour is not None:
        way = " and ".join(units.place(*place) for place in move.detour.waypoints_deg)
        longer = (
            f"{units.most_distance(move.detour.longer_m)} longer, arrives {duration_text(move.detour.later_s)} later"
        )
        return f"via {way} on leg {move.detour.leg}, {longer}"
    if move.speed != 1.0:
        return f"at {100.0 * move.speed:.1f} % of its speed"
    later = "later" if move.delay_s > 0.0 else "earlier"
    shift = f"{duration_text(abs(move.delay_s))} {later}"
    if move.departs_at is None:
        return shift
    verb = "is active from" if move.is_area else "departs"
    return f"{verb} {clock.text(move.departs_at)} {clock.name} ({shift})"
