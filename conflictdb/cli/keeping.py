"""`scenes`, `objects`, `rename`, `copy` and `delete`."""

import argparse
from dataclasses import asdict
from datetime import UTC

from conflictdb.cli.codes import DONE
from conflictdb.cli.load_report import Shown, scene_table
from conflictdb.cli.output import data, out, table
from conflictdb.cli.parser import check
from conflictdb.cli.session import database
from conflictdb.formats.instants import format_moment
from conflictdb.formats.json_text import dumped


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
        rows = [
            asdict(one) | {"start_at": format_moment(one.start_at), "end_at": format_moment(one.end_at)}
            for one in found
        ]
        data([dumped(rows, indent=2), "\n"], is_json=True)
        return DONE
    shown = Shown(args.tz or UTC)
    header = ["KEY", "KIND", "NAME", shown.header("FROM"), shown.header("TO"), "FLOOR M", "CEILING M"]
    lines = [
        [
            *(one.key, one.kind, one.name),
            *(shown.moment(one.start_at, up=False), shown.moment(one.end_at, up=True)),
            *(None if height is None else f"{height:g}" for height in (one.floor_m, one.ceiling_m)),
        ]
        for one in found
    ]
    out(table(header, lines, right=header[-2:]) if found else "no objects")
    return DONE


def rename(args: argparse.Namespace) -> int:
    """Rename a scene, or an object."""
    with database(args) as db:
        if args.key is not None:
            db.scene(args.scene).rename_object(args.key, args.new)
            out(f"{args.scene}: {args.key} is now {args.new}")
        else:
            db.scene(args.scene).rename(args.new)
            out(f"{args.scene} is now {args.new}")
            args.scene = args.new
    return DONE


def copy(args: argparse.Namespace) -> int:
    """Copy a scene."""
    with database(args) as db:
        copied = db.scene(args.scene).copy(args.new)
        out(f"{args.new}: {len(copied.objects())} objects of {args.scene}, to be detected")
    return DONE


def delete(args: argparse.Namespace) -> int:
    """Delete objects, or a scene."""
    whole = args.all and args.scene is not None
    check(args, [(bool(args.keys) == args.all or (args.all and not whole), "give KEY…, or --scene NAME --all")])
    with database(args) as db:
        if args.all:
            db.scene(args.scene).delete()
            out(f"{args.scene}: deleted")
        else:
            db.scene(args.scene).delete_objects(*args.keys)
            out(f"{args.scene}: {len(args.keys)} deleted")
    return DONE
