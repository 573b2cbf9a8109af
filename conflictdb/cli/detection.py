"""`detect` and `conflicts`."""

import argparse

from conflictdb.cli.codes import CONFLICTS_FOUND, DONE
from conflictdb.cli.output import note, progress
from conflictdb.cli.parser import check
from conflictdb.cli.report import print_conflicts, remark_skipped, run_text
from conflictdb.cli.session import database, show_progress
from conflictdb.store import Conflict


def detect(args: argparse.Namespace) -> int:
    """Load files, detect, and print the conflicts."""
    check(
        args,
        [
            (not args.files and args.scene is None, "give files, or --scene NAME of a scene that is in the database"),
            (args.merge and not args.files, "--merge is for files"),
            (args.max_speed_kn is not None and not args.files, "--max-speed-kn is for files"),
        ],
    )
    with database(args) as db:
        scenes = [args.scene]
        if args.files:
            loaded = db.load_files(args.files, args.scene, merge=args.merge, max_speed_kn=args.max_speed_kn)
            remark_skipped(loaded)
            scenes = [one.scene for one in loaded]
        found: list[Conflict] = []
        for scene in scenes:
            run = db.detect(
                scene,
                method=args.method,
                tolerance_m=args.tolerance_m,
                separation_m=args.separation_m,
                full=args.full,
                jobs=args.jobs,
                progress=show_progress,
            )
            progress("")
            note(run_text(scene, run))
            found += db.conflicts(scene, with_region=_wants_region(args))
    print_conflicts(found, args.format)
    return CONFLICTS_FOUND if found and args.fail_on_conflict else DONE


def conflicts(args: argparse.Namespace) -> int:
    """Print the conflicts that are known."""
    with database(args) as db:
        found = db.conflicts(args.scene, args.at, with_region=_wants_region(args))
    print_conflicts(found, args.format)
    return DONE


def _wants_region(args: argparse.Namespace) -> bool:
    return args.format in ("json", "geojson") and not args.no_region
