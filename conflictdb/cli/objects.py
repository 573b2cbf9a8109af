"""`load` and `export`."""

import argparse

from conflictdb.cli.codes import DONE, LEFT_OUT
from conflictdb.cli.output import data, out
from conflictdb.cli.report import loaded_text, remark_loaded
from conflictdb.cli.session import database, load_files


def load(args: argparse.Namespace) -> int:
    """Load files."""
    with database(args) as db:
        loaded = load_files(db, args)
    remark_loaded(loaded)
    for one in loaded:
        out(loaded_text(one))
    return LEFT_OUT if any(one.invalid for one in loaded) else DONE


def export(args: argparse.Namespace) -> int:
    """Write a scene file."""
    with database(args) as db:
        if args.file == "-":
            data([db.scene_text(args.scene)], is_json=True)
        else:
            db.export(args.scene, args.file)
    return DONE
