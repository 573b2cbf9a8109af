"""No everyday statement locks a table against readers or writers (docs/how-to/look-after-the-database.md)."""

from typing import Any

import psycopg
import pytest

from conflictdb.jobs.detect import detect

Conn = psycopg.Connection[Any]

WEAK = {"AccessShareLock", "RowShareLock", "RowExclusiveLock"}
AREAS = """
SELECT conflictdb.create_scene('s');
INSERT INTO conflictdb.area (scene_id, key, footprint)
SELECT s.scene_id, k, ST_Multi(ST_MakeEnvelope(0, 0, 1, 1, 4326)) FROM conflictdb.scene s, unnest(ARRAY['A', 'B']) k
"""
HELD = """
SELECT DISTINCT l.mode FROM pg_locks l JOIN pg_class c ON c.oid = l.relation AND c.relkind IN ('r', 'p')
WHERE l.pid = pg_backend_pid() AND c.relnamespace = 'conflictdb'::regnamespace
"""


def held(conn: Conn) -> set[str]:
    return {mode for (mode,) in conn.execute(HELD.encode())}


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE conflictdb.area SET floor_m = 1",
        "DELETE FROM conflictdb.area WHERE key = 'A'",
        "UPDATE conflictdb.scene SET separation_m = 9",
        "SELECT conflictdb.put_rule('s', 'area', 'area', 5)",
        "SELECT conflictdb.acknowledge('s', 'A', 'B', 'on purpose')",
        "SELECT conflictdb.prune_history('s', '0')",
        "SELECT conflictdb.remove_scene('s')",
    ],
)
def test_statements_lock_rows(conn: Conn, statement: str) -> None:
    conn.execute(AREAS)
    conn.commit()
    assert detect(conn, "s", jobs=1).opened == 1
    conn.execute(statement.encode())
    assert "RowExclusiveLock" in held(conn) <= WEAK


def test_a_detection_locks_rows(conn: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    modes: list[set[str]] = []
    commit = psycopg.Connection.commit

    def committing(self: Conn) -> None:
        modes.append(held(self))
        commit(self)

    conn.execute(AREAS)
    conn.commit()
    monkeypatch.setattr(psycopg.Connection, "commit", committing)
    assert detect(conn, "s", jobs=1).opened == 1
    assert {"RowExclusiveLock"} <= set().union(*modes) <= WEAK
