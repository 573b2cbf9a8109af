"""Commands and options. Nothing here imports a library, so that help and usage errors come at once."""

import argparse
import re
from collections.abc import Sequence
from datetime import datetime
from importlib import import_module
from pathlib import Path
from sys import float_info
from typing import Any, Final, NoReturn

import conflictdb
from conflictdb.cli import codes
from conflictdb.cli.output import program
from conflictdb.methods import METHODS, Method
from conflictdb.pipeline.memory import LEAST_MEMORY_MB, MEMORY_MB

FORMATS: Final = ("table", "json", "csv", "geojson")
_METHODS: Final = tuple(map(str, Method))  # plain words: usage errors show each choice's repr
_SAYS: Final = ", ".join(f"{method} ({METHODS[method].says})" for method in Method)

ENVIRONMENT: Final = {
    "CONFLICTDB_DSN": "database to use when there is no --dsn; without either, the embedded one",
    "CONFLICTDB_HOME": "directory of the embedded database",
    "CONFLICTDB_PG_BIN": "the only directory to take PostgreSQL's programs from",
    "CONFLICTDB_NO_DOWNLOAD": "1: never fetch PostgreSQL, use what is there",
}
_MOST_MB: Final = 1e6  # a terabyte, unpacked: more is a mistake in the unit
_MOST_S: Final = 1e9  # 31 years: more is a mistake in the unit, and nothing could wait for it
_UNITS_S: Final = {"": 1.0, "ms": 0.001, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0, "d": 86400.0}


