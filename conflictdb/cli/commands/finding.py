"""Commands that load plans, find conflicts, and print them."""

from typing import Any

from conflictdb.cli.changing import add_changes
from conflictdb.cli.parser import (
    APPROACH_FORMATS,
    FORMATS,
    add_format,
    add_loading,
    add_options,
    add_scene,
    add_settings,
    command,
)
from conflictdb.cli.values import (
    MORE_COLUMNS,
    bearing_deg,
    columns,
    count,
    duration_s,
    haven,
    height,
    instant,
    instants,
    level,
    metres,
    name,
    speed_kn,
    time,
    time_or_age,
    weight,
    zone,
)
from conflictdb.model.settings import STORED_BY_DETECT


def add(commands: Any) -> None:
    """Add the commands, in the order of the reference."""
    _add_plans(commands)
    _add_detection(commands)
    _add_questions(commands)


def _add_plans(commands: Any) -> None:
    more = "Does not detect. If one object is refused, nothing changes."
    parser = command(commands, "load", "scene_objects:load", "load plans from files", more)
    parser.add_argument("files", nargs="+", metavar="FILE", help="scene file, route, positions, areas, NOTAM, …")
    parser.add_argument("--scene", type=name, metavar="NAME", help="scene to load into (default: named by the file)")
    about = "positions of tracks of the scene, which workers compare with their plans"
    parser.add_argument("--positions", action="store_true", help=about)
    add_loading(parser)

    command(commands, "scenes", "scene_objects:scenes", "list scenes")

    parser = command(commands, "objects", "scene_objects:objects", "list the objects of a scene")
    add_scene(parser)
    add_options(parser, "--tz")
    add_format(parser, "table", "json")

    parser = command(commands, "rename", "scene_objects:rename", "rename a scene, or an object")
    parser.add_argument("key", nargs="?", metavar="KEY", help="key of the object to rename (default: the scene itself)")
    parser.add_argument("new", type=name, metavar="NEW", help="new name of the scene, or new key of the object")
    add_scene(parser)

    parser = command(commands, "copy", "scene_objects:copy", "copy a scene")
    parser.add_argument("new", type=name, metavar="NEW", help="name of the copy")
    add_scene(parser)

    parser = command(commands, "branch", "branching:branch", "try edits in a branch")
    parser.add_argument("action", choices=("create", "diff", "merge", "drop"), help="what to do with the branch")
    parser.add_argument("branch", type=name, metavar="BRANCH", help="name of the branch")
    add_scene(parser)
    parser.add_argument(
        "--proposal", type=count, metavar="N", help="create: a branch with the moves of this proposal of `resolve`"
    )
    add_changes(parser)
    add_format(parser, "table", "json")

    parser = command(commands, "delete", "scene_objects:delete", "delete objects, or a scene")
    parser.add_argument("keys", nargs="*", metavar="KEY", help="keys of the objects to delete")
    add_scene(parser)
    parser.add_argument("--all", action="store_true", help="delete the scene that --scene names")

    parser = command(
        commands, "export", "scene_objects:export", "write a scene file", "Loading it gives the same objects."
    )
    parser.add_argument(
        "file",
        metavar="FILE",
        help="file (.geojson, .parquet, .rtz, .gpx, .kml, .ed318.json, .f3548.json, also .gz; -: stdout)",
    )
    about = "keys of the objects to write (default: all)"
    parser.add_argument("keys", nargs="*", default=[], metavar="KEY", help=about)
    add_scene(parser)
    parser.add_argument(
        "--format",
        choices=("geojson", "geoparquet", "rtz"),
        help="format of a file whose ending does not say (default: geojson); rtz: FILE is a folder, for all tracks",
    )


