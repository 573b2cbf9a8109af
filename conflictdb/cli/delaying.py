"""`delays` and `speeds`: when tracks could depart, and how fast they could go instead."""

import argparse
import math
from collections.abc import Sequence

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import out, print_json, table
from conflictdb.cli.session import database
from conflictdb.model.results import Delays, Forbidden, Speeds


def delays(args: argparse.Namespace) -> int:
    """Print the departures of tracks that are in conflict, and the least that are not."""
    with database(args) as db:
        stored = db.scene(args.scene)
        found = stored.delays(args.key, args.within, args.now, args.clear_within_m, args.waypoint)
    if args.format == "json":
        print_json([one.as_json() for one in found])
    else:
        change = "departure" if args.waypoint is None else f"wait at waypoint {args.waypoint}"
        out(delays_text(found, args.within, change) if found else "no tracks")
        if args.key is not None and found[0].forbidden:
            out("\n" + _forbidden_table(found[0]))
    return DONE


def speeds(args: argparse.Namespace) -> int:
    """Print the speeds of tracks that are in conflict, and the nearest that are not."""
    with database(args) as db:
        found = db.scene(args.scene).speeds(args.key, args.slowest, args.fastest, args.leg)
    if args.format == "json":
        print_json([one.as_json() for one in found])
    else:
        out(speeds_text(found, args.slowest, args.fastest) if found else "no tracks")
        if args.key is not None and found[0].forbidden:
            out("\n" + _forbidden_speeds_table(found[0]))
    return DONE


def delays_text(found: Sequence[Delays], within_s: float, change: str = "departure") -> str:
    """Return a table of tracks, and a line for each one that no change within the horizon clears."""
    header = ["TRACK", "PLANNED", "LATER BY", "EARLIER BY", "MAY SHIFT BY", "CLEAR BY", "MEETS"]
    rows = []
    for one in found:
        slack, nearest = one.clear_by_s, _nearest(one)
        if one.has_departed:
            clears = ["conflict" if slack == 0.0 else "free", "departed", "departed", ""]
        elif slack == 0.0:
            clears = ["conflict", _least(one.least_later_s), _least(one.least_earlier_s), ""]
        else:
            # Rounded down: so far it may shift for certain.
            shift = f"{_duration(within_s)} or more" if slack is None else _duration(math.floor(1e3 * slack) / 1e3)
            clears = ["free", "", "", shift]
        rows.append([one.key, *clears, _clear(one), ", ".join(nearest.by) if nearest else ""])
    if all(one.clear_within_m is None for one in found):
        header, *rows = ([*row[:-2], row[-1]] for row in (header, *rows))
    lines = [
        f"{one.key}: no {change} within {_duration(within_s)} clears {', '.join(one.blocked_by)}"
        for one in found
        if one.blocked_by and not one.has_departed
    ]
    text = table(header, rows, right=header[2:-1])
    return "\n".join([text, "", *lines] if lines else [text])


def speeds_text(found: Sequence[Speeds], slowest: float, fastest: float) -> str:
    """Return a table of tracks, and a line for each one that no speed within the limits clears."""
    header = ["TRACK", "PLANNED", "SLOWER", "FASTER", "MEETS"]
    rows = []
    for one in found:
        is_free = one.slower == 1.0
        nearest = min(one.forbidden, key=lambda each: max(each.from_factor - 1.0, 1.0 - each.to_factor), default=None)
        nearby = ["", ""] if is_free else [_factor(one, one.slower, -1), _factor(one, one.faster, 1)]
        rows.append([one.key, "free" if is_free else "conflict", *nearby, ", ".join(nearest.by) if nearest else ""])
    lines = [
        f"{one.key}: no speed from {slowest:g} to {fastest:g} times the planned one clears {', '.join(one.blocked_by)}"
        for one in found
        if one.blocked_by
    ]
    text = table(header, rows, right=header[2:4])
    return "\n".join([text, "", *lines] if lines else [text])


def _factor(one: Speeds, factor: float | None, sign: int) -> str:
    """Return a factor with as few digits as leave it free, rounded away from the planned speed."""
    if factor is None:
        return "none"
    for digits in range(3, 12):
        rounded = sign * math.ceil(sign * factor * 10**digits) / 10**digits
        if not any(each.from_factor <= rounded <= each.to_factor for each in one.forbidden):
            return f"{rounded:.{digits}f}"
    return f"{factor:.12f}"


def _forbidden_speeds_table(one: Speeds) -> str:
    header = ["IN CONFLICT FROM", "TO", "ERRORS", "PROVEN", "MEETS"]
    rows = [
        [
            f"{each.from_factor:.9f}",
            f"{each.to_factor:.9f}",
            f"{each.from_error:.1e}, {each.to_error:.1e}",
            "yes" if each.is_proven else "in part",
            ", ".join(each.by),
        ]
        for each in one.forbidden
    ]
    return table(header, rows, right=header[:3])


def _forbidden_table(one: Delays) -> str:
    header = ["IN CONFLICT FROM", "TO", "ERRORS (S)", "PROVEN", "MEETS"]
    rows = [
        [
            _signed(each.from_s),
            _signed(each.to_s),
            f"{each.from_error_s:.6f}, {each.to_error_s:.6f}",
            "yes" if each.is_proven else "in part",
            ", ".join(each.by),
        ]
        for each in one.forbidden
    ]
    return table(header, rows, right=header[:3])


def _nearest(one: Delays) -> Forbidden | None:
    """Return the forbidden interval that a departure as planned is in, or nearest to."""
    return min(one.forbidden, key=lambda each: max(each.from_s, -each.to_s, 0.0), default=None)


def _least(least_s: float | None) -> str:
    return "none" if least_s is None else _duration(least_s)


def _clear(one: Delays) -> str:
    """Return the distance by which a track without a conflict clears everything for certain, rounded down."""
    if one.clear_within_m is None or one.clear_by_s == 0.0:
        return ""
    if one.clear_by_m is None:
        return f"{one.clear_within_m:g} m or more"
    least_m = 0.0 if one.clear_error_m is None else max(one.clear_by_m - one.clear_error_m, 0.0)
    return f"{math.floor(10.0 * least_m) / 10.0:.1f} m"


def _signed(delay_s: float) -> str:
    return f"{'-' if delay_s < 0.0 else '+'}{_duration(abs(delay_s))}"


def _duration(duration_s: float) -> str:
    """Return hours, minutes and seconds; with milliseconds or microseconds if they are not whole."""
    seconds, micros = divmod(round(1e6 * duration_s), 1_000_000)
    whole = f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"
    if not micros:
        return whole
    return f"{whole}.{micros // 1000:03}" if micros % 1000 == 0 else f"{whole}.{micros:06}"
