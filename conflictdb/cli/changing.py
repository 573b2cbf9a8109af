"""Plans of a scene that options change: `--swap`, `--move` and `--late` of `probe` and `branch`."""

import argparse
from collections.abc import Callable
from datetime import timedelta
from typing import TYPE_CHECKING, Any, TypeVar

from conflictdb.cli.parser import Parser, check
from conflictdb.cli.values import bearing_deg, delay_s, metres, name

if TYPE_CHECKING:
    from conflictdb.client.stored_scene import StoredScene
    from conflictdb.model.plans import Area, Track

_T = TypeVar("_T")


def add_changes(parser: Any) -> None:
    """Add the options that change plans."""
    late, move = ("KEY", "DURATION"), ("KEY", "DISTANCE", "BEARING")
    of_key = {"action": "append", "type": name}
    parser.add_argument("--late", nargs=2, metavar=late, help="later by 20m, or earlier by -5m; repeatable", **of_key)
    parser.add_argument(
        "--move", nargs=3, metavar=move, help="elsewhere at its true size: 2nmi 270, or 2nmi W; repeatable", **of_key
    )
    parser.add_argument(
        "--swap", nargs=2, metavar=("A", "B"), help="two tracks or areas exchange their times; repeatable", **of_key
    )


def has_changes(args: argparse.Namespace) -> bool:
    """Return whether options change plans."""
    return any(one is not None for one in (args.late, args.move, args.swap))


def changes(args: argparse.Namespace) -> "Callable[[StoredScene], list[Area | Track]]":
    """Return a function that returns the changed plans of a scene: exchanged, then moved, then later.

    Ends with a usage error for values that options cannot have.
    """
    late = [(key, timedelta(seconds=_value(args, "--late", delay_s, text))) for key, text in args.late or ()]
    moves = [
        (key, _value(args, "--move", metres, far), _value(args, "--move", bearing_deg, bearing))
        for key, far, bearing in args.move or ()
    ]
    swaps = [(a, b) for a, b in args.swap or ()]
    check(args, [(a == b, f"--swap needs two keys; got {a!r} twice") for a, b in swaps])

    def changed(scene: "StoredScene") -> "list[Area | Track]":
        # Imported here, so that usage errors are fast.
        from conflictdb.core.moving_plans import delayed, exchanged, moved
        from conflictdb.model.inputs import MICROSECOND

        plans: dict[str, Area | Track] = {}

        def plan(key: str) -> "Area | Track":
            return plans[key] if key in plans else scene.plan(key)

        for a, b in swaps:
            plans[a], plans[b] = exchanged(plan(a), plan(b))
        for key, distance_m, bearing in moves:
            plans[key] = moved(plan(key), distance_m, bearing, scene.settings())
        for key, delay in late:
            plans[key] = delayed(plan(key), round(delay / MICROSECOND))
        return list(plans.values())

    return changed


def _value(args: argparse.Namespace, option: str, parse: Callable[[str], _T], text: str) -> _T:
    try:
        return parse(text)
    except argparse.ArgumentTypeError as error:
        parser: Parser = args.parser
        return parser.error(f"argument {option}: {error}")
