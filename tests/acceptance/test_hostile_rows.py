"""Whatever readers and editors write into the tables that they may write, workers miss nothing, and views can be read.

Random rows of hostile values, by column, into every table that a role may insert into, update or delete from, and
transactions that are prepared first; a worker runs meanwhile, for `CONFLICTDB_HOSTILE_S` seconds
(4 by default; CONFLICTDB_HOSTILE_SEED: 1).
"""

import ast
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Final

import psycopg
import pytest
from own_server import OwnServer, own_server
from patience import WAIT_S
from psycopg import sql

import conflictdb
from conflictdb import store

SECONDS: Final = float(os.environ.get("CONFLICTDB_HOSTILE_S", "4"))
LEAST_TRIED: Final = 400

BOXES: Final = [f"SRID=4326;MULTIPOLYGON((({x} 0, {x + 2} 0, {x + 2} 2, {x} 2, {x} 0)))" for x in range(-3, 4)]
VALUES: Final[dict[str, list[Any]]] = {
    "smallint": [-32768, -1, 0, 1, 2, 7, 32767],
    "integer": [-(2**31), -1, 0, 1, 2**31 - 1],
    "bigint": [-(2**63), -1, 0, 1, 2, 3, 2**62 - 1, 2**62, 2**63 - 1],
    "double precision": ["NaN", "Infinity", "-Infinity", 0, -1, 1e308, 1e-308, 500],
    "text": [
        "",
        "A",
        "s",
        "\u202e",
        "x" * 5000,
        "'; DROP SCHEMA conflictdb; --",
        "{}",
        "{{1}}",
        "%s",
        "rhumb",
        "exact",
        "probe",
        "delays",
    ],
    "name": ["", "postgres", "conflictdb_worker", "public"],
    "boolean": [True, False],
    "jsonb": ["{}", "null", '{"a": [[[[]]]]}', '"x"', '{"key": "id"}', '{"key": "T", "horizon_s": 60}'],
    "json": [
        "[]",
        "null",
        *(
            json.dumps([{"type": "Feature", "version": 1, "id": "P", "geometry": shape, "properties": members}])
            for shape in (
                {"type": "Polygon", "coordinates": [[[0, 0], [2, 0], [2, 2], [0, 0]]]},
                {"type": "Polygon", "coordinates": [[[0, 0], [1e300, 0], [2, 2], "x"]]},
                {"type": "LineString", "coordinates": [[0, 0.5], [2, 0.5]]},
                {"type": "Point", "coordinates": [0, 0]},
                None,
            )
            for members in (
                {},
                {"start": "2026-03-01T06:00Z", "floor_m": "NaN"},
                {"times": ["2026-03-01T00:00Z", "2026-03-02T00:00Z"], "outline_m": [[0, 0]]},
                {"radius_m": 1e9, "schedule": [[[]]], "class": 5},
                None,
            )
        ),
    ],
    "interval": ["0", "-1 second", "1000000 years", "1 second"],
    "timestamp with time zone": ["infinity", "-infinity", "4713-01-01 BC", "294276-01-01", "2026-03-01 06:00Z"],
    "tstzrange": ["empty", "(,)", "[infinity,)", "(,-infinity]", "[-infinity,infinity]", "[2026-03-01,2026-03-02)"],
    "tstzmultirange": ["{}", "{(,)}", "{[2026-03-01,2026-03-02]}"],
    "text[]": ["{}", "{NULL}", "{a,b}"],
    "double precision[]": ["{}", "{NULL}", "{NaN}", "{1,2}"],
    "geometry": [
        *BOXES,
        "POLYGON EMPTY",
        "SRID=4326;MULTIPOLYGON EMPTY",
        "SRID=4326;MULTIPOLYGON(((0 0, 1 1, 0 1, 1 0, 0 0)))",
        "SRID=4326;MULTIPOLYGON(((0 0, 1e300 0, 1 1, 0 0)))",
        "SRID=4326;MULTIPOLYGON(((0 0, NaN 0, 1 1, 0 0)))",
        "SRID=3857;MULTIPOLYGON(((0 0, 1 0, 1 1, 0 0)))",
        "SRID=4326;LINESTRING M (0 0.5 1772323200, 2 0.5 1772409600)",
        "SRID=4326;LINESTRING M (0 0.5 NaN, 2 0.5 1772409600)",
        "SRID=4326;LINESTRING M (0 89.99999 0, 180 -89.99999 1e15)",
        "POLYGON((5 5, 5 -5, -5 -5, -5 5, 5 5))",
        "POLYGON((1e9 1e9, 1e9 -1e9, -1e9 -1e9, -1e9 1e9, 1e9 1e9))",
        "GEOMETRYCOLLECTION EMPTY",
    ],
}
# Rows that are accepted, so that a single hostile value is what a row is refused for; keys are made.
_PLAN: Final = json.dumps(
    [
        {
            "type": "Feature",
            "id": "P",
            "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [2, 0], [2, 2], [0, 0]]]},
            "properties": {"start": "2026-03-01T06:00Z"},
        }
    ]
)
USUAL: Final[dict[str, dict[str, list[Any]]]] = {
    "area": {"scene_id": [1, 2], "key": [None], "footprint": BOXES},
    "track": {
        "scene_id": [1, 2],
        "key": [None],
        "path": ["SRID=4326;LINESTRING M (0 0.5 1772323200, 2 0.5 1772409600)"],
        "outline": ["POLYGON((5 5, 5 -5, -5 -5, -5 5, 5 5))"],
    },
    "probe_request": {"scene_id": [1, 2], "kind": ["probe"], "plans": [_PLAN], "options": ["{}"]},
}
COLUMNS = """
SELECT c.relname, a.attname, regexp_replace(format_type(a.atttypid, a.atttypmod), '\\(.*\\)', ''),
       has_column_privilege(c.oid, a.attnum, 'INSERT'), has_column_privilege(c.oid, a.attnum, 'UPDATE'),
       has_table_privilege(c.oid, 'DELETE')
FROM pg_class c JOIN pg_attribute a ON a.attrelid = c.oid
WHERE c.relnamespace = 'conflictdb'::regnamespace AND c.relkind = 'r' AND a.attnum > 0 AND NOT a.attisdropped
"""


