"""Admission under other roles, hostile values and workers that are killed between its stages."""

import json
import time
from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from city import as_feature, as_plan, asked, flight, keys, square
from patience import answer_all
from psycopg import sql

from conflictdb import Database, StoredScene, store
from conflictdb.jobs import probes

Conn = psycopg.Connection[Any]


@pytest.fixture
def roles(db: Database) -> Iterator[dict[str, str]]:
    """Names of an editor, another editor and a reader."""
    conn = db.connection
    names = {name: f"{name}_{conn.info.dbname}" for name in ("editor", "other", "reader")}
    for name, role in names.items():
        group = "conflictdb_reader" if name == "reader" else "conflictdb_editor"
        statement = sql.SQL("CREATE ROLE {0} LOGIN; GRANT {1} TO {0}")
        conn.execute(statement.format(sql.Identifier(role), sql.Identifier(group)))
    conn.commit()
    yield names
    conn.rollback()
    db.protect_scenes(on=False)
    for role in names.values():
        statement = sql.SQL("REASSIGN OWNED BY {0} TO CURRENT_USER; DROP OWNED BY {0}; DROP ROLE {0}")
        conn.execute(statement.format(sql.Identifier(role)))
    conn.commit()


def become(conn: Conn, role: str) -> None:
    conn.rollback()
    conn.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(role)))
    conn.commit()


def refusal(conn: Conn, statement: str, *arguments: object) -> str:
    with pytest.raises(psycopg.Error) as caught:
        conn.execute(statement.encode(), arguments)
    conn.rollback()
    return f"{caught.value.sqlstate} {caught.value}"


ADMIT = "SELECT conflictdb.admit('city', %s)"
INSERT = """INSERT INTO conflictdb.probe_request (scene_id, kind, plans, options)
            SELECT scene_id, 'admit', %s, '{"allow_known": false}' FROM conflictdb.scene"""


def test_readers_cannot_admit(dsn: str, city: StoredScene, roles: dict[str, str]) -> None:
    """Neither by the function, nor by a request of their own, nor under another role's name."""
    plans = json.dumps([as_feature(square("a", 0.0))])
    with psycopg.connect(dsn) as conn:
        become(conn, roles["reader"])
        assert refusal(conn, ADMIT, plans).startswith("42501")
        assert refusal(conn, INSERT, plans).startswith("42501")
        pretended = INSERT.replace("plans,", "plans, asked_by,").replace("%s,", "%s, %s,")
        assert refusal(conn, pretended, plans, roles["editor"])[:5] in {"42501", "23514"}
        lock = "INSERT INTO conflictdb.admission_lock (scene_id, taken) SELECT scene_id, 1 FROM conflictdb.scene"
        assert refusal(conn, lock).startswith("42501")
    assert keys(city) == []


def test_requests_are_checked_again_when_they_are_answered(
    dsn: str, db: Database, city: StoredScene, roles: dict[str, str]
) -> None:
    """A right that was withdrawn meanwhile does not count, and nobody else sees the request."""
    city.put(square("a", 0.0))
    db.protect_scenes()
    city.share(roles["editor"], "write")
    with psycopg.connect(dsn) as conn, psycopg.connect(dsn) as other:
        become(other, roles["other"])
        assert "not in this database" in refusal(other, ADMIT, json.dumps([as_plan(square("b", 0.5))]))
        become(conn, roles["editor"])
        near = flight("near", 0.0106)
        requests = []
        for _ in range(2):
            _, _, request = asked(conn, near)
            requests.append(request)
            conn.commit()
        assert refusal(other, "SELECT conflictdb.wait_for_admission(%s, '1 ms')", requests[0]).startswith("ZC011")
        city.unshare(roles["editor"])
        answer_all(db.connection)
        errors = "SELECT error FROM conflictdb.probe_request ORDER BY probe_id"
        for (error,) in db.connection.execute(errors.encode()).fetchall():
            assert "may not change scene" in error
        db.connection.commit()
    assert keys(city) == ["a"]


