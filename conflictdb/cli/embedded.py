"""`server` and `psql`: run the embedded database, and open a client."""

import argparse
import os
from collections.abc import Sequence
from typing import NoReturn

from psycopg import conninfo

from conflictdb import embedded, store
from conflictdb.cli.codes import DONE, FAILED
from conflictdb.cli.output import as_called, note, out, remark
from conflictdb.client.database import connect
from conflictdb.errors import SchemaError


def server(args: argparse.Namespace) -> int:
    """Start, stop or show the embedded database."""
    if args.action == "dsn":
        with embedded.embedded(say=note) as running:
            if not running.status().held:
                remark("it stops when this command ends: `conflictdb server start` keeps it running")
            out(running.dsn)
        return DONE
    if args.action == "start":
        state = embedded.start_holder(say=note)
    elif args.action == "stop":
        state = embedded.stop_holder(say=note)
    else:
        state = embedded.status()
    _describe(state)
    return DONE


def _describe(state: embedded.ServerStatus) -> None:
    if not state.running:
        out(f"stopped; its home is {state.home}")
        return
    stays = as_called("stays until `conflictdb server stop`") if state.held else "stops when its last user has gone"
    out(f"running, {stays}")
    out(f"server  {state.description}")
    out(f"home    {state.home}")
    out(f"dsn     {state.dsn}")


def psql(args: argparse.Namespace) -> int:
    """Replace this process by psql on the database; the embedded one runs until psql ends."""
    if args.dsn:
        dsn, found = args.dsn, embedded.find_psql()
    else:
        try:
            connect(say=note).close()  # creates the schema if needed
        except SchemaError as error:
            remark(str(error))  # psql is how to mend it
        running = embedded.embedded(say=note)
        dsn, found = running.dsn, embedded.find_psql(running)
        running.stay_through_exec()
    if found is not None:
        _exec_psql(found, dsn, args.arguments)
    remark(
        f"there is no psql on this machine{' that only root can change' if os.geteuid() == 0 else ''}"
        " (Debian, Ubuntu: sudo apt-get install postgresql-client); any other client takes"
        " what `conflictdb server dsn` prints"
    )
    return FAILED


def _exec_psql(psql: embedded.Psql, dsn: str, arguments: Sequence[str]) -> NoReturn:
    with store.translated():
        parts = conninfo.conninfo_to_dict(dsn)
    if any(argument.startswith(("-U", "--username")) for argument in arguments):
        del parts["user"]  # a user in the DSN would override it
    password = parts.pop("password", None)  # arguments are visible to all users of a machine
    environ = {**os.environ, **psql.environ, **({"PGPASSWORD": str(password)} if password else {})}
    # The CONTEXT of an error is the source of conflictdb's routines.
    command = ["psql", "--set=SHOW_CONTEXT=never", "--dbname", conninfo.make_conninfo("", **parts), *arguments]
    os.execve(psql.path, command, environ)  # noqa: S606 (a shell would not help)