@pytest.fixture(scope="module")
def site() -> Iterator[OwnServer]:
    with own_server(max_prepared_transactions="20") as server:
        with psycopg.connect(server.dsn) as conn:
            conn.execute("CREATE SCHEMA mission; GRANT ALL ON SCHEMA mission TO conflictdb_editor")
            conn.execute("SET ROLE conflictdb_editor")
            for scene in ("s", "t"):
                conn.execute("SELECT conflictdb.create_scene(%s)", [scene])
                for k, box in enumerate(BOXES):
                    conn.execute("SELECT conflictdb.put_area(%s, %s, %s)", [scene, f"A{k}", box])
                conn.execute(
                    """SELECT conflictdb.put_track(%s, 'T', 'SRID=4326;LINESTRING M (-3 1 1772323200, 5 1 1772409600)',
                                                   conflictdb.rectangle_outline(90, 90, 50, 50))""",
                    [scene],
                )
            conn.execute("CREATE TABLE mission.ops (id integer PRIMARY KEY, shape public.geometry)")
            conn.execute("INSERT INTO mission.ops SELECT n, %s FROM generate_series(1, 5) n", [BOXES[3]])
            conn.execute(
                """SELECT conflictdb.attach('s', 'area', 'mission.ops', '{"key": "id", "footprint": "shape"}')"""
            )
            conn.commit()
            conn.execute("SELECT conflictdb.follow_attached('s')")
        yield server


