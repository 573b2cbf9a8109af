"""Commands that keep scenes current, and commands for their database."""

from pathlib import Path
from typing import Any

from conflictdb.cli.parser import action, add_jobs, add_lock_timeout, add_memory, command
from conflictdb.cli.values import address, duration_s, mapping, name


def add(commands: Any) -> None:
    """Add the commands, in the order of the help."""
    for add_one in (_worker, _service, _status, _attach, _share, _schema, _server, _psql, _demo):
        add_one(commands)


def _worker(commands: Any) -> None:
    parser = command(
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
    add_jobs(parser)
    add_memory(parser)
    add_lock_timeout(parser, "report a scene with changes as failed when somebody else detects it for longer")


def _service(commands: Any) -> None:
    parser = command(
        commands,
        "service",
        "service_units:service",
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
    parser = command(
        commands, "status", "operation:status", "show database, schema, scenes, pending changes, last runs and workers"
    )
    parser.add_argument("--format", choices=("table", "json"), default="table", help="default: table")


def _attach(commands: Any) -> None:
    parser = command(
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
    parser = command(commands, "detach", "attaching:detach", "detach a table from a scene, and remove its objects")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene it is attached to")
    parser.add_argument("--table", required=True, type=name, metavar="TABLE", help="table or view, as SCHEMA.TABLE")
    parser.add_argument("--keep", action="store_true", help="leave its objects in the scene")
    parser = command(
        commands, "attachments", "attaching:attachments", "show attached tables, and which of their rows are left out"
    )
    parser.add_argument("--scene", type=name, metavar="NAME", help="of this scene only")


def _share(commands: Any) -> None:
    parser = command(
        commands,
        "share",
        "share:share",
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
    parser = command(commands, "unshare", "share:unshare", "take back that a scene is shared with a role")
    parser.add_argument("role", metavar="ROLE", help="role that it is shared with")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene that is shared")
    parser = command(
        commands,
        "protect",
        "share:protect",
        "have scenes seen by their owners, and by the roles that these share them with",
        "For who owns the schema conflictdb. Workers see all scenes.",
    )
    parser.add_argument("--off", action="store_true", help="let every reader see all scenes again")


def _schema(commands: Any) -> None:
    again = "May be called again, also by several at once. The embedded database is brought up to date by itself."
    command(commands, "init", "operation:init", "create the schema `conflictdb` in a database", again)
    command(
        commands,
        "upgrade",
        "operation:upgrade",
        "upgrade the schema `conflictdb` of a database to this program's",
        again,
    )
    parser = command(
        commands,
        "extension",
        "making_extension:extension",
        "make conflictdb an extension of a server: CREATE EXTENSION conflictdb",
        "For servers whose files you may write; `init` needs none and makes the same schema.",
    )
    actions = parser.add_subparsers(title="actions", dest="action", required=True, metavar="ACTION")
    build = action(actions, "build", "write the files of the extension into a directory")
    build.add_argument("directory", type=Path, metavar="DIRECTORY", help="where to; made if need be")
    install = action(actions, "install", "write the files to where a server of this machine looks for extensions")
    install.add_argument(
        "--pg-config",
        metavar="PROGRAM",
        default="pg_config",
        help="pg_config of that server (default: the one on PATH)",
    )


def _server(commands: Any) -> None:
    parser = command(commands, "server", "embedded:server", "start, stop or show the embedded database")
    actions = parser.add_subparsers(title="actions", dest="action", required=True, metavar="ACTION")
    for does, summary in (
        ("start", "start it and keep it running until `server stop`"),
        ("stop", "stop it, as soon as nobody uses it any more"),
        ("status", "show whether it runs, and where it lives"),
        ("dsn", "start it and print its connection string, for other programs"),
    ):
        action(actions, does, summary)


def _psql(commands: Any) -> None:
    parser = command(
        commands,
        "psql",
        "embedded:psql",
        "open the database in psql",
        "It is the psql of the server's programs, else one of this machine, and gets all arguments.",
    )
    parser.add_argument("arguments", nargs="*", metavar="ARGUMENT", help="handed to psql, such as -c 'SELECT 1'")
    parser.hands_on = True


def _demo(commands: Any) -> None:
    command(
        commands,
        "demo",
        "demo:demo",
        "detect a small scene that comes with the program",
        "A strait with closed areas, a ferry, a tow, two submarines and an aircraft.",
    )
