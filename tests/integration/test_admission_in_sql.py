"""Plans are admitted in SQL as in Python: at once where stages 1 and 2 decide, by a worker where they do not."""

import json
from dataclasses import replace
from datetime import datetime
from itertools import cycle
from typing import Any

import psycopg
import pytest
from city import (
    CITY,
    HOUR_US,
    T0_US,
    as_feature,
    as_plan,
    asked,
    beyond_limits,
    flight,
    keys,
    pairs,
    square,
    within_limits,
    worker_connected,
)
from full_plans import lost
from layouts import HARBOUR, HIGH_LATITUDE, LOW_LATITUDE, SEAM, Workload
from mixed_scenes import plain_scene

from conflictdb import Area, Database, InvalidInput, StoredScene, Track, store
from conflictdb.jobs import probes


def test_sql_alone_decides_about_areas(db: Database, city: StoredScene) -> None:
    conn = db.connection
    assert asked(conn, square("a", 0.0)) == (True, [], None)
    admitted, conflicts, request = asked(conn, square("b", 0.005, (0.5, 2.0)))
    assert (admitted, request, pairs(conflicts)) == (False, None, [("a", "b")])
    assert asked(conn, square("b", 0.005, (1.0, 2.0)))[0]
    assert asked(conn, square("c", 0.0, floor_m=10.0), square("d", 0.0, floor_m=20.0))[0] is False
    conn.commit()
    assert keys(city) == ["a", "b"]


@pytest.mark.usefixtures("city")
@pytest.mark.parametrize("settings", [{}, {"intervals": "closed"}, {"motion": "great_circle", "earth": "sphere"}])
@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, SEAM, HARBOUR], ids=lambda w: w.name)
def test_sql_says_what_python_says(db: Database, workload: Workload, settings: dict[str, Any]) -> None:
    """Of areas and tracks, among objects that are detected, changed or new: the same pairs, verdicts and periods."""
    scene, areas, tracks = plain_scene(workload, 5, 24, 8)
    if settings.get("motion") and workload is SEAM:
        settings = {**settings, "centre": (180.0, areas[0].footprint.centroid.y)}
    scene = replace(scene, name="city", **settings)
    plans = [p for one in zip(areas[::3], areas[1::3], areas[2::3], tracks, strict=True) for p in one]
    stored, candidates = plans[::2], plans[1::2]
    city = db.scene("city")
    city.put([replace(one, floor_m=5000.0) for one in stored[:4]] + stored[4:9], scene)
    city.detect()
    city.put([*stored[:4], *stored[9:]])
    decided = refused = 0
    conn = db.connection
    # No stored plan has an owner: that of a candidate decides nothing, and half of them have one.
    owners, forms = cycle([None, "somebody", "somebody", None]), cycle([as_feature, as_feature, as_plan])
    for one, owner, form in zip(candidates, owners, forms, strict=False):
        with conn.transaction(force_rollback=True):
            expected = city.admit(one, owner)
            there = sorted(keys(city))
        with conn.transaction(force_rollback=True):
            admitted, conflicts, request = asked(conn, one, p_owner=owner, form=form)
            assert sorted(keys(city)) == (there if request is None else sorted(p.key for p in stored))
        if request is not None:
            continue
        decided += 1
        refused += not admitted
        assert admitted == bool(expected)
        assert pairs(conflicts) == sorted((c.a_key, c.b_key) for c in expected.conflicts)
        assert {c["verdict"] for c in conflicts} == {c.verdict for c in expected.conflicts}
        assert periods(conflicts) == {(c.a_key, c.b_key): c.periods for c in expected.conflicts}
    assert decided >= 6
    assert refused >= 2


def periods(conflicts: list[dict[str, Any]]) -> dict[tuple[str, str], tuple[tuple[datetime | None, ...], ...]]:
    return {
        (one["a_key"], one["b_key"]): tuple(
            tuple(None if end is None else datetime.fromisoformat(end) for end in period) for period in one["periods"]
        )
        for one in conflicts
    }


