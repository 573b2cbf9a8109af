"""`history` and `acknowledge`."""

import argparse
from collections.abc import Mapping

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import Shown, json_row, labels, table_with_names
from conflictdb.cli.output import line, out, print_json
from conflictdb.cli.parser import check, resolve_times
from conflictdb.cli.session import database
from conflictdb.cli.values import chosen_zone
from conflictdb.model.results import ConflictEvent


def history(args: argparse.Namespace) -> int:
    """Print the history of conflicts."""
    resolve_times(args, "since")
    check(args, [(len(args.keys) > 2, "give the keys of two objects at most")])
    with database(args) as db:
        found = db.scene(args.scene).conflict_events(*args.keys, after=args.after, since=args.since)
        is_json = args.format == "json"
        names = {} if is_json else db.scene(args.scene).names(*(key for one in found for key in (one.a_key, one.b_key)))
    if is_json:
        print_json([json_row(event) for event in found])
    else:
        out(events_table(found, names, Shown(args.tz or chosen_zone())) if found else "no events")
    return DONE


def acknowledge(args: argparse.Namespace) -> int:
    """Acknowledge a conflict, or withdraw its acknowledgement."""
    check(args, [(args.undo and (args.until, args.by) != (None, None), "--until and --by go with --reason")])
    a_key, b_key = args.keys
    with database(args) as db:
        scene = db.scene(args.scene)
        if args.undo:
            done = "taken back" if scene.unacknowledge(a_key, b_key) else "was not acknowledged"
        else:
            scene.acknowledge(a_key, b_key, args.reason, args.until, by=args.by)
            done = "acknowledged"
        line(f"{done}: {labels(scene.names(a_key, b_key), (a_key, b_key))}")
    return DONE


def events_table(events: list[ConflictEvent], names: Mapping[str, str], shown: Shown) -> str:
    """Return events as a table."""
    times = [shown.header(text) for text in ("AT", "FIRST CONTACT", "LAST CONTACT")]
    header = ["EVENT", times[0], "WHAT", "A", "B", "VERDICT", *times[1:]]
    names_of = [(names.get(event.a_key), names.get(event.b_key)) for event in events]
    rows = [
        [
            event.event,
            shown.moment(event.at, up=False),
            event.kind,
            event.a_key,
            event.b_key,
            event.verdict,
            shown.moment(event.periods[0][0], up=False),
            shown.moment(event.periods[-1][1], up=True),
        ]
        for event in events
    ]
    return table_with_names(header, rows, names_of, right=["EVENT"], whole=times)
