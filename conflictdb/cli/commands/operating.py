"""Commands that keep scenes current, and commands for their database."""

from typing import Any

from conflictdb.cli.parser import add_format, add_jobs, add_lock_timeout, add_memory, command
from conflictdb.cli.values import address, duration_s


def add(commands: Any) -> None:
    """Add the commands, in the order of the reference."""
    for add_one in (_demo, _status, _worker, _server, _psql, _completion):
        add_one(commands)


def _demo(commands: Any) -> None:
    command(commands, "demo", "demo:demo", "detect a small scene that comes with the program")


def _status(commands: Any) -> None:
    parser = command(commands, "status", "operation:status", "show database, scenes, runs and workers")
    add_format(parser, "table", "json")


def _worker(commands: Any) -> None:
    parser = command(
        commands,
        "worker",
        "operation:work",
        "keep all scenes current",
        "Run any number, on any machine.",
    )
    parser.add_argument("--once", action="store_true", help="detect pending changes and end; exit with 1 on failure")
    parser.add_argument("--every", type=duration_s, metavar="DURATION", help="longest pause (default 60s)")
    parser.add_argument("--log", choices=("text", "json"), default="text", help="default: text")
    parser.add_argument("--http", type=address, metavar="[HOST:]PORT", help="serve /healthz and /metrics")
    add_jobs(parser)
    add_memory(parser)
    add_lock_timeout(parser, "wait no longer for another detection")


def _server(commands: Any) -> None:
    parser = command(commands, "server", "embedded:server", "start, stop or show the embedded database")
    parser.add_argument(
        "action",
        choices=("start", "stop", "status", "dsn"),
        metavar="ACTION",
        help="start it, stop it after its last user, show its status, or start it and print its connection string",
    )


def _psql(commands: Any) -> None:
    parser = command(commands, "psql", "embedded:psql", "open the database in psql")
    parser.add_argument("arguments", nargs="*", metavar="ARGUMENT", help="passed to psql")
    parser.hands_on = True


def _completion(commands: Any) -> None:
    parser = command(
        commands,
        "completion",
        "completion:completion",
        "print a completion script",
    )
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), metavar="SHELL", help="bash, zsh or fish")
