"""Replicated rows are marked like any change; disabled triggers are noticed."""

from typing import Any

import psycopg
import pytest
from mixed_scenes import mixed_scene
from piecework import load

from conflictdb import store
from conflictdb.errors import SchemaOutdated
from conflictdb.jobs import schema
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Scene

Conn = psycopg.Connection[Any]


@pytest.fixture
def scene(conn: Conn) -> Scene:
    mixed = mixed_scene(6, ())
    load(conn, mixed.scene, mixed.areas, mixed.tracks)
    detect(conn, mixed.scene.name, jobs=1)
    return mixed.scene


def replicate(conn: Conn, *statements: str) -> None:
    """Run statements as the process of a subscription applies its changes."""
    with conn.transaction():
        conn.execute("SET LOCAL session_replication_role = replica")
        for statement in statements:
            conn.execute(statement.encode())


def pending(conn: Conn) -> tuple[int, bool]:
    (row,) = conn.execute("SELECT pending, is_current FROM conflictdb.scenes").fetchall()
    return row


def answer(conn: Conn, scene: Scene) -> list[tuple[Any, ...]]:
    conn.commit()
    return [(c.a_key, c.b_key, c.periods) for c in store.conflicts(conn, scene.name)]


CHANGES = {
    "insert an area": """INSERT INTO conflictdb.area (area_id, scene_id, key, footprint, properties, version)
        OVERRIDING SYSTEM VALUE SELECT 1000 + area_id, scene_id, 'COPY ' || key, footprint, '{}', version
        FROM conflictdb.area WHERE key = 'A1'""",
    "insert a track": """INSERT INTO conflictdb.track (track_id, scene_id, key, path, outline, properties, version)
        OVERRIDING SYSTEM VALUE SELECT 1000 + track_id, scene_id, 'COPY ' || key, path, outline, '{}', version
        FROM conflictdb.track WHERE key = 'T1'""",
    "change an area": "UPDATE conflictdb.area SET floor_m = 7, ceiling_m = NULL WHERE key = 'A1'",
    "change a track": "UPDATE conflictdb.track SET key = 'RENAMED' WHERE key = 'T1'",
    "remove an area": "DELETE FROM conflictdb.area WHERE key = 'A1'",
    "remove a track": "DELETE FROM conflictdb.track WHERE key = 'T2'",
}


def test_every_change_is_marked_and_the_next_detection_knows_it(conn: Conn, scene: Scene) -> None:
    for name, statement in CHANGES.items():
        replicate(conn, statement)
        assert pending(conn) == (1, False), name
        conn.commit()
        detect(conn, scene.name, jobs=1)
        assert pending(conn) == (0, True), name
        found = answer(conn, scene)
        detect(conn, scene.name, full=True, jobs=1)
        assert answer(conn, scene) == found, name
    assert found


def test_settings_that_arrive_mark_everything(conn: Conn, scene: Scene) -> None:
    replicate(conn, "UPDATE conflictdb.scene SET separation_m = 500")
    assert pending(conn) == (11, False)


def test_a_rule_that_moves_marks_both_scenes(conn: Conn, scene: Scene) -> None:
    conn.execute("SELECT conflictdb.put_rule(%s, 'ferry', 'area', 500)", [scene.name])
    conn.commit()
    detect(conn, scene.name, jobs=1)
    conn.execute(
        "SELECT conflictdb.create_scene('z'), conflictdb.put_area('z', 'A', 'SRID=4326;POLYGON((0 0, 0 1, 1 1, 0 0))')"
    )
    conn.commit()
    detect(conn, "z", jobs=1)
    replicate(
        conn,
        "UPDATE conflictdb.rule SET scene_id = (SELECT s.scene_id FROM conflictdb.scene s WHERE s.name = 'z')",
    )
    assert conn.execute("SELECT is_current FROM conflictdb.scenes").fetchall() == [(False,), (False,)]


def test_a_bad_row_is_refused_there_too(conn: Conn, scene: Scene) -> None:
    with pytest.raises(psycopg.Error, match="must be above floor_m"):
        replicate(conn, "UPDATE conflictdb.area SET floor_m = 7, ceiling_m = 6 WHERE key = 'A1'")


def test_keys_stay_unique_and_are_free_again(conn: Conn, scene: Scene) -> None:
    replicate(conn, CHANGES["change a track"], CHANGES["remove an area"])
    put = "SELECT conflictdb.put_area(%s, %s, 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))')"
    for key in ("T1", "A1"):
        conn.execute(put.encode(), [scene.name, key])
    with pytest.raises(psycopg.Error, match="is taken by another object"):
        conn.execute(put.encode(), [scene.name, "RENAMED"])


def test_a_scene_that_is_removed_takes_along_what_was_made_of_it(conn: Conn, scene: Scene) -> None:
    """Foreign keys do not act on replicas."""
    replicate(conn, "DELETE FROM conflictdb.area", "DELETE FROM conflictdb.track", "DELETE FROM conflictdb.scene")
    for table in ("piece", "conflict", "run", "change", "object_key", "scene_lock"):
        assert conn.execute(f"SELECT count(*) FROM conflictdb.{table}".encode()).fetchone() == (0,), table


@pytest.mark.parametrize(
    "how",
    [
        "ALTER TABLE conflictdb.area DISABLE TRIGGER USER",
        "ALTER TABLE conflictdb.track DISABLE TRIGGER ALL; ALTER TABLE conflictdb.track ENABLE TRIGGER ALL",
        "ALTER TABLE conflictdb.scene DISABLE TRIGGER scene_changed",
        "DROP TRIGGER area_replicated ON conflictdb.area",
    ],
)
def test_triggers_that_do_not_fire_are_noticed_and_mended(conn: Conn, dsn: str, how: str) -> None:
    """As restores leave them (pg_restore --disable-triggers)."""
    for statement in how.split(";"):
        conn.execute(statement.encode())
    conn.commit()
    with pytest.raises(SchemaOutdated, match=r"triggers of schema conflictdb .* run `conflictdb admin upgrade`"):
        schema.check(conn)
    schema.upgrade(dsn)
    schema.check(conn)


def test_a_sequence_that_was_set_back_hides_no_change(conn: Conn, scene: Scene) -> None:
    """Restores set sequences to their values in the dump."""
    (version,) = conn.execute("SELECT version FROM conflictdb.area WHERE key = 'A1'").fetchall()[0]
    conn.execute("SELECT setval('conflictdb.version_seq', %s, false)", [version])
    conn.execute("UPDATE conflictdb.area SET floor_m = 3, ceiling_m = NULL WHERE key = 'A1'")
    assert pending(conn) == (1, False)
    conn.execute("SELECT setval('conflictdb.change_change_id_seq', 1, false)")
    conn.execute("UPDATE conflictdb.area SET floor_m = 4 WHERE key = 'A1'")
    conn.execute("UPDATE conflictdb.area SET floor_m = 5 WHERE key = 'A2'")
    assert pending(conn) == (2, False)
