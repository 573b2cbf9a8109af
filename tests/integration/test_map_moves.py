"""Plans that the page of `conflictdb map` moves: who may store them, and what is refused."""

import json
from typing import Any

import psycopg
import pytest
import shapely
from map_page import Client, served_page

import conflictdb
from conflictdb.core.moving_plans import dragged, moved
from conflictdb.earth.geodesy import earth_of, rhumb_inverse
from conflictdb.model.plans import Area, EarthModel, Scene

HOSTILE = "<img src=x onerror=alert(1)>\u202e"
SHAPE = "SELECT ST_AsText(path), floor_m, ceiling_m FROM conflictdb.track ORDER BY track_id"


def plan_of(client: Client, key: str) -> str:
    """Return the digest of a track as the page has it."""
    packed = client.ask("GET", f"/api/pieces?key={key}&within_s=0")[1]
    return str(json.loads(packed[4 : 4 + int.from_bytes(packed[:4], "little")])["digests"][key])


def post(client: Client, asked: object, path: str = "/api/move", **more: str | None) -> tuple[int, Any]:
    secret = client.read("/api/scene")["secret"]
    good = {"X_Conflictdb_Secret": secret, "Content_Type": "application/json", "Origin": f"http://{client.host}"}
    status, body, _ = client.ask("POST", path, asked, **{**good, **more})
    return status, json.loads(body)


def test_only_the_page_moves_what_it_shows(strait: Client, conn: psycopg.Connection[Any]) -> None:
    """Requests of other sites, odd numbers and plans that changed meanwhile store nothing."""
    conn.autocommit = True
    before = conn.execute(SHAPE).fetchall()
    asked = {"key": "FERRY", "plan": plan_of(strait, "FERRY"), "later_us": 1_000_000, "up_m": 0, "branch": None}
    for wrong in ({"X_Conflictdb_Secret": None}, {"Origin": "http://evil.example"}, {"Content_Type": "text/plain"}):
        assert post(strait, asked, **wrong)[0] == 403
    for name, values in {
        "later_us": (1e12, "1", None, True, [1]),
        "up_m": (1e6, -1e6, "x"),
        "branch": (5, "", "x\0", "strait"),
        "key": (None, "nobody", "CABLE"),
        "plan": (None, "0" * 64),
        "waypoint": (5, [0, 1], [99, 1, 1], [0, 1, 91], [0, None, 1]),
    }.items():
        for value in values:
            assert post(strait, {**asked, name: value})[0] == 400, (name, value)
    assert post(strait, b'{"later_us": NaN}')[0] == 400
    assert conn.execute(SHAPE).fetchall() == before
    assert [one["scene"] for one in strait.read("/api/scenes")["scenes"]] == ["strait"]
    assert strait.ask("POST", "/api/probe", asked, Content_Type="application/json")[0] == 403
    assert post(strait, asked)[0] == 200
    assert conn.execute(SHAPE).fetchall() != before
    status, said = post(strait, asked)
    assert (status, "changed meanwhile" in said["error"]) == (400, True)


def test_a_probe_with_a_margin_names_what_is_nearer(strait: Client, dsn: str) -> None:
    """In a scene and a branch, as `delays` has the margin: by time and by distance, of tracks and areas."""
    with conflictdb.connect(dsn) as db:
        scene = db.scene("strait")
        scene.branch("b").detect()
        [by_m] = scene.delays("FERRY", within_s=10_800.0, margin_m=1852.0)
        [by_s] = scene.delays("FERRY", within_s=10_800.0, margin_s=300.0)
    ferry = {"key": "FERRY", "plan": plan_of(strait, "FERRY")}
    assert by_m.least_earlier_s is not None
    assert by_s.least_earlier_s is not None
    for scene_name in ("strait", "b"):
        path = f"/api/probe?scene={scene_name}"
        clear = ({"margin_m": 1852.0}, by_m.least_earlier_s), ({"margin_s": 300.0}, by_s.least_earlier_s)
        for margin, clear_s in clear:
            for more_s, nearer in ((-1.0, ["FIRING"]), (0.0, [])):
                move = {**ferry, **margin, "later_us": -round(1e6 * (clear_s + more_s))}
                assert post(strait, move, path) == (200, {"conflicts": [], "nearer": nearer})
        status, found = post(strait, {**ferry, "margin_m": 1852.0}, path)
        assert (status, len(found["conflicts"]), found["nearer"]) == (200, 3, [])
        plan = strait.read("/api/plan?key=DIVING")["plan"]
        area = {"key": "DIVING", "plan": plan, "shift_deg": [9.0, 57.0, 9.0, 60.0]}
        assert post(strait, area, path) == (200, {"conflicts": [], "nearer": []})
        assert "FERRY" in post(strait, {**area, "margin_m": 500_000.0}, path)[1]["nearer"]
    for wrong in ({"margin_m": -1}, {"margin_m": 2e6}, {"margin_s": "1"}, {"margin_s": None}):
        assert post(strait, {**ferry, **wrong}, "/api/probe")[0] == 400, wrong
    for wrong_m in ("-1", "NaN", "1.5", "1000001"):
        assert strait.ask("GET", f"/api/pieces?key=FERRY&margin_m={wrong_m}")[0] == 400


