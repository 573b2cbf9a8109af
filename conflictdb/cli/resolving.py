"""`resolve` and `apply`: propose delays that clear a scene, apply and undo them."""

import argparse
from collections.abc import Iterator, Mapping

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import labels
from conflictdb.cli.output import out, print_json, program
from conflictdb.cli.session import database
from conflictdb.cli.tables import wrapped
from conflictdb.model.proposals import Goal, Proposal, duration_text


def resolve(args: argparse.Namespace) -> int:
    """Print and store a proposal."""
    with database(args) as db:
        stored = db.scene(args.scene)
        found = stored.resolve(
            keys=args.keys or None,
            keep=args.keep,
            weights=dict(args.weight or ()),
            levels=dict(args.level or ()),
            within_s=args.within,
            now=args.now,
            slowest=args.slowest,
            fastest=args.fastest,
            aside_m=args.aside,
            goal=args.goal,
            limit_s=args.limit,
        )
        names = {} if args.format == "json" else stored.names(*_keys(found))
    if args.format == "json":
        print_json(found.as_json())
    else:
        out(proposal_text(found, names))
    return DONE


def apply(args: argparse.Namespace) -> int:
    """Apply or undo a proposal."""
    with database(args) as db:
        change = db.undo_proposal if args.undo else db.apply_proposal
        count = change(args.proposal, attached=args.attached)
    if not count:
        out("the proposal moves nothing")
        return DONE
    done = "restored" if args.undo else "moved"
    out(f"{done} {count} track{'' if count == 1 else 's'}; the scene waits for detection")
    return DONE


def proposal_text(found: Proposal, names: Mapping[str, str]) -> str:
    """Return a sentence for each move and for each track that is left, and how good the proposal is."""
    lines = [wrapped(move.text(names)) for move in found.moves]
    lines += [
        wrapped(f"{labels(names, [one.key])} stays in conflict: blocked by {labels(names, one.blocked_by)}")
        for one in found.left
    ]
    lines += [wrapped(f"note: {one}") for one in found.notes]
    if not found.moves:
        return "\n".join([*lines, "nothing to move"])
    is_total = found.goal is Goal.TOTAL
    delays_s = [abs(move.delay_s) for move in found.moves]
    is_weighted = abs((sum if is_total else max)(delays_s) - found.objective_s) > 1e-3
    what = ("weighted " if is_weighted else "") + ("delay in all" if is_total else "largest delay")
    proof = "the least" if found.is_least else f"at best {duration_text(found.bound_s)}"
    summary = f"proposal {found.proposal_id}: {len(found.moves)} moved, {len(found.left)} left; {what} "
    summary += f"{duration_text(found.objective_s)}, {proof}"
    return "\n".join([*lines, "", summary, f"apply it: {program()} apply {found.proposal_id}"])


def _keys(found: Proposal) -> Iterator[str]:
    for move in found.moves:
        yield move.key
        yield from (one.key for one in move.passes)
    for left in found.left:
        yield left.key
        yield from left.blocked_by
