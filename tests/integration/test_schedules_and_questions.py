"""Questions about a stored scene look as far as they reach, also beyond the time over which it expanded schedules."""

import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from city import asked, worker_connected
from patience import WAIT_S

import conflictdb
from conflictdb.client.database import Database
from conflictdb.errors import IncompleteWarning, InvalidInput
from conflictdb.jobs.probes import answer
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.store import WORKER_NAME, WorkerStamp

START_US = int(np.datetime64("2040-05-01T18:00", "us").astype(int))
HOUR_US = 3_600_000_000
DAY_US = 24 * HOUR_US
SHIP = conflictdb.rectangle_outline_m(50.0, 50.0, 50.0, 50.0)
BOX = shapely.box(4.0, 57.0, 4.2, 57.1)
DAILY = {"periods": [["19:10", "23:00"]]}


def voyage(key: str = "T", start_us: int = START_US, lat: float = 57.05, **more: Any) -> Track:
    return Track(key, [(3.9, lat), (4.3, lat)], [start_us, start_us + HOUR_US], SHIP, **more)


def said(found: Any) -> list[Any]:
    return [(c.a_key, c.b_key, str(c.verdict), c.periods, c.time_error_s) for c in found]


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with conflictdb.connect(dsn) as db:
        yield db


def stored(db: Database, objects: list[Area | Track], **settings: Any) -> Any:
    scene = db.scene("s")
    scene.put(objects, Scene("s", horizon_days=30.0, **settings))
    scene.detect()
    return scene


def worker(dsn: str, stop: threading.Event) -> None:
    with psycopg.connect(dsn, application_name=WORKER_NAME) as conn:
        WorkerStamp().begin(conn)
        while not stop.wait(0.02):
            answer(conn)


@pytest.fixture
def answering(dsn: str) -> Iterator[None]:
    stop = threading.Event()
    thread = threading.Thread(target=worker, args=(dsn, stop))
    thread.start()
    yield
    stop.set()
    thread.join()


AREA = Area("S", BOX, schedule=DAILY)
NEAR_IN_TIME = pytest.mark.parametrize(
    ("plan", "settings"),
    [
        (voyage(start_us=START_US + HOUR_US), {}),
        (voyage(start_us=START_US + 2 * DAY_US - HOUR_US), {"time_separation_s": 7200.0}),
        (voyage(tolerances={"departure_window": ["2040-05-01T18:00Z", "2040-05-01T19:30Z"]}), {}),
        (voyage(tolerances={"min_speed_kn": 1.0}), {}),
        (Area("P", BOX, start_us=np.datetime64(START_US, "us"), end_us=np.datetime64(START_US + DAY_US, "us")), {}),
    ],
)


@NEAR_IN_TIME
def test_a_probe_looks_as_far_as_its_plan(db: Database, plan: Area | Track, settings: dict[str, Any]) -> None:
    """Of one plan, of several, admitted, and within an edit: as the plan entered by hand; the scene stays current."""
    scene = stored(db, [AREA, voyage("far", lat=10.0)], **settings)
    entered = Area(
        "S",
        BOX,
        spans_us=[[np.datetime64(f"2040-05-0{day}T{at}", "us") for at in ("19:10", "23:00")] for day in (1, 2, 3)],
    )
    [expected] = said(conflictdb.solve(*_kinds([plan, entered]), Scene("s", **settings)))
    found = scene.probe(plan)
    assert said(found) == [expected]
    assert found.is_current
    several = scene.probe([plan, voyage("other", lat=-10.0)])
    assert said(several) == [expected]
    refused = scene.admit(plan)
    assert (bool(refused), said(refused.conflicts)) == (False, [expected])
    scene.put(Area("new", shapely.box(80, 0, 81, 1)))
    with pytest.warns(IncompleteWarning):
        assert said(scene.probe(plan)) == [expected]


def _kinds(plans: list[Area | Track]) -> tuple[list[Track], list[Area]]:
    return [one for one in plans if isinstance(one, Track)], [one for one in plans if isinstance(one, Area)]


@pytest.mark.usefixtures("answering")
def test_a_worker_looks_as_far_as_the_plan(db: Database) -> None:
    scene = stored(db, [AREA])
    plan = voyage(start_us=START_US + HOUR_US)
    expected = said(scene.probe(plan))
    assert [one[:2] for one in expected] == [("S", "T")]
    assert said(scene.probe(plan, worker_timeout_s=WAIT_S)) == expected


