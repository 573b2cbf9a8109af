"""The server of `conflictdb map`: its answers, and the roles that get them."""

import gzip
import hashlib
import json
import os
import pty
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from http.client import HTTPConnection, HTTPResponse
from importlib.resources import files
from pathlib import Path
from queue import Empty, Queue
from typing import Any
from urllib.parse import quote, urlsplit

import numpy as np
import psycopg
import pytest
import shapely
from commands import STRAIT, runner
from map_page import Client, served_page
from patience import WAIT_S, killed_after, until
from piecework import load
from tiles import decode

import conflictdb
from conflictdb import store
from conflictdb.cli import pictures
from conflictdb.errors import ConflictDBError
from conflictdb.map import serve
from conflictdb.map.guard import local_hosts
from conflictdb.map.scene_changes import CONFLICTS, LIVE, OBJECTS, Listener, SceneChanges
from conflictdb.map.serve import USUAL_PORTS, PageServer
from conflictdb.map.views import MOST_VIEWS
from conflictdb.model.plans import Area, EarthModel, Motion, Scene
from conflictdb.plot import land

VENDOR = Path(str(files("conflictdb"))) / "map" / "vendor"
HOSTILE = "<img src=x onerror=alert(1)>"
# z, x and y that are not numbers, or too large for the database or for Python.
BAD_TILES = [
    f"{bad}/0/0" for bad in ("-1", "1.5", "NaN", "%D9%A1", "%00", "1e1", "31", str(2**31), "9" * 30, "9" * 5_000)
]
BAD_TILES += [f"0/{'9' * 30}/0", f"0/0/{'9' * 30}", "0/0/-1"]
READS = ["/", "/api/scene", "/api/conflicts", "/api/areas", "/api/overview", "/api/tracks", "/api/pair?a=CABLE&b=SUB-1"]
READS += [
    "/api/depths",
    "/api/scenes",
    "/api/scene?scene=strait",
    "/api/known?at=2026-06-01T09:00:00Z",
    "/api/pieces?key=FERRY&within_s=3600",
    "/api/plan?key=CABLE",
    "/api/owners?key=FERRY",
    "/api/live",
    "/page/kernel.wasm",
    "/tiles/areas/0/0/0",
    "/land/50m",
]
READS += ["/page/app.js", "/vendor/maplibre-gl.css", "/api/events"]


@contextmanager
def killed_at_last(process: "subprocess.Popen[Any]") -> Iterator[None]:
    try:
        yield
    finally:
        process.kill()


def test_page_reads_the_scene(strait: Client, dsn: str) -> None:
    scene = strait.read("/api/scene")
    assert (scene["scene"], scene["motion"], scene["objects"], scene["is_current"]) == ("strait", "rhumb", 11, True)
    rows = strait.conflicts()
    with conflictdb.connect(dsn) as db:
        known = db.scene("strait").conflicts()
        boxes = db.connection.execute("SELECT conflict_id, Box2D(region)::box3d FROM conflictdb.conflicts").fetchall()
    assert [(row["a"], row["b"], row["verdict"]) for row in rows] == [(c.a_key, c.b_key, str(c.verdict)) for c in known]
    for row, conflict in zip(rows, known, strict=True):
        assert row["periods"] == [(start.timestamp(), end.timestamp()) for start, end in conflict.periods]
        assert row["place"] == conflict.first_contact_deg
        assert (row["is_current"], row["error_s"]) == (True, conflict.time_error_s)
    # The worst first: number, when, words, and metres.
    ranked = strait.read("/api/depths")
    keys = {row["id"]: (row["a"], row["b"]) for row in rows}
    assert [keys[one[0]] for one in ranked[:2]] == [("FERRY", "TOW"), ("CABLE", "SUB-1")]
    assert [(one[2], round(one[3] / 1852, 1)) for one in ranked[:2]] == [("too close", 0.5), ("inside", 7.2)]
    assert {keys[one[0]] for one in ranked} == set(keys.values())
    known_boxes = {number: [float(n) for n in re.findall(r"[-\d.e]+", box[6:])] for number, box in boxes}
    for row in rows:
        west, south, _, east, north, _ = known_boxes[row["id"]]
        assert row["box"] == pytest.approx((west, south, east, north), rel=1e-7)
    assert sorted(row[1] for row in strait.read("/api/areas")["rows"]) == ["CABLE", "DIVING", "FIRING", "RESERVE"]
    status, packed, _ = strait.ask("GET", "/api/tracks")
    length = int.from_bytes(packed[:4], "little")
    head = json.loads(packed[4 : 4 + length])
    assert (status, len(head["rows"])) == (200, 7)
    assert len(packed) == 4 + length + sum(size or 0 for row in head["rows"] for size in row[6:])
    pair = strait.read("/api/pair?a=CABLE&b=SUB-1")
    assert (pair["explanation"]["verdict"], list(pair["footprints"])) == ("conflict", ["CABLE"])
    assert sorted(decode(strait.ask("GET", "/tiles/conflicts/6/33/19")[1])) == ["conflicts", "first_contacts"]


