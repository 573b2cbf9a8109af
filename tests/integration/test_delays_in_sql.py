"""Delays requested in SQL: a worker answers with the result of `scene.delays`, to the role that requested it."""

import json
from datetime import timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
from patience import WAIT_S, answer_all
from psycopg import conninfo, sql
from scenes import T0_US, area, track
from shapely import box

from conflictdb import connect, store
from conflictdb.jobs import probes
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import Scene

Conn = psycopg.Connection[Any]

ASK = "SELECT conflictdb.request_delays('s', %s, %s)"
ANSWER = f"SELECT * FROM conflictdb.wait_for_delays(%s, '{WAIT_S:g} s')"


@pytest.fixture
def scene(conn: Conn) -> Conn:
    """Tracks that cross on the equator, another far away, and an area on the way of the first."""
    hour = 3_600
    tracks = [
        track("EAST", [(0.0, 0.0), (0.5, 0.0)], [0, hour], 100, 100, 50, 50),
        track("NORTH", [(0.25, -0.25), (0.25, 0.25)], [0, hour], 100, 100, 50, 50),
        track("FAR", [(20.0, 0.0), (20.5, 0.0)], [0, hour], 100, 100, 50, 50),
    ]
    store.replace_scene(conn, Scene("s"), [area("BAR", box(0.45, -0.01, 0.46, 0.01))], tracks, merge=False)
    conn.commit()
    return conn


def asked(conn: Conn, key: str | None, horizon: str | None = "2 hours") -> int:
    row = conn.execute(ASK, [key, horizon]).fetchone()
    assert row is not None
    conn.commit()
    return int(row[0])


def refused(conn: Conn, query: str, *values: Any) -> tuple[str | None, str]:
    with pytest.raises(psycopg.Error) as caught:
        conn.execute(query.encode(), values)
    conn.rollback()
    return caught.value.sqlstate, str(caught.value)


def answered(conn: Conn, dsn: str, probe_id: int) -> tuple[Any, ...]:
    with store.connect(dsn) as worker:
        answer_all(worker)
    row = conn.execute(ANSWER, [probe_id]).fetchone()
    conn.commit()
    assert row is not None
    return row


@pytest.mark.parametrize("is_detected", [False, True])
@pytest.mark.parametrize("key", ["EAST", "NORTH", "FAR"])
def test_a_worker_answers_as_python_does(scene: Conn, dsn: str, key: str, is_detected: bool) -> None:
    with connect(dsn) as db:
        if is_detected:
            db.scene("s").detect()
        (expected,) = db.scene("s").delays(key, within_s=7200.0)
    found = answered(scene, dsn, asked(scene, key))
    said = expected.as_json()
    assert found == (
        key,
        expected.least_later_s,
        expected.least_earlier_s,
        list(expected.blocked_by),
        [{**one, "by": list(one["by"])} for one in said["forbidden"]],
        *(said[name] for name in ("waits", "has_departed", "earliest_s", "latest_s")),
        *(expected.departs_at, 0.0, 0.0, None, None),
    )
    assert bool(found[4]) is (key != "FAR")
    assert found[3] == (["BAR"] if key == "EAST" else [])


