"""A scene loaded after the last ANALYZE looks small to the planner; no routine may then compare all with all.

The measure is the number of rows that plans threw away, not time: a nested loop over n objects throws away n squared.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from databases import TestServer
from piecework import load, mark_all, refresh, write_run

from conflictdb import store
from conflictdb.arrays.answers import Conflicts
from conflictdb.core.near import Question
from conflictdb.jobs.admission import admit
from conflictdb.jobs.detect import detect
from conflictdb.jobs.probes import probe
from conflictdb.jobs.sources import Stored
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m
from conflictdb.model.rules import Rule

Conn = psycopg.Connection[Any]

COUNT = 320  # its square is eight times what the plans of a scene may throw away
T0_US = 1_772_323_200_000_000


def grid(changed: bool = False) -> list[Area]:
    """Return areas side by side, each meeting the next."""
    floor = 0.0 if changed else None
    west = [(0.02 * (i % 100), 0.02 * (i // 100)) for i in range(COUNT)]
    return [
        Area(f"A{i}", shapely.MultiPolygon([shapely.box(x, y, x + 0.021, y + 0.019)]), floor_m=floor)
        for i, (x, y) in enumerate(west)
    ]


def neighbours(conn: Conn) -> Conflicts:
    """Return conflicts of every object with the next, as a detection might find them."""
    rows = conn.execute(
        "SELECT area_id, version FROM conflictdb.area ORDER BY area_id DESC LIMIT %s", [COUNT]
    ).fetchall()
    ids, versions = np.array(rows, dtype=np.int64).T
    zeros = np.zeros(COUNT - 1, np.int8)  # areas, in conflict
    a, b = (zeros, ids[:-1], versions[:-1]), (zeros, ids[1:], versions[1:])
    return Conflicts.of_members(a, b, (np.tile([T0_US, T0_US + 1], (len(zeros), 1)), np.arange(COUNT)), zeros)


def worst_waste(plan: dict[str, Any]) -> float:
    """Return the most rows that any node of a plan threw away."""
    own = sum(
        plan.get(name, 0) * plan.get("Actual Loops", 1)
        for name in ("Rows Removed by Join Filter", "Rows Removed by Filter", "Rows Removed by Index Recheck")
    )
    return max([own, *(worst_waste(child) for child in plan.get("Plans", []))])


def most_read(plan: dict[str, Any]) -> float:
    """Return the most rows that any node of a plan handed on."""
    return max([plan["Actual Rows"] * plan["Actual Loops"], *(most_read(child) for child in plan.get("Plans", []))])


def starts_workers(plan: dict[str, Any]) -> bool:
    """Return whether any node of a plan starts parallel workers."""
    return plan["Node Type"].startswith("Gather") or any(map(starts_workers, plan.get("Plans", [])))


@pytest.fixture
def plans(conn: Conn) -> list[dict[str, Any]]:
    """Return a list that the plans of all statements, also inside routines, are added to."""
    try:
        conn.execute("LOAD 'auto_explain'")
    except psycopg.Error:
        pytest.skip("did not run: the server has no auto_explain")
    for setting, value in {
        "log_min_duration": "0", "log_nested_statements": "on", "log_analyze": "on", "log_timing": "off",
        "log_format": "json",
    }.items():  # fmt: skip
        conn.execute(f"SET auto_explain.{setting} = {value}".encode())
    conn.execute("SET client_min_messages = log")
    # As on a solid-state disk: by the default, 4, bitmaps are cheaper, and count rows that are gone.
    conn.execute("SET random_page_cost = 1.1")
    conn.commit()
    found: list[dict[str, Any]] = []

    def keep(diagnostic: psycopg.errors.Diagnostic) -> None:
        _, _, text = (diagnostic.message_primary or "").partition("plan:\n")
        if text:
            plan = json.loads(text)
            found.append(
                {
                    "query": plan["Query Text"],
                    "waste": worst_waste(plan["Plan"]),
                    "read": most_read(plan["Plan"]),
                    "parallel": starts_workers(plan["Plan"]),
                    "plan": json.dumps(plan["Plan"]),
                }
            )

    conn.add_notice_handler(keep)
    return found


def times_taken_apart(plan: dict[str, Any]) -> int:
    """Return the number of calls of functions in FROM, which unnest rows of pieces."""
    own = plan["Actual Loops"] if plan["Node Type"] == "Function Scan" else 0
    return own + sum(times_taken_apart(child) for child in plan.get("Plans", []))


def test_rows_of_pieces_are_taken_apart_once_for_each_row_that_they_meet(conn: Conn) -> None:
    """And not for each of its pieces: a row of a ship at anchor has up to sixty-four."""
    swings = np.array([[0.0, 4e-4 * (i % 2)] for i in range(51)])
    minutes_us = 60_000_000 * np.arange(51)
    ships = [
        Track(key, np.add(swings, (2e-5 * i, 0.0)), minutes_us, rectangle_outline_m(50.0, 50.0, 10.0, 10.0))
        for i, key in enumerate(("A", "B", "C"))
    ]
    refresh(conn, load(conn, Scene("harbour"), [], ships))
    assert conn.execute("SELECT count(*), sum(pieces) FROM conflictdb.piece").fetchone() == (3, 150)
    asked = "EXPLAIN (ANALYZE, TIMING off, FORMAT JSON) SELECT * FROM conflictdb.candidates('harbour')"
    (((explained,),),) = conn.execute(asked).fetchall()
    assert explained["Plan"]["Actual Rows"] == 3
    # Both rows of three pairs.
    assert times_taken_apart(explained["Plan"]) == 6


def test_scene_that_statistics_do_not_know_is_handled_without_comparing_all_with_all(
    conn: Conn, plans: list[dict[str, Any]]
) -> None:
    first = load(conn, Scene("first"), grid(), [])
    refresh(conn, first)
    conn.execute("ANALYZE")
    conn.commit()
    conn.execute("ALTER TABLE conflictdb.piece SET (autovacuum_enabled = off)")
    conn.commit()

    scene_id = load(conn, Scene("second"), grid(), [])
    for areas in (grid(), grid(changed=True)):
        store.replace_scene(conn, Scene("second"), areas, [], merge=False)
        refresh(conn, scene_id)
        store.begin_snapshot(conn)
        for _ in Stored(conn, scene_id).pairs(Question()):
            pass
        write_run(conn, scene_id, store.RunRecord("nlp", {}, datetime.now(UTC)), neighbours(conn))
        conn.commit()
        conn.execute("SELECT count(*) FROM conflictdb.candidates('second')")
        everywhere = "ST_SetSRID(ST_MakeEnvelope(0, 0, 2, 2), 4326), '(,)'"
        conn.execute(f"SELECT count(*) FROM conflictdb.conflicts_within('second', {everywhere})".encode())
        conn.commit()
        store.conflicts(conn, "second")
    conn.execute(
        """INSERT INTO conflictdb.area (scene_id, key, footprint)
           SELECT scene_id, 'N' || key, footprint FROM conflictdb.area"""
    )
    conn.execute("UPDATE conflictdb.area SET key = 'U' || key, ceiling_m = 10")
    conn.execute("DELETE FROM conflictdb.area WHERE key LIKE 'UN%'")
    conn.commit()

    assert len(plans) > 50
    # 320 objects against each other are 102,400 pairs; boxes leave about a dozen pairs an object.
    wasteful = [plan for plan in plans if plan["waste"] > 40 * COUNT]
    assert wasteful == []


def test_rule_of_a_pair_of_pieces_is_inlined_and_looked_up_by_all_columns_of_the_index(
    conn: Conn, plans: list[dict[str, Any]]
) -> None:
    """Wherever it is used: detections of a whole scene and of few changes, differences, probes, admissions, explain."""
    scene = Scene("s", delays_within_s=3600.0, rules=(Rule("ferry", None, time_s=60.0),))
    hull_m = rectangle_outline_m(50.0, 50.0, 10.0, 10.0)
    ship = Track("T", np.array([[0.0, 0.0], [0.1, 0.1]]), np.array([T0_US, T0_US + 3_600_000_000]), hull_m)
    scene_id = load(conn, scene, grid(), [ship])
    refresh(conn, scene_id)
    store.begin_snapshot(conn)
    for _ in store.candidates(conn, scene_id, 1_000_000):
        pass
    conn.execute("DELETE FROM conflictdb.change WHERE object_id <> (SELECT min(area_id) FROM conflictdb.area)")
    for _ in store.candidates(conn, scene_id, 1_000_000):
        pass
    conn.rollback()
    detect(conn, "s", jobs=1)
    conn.execute("UPDATE conflictdb.track SET ceiling_m = 10")
    conn.commit()
    detect(conn, "s", jobs=1)
    conn.commit()
    probe(conn, "s", [replace(ship, key="P")])
    admit(conn, "s", [replace(grid()[7], key="Q")], None, allow_known=False, replace=(), lock_timeout_s=1.0)
    conn.rollback()
    place = "ST_SetSRID(ST_MakeEnvelope(0, 0, 0.1, 0.1), 4326)"
    conn.execute(f"SELECT count(*) FROM conflictdb.probe('s', {place})".encode())
    conn.execute("SELECT count(*) FROM conflictdb.candidates('s')")
    conn.execute("SELECT conflictdb.explain_conflict('s', 'A1', 'A2')")
    conn.rollback()
    assert not [plan for plan in plans if "_pieces_may_meet" in plan["plan"]]
    looked_up = [plan for plan in plans if "(hull &&" in plan["plan"]]
    assert len({plan["query"] for plan in looked_up}) >= 8
    conditions = [one for plan in looked_up for one in re.findall(r'"Index Cond": "([^"]*)"', plan["plan"])]
    assert [one for one in conditions if "hull &&" in one and "span && " not in one] == []


def test_objects_that_all_meet_are_detected_again_without_comparing_all_conflicts(
    conn: Conn, plans: list[dict[str, Any]]
) -> None:
    """Few objects with many conflicts, while the statistics know nothing of these: in full, again, and one change."""
    conn.execute("ALTER TABLE conflictdb.conflict SET (autovacuum_enabled = off)")
    conn.commit()
    boxes = [shapely.box(5.0 + 1e-3 * i, 57.0, 6.0, 58.0) for i in range(200)]
    areas = [Area(f"A{i}", shapely.MultiPolygon([one])) for i, one in enumerate(boxes)]
    pairs = len(areas) * (len(areas) - 1) // 2
    load(conn, Scene("s"), areas, [])
    assert detect(conn, "s", jobs=1).opened == pairs
    for _ in range(2):
        again = detect(conn, "s", jobs=1, full=True)
        assert (again.opened, again.changed, again.closed) == (0, 0, 0)
    store.replace_scene(conn, Scene("s"), areas[1:], [], merge=False)
    assert detect(conn, "s", jobs=1).closed == len(areas) - 1
    store.replace_scene(conn, Scene("s"), areas, [], merge=False)
    assert detect(conn, "s", jobs=1).opened == len(areas) - 1
    assert len(plans) > 50
    wasteful = [plan for plan in plans if max(plan["waste"], plan["read"]) > 10 * pairs]
    assert wasteful == []


def test_one_change_reads_what_it_touches_while_the_statistics_know_of_many_marks(
    conn: Conn, plans: list[dict[str, Any]]
) -> None:
    """As after a detection in full, during which the planner came to know the marks of all objects, which are dead."""
    refresh(conn, load(conn, Scene("s"), grid(), []))
    conn.execute("ALTER TABLE conflictdb.change SET (autovacuum_enabled = off)")
    conn.commit()
    conn.execute("ANALYZE conflictdb.change")
    conn.commit()
    detect(conn, "s", jobs=1)
    for change in (
        "UPDATE conflictdb.area SET ceiling_m = 10 WHERE key = 'A70'",
        "DELETE FROM conflictdb.area WHERE key = 'A300'",
        (
            "INSERT INTO conflictdb.area (scene_id, key, footprint) "
            "SELECT scene_id, 'again', footprint FROM conflictdb.area WHERE key = 'A301'"
        ),
    ):
        conn.execute(change.encode())
        conn.commit()
        plans.clear()
        assert detect(conn, "s", jobs=1).candidate_pairs < 20
        # Each has two neighbours, some pieces and a mark.
        wasteful = [plan for plan in plans if max(plan["waste"], plan["read"]) > 50]
        assert wasteful == []
        assert len(plans) > 10
    objects = "SELECT objects, (SELECT count(*) FROM conflictdb.area) FROM conflictdb.run ORDER BY run_id DESC LIMIT 1"
    assert conn.execute(objects).fetchall() == [(COUNT, COUNT)]


def test_merge_of_few_objects_reads_few_of_the_scene(conn: Conn, plans: list[dict[str, Any]]) -> None:
    """A key may pass between areas and tracks: the other kind was searched row by row."""
    hull_m, path = np.zeros((1, 2)), np.array([[0.0, 0.0], [0.1, 0.1]])
    ships = [Track(f"T{i}", path, [T0_US, T0_US + 3_600_000_000], hull_m) for i in range(COUNT)]
    load(conn, Scene("s"), grid(), ships)
    conn.execute("ANALYZE")
    conn.commit()
    plans.clear()
    few, passed = [*grid(changed=True)[:3], replace(grid()[9], key="T3")], [replace(ships[9], key="A40")]
    merged = store.replace_scene(conn, Scene("s"), few, passed, merge=True)
    assert (merged.added, merged.removed, merged.updated) == (2, 2, 3)
    assert [plan["query"] for plan in plans if max(plan["waste"], plan["read"]) > 50] == []
    # And all of another scene, that the statistics do not know, without comparing all with all.
    load(conn, Scene("other"), grid(), ships)
    plans.clear()
    merged = store.replace_scene(conn, Scene("other"), grid(changed=True), ships, merge=True)
    assert (merged.added, merged.removed, merged.updated) == (0, 0, COUNT)
    assert [plan["query"] for plan in plans if plan["waste"] > 40 * COUNT] == []


def test_one_change_starts_no_parallel_workers(conn: Conn, plans: list[dict[str, Any]]) -> None:
    """Two workers for eleven events took 50 ms of 70 in a database of 40,000 events; here they seem to cost nothing."""
    load(conn, Scene("s"), grid(), [])
    conn.commit()
    detect(conn, "s", jobs=1)
    for setting in ("parallel_setup_cost", "parallel_tuple_cost", "min_parallel_table_scan_size",
                    "min_parallel_index_scan_size"):  # fmt: skip
        conn.execute(f"SET {setting} = 0".encode())
    conn.commit()
    for height in (10, 20):
        conn.execute("UPDATE conflictdb.area SET ceiling_m = %s WHERE key = 'A70'", [height])
        conn.commit()
        plans.clear()
        assert detect(conn, "s", jobs=1).candidate_pairs < 20
        assert len(plans) > 10
        assert [plan["query"] for plan in plans if plan["parallel"]] == []


def test_a_conflict_of_a_layer_is_looked_up_by_its_number(conn: Conn) -> None:
    conn.execute("SET LOCAL enable_seqscan = off")
    query = "EXPLAIN SELECT * FROM conflictdb.map_conflicts WHERE conflict_id = 70"
    assert "conflict_conflict_id_btree" in "\n".join(str(line) for (line,) in conn.execute(query.encode()))


def test_one_change_reads_what_it_touches_by_plans_of_a_small_scene(conn: Conn, plans: list[dict[str, Any]]) -> None:
    """A worker's session keeps plans of few rows, which were analyzed, and nobody has analyzed what came since."""
    for table in ("area", "change", "conflict", "piece", "scene"):
        conn.execute(f"ALTER TABLE conflictdb.{table} SET (autovacuum_enabled = off)".encode())
    scene_id = load(conn, Scene("small"), grid()[:3], [])
    conn.commit()
    detect(conn, "small", jobs=1)
    conn.execute("ANALYZE")
    conn.commit()
    change = "UPDATE conflictdb.area SET ceiling_m = %s WHERE key = 'A1' AND scene_id = %s"
    for height in range(1, 8):
        conn.execute(change, [height, scene_id])
        conn.commit()
        detect(conn, "small", jobs=1)
    refresh(conn, load(conn, Scene("large"), grid(), []))
    conn.execute(change, [10, scene_id])
    conn.commit()
    plans.clear()
    assert detect(conn, "small", jobs=1).candidate_pairs < 20
    wasteful = [plan for plan in plans if max(plan["waste"], plan["read"]) > 50]
    assert wasteful == []