def _add_detection(commands: Any) -> None:
    more = "Recomputes only pairs with a changed member. Settings given here stay with the scene. Takes the options of "
    more += "`load`, too."
    parser = command(commands, "detect", "detecting:detect", "load files, detect, and print conflicts", more)
    parser.add_argument(
        "files",
        nargs="*",
        metavar="FILE",
        help="files to load first, as `load` does (default: detect what the scene has)",
    )
    add_scene(parser)
    add_settings(parser, STORED_BY_DETECT)
    add_options(parser, "--jobs", "--memory-mb")
    parser.add_argument("--full", action="store_true", help="recompute all pairs, also those without a changed member")
    add_options(parser, "--lock-timeout", "--fail-on-conflict")
    add_loading(parser, is_shown=False)
    add_format(parser, *FORMATS, "geoparquet")
    add_options(parser, "--no-region")

    parser = command(commands, "conflicts", "detecting:conflicts", "print known conflicts", "Does not detect.")
    parser.add_argument("key", nargs="?", metavar="KEY", help="only conflicts of this object")
    add_scene(parser)
    parser.add_argument("--at", type=time, metavar="TIME", help="only conflicts that are on at TIME")
    parser.add_argument(
        "--from", dest="start", type=time, metavar="TIME", help="only conflicts that last until TIME or longer"
    )
    parser.add_argument("--to", dest="end", type=time, metavar="TIME", help="only conflicts that begin before TIME")
    parser.add_argument(
        "--since",
        type=time_or_age,
        metavar="TIME",
        help="what is new, changed or gone since TIME, or since a DURATION ago (24h)",
    )
    parser.add_argument(
        "--verdict", choices=("conflict", "grazing", "unresolved"), help="only conflicts with this verdict"
    )
    parser.add_argument("--acknowledged", choices=("yes", "no"), help="only acknowledged conflicts, or only others")
    parser.add_argument(
        "--class", dest="object_class", type=name, metavar="CLASS", help="only conflicts of an object of this class"
    )
    parser.add_argument("--known-at", type=time, metavar="TIME", help="the conflicts that were known at TIME")
    parser.add_argument("--live", action="store_true", help="plans against what happens: who is late, off or silent")
    add_options(parser, "--tz")
    parser.add_argument(
        "--show",
        type=columns,
        default=frozenset(),
        metavar="COLUMN,…",
        help=f"more in the table, parted by commas: {', '.join(MORE_COLUMNS)}",
    )
    add_options(parser, "--wait", "--require-current")
    add_format(parser, *FORMATS, "geoparquet")
    add_options(parser, "--no-region")

    more = "Conflicts, and pairs within the scene's nearest_m."
    parser = command(commands, "approaches", "detecting:approaches", "print how close pairs come", more)
    add_scene(parser)
    add_options(parser, "--tz", "--wait", "--require-current")
    add_format(parser, *APPROACH_FORMATS)


