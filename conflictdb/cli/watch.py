"""Serve a worker's state over HTTP: /healthz for supervisors, /metrics for Prometheus."""

import json
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from threading import Thread
from typing import TYPE_CHECKING, Any, Final

from conflictdb.errors import ConflictDBError
from conflictdb.model.results import format_moment

if TYPE_CHECKING:
    from prometheus_client.core import GaugeMetricFamily

    from conflictdb.jobs.detect import Run
    from conflictdb.jobs.worker import Report, WorkerState
    from conflictdb.store import SceneAlarm

# A worker is stuck if it is this much late in looking for changes, and not detecting.
_STUCK_S: Final = 60.0
# A silent client is disconnected after this time.
_CLIENT_S: Final = 10.0
_BUCKETS_S: Final = (0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0, 300.0, 1800.0)


def health(state: "WorkerState", every_s: float) -> tuple[bool, dict[str, object]]:
    """Return whether a worker that looks for changes every `every_s` seconds is healthy, and its activity."""
    looked_s_ago = time.monotonic() - state.looked_at_s
    is_stuck = state.scene is None and looked_s_ago > every_s + _STUCK_S
    status = "no database" if not state.is_connected else "stuck" if is_stuck else "ok"
    members = {"detects": state.scene, "looked_s_ago": round(looked_s_ago, 3), "scenes_waiting": state.waiting}
    # A restart of the worker would mend none of these, so they do not make it unhealthy.
    scenes = {
        one.scene: {
            "is_current": one.is_current,
            "since": format_moment(state.since[one.scene]),
            "unmapped": one.unmapped,
            "last_error": one.last_error,
            "tables": one.tables,
        }
        for one in state.alarms
    }
    return status == "ok", {"status": status, **members, "longest_wait_s": _longest_wait_s(state), "scenes": scenes}


def _longest_wait_s(state: "WorkerState") -> float:
    """Return how long the first change has waited, also one that waits for another worker or role, seconds."""
    now = datetime.now(UTC)
    waits = [(now - one.waiting_since).total_seconds() for one in state.alarms if one.waiting_since is not None]
    return round(max([state.longest_s, *waits]), 3)


class Metrics:
    """The metrics of a worker; raises ConflictDBError without prometheus_client."""

    def __init__(self, state: "WorkerState") -> None:
        try:
            from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
            from prometheus_client.core import GaugeMetricFamily
            from prometheus_client.exposition import CONTENT_TYPE_LATEST
            from prometheus_client.registry import Collector
        except ImportError:
            raise ConflictDBError("--http needs prometheus_client: pip install 'conflictdb[metrics]'") from None
        self.content_type = CONTENT_TYPE_LATEST
        self._registry = CollectorRegistry()
        self._text: Callable[[CollectorRegistry], bytes] = generate_latest
        self._runs = Counter(
            "conflictdb_runs", "Detections of this worker.", ["scene", "outcome"], registry=self._registry
        )
        self._seconds = Histogram(
            "conflictdb_run_seconds", "Time that a detection took.", buckets=_BUCKETS_S, registry=self._registry
        )
        self._lag = Histogram(
            "conflictdb_lag_seconds",
            "Time from the oldest change that waited to the end of the detection that took it in.",
            buckets=_BUCKETS_S,
            registry=self._registry,
        )
        shown: dict[str, tuple[str, Callable[[], float]]] = {
            "connected": ("Whether the worker is connected to the database.", lambda: state.is_connected),
            "connections_made": ("Connections that it has made; all but the first followed a loss.",
                                 lambda: state.connections),
            "scenes_waiting": ("Scenes that waited for detection when it last looked.", lambda: state.waiting),
            "longest_wait_seconds": ("How long the first change has waited, also one of an attached table.",
                                     lambda: _longest_wait_s(state)),
        }  # fmt: skip
        for name, (text, value) in shown.items():
            Gauge(f"conflictdb_{name}", text, registry=self._registry).set_function(value)

        class ConflictCollector(Collector):
            def collect(self) -> Iterator[GaugeMetricFamily]:
                """Yield the numbers of conflicts that the worker counted last."""
                labels = ["scene", "verdict", "acknowledged"]
                family = GaugeMetricFamily("conflictdb_conflicts", "Conflicts, counted every 10 s.", labels=labels)
                for (scene, verdict, is_acknowledged), number in state.conflicts.items():
                    family.add_metric([scene, verdict, "yes" if is_acknowledged else "no"], number)
                yield family
                yield from _alarm_families(state, GaugeMetricFamily)

        self._registry.register(ConflictCollector())

    def counted(self, report: "Report") -> "Report":
        """Return a function that counts a detection and then calls `report`."""

        def both(scene: str, outcome: "Run | Exception", waited_s: float) -> None:
            self._runs.labels(scene, "failed" if isinstance(outcome, Exception) else "done").inc()
            if not isinstance(outcome, Exception):
                self._seconds.observe(outcome.total_s)
                self._lag.observe(waited_s)
            report(scene, outcome, waited_s)

        return both

    def text(self) -> bytes:
        """Return all metrics in Prometheus's text format."""
        return self._text(self._registry)


