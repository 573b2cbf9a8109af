"""The views have the columns of the table `conflictdb.record`, with the same types and the same sentences."""

from typing import Any

import psycopg
import pytest

from conflictdb import record
from conflictdb.record import Column, Type

TYPES = {
    Type.TEXT: "text",
    Type.NAME: "text",
    Type.INSTANT: "timestamp with time zone",
    Type.PERIODS: "tstzmultirange",
    Type.NUMBER: "double precision",
    Type.WHOLE: "bigint",
    Type.TRUTH: "boolean",
    Type.POINT: "geometry(Point,4326)",
    Type.REGION: "geometry(Geometry,4326)",
}


def of_view(conn: psycopg.Connection[Any], view: str) -> list[tuple[str, str, str]]:
    return conn.execute(
        """SELECT a.attname, format_type(a.atttypid, a.atttypmod), col_description(a.attrelid, a.attnum)
           FROM pg_attribute a WHERE a.attrelid = %s::regclass AND a.attnum > 0 ORDER BY a.attnum""",
        [f"conflictdb.{view}"],
    ).fetchall()


@pytest.mark.parametrize(("view", "columns"), [("conflicts", record.COLUMNS), ("approaches", record.APPROACH_COLUMNS)])
def test_views_have_the_columns_of_the_record(
    conn: psycopg.Connection[Any], view: str, columns: tuple[Column, ...]
) -> None:
    told = [(name, kind) for name, kind, _ in of_view(conn, view)]
    assert told == [(one.name, TYPES[one.type]) for one in columns]


def test_comments_begin_with_the_sentence_of_the_record(conn: psycopg.Connection[Any]) -> None:
    """A comment may say more."""
    said = {name: comment for name, _, comment in of_view(conn, "conflicts")}
    for one in record.COLUMNS:
        assert f"{said[one.name]} ".startswith(f"{one.meaning} "), one.name
