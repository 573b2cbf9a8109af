"""`completion`: complete commands in a shell."""

import argparse
import os
from pathlib import Path
from typing import Any

from conflictdb.cli.codes import DONE
from conflictdb.cli.commands import build
from conflictdb.cli.output import data


def completion(args: argparse.Namespace) -> int:
    """Print a script that completes the commands of this program, by the name it was called."""
    import shtab

    parser = build(Path(os.environ.get("CONFLICTDB_PROGRAM") or "conflictdb").name)
    _complete_files(parser, {"FILE": shtab.FILE, "DIRECTORY": shtab.DIRECTORY})
    data([shtab.complete(parser, args.shell, root_prefix="conflictdb"), "\n"], is_json=False)
    return DONE


def _complete_files(parser: argparse.ArgumentParser, kinds: dict[str, Any]) -> None:
    """Complete names of files where an argument is one."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                _complete_files(command, kinds)
        elif str(action.metavar) in kinds:
            action.complete = kinds[str(action.metavar)]  # type: ignore[attr-defined]
