"""`branch`: make, compare, merge and drop branches of a scene."""

import argparse
from collections.abc import Sequence

from conflictdb import store
from conflictdb.cli.changing import changes, has_changes
from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import Shown, json_row, span_text
from conflictdb.cli.output import line, out, print_json
from conflictdb.cli.parser import check
from conflictdb.cli.session import database
from conflictdb.cli.tables import table
from conflictdb.model.results import Period
from conflictdb.store import BranchDiff


def branch(args: argparse.Namespace) -> int:
    """Make, compare, merge or drop a branch."""
    is_other = args.action != "create"
    check(
        args,
        [
            (args.proposal is not None and is_other, "--proposal goes with create"),
            (has_changes(args) and is_other, "--late, --move and --swap go with create"),
            (has_changes(args) and args.proposal is not None, "--proposal goes without --late, --move and --swap"),
        ],
    )
    changed = changes(args)
    if is_other:
        # The branch is the scene.
        args.scene = args.branch
    with database(args) as db:
        scene = db.scene(args.scene)
        if args.action == "create":
            plans = changed(scene)
            with store.transaction(db.connection):
                made = scene.branch(args.branch, args.proposal)
                if plans:
                    made.put(plans)
            line(f"{made.name}: a branch of {args.scene}{f', {len(plans)} changed' if plans else ''}")
            args.scene = made.name
        elif args.action == "merge":
            parent, count = scene.branch_of(), scene.merge()
            waits = "; to be detected" if count else ""
            line(f"{parent}: {count} {_objects(count)} taken over from {args.branch}{waits}")
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
        objects, conflicts = ([json_row(one) for one in some] for some in (found.objects, found.conflicts))
        print_json({"objects": objects, "conflicts": conflicts})
        return
    lines = [[one.change, one.kind, one.key, one.name, "", ""] for one in found.objects]
    lines += [
        [
            *(one.change, one.verdict or one.verdict_before, one.a_key, one.b_key),
            *(_spans(periods) for periods in (one.periods, one.periods_before)),
        ]
        for one in found.conflicts
    ]
    header = ["CHANGE", "WHAT", "KEY", "NAME OR KEY", *map(Shown().header, ("NOW", "WAS"))]
    out(table(header, lines, whole=header[4:]) if lines else "no difference")


def _spans(periods: Sequence[Period]) -> str:
    """Return from when to when, and of how many periods."""
    if not periods:
        return ""
    text = span_text(periods[0][0], periods[-1][1])
    return text if len(periods) == 1 else f"{text} ({len(periods)} periods)"