def test_a_now_is_the_same_in_sql(scene: Conn, dsn: str) -> None:
    ask = "SELECT conflictdb.request_delays('s', 'NORTH', p_now => to_timestamp(%s))"
    with connect(dsn) as db:
        for now_s, is_offered in ((-7200, True), (-10, False), (1, False)):
            row = scene.execute(ask, [now_s + T0_US // 1_000_000]).fetchone()
            scene.commit()
            assert row is not None
            found = answered(scene, dsn, row[0])
            (expected,) = db.scene("s").delays("NORTH", now=np.datetime64(now_s * 1_000_000 + T0_US, "us"))
            said = expected.as_json()
            assert found[1:4] == (said["least_later_s"], said["least_earlier_s"], list(said["blocked_by"]))
            assert found[5:9] == (False, now_s > 0, said["earliest_s"], said["latest_s"])
            assert (found[2] is not None) == is_offered
    # A row that a reader inserts is answered.
    insert = "INSERT INTO conflictdb.probe_request (scene_id, kind, options) SELECT scene_id, 'delays', "
    insert += """'{"key": "NORTH", "horizon_s": 3600, "now_us": 1772236800000000}' FROM conflictdb.scene"""
    insert += " RETURNING probe_id"
    row = scene.execute(insert.encode()).fetchone()
    scene.commit()
    assert row is not None
    assert answered(scene, dsn, row[0])[5:9] == (False, False, -3600.0, 3600.0)
    state, text = refused(scene, "SELECT conflictdb.request_delays('s', 'NORTH', p_now => 'infinity')")
    assert (state, "now: must be an instant in the years 1 to 9999, or null; got infinity" in text) == (
        "ZC003",
        True,
    ), text


def test_margins_and_windows_are_those_of_python(scene: Conn, dsn: str) -> None:
    """Of a track and of an area; hostile options are refused."""
    scene.execute(
        "SELECT conflictdb.put_area('s', 'BAR', ST_MakeEnvelope(0.45, -0.01, 0.46, 0.01, 4326), "
        "tstzrange(to_timestamp(%s), to_timestamp(%s)))",
        [T0_US // 1_000_000, T0_US // 1_000_000 + 3600],
    )
    scene.commit()
    ask = "SELECT conflictdb.request_delays('s', %s, p_margin => '5 min', p_margin_m => 926, "
    ask += "p_from => to_timestamp(%s), p_to => to_timestamp(%s), p_best => 2)"
    start, end = (EPOCH + T0_US * MICROSECOND + timedelta(hours=hours) for hours in (-1, 4))
    for key in ("EAST", "BAR"):
        row = scene.execute(ask, [key, start.timestamp(), end.timestamp()]).fetchone()
        scene.commit()
        assert row is not None
        found = answered(scene, dsn, row[0])
        with connect(dsn) as db:
            (expected,) = db.scene("s").delays(key, margin_s=300.0, margin_m=926.0, start=start, end=end, best=2)
        said = json.loads(json.dumps(expected.as_json()))
        assert found[0] == key
        assert found[9:] == (expected.departs_at, 300.0, 926.0, said["slots"], said["closed"])
        assert found[12]
        assert found[13]
    refusals: tuple[tuple[str, str], ...] = (
        ("p_margin => '-1 s'", "ZC003"),
        ("p_margin => '200 years'", "ZC003"),
        ("p_margin_m => -1", "ZC003"),
        ("p_margin_m => 'NaN'", "ZC016"),
        ("p_margin_m => 'infinity'", "ZC016"),
        ("p_from => 'infinity'", "ZC016"),
        ("p_best => 0", "ZC003"),
    )
    for options, expected_state in refusals:
        found_state, text = refused(scene, f"SELECT conflictdb.request_delays('s', 'EAST', {options})")
        assert found_state == expected_state, text


def test_what_cannot_be_asked_is_refused(scene: Conn, dsn: str) -> None:
    """Unknown tracks, areas, and horizons that are negative, endless or absent; a removed track when it is answered."""
    for key, horizon, state, says in (
        ("WEST", "2 hours", "ZC011", "object 'WEST': key: is not a track or an area of scene 's'"),
        (None, "2 hours", "ZC011", "object NULL"),
        ("EAST", "-1 second", "ZC003", "horizon: must be an interval"),
        ("EAST", "200 years", "ZC003", "horizon"),
        ("EAST", None, "ZC003", "horizon"),
    ):
        found, text = refused(scene, ASK, key, horizon)
        assert (found, says in text) == (state, True), text
    probe_id = asked(scene, "EAST")
    scene.execute("SELECT conflictdb.remove_object('s', 'EAST')")
    scene.commit()
    with store.connect(dsn) as worker:
        probes.answer(worker)
    state, text = refused(scene, ANSWER, probe_id)
    assert state == "ZC016"
    assert "'EAST' is not known" in text


def test_each_question_has_its_own_answer(scene: Conn, dsn: str) -> None:
    """Requests for delays are no probes without conflicts, and a probe has no delays."""
    probe_id = asked(scene, "EAST")
    answered(scene, dsn, probe_id)
    assert refused(scene, "SELECT * FROM conflictdb.wait_for_probe(%s)", probe_id)[0] == "ZC011"
    row = scene.execute("SELECT conflictdb.request_probe('s', ST_MakeEnvelope(9, 9, 10, 10, 4326))").fetchone()
    scene.commit()
    assert row is not None
    assert refused(scene, ANSWER, row[0])[0] == "ZC011"


def test_readers_ask_and_only_they_see_the_answer(scene: Conn, dsn: str) -> None:
    """Nobody writes a reply but workers."""
    users = [f"{name}_{scene.info.dbname}" for name in ("asker", "other")]
    for user in users:
        scene.execute(sql.SQL("CREATE ROLE {} LOGIN IN ROLE conflictdb_reader").format(sql.Identifier(user)))
    scene.commit()
    opened = [psycopg.connect(conninfo.make_conninfo(dsn, user=user)) for user in users]
    try:
        probe_id = asked(opened[0], "NORTH")
        assert answered(opened[0], dsn, probe_id)[0] == "NORTH"
        assert refused(opened[1], ANSWER, probe_id)[0] == "ZC011"
        forged = "INSERT INTO conflictdb.probe_request (scene_id, kind, options, answer) SELECT scene_id, 'delays', "
        forged += """'{"key": "EAST", "horizon_s": 3600}', '{}' FROM conflictdb.scene"""
        assert refused(opened[1], forged)[0] == "ZC013"
    finally:
        for one in opened:
            one.close()
        for user in users:
            scene.execute(sql.SQL("DROP ROLE {}").format(sql.Identifier(user)))
        scene.commit()