def _alarm_families(state: "WorkerState", family: Any) -> "Iterator[GaugeMetricFamily]":
    """Yield the alarms of all scenes, as the worker read them last."""
    values: dict[str, tuple[str, Callable[[SceneAlarm], float]]] = {
        "current": ("Whether the conflicts of the scene are complete.", lambda one: one.is_current),
        "current_since_seconds": ("Since when that is so, Unix time.", lambda one: state.since[one.scene].timestamp()),
        "unmapped_rows": ("Rows of attached tables that are no objects.", lambda one: one.unmapped),
        "last_run_failed": ("Whether the last detection of the scene failed.", lambda one: one.last_error is not None),
    }
    alarms = state.alarms
    for name, (text, value) in values.items():
        found = family(f"conflictdb_{name}", text, labels=["scene"])
        for one in alarms:
            found.add_metric([one.scene], float(value(one)))
        yield found
    broken = family("conflictdb_attachment_broken", "Whether it cannot be read or followed.", labels=["scene", "table"])
    for one in alarms:
        for table, problem in one.tables.items():
            broken.add_metric([one.scene, table], float(problem is not None))
    yield broken


@contextmanager
def served(address: tuple[str, int], state: "WorkerState", metrics: Metrics, every_s: float) -> Iterator[int]:
    """Serve HTTP at (host, port) during the context; yields the port, which port 0 leaves to the system.

    Raises ConflictDBError if it cannot listen.
    """

    class Handler(BaseHTTPRequestHandler):
        timeout = _CLIENT_S

        def do_GET(self) -> None:
            if self.path == "/healthz":
                is_well, members = health(state, every_s)
                code = HTTPStatus.OK if is_well else HTTPStatus.SERVICE_UNAVAILABLE
                self._answer(code, "application/json", json.dumps(members).encode() + b"\n")
            elif self.path == "/metrics":
                self._answer(HTTPStatus.OK, metrics.content_type, metrics.text())
            else:
                self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"/healthz or /metrics\n")

        def _answer(self, code: HTTPStatus, kind: str, body: bytes) -> None:
            self.send_response(code)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, format: str, *arguments: Any) -> None:  # noqa: A002
            """Print nothing: the log is for the worker's own work."""

    class HealthServer(ThreadingTCPServer):
        allow_reuse_address = True
        daemon_threads = True
        address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET

        def handle_error(self, request: object, client_address: object) -> None:
            """Ignore a client that has disconnected."""

    try:
        server = HealthServer(address, Handler)
    except OSError as error:
        raise ConflictDBError(f"--http: cannot listen on {address[0]}, port {address[1]}: {error}") from error
    with server:
        thread = Thread(target=server.serve_forever, daemon=True, name="http")
        thread.start()
        try:
            yield int(server.server_address[1])
        finally:
            server.shutdown()
            thread.join()