def test_a_schedule_that_no_detection_has_seen_is_cut(db: Database) -> None:
    """Not estimated: its pairs are decided, and nothing is unresolved."""
    scene = stored(db, [voyage("far", lat=10.0)])
    scene.put([AREA, Area("morning", BOX, schedule={"periods": [["03:00", "05:00"]]})])
    plan = voyage(start_us=START_US + HOUR_US)
    with pytest.warns(IncompleteWarning):
        found = scene.probe(plan)
    assert [(one[0], one[2]) for one in said(found)] == [("S", "conflict")]
    assert not scene.admit(plan)
    assert scene.admit(voyage("free", START_US + 5 * HOUR_US))


def test_a_schedule_that_is_not_understood_is_unresolved(db: Database) -> None:
    scene = stored(db, [AREA])
    db.connection.execute("UPDATE conflictdb.area SET schedule = '{\"days\": [\"SOMEDAY\"]}' WHERE key = 'S'")
    db.connection.commit()
    with pytest.warns(IncompleteWarning):
        assert [one[2] for one in said(scene.probe(voyage()))] == ["unresolved"]
    assert not scene.admit(voyage())


def test_plans_without_an_end_are_known_until_the_horizon(db: Database) -> None:
    scene = stored(db, [AREA])
    plan = Area("P", BOX, start_us=np.datetime64(START_US, "us"))
    with pytest.warns(IncompleteWarning, match="schedules are expanded from"):
        assert not scene.probe(plan).is_current
    with pytest.raises(InvalidInput, match="area 'P': time: is not known to be free: schedules are expanded from"):
        scene.admit(plan)
    assert scene.probe(replace(plan, start_us=None)).is_current


@pytest.mark.usefixtures("answering")
def test_one_plan_without_an_end_among_others_is_known_until_the_horizon(db: Database) -> None:
    """Whatever the others touch, and whoever answers."""
    scene = stored(db, [AREA])
    plan, far = Area("P", BOX, start_us=np.datetime64(START_US, "us")), shapely.box(50.0, 10.0, 51.0, 11.0)
    now = np.datetime64(datetime.now(UTC).replace(tzinfo=None), "us")
    for other in (Area("N", far, start_us=now, end_us=now + np.timedelta64(1, "D")), Area("N", far, schedule=DAILY)):
        for wait in ({}, {"worker_timeout_s": WAIT_S}):
            for plans in ([plan], [plan, other]):
                with pytest.warns(IncompleteWarning, match="schedules are expanded from"):
                    assert not scene.probe(plans, **wait).is_current
            assert scene.probe(other, **wait).is_current


def admitted(db: Database, plan: Area | Track) -> tuple[bool | None, Any]:
    with worker_connected(db.connection.info.dsn):
        is_admitted, conflicts, request = asked(db.connection, plan, scene="s")
        db.connection.commit()
    if request is not None:
        found = db.connection.execute("SELECT * FROM conflictdb.wait_for_admission(%s)", [request]).fetchone()
        db.connection.commit()
        assert found is not None
        is_admitted, conflicts = found
    return is_admitted, [one["a_key"] for one in conflicts]


@pytest.mark.usefixtures("answering")
def test_admission_in_sql_looks_as_far_as_its_plan(db: Database) -> None:
    scene = stored(db, [AREA])
    ends: Any
    for ends in ({"start_us": np.datetime64(START_US, "us")}, {"end_us": np.datetime64("2020-01-01", "us")}):
        with pytest.raises(psycopg.Error, match="is not known to be free"):
            admitted(db, Area("E", BOX, **ends))
        db.connection.rollback()
    assert admitted(db, voyage(start_us=START_US + HOUR_US)) == (False, ["S"])
    assert admitted(db, voyage(start_us=START_US - 13 * HOUR_US)) == (True, [])
    span: Any = [np.datetime64(START_US + after, "us") for after in (HOUR_US, 2 * HOUR_US)]
    assert admitted(db, Area("P", BOX, start_us=span[0], end_us=span[1])) == (False, ["P"])
    night: Any = [np.datetime64(START_US + after, "us") for after in (5 * HOUR_US + 1, 7 * HOUR_US)]
    assert admitted(db, Area("P", BOX, start_us=night[0], end_us=night[1])) == (True, [])
    assert admitted(db, Area("Q", BOX, schedule={"periods": [["05:20", "05:30"]]}))[0] is False
    assert admitted(db, Area("Q", BOX, schedule={"periods": [["02:00", "03:00"]]})) == (True, [])
    assert admitted(db, Area("R", BOX, schedule={"periods": [["02:30", "03:30"]]}))[0] is False
    scene.detect()
    assert not scene.conflicts()