class Parser(argparse.ArgumentParser):
    """A parser whose usage errors are one line that names the help.

    hands_on : it only knows --help; everything else becomes `arguments`, as it is, for another program
    """

    hands_on = False

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Return the namespace, and the arguments that are not known."""
        if not self.hands_on or args in (["-h"], ["--help"]):
            return super().parse_known_args(args, namespace)
        namespace, _ = super().parse_known_args([], namespace)
        namespace.arguments = args
        return namespace, []

    def error(self, message: str) -> NoReturn:
        """End the program with exit code 2."""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")


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
    for add in (_detect, _load, _conflicts, _approaches, _explain, _advise, _export, _worker, _service, _status):
        add(commands)
    for add in (_plot, _report, _probe, _history, _acknowledge, _map, _attach, _share, _schema, _server, _psql, _demo):
        add(commands)
    _spark(commands)
    return parser


def _epilog() -> str:
    lines = ["environment:", *(f"  {name:<24} {text}" for name, text in ENVIRONMENT.items())]
    return "\n".join([*lines, "", "exit codes:", *(f"  {code:<4} {text}" for code, text in codes.MEANING.items())])


def _command(commands: Any, name: str, target: str, summary: str, more: str = "") -> Parser:
    """Add a command that runs function `target`, written ``module:function``, which is imported when it runs."""
    module, _, function = target.partition(":")

    def run(args: argparse.Namespace) -> int:
        return int(getattr(import_module(f"conflictdb.cli.{module}"), function)(args))

    description = f"{summary[0].upper()}{summary[1:]}. {more}".strip()
    parser: Parser = commands.add_parser(name, help=summary, description=description, allow_abbrev=False)
    parser.set_defaults(run=run, parser=parser)
    return parser


def _detect(commands: Any) -> None:
    parser = _command(
        commands,
        "detect",
        "detection:detect",
        "load files, detect, and print the conflicts",
        "Only pairs with a changed member are computed again. The settings given here become the scene's and stay. "
        "Files of one scene are taken together, as if they were one.",
    )
    parser.add_argument("files", nargs="*", metavar="FILE", help="scene files, moving features, positions, or areas")
    parser.add_argument(
        "--scene", type=name, metavar="NAME", help="scene to detect; with files: the scene to load them into"
    )
    parser.add_argument("--method", choices=_METHODS, help=f"where to stop: {_SAYS}")
    parser.add_argument("--tolerance-m", type=metres, metavar="M", help="closeness that is too close to call, metres")
    parser.add_argument(
        "--separation-m", type=metres, metavar="M", help="minimum distance wanted, metres (0: touching)"
    )
    parser.add_argument(
        "--nearest-m",
        type=metres,
        metavar="D",
        help="also report pairs without conflict that come within D metres, with their closest approach (0: do not)",
    )
    parser.add_argument("--jobs", type=count, metavar="N", help="threads to solve in (default: one per processor)")
    _add_memory(parser)
    parser.add_argument("--full", action="store_true", help="recompute everything, also what did not change")
    _add_lock_timeout(parser, "wait no longer for another detection of the scene, or any other lock")
    parser.add_argument(
        "--fail-on-conflict", action="store_true", help="exit with 10 if there are conflicts, also unresolved ones"
    )
    _add_merge(parser)
    _add_output(parser)


def _load(commands: Any) -> None:
    parser = _command(
        commands,
        "load",
        "objects:load",
        "load files, without detecting",
        "Files of one scene are taken together, as if they were one. All mistakes of all files are told in one go; "
        "if one object of one file is refused, nothing is changed.",
    )
    parser.add_argument("files", nargs="+", metavar="FILE", help="scene files, moving features, positions, or areas")
    parser.add_argument(
        "--scene", type=name, metavar="NAME", help="scene to load into (default: the one that the file names)"
    )
    _add_merge(parser)


def _conflicts(commands: Any) -> None:
    parser = _command(
        commands, "conflicts", "detection:conflicts", "print the conflicts that are known", "Does not detect."
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to print")
    parser.add_argument("--at", type=instant, metavar="T", help="only those at this instant (ISO 8601 with offset)")
    parser.add_argument(
        "--known-at", type=instant, metavar="T", help="as they were known at this instant, as far as history is kept"
    )
    _add_wait(parser)
    _add_output(parser)


def _approaches(commands: Any) -> None:
    parser = _command(
        commands,
        "approaches",
        "detection:approaches",
        "print how close pairs come: when, where and how far apart",
        "Every conflict, and with the scene's nearest_m every pair that comes within that distance. Does not detect.",
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to print")
    _add_wait(parser)
    parser.add_argument("--format", choices=FORMATS, default="table", help="default: table")


def _explain(commands: Any) -> None:
    parser = _command(
        commands,
        "explain",
        "detection:explain",
        "say why two objects are in conflict, or are not",
        "Which stage decided, what each of them left, and whether that is current. Does not detect.",
    )
    parser.add_argument("keys", nargs=2, metavar="KEY", help="keys of the two objects")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene that holds them")
    _add_wait(parser)
    parser.add_argument("--format", choices=("text", "json"), default="text", help="default: text")


def _plot(commands: Any) -> None:
    parser = _command(
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
    _add_wait(parser)


def _report(commands: Any) -> None:
    parser = _command(
        commands,
        "report",
        "pictures:report",
        "write a report of a scene, to file with a plan",
        "What was checked and how, what was found, with figures. Needs matplotlib, and for PDF fpdf2 (extra `plot`). "
        "Does not detect.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="report to write: .html (one file) or .pdf")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to report on")
    _add_wait(parser)


def _probe(commands: Any) -> None:
    parser = _command(
        commands,
        "probe",
        "probing:probe",
        "say what a plan would be in conflict with, and when",
        "The plans of files, each by itself, or one that is given here. By the scene's settings, on the objects that "
        "the last detection saw; writes nothing. An object that has the key of the plan is left out: the plan would "
        "replace it.",
    )
    parser.add_argument("files", nargs="*", metavar="FILE", help="plans: scene files, positions, or areas")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to ask")
    parser.add_argument("--footprint", metavar="WKT", help="an area: POLYGON or MULTIPOLYGON, longitude and latitude")
    parser.add_argument(
        "--from", dest="start", type=instant, metavar="T", help="since when it is there (ISO 8601 with offset)"
    )
    parser.add_argument("--to", dest="end", type=instant, metavar="T", help="until when")
    parser.add_argument("--path", metavar="WKT", help="a track: LINESTRING, longitude and latitude")
    parser.add_argument(
        "--times", type=instants, metavar="T,T,…", help="when it is at each waypoint (ISO 8601 with offset)"
    )
    for side, where in (("fore", "ahead of"), ("aft", "behind"), ("port", "left of"), ("starboard", "right of")):
        parser.add_argument(
            f"--{side}-m", type=metres, default=0.0, metavar="M", help=f"how far its haven reaches {where} it, metres"
        )
    parser.add_argument("--floor-m", type=height, metavar="M", help="lowest height, metres (default: no bound)")
    parser.add_argument("--ceiling-m", type=height, metavar="M", help="height it stays below (default: no bound)")
    parser.add_argument("--key", type=name, help="what the plan is called (default: plan)")
    parser.add_argument(
        "--worker",
        type=duration_s,
        metavar="DURATION",
        help="ask a worker, and wait so long at most (30s, 5m); exits with 1 if none has answered",
    )
    parser.add_argument("--jobs", type=count, metavar="N", help="threads to solve in (default: one per processor)")
    parser.add_argument(
        "--fail-on-conflict", action="store_true", help="exit with 10 if there are conflicts, also unresolved ones"
    )
    parser.add_argument("--format", choices=FORMATS, default="table", help="default: table")


def _history(commands: Any) -> None:
    parser = _command(
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
    parser = _command(
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


def _map(commands: Any) -> None:
    parser = _command(
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


def _advise(commands: Any) -> None:
    parser = _command(
        commands,
        "advise",
        "advice:advise",
        "estimate what each setting would cost for a scene, and how wrong it would be",
        "Tries methods, tolerances and earths on a sample of the scene's own pairs, in memory. It takes seconds, needs "
        "no detection before it, and changes nothing.",
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to advise on")
    parser.add_argument(
        "--sample", type=count, metavar="N", help="pairs of objects to try the settings on (default: 500)"
    )
    parser.add_argument("--seed", type=whole, default=0, metavar="N", help="draw another sample (default: 0)")
    parser.add_argument("--format", choices=("table", "json"), default="table", help="default: table")


def _export(commands: Any) -> None:
    parser = _command(
        commands, "export", "objects:export", "write a scene file", "Loading it again gives exactly the same objects."
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to write")
    parser.add_argument(
        "--format",
        choices=("geojson", "geoparquet"),
        help="default: geoparquet if the name ends in .parquet, else geojson",
    )
    parser.add_argument("file", metavar="FILE", help="file to write (.gz: compressed); - is the standard output")


def _worker(commands: Any) -> None:
    parser = _command(
        commands,
        "worker",
        "operation:work",
        "keep all scenes current",
        "Detects again whatever changed, as soon as it changes. Run as many as you like, on as many machines as you "
        "like. A scene that fails does not stop the others and is tried again later; a lost database is connected to "
        "again. SIGTERM and SIGINT end it cleanly, within 5 s.",
    )
    parser.add_argument(
        "--once",
        action="store_true",
        help="detect what changed, then end (for cron and timers); exits with 1 if a scene failed",
    )
    parser.add_argument(
        "--every",
        type=duration_s,
        metavar="DURATION",
        help="look for changes at least this often: 30s, 5m, 1h (default 60s)",
    )
    parser.add_argument(
        "--log", choices=("text", "json"), default="text", help="how each line is written (default: text)"
    )
    parser.add_argument(
        "--http",
        type=address,
        metavar="[HOST:]PORT",
        help="answer /healthz, and /metrics for Prometheus, at this port; to this machine alone unless HOST is given",
    )
    parser.add_argument("--jobs", type=count, metavar="N", help="threads to solve in (default: one per processor)")
    _add_memory(parser)
    _add_lock_timeout(parser, "report a scene with changes as failed when somebody else detects it for longer")


def _service(commands: Any) -> None:
    parser = _command(
        commands,
        "service",
        "service:service",
        "print what has a system keep scenes current: a unit of systemd, a line for cron, jobs of pg_cron",
        "Written for this program; where the database is, is yours to fill in.",
    )
    parser.add_argument(
        "what",
        choices=("systemd", "systemd-once", "systemd-timer", "cron", "pg_cron"),
        metavar="WHAT",
        help="systemd: a worker that runs all the time; systemd-once and systemd-timer: one that is started every five "
        "minutes; cron: the same; pg_cron: jobs by which the database asks for what a worker does",
    )


def _status(commands: Any) -> None:
    parser = _command(
        commands, "status", "operation:status", "show database, schema, scenes, pending changes, last runs and workers"
    )
    parser.add_argument("--format", choices=("table", "json"), default="table", help="default: table")


def _share(commands: Any) -> None:
    parser = _command(
        commands,
        "share",
        "sharing:share",
        "let a role of the database see a scene, or list which may",
        "For who owns the scene. It matters once scenes are protected; until then every reader sees all.",
    )
    parser.add_argument("role", nargs="?", metavar="ROLE", help="role; public is every role (default: list them)")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to share")
    parser.add_argument(
        "--access",
        choices=("read", "write", "own"),
        help="what it may do (default: read); own: the scene is its own then, in place of who owns it",
    )
    parser = _command(commands, "unshare", "sharing:unshare", "take back that a scene is shared with a role")
    parser.add_argument("role", metavar="ROLE", help="role that it is shared with")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene that is shared")
    parser = _command(
        commands,
        "protect",
        "sharing:protect",
        "have scenes seen by their owners, and by the roles that these share them with",
        "For who owns the schema conflictdb. Workers see all scenes.",
    )
    parser.add_argument("--off", action="store_true", help="let every reader see all scenes again")


def _spark(commands: Any) -> None:
    parser: Parser = commands.add_parser(
        "spark",
        help="detect scenes that outgrow one machine, on Apache Spark",
        description="Scenes that outgrow one machine, by the same stages on Apache Spark with Apache Sedona. Needs "
        "Java 17 and the extra `spark`.",
        allow_abbrev=False,
    )
    on_spark = parser.add_subparsers(title="commands", dest="spark_command", required=True, metavar="COMMAND")
    parser = _command(
        on_spark,
        "detect",
        "on_spark:detect",
        "find the conflicts of a scene of the database, or of objects in GeoParquet files, and write them to files",
        "The rows are those of `conflictdb detect` on the same objects and settings.",
    )
    parser.add_argument(
        "--input",
        nargs="+",
        metavar="PATH",
        help="GeoParquet files of objects, as `conflictdb export` writes them, or directories of them; any path that "
        "Spark can read (default: the scene of the database)",
    )
    parser.add_argument("--output", required=True, metavar="PATH", help="directory of GeoParquet to write, a new one")
    _add_spark(parser)
    parser.add_argument(
        "--scene",
        type=name,
        metavar="NAME",
        help="scene of the database, whose settings it has unless others are given; of files the name (default: as "
        "the first file says, as it says all settings if it was exported)",
    )
    parser.add_argument("--motion", choices=("rhumb", "great_circle"), help="how tracks and edges run (default: rhumb)")
    parser.add_argument("--earth", choices=("wgs84", "sphere"), help="default: wgs84; of great circles sphere")
    parser.add_argument(
        "--centre", type=place, metavar="LON,LAT", help="great circles: the middle (default: that of the objects)"
    )
    parser.add_argument("--method", choices=_METHODS, help=f"where to stop: {_SAYS}")
    parser.add_argument("--tolerance-m", type=metres, metavar="M", help="closeness that is too close to call, metres")
    parser.add_argument("--separation-m", type=metres, metavar="M", help="minimum distance wanted, metres")
    parser.add_argument("--nearest-m", type=metres, metavar="D", help="also report pairs that come within D metres")
    parser.add_argument(
        "--partitions", type=count, metavar="N", help="of pieces and of pairs (default: four per processor)"
    )
    _add_memory(parser)
    parser = _command(
        on_spark,
        "write-back",
        "on_spark:write_back",
        "write the conflicts that Spark found into the scene that its objects were exported from",
        "In one transaction; again, it changes nothing. Objects that have changed since wait for a detection. Needs no "
        "Spark.",
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to write into")
    parser.add_argument("file", metavar="PATH", help="what `conflictdb spark detect --output PATH` wrote")
    _add_lock_timeout(parser, "wait no longer for a detection of the scene, or any other lock")
    parser = _command(
        on_spark,
        "demo",
        "on_spark:demo",
        "take the scene that comes with the program through Spark, and compare",
        "Its answer is held against that of one machine; no database is needed.",
    )
    _add_spark(parser)


def _add_spark(parser: Parser) -> None:
    parser.add_argument(
        "--master",
        metavar="URL",
        help="where Spark runs: local[4], spark://host:7077, … (default: all processors of this machine, or what "
        "spark-submit says)",
    )


def _attach(commands: Any) -> None:
    parser = _command(
        commands,
        "attach",
        "attaching:attach",
        "make the rows of a table of the database objects of a scene, now and as they change",
        "Triggers on the table tell of changes; its own data and structure stay as they are, and `detach` takes the "
        "triggers away. A scene that is not there yet is created.",
    )
    parser.add_argument("kind", choices=("area", "track"), metavar="KIND", help="what the rows become: area or track")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to attach it to")
    parser.add_argument("--table", required=True, type=name, metavar="TABLE", help="table or view, as SCHEMA.TABLE")
    parser.add_argument(
        "--map",
        required=True,
        action="append",
        type=mapping,
        metavar="FIELD=COLUMN,…",
        help="for each field, a column or an SQL expression of the columns of a row; may be repeated",
    )
    parser.add_argument(
        "--where",
        type=name,
        metavar="EXPRESSION",
        help="only rows of which this SQL expression of their columns is true",
    )
    parser.add_argument(
        "--every",
        type=duration_s,
        metavar="DURATION",
        help="look for changes so often (30s, 5m) in place of triggers, as who does not own the table (views, foreign "
        "tables: default 60s)",
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="print what would be done and the first objects, and change nothing"
    )
    parser = _command(commands, "detach", "attaching:detach", "detach a table from a scene, and remove its objects")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene it is attached to")
    parser.add_argument("--table", required=True, type=name, metavar="TABLE", help="table or view, as SCHEMA.TABLE")
    parser.add_argument("--keep", action="store_true", help="leave its objects in the scene")
    parser = _command(
        commands, "attachments", "attaching:attachments", "show attached tables, and which of their rows are left out"
    )
    parser.add_argument("--scene", type=name, metavar="NAME", help="of this scene only")


def _schema(commands: Any) -> None:
    again = "May be called again, also by several at once. The embedded database is brought up to date by itself."
    _command(commands, "init", "operation:init", "create the schema `conflictdb` in a database", again)
    _command(
        commands,
        "upgrade",
        "operation:upgrade",
        "upgrade the schema `conflictdb` of a database to this program's",
        again,
    )
    parser = _command(
        commands,
        "extension",
        "extension:extension",
        "make conflictdb an extension of a server: CREATE EXTENSION conflictdb",
        "For servers whose files you may write; `init` needs none and makes the same schema.",
    )
    actions = parser.add_subparsers(title="actions", dest="action", required=True, metavar="ACTION")
    action = _action(actions, "build", "write the files of the extension into a directory")
    action.add_argument("directory", type=Path, metavar="DIRECTORY", help="where to; made if need be")
    action = _action(actions, "install", "write the files to where a server of this machine looks for extensions")
    action.add_argument(
        "--pg-config",
        metavar="PROGRAM",
        default="pg_config",
        help="pg_config of that server (default: the one on PATH)",
    )


def _action(actions: Any, name: str, summary: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = actions.add_parser(
        name, help=summary, description=f"{summary[0].upper()}{summary[1:]}.", allow_abbrev=False
    )
    return parser


def _server(commands: Any) -> None:
    parser = _command(commands, "server", "embedded:server", "start, stop or show the embedded database")
    actions = parser.add_subparsers(title="actions", dest="action", required=True, metavar="ACTION")
    for name, summary in (
        ("start", "start it and keep it running until `server stop`"),
        ("stop", "stop it, as soon as nobody uses it any more"),
        ("status", "show whether it runs, and where it lives"),
        ("dsn", "start it and print its connection string, for other programs"),
    ):
        _action(actions, name, summary)


def _psql(commands: Any) -> None:
    parser = _command(
        commands,
        "psql",
        "embedded:psql",
        "open the database in psql",
        "It is the psql of the server's programs, else one of this machine, and gets all arguments.",
    )
    parser.add_argument("arguments", nargs="*", metavar="ARGUMENT", help="handed to psql, such as -c 'SELECT 1'")
    parser.hands_on = True


def _demo(commands: Any) -> None:
    _command(
        commands,
        "demo",
        "demo:demo",
        "detect a small scene that comes with the program",
        "A strait with closed areas, a ferry, a tow, two submarines and an aircraft.",
    )


def _add_memory(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--memory-mb",
        type=memory_mb,
        default=MEMORY_MB,
        metavar="N",
        help=f"memory to keep below, megabytes (default {MEMORY_MB}): a detection of more works in smaller parts",
    )


def _add_lock_timeout(parser: Parser, what: str) -> None:
    parser.add_argument(
        "--lock-timeout", type=duration_s, metavar="DURATION", help=f"{what}: 30s, 5m (default: no limit)"
    )


def _add_merge(parser: Parser) -> None:
    parser.add_argument(
        "--merge", action="store_true", help="add and update; otherwise the files replace what the scene held"
    )
    parser.add_argument(
        "--layer",
        action="append",
        metavar="NAME",
        help="of files that OGR opens (GeoPackage, KML, S-57): a layer to read; may be repeated (default: all)",
    )
    parser.add_argument(
        "--skip-invalid",
        action="store_true",
        help="load the rest where objects are refused; exits with 6 if any is left out",
    )
    parser.add_argument(
        "--max-speed-kn",
        type=speed_kn,
        metavar="KN",
        help="faster tracks are refused, faster fixes of positions left out (default 2000, 102.2 for AIS)",
    )
    parser.add_argument(
        "--max-file-mb",
        type=megabytes,
        metavar="MB",
        help="refuse files that hold, or unpack to, more (default 64, GeoParquet 4000, or 400 where it is held whole)",
    )


def _add_wait(parser: Parser) -> None:
    parser.add_argument(
        "--wait",
        type=duration_s,
        metavar="DURATION",
        help="wait until a worker has detected what changed, at most so long (30s, 5m); exit with 1 if it has not",
    )


def _add_output(parser: Parser) -> None:
    parser.add_argument("--format", choices=(*FORMATS, "geoparquet"), default="table", help="default: table")
    parser.add_argument("--no-region", action="store_true", help="leave out where each conflict is; tables and csv do")


def name(text: str) -> str:
    """Return the name of a scene, as a database can hold it."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise argparse.ArgumentTypeError(f"must be UTF-8; got {text!a}") from None
    return text


