"""`load`, `export`, `scenes`, `objects`, `rename`, `copy` and `delete`."""

import argparse
import shlex
from dataclasses import asdict
from datetime import datetime
from typing import TYPE_CHECKING, NamedTuple

from conflictdb.cli.codes import DONE, LEFT_OUT
from conflictdb.cli.load_report import Shown, labels, loaded_text, remark_loaded, scene_table
from conflictdb.cli.output import as_called, binary, data, line, out, print_json, remark, warnings_as_remarks
from conflictdb.cli.parser import check
from conflictdb.cli.session import database, load_files
from conflictdb.cli.tables import table
from conflictdb.cli.values import chosen_zone
from conflictdb.errors import InvalidInput
from conflictdb.model.results import format_moment

if TYPE_CHECKING:
    from conflictdb.store.scenes import ObjectSummary

# Ids that a remark lists.
_MOST_NAMED = 10


def load(args: argparse.Namespace) -> int:
    """Load files."""
    if args.positions:
        return _load_positions(args)
    with database(args) as db:
        loaded = load_files(db, args)
    remark_loaded(loaded)
    for one in loaded:
        out(loaded_text(one))
    return LEFT_OUT if any(one.invalid for one in loaded) else DONE


def _load_positions(args: argparse.Namespace) -> int:
    given = {"--replace": args.replace, "--layer": args.layer, "--haven": args.haven, "--speed-kn": args.speed_kn}
    given |= {"--departure": args.departure, "--max-gap": args.max_gap, "--max-speed-kn": args.max_speed_kn}
    given |= {"--skip-invalid": args.skip_invalid, "--unbounded-heights": args.unbounded_heights}
    others = [name for name, value in given.items() if value]
    check(
        args,
        [
            (args.scene is None, "--positions needs --scene"),
            (bool(others), f"--positions and {''.join(others[:1])} exclude each other"),
        ],
    )
    from conflictdb.formats.hints import FileHints

    hints = FileHints(args.map or {}, args.time_zone and str(args.time_zone))
    with database(args) as db:
        for file in args.files:
            loaded = db.scene(args.scene).load_positions(file, max_file_mb=args.max_file_mb, hints=hints)
            out(f"{args.scene}: {loaded.positions:,} positions of {loaded.tracks:,} tracks")
            if loaded.unknown:
                named = ", ".join(repr(key) for key in loaded.unknown[:_MOST_NAMED])
                more = ", …" if len(loaded.unknown) > _MOST_NAMED else ""
                remark(f"{file}: {len(loaded.unknown):,} ids are no tracks of the scene, and left out: {named}{more}")
            if loaded.left_out:
                remark(f"{file}: {loaded.left_out:,} rows without a time or a place are left out")
    return DONE


def export(args: argparse.Namespace) -> int:
    """Write a scene file."""
    from conflictdb.formats.reading import is_parquet

    if args.format == "rtz":
        with database(args) as db, warnings_as_remarks():
            files = db.scene(args.scene).export_routes(args.file, args.keys or None)
        out(f"{len(files):,} route{'' if len(files) == 1 else 's'} in {args.file}")
        return DONE
    is_binary = args.format == "geoparquet"
    is_whole = is_binary or args.file == "-" or is_parquet(args.file)
    check(
        args,
        [
            (args.format == "geojson" and is_parquet(args.file), "a file of GeoJSON does not end in .parquet"),
            (bool(args.keys) and is_whole, "GeoParquet and stdout hold the whole scene"),
        ],
    )
    with database(args) as db:
        scene = db.scene(args.scene)
        if is_binary and (args.file == "-" or not is_parquet(args.file)):
            from conflictdb.formats.writing import whole_file  # lists need none

            with binary() if args.file == "-" else whole_file(args.file) as stream:
                scene.write_geoparquet(stream)
        elif args.file == "-":
            data([scene.text()], is_json=True)
        else:
            with warnings_as_remarks():
                scene.export(args.file, args.keys or None)
    return DONE


def scenes(args: argparse.Namespace) -> int:
    """List the scenes."""
    with database(args) as db:
        out(scene_table(db.scenes()))
    return DONE


