"""`load` and `export`."""

import argparse
import sys

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import out
from conflictdb.cli.report import loaded_text, remark_loaded
from conflictdb.cli.session import database


def load(args: argparse.Namespace) -> int:
    """Load files."""
    with database(args) as db:
        loaded = db.load_files(args.files, args.scene, merge=args.merge, max_speed_kn=args.max_speed_kn)
    remark_loaded(loaded)
    for one in loaded:
        out(loaded_text(one))
    return DONE


def export(args: argparse.Namespace) -> int:
    """Write a scene file."""
    with database(args) as db:
        if args.file == "-":
            sys.stdout.write(db.scene_text(args.scene))
        else:
            db.export(args.scene, args.file)
    return DONE
