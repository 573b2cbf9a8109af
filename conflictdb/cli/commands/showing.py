"""Commands that draw, and commands for history and acknowledgements."""

from pathlib import Path
from typing import Any

from conflictdb.cli.parser import add_require_current, add_wait, command
from conflictdb.cli.values import instant, name, port, whole


def add(commands: Any) -> None:
    """Add the commands, in the order of the help."""
    for add_one in (_map, _plot, _report, _history, _acknowledge):
        add_one(commands)


def _map(commands: Any) -> None:
    parser = command(
        commands,
        "map",
        "mapping:show",
        "show a scene on a map with time, in a browser",
        "Prints the address of a page, and serves it until interrupted. It only reads, but for acknowledging.",
    )
    parser.add_argument("--scene", type=name, metavar="NAME", help="scene to show (default: the demo's)")
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="HOST",
        help="address to listen on (default: this machine alone); at another, the page needs the token that is printed",
    )
    parser.add_argument(
        "--html",
        type=Path,
        metavar="FILE",
        help="write the page into a file that needs nothing else, to send to somebody, instead of serving it",
    )
    parser.add_argument("--port", type=port, default=8620, metavar="N", help="port (default: 8620; 0: any free one)")


def _plot(commands: Any) -> None:
    parser = command(
        commands,
        "plot",
        "pictures:plot",
        "draw a scene, or two of its objects",
        "Where and when plans are in conflict; of two objects what they sweep, where the stages let them meet, and "
        "their separation over time. Needs matplotlib (the extra `plot`). Does not detect.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="figure to write: .png, .svg or .pdf")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to draw")
    parser.add_argument(
        "--conflict", nargs=2, metavar=("A", "B"), help="keys of two objects to draw, in conflict or not"
    )
    add_wait(parser)
    add_require_current(parser)


def _report(commands: Any) -> None:
    parser = command(
        commands,
        "report",
        "pictures:report",
        "write a report of a scene, to file with a plan",
        "What was checked and how, what was found, with figures. Needs matplotlib, and for PDF fpdf2 (extra `plot`). "
        "Does not detect.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="report to write: .html (one file) or .pdf")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to report on")
    add_wait(parser)
    add_require_current(parser)


def _history(commands: Any) -> None:
    parser = command(
        commands,
        "history",
        "history:history",
        "print when conflicts opened, changed and closed",
        "Of a scene, of an object or of two objects, oldest first, as far back as history is kept. Does not detect.",
    )
    parser.add_argument("keys", nargs="*", metavar="KEY", help="keys of one object, or of two")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to print")
    parser.add_argument("--after", type=whole, default=0, metavar="N", help="only events with a greater number")
    parser.add_argument("--format", choices=("table", "json"), default="table", help="default: table")


def _acknowledge(commands: Any) -> None:
    parser = command(
        commands,
        "acknowledge",
        "history:acknowledge",
        "take note of the conflict of two objects",
        "It holds while the conflict is no more than it is now: at no other times, with no worse verdict, no closer.",
    )
    parser.add_argument("keys", nargs=2, metavar="KEY", help="keys of the two objects")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene that holds them")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--reason", metavar="TEXT", help="why")
    what.add_argument("--undo", action="store_true", help="take it back")
    parser.add_argument("--until", type=instant, metavar="T", help="until then (ISO 8601 with offset; default: no end)")