def test_page_asks_for_its_modules_at_once() -> None:
    """The page requests all modules itself, before the modules that import them arrive."""
    page = VENDOR.parent / "page"
    asked = (page / "index.html").read_text()
    assert [module.name for module in page.glob("*.js") if f'"page/{module.name}"' not in asked] == []


def _polygons(text: str) -> Any:
    (land_feature, _) = json.loads(text)["features"]
    return shapely.geometry.shape(land_feature["geometry"])


def test_land_in_a_box_is_land() -> None:
    """Even if coasts cross the edge of a box often, the inside keeps its land."""
    places = [(4.0, 57.0), (-4.0, 52.5), (9.5, 61.5), (2.5, 49.0), (0.5, 55.5)]
    box = (-7.0, 47.0, 15.0, 67.0)
    for detail in (land.COARSE, land.FINE):
        found = _polygons(land.geojson(detail, box))
        assert [bool(shapely.contains_xy(found, *place)) for place in places] == [False, True, True, True, False]
        assert found.area == pytest.approx(202.0, abs=0.5)  # square degrees
    rest = _polygons(land.geojson(land.COARSE, land.WORLD, box))
    assert not shapely.contains_xy(rest, *places[1])
    assert shapely.contains_xy(rest, 25.0, 55.0)


def test_no_transaction_stays_open(strait: Client, conn: psycopg.Connection[Any]) -> None:
    """Not between two requests of the page: it would block changes of tables, such as `upgrade`."""
    query = "SELECT query FROM pg_stat_activity WHERE datname = current_database() AND starts_with(state, 'idle in')"
    conn.autocommit = True
    for path in [*READS[:-1], "/api/pair?a=CABLE&b=nobody"]:
        strait.ask("GET", path)
        until_s = time.monotonic() + WAIT_S
        while found := conn.execute(query).fetchall():  # those of the listening connection are short
            assert time.monotonic() < until_s, (path, found)
            time.sleep(0.02)


def test_mistakes_are_told(strait: Client) -> None:
    for path, status in [
        ("/api/pair?a=CABLE&b=nobody", 400),
        ("/api/nothing", 404),
        ("/page/../../errors.py", 404),
        ("/vendor/vendor.json", 404),
        ("/tiles/havens/0/0/0", 404),
        ("/tiles/areas/2/9/0", 400),
        *((f"/tiles/areas/{place}", 400) for place in BAD_TILES),
        ("/api/pair?a=%00&b=SUB-1", 400),
        ("/api/pair?a=CABLE&b=SUB-1%00", 400),
        ("/api/pair?a=%ED%A0%80&b=SUB-1", 400),
        ("/api/pair?a=CABLE&a=CABLE&b=SUB-1", 400),
        ("/api/pair?b=SUB-1", 400),
        (f"/api/pair?a={'x' * 50_000}&b=SUB-1", 400),
        ("/land/1m", 404),
        ("/land/50m?box=1,2,3", 400),
        ("/land/50m?box=1,2,inf,nan", 400),
        ("/land/50m?box=1,2,3,4&box=1,2,3,4", 400),
        ("/land/50m?but=%00", 400),
        (f"/land/50m?box={'9' * 5_000},0,1,1", 400),
    ]:
        found, body, _ = strait.ask("GET", path)
        assert (found, list(json.loads(body))) == (status, ["error"]), path[:80]


def test_another_site_reads_nothing(strait: Client) -> None:
    """A browser sends these headers for it, and whoever made the site cannot take them away."""
    for path in READS:
        for headers in (
            {"Host": "evil.example"},
            {"Host": f"127.0.0.1.evil.example:{strait.url.port}"},
            {"Host": "127.0.0.1:1"},
            {"Host": None},
            {"Origin": "http://evil.example"},
            {"Origin": "null"},
            {"Origin": f"http://localhost:{strait.url.port}"},
            {"Sec_Fetch_Site": "cross-site"},
            {"Sec_Fetch_Site": "same-site"},
            {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "script"},
        ):
            status, body, found = strait.ask("GET", path, **headers)
            assert status in (400, 403), (path, headers)
            assert len(body) < 100
            assert "Access-Control-Allow-Origin" not in found
    # Nothing is allowed to it, either, when it asks beforehand.
    assert strait.ask("OPTIONS", "/api/acknowledge", Origin="http://evil.example")[0] == 403