def test_more_changes_than_fit_a_table_of_hashes_are_looked_up(conn: Conn, plans: list[dict[str, Any]]) -> None:
    """A server with little work_mem and a scene of millions: a lookup of the conflicts to compute again."""
    scene_id = load(conn, Scene("s"), grid(), [])
    conn.execute("SET work_mem = '64kB'")
    conn.execute("SET hash_mem_multiplier = 1")
    conn.commit()
    for version in (2, 3):
        # Deleted objects, more than fit: the hash table would have to contain them, too.
        conn.execute(
            "INSERT INTO conflictdb.change (scene_id, object_kind, object_id, version) "
            "SELECT %s, n %% 2, n, %s FROM generate_series(100000, 110000) n",
            [scene_id, version],
        )
        conn.commit()
        refresh(conn, scene_id)
        conn.execute("ANALYZE conflictdb.change")
        conn.commit()
        store.begin_snapshot(conn)
        found = neighbours(conn)
        for _ in store.candidates(conn, scene_id, 1_000_000):
            pass
        write_run(conn, scene_id, store.RunRecord("exact", {}, datetime.now(UTC)), found)
        conn.commit()
        mark_all(conn, scene_id)
        conn.commit()
    wasteful = [plan for plan in plans if max(plan["waste"], plan["read"]) > 40 * COUNT]
    assert wasteful == []


