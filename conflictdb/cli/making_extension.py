"""`extension`: conflictdb as an extension of a server."""

import argparse

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import out
from conflictdb.db import extension as files


def extension(args: argparse.Namespace) -> int:
    """Write the files of the extension."""
    directory = args.directory or files.install_directory(args.pg_config)
    for path in files.build(directory):
        out(str(path))
    return DONE
