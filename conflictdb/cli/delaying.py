"""`delays` and `speeds`: when tracks could depart, and how fast they could go instead."""

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import labels
from conflictdb.cli.output import out, print_json
from conflictdb.cli.session import database
from conflictdb.cli.tables import table, wrapped
from conflictdb.model.results import Delays, Forbidden, Speeds


def delays(args: argparse.Namespace) -> int:
    """Print the departures of tracks that are in conflict, and the least that are not."""
    with database(args) as db:
        stored = db.scene(args.scene)
        found = stored.delays(args.key, args.within, args.now, args.clear_within_m, args.waypoint)
        names = {} if args.format == "json" else stored.names(*_keys(found))
    if args.format == "json":
        print_json([one.as_json() for one in found])
    else:
        change = "departure" if args.waypoint is None else f"wait at waypoint {args.waypoint}"
        out(delays_text(found, args.within, names, change) if found else "no tracks")
        if args.key is not None and found[0].forbidden:
            out("\n" + _forbidden_table(found[0], names))
    return DONE


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


def delays_text(found: Sequence[Delays], within_s: float, names: Mapping[str, str], change: str = "departure") -> str:
    """Return a table of tracks, and a line for each one that no change within the horizon clears."""
    header = ["TRACK", "PLANNED", "LATER BY", "EARLIER BY", "MAY SHIFT BY", "CLEAR BY", "NAME", "MEETS"]
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
        meets = labels(names, nearest.by) if nearest else ""
        rows.append([one.key, *clears, _clear(one), names.get(one.key), meets])
    if all(one.clear_within_m is None for one in found):
        header, rows = [*header[:-3], *header[-2:]], [[*row[:-3], *row[-2:]] for row in rows]
    lines = [
        f"{labels(names, [one.key])}: no {change} within {_duration(within_s)} clears {labels(names, one.blocked_by)}"
        for one in found
        if one.blocked_by and not one.has_departed
    ]
    text = table(header, rows, right=header[2:-2], extra=["NAME"])
    return "\n".join([text, "", *map(wrapped, lines)] if lines else [text])


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