def mapping(text: str) -> dict[str, str]:
    """Return the fields of ``key=id,floor_m=-depth_ft*0.3048``; commas in parentheses and quotes part nothing."""
    parts, depth, quote, start = [], 0, "", 0
    for i, sign in enumerate(text):
        if quote:
            quote = "" if sign == quote else quote
        elif sign in "'\"":
            quote = sign
        elif sign in "([":
            depth += 1
        elif sign in ")]":
            depth -= 1
        elif sign == "," and depth == 0:
            parts.append(text[start:i])
            start = i + 1
    fields = {}
    for part in [*parts, text[start:]]:
        match = re.fullmatch(r"\s*(\w+)\s*=(.*)", part, re.DOTALL)
        if not match or not match[2].strip() or match[1] in fields:
            raise argparse.ArgumentTypeError(f"must be FIELD=COLUMN, each field once, parted by commas; got {part!r}")
        fields[match[1]] = match[2].strip()
    return fields


def place(text: str) -> tuple[float, float]:
    """Return longitude and latitude in degrees of ``9.5,54``."""
    parts = text.split(",")
    if len(parts) != 2:
        raise argparse.ArgumentTypeError(f"must be LONGITUDE,LATITUDE in degrees; got {text!r}")
    lon, lat = (_number(part, "LONGITUDE,LATITUDE in degrees", least=-360.0) for part in parts)
    return lon, lat