def answered(dsn: str, request: int, conn: psycopg.Connection[Any]) -> tuple[Any, ...]:
    """Let a worker answer a request, and return its answer."""
    conn.commit()
    with psycopg.connect(dsn) as worker:
        while probes.answer(worker):
            pass
    row = conn.execute("SELECT * FROM conflictdb.wait_for_admission(%s, '1 s')", [request]).fetchone()
    conn.commit()
    assert row is not None
    return row


def test_a_worker_decides_the_others(dsn: str, db: Database, city: StoredScene) -> None:
    """Tracks near others, with the same answer as in Python, and what is put is the same."""
    conn = db.connection
    city.put([square("a", 0.0), square("b", 0.3)])
    assert asked(conn, flight("t", 0.205)) == (True, [], None)
    with conn.transaction():
        admitted, conflicts, request = asked(conn, flight("u", 0.005), p_owner="me")
    assert (admitted, conflicts) == (None, [])
    admitted, conflicts = answered(dsn, request, conn)
    assert (admitted, pairs(conflicts)) == (False, [("a", "u")])
    assert conflicts[0]["is_new"]
    [expected] = city.admit(flight("u", 0.005), "me").conflicts
    assert periods(conflicts) == {("a", "u"): expected.periods}
    # Boxes meet, havens do not.
    _, _, request = asked(conn, flight("v", 0.2062))
    assert answered(dsn, request, conn) == (True, [])
    assert keys(city) == ["a", "b", "t", "v"]
    [stored] = store.read_scene(conn, "city", ["v"])[2]
    assert lost(flight("v", 0.2062), stored) == []


def test_without_a_worker_no_request_is_left(dsn: str, db: Database) -> None:
    """What needs none is decided; for the rest one sentence says that none is connected."""
    conn = db.connection
    db.scene("city").put(square("a", 0.0))
    assert asked(conn, flight("t", 0.205))[0]
    assert asked(conn, square("b", 0.005))[0] is False
    conn.commit()
    for near in (flight("u", 0.005), flight("v", 0.3, tolerances={"xtd_port_m": 9.0})):
        with pytest.raises(psycopg.Error, match="plans: worker: must be connected") as caught, conn.transaction():
            asked(conn, near)
        assert caught.value.sqlstate == "ZC015"
    assert conn.execute("SELECT count(*) FROM conflictdb.probe_request").fetchone() == (0,)
    with worker_connected(dsn):
        assert asked(conn, flight("u", 0.005))[2] is not None


def test_known_conflicts_may_be_allowed(dsn: str, db: Database, city: StoredScene) -> None:
    conn = db.connection
    city.put([square("a", 0.0), square("b", 0.005), square("c", 0.03)])
    later = square("a", 0.001, (0.2, 0.9))
    mine = {"p_replace": ["a"]}
    assert asked(conn, later, **mine)[0] is False
    _, _, request = asked(conn, later, p_allow_known=True, **mine)
    admitted, conflicts = answered(dsn, request, conn)
    assert (admitted, pairs(conflicts), conflicts[0]["is_new"]) == (True, [("a", "b")], False)
    _, _, request = asked(conn, square("a", 0.022, (0.2, 0.9)), p_allow_known=True, **mine)
    admitted, conflicts = answered(dsn, request, conn)
    assert (admitted, [(one["b_key"], one["is_new"]) for one in conflicts]) == (False, [("c", True)])


def test_an_owner_replaces_its_plans(db: Database, city: StoredScene) -> None:
    conn = db.connection
    assert asked(conn, square("1", 0.0), square("2", 0.005), p_owner="f")[0]
    assert asked(conn, square("3", 0.0), flight("4", 0.705), p_owner="f")[0]
    assert keys(city) == ["3", "4"]
    assert asked(conn, square("1", 0.0), p_owner="g")[0] is False
    for owner in ("g", None):
        with pytest.raises(psycopg.Error, match="plan '3': key: belongs to owner 'f'"), conn.transaction():
            asked(conn, square("3", 0.6), p_owner=owner)
    assert asked(conn, replace(flight("3", 0.3), owner="f"), p_replace=["3"])[0]
    assert [(one.key, one.kind) for one in city.objects()] == [("3", "track"), ("4", "track")]


