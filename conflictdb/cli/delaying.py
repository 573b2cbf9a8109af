"""`delays`: when tracks could depart instead."""

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import labels, shortened
from conflictdb.cli.output import out, print_json, table
from conflictdb.cli.session import database
from conflictdb.model.results import Delays, Forbidden


def delays(args: argparse.Namespace) -> int:
    """Print the departures of tracks that are in conflict, and the least that are not."""
    with database(args) as db:
        found = db.scene(args.scene).delays(args.key, args.within)
        names = {} if args.format == "json" else db.scene(args.scene).names(*_keys(found))
    if args.format == "json":
        print_json([one.as_json() for one in found])
    else:
        out(delays_text(found, args.within, names) if found else "no tracks")
        if args.key is not None and found[0].forbidden:
            out("\n" + _forbidden_table(found[0], names))
    return DONE


def _keys(found: Sequence[Delays]) -> Iterator[str]:
    """Yield the keys of tracks, and of all that they would meet."""
    for one in found:
        yield one.key
        yield from one.blocked_by
        for each in one.forbidden:
            yield from each.by


def delays_text(found: Sequence[Delays], within_s: float, names: Mapping[str, str]) -> str:
    """Return a table of tracks, and a line for each one that no departure within the horizon clears."""
    header = ["TRACK", "NOW", "LATER BY", "EARLIER BY", "MAY SHIFT BY", "NAME", "MEETS"]
    rows = []
    for one in found:
        slack, nearest = one.clear_by_s, _nearest(one)
        if slack == 0.0:
            clears = ["conflict", _least(one.least_later_s), _least(one.least_earlier_s), ""]
        else:
            # Rounded down: so far it may shift for certain.
            shift = f"{_duration(within_s)} or more" if slack is None else _duration(math.floor(1e3 * slack) / 1e3)
            clears = ["free", "", "", shift]
        rows.append([one.key, *clears, shortened(names.get(one.key)), labels(names, nearest.by) if nearest else ""])
    lines = [
        f"{labels(names, [one.key])}: no departure within {_duration(within_s)} clears {labels(names, one.blocked_by)}"
        for one in found
        if one.blocked_by
    ]
    text = table(header, rows, right=header[2:5])
    return "\n".join([text, "", *lines] if lines else [text])


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


def _signed(delay_s: float) -> str:
    return f"{'-' if delay_s < 0.0 else '+'}{_duration(abs(delay_s))}"


def _duration(duration_s: float) -> str:
    """Return hours, minutes and seconds; with milliseconds or microseconds if they are not whole."""
    seconds, micros = divmod(round(1e6 * duration_s), 1_000_000)
    whole = f"{seconds // 3600}:{seconds // 60 % 60:02}:{seconds % 60:02}"
    if not micros:
        return whole
    return f"{whole}.{micros // 1000:03}" if micros % 1000 == 0 else f"{whole}.{micros:06}"