def metres(text: str) -> float:
    """Return a length in metres, 0 or more."""
    return _number(text, "a number of metres, 0 or more", least=0.0)


def speed_kn(text: str) -> float:
    """Return a speed in knots, more than 0."""
    value = _number(text, "a speed in knots, more than 0", least=0.0)
    if value == 0.0:
        raise argparse.ArgumentTypeError("must be a speed in knots, more than 0")
    return value


def megabytes(text: str) -> float:
    """Return a size in millions of bytes, more than 0."""
    value = _number(text, "a number of megabytes, more than 0", least=0.0)
    if not 0.0 < value <= _MOST_MB:
        raise argparse.ArgumentTypeError(f"must be a number of megabytes, more than 0 and at most {_MOST_MB:g}")
    return value


def memory_mb(text: str) -> int:
    """Return a whole number of megabytes that a detection can do with."""
    if not re.fullmatch(r"\d{1,9}", text) or int(text) < LEAST_MEMORY_MB:
        raise argparse.ArgumentTypeError(f"must be a whole number, {LEAST_MEMORY_MB} or more; got {text!r}")
    return int(text)


def count(text: str) -> int:
    """Return a whole number, 1 or more."""
    if not re.fullmatch(r"\d{1,6}", text) or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number, 1 or more; got {text!r}")
    return int(text)


