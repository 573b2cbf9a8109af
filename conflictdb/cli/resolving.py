"""`resolve` and `apply`: propose delays that clear a scene, apply and undo them."""

import argparse
from collections.abc import Iterator, Mapping

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import labels
from conflictdb.cli.output import out, print_json, program
from conflictdb.cli.session import database
from conflictdb.cli.tables import wrapped
from conflictdb.cli.values import chosen_units, chosen_zone
from conflictdb.model.clock import Clock
from conflictdb.model.margin import Margin
from conflictdb.model.proposals import Goal, Proposal, duration_text


def resolve(args: argparse.Namespace) -> int:
    """Print and store a proposal."""
    margin_s, margin_m = args.margin
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
            movable=args.movable,
            margin_s=margin_s,
            margin_m=margin_m,
            round_s=args.round,
            time_zone=args.tz or chosen_zone(),
            units=chosen_units(),
        )
        names = {} if args.format == "json" else stored.names(*_keys(found))
    if args.format == "json":
        print_json(found.as_json())
    else:
        out(proposal_text(found, names, Clock(args.tz or chosen_zone(), round(1e6 * args.round))))
        if found.left:
            out(wrapped(_tried(args)))
    return DONE


def _tried(args: argparse.Namespace) -> str:
    """Return what was tried for those that stay in conflict, and which options would look further."""
    tried = [f"delays up to {duration_text(args.within)}"]
    further = ["--within (longer delays)"]
    places = " and places of areas" if args.movable else ""
    for is_given, what, option in (
        (args.now is not None, "earlier departures", "--now (earlier departures)"),
        (not args.slowest == args.fastest == 1.0, "other speeds", "--slowest and --fastest (other speeds)"),
        (args.aside > 0.0, f"new waypoints{places}", f"--aside (new waypoints{places})"),
        (bool(args.movable), "other times of areas", "--movable (other times of areas, with --aside other places)"),
    ):
        if is_given:
            tried.append(what)
        else:
            further.append(option)
    if args.keys or args.keep:
        further.append("no KEY, no --keep (all may move)")
    return f"tried: {', '.join(tried)}; these look further: {', '.join(further)}"


def apply(args: argparse.Namespace) -> int:
    """Apply or undo a proposal."""
    with database(args) as db:
        change = db.undo_proposal if args.undo else db.apply_proposal
        count = change(args.proposal, attached=args.attached)
    if not count:
        out("the proposal moves nothing")
        return DONE
    done = "restored" if args.undo else "moved"
    out(f"{done} {count} plan{'' if count == 1 else 's'}; the scene waits for detection")
    return DONE


def proposal_text(found: Proposal, names: Mapping[str, str], clock: Clock) -> str:
    """Return a sentence for each move and for each plan that is left, and how good the proposal is."""
    lines = [wrapped(move.text(names, clock, chosen_units())) for move in found.moves]
    lines += [
        wrapped(f"{labels(names, [one.key])} stays in conflict: blocked by {labels(names, one.blocked_by)}")
        for one in found.left
    ]
    lines += [wrapped(f"note: {one}") for one in found.notes]
    margin = Margin.of("resolve", found.margin_s, found.margin_m).text(chosen_units())
    if not found.moves:
        nothing = "nothing found that may move" if found.left else f"nothing to move: no conflict that moves ({margin})"
        return "\n".join([*lines, nothing])
    is_total = found.goal is Goal.TOTAL
    delays_s = [abs(move.delay_s) for move in found.moves]
    is_weighted = abs((sum if is_total else max)(delays_s) - found.objective_s) > 1e-3
    what = ("weighted " if is_weighted else "") + ("delay in all" if is_total else "largest delay")
    proof = f"at best {duration_text(found.bound_s)}"
    if found.is_least:
        is_rounded = found.objective_s > found.bound_s + 1e-3
        proof = f"the least before rounding: {duration_text(found.bound_s)}" if is_rounded else "the least"
    number = "" if found.proposal_id is None else f" {found.proposal_id}"
    summary = f"proposal{number}: {len(found.moves)} moved, {len(found.left)} left, {margin}; {what} "
    summary += f"{duration_text(found.objective_s)}, {proof}"
    stored = [] if found.proposal_id is None else [f"apply it: {program()} apply {found.proposal_id}"]
    return "\n".join([*lines, "", summary, *stored])


def _keys(found: Proposal) -> Iterator[str]:
    for move in found.moves:
        yield move.key
        yield from (one.key for one in move.passes)
    for left in found.left:
        yield left.key
        yield from left.blocked_by
