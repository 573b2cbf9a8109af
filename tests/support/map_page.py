"""The page of `conflictdb map` of a database: served in a thread, or by a program of its own."""

import json
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from http.client import HTTPConnection, HTTPMessage
from threading import Thread
from typing import Any
from urllib.parse import urlsplit

from patience import WAIT_S, killed_after

from conflictdb import store
from conflictdb.map.serve import PageServer

# Serves the page of a scene of a database until the end of a test, and returns its address.
Serve = Callable[[str, str], str]


@contextmanager
def served_page(dsn: str, scene: str, host: str = "127.0.0.1") -> Iterator[str]:
    """Serve the page of a scene, and give its address."""
    with PageServer(scene, lambda: store.connect(store.map_dsn(dsn)), host, 0) as server:
        thread = Thread(target=server.serve_until_interrupted, name="page", daemon=True)
        thread.start()
        try:
            until_s = time.monotonic() + WAIT_S
            while not server.started:
                assert time.monotonic() < until_s
                time.sleep(0.01)
            yield server.address
        finally:
            server.end()
            thread.join(WAIT_S)
        assert not thread.is_alive()


@contextmanager
def page_program(dsn: str, scene: str) -> Iterator[str]:
    """Serve the page of a scene by `conflictdb map`, which may run during other tests, and give its address."""
    command = [sys.executable, "-m", "conflictdb", "--dsn", dsn, "map", "--scene", scene, "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            with killed_after(process, WAIT_S):
                address = process.stdout.readline().strip()
            yield address
        finally:
            process.kill()


class Client:
    """Asks a page's server, as a browser would or as it must not."""

    def __init__(self, address: str) -> None:
        self.url = urlsplit(address)
        self.host = f"127.0.0.1:{self.url.port}"

    def ask(
        self, method: str, path: str, body: object = None, /, **headers: str | None
    ) -> tuple[int, bytes, HTTPMessage]:
        """Return status, body and headers of an answer; a header of None is not sent."""
        sent: Mapping[str, str | None] = {"Host": self.host, **{k.replace("_", "-"): v for k, v in headers.items()}}
        connection = HTTPConnection("127.0.0.1", self.url.port, timeout=WAIT_S)
        try:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            text = b"" if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
            for name, value in {**sent, "Content-Length": str(len(text))}.items():
                if value is not None:
                    connection.putheader(name, value)
            connection.endheaders(text)
            answer = connection.getresponse()
            return answer.status, answer.read(), answer.headers
        finally:
            connection.close()

    def read(self, path: str) -> Any:
        """Return the JSON of an answer."""
        status, body, _ = self.ask("GET", path)
        assert status == 200, body
        return json.loads(body)

    def conflicts(self) -> list[dict[str, Any]]:
        """Return the conflicts in their order, as routine _map_conflicts says that they are packed."""
        status, body, _ = self.ask("GET", "/api/conflicts")
        assert status == 200, body
        (size,) = struct.unpack_from("<I", body)
        head, at = json.loads(body[4 : 4 + size]), 4 + size
        found = []
        for a, b in zip(head["a"], head["b"], strict=True):
            number, verdict, is_current, error_s, *place, count = struct.unpack_from(">qhhdddffffi", body, at)
            times = struct.unpack_from(f">{2 * count}d", body, at + 56)
            at += 56 + 16 * count
            found.append({
                "id": number, "a": a, "b": b, "verdict": ("conflict", "grazing", "unresolved")[verdict],
                "is_current": bool(is_current), "error_s": error_s, "place": tuple(place[:2]), "box": tuple(place[2:]),
                "periods": list(zip(times[::2], times[1::2], strict=True)), "acknowledged": None,
            })  # fmt: skip
        for n, *what in head["acknowledged"]:
            found[n]["acknowledged"] = tuple(what)
        assert at == len(body)
        return found