def test_marks_that_are_gone_cost_the_list_of_conflicts_nothing(conn: Conn) -> None:
    """Their table is long, empty and full in the planner's eyes: the query checks once whether a scene is current."""
    scene_id = load(conn, Scene("s"), grid(), [])
    refresh(conn, scene_id)
    store.begin_snapshot(conn)
    write_run(conn, scene_id, store.RunRecord("exact", {}, datetime.now(UTC)), neighbours(conn))
    conn.execute(
        "INSERT INTO conflictdb.change (scene_id, object_kind, object_id, version, is_covered) "
        "SELECT %s, 0, n, 1, true FROM generate_series(1, 30000) n",
        [scene_id],
    )
    conn.commit()
    conn.execute("ANALYZE conflictdb.change")
    conn.execute("DELETE FROM conflictdb.change")
    conn.commit()
    ((plan,),) = conn.execute(
        "EXPLAIN (ANALYZE, BUFFERS, FORMAT JSON) "
        "SELECT count(scene_is_current) FROM conflictdb.conflicts WHERE scene = 's'"
    ).fetchall()
    assert plan[0]["Plan"]["Shared Hit Blocks"] < 30_000  # for each conflict a hundred pages of marks would be more


MANY = 20_000


@pytest.fixture(scope="module")
def with_many(_server: TestServer, template: str, worker_id: str) -> Iterator[Conn]:
    """A database of two scenes of as many conflicts, each in a place and at a time of its own, for questions alone."""
    name = f"{_server.prefix}_{worker_id}_many"
    dsn = _server.clone(template, name)
    with psycopg.connect(dsn, options="-c timezone=UTC") as conn:
        add_many(conn)
        yield conn
    _server.drop(name)


