"""The commands and their options, as help lists them."""

import argparse
from typing import Final

import conflictdb
from conflictdb.cli import codes
from conflictdb.cli.commands import finding, operating, showing, spark
from conflictdb.cli.output import program
from conflictdb.cli.parser import Parser

ENVIRONMENT: Final = {
    "CONFLICTDB_DSN": "database to use when there is no --dsn; without either, the embedded one",
    "CONFLICTDB_HOME": "directory of the embedded database",
    "CONFLICTDB_PG_BIN": "the only directory to take PostgreSQL's programs from",
    "CONFLICTDB_NO_DOWNLOAD": "1: never fetch PostgreSQL, use what is there",
}


def build() -> Parser:
    """Return the parser of the whole command line."""
    parser = Parser(
        prog=program(),
        description="Find when and where moving and static areas interfere, inside PostGIS.",
        epilog=_epilog(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument(
        "--version", action="version", version=f"conflictdb {conflictdb.__version__}", help="show the version, and end"
    )
    parser.add_argument(
        "--dsn",
        help="database to use: a libpq connection string or URI (env CONFLICTDB_DSN; default: the embedded one)",
    )
    parser.add_argument("--debug", action="store_true", help="log to stderr, and show a traceback when something fails")
    commands = parser.add_subparsers(title="commands", dest="command", required=True, metavar="COMMAND")
    for family in (finding, showing, operating, spark):
        family.add(commands)
    return parser


def _epilog() -> str:
    lines = ["environment:", *(f"  {name:<24} {text}" for name, text in ENVIRONMENT.items())]
    return "\n".join([*lines, "", "exit codes:", *(f"  {code:<4} {text}" for code, text in codes.MEANING.items())])