HOSTILE: list[dict[str, Any]] = [
    {"key": ""},
    {"key": "x" * 100_000},
    {"key": "a\u0000b"},
    {"footprint": {"type": "Polygon", "coordinates": [[[1e308, 0], [1, 0], [1, 1], [1e308, 0]]]}},
    {"footprint": {"type": "Polygon", "coordinates": []}},
    {"footprint": "POLYGON EMPTY"},
    {"footprint": "POLYGON((0 0, NaN 0, 1 1, 0 0))"},
    {"footprint": "SRID=3857;POLYGON((0 0, 1 0, 1 1, 0 0))"},
    {"footprint": "CURVEPOLYGON(CIRCULARSTRING(0 0, 1 1, 2 0, 1 -1, 0 0))"},
    {"footprint": "POLYGON((0 0, 1 1, 1 0, 0 1, 0 0))"},
    {"active_span": "empty"},
    {"active_span": "[infinity,)"},
    {"active_span": "[2030-01-01, 2029-01-01)"},
    {"floor_m": 1e309},
    {"floor_m": "Infinity"},
    {"floor_m": 5, "ceiling_m": 4},
    {"owner": ""},
    {"owner": {"a": 1}},
    {"name": 1},
    {"class": "c\ud800"},
    {"properties": [1]},
    {"activations": "{[2030-01-01,2030-01-02)}", "active_span": "[2030-01-01,2030-01-02)"},
]


@pytest.mark.parametrize("fields", HOSTILE, ids=lambda fields: str(fields)[:60])
def test_hostile_values_change_nothing(db: Database, city: StoredScene, fields: dict[str, Any]) -> None:
    """Nor do they stop the next admission."""
    plan = {"key": "bad", "footprint": "POLYGON((0 0, 0.01 0, 0.01 0.01, 0 0))", **fields}
    with pytest.raises(psycopg.Error) as caught, db.connection.transaction():
        db.connection.execute(ADMIT, [json.dumps([as_plan(square("good", 0.5)), plan])])
    assert caught.value.sqlstate is not None
    assert caught.value.sqlstate[:2] in {"ZC", "22"}
    assert keys(city) == []
    assert asked(db.connection, square("good", 0.0))[0]
    db.connection.commit()


def test_a_search_path_of_the_caller_does_not_matter(dsn: str, city: StoredScene, roles: dict[str, str]) -> None:
    with psycopg.connect(dsn) as conn:
        become(conn, roles["editor"])
        conn.execute("CREATE TEMP TABLE area (area_id bigint, scene_id bigint, key text)")
        conn.execute(
            "CREATE FUNCTION pg_temp._begin_admission(text, double precision, text[], text) RETURNS int "
            "LANGUAGE sql AS 'SELECT 1'"
        )
        conn.execute("SET search_path = pg_temp, pg_catalog, public")
        assert asked(conn, square("a", 0.0))[0]
        assert asked(conn, square("b", 0.005))[0] is False
        conn.commit()
    assert keys(city) == ["a"]


@pytest.mark.parametrize("stage", ["read_request", "answer_admission", "put_rows", "objects_near"])
def test_a_worker_that_is_killed_between_stages_leaves_nothing(
    dsn: str, db: Database, city: StoredScene, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    """Another one answers the request, once."""
    city.put(square("a", 0.0))
    _, _, request = asked(db.connection, flight("near", 0.0106))
    db.connection.commit()
    known = getattr(store, stage)

    def killed(conn: Conn, *rest: Any, **options: Any) -> Any:
        found = known(conn, *rest, **options)
        with psycopg.connect(dsn, autocommit=True) as killer:
            killer.execute("SELECT pg_terminate_backend(%s, 60000)", [conn.info.backend_pid])
        return found

    with psycopg.connect(dsn) as worker, monkeypatch.context() as patched:
        patched.setattr(store, stage, killed)
        with pytest.raises(Exception, match=r"terminat|closed|lost|connection"):
            probes.answer(worker)
    assert keys(city) == ["a"]
    with psycopg.connect(dsn) as worker:
        time.sleep(1.0)  # the claim of the first one lasts as long
        while probes.answer(worker):
            pass
    assert db.connection.execute("SELECT admitted FROM conflictdb.wait_for_admission(%s)", [request]).fetchone() == (
        True,
    )
    db.connection.commit()
    assert keys(city) == ["a", "near"]
