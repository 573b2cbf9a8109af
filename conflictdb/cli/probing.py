"""`probe`."""

import argparse
import math
import os
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from conflictdb.cli.changing import changes, has_changes
from conflictdb.cli.codes import CONFLICTS_FOUND, DONE
from conflictdb.cli.load_report import (
    approach_table,
    print_conflicts,
    remark_incomplete,
    remark_read,
    require_current,
    span_text,
)
from conflictdb.cli.output import out
from conflictdb.cli.parser import check
from conflictdb.cli.session import database
from conflictdb.cli.tables import show_table
from conflictdb.errors import InvalidInput
from conflictdb.formats.conflict_text import MoreColumn
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m
from conflictdb.model.results import Conflict, SceneState, Verdict, interval_text

if TYPE_CHECKING:
    import shapely

    from conflictdb.client.stored_scene import StoredScene

_POINT = {"fore_m": 0.0, "aft_m": 0.0, "port_m": 0.0, "starboard_m": 0.0}


def probe(args: argparse.Namespace) -> int:
    """Print the conflicts that plans would have."""
    given = [bool(args.files), args.footprint is not None, args.path is not None, has_changes(args)]
    is_known = bool(args.files) or has_changes(args)
    check(
        args,
        [
            (bool(args.files) and has_changes(args), _left_over(args.files)),
            (
                sum(given) != 1,
                "give files, or --late, --move or --swap, or --footprint of an area, or --path of a track",
            ),
            (args.path is not None and args.times is None, "--path needs --times, one for each waypoint"),
            (args.path is None and args.times is not None, "--times is for --path"),
            (not args.files and args.path is None and args.haven is not None, "--haven is for files and --path"),
            (not args.files and args.departure is not None, "--departure is for files"),
            (not args.files and args.speed_kn is not None, "--speed-kn is for files"),
            (not args.files and args.time_zone is not None, "--time-zone is for files"),
            (args.footprint is None and (args.start or args.end) is not None, "--from and --to are for --footprint"),
            (is_known and args.key is not None, "--key is for --footprint and --path"),
            (is_known and args.object_class is not None, "--class is for --footprint and --path"),
            (is_known and args.owner is not None, "--owner is for --footprint and --path"),
            (is_known and (args.floor_m, args.ceiling_m) != (None, None), "--floor-m is for --footprint and --path"),
        ],
    )
    changed = changes(args)
    plans = _plans(args)
    jobs = args.jobs or os.cpu_count() or 1
    with database(args) as db:
        if not is_known:
            plans = [_in_place(args, one, db.scene(args.scene)) for one in plans]
        if args.files:
            plans += _of_files(args, db.scene(args.scene).settings())
        plans += changed(db.scene(args.scene))
        keys = {plan.key for plan in plans}
        known = [one for one in db.scene(args.scene).stream_conflicts() if _members(one, keys)] if args.diff else []
        require_current(args, db.scene(args.scene).state())
        found = db.scene(args.scene).probe(plans, jobs=jobs, worker_timeout_s=args.worker)
    require_current(args, found.state)
    named = MoreColumn("plans", lambda one: _members(one, keys))
    conflicts = [one for one in found if one.verdict is not Verdict.NEAR]
    if args.diff:
        _print_changes(known, conflicts, found.state, named, args.format)
    elif args.format == "table":
        print_conflicts(conflicts, [found.state], args.format, [named])
        if near := [one for one in found if one.verdict is Verdict.NEAR]:
            out("\nno conflict, but near:")
            show_table(approach_table(near, [named]))
    else:
        print_conflicts(found, [found.state], args.format, [named])
    return CONFLICTS_FOUND if args.fail_on_conflict and conflicts else DONE


def _left_over(files: Sequence[str]) -> str:
    """Return what is wrong with words beside `--late`, `--move` and `--swap`: a file, or a part of a key or number."""
    if not files or Path(files[0]).exists():
        return "files go without --late, --move and --swap"
    return f"{files[0]!r} is of no option: quote a key that has blanks ('FERRY NORTH'); a distance is one word (2nmi)"


def _members(one: Conflict, keys: Collection[str]) -> list[str]:
    """Return the members of a pair with one of these keys."""
    return [key for key in (one.a_key, one.b_key) if key in keys]