def test_a_stored_key_must_be_named(dsn: str, db: Database, city: StoredScene) -> None:
    """A flight with the key of a fence does not remove the fence; one of another owner is refused, named or not."""
    conn = db.connection
    city.put([square("fence", 0.0), square("theirs", 0.3, owner="them")])
    conn.commit()
    for given, rule in (
        ({}, "plan 'fence': key: belongs to an object of the scene"),
        ({"p_replace": None}, "belongs to an object of the scene"),
        ({"p_owner": "me", "p_replace": ["other"]}, "belongs to an object of the scene"),
    ):
        with pytest.raises(psycopg.Error, match=rule) as caught, conn.transaction():
            asked(conn, flight("fence", 0.605), **given)
        assert caught.value.sqlstate == "ZC007"
    for given in ({}, {"p_owner": "me"}, {"p_replace": ["theirs"]}, {"p_owner": "me", "p_replace": ["theirs"]}):
        with pytest.raises(psycopg.Error, match="belongs to owner 'them'") as caught, conn.transaction():
            asked(conn, flight("theirs", 0.605), **given)
        assert caught.value.sqlstate == "ZC007"
    with pytest.raises(psycopg.Error, match="belongs to an object of the scene"), conn.transaction():
        asked(conn, replace(square("theirs", 0.605), owner="them"))
    assert [(one.key, one.kind) for one in city.objects()] == [("fence", "area"), ("theirs", "area")]
    assert asked(conn, flight("fence", 0.605), p_owner="me", p_replace=["fence", "unknown"])[0]
    conn.commit()
    # A worker keeps the named keys, and refuses objects that came meanwhile.
    _, _, request = asked(conn, flight("near", 0.2994))
    conn.commit()
    city.put(square("near", 0.6))
    with pytest.raises(psycopg.Error, match="belongs to an object of the scene") as caught:
        answered(dsn, request, conn)
    assert caught.value.sqlstate == "ZC016"
    conn.rollback()
    _, _, request = asked(conn, flight("near", 0.2994), p_replace=["near"])
    assert answered(dsn, request, conn)[0] is not None


def test_members_that_only_workers_read_are_admitted_by_one(dsn: str, db: Database, city: StoredScene) -> None:
    """What a scene file can say is put as from the file, and decided as in Python; nothing is put before."""
    conn = db.connection
    city.put([square("a", 0.0), square("b", 0.3)])
    plans: list[Area | Track] = [
        replace(
            square("s", 0.7),
            start_us=None,
            end_us=None,
            spans_us=[(T0_US, T0_US + HOUR_US), (T0_US + 2 * HOUR_US, T0_US + 3 * HOUR_US)],
        ),
        replace(flight("t", 0.205), tolerances={"xtd_port_m": 20.0}, name="with tolerances"),
        replace(flight("u", 0.25), departures_us=[T0_US, T0_US + HOUR_US], object_class="drone"),
        replace(flight("v", 0.4), floors_m=[20.0], ceilings_m=[30.0]),
        replace(flight("w", 0.6, properties={"Speed": 3}), grow_mps=0.1),
        replace(flight("near", 0.0101), tolerances={"xtd_port_m": 20.0}),
    ]
    circle = {
        "type": "Feature", "version": 1, "id": "c", "geometry": {"type": "Point", "coordinates": [0.5, 0.0]},
        "properties": {"radius_m": 300},
    }  # fmt: skip
    for plan in plans:
        with conn.transaction(force_rollback=True):
            expected = city.admit(plan, "me")
        there = keys(city)
        admitted, conflicts, request = asked(conn, plan, p_owner="me")
        conn.commit()
        if request is not None:
            assert (admitted, conflicts, keys(city)) == (None, [], there)
            admitted, conflicts = answered(dsn, request, conn)
        assert (admitted, pairs(conflicts)) == (
            bool(expected), sorted((one.a_key, one.b_key) for one in expected.conflicts),
        )  # fmt: skip
        if admitted:
            [stored] = [one for kind in store.read_scene(conn, "city", [plan.key])[1:] for one in kind]
            assert lost(replace(plan, owner="me", **limit(plan)), stored) == []
            assert city.delete_objects(plan.key) is None
    [admitted, _, request] = asked(conn, circle, form=lambda one: one)  # type: ignore[arg-type]
    assert answered(dsn, request, conn) == (True, [])
    assert keys(city) == ["a", "b", "c"]


