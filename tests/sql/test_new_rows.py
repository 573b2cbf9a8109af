"""Many new conflicts are copied into their tables: the rows are those that the statement writes."""

import json
from itertools import takewhile
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from patience import WAIT_S
from piecework import load
from scenes import T0_US

from conflictdb import store
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m
from conflictdb.store import write_rows

Conn = psycopg.Connection[Any]

ALL_BY_STATEMENT = 10**9
HOSTILE = ["A0", "a'\"\\", "zwei\nZeilen\t", "Ünïcode \U0001f6a2", "x" * 990, "{}", "[1, 2]"]
ROWS = """
SELECT a_key, a_kind, b_key, b_kind, periods, verdict, ST_AsEWKT(region), ST_AsEWKT(first_contact_point), method,
       time_error_s, is_current, found_at = opened_at, closest_at, closest_m, closest_error_m,
       ST_AsEWKT(closest_a_point), ST_AsEWKT(closest_b_point), changed_at
FROM conflictdb.conflicts WHERE scene = %s ORDER BY a_key, b_key
"""
NEAR = "SELECT a_key, b_key, closest_m, verdict FROM conflictdb.approaches WHERE scene = %s ORDER BY a_key, b_key"
EVENTS = """
SELECT e.kind, e.at = e.opened_at, c.found_at = e.at, e.run_id = c.run_id, e.a_kind, e.a_key, e.b_kind, e.b_key,
       e.periods = c.periods, e.verdict, e.time_error_s, e.closest_at, e.closest_m, e.closest_error_m
FROM conflictdb.conflict_event e JOIN conflictdb.scene s USING (scene_id)
JOIN conflictdb.conflict c USING (scene_id, conflict_id) WHERE s.name = %s ORDER BY e.a_key, e.b_key
"""


def crossing() -> tuple[list[Area], list[Track]]:
    """Return areas that overlap, and tracks that cross them or pass outside, under keys of all kinds."""
    areas = [
        Area(key, shapely.MultiPolygon([shapely.box(0.1 * k, 50, 0.1 * k + 0.3, 50.2)]), start_us=T0_US + k)
        for k, key in enumerate(HOSTILE)
    ]
    times = np.array([T0_US, T0_US + 3_600_000_000])
    tracks = [
        Track(f"{key}'", np.array([[0.0, 50.02 * 1.001**k], [1.0, 50.1]]), times, rectangle_outline_m(50, 50, 50, 50))
        for k, key in enumerate(HOSTILE[1:])
    ]
    return areas, tracks


def rows_of(conn: Conn, query: str, scene: str) -> list[tuple[Any, ...]]:
    return conn.execute(query.encode(), [scene]).fetchall()


def test_copied_rows_are_those_of_the_statement(conn: Conn, dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows, events, the run and notifications, also of pairs that are only near."""
    heard, runs = {}, {}
    for name, many in (("copied", 1), ("stated", ALL_BY_STATEMENT)):
        with psycopg.connect(dsn, autocommit=True) as listener:
            listener.execute("LISTEN conflictdb_event; LISTEN conflictdb")
            monkeypatch.setattr(write_rows, "_MANY_NEW", many)
            load(conn, Scene(name, nearest_m=20_000.0), *crossing())
            run = detect(conn, name, jobs=1)
            runs[name] = (run.opened, run.changed, run.closed, run.conflicts, run.unresolved)
            one = list(takewhile(lambda n: n.channel == "conflictdb_event", listener.notifies(timeout=WAIT_S)))
            heard[name] = [json.loads(n.payload) for n in one]
    assert runs["copied"] == runs["stated"]
    for query in (ROWS, NEAR, EVENTS):
        rows = rows_of(conn, query, "copied")
        assert rows == rows_of(conn, query, "stated")
        assert len(rows) > 10
    assert len(rows_of(conn, NEAR, "copied")) > len(rows_of(conn, ROWS, "copied"))
    numbers: dict[str, list[tuple[Any, ...]]] = {}
    for name, payloads in heard.items():
        assert {(n["scene"], n["kind"]) for n in payloads} == {(name, "opened")}
        numbers[name] = [tuple(event) for n in payloads for event in n["events"]]
        known = {
            event_id: keys
            for event_id, *keys in conn.execute(
                """SELECT conflict_event_id, a_key, b_key FROM conflictdb.conflict_event JOIN conflictdb.scene
                   USING (scene_id) WHERE name = %s""",
                [name],
            )
        }
        assert sorted(event[0] for event in numbers[name]) == sorted(known)
        assert all(list(event[1:]) in ([], known[event[0]]) for event in numbers[name])
    # Those of long keys by their number alone.
    assert len({tuple(map(len, sorted(events, key=len))) for events in numbers.values()}) == 1
    assert {len(event) for event in numbers["copied"]} == {1, 3}


def test_copied_rows_have_numbers_that_grow(conn: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Conflicts and events, in parts of five rows."""
    monkeypatch.setattr(write_rows, "_MANY_NEW", 1)
    monkeypatch.setattr(write_rows, "_ROWS_AT_ONCE", 5)
    load(conn, Scene("s"), *crossing())
    run = detect(conn, "s", jobs=1)
    ids = conn.execute(
        "SELECT conflict_event_id, conflict_id FROM conflictdb.conflict_event ORDER BY conflict_event_id"
    ).fetchall()
    assert len(ids) == len(set(ids)) == run.opened > 20
    assert ids == sorted(ids, key=lambda one: one[1])
    (known,) = store.runs(conn, "s")
    assert (known.conflicts, known.unresolved) == (run.conflicts, run.unresolved) == (run.opened, 0)


def test_workers_of_protected_scenes_write_by_the_statement(conn: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Row-level security forbids COPY: the rows are written all the same."""
    monkeypatch.setattr(write_rows, "_MANY_NEW", 1)
    for name in ("bare", "protected"):
        load(conn, Scene(name), *crossing())
    detect(conn, "bare", jobs=1)
    conn.execute("SELECT conflictdb.protect_scenes()")
    conn.execute("SET ROLE conflictdb_worker")
    conn.commit()
    run = detect(conn, "protected", jobs=1)
    conn.execute("RESET ROLE")
    assert run.opened > 0
    for query in (ROWS, EVENTS):
        assert rows_of(conn, query, "protected") == rows_of(conn, query, "bare")