def add_many(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('many'), conflictdb.create_scene('more')")
    conn.execute(
        """INSERT INTO conflictdb.conflict (scene_id, run_id, a_kind, a_id, a_version, a_key, b_kind, b_id, b_version,
                                            b_key, periods, verdict, region, method, time_error_s, found_at, closest_m,
                                            closest_error_m, closest_a_point, closest_b_point, conflict_id)
           SELECT s.scene_id, 1, 0, n + s.scene_id * %(many)s, 1, 'A' || n, 1, n + s.scene_id * %(many)s, 1, 'T' || n,
                  tstzmultirange(tstzrange(t.at, t.at + interval '1 hour', '[]')), 'conflict', ST_Expand(p.at, 0.1),
                  'exact', 0, now(), 0, 0, p.at, p.at, nextval('conflictdb.conflict_seq')
           FROM conflictdb.scene s CROSS JOIN generate_series(1, %(many)s) n
           CROSS JOIN LATERAL (SELECT ST_SetSRID(ST_MakePoint(n / 200 - 50, n %% 200 * 0.5 - 50), 4326) AS at) p
           CROSS JOIN LATERAL (SELECT timestamptz '2026-03-01Z' + n %% 977 * interval '1 minute' AS at) t""",
        {"many": MANY},
    )
    conn.execute(
        """INSERT INTO conflictdb.conflict_event (scene_id, run_id, conflict_id, kind, at, opened_at, a_kind, a_key,
                                                  b_kind, b_key, periods, verdict, time_error_s)
           SELECT s.scene_id, n / 10, n, 'opened', t.at, t.at, 0, 'A' || n, 1, 'T' || n, '{(,)}', 'conflict', 0
           FROM conflictdb.scene s CROSS JOIN generate_series(1, %s) n
           CROSS JOIN LATERAL (SELECT timestamptz '2026-03-01Z' + n / 10 * interval '1 minute' AS at) t
           ORDER BY n, s.scene_id""",
        [MANY],
    )
    conn.execute("ANALYZE")
    conn.commit()


@pytest.mark.parametrize(
    ("query", "found"),
    [
        ("conflicts_of('many', 'A777')", 1),
        ("conflicts_of('many', 'T777')", 1),
        ("approaches_of('many', 'A777')", 1),
        ("approaches_of('many', 'T777')", 1),
        ("conflicts WHERE scene = 'many' AND a_key = 'A777'", 1),
        ("conflicts WHERE scene = 'many' AND b_key = 'T777'", 1),
        ("conflicts_within('many', ST_MakeEnvelope(3.3, 3.3, 3.7, 3.7, 4326), '[2026-03-01,2026-03-02)')", 0),
        ("conflicts_within('many', ST_MakeEnvelope(2.9, 2.9, 3.1, 3.1, 4326), '[2026-03-01,2026-03-02)')", 1),
        ("conflicts_within('many', ST_MakeEnvelope(2.9, 2.9, 3.1, 3.1, 4326), NULL)", 1),
        ("conflict_events WHERE scene = 'many' AND at >= '2026-03-02 09:18Z'", 21),
        ("conflict_events WHERE scene = 'many' AND at BETWEEN '2026-03-01 12:00Z' AND '2026-03-01 12:01Z'", 20),
        ("conflict_events WHERE scene = 'many' AND event > 39990 ORDER BY event", 5),
        ("map_conflicts WHERE scene = 'many' AND conflict_id = 777", 1),
    ],
)
def test_questions_about_one_object_or_place_read_few_of_many_conflicts(
    with_many: Conn, query: str, found: int
) -> None:
    with_many.rollback()
    with_many.execute("SET search_path = conflictdb, conflictdb_internal, public")
    with_many.execute("SET client_min_messages = warning")
    row = with_many.execute(f"EXPLAIN (ANALYZE, TIMING off, FORMAT json) SELECT * FROM {query}".encode()).fetchone()
    assert row is not None
    plan = row[0][0]["Plan"]
    assert plan["Actual Rows"] == found
    assert max(most_read(plan), worst_waste(plan)) < 100


@pytest.mark.parametrize("key", ["A777", "T777"])
def test_the_list_of_one_object_reads_no_index_in_full(with_many: Conn, key: str) -> None:
    """`conflicts --of`, `Scene.conflicts(key=…)`: they read 286 blocks of 33,648 conflicts, and more of more."""
    with_many.rollback()
    with_many.execute(
        {
            "A777": "SELECT conflictdb.put_area('many', 'A777', 'SRID=4326;MULTIPOLYGON(((0 0, 1 0, 1 1, 0 0)))')",
            "T777": "SELECT conflictdb.put_track('many', 'T777', 'SRID=4326;LINESTRING M (-1 50.5 1772323200, 2 50.5 "
            "1772409600)', conflictdb.rectangle_outline(9, 9, 9, 9))",
        }[key].encode()
    )
    read = """SELECT sum(pg_stat_get_xact_blocks_fetched(indexrelid)) FROM pg_index
              WHERE indrelid = 'conflictdb.conflict'::regclass"""
    before = with_many.execute(read).fetchall()
    found = with_many.execute(
        "SELECT a_key, b_key FROM conflictdb_internal._conflicts('many', NULL, false, NULL, %s, NULL, NULL, NULL, "
        "NULL, NULL, NULL)",
        [key],
    ).fetchall()
    assert found == [("A777", "T777")]
    after = with_many.execute(read).fetchall()
    with_many.rollback()
    assert after[0][0] - before[0][0] < 30


def test_pruning_reads_what_is_old_and_compares_no_run_with_all_events(conn: Conn, plans: list[dict[str, Any]]) -> None:
    """A history of 3.6 million events was not pruned within five minutes: each run was looked up among all of them."""
    load(conn, Scene("s"), grid(), [])
    conn.execute("SET work_mem = '64kB'")
    conn.execute("SET hash_mem_multiplier = 1")
    conn.execute(
        """INSERT INTO conflictdb.run (scene_id, started_at, finished_at, method, settings, objects, conflicts,
                                       unresolved, opened, changed, closed)
           SELECT s.scene_id, t, t, 'exact', '{}', 1, 0, 0, 0, 0, 0
           FROM conflictdb.scene s, generate_series(now() - interval '300 minutes', now(), interval '1 minute') t"""
    )
    conn.execute(
        """INSERT INTO conflictdb.conflict_event (scene_id, run_id, conflict_id, kind, at, opened_at, a_kind, a_key,
                                                  b_kind, b_key, periods, verdict, time_error_s)
           SELECT r.scene_id, r.run_id, r.run_id * 100 + n / 2, (ARRAY['opened', 'closed'])[n % 2 + 1], r.finished_at,
                  r.finished_at, 0, 'A' || n, 1, 'T' || n, '{(,)}', 'conflict', 0
           FROM conflictdb.run r, generate_series(0, 99) n"""
    )
    conn.execute("ANALYZE conflictdb.conflict_event")
    conn.commit()
    plans.clear()
    assert conn.execute("SELECT conflictdb.prune_history('s', '280 minutes')").fetchone() == (2100,)
    assert conn.execute("SELECT count(*) FROM conflictdb.run").fetchone() == (281,)
    reading = [plan for plan in plans if "conflict_event" in plan["query"] and "prune_history(" not in plan["query"]]
    assert len(reading) >= 2
    assert [plan for plan in reading if max(plan["waste"], plan["read"]) > 3000] == []


def test_what_was_planned_while_there_were_no_conflicts_reads_few_of_many(conn: Conn) -> None:
    """A worker's session keeps its plans while conflicts come, and no ANALYZE has run yet."""
    ask = """SELECT octet_length(a_ids)
             FROM conflictdb_internal._known_conflicts_of(1, array_fill(1::smallint, '{20}'), %s)"""
    read = """SELECT sum(pg_stat_get_xact_blocks_fetched(indexrelid)) FROM pg_index
              WHERE indrelid = 'conflictdb.conflict'::regclass"""
    objects = list(range(1, 21))
    assert conn.execute(ask, [objects]).fetchone() == (12,)  # none
    conn.execute(
        """INSERT INTO conflictdb.conflict (scene_id, run_id, a_kind, a_id, a_version, a_key, b_kind, b_id, b_version,
                                            b_key, periods, verdict, method, time_error_s, found_at, conflict_id)
           SELECT 1, 1, 1, n, 1, 'A' || n, 1, 20000 - n, 1, 'T' || n, '{(,)}', 'conflict', 'exact', 0, now(), n
           FROM generate_series(1, 20000) n"""
    )
    (before,) = conn.execute(read).fetchone() or (0,)
    assert conn.execute(ask, [objects]).fetchone() == (20 + 12 * 40,)
    (after,) = conn.execute(read).fetchone() or (0,)
    assert 40 <= after - before < 400


def test_routines_that_rule_out_plans_compile_none(conn: Conn) -> None:
    """A disabled plan that is used all the same costs 1e10, so two rows seem worth a second of compiling (JIT)."""
    query = r"""SELECT p.oid::regprocedure::text FROM pg_proc p
                WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
                      AND 'jit=off' <> ALL (coalesce(p.proconfig, '{}'))
                  AND (array_to_string(p.proconfig, ' ') ~ '\menable_\w+=' OR p.prosrc ~ '\menable_\w+')"""
    assert conn.execute(query).fetchall() == []
