"""A separation in time counts wherever conflicts do: in the database, in its questions and explanations."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from layouts import EQUATOR, LOW_LATITUDE
from mixed_scenes import plain_scene
from piecework import load

from conflictdb import (
    Area,
    Conflict,
    InvalidInput,
    Scene,
    Track,
    connect,
    delays,
    rectangle_outline_m,
    solve,
    speeds,
    store,
)
from conflictdb.jobs import probes
from conflictdb.jobs.detect import detect

Conn = psycopg.Connection[Any]
T0_US = 1_772_323_200_000_000
HERE = "ST_MakeEnvelope(0.4, -0.1, 0.6, 0.1, 4326)"


def track(key: str, *way: tuple[float, float], after_s: float = 0.0) -> Track:
    times = T0_US + round(1e6 * after_s) + 3_600_000_000 * np.arange(len(way))
    return Track(key, np.array(way), times, rectangle_outline_m(50, 50, 20, 20))


FERRY, LATER = track("FERRY", (0.0, 0.0), (1.0, 0.0)), track("LATER", (0.5, -0.5), (0.5, 0.5), after_s=250.0)
ZONE = Area("ZONE", shapely.box(0.4, -0.1, 0.6, 0.1), None, None, T0_US)


def found(conn: Conn) -> list[Conflict]:
    rows = sorted(store.conflicts(conn, "s"), key=lambda one: (one.a_kind.code, one.a_key, one.b_key))
    conn.commit()
    return rows


def same(stored: list[Conflict], solved: list[Conflict]) -> bool:
    """Whether two lists tell the same of their pairs."""

    def compared(one: Conflict) -> tuple[object, ...]:
        return one.a_key, one.b_key, one.verdict, one.periods, one.time_error_s, one.lacking_s, one.first_contact_deg

    return list(map(compared, stored)) == list(map(compared, solved))


def test_it_stays_with_the_scene_and_recomputes_it(conn: Conn) -> None:
    """Detection of all, and of the few that change; the same as `solve`; 0 is as before."""
    load(conn, Scene("s"), [ZONE], [FERRY, LATER])
    detect(conn, "s")
    assert found(conn) == []
    conn.execute("SELECT conflictdb.create_scene('s', p_time_separation_s => 1500)")
    conn.commit()
    detect(conn, "s")
    scene = store.scene_settings(conn, "s")
    assert scene == Scene("s", time_separation_s=1500.0)
    first = found(conn)
    assert {(one.a_key, one.b_key) for one in first} == {("ZONE", "FERRY"), ("FERRY", "LATER")}
    assert same(first, list(solve([FERRY, LATER], [ZONE], scene)))
    row = conn.execute("SELECT lacking_s FROM conflictdb.conflicts WHERE a_key = 'FERRY'").fetchone()
    assert row == (first[1].lacking_s,)
    conn.commit()
    earlier = replace(LATER, times_us=LATER.times_us + 900_000_000)
    store.replace_scene(conn, scene, [ZONE], [FERRY, earlier], merge=False)
    detect(conn, "s")
    second = found(conn)
    assert same(second, list(solve([FERRY, earlier], [ZONE], scene)))
    assert second[1].lacking_s == pytest.approx(first[1].lacking_s - 900.0, abs=1e-4)  # type: ignore[operator]
    conn.commit()
    with connect(conn) as db:
        db.scene("s").detect(time_separation_s=0.0)
    assert found(conn) == []


@pytest.mark.parametrize("workload", [EQUATOR, LOW_LATITUDE], ids=lambda one: one.name)
def test_the_database_answers_as_memory_does(conn: Conn, workload: Any) -> None:
    """Random scenes with areas that are there for a while; a probe of each plan, too."""
    scene, areas, tracks = plain_scene(workload, 4, 6, 8)
    areas = [
        replace(one, start_us=T0_US + k * 10**9, end_us=T0_US + 3 * k * 10**9 + 10**9) for k, one in enumerate(areas)
    ]
    scene = replace(scene, name="s", time_separation_s=2700.0)
    load(conn, scene, areas, tracks)
    detect(conn, "s")
    expected = list(solve(tracks, areas, scene))
    assert same(found(conn), expected)
    assert any(one.lacking_s not in (None, 2700.0) for one in expected)
    for plan in [*areas[:3], *tracks[:3]]:
        of_plan = [one for one in expected if plan.key in (one.a_key, one.b_key)]
        assert same(
            sorted(probes.probe(conn, "s", [plan]), key=lambda one: (one.a_kind.code, one.a_key, one.b_key)), of_plan
        )
    rows = conn.execute("SELECT a_key, b_key, spans FROM conflictdb.candidates('s')").fetchall()
    spans = {(a, b): span for a, b, span in rows}
    for one in expected:
        span = spans[one.a_key, one.b_key]
        for start, end in one.periods:
            assert any(part.lower <= start and end <= part.upper for part in span)


def test_a_region_that_only_the_database_computes(conn: Conn) -> None:
    """From the hulls of pieces that come within that time, whose spans do not meet."""
    load(conn, Scene("s", time_separation_s=1500.0), [ZONE], [FERRY, LATER])
    detect(conn, "s")
    rows = conn.execute(
        """SELECT ST_Covers(conflictdb_internal._conflict_region(c.scene_id, c.a_kind, c.a_id, c.a_version, c.b_kind,
                            c.b_id, c.b_version, c.periods, 'wgs84'), c.first_contact_point)
           FROM conflictdb.conflict c"""
    ).fetchall()
    assert rows == [(True,), (True,)]


def test_questions_of_sql_know_it(conn: Conn) -> None:
    load(conn, Scene("s", time_separation_s=600.0), [], [FERRY])
    detect(conn, "s")
    leaves = datetime(2026, 3, 1, 0, 36, tzinfo=UTC)
    for begins, keys in ((leaves + timedelta(seconds=599), ["FERRY"]), (leaves + timedelta(seconds=2041), [])):
        ask = f"SELECT key, spans FROM conflictdb.probe('s', {HERE}, tstzrange(%s, NULL))"
        rows = conn.execute(ask.encode(), [begins]).fetchall()
        assert [key for key, _ in rows] == keys
    asked = f"SELECT conflictdb.request_probe('s', {HERE}, tstzrange(%s, NULL))"
    row = conn.execute(asked.encode(), [datetime(2026, 3, 1, 0, 40, tzinfo=UTC)]).fetchone()
    conn.commit()
    probes.answer(conn)
    assert row is not None
    [reply] = conn.execute("SELECT key, verdict, lacking_s FROM conflictdb.wait_for_probe(%s)", row).fetchall()
    zone = replace(ZONE, start_us=T0_US + 2_400_000_000, end_us=None)
    [solved] = solve([FERRY], [zone], Scene("s", time_separation_s=600.0))
    assert reply == ("FERRY", "conflict", solved.lacking_s)


def test_explanations_say_how_late_it_is(conn: Conn) -> None:
    """And how late it must be; that two are never there together; what would clear it."""
    late = track("LATE", (1.0, 0.0), (0.0, 0.0), after_s=3850.0)
    load(conn, Scene("s", time_separation_s=300.0), [replace(ZONE, end_us=T0_US - 10**9)], [FERRY, late])
    detect(conn, "s")
    [row] = found(conn)
    with connect(conn) as db:
        explanation = db.scene("s").explain("FERRY", "LATE")
        gone = db.scene("s").explain("ZONE", "FERRY")
    assert explanation.facts["lacking_s"] == row.lacking_s
    late_s = 300.0 - (row.lacking_s or 0.0)
    assert (
        explanation.facts["why"]
        == f"one uses a place {int(late_s // 60)} min {late_s % 60:g} s after the other; 5 min are required"
    )
    assert explanation.facts["are_never_together"]
    assert "closest: never there at the same time and height" in explanation.text
    assert gone.facts["decided_by"] == {"stage": 1, "by": "time"}
    assert gone.facts["why"].endswith(": 5 min or more apart")
    assert explanation.facts["settings"]["time_separation_s"] == 300.0


def test_delays_are_those_of_a_wider_conflict(conn: Conn) -> None:
    """By exactly the separation in time, and the least delay leaves no conflict."""
    load(conn, Scene("s", time_separation_s=600.0), [ZONE], [FERRY, LATER])
    with connect(conn) as db:
        [wide] = db.scene("s").delays("FERRY", within_s=7200.0)
        [slower] = db.scene("s").speeds("FERRY")
    assert [slower] == speeds([FERRY, LATER], [ZONE], Scene("s", time_separation_s=600.0), "FERRY")
    [plain] = delays([FERRY, LATER], [ZONE], Scene("s"), "FERRY", 9000.0)
    low, high = plain.forbidden[-1].from_s, plain.forbidden[-1].to_s
    assert (wide.forbidden[-1].from_s, wide.forbidden[-1].to_s) == (round(low - 600.0, 6), round(high + 600.0, 6))
    assert wide.least_later_s == pytest.approx(high + 600.000001, abs=1e-9)
    later = replace(FERRY, times_us=FERRY.times_us + round(1e6 * (wide.least_later_s or 0.0)))
    assert solve([later, LATER], [ZONE], Scene("s", time_separation_s=600.0)) == []
    sooner = replace(later, times_us=later.times_us - 5000)
    assert len(solve([sooner, LATER], [ZONE], Scene("s", time_separation_s=600.0, tolerance_m=0.0))) <= 1


@pytest.mark.parametrize("value", ["-1", "'NaN'", "'Infinity'", "2592000.5", "1e-7"])
def test_other_values_are_refused(conn: Conn, value: str) -> None:
    with pytest.raises(
        psycopg.Error, match="time_separation_s: must be whole microseconds, 0 to 2592000 seconds"
    ) as refused:
        conn.execute(f"SELECT conflictdb.create_scene('s', p_time_separation_s => {value})".encode())
    assert refused.value.sqlstate == "ZC009"


def test_the_published_program_is_refused_in_one_message(conn: Conn) -> None:
    load(conn, Scene("s", time_separation_s=60.0), [], [FERRY])
    conn.commit()
    with connect(conn) as db, pytest.raises(InvalidInput, match="time_separation_s: is not known to method 'nlp'"):
        db.scene("s").detect(method="nlp")


def test_permanent_and_endless_areas(conn: Conn) -> None:
    """Of a whole scene and of few changes, with the largest setting."""
    areas = [
        replace(ZONE, key="EVER", end_us=None),
        replace(ZONE, key="PAST", start_us=None, end_us=T0_US - 10**12),
        replace(ZONE, key="NEXT", start_us=T0_US + 10**12, end_us=None),
    ]
    scene = Scene("s", time_separation_s=2_592_000.0)
    load(conn, scene, areas, [FERRY])
    detect(conn, "s")
    expected = list(solve([FERRY], areas, scene))
    assert len(expected) == 6
    assert same(found(conn), expected)
    conn.execute("UPDATE conflictdb.area SET floor_m = 0 WHERE key = 'PAST'")
    conn.commit()
    detect(conn, "s")
    assert same(found(conn), expected)
