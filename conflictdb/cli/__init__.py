"""The command line: `conflictdb [--dsn DSN] COMMAND`, also `python -m conflictdb`.

This room reads the environment, converts errors to one message and an exit code, and prints text.
"""

import os
import sys
from argparse import Namespace
from collections.abc import Sequence
from io import TextIOWrapper
from typing import Final

from conflictdb.cli.codes import (
    FAILED,
    INPUT_REFUSED,
    INTERRUPTED,
    NO_SERVER,
    NOT_CURRENT,
    SCHEMA_MISMATCH,
    TERMINATED,
    USAGE,
)
from conflictdb.cli.commands import build
from conflictdb.cli.output import remark
from conflictdb.cli.termination import Terminated, interrupt_behind, termination_as_interrupt
from conflictdb.errors import ConflictDBError, EngineMissing, InvalidInput, NotCurrent, SchemaError, ServerError

_CODES: Final = (
    (InvalidInput, INPUT_REFUSED),
    (SchemaError, SCHEMA_MISMATCH),
    (ServerError, NO_SERVER),
    (EngineMissing, USAGE),
    (NotCurrent, NOT_CURRENT),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; usage errors and --help raise SystemExit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # JSON and GeoJSON are UTF-8 in every locale
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    args = build().parse_args(arguments)
    from conflictdb.cli.logs import logged  # help needs none

    with logged(args.debug):
        return _run(args)


def _run(args: Namespace) -> int:
    args.dsn = args.dsn or os.environ.get("CONFLICTDB_DSN") or None
    try:
        with termination_as_interrupt():
            try:
                code = int(args.run(args))
            except Exception as error:
                if (interrupt := interrupt_behind(error)) is not None:
                    raise interrupt from None
                raise
        sys.stdout.flush()
    except ConflictDBError as error:
        return _failed(error, next((code for kind, code in _CODES if isinstance(error, kind)), FAILED), args.debug)
    except KeyboardInterrupt as interrupt:
        is_terminated = isinstance(interrupt, Terminated)
        remark("terminated" if is_terminated else "interrupted")
        return TERMINATED if is_terminated else INTERRUPTED
    except BrokenPipeError:
        # The reader of the output has closed it, as `head` does. Avoid a second error when Python flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        return _failed(error, FAILED, args.debug)
    except Exception as error:  # a bug in this program: report it, and how to see more
        if (known := _database_error(error)) is not None:
            return _failed(error, FAILED, args.debug, str(known))
        name = type(error).__name__
        return _failed(error, FAILED, args.debug, f"{name}: {error} (a mistake of this program; --debug shows where)")
    return code


def _database_error(error: Exception) -> ConflictDBError | None:
    """Convert an error of psycopg to one of this package; None for any other error."""
    if not type(error).__module__.startswith("psycopg"):
        return None
    from conflictdb.store import translated  # imports psycopg, which takes long

    try:
        with translated():
            raise error
    except ConflictDBError as known:
        return known


def _failed(error: Exception, code: int, debug: bool, message: str = "") -> int:
    if debug:
        import logging

        logging.getLogger(__name__).error("failed", exc_info=error)
    remark(message or str(error))
    return code
