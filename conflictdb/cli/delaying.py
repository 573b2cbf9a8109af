"""`delays` and `speeds`: when tracks could depart, and how fast they could go instead."""

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from typing import TYPE_CHECKING

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import labels
from conflictdb.cli.output import out, print_json
from conflictdb.cli.parser import check, resolve_times
from conflictdb.cli.session import database
from conflictdb.cli.tables import table, wrapped
from conflictdb.cli.values import chosen_units, chosen_zone
from conflictdb.model.clock import Clock, rounded_delay_us, rounded_window
from conflictdb.model.departure_text import duration_text
from conflictdb.model.inputs import MICROSECOND
from conflictdb.model.margin import Margin
from conflictdb.model.results import Delays, Forbidden, Opening, Speeds

if TYPE_CHECKING:
    from conflictdb.memory.area_places import FreePlace


def delays(args: argparse.Namespace) -> int:
    """Print the departures of plans that are in conflict, and the least that are not."""
    resolve_times(args, "start", "end")
    has_slots = (args.start, args.end, args.best) != (None, None, None)
    check(
        args,
        [
            (has_slots and args.key is None, "--from, --to and --best need a KEY"),
            (args.aside is not None and args.key is None, "--aside needs a KEY, of an area"),
            (args.bearing is not None and args.aside is None, "--bearing is for --aside"),
        ],
    )
    margin_s, margin_m = args.margin
    with database(args) as db:
        stored = db.scene(args.scene)
        found = stored.delays(
            args.key,
            args.within,
            args.now,
            args.clear_within_m,
            args.waypoint,
            margin_s=margin_s,
            margin_m=margin_m,
            start=args.start,
            end=args.end,
            best=args.best,
        )
        margins = {"margin_s": margin_s, "margin_m": margin_m}
        places = (
            None
            if args.aside is None
            else stored.places(args.key, args.aside, args.bearing, **margins, units=chosen_units())
        )
        met = () if places is None else (key for place in places for key in place.meets)
        names = {} if args.format == "json" else stored.names(*_keys(found), *met)
    if args.format == "json":
        more = {} if places is None else {"places": [asdict(one) for one in places]}
        print_json([one.as_json() | more for one in found])
        return DONE
    clock = Clock(args.tz or chosen_zone(), round(1e6 * args.round))
    change = "departure" if args.waypoint is None else f"wait at waypoint {args.waypoint}"
    margin = Margin.of("delays", margin_s, margin_m)
    out(delays_text(found, args.within, names, clock, margin, change) if found else "no tracks")
    if has_slots:
        out("\n" + slots_text(found[0], names, clock, margin))
    elif args.key is not None and found[0].forbidden:
        out("\n" + _forbidden_table(found[0], names))
    if places is not None:
        out("\n" + _places_text(places, args.aside, names, margin))
    return DONE


def _places_text(places: "Sequence[FreePlace]", aside_m: float, names: Mapping[str, str], margin: Margin) -> str:
    """Return where an area could be instead, the nearest first."""
    units = chosen_units()
    far = units.least_distance(aside_m)
    if any(one.distance_m == 0.0 for one in places):
        return f"it meets nothing where it is ({margin.text(chosen_units())})"
    rows = []
    for one in sorted(places, key=lambda each: (each.distance_m is None, each.distance_m or 0.0)):
        free = f"none within {far}" if one.distance_m is None else units.exact_distance(one.distance_m)
        rows.append([f"{one.bearing_deg % 360.0:03.0f}°", free, labels(names, one.meets)])
    header = ["BEARING", "FREE FROM", "CLEARS, OR STILL MEETS"]
    return "\n".join([table(header, rows), "", margin.text(chosen_units())])


def speeds(args: argparse.Namespace) -> int:
    """Print the speeds of tracks that are in conflict, and the nearest that are not."""
    with database(args) as db:
        stored = db.scene(args.scene)
        found = stored.speeds(args.key, args.slowest, args.fastest, args.leg)
        names = {} if args.format == "json" else stored.names(*_keys(found))
    if args.format == "json":
        print_json([one.as_json() for one in found])
    else:
        out(speeds_text(found, args.slowest, args.fastest, names) if found else "no tracks")
        if args.key is not None and found[0].forbidden:
            out("\n" + _forbidden_speeds_table(found[0], names))
    return DONE


