"""`certify`: print a proof of what a detection found."""

import argparse
import os
import sys

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import remark
from conflictdb.cli.session import database


def certify(args: argparse.Namespace) -> int:
    """Print the proof of a scene."""
    with database(args) as db:
        found = db.scene(args.scene).certify(sys.stdout, jobs=args.jobs or os.cpu_count() or 1, delays=args.delays)
    remark(
        f"{args.scene}: {found.pairs:,} pairs of pieces apart by {found.directions:,} directions, "
        f"{found.conflicts:,} conflicts" + (f", {found.delays:,} least delays" if found.delays else "")
    )
    if not found:
        remark(
            f"{args.scene}: without proof: {found.unproven_pairs:,} pairs of pieces, "
            f"{found.unproven_conflicts:,} conflicts, {found.unproven_delays:,} least delays"
        )
    return DONE