def test_plans_with_a_schedule_are_probed_and_admitted(db: Database) -> None:
    """They meet what is stored, whether detected or not, and each other, as `solve` says."""
    start_us = int(datetime.now(UTC).timestamp() // 86_400 + 40) * DAY_US + 18 * HOUR_US
    ends: Any = [np.datetime64(start_us + us, "us") for us in (0, DAY_US)]
    span = Area("A", BOX, start_us=ends[0] - np.timedelta64(35, "D"), end_us=ends[1] - np.timedelta64(35, "D"))
    late = Area("late", BOX, schedule={"periods": [["22:00", "22:10"]]})
    for others in ([voyage("V", start_us + HOUR_US)], [span], [voyage("V", start_us + HOUR_US), late]):
        scene = stored(db, [*others])
        expected = said(conflictdb.solve(*_kinds([AREA, *others]), Scene("s", horizon_days=30.0)))
        mine = [one for one in expected if "S" in one[:2]]
        assert mine
        assert said(scene.probe(AREA)) == mine
        morning = replace(AREA, schedule={"periods": [["03:00", "03:10"]]})
        assert [one[:2] for one in said(scene.probe(morning))] == ([("A", "S")] if span in others else [])
        assert not scene.admit(AREA)
        scene.put(AREA)
        with pytest.warns(IncompleteWarning):
            assert said(scene.probe(AREA)) == mine
        scene.detect()
        assert sorted(said(scene.conflicts())) == sorted(expected)
        scene.delete()


LATE = Area("B", shapely.box(4.21, 57.0, 4.3, 57.1), schedule={"periods": [["22:00", "23:59"]]})


def as_entered(*areas: Area) -> list[Area]:
    """Return areas by schedule as areas by hand, for some days."""
    days = [f"2040-{day}" for day in ("04-29", "04-30", "05-01", "05-02", "05-03", "05-04")]
    return [
        replace(
            area,
            schedule=None,
            spans_us=[[np.datetime64(f"{day}T{at}", "us") for at in area.schedule["periods"][0]] for day in days],
        )
        for area in areas
    ]


@pytest.mark.usefixtures("answering")
def test_delays_of_one_track_look_as_far_as_they_reach(db: Database) -> None:
    """Of a scene, of a branch and by a worker, as those of all tracks: no departure is called free that conflicts."""
    scene = stored(db, [AREA, LATE, voyage(), voyage("far", lat=10.0)])
    [expected] = conflictdb.delays([voyage()], as_entered(AREA, LATE), Scene("s"), "T", 28_800.0)
    assert {key for one in expected.forbidden for key in one.by} == {"S", "B"}
    assert scene.delays("T", 28_800.0) == [expected]
    assert scene.delays(within_s=28_800.0)[0] == expected
    [waits] = conflictdb.delays([voyage()], as_entered(AREA, LATE), Scene("s"), "T", 28_800.0, waypoint=1)
    assert scene.delays("T", 28_800.0, waypoint=1) == [waits]
    [clear] = scene.delays("T", 28_800.0, clear_within_m=2000.0)
    assert clear.forbidden == expected.forbidden
    request = db.connection.execute("SELECT conflictdb.request_delays('s', 'T', '8 hours')").fetchone()
    db.connection.commit()
    row = db.connection.execute("SELECT forbidden FROM conflictdb.wait_for_delays(%s)", request).fetchone()
    db.connection.commit()
    assert row is not None
    assert [one["to_s"] for one in row[0]] == [one.to_s for one in expected.forbidden]
    branch = scene.branch("b")
    branch.put(voyage(start_us=START_US - HOUR_US))
    branch.detect()
    [moved] = conflictdb.delays(
        [voyage(start_us=START_US - HOUR_US)], as_entered(AREA, LATE), Scene("b"), "T", 28_800.0
    )
    assert branch.delays("T", 28_800.0) == [moved]


def test_speeds_of_one_track_look_as_far_as_they_reach(db: Database) -> None:
    scene = stored(db, [AREA, LATE, voyage(), voyage("far", lat=10.0)])
    [expected] = conflictdb.speeds([voyage()], as_entered(AREA, LATE), Scene("s"), "T", 0.2, 2.0)
    assert expected.forbidden
    assert scene.speeds("T", 0.2, 2.0) == [expected]
    assert scene.speeds(slowest=0.2, fastest=2.0)[0] == expected


def test_delays_of_a_repeated_voyage_look_as_far_as_the_scene_does(db: Database) -> None:
    """With a key or without: schedules are expanded as far as a detection did for any voyage."""
    weekly = {"rrule": "DTSTART:20400101T180000Z\nRRULE:FREQ=DAILY;COUNT=200", "duration": "PT1H"}
    ferry = Track("F", [(3.9, 57.05), (4.3, 57.05)], [START_US, START_US + HOUR_US], SHIP, schedule=weekly)
    scene = stored(db, [replace(AREA, schedule={"dates": ["2040-03-01"], **DAILY}), ferry, voyage("far", lat=10.0)])
    [of_all] = [one for one in scene.delays(within_s=7200.0) if one.key == "F"]
    assert of_all.forbidden
    assert scene.delays("F", 7200.0) == [of_all]


def test_the_page_reads_what_a_moved_plan_may_meet(db: Database) -> None:
    """Pieces for the page, and its probe of a moved plan in a branch, contain schedules beyond the planned voyage."""
    from conflictdb.map import editing, what_if

    scene = stored(db, [AREA, LATE, voyage(), voyage("far", lat=10.0)])
    packed = what_if.packed_departing(db.connection, "s", "T", 86_400.0)
    head = json.loads(packed[4 : 4 + int.from_bytes(packed[:4], "little")])
    assert head["objects"] == ["B", "S", "T"]
    db.connection.commit()
    branch = scene.branch("b")
    branch.detect()
    later = editing.PlanMove("T", editing.digest(voyage()), 2 * HOUR_US, 0.0, None, None)
    for name in ("s", "b"):
        assert [row[0] for row in editing.probed(db.connection, name, later)["conflicts"]] == ["S"]
    beyond = replace(later, later_us=3 * HOUR_US + HOUR_US // 2)
    for name in ("s", "b"):
        assert sorted(row[0] for row in editing.probed(db.connection, name, beyond)["conflicts"]) == ["B", "S"]


def test_a_probe_of_sql_says_where_schedules_are_missing(db: Database) -> None:
    """Pending schedules, and those that are not understood, are candidates; times beyond schedules give a notice."""
    scene = stored(db, [Area("daily", BOX, schedule=DAILY), voyage("T", lat=59.0)])
    said_so: list[str] = []
    db.connection.add_notice_handler(lambda notice: said_so.append(str(notice.message_primary)))

    def probed(span: str) -> set[str]:
        said_so.clear()
        query = "SELECT key FROM conflictdb.probe('s', ST_MakeEnvelope(4, 57, 4.2, 57.1, 4326), %s::tstzrange)"
        with db.connection.transaction():
            return {key for (key,) in db.connection.execute(query, [span]).fetchall()}

    now = datetime.now(UTC)
    soon, beyond = f"[{now}, {now + timedelta(days=365)})", "[2060-01-01Z, 2060-02-01Z)"
    assert probed("(,)") == {"daily"}
    assert not said_so
    assert probed(beyond) == set()
    assert "schedules are expanded from" in said_so[0]
    far = "[2060-01-01Z,)"
    assert probed(far) == set()
    assert "schedules are expanded from" in said_so[0]
    scene.put([Area("pending", BOX, schedule=DAILY), voyage("repeats", schedule=DAILY)])
    for span in (soon, beyond, far, "(,)"):
        assert {"pending", "repeats"} <= probed(span)
        assert any("waits" in one or "wait" in one for one in said_so), said_so
    with db.connection.transaction():
        db.connection.execute(
            "UPDATE conflictdb.area SET schedule = %s WHERE key = 'pending'", ['{"notam": "WHENEVER"}']
        )
    scene.detect()
    for span in (soon, beyond, far, "(,)"):
        assert "pending" in probed(span)