def _keys(found: Sequence[Delays] | Sequence[Speeds]) -> Iterator[str]:
    """Yield the keys of tracks, and of all that they would meet."""
    for one in found:
        yield one.key
        yield from one.blocked_by
        for each in one.forbidden:
            yield from each.by


def delays_text(
    found: Sequence[Delays],
    within_s: float,
    names: Mapping[str, str],
    clock: Clock,
    margin: Margin,
    change: str = "departure",
) -> str:
    """Return a table of plans, and a line for each plan that no change within the horizon clears."""
    header = ["KEY", "PLANNED", f"DEPARTS ({clock.name})", "LATER", "EARLIER"]
    header += ["MAY SHIFT BY", "CLEAR BY", "NAME", "MEETS"]
    rows = []
    for one in found:
        slack, nearest = one.clear_by_s, _nearest(one)
        planned = ("too close" if margin else "conflict") if slack == 0.0 else "free"
        departs = "" if one.departs_at is None else clock.text(one.departs_at)
        if one.has_departed:
            clears = [planned, departs, "departed", "departed", ""]
        elif slack == 0.0:
            ways = (_departure(one, clock, later=later) for later in (True, False))
            clears = [planned, departs, *ways, ""]
        else:
            # Rounded down: so far it may shift for certain.
            shift = f"{_duration(within_s)} or more" if slack is None else _duration(math.floor(1e3 * slack) / 1e3)
            clears = [planned, departs, "", "", shift]
        meets = labels(names, nearest.by) if nearest else ""
        rows.append([one.key, *clears, _clear(one), names.get(one.key), meets])
    if all(one.clear_within_m is None for one in found):
        header, rows = [*header[:-3], *header[-2:]], [[*row[:-3], *row[-2:]] for row in rows]
    lines = [
        f"{labels(names, [one.key])}: no {change} within {_horizon(one)} clears {labels(names, one.blocked_by)}"
        for one in found
        if one.blocked_by and not one.has_departed
    ]
    lines.append(margin.text(chosen_units()))
    return "\n".join([table(header, rows, right=header[5:-2], extra=["NAME"]), "", *map(wrapped, lines)])


def slots_text(one: Delays, names: Mapping[str, str], clock: Clock, margin: Margin) -> str:
    """Return the free windows, best first, and what closes the other departures, one a row."""
    if one.slots is None or one.closed is None:
        return "no planned departure, and so no windows"
    planned_at = one.departs_at
    lines = []
    for slot in one.slots:
        lines.append(f"free    {_window(*rounded_window(slot.from_at, slot.to_at, clock), clock, planned_at)}")
    if not one.slots:
        lines.append(f"no free window ({margin.text(chosen_units())})")
    for gap in one.closed:
        # Rounded outward: every departure outside of it is another row's.
        ends = clock.rounded(gap.from_at, up=False), clock.rounded(gap.to_at, up=True)
        text = f"closed  {_window(*ends, clock, planned_at)}, by {labels(names, gap.by)}"
        if gap.opened_by:
            is_one = len(gap.opened_by) == 1
            changes = (
                _opening(one, "it" if is_one else labels(names, [one.key]), clock, planned_at) for one in gap.opened_by
            )
            text += f"; free if {' and '.join(changes)}"
        lines.append(text)
    return "\n".join(lines)


def _opening(one: Opening, who: str, clock: Clock, beside: datetime | None) -> str:
    """Return when an area ends, or starts: rounded so that it is there for less time."""
    if one.ends_at is not None:
        return f"{who} ends at {clock.text(clock.rounded(one.ends_at, up=False), beside)}"
    assert one.starts_at is not None  # noqa: S101
    return f"{who} starts at {clock.text(clock.rounded(one.starts_at, up=True), beside)}"


def _window(low: datetime, high: datetime, clock: Clock, beside: datetime | None) -> str:
    return f"{clock.text(low, beside)}-{clock.text(high, low)}"


def _departure(one: Delays, clock: Clock, *, later: bool) -> str:
    """Return the least departure without a conflict as a clock time, and how much later or earlier it is."""
    least_s = one.least_later_s if later else one.least_earlier_s
    if least_s is None:
        return "none"
    delay_us = rounded_delay_us(one, round(1e6 * least_s) * (1 if later else -1), clock, later=later)
    shift = duration_text(abs(delay_us))
    if one.departs_at is None:
        return shift
    return f"{clock.text(one.departs_at + delay_us * MICROSECOND, one.departs_at)} ({shift})"


