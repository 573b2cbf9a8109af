"""`server`: the embedded database."""

import argparse

from conflictdb import server as embedded
from conflictdb.cli.codes import DONE
from conflictdb.cli.output import note, out, remark


def server(args: argparse.Namespace) -> int:
    """Start, stop or show the embedded database."""
    actions = {"start": _start, "stop": _stop, "status": _show, "dsn": _dsn}
    return actions[args.action]()


def _start() -> int:
    return _describe(embedded.start_holder(say=note))


def _stop() -> int:
    return _describe(embedded.stop_holder(say=note))


def _show() -> int:
    return _describe(embedded.status())


def _dsn() -> int:
    with embedded.embedded(say=note) as running:
        if not running.status().held:
            remark("it stops when this command ends: `conflictdb server start` keeps it running")
        out(running.dsn)
    return DONE


def _describe(state: embedded.ServerStatus) -> int:
    if not state.running:
        out(f"stopped; its home is {state.home}")
        return DONE
    stays = "stays until `conflictdb server stop`" if state.held else "stops when its last user has gone"
    out(f"running, {stays}")
    out(f"server  {state.description}")
    out(f"home    {state.home}")
    out(f"dsn     {state.dsn}")
    return DONE
