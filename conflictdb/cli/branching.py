"""`branch`: make, compare, merge and drop branches of a scene."""

import argparse
from dataclasses import asdict

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import line, out, print_json
from conflictdb.cli.parser import check
from conflictdb.cli.session import database
from conflictdb.cli.tables import table
from conflictdb.store import BranchDiff


def branch(args: argparse.Namespace) -> int:
    """Make, compare, merge or drop a branch."""
    check(args, [(args.proposal is not None and args.action != "create", "--proposal goes with create")])
    if args.action != "create":
        # The branch is the scene.
        args.scene = args.branch
    with database(args) as db:
        scene = db.scene(args.scene)
        if args.action == "create":
            made = scene.branch(args.branch, args.proposal)
            line(f"{made.name}: a branch of {args.scene}")
            args.scene = made.name
        elif args.action == "merge":
            parent, count = scene.branch_of(), scene.merge()
            line(f"{parent}: {count} {_objects(count)} taken over from {args.branch}; to be detected")
            args.scene = parent
        elif args.action == "drop":
            args.scene = scene.branch_of()
            scene.drop()
            line(f"{args.branch}: dropped")
        else:
            _show(args, scene.diff())
    return DONE


def _objects(count: int) -> str:
    return "object" if count == 1 else "objects"


def _show(args: argparse.Namespace, found: BranchDiff) -> None:
    if args.format == "json":
        print_json(asdict(found))
        return
    lines = [[one.change, one.kind, one.key, one.name] for one in found.objects]
    lines += [[one.change, one.verdict or one.verdict_before, one.a_key, one.b_key] for one in found.conflicts]
    out(table(["CHANGE", "WHAT", "KEY", "NAME OR KEY"], lines) if lines else "no difference")