def writes(conn: psycopg.Connection[Any], chance: random.Random) -> Iterator[tuple[sql.Composed, list[Any]]]:
    """Yield hostile statements of the current role, for ever."""
    tables: dict[str, list[tuple[str, str, bool, bool]]] = {}
    removable = set()
    for table, column, kind, may_insert, may_update, may_delete in conn.execute(COLUMNS.encode()).fetchall():
        tables.setdefault(table, []).append((column, kind, may_insert, may_update))
        if may_delete:
            removable.add(table)
    writable = sorted(name for name, columns in tables.items() if any(one[2] or one[3] for one in columns))
    assert "probe_request" in writable
    while True:
        name = chance.choice(writable)
        table = sql.Identifier("conflictdb", name)
        some = [(c, kind) for c, kind, may_insert, _ in tables[name] if may_insert and chance.random() < 0.8]
        others = [(c, kind) for c, kind, _, may_update in tables[name] if may_update]
        turn = chance.random()
        usual = USUAL.get(name, {})
        if turn < 0.3 and usual and usual.keys() <= {c for c, _, may_insert, _ in tables[name] if may_insert}:
            row = {c: chance.choice(among) for c, among in usual.items()}
            if "key" in row:
                row["key"] = f"K{chance.random()}"
            hostile, kind = chance.choice(some or [("scene_id", "bigint")])
            row[hostile] = chance.choice([None, *VALUES.get(kind, [])]) if chance.random() < 0.5 else row.get(hostile)
            row = {c: value for c, value in row.items() if c in usual or value is not None}
            columns = sql.SQL(", ").join(map(sql.Identifier, row))
            marks = sql.SQL(", ").join(sql.SQL("%s") for _ in row)
            yield sql.SQL("INSERT INTO {} ({}) VALUES ({})").format(table, columns, marks), [*row.values()]
        elif turn < 0.6 and some:
            values = [chance.choice([None, *VALUES.get(kind, [])]) for _, kind in some]
            columns = sql.SQL(", ").join(sql.Identifier(c) for c, _ in some)
            marks = sql.SQL(", ").join(sql.SQL("%s") for _ in some)
            yield sql.SQL("INSERT INTO {} ({}) VALUES ({})").format(table, columns, marks), values
        elif turn < 0.95 and others:
            column, kind = chance.choice(others)
            where = sql.SQL("ctid IN (SELECT ctid FROM {} ORDER BY random() LIMIT 2)").format(table)
            update = sql.SQL("UPDATE {} SET {} = %s WHERE {}").format(table, sql.Identifier(column), where)
            yield update, [chance.choice(VALUES.get(kind, [None]))]
        elif name in removable and name not in ("scene", "attachment"):
            where = sql.SQL("ctid IN (SELECT ctid FROM {} ORDER BY random() LIMIT 1)").format(table)
            yield sql.SQL("DELETE FROM {} WHERE {}").format(table, where), []


def read_all_views(conn: psycopg.Connection[Any]) -> None:
    """Read all columns of all rows of all views."""
    views = conn.execute(
        "SELECT relname FROM pg_class WHERE relnamespace = 'conflictdb'::regnamespace AND relkind = 'v'"
    ).fetchall()
    assert ("conflicts",) in views
    for (name,) in views:
        conn.execute(sql.SQL("SELECT count(v::text) FROM {} v").format(sql.Identifier("conflictdb", name)))
    conn.rollback()


def conflicts(db: conflictdb.Database) -> set[tuple[Any, ...]]:
    rows = db.connection.execute(
        "SELECT scene, a_key, b_key, verdict, periods::text FROM conflictdb.conflicts"
    ).fetchall()
    db.connection.rollback()
    return set(rows)