def test_a_moved_waypoint_and_a_branch_with_any_name(strait: Client, dsn: str) -> None:
    """The scene stays as it is."""
    asked = {"key": "FERRY", "plan": plan_of(strait, "FERRY"), "waypoint": [1, 9.4, 57.7], "branch": HOSTILE}
    assert post(strait, asked)[0] == 200
    with conflictdb.connect(dsn) as db:
        (_, _, (moved,)), (_, _, (same,)) = (db.scene(name)._read(["FERRY"]) for name in (HOSTILE, "strait"))
        assert db.scene(HOSTILE).state().is_current
    assert moved.positions_deg[1].tolist() == [9.4, 57.7]
    assert same.positions_deg[1].tolist() == [9.4, 57.79]
    assert moved.times_us.tolist() == same.times_us.tolist()


def test_a_moved_area_keeps_its_size_and_ends_at_another_time(strait: Client, dsn: str) -> None:
    """In a branch, as `probe --move` moves it; what cannot be a move of an area is refused."""
    asked = {"key": "DIVING", "plan": strait.read("/api/plan?key=DIVING")["plan"], "branch": "moved"}
    for wrong in (
        {"later_us": 1_000_000},
        {"waypoint": [0, 1, 1]},
        {"shift_deg": [9.0, 57.0, 9.0]},
        {"shift_deg": [9.0, 57.0, None, 57.0]},
        {"shift_deg": [9.0, 0.0, 9.0, 89.9]},
        {"ends_us": -8 * 3_600_000_000},
        {"ends_us": 1e12},
        {"starts_us": True},
    ):
        assert post(strait, {**asked, **wrong})[0] == 400, wrong
    assert post(strait, {**asked, "key": "FERRY", "plan": plan_of(strait, "FERRY"), "ends_us": 1_000_000})[0] == 400
    status, _ = post(strait, {**asked, "shift_deg": [9.0, 57.0, 9.1, 57.2], "ends_us": -3_600_000_000})
    assert status == 200
    with conflictdb.connect(dsn) as db:
        (_, (now,), _), (_, (before,), _) = (db.scene(name)._read(["DIVING"]) for name in ("moved", "strait"))
    earth = earth_of(EarthModel.WGS84)
    step_m, bearing_deg = rhumb_inverse(earth, 9.0, 57.0, 9.1, 57.2)
    as_probed = moved(before, float(step_m), float(bearing_deg), Scene("strait"))
    assert isinstance(as_probed, Area)
    # The dragged place moves by exactly this, as the middle does in `probe --move`; in between it differs little.
    exact = dragged(before, (9.0, 57.0), (9.1, 57.2), Scene("strait"))
    assert isinstance(exact, Area)
    assert shapely.get_coordinates(now.footprint) == pytest.approx(shapely.get_coordinates(exact.footprint), abs=1e-12)
    assert shapely.get_coordinates(now.footprint) == pytest.approx(
        shapely.get_coordinates(as_probed.footprint), abs=1e-2
    )
    assert before.end_us is not None
    assert (now.start_us, now.end_us) == (before.start_us, before.end_us - 3_600_000_000)


def test_a_branch_ends_by_who_may(strait: Client, dsn: str) -> None:
    """Merged or dropped; a scene that is no branch is refused, and other words."""
    with conflictdb.connect(dsn) as db:
        for name in ("one", "two"):
            db.scene("strait").branch(name).delete_objects("TOW")

    def end(branch: str, does: object) -> tuple[int, Any]:
        secret = strait.read("/api/scene")["secret"]
        good = {"X_Conflictdb_Secret": secret, "Content_Type": "application/json", "Origin": f"http://{strait.host}"}
        status, body, _ = strait.ask("POST", f"/api/branch?scene={branch}", {"does": does}, **good)
        return status, json.loads(body)

    for branch, does in (("strait", "drop"), ("one", "rename"), ("one", None)):
        assert end(branch, does)[0] == 400
    assert end("nothing", "drop")[0] in (400, 410)
    assert strait.ask("POST", "/api/branch?scene=one", {"does": "drop"}, Content_Type="application/json")[0] == 403
    assert end("one", "drop") == (200, {"parent": "strait"})
    assert end("two", "merge") == (200, {"parent": "strait"})
    with conflictdb.connect(dsn) as db:
        assert [one.scene.name for one in db.scenes()] == ["strait"]
        assert db.scene("strait").state().is_current
        assert "TOW" not in {one.key for one in db.scene("strait").objects()}


def test_who_only_reads_moves_nothing(dsn: str, conn: psycopg.Connection[Any]) -> None:
    with conflictdb.connect(dsn) as db:
        db.load_demo()
        db.scene("strait").detect()
    role = f"reader_of_moves_{conn.info.backend_pid}"
    conn.autocommit = True
    conn.execute(f"CREATE ROLE {role} LOGIN IN ROLE conflictdb_reader".encode())
    before = conn.execute(SHAPE).fetchall()
    try:
        with served_page(psycopg.conninfo.make_conninfo(dsn, options=f"-c role={role}"), "strait") as address:
            client = Client(address)
            assert client.read("/api/scene")["may_edit"] is False
            for branch in (None, "mine"):
                asked = {"key": "FERRY", "plan": plan_of(client, "FERRY"), "later_us": 1_000_000, "branch": branch}
                assert post(client, asked)[0] == 403
        assert conn.execute(SHAPE).fetchall() == before
    finally:
        conn.execute(f"DROP ROLE {role}".encode())
