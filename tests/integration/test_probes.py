"""A probe gives the answer that a detection would give for the plan: from Python, and from SQL by a worker."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from draws import draws
from full_plans import lost
from mixed_scenes import odd_scene
from odd_values import Anywhere
from patience import WAIT_S, answer_all
from piecework import load
from psycopg import conninfo, sql
from scenes import T0_US, box, sail

from conflictdb import Area, Rule, Track, connect, rectangle_outline_m, store
from conflictdb.core import conflicts_between
from conflictdb.errors import IncompleteWarning, InvalidInput, NotCurrent, StoreError
from conflictdb.formats.file_objects import AREA_MEMBERS, TRACK_MEMBERS
from conflictdb.formats.scene_file import feature_of, plans_text, read_plans
from conflictdb.jobs import detect, probes
from conflictdb.model.plans import Scene
from conflictdb.model.results import Conflict

Conn = psycopg.Connection[Any]
HOUR_US = 3_600_000_000
T0 = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=T0_US)


def said(found: list[Conflict]) -> list[Conflict]:
    """Return conflicts without columns that only the database fills."""
    unknown: dict[str, Any] = dict.fromkeys(("region", "is_current", "scene_is_current", "run_id", "found_at"))
    rows = [replace(one, **unknown) for one in found]
    return sorted(rows, key=lambda one: (one.a_key, one.b_key))


def test_a_probe_writes_nothing_and_says_what_is_not_current(conn: Conn) -> None:
    load(conn, Scene("s"), [box("A", 0.4, -0.1, 0.6, 0.1)], [])
    detect.detect(conn, "s", jobs=1)
    with connect(conn) as db:
        (one,) = db.scene("s").probe(sail("new", (0.0, 0.0), (1.0, 0.0)))
        assert (one.a_key, one.b_key, one.verdict) == ("A", "new", "conflict")
        assert db.scene("s").probe(sail("new", (0.0, 5.0), (1.0, 5.0))) == []
        assert db.scene("s").probe(box("A", 0.4, -0.1, 0.6, 0.1)) == []  # it would replace itself
        store.replace_scene(conn, Scene("s"), [box("B", 2.0, 2.0, 3.0, 3.0)], [], merge=True)
        conn.execute("SET default_transaction_read_only = on")
        conn.commit()
        with pytest.warns(IncompleteWarning, match="1 object waits"):
            assert len(db.scene("s").probe(sail("new", (0.0, 0.0), (1.0, 0.0)))) == 1
        conn.execute("SELECT 1")
        with pytest.raises(StoreError, match="open transaction"):
            db.scene("s").probe(box("new", 0.0, 0.0, 1.0, 1.0))
        conn.rollback()
        with pytest.raises(InvalidInput, match="89"):
            db.scene("s").probe(sail("new", (0.0, 89.5), (1.0, 89.5)))
        with pytest.raises(InvalidInput, match="must be an Area or a Track"):
            db.scene("s").probe("A")  # type: ignore[arg-type]
        with pytest.raises(InvalidInput, match="nowhere"):
            db.scene("nowhere").probe(box("new", 0.0, 0.0, 1.0, 1.0))


def test_a_probe_sees_what_no_detection_has_seen(conn: Conn, dsn: str) -> None:
    """Objects that are new, moved or gone, voyages and schedules at other times, in Python, by a worker and in SQL."""
    load(conn, Scene("s"), [box("moves", 0.4, -0.1, 0.6, 0.1), box("goes", 0.4, -0.1, 0.6, 0.1)], [])
    detect.detect(conn, "s", jobs=1)
    later = T0_US + 100 * HOUR_US
    voyages = replace(
        sail("voyages", (0.5, -0.2), (0.5, 0.2)),
        times_us=T0_US + np.array([0, 1]) * HOUR_US,
        departures_us=[T0_US, later],
    )
    plan = box("new", 0.4, -0.1, 0.6, 0.1, start_us=later, end_us=later + HOUR_US)
    with connect(conn) as db:
        scene = db.scene("s")
        scene.put([box("moves", 2.0, 2.0, 3.0, 3.0), box("added", 0.5, 0.0, 0.7, 0.2), box("new", 5.0, 5.0, 6.0, 6.0)])
        scene.put([voyages, sail("passed", (0.5, -0.2), (0.5, 0.2))])
        scene.delete_objects("goes")
        conn.commit()
        with pytest.warns(IncompleteWarning):
            assert {(one.a_key, one.b_key) for one in scene.probe(plan)} == {("added", "new"), ("new", "voyages")}
        assert {one.a_key for one in scene.admit(plan, replace=["new"]).conflicts} == {"added", "new"}
        with answering(dsn), connect(dsn) as other:
            with pytest.warns(IncompleteWarning):
                answered = other.scene("s").probe(plan, worker_timeout_s=WAIT_S)
            assert {(one.a_key, one.b_key) for one in answered} == {("added", "new"), ("new", "voyages")}
    span = "tstzrange(to_timestamp(%s), to_timestamp(%s))"
    found = f"SELECT key FROM conflictdb.probe('s', ST_MakeEnvelope(0.4, -0.1, 0.6, 0.1, 4326), {span}) ORDER BY key"
    at = [later / 1e6, later / 1e6 + 3600.0]
    assert conn.execute(found.encode(), at).fetchall() == [("added",), ("voyages",)]
    at = [T0_US / 1e6, T0_US / 1e6 + 3600.0]
    assert conn.execute(found.encode(), at).fetchall() == [("added",), ("passed",), ("voyages",)]
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    assert conn.execute(found.encode(), at).fetchall() == [("added",), ("passed",), ("voyages",)]


def test_workers_are_asked_about_many_plans_in_as_many_round_trips_as_about_two(
    conn: Conn, dsn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    load(conn, Scene("s"), [box("A", 0.0, 0.0, 9.0, 0.1)], [])
    detect.detect(conn, "s", jobs=1)
    calls: list[str] = []
    known = psycopg.Cursor.execute
    with answering(dsn), connect(dsn) as db:

        def counted(self: Any, query: Any, *rest: Any, **options: Any) -> Any:
            if self.connection is db.connection:
                calls.append(str(query))
            return known(self, query, *rest, **options)

        monkeypatch.setattr(psycopg.Cursor, "execute", counted)
        taken = []
        for count in (2, 9):
            calls.clear()
            plans = [box(f"P{k}", float(k), 0.0, k + 0.5, 0.2) for k in range(count)]
            found = db.scene("s").probe(plans, worker_timeout_s=WAIT_S)
            assert [(one.a_key, one.b_key) for one in found] == [("A", plan.key) for plan in plans]
            taken.append(len(calls))
        assert taken[0] == taken[1]
    with connect(dsn) as db, pytest.raises(NotCurrent, match="is not answered after"):
        db.scene("s").probe(plans, worker_timeout_s=0.05)


def test_several_plans_replace_their_namesakes_together(conn: Conn, dsn: str) -> None:
    """In this process and by a worker: the old places meet nothing, and the new ones each other."""
    old = [box("A", 0.4, -0.1, 0.6, 0.1), box("B", 2.4, -0.1, 2.6, 0.1)]
    load(conn, Scene("s"), old, [sail("T", (0.0, 0.0), (3.0, 0.0))])
    detect.detect(conn, "s", jobs=1)
    plans = [box("A", 2.5, 0.0, 2.6, 0.3), box("B", 2.4, 0.2, 2.6, 0.4), sail("P", (0.5, -1.0), (0.5, 1.0))]
    with connect(conn) as db:
        here = db.scene("s").probe(plans)
        assert [(one.a_key, one.b_key) for one in here] == [("A", "B"), ("A", "T")]
        for given, rule in (([], "got none"), ([plans[0], plans[0]], "occurs more than once"), ([1], "got int")):
            with pytest.raises(InvalidInput, match=rule):
                db.scene("s").probe(given)
    with answering(dsn), connect(dsn) as db:
        answered = db.scene("s").probe(plans, worker_timeout_s=WAIT_S)
        assert [(one.a_key, one.b_key, one.periods) for one in answered] == [
            (one.a_key, one.b_key, one.periods) for one in here
        ]


ASK = "SELECT conflictdb.request_probe(%s, ST_MakeEnvelope(0.4, -0.1, 0.6, 0.1, 4326))"
ASK_TRACK = """
SELECT conflictdb.request_track_probe(%s, ST_GeomFromText(%s, 4326), conflictdb.rectangle_outline(500, 500, 200, 200))
"""
ANSWER = f"SELECT * FROM conflictdb.wait_for_probe(%s, '{WAIT_S:g} s')"


@contextmanager
def answering(dsn: str) -> Iterator[None]:
    """Answer requests meanwhile, as a worker does."""
    ended = threading.Event()

    def work() -> None:
        with store.connect(dsn) as conn, suppress(StoreError):
            while not ended.is_set():
                probes.answer(conn)
                store.wait_for_change(conn, 0.02)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def ask(conn: Conn, statement: str, *arguments: object) -> int:
    row = conn.execute(statement.encode(), arguments).fetchone()
    conn.commit()
    assert row is not None
    return int(row[0])


def refused(conn: Conn, statement: str, *arguments: object) -> str | None:
    with pytest.raises(psycopg.Error) as error:
        conn.execute(statement.encode(), arguments)
    conn.rollback()
    return error.value.sqlstate


def test_who_asks_in_sql_is_answered_by_a_worker(conn: Conn, dsn: str) -> None:
    load(conn, Scene("s", nearest_m=2000.0), [box("N", 0.4, 0.11, 0.6, 0.2)], [sail("T", (0.0, 0.0), (1.0, 0.0))])
    detect.detect(conn, "s", jobs=1)
    with answering(dsn):
        rows = conn.execute(ANSWER, [ask(conn, ASK, "s")]).fetchall()
        assert [(row[0], row[1], row[2]) for row in rows] == [("N", "area", "near"), ("T", "track", "conflict")]
        _, _, _, periods, first, last, error_s, point, closest_at, closest_m, _, lacking_s, certainty = rows[1]
        assert len(periods) == 1
        assert T0 < first < last < T0 + timedelta(hours=1)
        assert 0 < error_s < 1e-6
        assert point is not None
        assert (closest_at, closest_m, lacking_s, certainty) == (first, 0.0, None, None)
        path = f"LINESTRING M (0.5 -1 {T0_US / 1e6}, 0.5 1 {T0_US / 1e6 + 3600})"
        crossing = conn.execute(ANSWER, [ask(conn, ASK_TRACK, "s", path)]).fetchall()
        assert [row[0] for row in crossing] == ["T", "N"]  # the earlier first
        conn.execute("SET DateStyle = 'SQL, DMY'; SET TimeZone = 'Asia/Kolkata'")
        again = ask(conn, ASK, "s")
        same_time = "SELECT count(*) FROM conflictdb.wait_for_probe(%s) WHERE first_contact = to_timestamp(%s)"
        assert conn.execute(same_time, [again, first.timestamp()]).fetchone() == (1,)
        conn.execute("RESET DateStyle; RESET TimeZone")
        # An impossible object is reported to its sender, and stops no other request.
        dented = "'POLYGON((0 0, 9 0, 1 1, 0 9, 0 0))'"
        bad = f"SELECT conflictdb.request_track_probe('s', ST_GeomFromText(%s, 4326), {dented})"
        assert refused(conn, ANSWER, ask(conn, bad, path)) == "ZC016"
        assert len(conn.execute(ANSWER, [ask(conn, ASK, "s")]).fetchall()) == 2
    assert conn.execute("SELECT count(*) FROM conflictdb.change").fetchone() == (0,)


def test_workers_are_asked_from_python_and_say_the_same(conn: Conn, dsn: str) -> None:
    """All columns, whatever a plan says."""
    areas = [box("A", 0.4, -0.1, 0.6, 0.1, start_us=T0_US), box("N", 0.4, 0.11, 0.6, 0.2)]
    load(conn, Scene("s", nearest_m=2000.0), areas, [sail("T", (0.0, 0.0), (1.0, 0.0))])
    detect.detect(conn, "s", jobs=1)
    crossing = sail("P", (0.5, -1.0), (0.5, 1.0), floor_m=-10.0, ceiling_m=20.0)
    plans = [
        box("P", 0.3, -0.2, 0.45, 0.105, start_us=T0_US - 1, floor_m=-5.0),
        box("T", 0.3, -0.2, 0.45, 0.105),
        crossing,
        replace(crossing, outline_m=np.array([[0.0, 0.0]]), grow_mps=0.5),
        replace(crossing, outline_m=np.array([[-50.0, 0.0], [50.0, 10.0]])),
        replace(crossing, outlines_m=np.array([crossing.outline_m, 2.0 * crossing.outline_m])),
        replace(crossing, tolerances={"xtd_port_m": 300.0, "xtd_starboard_m": 20.0}),
        replace(crossing, floor_m=None, ceiling_m=None, floors_m=[-10.0], ceilings_m=[np.inf]),
        replace(crossing, departures_us=[T0_US + k * 2 * HOUR_US for k in range(3)]),
        replace(
            plan_of_spans := box("P", 0.3, -0.2, 0.45, 0.105),
            spans_us=[(None, T0_US + 1), (T0_US + HOUR_US // 2, None)],
        ),
        replace(plan_of_spans, name="named", properties={"Floor": 3, "cieling_m": 5}),
    ]
    with answering(dsn), connect(dsn) as db:
        for plan in plans:
            here = said(list(db.scene("s").probe(plan)))
            answered = db.scene("s").probe(plan, worker_timeout_s=WAIT_S)
            assert (said(list(answered)), answered.is_current) == (here, True)
            assert here
    with connect(dsn) as db:
        with pytest.raises(NotCurrent, match="is not answered after"):
            db.scene("s").probe(crossing, worker_timeout_s=0.05)
        with db.connection.transaction(), pytest.raises(StoreError, match="without an open transaction"):
            db.scene("s").probe(crossing, worker_timeout_s=1.0)


def test_a_scene_that_changes_before_a_worker_answers_is_not_current(conn: Conn, dsn: str) -> None:
    load(conn, Scene("s"), [box("A", 0.0, 0.0, 1.0, 1.0)], [])
    detect.detect(conn, "s", jobs=1)

    def change_and_answer() -> None:
        with connect(dsn) as other, store.connect(dsn) as worker:
            while not worker.execute("SELECT FROM conflictdb.probe_request").fetchall():
                worker.rollback()
                time.sleep(0.01)
            worker.rollback()
            other.scene("s").put(box("B", 0.0, 0.0, 1.0, 1.0))
            probes.answer(worker)

    thread = threading.Thread(target=change_and_answer)
    thread.start()
    with connect(dsn) as db, pytest.warns(IncompleteWarning, match="changed before a worker answered"):
        found = db.scene("s").probe(box("P", 0.5, 0.5, 2.0, 2.0), worker_timeout_s=WAIT_S)
    thread.join()
    assert [one.a_key for one in found] == ["A", "B"]


@pytest.mark.parametrize("options", ["{}", '{"owner": null, "allow_known": null, "replace": null}'])
def test_options_of_an_admission_may_be_left_out(conn: Conn, options: str) -> None:
    load(conn, Scene("s"), [], [])
    add = f"""INSERT INTO conflictdb.probe_request (scene_id, kind, plans, options)
              SELECT s.scene_id, 'admit', '[{A_FEATURE}]', %s FROM conflictdb.scene s RETURNING probe_id"""
    probe_id = ask(conn, add, options)
    probes.answer(conn)
    answer = "SELECT admitted FROM conflictdb.wait_for_admission(%s)"
    assert conn.execute(answer.encode(), [probe_id]).fetchone() == (True,)
    assert refused(conn, add, '{"replace": "T"}') == "ZC016"


def test_what_can_be_no_plan_is_refused_at_once(conn: Conn) -> None:
    load(conn, Scene("s"), [], [])
    at = T0_US / 1e6
    paths = {
        f"LINESTRING M (0.5 -1 {at}, 0.5 1 {at})": "ZC002",
        "LINESTRING M (0 0 NaN, 1 1 5)": "ZC001",
        "LINESTRING M (0 0 1e15, 1 1 2e15)": "ZC003",
        f"LINESTRING M (0 91 {at}, 0.5 1 {at + 1})": "ZC005",
        "LINESTRING (0 0, 1 1)": "ZC001",
    }
    for path, sqlstate in paths.items():
        assert refused(conn, ASK_TRACK, "s", path) == sqlstate, path
    assert refused(conn, ASK, "nowhere") == "ZC010"
    assert refused(conn, ASK.replace("4326)", "3857)"), "s") == "ZC001"
    for span in ("[0044-03-15 00:00+00 BC, 2030-01-01 00:00+00)", "[2030-01-01 00:00+00, 10000-01-01 00:00+00)"):
        at_span = "SELECT conflictdb.request_probe('s', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))', %s)"
        assert refused(conn, at_span, span) == "ZC003"
    line = "SELECT conflictdb.request_probe('s', 'SRID=4326;LINESTRING(0 0, 1 1)')"
    assert refused(conn, line) == "ZC001"


def test_nobody_answers_in_time(conn: Conn) -> None:
    load(conn, Scene("s"), [], [])
    probe_id = ask(conn, ASK, "s")
    assert refused(conn, "SELECT * FROM conflictdb.wait_for_probe(%s, '50 ms')", probe_id) == "ZC015"
    assert refused(conn, ANSWER, probe_id + 1000) == "ZC011"
    conn.execute("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ")
    assert refused(conn, ANSWER, probe_id) == "ZC013"
    row = conn.execute(ASK, ["s"]).fetchone()
    assert row is not None
    assert refused(conn, ANSWER, row[0]) == "ZC013"


def test_scenes_are_answered_in_turn_and_what_is_old_is_removed(conn: Conn, dsn: str) -> None:
    load(conn, Scene("s"), [], [])
    load(conn, Scene("other"), [], [])
    asked = [ask(conn, ASK, "s") for _ in range(4)] + [ask(conn, ASK, "other")]
    old = "UPDATE conflictdb.probe_request SET asked_at = now() - interval '61 minutes' WHERE probe_id = %s"
    conn.execute(old, [asked[3]])
    conn.commit()
    with store.connect(dsn) as worker:
        answer_all(worker)
    rows = conn.execute("SELECT probe_id FROM conflictdb.probe_request ORDER BY answered_at").fetchall()
    assert [probe_id for (probe_id,) in rows] == [asked[0], asked[4], asked[1], asked[2]]


def test_answers_are_for_who_asked(conn: Conn, dsn: str) -> None:
    """Readers may ask; another reader sees neither the question nor the answer, workers see both."""
    load(conn, Scene("s"), [], [sail("T", (0.0, 0.0), (1.0, 0.0))])
    detect.detect(conn, "s", jobs=1)
    users = {name: f"{name}_{conn.info.dbname}" for name in ("asker", "other", "stranger", "worker")}
    roles = {"asker": "reader", "other": "reader", "worker": "worker"}
    for name, user in users.items():
        conn.execute(sql.SQL("CREATE ROLE {} LOGIN").format(sql.Identifier(user)))
        if name in roles:
            role = sql.Identifier(f"conflictdb_{roles[name]}")
            conn.execute(sql.SQL("GRANT {} TO {}").format(role, sql.Identifier(user)))
    conn.commit()
    opened = {}
    try:
        for name, user in users.items():
            opened[name] = psycopg.connect(conninfo.make_conninfo(dsn, user=user))
        probe_id = ask(opened["asker"], ASK, "s")
        answer_all(opened["worker"])
        assert len(opened["asker"].execute(ANSWER, [probe_id]).fetchall()) == 1
        counts = "SELECT (SELECT count(*) FROM conflictdb.probe_request), (SELECT count(*) FROM conflictdb.probe_reply)"
        seen = {name: opened[name].execute(counts.encode()).fetchone() for name in ("asker", "other", "worker")}
        assert seen == {"asker": (1, 1), "other": (0, 0), "worker": (1, 1)}
        assert refused(opened["other"], ANSWER, probe_id) == "ZC011"
        assert refused(opened["stranger"], ASK, "s") == "42501"
        pretend = "INSERT INTO conflictdb.probe_request (scene_id, kind, plans, asked_by) SELECT scene_id, 'probe', "
        pretend += f"'[{A_FEATURE}]', %s FROM "
        assert refused(opened["other"], pretend + "conflictdb.scene", users["asker"]) in ("42501", "23514")
        assert refused(opened["asker"], "UPDATE conflictdb.probe_request SET asked_at = now()") == "42501"
        assert refused(opened["asker"], "INSERT INTO conflictdb.probe_reply DEFAULT VALUES") == "42501"
    finally:
        for connection in opened.values():
            connection.close()
        for user in users.values():
            conn.execute(sql.SQL("DROP OWNED BY {0}").format(sql.Identifier(user)))
            conn.execute(sql.SQL("DROP ROLE {0}").format(sql.Identifier(user)))
        conn.commit()


REQUEST = """INSERT INTO conflictdb.probe_request (scene_id, kind, plans, {column})
             SELECT scene_id, {kind}, {plans}, {value} FROM conflictdb.scene"""
A_RING = '"geometry": {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}'
A_FEATURE = f'{{"type": "Feature", "version": 1, "id": "A", {A_RING}, "properties": {{"start": "2030-01-01T00:00Z"}}}}'


@pytest.mark.parametrize(
    ("row", "state"),
    [
        ({}, None),
        ({"plans": f"""'{{"type": "FeatureCollection", "version": 1, "features": [{A_FEATURE}]}}'"""}, None),
        ({"plans": "NULL"}, "ZC016"),
        ({"plans": "'[]'"}, "ZC016"),
        ({"plans": "'5'"}, "ZC016"),
        ({"plans": f"""'{{"type": "FeatureCollection", "version": 2, "features": [{A_FEATURE}]}}'"""}, "ZC016"),
        ({"plans": f"""'{{"type": "FeatureCollection", "scene": {{}}, "features": [{A_FEATURE}]}}'"""}, "ZC016"),
        ({"plans": "'[" + A_FEATURE.replace('"version": 1', '"version": 2') + "]'"}, "ZC016"),
        ({"plans": "'[" + A_FEATURE.replace('"id": "A"', '"id": 7') + "]'"}, "ZC016"),
        ({"plans": "'[" + A_FEATURE.replace('"Feature"', '"feature"') + "]'"}, "ZC016"),
        ({"plans": f"'[{A_FEATURE}, {A_FEATURE}]'"}, "ZC007"),
        ({"plans": "'[" + A_FEATURE.replace("Polygon", "Polygone") + "]'"}, None),
        ({"plans": "'[" + A_FEATURE.replace(A_RING, '"geometry": null') + "]'"}, None),
        ({"plans": "'[" + A_FEATURE.replace("2030-01-01T00:00Z", "tomorrow") + "]'"}, None),
        ({"plans": "'[" + A_FEATURE.replace('"start"', '"strat"') + "]'"}, None),
        ({"column": "answered_at", "value": "now()"}, "ZC013"),
        ({"column": "answer", "value": "'{}'"}, "ZC013"),
        ({"column": "attempts", "value": "-32768"}, "ZC013"),
        ({"column": "attempted_at", "value": "'infinity'"}, "ZC013"),
        ({"column": "bytes", "value": "-1e18"}, None),
        ({"column": "asked_at", "value": "'infinity'"}, None),
        ({"column": "options", "value": "'[]'"}, "ZC016"),
        ({"column": "options", "value": """'{"key": "T"}'"""}, "ZC016"),
        ({"kind": "'delays'", "column": "options", "value": """'{"key": "T", "horizon_s": 60}'"""}, None),
        ({"kind": "'delays'", "column": "options", "value": """'{"key": "T", "horizon_s": "x"}'"""}, "ZC016"),
        ({"kind": "'delays'", "column": "options", "value": """'{"key": "T"}'"""}, "ZC003"),
        ({"kind": "'admit'"}, "42501"),
        ({"kind": "'other'"}, "ZC016"),
        ({"kind": "NULL"}, "ZC016"),
    ],
    ids=str,
)
def test_a_row_that_a_reader_writes_stops_no_worker(
    conn: Conn, dsn: str, row: dict[str, str], state: str | None
) -> None:
    """It is refused, or answered: and the next question is, too."""
    load(conn, Scene("s"), [], [sail("T", (0.0, 0.0), (1.0, 0.0))])
    detect.detect(conn, "s", jobs=1)
    given = {"kind": "'probe'", "plans": f"'[{A_FEATURE}]'", "column": "is_current", "value": "NULL", **row}
    statement = REQUEST.format(**given).encode()
    with store.connect(dsn) as reader:
        reader.execute("SET ROLE conflictdb_reader")
        if state is not None:
            with pytest.raises(psycopg.Error) as refused:
                reader.execute(statement)
            assert refused.value.sqlstate == state
            reader.rollback()
            reader.execute("SET ROLE conflictdb_reader")
        else:
            reader.execute(statement)
        reader.commit()
        reader.execute("SELECT conflictdb.request_probe('s', 'SRID=4326;POLYGON((0 -1, 1 -1, 1 1, 0 1, 0 -1))')")
        reader.commit()
    answer_all(conn)
    left = "SELECT count(*) FROM conflictdb.probe_request WHERE answered_at IS NULL"
    assert conn.execute(left.encode()).fetchone() == (0,)


def test_a_request_has_no_more_values_than_a_worker_can_hold(conn: Conn) -> None:
    """Also where no limit of points counts them: a worker that runs out of memory would begin again, and again."""
    load(conn, Scene("s"), [], [])
    many = f"""('[{A_FEATURE[:-2]}, "x": [' || repeat('[],', 4000000) || '0]}}}}]')::json"""
    statement = REQUEST.format(kind="'probe'", plans=many, column="is_current", value="NULL")
    assert refused(conn, statement) == "ZC017"


def test_a_request_that_always_fails_is_refused_after_three_attempts(
    conn: Conn, dsn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And delays no other request meanwhile, of its scene or another."""
    load(conn, Scene("s"), [], [sail("T", (0.0, 0.0), (1.0, 0.0))])
    detect.detect(conn, "s", jobs=1)
    ids = []
    with store.connect(dsn) as reader:
        ids = [ask(reader, ASK, "s") for _ in range(2)]
    read, order = store.read_request, []

    def fails(conn: Conn, probe_id: int) -> store.Request:
        order.append(probe_id)
        if probe_id == ids[0]:
            conn.execute("SELECT 1 / 0")
        return read(conn, probe_id)

    monkeypatch.setattr(store, "read_request", fails)
    answer_all(conn)
    assert order == [ids[0], ids[1], ids[0], ids[0]]
    errors = conn.execute("SELECT error FROM conflictdb.probe_request ORDER BY probe_id").fetchall()
    assert "in three attempts: database: division by zero" in errors[0][0]
    assert errors[1] == (None,)


