"""`worker`, `status`, `init`, `upgrade` and `extension`."""

import argparse
from contextlib import ExitStack, suppress
from typing import Any

from conflictdb.cli.codes import DONE, FAILED
from conflictdb.cli.load_report import remark_incomplete, scene_table
from conflictdb.cli.log import Log
from conflictdb.cli.output import note, out, print_json, remark
from conflictdb.cli.parser import check
from conflictdb.cli.session import connections, database
from conflictdb.cli.watch import Metrics, served
from conflictdb.db import schema, store
from conflictdb.formats.instants import format_moment
from conflictdb.session.database import Status, connect


def work(args: argparse.Namespace) -> int:
    """Keep all scenes current."""
    other = "--every" if args.every is not None else "--http" if args.http is not None else None
    check(args, [(args.once and other is not None, f"--once and {other} exclude each other")])
    # Imported here: it loads the solvers, which are slow to import.
    from conflictdb.db.worker import EVERY_S, Worker

    log = Log(args.log == "json")
    with database(args), connections(args, store.worker_dsn) as connection, ExitStack() as serving:
        worker = Worker(
            connection, log.report, args.every or EVERY_S, args.jobs, args.lock_timeout, log.say, args.memory_mb
        )
        if args.once:
            return DONE if worker.once() else FAILED
        if args.http is not None:
            metrics = Metrics(worker.state)
            worker.counts = True
            worker.report = metrics.counted(log.report)
            serving.enter_context(served(args.http, worker.state, metrics, worker.every_s))
        note("working; Ctrl-C ends")
        with suppress(KeyboardInterrupt):
            worker.run()
    note("stopped")
    return DONE


def status(args: argparse.Namespace) -> int:
    """Show the database, its schema, its scenes and its workers."""
    with database(args) as db:
        state = db.status()
    if args.format == "json":
        print_json(_members(state))
        return DONE
    out(f"database  {state.database}")
    out(f"server    {state.server}")
    out(f"schema    {state.revision}")
    out(f"workers   {state.worker_count}")
    out()
    out(scene_table(state.scenes))
    return DONE


def _members(state: Status) -> dict[str, Any]:
    counts = ("areas", "tracks", "pending", "conflicts", "run_id")
    scenes = [
        {
            "name": scene.scene.name,
            **{name: getattr(scene, name) for name in counts},
            "finished_at": format_moment(scene.finished_at),
            "error": scene.error,
            "is_current": scene.is_current,
        }
        for scene in state.scenes
    ]
    members = {"database": state.database, "server": state.server, "schema_revision": state.revision}
    return {**members, "worker_count": state.worker_count, "scenes": scenes}


def init(args: argparse.Namespace) -> int:
    """Create the schema."""
    return upgrade(args)


def upgrade(args: argparse.Namespace) -> int:
    """Create the schema, or upgrade it to this program's revision."""
    with connect(args.dsn, create=True, say=note) as db:
        state = db.status()
        missing = schema.missing_grants(db.connection)
        waiting = [db.scene(one.scene.name).state() for one in state.scenes if not one.is_current]
    if missing:
        remark(f"the roles of conflictdb cannot read yet; let an administrator run: {missing}")
    out(f"database {state.database}: schema conflictdb is at revision {state.revision}")
    # An upgrade that changes answers marks every object.
    remark_incomplete(waiting)
    return DONE


def extension(args: argparse.Namespace) -> int:
    """Write the files of conflictdb as an extension of a server."""
    from conflictdb.db import extension as files

    for path in files.build(args.directory or files.install_directory(args.pg_config)):
        out(str(path))
    return DONE
