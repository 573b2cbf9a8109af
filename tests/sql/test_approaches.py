"""The view approaches, and results that near pairs do not affect."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
import scenes
import shapely
from patience import WAIT_S
from scenes import T0_US

from conflictdb import store
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import EarthModel, Scene

Conn = psycopg.Connection[Any]
METRES = np.radians(scenes.RADIUS_M[EarthModel.SPHERE])
SCENE = Scene("s", earth=EarthModel.SPHERE, nearest_m=5_000.0)
BOX = scenes.area("BOX", shapely.box(0.5, 0.02, 0.6, 0.1))
FAR = scenes.area("FAR", shapely.box(0.5, 1.02, 0.6, 1.1))
UNDER = scenes.track("under", [(0.0, 0.0), (1.0, 0.0)], [0, 3600], 0, 0, 0, 0)
THROUGH = scenes.track("through", [(1.0, 0.05), (0.0, 0.05)], [0, 3600], 0, 0, 0, 0)


@pytest.fixture
def planned(conn: Conn) -> Conn:
    """A scene of two tracks: one passes below an area and the other through it."""
    store.replace_scene(conn, SCENE, [BOX, FAR], [UNDER, THROUGH], merge=False)
    detect(conn, "s", jobs=1)
    conn.execute("SET search_path = conflictdb, conflictdb_internal, public")
    return conn


def rows(conn: Conn, query: str, *values: object) -> list[tuple[Any, ...]]:
    return conn.execute(query.encode(), values).fetchall()


def test_view_shows_conflicts_and_near_pairs_with_their_closest_approach(planned: Conn) -> None:
    columns = [column.name for column in planned.execute("SELECT * FROM approaches").description or ()]
    assert columns == [
        *("scene", "a_key", "a_kind", "b_key", "b_kind", "closest_at", "closest_m", "closest_error_m"),
        *("a_point", "b_point", "verdict", "is_current", "run_id", "found_at", "scene_is_current"),
        *("method", "time_error_s", "a_name", "b_name"),
    ]
    found = rows(
        planned,
        """SELECT scene, a_key, a_kind, b_key, b_kind, extract(epoch FROM closest_at)::float8, closest_m,
                  closest_error_m, ST_X(a_point), ST_Y(a_point), ST_X(b_point), ST_Y(b_point), verdict, is_current
           FROM approaches ORDER BY b_key""",
    )
    by_pair = {(row[1], row[3]): row for row in found}
    assert set(by_pair) == {("BOX", "through"), ("BOX", "under")}
    assert by_pair["BOX", "under"][:5] == ("s", "BOX", "area", "under", "track")
    near = by_pair["BOX", "under"]
    assert near[5] - T0_US / 1e6 == pytest.approx(1800.0, abs=0.01)
    assert near[6:8] == (pytest.approx(0.02 * METRES, abs=1e-3), pytest.approx(0.0, abs=0.05))
    assert near[8:12] == pytest.approx((0.5, 0.02, 0.5, 0.0), abs=1e-4)
    assert near[12:] == ("near", True)
    meets = by_pair["BOX", "through"]
    assert meets[5] - T0_US / 1e6 == pytest.approx(0.4 * 3600, abs=0.01)
    assert meets[6:8] == (0.0, 0.0)
    assert meets[8:12] == pytest.approx((0.6, 0.05, 0.6, 0.05), abs=1e-6)
    assert meets[12:] == ("conflict", True)


def test_near_pairs_are_no_conflicts(planned: Conn) -> None:
    assert rows(planned, "SELECT a_key, b_key, closest_m FROM conflicts") == [("BOX", "through", 0.0)]
    assert rows(planned, "SELECT b_key FROM conflicts_of('s', 'under')") == []
    assert rows(planned, "SELECT conflicts, opened, changed, closed FROM run") == [(1, 1, 0, 0)]
    assert rows(planned, "SELECT conflicts FROM _scenes()") == [(1,)]
    assert rows(planned, "SELECT verdict, isempty(periods) FROM conflict WHERE b_key = 'under' AND a_key = 'BOX'") == [
        ("near", True)
    ]


def test_approaches_of_an_object(planned: Conn) -> None:
    assert ("BOX", "near") in rows(planned, "SELECT a_key, verdict FROM approaches_of('s', 'under')")
    assert rows(planned, "SELECT a_key FROM approaches_of('s', 'FAR')") == []
    with pytest.raises(psycopg.Error) as refused:
        rows(planned, "SELECT a_key FROM approaches_of('nowhere', 'FAR')")
    assert refused.value.sqlstate == "ZC010"


def test_what_comes_and_goes_between_near_and_conflict_is_counted_as_conflicts_are(conn: Conn, dsn: str) -> None:
    """A near pair that becomes a conflict opens it, and is found then; a pair that was near from the start does not."""
    scene = replace(SCENE, name="t")
    store.replace_scene(conn, scene, [BOX], [UNDER], merge=False)
    assert (detect(conn, "t", jobs=1).opened, detect(conn, "t", jobs=1).conflicts) == (0, 0)
    first = store.approaches(conn, "t")[0]
    with psycopg.connect(dsn, autocommit=True) as listener:
        listener.execute("LISTEN conflictdb")
        store.replace_scene(conn, scene, [BOX], [replace(THROUGH, key="under")], merge=False)
        run = detect(conn, "t", jobs=1)
        notification = next(listener.notifies(timeout=WAIT_S, stop_after=1))
    assert (run.opened, run.changed, run.closed, run.conflicts) == (1, 0, 0, 1)
    assert json.loads(notification.payload) == {"scene": "t", "run": run.run_id, "opened": 1, "changed": 0, "closed": 0}
    (conflict,) = store.conflicts(conn, "t")
    assert conflict.found_at > first.found_at
    store.replace_scene(conn, scene, [BOX], [UNDER], merge=False)
    run = detect(conn, "t", jobs=1)
    assert (run.opened, run.changed, run.closed, run.conflicts) == (0, 0, 1, 0)
    assert [row.verdict for row in store.approaches(conn, "t")] == ["near"]


def test_asking_for_less_removes_near_pairs_and_marks_everything(planned: Conn) -> None:
    planned.execute("SELECT create_scene('s', p_nearest_m => 0)")
    assert rows(planned, "SELECT bool_or(is_current) FROM approaches") == [(False,)]
    planned.commit()
    run = detect(planned, "s", jobs=1)
    assert (run.opened, run.changed, run.closed) == (0, 0, 0)
    assert rows(planned, "SELECT a_key, b_key FROM approaches") == [("BOX", "through")]


def test_nearest_m_must_be_a_distance(conn: Conn) -> None:
    for value in ("-1", "NaN", "Infinity"):
        with pytest.raises(psycopg.Error) as refused, conn.transaction():
            conn.execute("SELECT conflictdb.create_scene('s', p_nearest_m => %s::float8)", [value])
        assert (refused.value.sqlstate, refused.value.diag.constraint_name) == ("ZC009", "scene_nearest_finite")


def test_areas_that_are_always_there_are_closest_at_no_instant(conn: Conn) -> None:
    beside = scenes.area("BESIDE", shapely.box(0.61, 0.02, 0.7, 0.1))
    store.replace_scene(conn, SCENE, [BOX, beside], [], merge=False)
    detect(conn, "s", jobs=1)
    (one,) = store.approaches(conn, "s")
    assert (one.closest_at, one.verdict) == (None, "near")
    assert one.closest_m == pytest.approx(0.01 * METRES * np.cos(np.radians(0.1)), abs=0.01)
    assert one.a_deg[0] == pytest.approx(0.61, abs=1e-6)


def test_approaches_tell_how_they_were_found_and_near_ones_can_be_asked_for_alone(planned: Conn) -> None:
    near, meets = sorted(store.approaches(planned, "s"), key=lambda one: one.verdict != "near")
    assert (near.method, near.time_error_s) == ("exact", 0.0)
    (conflict,) = store.conflicts(planned, "s")
    assert (meets.method, meets.time_error_s) == (conflict.method, conflict.time_error_s)
    assert meets == conflict.approach
    assert list(store.each_approach(planned, "s", only_near=True)) == [near]
