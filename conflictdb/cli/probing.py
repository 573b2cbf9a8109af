"""`probe`."""

import argparse
import os
from typing import TYPE_CHECKING, Any

from conflictdb.cli.codes import CONFLICTS_FOUND, DONE
from conflictdb.cli.output import out, remark
from conflictdb.cli.parser import check
from conflictdb.cli.report import approach_table, print_conflicts, skipped_text
from conflictdb.cli.session import database
from conflictdb.errors import InvalidInput
from conflictdb.model import Area, Track, rectangle_outline_m
from conflictdb.results import Conflict, Verdict

if TYPE_CHECKING:
    import shapely

_SIZES = ("fore_m", "aft_m", "port_m", "starboard_m")


def probe(args: argparse.Namespace) -> int:
    """Print what plans would be in conflict with."""
    given = [bool(args.files), args.footprint is not None, args.path is not None]
    check(
        args,
        [
            (sum(given) != 1, "give files, or --footprint of an area, or --path of a track"),
            (args.path is not None and args.times is None, "--path needs --times, one for each waypoint"),
            (args.path is None and args.times is not None, "--times is for --path"),
            (args.path is None and any(_sizes(args).values()), "--fore-m and the like are for --path"),
            (args.footprint is None and (args.start or args.end) is not None, "--from and --to are for --footprint"),
            (bool(args.files) and args.key is not None, "--key is for --footprint and --path: files have keys"),
            (bool(args.files) and (args.floor_m, args.ceiling_m) != (None, None), "files have heights of their own"),
        ],
    )
    plans = _plans(args)
    found: list[Conflict] = []
    states = []
    with database(args) as db:
        for plan in plans:
            jobs = args.jobs or os.cpu_count() or 1
            listing = db.probe(args.scene, plan, jobs=jobs, worker_timeout_s=args.worker)
            found += listing
            states = [listing.state]
    conflicts = [one for one in found if one.verdict is not Verdict.NEAR]
    if args.format == "table":
        print_conflicts(conflicts, states, args.format)
        if near := [one for one in found if one.verdict is Verdict.NEAR]:
            out("\nno conflict, but near:\n" + approach_table(near))
    else:
        print_conflicts(found, states, args.format)
    return CONFLICTS_FOUND if args.fail_on_conflict and conflicts else DONE


def _plans(args: argparse.Namespace) -> list[Area | Track]:
    # Not above: usage errors come at once.
    from conflictdb.io import read
    from conflictdb.io.contents import without_objects

    plans: list[Area | Track] = []
    for file in args.files:
        contents = read(file)
        for line in skipped_text(contents.skipped):
            remark(line)
        if not (contents.areas or contents.tracks):
            raise without_objects("file", file, contents.skipped)
        plans += [*contents.areas, *contents.tracks]
    key = args.key or "plan"
    heights = {"floor_m": args.floor_m, "ceiling_m": args.ceiling_m}
    if args.footprint is not None:
        footprint: Any = _geometry(key, "footprint", args.footprint, ("Polygon", "MultiPolygon"))
        plans.append(Area(key, footprint, start_us=args.start, end_us=args.end, **heights))
    if args.path is not None:
        path: Any = _geometry(key, "path", args.path, ("LineString",))
        plans.append(Track(key, path, args.times, rectangle_outline_m(**_sizes(args)), **heights))
    return plans


def _sizes(args: argparse.Namespace) -> dict[str, float]:
    return {name: getattr(args, name) for name in _SIZES}


def _geometry(key: str, field: str, text: str, kinds: tuple[str, ...]) -> "shapely.Geometry":
    import shapely

    try:
        geometry = shapely.from_wkt(text)
    except shapely.errors.GEOSException:
        geometry = None
    if geometry is None or geometry.geom_type not in kinds:
        rule = f"must be a {' or '.join(kinds)} as WKT, longitude and latitude in degrees; got {text!r:.60}"
        raise InvalidInput(f"plan {key!r}", field, rule)
    return geometry