def test_a_link_of_another_site_leads_to_the_page_alone(strait: Client) -> None:
    link = {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Dest": "document", "Sec_Fetch_Mode": "navigate"}
    assert strait.ask("GET", "/", **link)[0] == 200
    assert strait.ask("GET", "/api/scene", **link)[0] == 403
    assert strait.ask("GET", "/", **{**link, "Sec_Fetch_Dest": "iframe"})[0] == 403


def test_every_answer_says_what_browsers_may_do_with_it(strait: Client) -> None:
    for path in [*READS[:-1], "/nothing"]:
        headers = strait.ask("GET", path)[2]
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy.replace("'wasm-unsafe-eval'", "")
        assert "frame-ancestors 'none'" in policy
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Cache-Control"] == "no-store"


def test_only_the_page_acknowledges(strait: Client, dsn: str) -> None:
    secret = strait.read("/api/scene")["secret"]
    asked = {"a": "CABLE", "b": "SUB-1", "reason": HOSTILE}
    good = {"X_Conflictdb_Secret": secret, "Content_Type": "application/json", "Origin": f"http://{strait.host}"}

    def reasons() -> list[str | None]:
        return [row["acknowledged"][1] for row in strait.conflicts() if row["acknowledged"] is not None]

    for wrong, status in [
        ({"X_Conflictdb_Secret": None}, 403),
        ({"X_Conflictdb_Secret": secret[:-1]}, 403),
        ({"X_Conflictdb_Secret": "\xe9"}, 403),
        ({"Content_Type": "text/plain"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Sec_Fetch_Site": "cross-site"}, 403),
    ]:
        assert strait.ask("POST", "/api/acknowledge", asked, **{**good, **wrong})[0] == status, wrong
    assert reasons() == []
    for body, status in [
        (b"{", 400),
        (b"[]", 400),
        ({"a": "CABLE", "b": 1}, 400),
        ({**asked, "reason": 5}, 400),
        ({**asked, "reason": " "}, 400),
        ({**asked, "a": "nobody"}, 400),
        (b" " * 70_000, 413),
        (b"[" * 30_000, 400),
        (b'{"a":' * 5_000 + b"1" + b"}" * 5_000, 400),
        (b'{"a": "CABLE", "b": "SUB-1", "reason": ' + b"9" * 6_000 + b"}", 400),
        *(({**asked, name: text}, 400) for name in asked for text in ("\0", "x\ud800")),
        ({"a": "\ud800", "b": "SUB-1"}, 400),
        (b'{"a": "CABLE", "b": "SUB-1", "reason": "\xed\xa0\x80"}', 400),
        (b"\xff", 400),
    ]:
        found, answer, _ = strait.ask("POST", "/api/acknowledge", body, **good)
        assert (found, list(json.loads(answer))) == (status, ["error"]), str(body)[:80]
    assert reasons() == []
    assert strait.ask("POST", "/api/acknowledge", asked, **good)[0] == 200
    assert reasons() == [HOSTILE]
    assert strait.ask("POST", "/api/acknowledge", {**asked, "reason": None}, **good)[0] == 200
    assert reasons() == []


def test_owners_are_those_of_an_object_and_of_what_it_meets(strait: Client, conn: psycopg.Connection[Any]) -> None:
    """SUB-2 meets DIVING, and not FERRY; objects without an owner, or that are not there, have none."""
    for kind, key in (("track", "SUB-2"), ("area", "DIVING"), ("track", "FERRY")):
        conn.execute(f"UPDATE conflictdb.{kind} SET owner = %s WHERE key = %s".encode(), [f"of {key}", key])
    conn.commit()
    assert strait.read("/api/owners?key=SUB-2") == {"SUB-2": "of SUB-2", "DIVING": "of DIVING"}
    assert strait.read("/api/owners?key=CABLE") == {}
    assert strait.ask("GET", "/api/owners?key=NONE")[0] == 400


def test_who_only_reads_cannot_acknowledge(dsn: str, conn: psycopg.Connection[Any]) -> None:
    """The page says so; and if it sent the request all the same, the database would refuse."""
    with conflictdb.connect(dsn) as db:
        db.load_demo()
        db.scene("strait").detect()
    conn.execute("CREATE ROLE map_reader LOGIN IN ROLE conflictdb_reader")
    conn.commit()
    try:
        with served_page(psycopg.conninfo.make_conninfo(dsn, options="-c role=map_reader"), "strait") as address:
            client = Client(address)
            scene = client.read("/api/scene")
            assert scene["may_acknowledge"] is False
            assert len(client.conflicts()) == 7
            assert client.ask("GET", "/tiles/areas/0/0/0")[0] == 200
            headers = {"X_Conflictdb_Secret": scene["secret"], "Content_Type": "application/json"}
            asked = {"a": "CABLE", "b": "SUB-1", "reason": "none"}
            assert client.ask("POST", "/api/acknowledge", asked, **headers)[0] == 403
    finally:
        conn.execute("DROP ROLE map_reader")
        conn.commit()


def test_who_may_not_see_a_scene_gets_nothing_of_it(dsn: str, conn: psycopg.Connection[Any]) -> None:
    """In protected scenes: no objects, no tiles, not even cached ones, and no notice of a change."""
    alice, bob = (f"{name}_{conn.info.dbname}" for name in ("alice", "bob"))
    shape = "'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))'"

    def does(role: str, *statements: str) -> None:
        conn.execute(f"SET ROLE {role}".encode())
        for statement in statements:
            conn.execute(statement.encode())
        conn.execute("RESET ROLE")
        conn.commit()

    def said(listens: socket.socket) -> bytes:
        """Return the next message except heads and signs of life; nothing if there is none for a while."""
        try:
            while not re.search(b"retry:|event:|^$", got := listens.recv(10_000)):
                pass
        except TimeoutError:
            return b""
        return got

    asked = ["/api/scene", "/api/conflicts", "/api/areas", "/api/tracks", "/api/pair?a=A&b=B"]
    asked += [f"/tiles/{kind}/0/0/0" for kind in ("areas", "tracks", "conflicts")]
    for role in (alice, bob):
        conn.execute(f"CREATE ROLE {role} LOGIN IN ROLE conflictdb_editor".encode())
    try:
        put = [f"SELECT conflictdb.put_area('hers', '{key}', {shape})" for key in "AB"]
        does(alice, "SELECT conflictdb.create_scene('hers')", *put)
        conn.execute("SELECT conflictdb.protect_scenes()")
        conn.commit()
        with served_page(psycopg.conninfo.make_conninfo(dsn, options=f"-c role={bob}"), "hers") as address:
            client = Client(address)
            with socket.create_connection(("127.0.0.1", client.url.port or 0)) as listens:
                listens.sendall(f"GET /api/events HTTP/1.1\r\nHost: {client.host}\r\n\r\n".encode())
                listens.settimeout(WAIT_S)
                assert b"retry" in said(listens)
                listens.settimeout(1.5)
                for path in asked:
                    status, body, _ = client.ask("GET", path)
                    assert (status, b"hers" in body.replace(b"scene 'hers'", b"")) == (410, False), path
                does(alice, "SELECT conflictdb.put_area('hers', 'C', " + shape + ")")
                assert said(listens) == b""
                listens.settimeout(WAIT_S)
                does(alice, f"SELECT conflictdb.share_scene('hers', '{bob}')")
                assert b"event: objects" in said(listens)
                does(alice, *put[:1], "SELECT conflictdb.remove_object('hers', 'C')")
                assert b"event: objects" in said(listens)
                for path in asked:
                    assert client.ask("GET", path)[0] == 200, path
                does(alice, f"SELECT conflictdb.unshare_scene('hers', '{bob}')")
                for path in asked:
                    assert client.ask("GET", path)[0] == 410, path
                # The end of the permission is reported soon, without another change, and then nothing more.
                assert b"event: objects" in said(listens)
                listens.settimeout(2.5)
                does(alice, "SELECT conflictdb.remove_object('hers', 'A')")
                assert said(listens) == b""
    finally:
        conn.rollback()
        conn.execute("SELECT conflictdb.protect_scenes(false)")
        for role in (alice, bob):
            conn.execute(f"DROP OWNED BY {role}".encode())
            conn.execute(f"DROP ROLE {role}".encode())
        conn.commit()


def test_elsewhere_the_page_needs_its_token(dsn: str, conn: psycopg.Connection[Any]) -> None:
    load(conn, Scene("s"), [Area("A", shapely.box(0, 0, 1, 1))], [])
    with served_page(dsn, "s", host="0.0.0.0") as address:  # noqa: S104
        client = Client(address)
        root = client.url.path
        assert re.fullmatch(r"/[\w-]{32}/", root)
        assert client.url.query == ""
        assert client.url.hostname not in ("0.0.0.0", "::")  # noqa: S104 (another machine can open it)
        for path in READS:
            assert client.ask("GET", path)[0] == 403, path
        wrong = [root[:-1], root[:-2] + "/", "/" + root, f"/?token={root[1:-1]}", f"/x{root}", root.upper(), "/é/"]
        for path in wrong:
            assert client.ask("GET", quote(path, safe="/?="))[0] == 403, path
        for path in READS[:-1]:
            status, _, headers = client.ask("GET", root + path[1:], Host="ship.example:80")
            assert status != 403, path
            assert headers["Set-Cookie"] is None, "servers at other ports would receive it"
        assert client.ask("GET", root + "api/scene", Origin="http://evil.example")[0] == 403
        assert client.ask("GET", root + "api/scene", Sec_Fetch_Site="same-site")[0] == 403  # another port


def test_a_client_that_never_ends_its_head_is_disconnected(strait: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a first request and in later ones: else whoever reaches the port could use up its connections."""
    address = ("127.0.0.1", strait.url.port or 0)
    whole = f"GET /places HTTP/1.1\r\nHost: {strait.host}\r\n\r\n".encode()
    with ExitStack() as sockets:
        later, events = (sockets.enter_context(socket.create_connection(address, timeout=WAIT_S)) for _ in range(2))
        # As long as usual to send these.
        later.sendall(whole)
        events.sendall(whole.replace(b"/places", b"/api/events"))
        head = b""
        while b"retry" not in head:
            head += (got := events.recv(10_000))
            assert got
        monkeypatch.setattr(serve, "_HEAD_S", 1.0)
        while not (got := later.recv(1_000_000)).endswith(b"]"):
            assert got
        halves = [sockets.enter_context(socket.create_connection(address, timeout=WAIT_S)) for _ in range(2)]
        with suppress(ConnectionError):  # it was disconnected first
            halves[1].sendall(whole[:20])
            later.sendall(whole[:20])
        for half in (*halves, later):
            with suppress(ConnectionResetError):
                assert half.recv(1000) == b""
        time.sleep(1.5)
        events.setblocking(False)
        with suppress(BlockingIOError):  # a stream has its head, and stays open
            assert events.recv(1) != b""


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.2", "127.1", "localhost", "LOCALHOST", "::1", "0:0:0:0:0:0:0:1"]
)
def test_the_printed_address_of_this_machine_works(dsn: str, conn: psycopg.Connection[Any], host: str) -> None:
    """As it is printed, and as browsers write it; no other name does, though it leads to the same address."""
    load(conn, Scene("s"), [Area("A", shapely.box(0, 0, 1, 1))], [])
    conn.commit()
    try:
        with served_page(dsn, "s", host=host) as address:
            url = urlsplit(address)
            written = {url.netloc, f"{'[::1]' if ':' in host else host}:{url.port}".lower()}
            for name, status in [*((name, 200) for name in sorted(written)), (f"evil.example:{url.port}", 403)]:
                connection = HTTPConnection(url.hostname or "", url.port, timeout=WAIT_S)
                connection.request("GET", "/api/scene", headers={"Host": name})
                assert connection.getresponse().status == status, name
                connection.close()
    except ConflictDBError as error:
        if ":" in host and "cannot listen" in str(error):
            pytest.skip(f"no IPv6 here: {error}")
        raise


def test_names_of_this_machine() -> None:
    """At the port of http browsers leave it out."""
    assert local_hosts(80, "Ship") >= {"ship", "ship:80", "127.0.0.1", "localhost", "[::1]", "[::1]:80"}
    assert "ship" not in local_hosts(81, "ship")


def test_a_notification_that_is_nested_deeply_is_ignored() -> None:
    """Any role may notify: an unreadable message must not end the listening thread."""
    changes = SceneChanges("s")
    assert changes._meaning("[" * 7_900, writers_notify=True) is None
    assert changes._meaning('{"scene": "s"}', writers_notify=True) == CONFLICTS


def test_an_alarm_changes_no_tile() -> None:
    """The page reads states again, and keeps its tiles, whose addresses have the version."""
    changes = SceneChanges("s")
    assert changes._meaning('{"scene": "s", "kind": "begun", "alarm": 7}', writers_notify=True) == LIVE
    assert changes._meaning('{"scene": "other", "kind": "begun", "alarm": 7}', writers_notify=True) is None
    before = changes.version
    changes._send(LIVE)
    assert changes.version == before
    changes._send(CONFLICTS)
    assert changes.version == before + 1


def test_states_of_no_scene_and_of_a_branch(strait: Client, dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        db.scene("strait").branch("trial")
    assert strait.read("/api/live?scene=trial") == {"tracks": [], "alarms": []}
    assert strait.ask("GET", "/api/live?scene=gone")[0] == 410


def test_page_of_a_branch_hears_its_parent(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A detection of the parent changes the conflicts that a branch shows; one of another scene does not."""
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        parent = db.scene("strait")
        other = parent.copy("other")
        branch = parent.branch("branch")
        for one in (parent, other, branch):
            one.detect()
        heard: Queue[str] = Queue()
        listening = threading.Event()
        changes = SceneChanges("branch")
        listener = Listener(lambda: psycopg.connect(dsn), lambda: [changes])
        monkeypatch.setattr(changes, "publish", heard.put)
        sees = changes._sees

        def sees_now(connection: psycopg.Connection[Any]) -> bool:
            seen = sees(connection)
            listening.set()
            return seen

        monkeypatch.setattr(changes, "_sees", sees_now)
        thread = threading.Thread(target=listener.listen)
        thread.start()
        try:
            assert listening.wait(WAIT_S)
            assert heard.get(timeout=WAIT_S) == OBJECTS  # of the first connection
            other.detect(full=True)
            with pytest.raises(Empty):
                heard.get(timeout=2.0)
            parent.detect(full=True)
            assert heard.get(timeout=WAIT_S) == CONFLICTS
        finally:
            listener.end()
            thread.join()


def _stream(client: Client, scene: str) -> tuple[HTTPConnection, HTTPResponse]:
    connection = HTTPConnection("127.0.0.1", client.url.port, timeout=WAIT_S)
    connection.request("GET", f"/api/events?scene={scene}", headers={"Host": client.host})
    return connection, connection.getresponse()


def test_streams_of_many_scenes_share_one_connection_and_end_with_their_pages(strait: Client, dsn: str) -> None:
    """Sixteen scenes at most, of any name; the seventeenth is refused until a page goes."""
    ours = """SELECT count(*) FROM pg_stat_activity
              WHERE datname = current_database() AND application_name = 'conflictdb map'"""
    strait.read("/api/scene")
    with psycopg.connect(dsn, autocommit=True) as conn:
        until(lambda: conn.execute(ours).fetchone() == (2,), what="a connection for requests, and a listener")
        streams = [_stream(strait, f"scene-{n}") for n in range(MOST_VIEWS)]
        again = _stream(strait, "scene-0")
        try:
            for _, answer in [*streams, again]:
                assert (answer.status, answer.readline()) == (200, b"retry: 1000\n")
            for n in range(5):
                status, body, _ = strait.ask("GET", f"/api/events?scene=more-{n}")
                assert (status, json.loads(body)) == (
                    503,
                    {"error": "pages show 16 scenes already, the most of one server: close those of one of them"},
                )
            assert conn.execute(ours).fetchone() == (2,)
        finally:
            for connection, answer in [*streams, again]:
                answer.close()
                connection.close()
        until(lambda: strait.ask("GET", "/api/scene?scene=strait")[0] == 200, what="streams stay after their pages")


def test_a_page_may_follow_the_version_that_it_was_given(strait: Client) -> None:
    version = strait.read("/api/scene")["version"]
    connection, answer = _stream(strait, f"strait&version={version}")
    try:
        assert (answer.status, answer.readline()) == (200, b"retry: 1000\n")
    finally:
        answer.close()
        connection.close()
    assert strait.ask("GET", f"/api/events?scene=strait&version={10**20}")[0] == 400


def test_a_view_that_is_made_anew_has_another_version() -> None:
    """So a page that was away while nobody listened reads everything again."""
    first = SceneChanges("s").version
    time.sleep(0.002)
    assert SceneChanges("s").version > first


def test_a_host_that_is_no_name_is_refused(dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    done = runner(dsn, capsys)("map", "--port", "0", "--host", "a..b")
    assert done.code == 1
    assert "cannot listen on a..b" in done.err


def test_a_lost_database_is_told_as_such(strait: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    """By 503, whatever the driver raises."""

    def connect(_: str) -> None:
        raise psycopg.OperationalError("the connection is lost")

    secret = strait.read("/api/scene")["secret"]
    monkeypatch.setattr(store, "connect", connect)
    asked = {"a": "CABLE", "b": "SUB-1", "reason": "none"}
    headers = {"X_Conflictdb_Secret": secret, "Content_Type": "application/json"}
    status, body, _ = strait.ask("POST", "/api/acknowledge", asked, **headers)
    assert (status, json.loads(body)) == (503, {"error": "the connection is lost"})


def test_command_prints_where_and_ends_cleanly(dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a scene it is the demo's, which is made."""
    with (
        subprocess.Popen(
            [sys.executable, "-m", "conflictdb", "--dsn", dsn, "map", "--port", "0"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process,
        killed_at_last(process),
    ):
        assert process.stdout is not None
        with killed_after(process, WAIT_S):
            address = process.stdout.readline().strip()
        client = Client(address)
        assert len(client.conflicts()) == 7
        with socket.create_connection(("127.0.0.1", client.url.port or 0)) as listens:
            listens.sendall(f"GET /api/events HTTP/1.1\r\nHost: {client.host}\r\n\r\n".encode())
            assert b"200 OK" in listens.recv(1000)
            process.send_signal(signal.SIGINT)
            assert process.wait(WAIT_S) == 0
        assert process.communicate(timeout=WAIT_S) == ("", "")
    run = runner(dsn, capsys)
    taken = run("map", "--scene", "nothing", "--port", "0")
    assert (taken.code, taken.out) == (4, "")
    assert "nothing" in taken.err
    with socket.create_server(("127.0.0.1", 0)) as other:
        used = run("map", "--port", str(other.getsockname()[1]))
    assert used.code == 1
    assert "cannot listen on 127.0.0.1: port" in used.err
    assert "--port 0" in used.err


def test_demo_ends_with_the_map_for_a_person_at_a_terminal(dsn: str) -> None:
    """In a program of continuous integration, which may have a terminal too, it names the command only."""
    # Not ignored, as it is in the background of a shell.
    command = ["env", "--default-signal=INT", sys.executable, "-m", "conflictdb", "--dsn", dsn, "demo"]
    plain = {name: value for name, value in os.environ.items() if name not in ("CI", "DISPLAY", "WAYLAND_DISPLAY")}
    for env in (plain, plain | {"CI": "true"}):
        ours, theirs = pty.openpty()
        with (
            subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=env) as process,
            killed_at_last(process),
            killed_after(process, WAIT_S),
        ):
            os.close(theirs)
            said = ""
            with suppress(OSError):  # the end of a terminal
                while "http://127.0.0.1:" not in said:
                    said += os.read(ours, 10_000).decode()
            assert "map   # the scene in your browser" in said
            assert ("http://" in said) == ("CI" not in env)
            if "http://" in said:
                process.send_signal(signal.SIGINT)
            assert process.wait(WAIT_S) == 0
        os.close(ours)


def _no_connection() -> "psycopg.Connection[Any]":
    raise psycopg.OperationalError("no database")


def test_the_next_free_port_is_taken() -> None:
    """The usual port is often in use: by the page of another scene."""
    with (
        PageServer("s", _no_connection, "127.0.0.1", None) as first,
        PageServer("s", _no_connection, "127.0.0.1", None) as second,
    ):
        ports = [urlsplit(server.address).port for server in (first, second)]
    assert ports[0] != ports[1]
    assert all(port in USUAL_PORTS for port in ports)


def test_a_person_at_a_desktop_sees_the_page_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    opened = Queue[str]()
    monkeypatch.setattr(webbrowser, "open", opened.put)
    monkeypatch.setenv("DISPLAY", ":0")
    pictures._open_browser("http://piped/")  # output that is not a terminal
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    pictures._open_browser("http://shown/")
    assert opened.get(timeout=WAIT_S) == "http://shown/"


def test_what_is_shipped_is_what_it_says() -> None:
    """Every file of others has its version, its licence and its hash."""
    listed = json.loads((VENDOR / "vendor.json").read_text())
    files_of = {name: package["sha256"] for name, package in listed.items()}
    for hashes in files_of.values():
        for name, expected in hashes.items():
            content = (VENDOR / name).read_bytes()
            plain = gzip.decompress(content) if name.endswith(".gz") else content
            assert hashlib.sha256(plain).hexdigest() == expected, name
    notices = {package["notice"] for package in listed.values()}
    known = {"vendor.json", *notices, *(name for hashes in files_of.values() for name in hashes)}
    assert {path.name for path in VENDOR.iterdir()} == known
    assert all((VENDOR / name).stat().st_size > 500 for name in notices)


def test_land_is_cut() -> None:
    everything, coasts = shapely.from_geojson(land.geojson(land.COARSE, land.WORLD)).geoms
    assert (everything.geom_type, coasts.geom_type) == ("MultiPolygon", "MultiLineString")
    # Jutland, not the sea west of it.
    assert shapely.contains_xy(everything, [9.0, 5.0], [56.2, 56.0]).tolist() == [True, False]
    box = (5.0, 54.0, 12.0, 60.0)
    near, near_coasts = shapely.from_geojson(land.geojson(land.FINE, box)).geoms
    assert shapely.box(*box).contains(shapely.box(*near.bounds))
    rest, rest_coasts = shapely.from_geojson(land.geojson(land.COARSE, land.WORLD, box)).geoms
    assert rest.intersection(shapely.box(*box)).area < 1e-2
    # A cut through land is no coast.
    for lines in (near_coasts, rest_coasts):
        assert shapely.length(shapely.intersection(lines, shapely.box(*box).boundary)) == 0.0
    assert shapely.contains_xy(rest, 100.0, 60.0)


@pytest.mark.parametrize("detail", [land.COARSE, land.FINE])
def test_land_at_the_date_line_and_the_pole_is_where_it_is(detail: str) -> None:
    """Chukotka, Taveuni and Antarctica are on both sides of the date line, or all around."""
    known = land.land(detail)
    shapely.prepare(known.polygons)

    def is_land(lon: float, lat: float) -> bool:
        return bool(shapely.intersects_xy(known.polygons, lon, lat).any())

    # Chukotka, west and east; Wrangel Island, west and east; Antarctica, and all of the pole.
    dry = [(179.0, 68.0), (-178.0, 67.5), (179.5, 71.2), (-179.5, 71.2), (0.0, -80.0), (179.9, -86.0), (-100.0, -89.9)]
    assert [place for place in dry if not is_land(*place)] == []
    # The same latitudes in other seas: Atlantic, Norwegian Sea, Greenland Sea, Barents Sea, Pacific, Indian Ocean.
    wet = [(-30.0, 50.0), (3.0, 67.5), (0.0, 71.2), (40.0, 71.2), (-120.0, -16.5), (80.0, -16.8), (-150.0, -60.0)]
    assert [place for place in wet if is_land(*place)] == []
    longest = max(np.abs(np.diff(shapely.get_coordinates(line)[:, 0])).max() for line in known.coasts)
    assert longest < 6.0


def test_names_of_areas_have_a_place_within_them(dsn: str, conn: psycopg.Connection[Any]) -> None:
    """In the middle of their boxes only if that is inside; as they are drawn, where edges bend."""
    corner = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)]
    shapes: dict[str, Any] = {
        "SQUARE": shapely.box(10, 10, 12, 11),
        "L": shapely.Polygon(corner),
        "C": shapely.difference(shapely.box(20, 0, 23, 3), shapely.box(21, 1, 24, 2)),
        "HOLED": shapely.difference(shapely.box(179, 0, 182, 3), shapely.box(179.5, 0.5, 181.5, 2.5)),
        "APART": shapely.MultiPolygon([shapely.box(30, 0, 31, 1), shapely.box(34, 0, 35, 1)]),
    }
    bent = {"WIDE": shapely.box(-40, 50, 40, 52)}
    load(conn, Scene("plain"), [Area(key, shape) for key, shape in shapes.items()], [])
    great = Scene("bent", motion=Motion.GREAT_CIRCLE, earth=EarthModel.SPHERE, centre=(0.0, 50.0))
    load(conn, great, [Area(key, shape) for key, shape in bent.items()], [])
    conn.commit()
    plane = "conflictdb_internal._plane(motion, earth, centre_lon, centre_lat)"
    drawn = f"SELECT ST_AsText(conflictdb_internal._drawn(footprint, {plane}))"
    drawn += " FROM conflictdb.area JOIN conflictdb.scene USING (scene_id) WHERE key = %s"
    for scene, known in [("plain", shapes), ("bent", bent)]:
        with served_page(dsn, scene) as address:
            found = Client(address).read("/api/areas")
        rows = [dict(zip(found["columns"], row, strict=True)) for row in found["rows"]]
        places = {
            row["key"]: ((row["west"] + row["east"]) / 2, (row["south"] + row["north"]) / 2)
            if row["lon"] is None
            else (row["lon"], row["lat"])
            for row in rows
        }
        assert places.keys() == known.keys()
        for key in known:
            (text,) = conn.execute(drawn.encode(), [key]).fetchone() or ("",)
            assert shapely.contains_xy(shapely.from_wkt(text), *places[key]), (key, places[key])


def test_a_file_is_for_scenes_that_a_browser_opens(
    dsn: str,
    conn: psycopg.Connection[Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A scene that is too large is refused before it is read, and no file is left."""
    load(conn, Scene("s"), [Area(key, shapely.MultiPolygon([shapely.box(1, 1, 2, 2)])) for key in "ABC"], [])
    conn.commit()
    monkeypatch.setattr("conflictdb.map.html.MOST_OBJECTS", 2)
    file = tmp_path / "large.html"
    done = runner(dsn, capsys)("map", "--scene", "s", "--html", file)
    assert done.code == 4
    assert "must be at most 2 for a file; got 3" in done.err
    assert not file.exists()
