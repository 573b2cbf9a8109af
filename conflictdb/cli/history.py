"""`history` and `acknowledge`."""

import argparse
from dataclasses import fields
from datetime import datetime
from typing import Any

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import moment_text
from conflictdb.cli.output import out, print_json, table
from conflictdb.cli.parser import check
from conflictdb.cli.session import database
from conflictdb.formats.instants import format_moment
from conflictdb.model.results import ConflictEvent


def history(args: argparse.Namespace) -> int:
    """Print the history of conflicts."""
    check(args, [(len(args.keys) > 2, "give the keys of two objects at most")])
    with database(args) as db:
        found = db.scene(args.scene).conflict_events(*args.keys, after=args.after)
    if args.format == "json":
        print_json([_facts(event) for event in found])
    else:
        out(_table(found) if found else "no events")
    return DONE


def acknowledge(args: argparse.Namespace) -> int:
    """Acknowledge a conflict, or withdraw its acknowledgement."""
    check(args, [(args.undo and (args.until, args.by) != (None, None), "--until and --by go with --reason")])
    a_key, b_key = args.keys
    with database(args) as db:
        if args.undo:
            out("taken back" if db.scene(args.scene).unacknowledge(a_key, b_key) else "was not acknowledged")
        else:
            db.scene(args.scene).acknowledge(a_key, b_key, args.reason, args.until, by=args.by)
            out("acknowledged")
    return DONE


def _table(events: list[ConflictEvent]) -> str:
    header = ["EVENT", "AT (UTC)", "WHAT", "A", "B", "VERDICT", "FIRST CONTACT (UTC)", "LAST CONTACT (UTC)"]
    rows = [
        [
            event.event,
            moment_text(event.at, up=False),
            event.kind,
            event.a_key,
            event.b_key,
            event.verdict,
            moment_text(event.periods[0][0], up=False),
            moment_text(event.periods[-1][1], up=True),
        ]
        for event in events
    ]
    return table(header, rows, right=["EVENT"])


def _facts(event: ConflictEvent) -> dict[str, object]:
    """Return the columns of the view `conflict_events`."""
    return {one.name: _fact(getattr(event, one.name)) for one in fields(event)}


def _fact(value: Any) -> object:
    if isinstance(value, tuple):
        return [[format_moment(start), format_moment(end)] for start, end in value]
    return format_moment(value) if isinstance(value, datetime) else value