def test_workers_go_on_and_miss_nothing(site: OwnServer, tmp_path: Any) -> None:
    said = tmp_path / "said"
    chance = random.Random(int(os.environ.get("CONFLICTDB_HOSTILE_SEED", "1")))  # noqa: S311
    tried, written, prepared = 0, 0, []
    with said.open("w") as log, psycopg.connect(site.dsn) as reader, psycopg.connect(site.dsn) as editor:
        worker = subprocess.Popen(
            [sys.executable, "-m", "conflictdb", "--dsn", site.dsn, "worker"], stdout=log, stderr=log
        )
        try:
            turns = []
            for conn, role in ((reader, "conflictdb_reader"), (editor, "conflictdb_editor")):
                conn.execute(f"SET ROLE {role}".encode())
                conn.execute("SET lock_timeout = '5s'")
                conn.commit()
                turns.append((conn, writes(conn, chance)))
            until = time.monotonic() + SECONDS
            # On a machine that is busy, until as many rows are tried as otherwise.
            while time.monotonic() < until or (tried < LEAST_TRIED and time.monotonic() < until + WAIT_S):
                conn, statements = chance.choice(turns)
                statement, values = next(statements)
                tried += 1
                with suppress(psycopg.Error):
                    if chance.random() < 0.2 and len(prepared) < 10:
                        conn.tpc_begin(conn.xid(1, f"hostile {tried}", "x"))
                        conn.execute(statement, values)
                        conn.tpc_prepare()
                        prepared.append(f"hostile {tried}")
                        chance.choice([conn.tpc_commit, conn.tpc_rollback])()
                        prepared.pop()
                    else:
                        conn.execute(statement, values)
                        conn.commit()
                    written += 1
                if conn.info.transaction_status != psycopg.pq.TransactionStatus.IDLE:
                    with suppress(psycopg.Error):
                        conn.tpc_rollback()
                    conn.rollback()
                assert not conn.closed
                if tried % 50 == 0:
                    read_all_views(reader)
            await_answers(site, worker)
            assert worker.poll() is None, said.read_text()
        finally:
            worker.kill()
            worker.wait()
    assert "lost the database" not in said.read_text()
    assert written > 100, f"{written} of {tried}"
    with conflictdb.connect(site.dsn) as db:
        scenes = [status.scene.name for status in db.scenes()]
        for name in scenes:
            detect_mended(db, name)
        kept = conflicts(db)
        for name in scenes:
            db.scene(name).detect(full=True)
        assert kept == conflicts(db)


def detect_mended(db: conflictdb.Database, scene: str) -> None:
    """Detect a scene; a schedule that is not understood is refused by the name of its object, and taken away then."""
    while True:
        try:
            db.scene(scene).detect()
        except conflictdb.InvalidInput as refused:
            kind, _, key = refused.key.partition(" ")
            db.connection.rollback()
            if refused.field != "schedule":
                raise
            mended = db.connection.execute(
                f"UPDATE conflictdb.{kind} SET schedule = NULL WHERE key = %s AND schedule IS NOT NULL".encode(),
                [ast.literal_eval(key)],
            )
            assert mended.rowcount > 0
            db.connection.commit()
        else:
            return


def await_answers(site: OwnServer, worker: "subprocess.Popen[bytes]") -> None:
    """Wait until the worker has answered a request that was sent after all of these rows."""
    with store.connect(site.dsn) as conn:
        conn.execute("DELETE FROM conflictdb.probe_request WHERE answered_at IS NULL AND attempts > 0")
        row = conn.execute("SELECT name FROM conflictdb.scene ORDER BY scene_id LIMIT 1").fetchone()
        assert row is not None
        (probe_id,) = conn.execute("SELECT conflictdb.request_probe(%s, %s)", [row[0], BOXES[0]]).fetchone() or (None,)
        conn.commit()
        until = time.monotonic() + WAIT_S
        answered = "SELECT answered_at IS NOT NULL FROM conflictdb.probe_request WHERE probe_id = %s"
        while conn.execute(answered.encode(), [probe_id]).fetchone() != (True,):
            conn.commit()
            assert worker.poll() is None
            assert time.monotonic() < until, "no answer"
            time.sleep(0.05)