def test_a_role_may_ask_a_thousand_questions_at_a_time(conn: Conn) -> None:
    load(conn, Scene("s"), [], [])
    many = "SELECT count(conflictdb.request_probe('s', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))')) "
    conn.execute(f"{many} FROM generate_series(1, 1000)".encode())
    with pytest.raises(psycopg.Error, match=r"1000 questions of role .* wait already"):
        conn.execute(many.encode())


def test_a_request_whose_worker_is_always_killed_is_refused_after_three_attempts(
    conn: Conn, dsn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The attempt counts when it begins, so that no end of a process is missed; the next request is answered."""
    load(conn, Scene("s"), [], [sail("T", (0.0, 0.0), (1.0, 0.0))])
    detect.detect(conn, "s", jobs=1)
    with store.connect(dsn) as reader:
        ids = [ask(reader, ASK, "s") for _ in range(2)]
    read, killed = store.read_request, []

    def dies(worker: Conn, probe_id: int) -> store.Request:
        if probe_id == ids[0]:
            killed.append(probe_id)
            worker.close()
            raise SystemExit
        return read(worker, probe_id)

    monkeypatch.setattr(store, "read_request", dies)
    later = "UPDATE conflictdb.probe_request SET attempted_at = attempted_at - interval '2 s'"
    for _ in range(3):
        with store.connect(dsn) as worker, suppress(SystemExit):
            while probes.answer(worker):
                pass
        conn.execute(later)
        conn.commit()
    assert killed == [ids[0]] * 3
    answer_all(conn)
    assert killed == [ids[0]] * 3
    errors = conn.execute("SELECT error FROM conflictdb.probe_request ORDER BY probe_id").fetchall()
    assert "none of 3 attempts ended" in errors[0][0]
    assert errors[1] == (None,)


def test_two_workers_never_count_for_one_attempt(conn: Conn, dsn: str) -> None:
    """Also between the transaction that counts the attempt and the one that answers."""
    load(conn, Scene("s"), [], [])
    probe_id = ask(conn, ASK, "s")
    with store.connect(dsn) as one, store.connect(dsn) as two:
        claim = store.claim_probe(one, [])
        assert claim == (probe_id, 1)
        one.commit()
        assert store.claim_probe(two, []) is None
        two.commit()
        assert store.hold_probe(one, *claim)
        conn.rollback()
        assert store.claim_probe(two, []) is None
        two.rollback()
        store.release_probe(one, probe_id)
        one.commit()
        assert store.claim_probe(two, []) == (probe_id, 1)
        two.commit()
        assert not store.hold_probe(one, probe_id, 2)
        one.rollback()


def test_the_open_requests_of_a_role_have_a_bound_in_bytes(conn: Conn) -> None:
    """A thousand requests of 100 MB each would fill the disk; answered ones and those of other roles do not count."""
    load(conn, Scene("s"), [], [])
    conn.execute(ASK, ["s"])
    conn.execute("UPDATE conflictdb.probe_request SET bytes = 199999900")
    conn.commit()
    with pytest.raises(psycopg.Error, match=r"must have at most 200000000 bytes .* got 200000") as found:
        conn.execute(ASK, ["s"])
    assert found.value.sqlstate == "ZC017"
    conn.rollback()
    conn.execute("UPDATE conflictdb.probe_request SET answered_at = now()")
    asked = "SELECT bytes = octet_length(plans::text) FROM conflictdb.probe_request WHERE probe_id = %s"
    assert conn.execute(asked, [ask(conn, ASK, "s")]).fetchone() == (True,)


@draws("scenes", 30, 2000)
def test_a_plan_comes_through_a_request_to_the_last_bit(conn: Conn, scenes: int) -> None:
    load(conn, Scene("s"), [], [])
    for seed in range(scenes):
        _, *kinds = odd_scene(seed, Anywhere(north_deg=80.0))
        plans = [one for kind in kinds for one in kind]
        if not plans:
            continue
        with conn.transaction(force_rollback=True):
            number = store.request_probe(conn, "s", plans_text(plans))
            request = store.read_request(conn, number)
            assert (request.kind, request.scene) == ("probe", "s")
            assert request.plans is not None
            read = {one.key: one for one in read_plans(request.plans, Scene("s"))}
        assert len(read) == len(plans)
        assert {plan.key: lost(plan, read[plan.key]) for plan in plans} == {plan.key: [] for plan in plans}, seed


RULED = Scene("s", rules=(Rule("ferry", "area", separation_m=5000.0),))
FERRY = "ST_MakeEnvelope(4.0, 57.12, 4.2, 57.14, 4326)"


@pytest.mark.parametrize(
    ("options", "met"),
    [
        ("", ["FERRY"]),
        ("p_key => 'FERRY'", ["A"]),
        ("p_class => 'ferry'", ["A", "FERRY"]),
        ("p_key => 'FERRY', p_class => 'other'", []),
        ("p_key => 'FERRY', p_owner => 'them'", []),
        ("p_key => 'new', p_class => 'ferry', p_owner => 'line'", ["A"]),
        ("p_key => 'OWNED'", ["FERRY"]),
    ],
)
def test_questions_in_sql_have_class_and_owner(conn: Conn, dsn: str, options: str, met: list[str]) -> None:
    """Those of the object that the plan would replace, unless they are given."""
    load_ruled(conn)
    rest = f", {options}" if options else ""
    path = "conflictdb.track_path(ST_GeomFromText('LINESTRING(4 57.13, 4.2 57.13)', 4326), ARRAY['2026-12-03 08:00Z', "
    path += "'2026-12-03 09:00Z']::timestamptz[])"
    outline = "conflictdb.rectangle_outline(50, 50, 50, 50)"
    with answering(dsn):
        for question in (f"request_probe('s', {FERRY}{rest})", f"request_track_probe('s', {path}, {outline}{rest})"):
            rows = conn.execute(ANSWER, [ask(conn, f"SELECT conflictdb.{question}")]).fetchall()
            found = sorted(row[0] for row in rows)
            assert found == met, question


def load_ruled(conn: Conn) -> None:
    ship = rectangle_outline_m(50.0, 50.0, 50.0, 50.0)
    at = [datetime(2026, 12, 3, hour, tzinfo=UTC) for hour in (8, 9)]
    ferry = Track("FERRY", [(4.0, 57.13), (4.2, 57.13)], at, ship, object_class="ferry", owner="line")
    closed = Area("A", shapely.box(4.0, 57.0, 4.2, 57.1), owner="them")
    load(conn, RULED, [closed, Area("OWNED", shapely.box(9.0, 9.0, 9.1, 9.1), owner="x")], [ferry])
    detect.detect(conn, "s", jobs=1)


def test_several_plans_are_asked_about_in_sql(conn: Conn, dsn: str) -> None:
    load(conn, Scene("s"), [box("A", 0.4, -0.1, 0.6, 0.1), box("N", 5.0, 5.0, 6.0, 6.0)], [])
    detect.detect(conn, "s", jobs=1)
    plans = [box("N", 0.5, 0.0, 0.7, 0.2), box("P", 0.65, 0.1, 0.9, 0.3), box("far", 7.0, 7.0, 8.0, 8.0)]
    features = json.dumps([feature_of(one) | {"version": 1} for one in plans])
    with answering(dsn):
        number = ask(conn, "SELECT conflictdb.request_plans_probe('s', %s)", features)
        rows = conn.execute("SELECT plan_key, key, kind FROM conflictdb.wait_for_plans_probe(%s)", [number]).fetchall()
        assert sorted(rows) == [("N", "A", "area"), ("N", "P", "area")]
        assert sorted(row[0] for row in conn.execute(ANSWER, [number]).fetchall()) == ["A", "P"]


def test_sql_knows_the_members_of_plans(conn: Conn) -> None:
    """Properties of these names would be read as members."""
    row = conn.execute("SELECT conflictdb_internal._members_of_plans()").fetchone()
    assert row is not None
    assert set(row[0]) == AREA_MEMBERS | TRACK_MEMBERS


def test_an_answer_has_a_bounded_number_of_conflicts(conn: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans that all meet are refused before all their pairs are compared: from Python, by a worker and by `admit`."""
    load(conn, Scene("s"), [box(f"old {k}", 0.0, 0.0, 1.0, 1.0) for k in range(60)], [])
    detect.detect(conn, "s", jobs=1)
    plans = [box(f"{k}", 0.0, 0.0, 1.0, 1.0) for k in range(40)]
    compared: list[int] = []
    original = conflicts_between.run_scene

    def counted(*given: Any, **options: Any) -> Iterator[Any]:
        for part, funnel in original(*given, **options):
            compared.append(len(part))
            yield part, funnel

    monkeypatch.setattr(conflicts_between, "run_scene", counted)
    monkeypatch.setattr(conflicts_between, "MOST_REPLIES", 50)
    monkeypatch.setattr(conflicts_between, "_AT_ONCE", 30)
    message = "plans: have more than 50 conflicts, the most that one answer may have: ask about fewer plans at once"
    with connect(conn) as db:
        with pytest.raises(InvalidInput, match=message):
            db.scene("s").probe(plans)
        assert sum(compared) <= 80
        with pytest.raises(InvalidInput, match=message):
            db.scene("s").probe(plans[0])
        with pytest.raises(InvalidInput, match=message):
            db.scene("s").admit(plans)
        number = store.request_probe(conn, "s", plans_text(plans))
        conn.commit()
        answer_all(conn)
        with pytest.raises(InvalidInput, match=message):
            store.wait_for_probe(conn, Scene("s"), plans, number, timedelta(seconds=60))
        conn.rollback()
        monkeypatch.setattr(conflicts_between, "MOST_REPLIES", 60 * 40 + 40 * 39 // 2)
        assert len(db.scene("s").probe(plans)) == 60 * 40 + 40 * 39 // 2
