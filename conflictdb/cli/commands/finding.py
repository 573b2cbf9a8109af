"""Commands that load plans, find conflicts, and print them."""

from typing import Any

from conflictdb.cli.parser import (
    FORMATS,
    add_fail_on_conflict,
    add_jobs,
    add_loading,
    add_lock_timeout,
    add_memory,
    add_output,
    add_require_current,
    add_settings,
    add_wait,
    command,
)
from conflictdb.cli.values import count, duration_s, height, instant, instants, metres, name, whole
from conflictdb.model.settings import STORED_BY_DETECT


def add(commands: Any) -> None:
    """Add the commands, in the order of the help."""
    for add_one in (_detect, _load, _export, _conflicts, _approaches, _explain, _advise, _probe):
        add_one(commands)


def _detect(commands: Any) -> None:
    parser = command(
        commands,
        "detect",
        "detecting:detect",
        "load files, detect, and print the conflicts",
        "Only pairs with a changed member are computed again. The settings given here become the scene's and stay. "
        "Files of one scene are taken together, as if they were one.",
    )
    parser.add_argument("files", nargs="*", metavar="FILE", help="scene files, moving features, positions, or areas")
    parser.add_argument(
        "--scene", type=name, metavar="NAME", help="scene to detect; with files: the scene to load them into"
    )
    add_settings(parser, STORED_BY_DETECT)
    add_jobs(parser)
    add_memory(parser)
    parser.add_argument("--full", action="store_true", help="recompute everything, also what did not change")
    add_lock_timeout(parser, "wait no longer for another detection of the scene, or any other lock")
    add_fail_on_conflict(parser)
    add_loading(parser)
    add_output(parser)


def _load(commands: Any) -> None:
    parser = command(
        commands,
        "load",
        "load_and_export:load",
        "load files, without detecting",
        "Files of one scene are combined as if they were one. All mistakes of all files are reported together; "
        "if one object of one file is refused, or a file has no objects, nothing is changed.",
    )
    parser.add_argument("files", nargs="+", metavar="FILE", help="scene files, moving features, positions, or areas")
    parser.add_argument(
        "--scene", type=name, metavar="NAME", help="scene to load into (default: the one that the file names)"
    )
    add_loading(parser)


def _export(commands: Any) -> None:
    parser = command(
        commands,
        "export",
        "load_and_export:export",
        "write a scene file",
        "Loading it again gives exactly the same objects.",
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to write")
    parser.add_argument(
        "--format",
        choices=("geojson", "geoparquet"),
        help="default: geoparquet if the name ends in .parquet, else geojson",
    )
    parser.add_argument("file", metavar="FILE", help="file to write (.gz: compressed); - is the standard output")


def _conflicts(commands: Any) -> None:
    parser = command(
        commands, "conflicts", "detecting:conflicts", "print the conflicts that are known", "Does not detect."
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to print")
    parser.add_argument("--at", type=instant, metavar="T", help="only those at this instant (ISO 8601 with offset)")
    parser.add_argument(
        "--known-at", type=instant, metavar="T", help="as they were known at this instant, as far as history is kept"
    )
    add_wait(parser)
    add_require_current(parser)
    add_output(parser)


def _approaches(commands: Any) -> None:
    parser = command(
        commands,
        "approaches",
        "detecting:approaches",
        "print how close pairs come: when, where and how far apart",
        "Every conflict, and with the scene's nearest_m every pair that comes within that distance. Does not detect.",
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to print")
    add_wait(parser)
    add_require_current(parser)
    parser.add_argument("--format", choices=FORMATS, default="table", help="default: table")


def _explain(commands: Any) -> None:
    parser = command(
        commands,
        "explain",
        "detecting:explain",
        "say why two objects are in conflict, or are not",
        "Which stage decided, what each of them left, and whether that is current. Does not detect.",
    )
    parser.add_argument("keys", nargs=2, metavar="KEY", help="keys of the two objects")
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene that holds them")
    add_wait(parser)
    add_require_current(parser)
    parser.add_argument("--format", choices=("text", "json"), default="text", help="default: text")


def _advise(commands: Any) -> None:
    parser = command(
        commands,
        "advise",
        "advice:advise",
        "estimate what each setting would cost for a scene, and how wrong it would be",
        "Solves a sample of the scene's own pairs with screen and exact at several tolerances, in memory. It takes "
        "seconds, needs no detection before it, and changes nothing.",
    )
    parser.add_argument("--scene", required=True, type=name, metavar="NAME", help="scene to advise on")
    parser.add_argument(
        "--sample", type=count, metavar="N", help="pairs of objects to try the settings on (default: 500)"
    )
    parser.add_argument("--seed", type=whole, default=0, metavar="N", help="draw another sample (default: 0)")
    parser.add_argument("--format", choices=("table", "json"), default="table", help="default: table")


def _probe(commands: Any) -> None:
    parser = command(
        commands,
        "probe",
        "probing:probe",
        "say what a plan would be in conflict with, and when",
        "The plans of files, or one that is given here. By the scene's settings, on the objects that the last "
        "detection saw; writes nothing. All plans together replace the objects that have their keys, and are compared "
        "with each other, too. Column plans: which members of a pair are plans.",
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
        help="ask a worker, and wait so long at most (30s, 5m); exits with 7 if none has answered",
    )
    parser.add_argument(
        "--diff",
        action="store_true",
        help="print only what the plans would change: known conflicts that are gone, new ones and changed ones",
    )
    add_require_current(parser)
    add_jobs(parser)
    add_fail_on_conflict(parser)
    parser.add_argument("--format", choices=FORMATS, default="table", help="default: table")