def speeds_text(found: Sequence[Speeds], slowest: float, fastest: float, names: Mapping[str, str]) -> str:
    """Return a table of tracks, and a line for each one that no speed within the limits clears."""
    header = ["TRACK", "PLANNED", "SLOWER", "FASTER", "NAME", "MEETS"]
    rows = []
    for one in found:
        is_free = one.slower == 1.0
        nearest = min(one.forbidden, key=lambda each: max(each.from_factor - 1.0, 1.0 - each.to_factor), default=None)
        nearby = ["", ""] if is_free else [_factor(one, one.slower, -1), _factor(one, one.faster, 1)]
        meets = labels(names, nearest.by) if nearest else ""
        verdict = "free" if is_free else "conflict"
        rows.append([one.key, verdict, *nearby, names.get(one.key), meets])
    limits = f"from {slowest:g} to {fastest:g} times the planned one"
    lines = [
        f"{labels(names, [one.key])}: no speed {limits} clears {labels(names, one.blocked_by)}"
        for one in found
        if one.blocked_by
    ]
    text = table(header, rows, right=header[2:4], extra=["NAME"])
    return "\n".join([text, "", *map(wrapped, lines)] if lines else [text])


def _factor(one: Speeds, factor: float | None, sign: int) -> str:
    """Return a factor with as few digits as leave it free, rounded away from the planned speed."""
    if factor is None:
        return "none"
    for digits in range(3, 12):
        rounded = sign * math.ceil(sign * factor * 10**digits) / 10**digits
        if not any(each.from_factor <= rounded <= each.to_factor for each in one.forbidden):
            return f"{rounded:.{digits}f}"
    return f"{factor:.12f}"


def _forbidden_speeds_table(one: Speeds, names: Mapping[str, str]) -> str:
    header = ["IN CONFLICT FROM", "TO", "ERRORS", "PROVEN", "MEETS"]
    rows = [
        [
            f"{each.from_factor:.9f}",
            f"{each.to_factor:.9f}",
            f"{each.from_error:.1e}, {each.to_error:.1e}",
            "yes" if each.is_proven else "in part",
            labels(names, each.by),
        ]
        for each in one.forbidden
    ]
    return table(header, rows, right=header[:3])


def _forbidden_table(one: Delays, names: Mapping[str, str]) -> str:
    header = ["IN CONFLICT FROM", "TO", "ERRORS (S)", "PROVEN", "MEETS"]
    rows = [
        [
            _signed(each.from_s),
            _signed(each.to_s),
            f"{each.from_error_s:.6f}, {each.to_error_s:.6f}",
            "yes" if each.is_proven else "in part",
            labels(names, each.by),
        ]
        for each in one.forbidden
    ]
    return table(header, rows, right=header[:3])


def _nearest(one: Delays) -> Forbidden | None:
    """Return the forbidden interval that a departure as planned is in, or nearest to."""
    return min(one.forbidden, key=lambda each: max(each.from_s, -each.to_s, 0.0), default=None)


def _clear(one: Delays) -> str:
    """Return the distance by which a track without a conflict clears everything for certain, rounded down."""
    if one.clear_within_m is None or one.clear_by_s == 0.0:
        return ""
    if one.clear_by_m is None:
        return f"{chosen_units().given_distance(one.clear_within_m)} or more"
    least_m = 0.0 if one.clear_error_m is None else max(one.clear_by_m - one.clear_error_m, 0.0)
    return chosen_units().least_distance(least_m)


def _horizon(one: Delays) -> str:
    return duration_text(round(1e6 * max(one.latest_s, -one.earliest_s)))


def _signed(delay_s: float) -> str:
    return f"{'-' if delay_s < 0.0 else '+'}{_duration(abs(delay_s))}"


def _duration(duration_s: float) -> str:
    """Return hours, minutes and seconds; with milliseconds or microseconds if they are not whole."""
    seconds, micros = divmod(round(1e6 * duration_s), 1_000_000)
    whole = f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"
    if not micros:
        return whole
    return f"{whole}.{micros // 1000:03}" if micros % 1000 == 0 else f"{whole}.{micros:06}"
