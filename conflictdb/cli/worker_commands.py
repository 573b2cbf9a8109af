"""`worker` and `status`."""

import argparse
import logging
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from conflictdb import store
from conflictdb.cli.codes import DONE, FAILED
from conflictdb.cli.load_report import run_text, scene_table
from conflictdb.cli.output import data, note, out, print_json, remark
from conflictdb.cli.parser import check
from conflictdb.cli.session import connections, database
from conflictdb.client.database import Status
from conflictdb.errors import ConflictDBError
from conflictdb.formats.json_text import dumped
from conflictdb.model.results import format_moment

if TYPE_CHECKING:
    from conflictdb.jobs.detect import Run


def work(args: argparse.Namespace) -> int:
    """Keep all scenes current."""
    if args.replay is not None:
        return _replay(args)
    check(args, [(args.scene is not None, "--scene is for --replay")])
    other = "--every" if args.every is not None else "--http" if args.http is not None else None
    check(args, [(args.once and other is not None, f"--once and {other} exclude each other")])
    # Imported here: it loads the solvers, which are slow to import.
    from conflictdb.jobs.worker import EVERY_S, Worker

    log = _Log(args.log == "json")
    with log.of_package(), database(args), connections(args, store.worker_dsn) as connection, ExitStack() as serving:
        worker = Worker(
            connection, log.report, args.every or EVERY_S, args.jobs, args.lock_timeout, log.say, args.memory_mb
        )
        if args.once:
            return DONE if worker.once() else FAILED
        if args.http is not None:
            from conflictdb.cli.watch import Metrics, served  # `status` serves nothing

            metrics = Metrics(worker.state)
            worker.counts = True
            worker.report = metrics.counted(log.report)
            serving.enter_context(served(args.http, worker.state, metrics, worker.every_s))
        note("working; Ctrl-C ends")
        with suppress(KeyboardInterrupt):
            worker.run()
    note("stopped")
    return DONE


def _replay(args: argparse.Namespace) -> int:
    from conflictdb.formats.reading import read_observed
    from conflictdb.jobs.replay import replay

    others = [name for name in ("once", "every", "http", "lock_timeout") if getattr(args, name)]
    option = "".join(others[:1]).replace("_", "-")
    check(args, [(bool(others), f"--replay and --{option} exclude each other")])
    args.needs_scene = True
    fixes, _ = read_observed(args.replay)
    alarms: set[int] = set()
    with database(args) as db, connections(args, store.worker_dsn) as connection, connection() as conn:
        scene = db.scene(args.scene)

        def report(now_us: int, looked: int) -> None:
            if not looked:
                return
            for one in scene.live_conflicts():
                if one.alarm_id not in alarms:
                    alarms.add(one.alarm_id)
                    at = format_moment(datetime.fromtimestamp(now_us / 1e6, UTC))
                    meets = "anything near" if one.other_key is None else one.other_key
                    out(f"{at} {one.key} {one.verdict} meet {meets}", flush=True)

        note("replaying; Ctrl-C ends")
        with suppress(KeyboardInterrupt):
            done = replay(conn, scene.name, fixes, report=report)
            out(f"{scene.name}: {done:,} positions replayed, {len(alarms):,} alarms")
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


@dataclass(frozen=True, slots=True)
class _Log:
    """The log of a worker: as text, with failures and remarks on stderr; as JSON, all on stdout."""

    is_json: bool

    def report(self, scene: str, outcome: "Run | Exception", waited_s: float) -> None:
        """Log a detection or its failure; `waited_s` is the waiting time of its changes."""
        if isinstance(outcome, Exception):
            if self.is_json:
                _print_event("failed", scene=scene, waited_s=waited_s, error=str(outcome))
            else:
                remark(f"{scene}: failed: {outcome}")
        elif self.is_json:
            _print_event("run", scene=scene, waited_s=waited_s, **asdict(outcome))
        else:
            out(run_text(scene, outcome), flush=True)

    @contextmanager
    def of_package(self) -> Iterator[None]:
        """Log what this package logs, and errors, in the form of this log."""
        logger, handler = logging.getLogger("conflictdb"), _Remarks(self.say)
        logger.addHandler(handler)
        logger.propagate, former = logger.propagate and not self.is_json, logger.propagate
        try:
            yield
        except ConflictDBError as error:
            if self.is_json:
                _print_event("error", error=str(error))
            raise
        finally:
            logger.removeHandler(handler)
            logger.propagate = former

    def say(self, text: str) -> None:
        """Log a remark."""
        if self.is_json:
            _print_event("remark", text=text)
        else:
            remark(text)


class _Remarks(logging.Handler):
    """Passes warnings of the package on, as texts."""

    def __init__(self, say: store.Say) -> None:
        super().__init__(logging.WARNING)
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        self._say(record.getMessage())


def _print_event(event: str, **members: object) -> None:
    data([dumped({"at": format_moment(datetime.now(UTC)), "event": event, **members}), "\n"], is_json=True)
    sys.stdout.flush()