def objects(args: argparse.Namespace) -> int:
    """List the objects of a scene."""
    with database(args) as db:
        found = db.scene(args.scene).objects()
    if args.format == "json":
        ends = ("start_at", "end_at")
        rows = [asdict(one) | {name: format_moment(getattr(one, name)) for name in ends} for one in found]
        print_json([row | {"class": row.pop("object_class")} for row in rows])
        return DONE
    shown = Shown(args.tz or chosen_zone())
    header = ["KEY", "KIND", "NAME", shown.header("FROM"), shown.header("TO"), "FLOOR M", "CEILING M"]
    ruled = [name for name in ("object_class", "owner") if any(getattr(one, name) for one in found)]
    header += [name.removeprefix("object_").upper() for name in ruled]
    rules = [_rule(one) for one in found]
    header += ["RULE"] if any(rule.text for rule in rules) else []
    lines = [
        [
            *(one.key, one.kind, one.name),
            *(shown.moment(rule.start_at, up=False), shown.moment(rule.end_at, up=True)),
            *(None if height is None else f"{height:g}" for height in (one.floor_m, one.ceiling_m)),
            *(getattr(one, name) for name in ruled),
            *([rule.text] if header[-1] == "RULE" else []),
        ]
        for one, rule in zip(found, rules, strict=True)
    ]
    empty = as_called(f"no objects: `conflictdb load FILE --scene {shlex.quote(args.scene)}` brings some")
    out(table(header, lines, right=header[5:7], whole=header[3:5]) if found else empty)
    return DONE


class _Rule(NamedTuple):
    """When an object is there, and the rule of its schedule in words, with the number of times, where known."""

    start_at: datetime | None
    end_at: datetime | None
    text: str | None = None


def _rule(one: "ObjectSummary") -> _Rule:
    """Return the rule of an object; without a schedule only its times."""
    if one.schedule is None:
        return _Rule(one.start_at, one.end_at)
    # Imported here, so that usage errors are fast.
    from conflictdb.model.inputs import EPOCH, MICROSECOND
    from conflictdb.model.schedules import schedule_of
    from conflictdb.model.schedules.words import known_spans, schedule_text

    ends = (None if at is None else (at - EPOCH) // MICROSECOND for at in (one.start_at, one.end_at))
    try:
        schedule = schedule_of(f"object {one.key!r}", one.schedule)
        spans = known_spans(schedule, *ends)
    except InvalidInput:
        return _Rule(one.start_at, one.end_at, "not understood")
    if spans is None or not len(spans):
        return _Rule(one.start_at, one.end_at, schedule_text(schedule))
    count = f"{len(spans):,} time{'' if len(spans) == 1 else 's'}"
    text = f"{schedule_text(schedule)}, {count}"
    if one.kind == "track":  # its voyages last on
        return _Rule(one.start_at, one.end_at, text)
    return _Rule(EPOCH + int(spans[0, 0]) * MICROSECOND, EPOCH + int(spans[-1, 1]) * MICROSECOND, text)


def rename(args: argparse.Namespace) -> int:
    """Rename a scene, or an object."""
    with database(args) as db:
        if args.key is not None:
            names = db.scene(args.scene).names(args.key)
            db.scene(args.scene).rename_object(args.key, args.new)
            line(f"{args.scene}: {labels(names, [args.key])} is now {args.new}")
        else:
            db.scene(args.scene).rename(args.new)
            line(f"{args.scene} is now {args.new}")
            args.scene = args.new
    return DONE


def copy(args: argparse.Namespace) -> int:
    """Copy a scene."""
    with database(args) as db:
        copied = db.scene(args.scene).copy(args.new)
        line(f"{args.new}: {len(copied.objects())} objects of {args.scene}, to be detected")
    return DONE


def delete(args: argparse.Namespace) -> int:
    """Delete objects, or a scene."""
    whole = args.all and args.scene is not None
    check(args, [(bool(args.keys) == args.all or (args.all and not whole), "give KEY…, or --scene NAME --all")])
    with database(args) as db:
        if args.all:
            db.scene(args.scene).delete()
            line(f"{args.scene}: deleted")
        else:
            names = db.scene(args.scene).names(*args.keys)
            db.scene(args.scene).delete_objects(*args.keys)
            line(f"{args.scene}: {len(args.keys)} deleted: {labels(names, args.keys)}")
    return DONE
