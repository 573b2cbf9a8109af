"""`service`: print units for systemd, cron or pg_cron that keep scenes current."""

import argparse
import os
import re
import sys
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Final

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import data, remark

# Name for users -> file in conflictdb/services.
SERVICES: Final = {
    "systemd": "conflictdb-worker.service",
    "systemd-once": "conflictdb-detect.service",
    "systemd-timer": "conflictdb-detect.timer",
    "cron": "crontab",
    "pg_cron": "pg_cron.sql",
}
# The program's path in these files; other characters would need quoting, differently in each.
_PROGRAM: Final = "/opt/conflictdb/bin/conflictdb"
_PLAIN: Final = re.compile(r"[\w./+-]+", re.ASCII)
# Settings of the units, and the directories that they hide from the program (systemd.exec(5)).
_HIDDEN: Final = {
    "ProtectHome=yes": ("/home", "/root", "/run/user"),
    "PrivateTmp=yes": ("/tmp", "/var/tmp"),  # noqa: S108 (compared with, not written to)
}


def service(args: argparse.Namespace) -> int:
    """Print a unit of systemd, a line for cron, or jobs of pg_cron.

    A remark names paths that the printed systemd unit could not reach, and the remedy.
    """
    program = os.path.abspath(os.environ.get("CONFLICTDB_PROGRAM") or sys.argv[0])  # noqa: PTH100 (links stay)
    text = (files("conflictdb") / "services" / SERVICES[args.what]).read_text()
    data([text.replace(_PROGRAM, program) if _PLAIN.fullmatch(program) else text], is_json=False)
    if "ExecStart=" in text:
        # A visible program may still use an interpreter or packages in a home directory.
        needed = (program, sys.executable, sys.prefix, sys.base_prefix, str(files("conflictdb")))
        for path, setting, directory in hidden(needed)[:1]:
            remark(
                f"the printed unit cannot start this program: it needs {path}, and {setting} hides {directory}.\n"
                "Install conflictdb and its Python outside it, such as in /opt/conflictdb, and print the unit there."
            )
    return DONE


def hidden(paths: Iterable[str]) -> list[tuple[str, str, str]]:
    """Return (path, setting, directory) of each path that a setting of the units hides, links followed."""
    found = []
    for path in paths:
        # A link in a hidden directory is hidden, whatever its target.
        for place in dict.fromkeys((Path(os.path.abspath(path)), Path(path).resolve())):  # noqa: PTH100 (links stay)
            found += [
                (str(place), setting, directory)
                for setting, directories in _HIDDEN.items()
                for directory in directories
                if place.is_relative_to(directory)
            ]
    return found
