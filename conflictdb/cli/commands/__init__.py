"""The commands and their options, as help lists them."""

import argparse
from collections.abc import Sequence
from functools import cache
from typing import Any, Final

import conflictdb
from conflictdb.cli.commands import admin, finding, operating, showing, spark
from conflictdb.cli.output import out, program
from conflictdb.cli.parser import Parser

ENVIRONMENT: Final = {
    "CONFLICTDB_DSN": "database to use when there is no --dsn; without either, the embedded one",
    "CONFLICTDB_SCENE": "scene to use when there is no --scene; without either, the last one used in this database",
    "CONFLICTDB_HOME": "directory of the embedded database",
    "CONFLICTDB_PG_BIN": "the only directory to take PostgreSQL's programs from",
    "CONFLICTDB_TZ": "default of --tz, a time zone such as Europe/Copenhagen",
    "CONFLICTDB_UNITS": "metric: distances in km, places in decimal degrees (default: nautical)",
    "CONFLICTDB_NO_DOWNLOAD": "1: never fetch PostgreSQL, use what is there",
}


GROUPS: Final = (
    ("plan", ("load", "scenes", "objects", "rename", "copy", "branch", "delete", "export")),
    (
        "ask",
        (
            *(
                "detect",
                "conflicts",
                "approaches",
                "probe",
                "delays",
                "speeds",
                "resolve",
                "apply",
                "explain",
                "history",
                "acknowledge",
            ),
            *("map", "plot", "report", "advise"),
        ),
    ),
    ("operate", ("demo", "status", "worker", "server", "psql", "spark", "completion", "admin")),
)


def build(prog: str | None = None) -> Parser:
    """Return the parser of the whole command line; `prog` replaces the program's name as it was called."""
    return _built(prog or program())


class _Version(argparse.Action):
    """Show the version, which takes as long to find as all of the help."""

    def __init__(self, option_strings: Sequence[str], dest: str, **given: Any) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, 0, **given)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Print it, and exit."""
        out(f"conflictdb {conflictdb.__version__}")
        parser.exit()


@cache
def _built(prog: str) -> Parser:
    parser = Parser(
        prog=prog,
        usage="%(prog)s [--dsn DATABASE] [--debug] [--version] COMMAND …",
        description="Find when and where plans interfere, inside PostGIS.",
        epilog="DATABASE: connection string or URI. COMMAND --help shows its options.",
    )
    parser.groups = GROUPS
    parser.add_argument(
        "--dsn", metavar="DATABASE", help="connection string or URI (default: $CONFLICTDB_DSN, else the embedded one)"
    )
    parser.add_argument("--debug", action="store_true", help="log to stderr, with tracebacks")
    parser.add_argument("--version", action=_Version, help="show the version")
    commands = parser.add_subparsers(prog=parser.prog, dest="command", required=True, metavar="COMMAND")
    for family in (finding, showing, operating, spark, admin):
        family.add(commands)
    return parser
