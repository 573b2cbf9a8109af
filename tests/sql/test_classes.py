"""Classes and owners of areas and tracks: kept by every way in, refused where they name nothing."""

from typing import Any

import psycopg
import pytest

Conn = psycopg.Connection[Any]

BOX = "ST_GeomFromText('POLYGON ((0 0, 1 0, 1 1, 0 1, 0 0))', 4326)"
PATH = "conflictdb.track_path(ST_GeomFromText('LINESTRING (0 0, 1 1)', 4326), '{2026-01-01Z, 2026-01-02Z}')"
OUTLINE = "conflictdb.rectangle_outline(10, 10, 10, 10)"


def put(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute(f"SELECT conflictdb.put_area('s', 'A', {BOX}, p_class => 'range', p_owner => 'navy')")
    conn.execute(f"SELECT conflictdb.put_track('s', 'T', {PATH}, {OUTLINE}, p_class => 'ferry', p_owner => 'line')")


def listed(conn: Conn, scene: str) -> list[tuple[Any, ...]]:
    return conn.execute("SELECT key, class, owner FROM conflictdb.list_objects(%s)", [scene]).fetchall()


def test_list_and_copy_keep_them(conn: Conn) -> None:
    put(conn)
    conn.execute("SELECT conflictdb.copy_scene('s', 'c')")
    assert listed(conn, "s") == listed(conn, "c") == [("A", "range", "navy"), ("T", "ferry", "line")]


@pytest.mark.parametrize(("table", "column"), [("area", "class"), ("area", "owner"), ("track", "class")])
def test_a_change_is_a_new_version_with_a_mark(conn: Conn, table: str, column: str) -> None:
    put(conn)
    conn.execute("DELETE FROM conflictdb.change")
    before = conn.execute(f"SELECT version FROM conflictdb.{table}").fetchone()
    conn.execute(f"UPDATE conflictdb.{table} SET {column} = 'other'")
    assert conn.execute(f"SELECT version FROM conflictdb.{table}").fetchone() > before
    assert conn.execute("SELECT count(*) FROM conflictdb.change").fetchone() == (1,)


def test_an_attached_table_may_give_them(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute("CREATE TABLE public.zones (id text PRIMARY KEY, geom geometry, sort text, unit text)")
    conn.execute(f"INSERT INTO public.zones VALUES ('A', {BOX}, 'range', 'navy')")
    mapped = '{"key": "id", "footprint": "geom", "class": "sort", "owner": "unit"}'
    conn.execute("SELECT conflictdb.attach('s', 'area', 'public.zones', %s)", [mapped])
    conn.execute("SELECT conflictdb.follow_attached('s')")
    assert listed(conn, "s") == [("A", "range", "navy")]
    conn.execute("UPDATE public.zones SET sort = 'closed'")
    conn.execute("SELECT conflictdb.follow_attached('s')")
    assert listed(conn, "s") == [("A", "closed", "navy")]