def _add_questions(commands: Any) -> None:
    more = "Plans replace the objects with their keys. Writes nothing."
    parser = command(commands, "probe", "probing:probe", "say what a plan would conflict with", more)
    parser.add_argument("files", nargs="*", metavar="FILE", help="files with plans, as for `load`")
    add_scene(parser)
    add_changes(parser)
    parser.add_argument("--footprint", metavar="WKT", help="an area: POLYGON or MULTIPOLYGON, longitude latitude")
    parser.add_argument(
        "--from", dest="start", type=instant, metavar="TIME", help="start of the area (default: always active)"
    )
    parser.add_argument("--to", dest="end", type=instant, metavar="TIME", help="end of the area")
    parser.add_argument("--path", metavar="WKT", help="a track: LINESTRING, longitude latitude")
    parser.add_argument(
        "--times", type=instants, metavar="TIME,…", help="time at each waypoint of --path, parted by commas"
    )
    parser.add_argument(
        "--haven", type=haven, metavar="FORE,AFT,PORT,STARBOARD", help="haven of --path, or of tracks without a size"
    )
    parser.add_argument("--departure", type=instant, metavar="TIME", help="departure of routes without times")
    parser.add_argument("--speed-kn", type=speed_kn, metavar="SPEED", help="speed of routes without speeds")
    parser.add_argument("--time-zone", type=zone, metavar="ZONE", help="time zone of times without offset in files")
    parser.add_argument(
        "--floor-m", type=height, metavar="HEIGHT", help="lowest height of the plan (default: unbounded)"
    )
    parser.add_argument(
        "--ceiling-m", type=height, metavar="HEIGHT", help="height below which the plan stays (default: unbounded)"
    )
    parser.add_argument(
        "--key", type=name, metavar="KEY", help="key of the plan; it replaces the object with this key (default: plan)"
    )
    parser.add_argument(
        "--class", dest="object_class", type=name, metavar="CLASS", help="class of the plan (default: that of KEY)"
    )
    parser.add_argument("--owner", type=name, metavar="OWNER", help="owner of the plan (default: that of KEY)")
    parser.add_argument(
        "--worker",
        type=duration_s,
        metavar="DURATION",
        help="let a worker compute it; exit with 7 if none answers in this time",
    )
    parser.add_argument("--diff", action="store_true", help="print only new, changed and gone conflicts")
    add_options(parser, "--require-current", "--jobs", "--fail-on-conflict")
    add_format(parser, *FORMATS)

    more = "An area departs when it is first active."
    parser = command(commands, "delays", "delaying:delays", "say when plans could depart instead", more)
    parser.add_argument("key", nargs="?", metavar="KEY", help="track or area (default: every track)")
    add_scene(parser)
    parser.add_argument(
        "--within", type=duration_s, default=7200.0, metavar="DURATION", help="how much later or earlier (default: 2h)"
    )
    parser.add_argument(
        "--from", dest="start", type=time, metavar="TIME", help="list the free windows of KEY from TIME"
    )
    parser.add_argument("--to", dest="end", type=time, metavar="TIME", help="list the free windows of KEY until TIME")
    parser.add_argument("--best", type=count, metavar="N", help="list at most N windows, those nearest to the plan")
    add_options(parser, "--margin", "--round", "--tz")
    parser.add_argument(
        "--aside", type=metres, metavar="DISTANCE", help="say where the area KEY could be instead, up to so far aside"
    )
    parser.add_argument(
        "--bearing",
        action="append",
        type=bearing_deg,
        metavar="DEGREES",
        help="with --aside: only on this bearing, 270 or W; repeatable (default: eight of them)",
    )
    parser.add_argument(
        "--clear-within-m", type=metres, metavar="DISTANCE", help="show how far it stays clear, up to this"
    )
    parser.add_argument("--now", type=instant, metavar="TIME", help="nothing departs before TIME")
    parser.add_argument(
        "--waypoint", type=count, metavar="N", help="wait at this waypoint instead of departing later, 1 is the first"
    )
    add_format(parser, "table", "json")

    parser = command(commands, "speeds", "delaying:speeds", "say at which speeds tracks meet nothing")
    parser.add_argument("key", nargs="?", metavar="KEY", help="key of a track (default: every track)")
    add_scene(parser)
    parser.add_argument(
        "--slowest",
        type=float,
        default=0.5,
        metavar="FACTOR",
        help="lowest speed, as a factor of the planned one (default: 0.5)",
    )
    parser.add_argument(
        "--fastest",
        type=float,
        default=2.0,
        metavar="FACTOR",
        help="highest speed, as a factor of the planned one (default: 2)",
    )
    parser.add_argument("--leg", type=count, metavar="N", help="change the speed of this leg only, 1 is the first")
    add_format(parser, "table", "json")

    parser = command(commands, "resolve", "resolving:resolve", "propose delays that clear a scene")
    parser.add_argument("keys", nargs="*", metavar="KEY", help="tracks that may move (default: those in conflict)")
    add_scene(parser)
    parser.add_argument(
        "--keep", action="append", default=[], metavar="KEY", help="track that does not move; repeatable"
    )
    parser.add_argument(
        "--weight",
        action="append",
        type=weight,
        metavar="KEY=N",
        help="a second of its delay counts N times (FERRY=2.5); repeatable",
    )
    parser.add_argument(
        "--level",
        action="append",
        type=level,
        metavar="KEY=N",
        help="priority: a higher level is served first (FERRY=1); repeatable",
    )
    parser.add_argument(
        "--within", type=duration_s, default=7200.0, metavar="DURATION", help="largest delay (default: 2h)"
    )
    about = "nothing departs before TIME; plans that depart later may depart earlier"
    parser.add_argument("--now", type=instant, metavar="TIME", help=about)
    parser.add_argument(
        "--slowest",
        type=float,
        default=1.0,
        metavar="FACTOR",
        help="lowest speed, as a factor, for tracks that no delay clears (default: 1)",
    )
    parser.add_argument(
        "--fastest", type=float, default=1.0, metavar="FACTOR", help="highest speed, as a factor (default: 1)"
    )
    parser.add_argument(
        "--aside",
        type=metres,
        default=0.0,
        metavar="DISTANCE",
        help="what no delay clears: try new waypoints so far off legs, and areas so far aside (default: none)",
    )
    parser.add_argument(
        "--goal",
        choices=("total", "largest"),
        default="total",
        help="least sum of delays, or least largest delay (default: total)",
    )
    parser.add_argument(
        "--limit", type=duration_s, default=30.0, metavar="DURATION", help="time to compute (default: 30s)"
    )
    parser.add_argument(
        "--movable",
        nargs="+",
        default=[],
        metavar="KEY",
        help="areas that may move, too: in time, and by --aside in place",
    )
    add_options(parser, "--margin", "--round", "--tz")
    add_format(parser, "table", "json")

    parser = command(commands, "apply", "resolving:apply", "apply or undo a proposal")
    parser.add_argument("proposal", type=count, metavar="N", help="number of the proposal, as `resolve` prints it")
    parser.add_argument("--undo", action="store_true", help="restore the plans that it changed")
    parser.add_argument("--attached", action="store_true", help="change rows of attached tables, too")

    parser = command(commands, "explain", "detecting:explain", "say why two objects conflict, or not")
    parser.add_argument("keys", nargs=2, metavar="KEY", help="keys of both objects")
    add_scene(parser)
    add_options(parser, "--wait", "--require-current")
    add_format(parser, "text", "json")

    more = "Tries them on a sample of the scene's pairs; changes nothing."
    parser = command(commands, "advise", "advice:advise", "estimate cost and error of other settings", more)
    add_scene(parser)
    parser.add_argument("--sample", type=count, metavar="N", help="number of pairs to try (default: 500)")
    add_format(parser, "table", "json")
