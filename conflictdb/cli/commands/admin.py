"""Commands for operators: the schema, attached tables, rights, services."""

from pathlib import Path
from typing import Any

from conflictdb.cli.parser import Parser, add_options, command
from conflictdb.cli.values import duration_s, mapping, name, seconds


def add(commands: Any) -> None:
    """Add `admin` with its own commands."""
    about = "schema, attached tables, rights, services"
    parser: Parser = commands.add_parser("admin", help=about, description=f"Commands for operators: the {about}.")
    below = parser.add_subparsers(title="commands", dest="admin_command", required=True, metavar="COMMAND")
    command(below, "init", "administration:upgrade", "create the schema `conflictdb`", "May run again.")
    command(below, "upgrade", "administration:upgrade", "upgrade the schema to this program's", "May run again.")

    about = "write the files of the extension conflictdb for a server"
    parser = command(below, "extension", "administration:extension", about)
    about = "directory to write to (default: that of the server of --pg-config)"
    parser.add_argument("directory", nargs="?", type=Path, metavar="DIRECTORY", help=about)
    parser.add_argument(
        "--pg-config", metavar="PROGRAM", default="pg_config", help="pg_config of the server (default: the one on PATH)"
    )

    about = "print separation rules, or change one"
    parser = command(below, "rules", "administration:rules", about)
    parser.add_argument(
        "sides", nargs="*", metavar="SIDE", help="the two sides of a rule, each a class, area, track or any"
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="name of the scene")
    parser.add_argument(
        "--set",
        type=mapping,
        metavar="NAME=VALUE,…",
        help="what the rule says, named as in scene files: separation_m=500",
    )
    parser.add_argument("--remove", action="store_true", help="remove the rule")

    parser = command(
        below, "certify", "certifying_scenes:certify", "print a proof of what was found", "For check_proof.py."
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="name of the scene")
    about = "tracks whose least later departures are proven, too"
    parser.add_argument("--delays", nargs="+", default=[], metavar="KEY", help=about)
    add_options(parser, "--jobs")

    _add_tables(below)
    _add_rights(below)

    about = "print a unit or job that keeps scenes current"
    parser = command(below, "service", "service_units:service", about)
    parser.add_argument(
        "what",
        choices=("systemd", "systemd-once", "systemd-timer", "cron", "pg_cron"),
        metavar="WHAT",
        help="systemd (a worker), systemd-once and systemd-timer (every five minutes), cron or pg_cron",
    )


def _add_tables(commands: Any) -> None:
    more = "They follow the table, by triggers, until `detach`."
    parser = command(commands, "attach", "administration:attach", "make rows of a table objects of a scene", more)
    parser.add_argument("kind", choices=("area", "track"), metavar="KIND", help="area or track")
    _add_table(parser)
    _add_map(parser, is_required=True)
    parser.add_argument(
        "--every", type=duration_s, metavar="DURATION", help="compare the table so often, instead of by triggers"
    )
    parser.add_argument("--again", action="store_true", help="attach it although the scene has the table")

    about = "change the map or name of an attached table"
    parser = command(commands, "reattach", "administration:reattach", about, "Objects and conflicts stay.")
    _add_table(parser)
    parser.add_argument("--to", type=name, metavar="TABLE", help="another table (default: the same)")
    _add_map(parser, is_required=False)
    parser.add_argument(
        "--without", action="append", default=[], metavar="FIELD", help="leave this field out of the map; repeatable"
    )
    parser.add_argument("--every", type=seconds, metavar="DURATION", help="compare the table so often; 0: by triggers")

    parser = command(commands, "detach", "administration:detach", "detach a table, and remove its objects")
    _add_table(parser)
    parser.add_argument("--keep", action="store_true", help="keep its objects in the scene")

    parser = command(commands, "attachments", "administration:attachments", "show attached tables and rows left out")
    parser.add_argument("--scene", type=name, metavar="NAME", help="only those of this scene")


def _add_map(parser: Parser, *, is_required: bool) -> None:
    about = "a column or SQL expression for each field; repeatable"
    parser.add_argument(
        "--map", required=is_required, action="append", default=[], type=mapping, metavar="FIELD=COLUMN,…", help=about
    )
    parser.add_argument("--where", type=name, metavar="EXPRESSION", help="only rows where this is true")
    parser.add_argument("--dry-run", action="store_true", help="print the effect, change nothing")


def _add_table(parser: Parser) -> None:
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="name of the scene")
    parser.add_argument("--table", required=True, type=name, metavar="TABLE", help="table or view, SCHEMA.TABLE")


def _add_rights(commands: Any) -> None:
    about = "share a scene, or give it away"
    parser = command(commands, "share", "administration:share", about, "For the scene's owner.")
    parser.add_argument("role", nargs="?", metavar="ROLE", help="role, or public (default: list them)")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="name of the scene")
    about = "what ROLE may do; own: make it the owner (default: read)"
    parser.add_argument("--access", choices=("read", "write", "own", "none"), help=about)

    about = "show scenes to their owners and shares only"
    parser = command(commands, "protect", "administration:protect", about, "For the owner of schema conflictdb.")
    parser.add_argument("--off", action="store_true", help="show all scenes to all")

    command(commands, "verify-audit", "administration:verify_audit", "verify the seals of the audit of edits")
