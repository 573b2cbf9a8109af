"""`service`: what has a system keep scenes current, written for this program."""

import argparse
import os
import re
import sys
from importlib.resources import files
from typing import Final

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import data

# By the name that a user gives: a file of conflictdb/services.
SERVICES: Final = {
    "systemd": "conflictdb-worker.service",
    "systemd-once": "conflictdb-detect.service",
    "systemd-timer": "conflictdb-detect.timer",
    "cron": "crontab",
    "pg_cron": "pg_cron.sql",
}
# As the files call the program; what has other characters than these would have to be quoted, in each its own way.
_PROGRAM: Final = "/opt/conflictdb/bin/conflictdb"
_PLAIN: Final = re.compile(r"[\w./+-]+", re.ASCII)


def service(args: argparse.Namespace) -> int:
    """Print a unit of systemd, a line for cron, or jobs of pg_cron."""
    program = os.path.abspath(os.environ.get("CONFLICTDB_PROGRAM") or sys.argv[0])  # noqa: PTH100 (links stay)
    text = (files("conflictdb") / "services" / SERVICES[args.what]).read_text()
    data([text.replace(_PROGRAM, program) if _PLAIN.fullmatch(program) else text], is_json=False)
    return DONE