def test_an_area_meets_nobody_between_its_spans(dsn: str, db: Database, city: StoredScene) -> None:
    conn = db.connection
    city.put(square("a", 0.0, (2.0, 3.0)))
    city.detect()
    for key, hours, free in (("b", ((0.0, 1.0), (5.0, 6.0)), True), ("c", ((6.5, 7.0), (2.5, 4.0)), False)):
        spans: Any = [tuple(T0_US + round(h * HOUR_US) for h in one) for one in hours]
        plan = replace(square(key, 0.0), start_us=None, end_us=None, spans_us=spans)
        with conn.transaction(force_rollback=True):
            assert bool(city.admit(plan)) is free
        admitted, conflicts, request = asked(conn, plan)
        conn.commit()
        if request is not None:
            admitted, conflicts = answered(dsn, request, conn)
        assert (admitted, pairs(conflicts)) == (free, [] if free else [("a", "c")])


@pytest.mark.parametrize(
    ("times", "rule"),
    [
        ({"start": "", "end": "2030-01-01T00:00Z"}, "start: must be a date and time"),
        ({"start": "-infinity"}, "start: must be a date and time"),
        ({"end": '"2030-01-01T00:00Z"'}, "end: must be a date and time"),
        ({"spans": [["2030-01-01T00:00Z,2030-01-02T00:00Z),[2030-01-03T00:00Z", "2030-01-04T00:00Z"]]}, "spans"),
        ({"spans": [["2030-01-01T00:00Z", "2030-01-01T00:00Z"], [None, "2029-01-01T00:00Z"]]}, "end after it starts"),
    ],
)
def test_times_of_features_are_instants(dsn: str, db: Database, city: StoredScene, times: Any, rule: str) -> None:
    """None is read as no limit, or lost, that a scene file refuses."""
    feature = as_feature(square("a", 0.0))
    feature["properties"] = times

    def admit() -> Any:
        _, _, request = asked(db.connection, feature, form=lambda one: one)  # type: ignore[arg-type]
        return answered(dsn, request, db.connection)

    with pytest.raises(psycopg.Error, match=rule) as caught:
        admit()
    assert caught.value.sqlstate == "ZC016"
    db.connection.rollback()
    assert keys(city) == []


def limit(plan: Area | Track) -> dict[str, Any]:
    return {} if isinstance(plan, Area) else {"max_speed_kn": float("inf")}


@pytest.mark.parametrize("form", [as_feature, as_plan])
def test_older_forms_of_plans_are_read_with_a_notice(db: Database, city: StoredScene, form: Any) -> None:
    notices: list[str] = []
    db.connection.add_notice_handler(lambda one: notices.append(one.message_primary or ""))
    assert asked(db.connection, square("a", 0.0), form=form)[0]
    assert [one for one in notices if "until the next release" in one] == notices
    assert len(notices) == (form is as_plan)