def whole(text: str) -> int:
    """Return a whole number, 0 or more."""
    if not re.fullmatch(r"\d{1,18}", text):
        raise argparse.ArgumentTypeError(f"must be a whole number, 0 or more; got {text!r}")
    return int(text)


def address(text: str) -> tuple[str, int]:
    """Return host and port of ``9187``, ``0.0.0.0:9187`` or ``[::1]:9187``; without a host it is this machine alone."""
    match = re.fullmatch(r"(?:(?P<host>[^:\[\]]+|\[[^\[\]]+\]):)?(?P<port>[0-9]{1,5})", text)
    if not match or int(match["port"]) > 65535:
        raise argparse.ArgumentTypeError(f"must be a port, or HOST:PORT; got {text!r}")
    return (match["host"] or "127.0.0.1").strip("[]"), int(match["port"])


def port(text: str) -> int:
    """Return the number of a port, or 0."""
    if not re.fullmatch(r"[0-9]{1,5}", text) or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 to 65535; got {text!r}")
    return int(text)


def duration_s(text: str) -> float:
    """Return a duration such as 90, 30s, 5m, 1.5h or 1d in seconds."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([a-z]*)", text.strip())
    if not match or match[2] not in _UNITS_S or float(match[1]) == 0.0:
        raise argparse.ArgumentTypeError(f"must be a duration such as 30s, 5m or 1h; got {text!r}")
    value_s = float(match[1]) * _UNITS_S[match[2]]
    if value_s > _MOST_S:
        raise argparse.ArgumentTypeError(f"must be at most 11574d, 31 years; got {text!r}")
    return value_s


def instant(text: str) -> datetime:
    """Return an ISO 8601 instant with offset."""
    from conflictdb.inputs import EPOCH, MICROSECOND
    from conflictdb.io.instants import parse_instant

    try:
        return EPOCH + parse_instant(text) * MICROSECOND
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def instants(text: str) -> list[datetime]:
    """Return ISO 8601 instants with offset, parted by commas."""
    return [instant(part.strip()) for part in text.split(",")]


def height(text: str) -> float:
    """Return a height in metres, negative below the sea."""
    return _number(text, "a number of metres", least=-float_info.max)


def _number(text: str, rule: str, least: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not least <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"must be {rule}; got {text!r}")
    return value


def check(args: argparse.Namespace, rules: Sequence[tuple[bool, str]]) -> None:
    """End with a usage error (exit code 2) if a rule between options is broken."""
    for is_broken, message in rules:
        if is_broken:
            args.parser.error(message)
