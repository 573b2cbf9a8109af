"""Commands that keep scenes current, and commands for their database."""

from typing import Any

from conflictdb.cli.parser import add_format, add_options, command
from conflictdb.cli.values import address, duration_s, name


def add(commands: Any) -> None:
    """Add the commands, in the order of the reference."""
    parser = command(commands, "demo", "demo:demo", "detect a small example scene")
    parser.set_defaults(html=None, host="127.0.0.1", port=None)  # of the map that follows

    parser = command(commands, "status", "worker_commands:status", "show database, scenes, runs and workers")
    add_format(parser, "table", "json")

    more = "Run any number, on any machine."
    parser = command(commands, "worker", "worker_commands:work", "keep all scenes current", more)
    parser.add_argument("--once", action="store_true", help="detect pending changes and end; exit with 1 on failure")
    about = "replay a file of positions as if they came now, an hour in a minute, and end"
    parser.add_argument("--replay", metavar="FILE", help=about)
    parser.add_argument("--scene", type=name, metavar="NAME", help="scene to replay in (default: the last one used)")
    parser.add_argument(
        "--every", type=duration_s, metavar="DURATION", help="longest pause between looks at the database (default 60s)"
    )
    parser.add_argument("--log", choices=("text", "json"), default="text", help="form of log lines (default: text)")
    parser.add_argument("--http", type=address, metavar="[HOST:]PORT", help="serve /healthz and /metrics over HTTP")
    add_options(parser, "--jobs", "--memory-mb")
    about = "give up if another detection locks a scene for longer"
    parser.add_argument("--lock-timeout", type=duration_s, metavar="DURATION", help=about)

    parser = command(commands, "server", "embedded:server", "start, stop or show the embedded database")
    about = "start it, stop it after its last user, show its status, or start it and print its connection string"
    parser.add_argument("action", choices=("start", "stop", "status", "dsn"), metavar="ACTION", help=about)

    parser = command(commands, "psql", "embedded:psql", "open the database in psql")
    parser.add_argument("arguments", nargs="*", metavar="ARGUMENT", help="arguments and options of psql")
    parser.hands_on = True

    parser = command(commands, "completion", "completion:completion", "print a completion script")
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), metavar="SHELL", help="shell to print it for")