@pytest.mark.parametrize(
    ("plans", "rule"),
    [
        ('{"type": "FeatureCollection", "features": []}', "array of 1 to 1000 plans"),
        ('[{"type": "Feature", "version": 2, "id": "a"}]', "plan 'a': version: must be 1; got 2"),
        ('[{"type": "Feature", "version": 1}]', "plans: id: must be text"),
        ('[{"type": "Feature", "id": "a"}, {"key": "b"}]', "plans: type: must be a GeoJSON Feature"),
        ('{"type": "FeatureCollection", "scene": {}, "features": [1]}', "plans: scene: is not a member of plans"),
        ("[]", "array of 1 to 1000 plans"),
        ("{}", "array of 1 to 1000 plans"),
        ("null", "array of 1 to 1000 plans"),
        ("[1]", "key: must be text"),
        ('[{"key": 1}]', "key: must be text"),
        ('[{"key": "a"}]', "plan 'a': footprint: must be given, or path"),
        ('[{"key": "a", "footprint": "POINT(0 0)"}]', "must be a Polygon"),
        ('[{"key": "a", "footprint": "POLYGON((0 0, 1 0, 1 1"}]', "plan 'a': plan: cannot be read: parse error"),
        ('[{"key": "a", "footprint": "POLYGON((0 0, 1 0, 1 1, 0 0))", "cieling_m": 3}]', "cieling_m: is not a member"),
        ('[{"key": "a", "footprint": "POLYGON((0 0, 1 0, 1 1, 0 0))", "schedule": {}}]', "schedule: is not a member"),
        (
            '[{"key": "a", "footprint": "POLYGON((0 0, 1 0, 1 1, 0 0))", "times": []}]',
            "times: is not a member of",
        ),
        ('[{"key": "a", "path": "LINESTRING(0 0, 1 0)", "outline": "POLYGON((0 0, 1 0, 1 1, 0 0))"}]', "LineStringM"),
        (
            '[{"key": "a", "path": "LINESTRING(0 0, 1 0)", "times": ["2030-01-01T00:00Z"], "outline": "POINT(0 0)"}]',
            "plan 'a': times: must be one per waypoint of a LineString: 2 waypoints, 1 times",
        ),
        ('[{"key": "a", "footprint": "POLYGON((0 0, 1 0, 1 1, 0 0))", "floor_m": "NaN"}]', "floor_m: must be a finite"),
        ('[{"key": "a", "footprint": "POLYGON((0 0, 1 0, 1 1, 0 0))", "active_span": "[x,)"}]', "cannot be read"),
    ],
)
def test_bad_plans_change_nothing(db: Database, city: StoredScene, plans: str, rule: str) -> None:
    with pytest.raises(psycopg.Error, match=rule) as caught, db.connection.transaction():
        db.connection.execute("SELECT conflictdb.admit('city', %s)", [plans])
    assert caught.value.sqlstate is not None
    assert caught.value.sqlstate.startswith("ZC")
    assert keys(city) == []


@pytest.mark.parametrize("bad", ["now", "tomorrow", "2030-01-01T06:00:00", "2030-01-01", "06:00", "epoch"])
@pytest.mark.parametrize("member", ["active_span", "activations", "times", "departures"])
def test_instants_need_an_offset(db: Database, city: StoredScene, member: str, bad: str) -> None:
    """Else one text would be other times in other sessions."""
    ring, hull = "POLYGON((0 0, 1 0, 1 1, 0 0))", "POLYGON((5 5, 5 -5, -5 -5, -5 5, 5 5))"
    good = ["2030-01-01T05:00:00Z", "2040-01-01 08:00:00.123456+02"]
    area = {"key": "a", "footprint": ring}
    track = {"key": "a", "path": "LINESTRING(0 0, 0.1 0)", "outline": hull, "times": good}
    for wrong in (False, True):
        start = bad if wrong else good[0]
        plan = {
            "active_span": area | {"active_span": f"[{start},)"},
            "activations": area | {"activations": f'{{[{start}, 2030-06-01 00:00Z), (2031-01-01 00:00Z,"{good[1]}"]}}'},
            "times": track | {"times": [start, good[1]]},
            "departures": track | {"times": [good[0], "2030-01-01 06:00Z"], "departures": [start]},
        }[member]
        for zone in ("UTC", "America/New_York"):
            with db.connection.transaction(force_rollback=True):
                db.connection.execute("SELECT set_config('timezone', %s, true)", [zone])
                ask = "SELECT admitted FROM conflictdb.admit('city', %s)"
                if not wrong:
                    assert db.connection.execute(ask, [json.dumps([plan])]).fetchone() == (True,)
                    [stored] = store.read_scene(db.connection, "city")[1 if "footprint" in plan else 2]
                    assert 1_893_474_000_000_000 in (getattr(stored, "start_us", 0), *getattr(stored, "times_us", []))
                    continue
                with pytest.raises(psycopg.Error, match=r"plan 'a'.*must be ISO 8601 with an offset") as caught:
                    db.connection.execute(ask, [json.dumps([plan])])
                assert caught.value.sqlstate == "ZC016"