def _print_changes(
    known: Sequence[Conflict], found: Sequence[Conflict], state: SceneState, named: MoreColumn, form: str
) -> None:
    """Print the conflicts that the plans would end, begin or change."""
    before, after = ({(one.a_key, one.b_key): one for one in some} for some in (known, found))
    kinds = {pair: "gone" for pair in before if pair not in after}
    kinds |= {pair: "new" for pair in after if pair not in before}
    kinds |= {pair: "changed" for pair in after if pair in before and _differs(before[pair], after[pair])}
    rows = [after.get(pair) or before[pair] for pair in sorted(kinds)]
    change = MoreColumn("change", lambda one: kinds[one.a_key, one.b_key])

    def was(one: Conflict) -> Conflict | None:
        return before.get((one.a_key, one.b_key))

    def was_text(one: Conflict) -> str:
        """Return the former times of a conflict; empty if its row shows them already."""
        old = was(one)
        is_gone = kinds[one.a_key, one.b_key] == "gone"
        return "" if old is None or is_gone else span_text(old.first_contact, old.last_contact)

    former = MoreColumn(
        "was", lambda one: interval_text(old.periods) if (old := was(one)) else "", was_text, is_last=True
    )
    if form == "table" and not rows:
        remark_incomplete([state])
        out("no conflict would be gone, new or changed")
    else:
        print_conflicts(rows, [state], form, [change, named, former])


def _differs(one: Conflict, other: Conflict) -> bool:
    """Return whether verdicts differ, or periods differ by more than their errors."""
    if one.verdict is not other.verdict or len(one.periods) != len(other.periods):
        return True
    most = timedelta(seconds=one.time_error_s + other.time_error_s, microseconds=2)
    ends, others = ([end for period in each.periods for end in period] for each in (one, other))
    return any(x != y if x is None or y is None else abs(x - y) > most for x, y in zip(ends, others, strict=True))


def _of_files(args: argparse.Namespace, scene: Scene) -> list[Area | Track]:
    """Return the plans in files; raises InvalidInput for heights above another vertical datum than the scene's."""
    # Imported here, so that usage errors are fast.
    from conflictdb.formats.contents import without_objects
    from conflictdb.formats.gather import gather
    from conflictdb.formats.hints import FileHints

    plans: list[Area | Track] = []
    haven_m = None if args.haven is None else tuple(args.haven.values())
    zone = args.time_zone and str(args.time_zone)
    hints = FileHints(time_zone=zone, haven_m=haven_m, departure=args.departure, speed_kn=args.speed_kn)
    hints_given = None if hints == FileHints() else hints
    for read in gather(args.files, "plans", settings_of=lambda name: scene, hints=hints_given):
        remark_read(read.skipped, read.remarks)
        if not (read.areas or read.tracks):
            raise without_objects("file", read.sources[0], read.skipped)
        found: list[Area | Track] = [*read.areas, *read.tracks]
        datum = scene.vertical_datum if read.settings is None else read.settings.vertical_datum
        if datum is not scene.vertical_datum and any((one.floor_m, one.ceiling_m) != (None, None) for one in found):
            rule = f"is {scene.vertical_datum.value!r}, and the heights are above {datum.value!r}: convert them"
            raise InvalidInput(f"scene {scene.name!r}", "vertical_datum", rule, read.sources[0])
        plans += found
    return plans


def _plans(args: argparse.Namespace) -> list[Area | Track]:
    plans: list[Area | Track] = []
    key = args.key or "plan"
    heights = {"floor_m": args.floor_m, "ceiling_m": args.ceiling_m}
    if args.footprint is not None:
        footprint: Any = _geometry(key, "footprint", args.footprint, ("Polygon", "MultiPolygon"))
        plans.append(Area(key, footprint, start_us=args.start, end_us=args.end, **heights))
    if args.path is not None:
        path: Any = _geometry(key, "path", args.path, ("LineString",))
        plans.append(Track(key, path, args.times, rectangle_outline_m(**args.haven or _POINT), **heights))
    return plans


def _in_place(args: argparse.Namespace, plan: Area | Track, scene: "StoredScene") -> Area | Track:
    """Return a plan with its class and owner: as options say, else those of the object with its key."""
    object_class, owner = args.object_class, args.owner
    if args.key is not None:
        with suppress(InvalidInput):  # no such object
            stored = scene.plan(args.key)
            object_class = stored.object_class if object_class is None else object_class
            owner = stored.owner if owner is None else owner
    limit: Any = {} if isinstance(plan, Area) else {"max_speed_kn": math.inf}
    return replace(plan, object_class=object_class, owner=owner, **limit)


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
