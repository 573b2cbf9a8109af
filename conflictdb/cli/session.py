"""Open the database of a command, and load its files."""

import argparse
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from conflictdb.cli.output import note, progress
from conflictdb.db import store
from conflictdb.errors import IncompleteWarning
from conflictdb.server import EmbeddedServer, embedded
from conflictdb.session.database import Database, connect
from conflictdb.session.loading import Loaded

if TYPE_CHECKING:
    from psycopg import Connection


@contextmanager
def database(args: argparse.Namespace) -> Iterator[Database]:
    """Open the database of a command, and close it at the end; applies --lock-timeout to everything in between."""
    with warnings.catch_warnings(), connect(args.dsn, say=note) as opened:
        warnings.simplefilter("ignore", IncompleteWarning)  # commands print their own remarks
        with store.waiting_at_most(opened.connection, getattr(args, "lock_timeout", None)):
            yield opened


def load_files(db: Database, args: argparse.Namespace) -> list[Loaded]:
    """Load the files of a command with its options."""
    return db.load_files(
        args.files,
        args.scene,
        replace=args.replace,
        max_speed_kn=args.max_speed_kn,
        layers=args.layer or (),
        skip_invalid=args.skip_invalid,
        max_file_mb=args.max_file_mb,
    )


@contextmanager
def connections(args: argparse.Namespace, named: Callable[[str], str]) -> Iterator[Callable[[], "Connection[Any]"]]:
    """Yield a function that connects, repeatedly, for commands that run long; `named` converts the connection string.

    Restarts the embedded database if it has ended, and keeps it running.
    """
    in_use: list[EmbeddedServer] = []

    def connection() -> "Connection[Any]":
        if args.dsn:
            return store.connect(named(args.dsn))
        in_use.append(embedded(say=note))
        for former in in_use[:-1]:
            former.stop()
        del in_use[:-1]
        return store.connect(named(in_use[0].dsn))

    try:
        yield connection
    finally:
        for server in in_use:
            server.stop()


def show_progress(done: int, total: int) -> None:
    """Show the progress of solving."""
    progress(f"solving: {done:,} of {total:,} pairs" if done < total else "")