def test_limits_of_the_database_refuse_plans(db: Database, city: StoredScene) -> None:
    """In Python and SQL, whether they meet anybody or not; objects that are put directly may have no end."""
    conn = db.connection
    city.put(replace(square("fence", 0.0), start_us=None, end_us=None))
    limits = {"max_days_ahead": "30", "max_vertices": "10000", "max_waypoints": "10000"}
    for name, most in limits.items():
        conn.execute(f"SET conflictdb.{name} = {most}")
    for plan, rule in beyond_limits():
        with pytest.raises(InvalidInput, match=rule):
            city.admit(plan)
        with pytest.raises(psycopg.Error, match=rule) as caught, conn.transaction():
            asked(conn, plan)
        assert caught.value.sqlstate in {"ZC003", "ZC017"}
    assert keys(city) == ["fence"]
    assert not city.admit(within_limits("a"))
    assert asked(conn, within_limits("a"))[0] is False
    conn.commit()
    for given in ("-1", "soon", "NaN", "1e3"):
        conn.execute("SELECT set_config('conflictdb.max_days_ahead', %s, false)", [given])
        with pytest.raises(psycopg.Error, match="must be a number of days"), conn.transaction():
            asked(conn, within_limits("a"))
    conn.execute("RESET ALL")
    conn.commit()


def test_undetected_objects_at_other_times_are_not_projected(db: Database, city: StoredScene) -> None:
    """PROJ prepares the plane of a great-circle scene at each call: an admission calls it once."""
    store.set_scene(db.connection, replace(CITY, motion="great_circle", earth="sphere"))
    city.put([square(f"there {k}", 0.001 * (k % 7), (2.0 + k, 3.0 + k)) for k in range(70)])
    conn = db.connection
    with conn.transaction():
        conn.execute("SET LOCAL track_functions = 'all'")
        assert asked(conn, *(square(f"{k}", 0.02 * k) for k in range(6)), p_owner="operator")[0]
        calls = conn.execute(
            "SELECT calls FROM pg_stat_xact_user_functions WHERE funcname = 'postgis_transform_geometry'"
        ).fetchone()
    assert calls == (1,)


@pytest.mark.usefixtures("city")
def test_an_answer_in_sql_has_a_bounded_number_of_conflicts(db: Database) -> None:
    """79,800 of 400 plans: the refusal names the limit, nothing was put, and the comparison stopped there."""
    conn = db.connection
    message = "plans: have more than 50000 conflicts, the most that one answer may have: ask about fewer plans at once"
    with conn.transaction():
        conn.execute("SET LOCAL track_functions = 'all'")
        with pytest.raises(psycopg.Error, match=message) as refused, conn.transaction():
            asked(conn, *(square(f"{k}", 0.0) for k in range(400)))
        compared = conn.execute(
            "SELECT calls FROM pg_stat_xact_user_functions WHERE funcname = 'st_intersection'"
        ).fetchone()
    assert refused.value.sqlstate == "ZC016"
    assert compared is not None
    # The last plan is compared with all others.
    assert 50_000 < compared[0] <= 50_000 + 400
    assert len(asked(conn, *(square(f"{k}", 0.0) for k in range(20)))[1]) == 190


@pytest.mark.usefixtures("city")
def test_pairs_that_workers_decide_are_no_conflicts_yet(db: Database) -> None:
    """51,040 pairs of 320 flights: more than an answer may have, and perhaps none of them is a conflict."""
    admitted, conflicts, request = asked(db.connection, *(flight(f"{k}", 0.0) for k in range(320)))
    assert (admitted, conflicts) == (None, [])
    assert request is not None
