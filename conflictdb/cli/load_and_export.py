"""`load` and `export`."""

import argparse

from conflictdb.cli.codes import DONE, LEFT_OUT
from conflictdb.cli.load_report import loaded_text, remark_loaded
from conflictdb.cli.output import binary, data, out
from conflictdb.cli.parser import check
from conflictdb.cli.session import database, load_files
from conflictdb.formats.reading import is_parquet
from conflictdb.formats.whole_files import whole_file


def load(args: argparse.Namespace) -> int:
    """Load files."""
    with database(args) as db:
        loaded = load_files(db, args)
    remark_loaded(loaded)
    for one in loaded:
        out(loaded_text(one))
    return LEFT_OUT if any(one.invalid for one in loaded) else DONE


def export(args: argparse.Namespace) -> int:
    """Write a scene file."""
    check(args, [(args.format == "geojson" and is_parquet(args.file), "a file of GeoJSON does not end in .parquet")])
    is_binary = args.format == "geoparquet"
    with database(args) as db:
        if args.file == "-" and is_binary:
            with binary() as stream:
                db.scene(args.scene).write_geoparquet(stream)
        elif is_binary and not is_parquet(args.file):
            with whole_file(args.file) as stream:
                db.scene(args.scene).write_geoparquet(stream)
        elif args.file == "-":
            data([db.scene(args.scene).text()], is_json=True)
        else:
            db.scene(args.scene).export(args.file)
    return DONE
