"""The database that a command works on, and the scene that it means."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from conflictdb.cli.output import note, progress
from conflictdb.database import Database, connect


@contextmanager
def database(args: argparse.Namespace) -> Iterator[Database]:
    """Open the database of a command, and close it at the end."""
    with connect(args.dsn, say=note) as opened:
        yield opened


def show_progress(done: int, total: int) -> None:
    """Show how much of the solving is done."""
    progress(f"solving: {done:,} of {total:,} pairs" if done < total else "")
