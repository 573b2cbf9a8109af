"""examples/http_server: it answers, its limits hold, and random requests by its OpenAPI get no 5xx."""

import json
import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psycopg
import pytest
import schemathesis
from draws import draws
from hypothesis import HealthCheck, Phase, given, settings
from jsonschema import Draft202012Validator
from patience import WAIT_S
from ports import free_port
from psycopg import conninfo
from scenes import box, sail
from schemathesis import GenerationMode

from conflictdb import Area, Scene, Track, connect, store
from conflictdb.formats.scene_file import plans_text

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "http_server"
ROLE = "desk_of_example"
OPERATIONS = ("plans", "probe", "admit", "conflicts", "events")


@pytest.fixture
def address(dsn: str, tmp_path: Path) -> Iterator[str]:
    """Return the address of a server whose role is an editor, and nothing else; it must log no traceback."""
    with psycopg.connect(dsn, autocommit=True) as admin:
        admin.execute(f"DROP ROLE IF EXISTS {ROLE}".encode())
        admin.execute(f"CREATE ROLE {ROLE} LOGIN IN ROLE conflictdb_editor".encode())
        store.replace_scene(admin, Scene("s"), [box("A", 0.4, -0.1, 0.6, 0.1)], [], merge=True)
    port = free_port()
    command = [sys.executable, "-m", "uvicorn", "--factory", "app:application", "--port", f"{port}"]
    own = {"CONFLICTDB_DSN": conninfo.make_conninfo(dsn, user=ROLE)}
    quiet = ["--log-level", "warning"]
    log = tmp_path / "server.log"
    with (
        log.open("wb") as errors,
        subprocess.Popen([*command, *quiet], cwd=EXAMPLE, env={**os.environ, **own}, stderr=errors) as server,
    ):
        try:
            _wait(port, server)
            yield f"http://127.0.0.1:{port}"
        finally:
            server.terminate()
    assert "Traceback" not in log.read_text()
    with psycopg.connect(dsn, autocommit=True) as admin:
        admin.execute(f"DROP ROLE {ROLE}".encode())


def _wait(port: int, server: subprocess.Popen[bytes]) -> None:
    end_s = time.monotonic() + WAIT_S
    while True:
        assert server.poll() is None
        assert time.monotonic() < end_s
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)


def asked(url: str, method: str = "GET", body: bytes | None = None) -> tuple[int, Any]:
    request = urllib.request.Request(url, body, method=method)  # noqa: S310 our own
    try:
        with urllib.request.urlopen(request, timeout=WAIT_S) as answer:  # noqa: S310
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as refused:
        return refused.code, json.load(refused)


def body(*plans: Area | Track) -> bytes:
    return plans_text(plans).encode()


def test_it_answers(address: str, dsn: str) -> None:
    """Each operation, and errors in the sentences of conflictdb; the form of requests is in the OpenAPI."""
    status, described = asked(f"{address}/openapi.json")
    assert status == 200
    assert described["paths"].keys() == {f"/scenes/{{scene}}/{one}" for one in OPERATIONS}
    scene = f"{address}/scenes/s"
    cross = sail("new", (0.0, 0.0), (1.0, 0.0))
    status, probed = asked(f"{scene}/probe", "POST", body(cross))
    assert (status, [(one["a_key"], one["b_key"]) for one in probed["conflicts"]]) == (200, [("A", "new")])
    status, admitted = asked(f"{scene}/admit", "POST", body(cross))
    assert (status, admitted["admitted"], len(admitted["conflicts"])) == (200, False, 1)
    apart = sail("apart", (0.0, 5.0), (1.0, 5.0))
    assert asked(f"{scene}/admit?owner=me", "POST", body(apart)) == (200, {"admitted": True, "conflicts": []})
    assert asked(f"{scene}/plans", "PUT", body(cross)) == (200, {"added": 1, "updated": 0, "unchanged": 0})
    with connect(dsn) as db:
        db.scene("s").detect()
    status, known = asked(f"{scene}/conflicts")
    assert (status, known["is_current"], [one["b_key"] for one in known["conflicts"]]) == (200, True, ["new"])
    status, answer = asked(f"{scene}/events?after=0&most=10")
    assert (status, [one["kind"] for one in answer["events"]]) == (200, ["opened"])
    status, refused = asked(f"{scene}/admit", "POST", body(apart))
    assert (status, refused["error"].startswith("plan 'apart': key: ")) == (422, True)
    assert asked(f"{address}/scenes/none/conflicts")[0] == 404
    assert asked(f"{scene}/plans", "PUT", b"\xff")[0] == 400
    assert asked(f"{scene}/plans", "PUT", b"{}")[0] == 422
    assert asked(f"{scene}/events?after=-1")[0] == 422


def test_its_limits_hold(address: str) -> None:
    """Of bytes and of plans; the OpenAPI has the form of plans."""
    assert asked(f"{address}/scenes/s/plans", "PUT", b" " * 1_000_001)[0] == 413
    many = [box(f"{k}", 3.0 + k, 3.0, 3.5 + k, 3.5) for k in range(101)]
    status, refused = asked(f"{address}/scenes/s/plans", "PUT", body(*many))
    assert (status, refused["error"]) == (422, "plans: must be 1 to 100 in a request; got 101")
    document = json.loads(plans_text(many[:2]))
    schema = asked(f"{address}/openapi.json")[1]["components"]["schemas"]
    whole = {"$ref": "#/components/schemas/plans", "components": {"schemas": schema}}
    Draft202012Validator(whole).validate(document)


def test_a_client_that_leaves_is_no_error_of_the_server(address: str) -> None:
    """In the middle of its body; others get their answers."""
    port = urllib.parse.urlsplit(address).port
    for _ in range(3):
        with socket.create_connection(("127.0.0.1", port)) as leaving:
            leaving.sendall(b"POST /scenes/s/probe HTTP/1.1\r\nHost: h\r\nContent-Length: 1000\r\n\r\n{")
    assert asked(f"{address}/scenes/s/conflicts")[0] == 200


@draws("examples", 5, 60)
def test_random_requests_get_no_error_of_the_server(address: str, examples: int) -> None:
    """By the OpenAPI: requests that are valid, and that are not; each document goes to all operations that take one."""
    quick = settings(
        max_examples=examples,
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    answers: dict[str, set[int]] = {}

    def note(case: schemathesis.Case, path: str, method: str) -> None:
        case.path, case.method = path, method
        status = case.call(base_url=address, timeout=WAIT_S).status_code
        answers.setdefault(path, set()).add(status)
        assert status < 500, case.as_curl_command()

    operations = [one.ok() for one in schemathesis.openapi.from_url(f"{address}/openapi.json").get_all_operations()]
    take_plans = [one for one in operations if one.method.upper() != "GET"]

    def ask(case: schemathesis.Case) -> None:
        given_to = take_plans if case.operation in take_plans else [case.operation]
        for one in given_to:
            note(case, one.path, one.method)

    for one in operations:
        if one in take_plans and not one.path.endswith("/admit"):
            continue
        for mode in GenerationMode:
            quick(given(one.as_strategy(mode, path_parameters={"scene": "s"}))(ask))()
            if one not in take_plans:
                quick(given(one.as_strategy(mode))(ask))()
    assert len(answers) == len(operations) == len(OPERATIONS)
    assert set.union(*answers.values()) >= {200, 404, 422}
