"""`plot` and `report`."""

import argparse

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import remark_incomplete, require_current
from conflictdb.cli.output import note
from conflictdb.cli.session import database


def plot(args: argparse.Namespace) -> int:
    """Draw a scene, or two of its objects."""
    from conflictdb.drawing import figures

    figures.check_name(args.file)
    with database(args) as db:
        if args.wait is not None:
            db.scene(args.scene).wait_until_current(args.wait)
        state = db.scene(args.scene).state()
        require_current(args, state)
        remark_incomplete([state])
        figures.save(db.scene(args.scene).plot(*(args.conflict or ())), args.file)
    note(f"{args.file} is written")
    return DONE


def report(args: argparse.Namespace) -> int:
    """Write a report of a scene."""
    with database(args) as db:
        if args.wait is not None:
            db.scene(args.scene).wait_until_current(args.wait)
        state = db.scene(args.scene).state()
        require_current(args, state)
        remark_incomplete([state])
        db.scene(args.scene).report(args.file)
    note(f"{args.file} is written")
    return DONE
