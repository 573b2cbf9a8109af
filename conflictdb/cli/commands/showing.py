"""Commands that draw, and commands for history and acknowledgements."""

from pathlib import Path
from typing import Any

from conflictdb.cli.parser import add_format, add_options, add_scene, command
from conflictdb.cli.values import instant, name, port, time_or_age, whole


def add(commands: Any) -> None:
    """Add the commands, in the order of the reference."""
    about = "print when conflicts opened, changed and closed"
    parser = command(commands, "history", "history:history", about, "Of all objects, of one, or of two.")
    parser.add_argument("keys", nargs="*", metavar="KEY", help="keys of one or two objects (default: all)")
    add_scene(parser)
    parser.add_argument("--after", type=whole, default=0, metavar="N", help="only events after number N")
    parser.add_argument(
        "--since", type=time_or_age, metavar="TIME", help="only events since TIME, or since a DURATION ago (24h)"
    )
    add_options(parser, "--tz")
    add_format(parser, "table", "json")

    about = "acknowledge the conflict of two objects"
    parser = command(commands, "acknowledge", "history:acknowledge", about, "Holds unless the conflict gets worse.")
    parser.add_argument("keys", nargs=2, metavar="KEY", help="keys of both objects")
    add_scene(parser)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--reason", metavar="TEXT", help="why the conflict is acceptable")
    what.add_argument("--undo", action="store_true", help="withdraw the acknowledgement")
    parser.add_argument("--by", type=name, metavar="NAME", help="person who acknowledges, shown with the database user")
    parser.add_argument("--until", type=instant, metavar="TIME", help="end of the acknowledgement (default: none)")

    more = "Prints the address of a page, opens it, and serves it until interrupted."
    parser = command(commands, "map", "pictures:show_map", "show a scene on a map, in a browser", more)
    add_scene(parser, ", else the first, or the demo")
    parser.set_defaults(needs_scene=False)
    about = "address to listen on (default: this machine)"
    parser.add_argument("--host", default="127.0.0.1", metavar="HOST", help=about)
    parser.add_argument("--port", type=port, metavar="N", help="port (default: 8620, or the next free one; 0: any)")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write the page to a file instead, to send it")

    parser = command(commands, "plot", "pictures:plot", "draw a scene, or two objects", "Needs the extra `plot`.")
    parser.add_argument("file", type=Path, metavar="FILE", help="figure to write: .png, .svg or .pdf")
    add_scene(parser)
    parser.add_argument("--conflict", nargs=2, metavar=("KEY", "KEY"), help="draw these two objects")
    parser.add_argument("--delays", action="store_true", help="draw which departures are free")
    add_options(parser, "--wait", "--require-current")

    more = "With KEY: one page for its captain or range officer. Needs the extra `plot`."
    parser = command(commands, "report", "pictures:report", "write a report of a scene, or of a plan", more)
    parser.add_argument("key", nargs="?", metavar="KEY", help="plan to write a brief of (default: report of the scene)")
    parser.add_argument("file", type=Path, metavar="FILE", help="report to write: .html or .pdf")
    add_scene(parser)
    add_options(parser, "--tz", "--wait", "--require-current")
