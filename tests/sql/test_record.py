"""The views have the columns of the table `conflictdb.model.record`, with the same types and the same sentences."""

from typing import Any

import psycopg
import pytest
from commands import STRAIT

from conflictdb import connect, read, solve
from conflictdb.model import record
from conflictdb.model.record import Column, ColumnType

TYPES = {
    ColumnType.TEXT: "text",
    ColumnType.NAME: "text",
    ColumnType.INSTANT: "timestamp with time zone",
    ColumnType.PERIODS: "tstzmultirange",
    ColumnType.NUMBER: "double precision",
    ColumnType.WHOLE: "bigint",
    ColumnType.TRUTH: "boolean",
    ColumnType.POINT: "geometry(Point,4326)",
    ColumnType.REGION: "geometry(Geometry,4326)",
    ColumnType.JSON: "jsonb",
}


def of_view(conn: psycopg.Connection[Any], view: str) -> list[tuple[str, str, str]]:
    return conn.execute(
        """SELECT a.attname, format_type(a.atttypid, a.atttypmod), col_description(a.attrelid, a.attnum)
           FROM pg_attribute a WHERE a.attrelid = %s::regclass AND a.attnum > 0 ORDER BY a.attnum""",
        [f"conflictdb.{view}"],
    ).fetchall()


@pytest.mark.parametrize(
    ("view", "columns"), [("conflicts", record.COLUMNS + record.ATTACHED), ("approaches", record.APPROACH_COLUMNS)]
)
def test_views_have_the_columns_of_the_record(
    conn: psycopg.Connection[Any], view: str, columns: tuple[Column, ...]
) -> None:
    typed = [(name, kind) for name, kind, _ in of_view(conn, view)]
    assert typed == [(one.name, TYPES[one.type]) for one in columns]


def test_comments_begin_with_the_sentence_of_the_record(conn: psycopg.Connection[Any]) -> None:
    """A comment may say more."""
    said = {name: comment for name, _, comment in of_view(conn, "conflicts")}
    for one in record.COLUMNS + record.ATTACHED:
        assert f"{said[one.name]} ".startswith(f"{one.meaning} "), one.name


def test_the_first_contact_is_a_point_and_two_numbers(dsn: str) -> None:
    """In the view and in Python; null in both if the method does not compute it."""
    with connect(dsn) as db:
        for method in ("exact", "screen"):
            db.load_demo()
            db.scene("strait").detect(method=method)
            rows = db.connection.execute(
                """SELECT a_key, b_key, first_contact_lon_deg, first_contact_lat_deg, ST_X(first_contact_point)
                   FROM conflictdb.conflicts"""
            ).fetchall()
            db.connection.commit()
            given = {(a, b): (lon, lat) for a, b, lon, lat, _ in rows}
            assert [lon for _, _, lon, _, _ in rows] == [x for *_, x in rows]
            found = db.scene("strait").conflicts()
            assert given == {
                (one.a_key, one.b_key): (one.first_contact_lon_deg, one.first_contact_lat_deg) for one in found
            }
            places = [one.first_contact_deg or (None, None) for one in found]
            assert [given[one.a_key, one.b_key] for one in found] == places
            assert any(lon is not None for lon, _ in places) == (method == "exact")


def test_names_are_those_of_the_objects_now(dsn: str) -> None:
    """In both views, in Python and in memory; an object without a name has null."""
    with connect(dsn) as db:
        db.load_demo()
        scene = db.scene("strait")
        scene.detect(nearest_m=5000)
        (one,) = [one for one in scene.conflicts() if (one.a_key, one.b_key) == ("FIRING", "FERRY")]
        assert one.labels == ("FIRING (Firing practice)", "FERRY (Ferry)")
        assert {near.labels for near in scene.approaches()} >= {one.labels}
        assert one.approach is not None
        assert one.approach.labels == one.labels
        own_file = read(STRAIT)
        found = solve(own_file.tracks, own_file.areas)
        (solved,) = [own for own in found if (own.a_key, own.b_key) == ("FIRING", "FERRY")]
        assert solved.labels == one.labels
        db.connection.execute("UPDATE conflictdb.area SET name = 'Range' WHERE key = 'FIRING'")
        db.connection.execute("UPDATE conflictdb.track SET name = NULL WHERE key = 'FERRY'")
        for view in ("conflicts", "approaches"):
            query = f"SELECT a_name, b_name FROM conflictdb.{view} WHERE a_key = 'FIRING' AND b_key = 'FERRY'"
            assert db.connection.execute(query.encode()).fetchall() == [("Range", None)]
        db.connection.commit()
        (one,) = [one for one in scene.conflicts() if (one.a_key, one.b_key) == ("FIRING", "FERRY")]
        assert one.labels == ("FIRING (Range)", "FERRY")
