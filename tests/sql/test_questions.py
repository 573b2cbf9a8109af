"""An empty answer never hides a mistake in the question."""

from typing import Any

import psycopg
import pytest
import shapely
from piecework import load

from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Motion, Scene

Conn = psycopg.Connection[Any]

AREA = Area("A", shapely.MultiPolygon([shapely.box(4, 57, 5, 58)]))
OTHER = Area("B", shapely.MultiPolygon([shapely.box(4.5, 57, 5, 58)]))
HERE = "ST_MakeEnvelope(4.6, 57.1, 4.7, 57.2, 4326)"

# Errors of a place, with the SQLSTATE of the refusal and the rule it names.
BAD_PLACES = {
    "no geometry": ("NULL", "NULL", "ZC001", "geometry_given"),
    "empty geometry": ("'SRID=4326;POLYGON EMPTY'", "NULL", "ZC001", "geometry_given"),
    "no reference system": ("ST_MakeEnvelope(4.6, 57.1, 4.7, 57.2)", "NULL", "ZC001", "geometry_srid"),
    "metres": (f"ST_Transform({HERE}, 3857)", "NULL", "ZC001", "geometry_srid"),
    "sides that cross": ("'SRID=4326;POLYGON((4 57,5 58,5 57,4 58,4 57))'", "NULL", "ZC001", "geometry_valid"),
    "latitude first": ("ST_MakeEnvelope(57, 104, 58, 105, 4326)", "NULL", "ZC005", "latitude_in_range"),
    "two turns away": ("ST_MakeEnvelope(724.6, 57, 725, 58, 4326)", "NULL", "ZC005", "longitude_in_range"),
    "empty span": (HERE, "'empty'", "ZC003", "span_not_empty"),
}


@pytest.mark.parametrize("case", BAD_PLACES)
def test_a_place_where_nothing_could_be_is_refused(conn: Conn, case: str) -> None:
    geometry, span, state, rule = BAD_PLACES[case]
    conn.execute("SELECT conflictdb.create_scene('s')")
    for question in ("probe", "conflicts_within"):
        for columns in ("*", "count(*)"):
            with pytest.raises(psycopg.Error) as refused, conn.transaction():
                conn.execute(f"SELECT {columns} FROM conflictdb.{question}('s', {geometry}, {span})".encode())
            assert (refused.value.sqlstate, refused.value.diag.constraint_name) == (state, rule)


@pytest.mark.parametrize("heights", ["100, -100", "'NaN', NULL", "NULL, '-Infinity'"])
def test_heights_between_which_nothing_could_be_are_refused(conn: Conn, heights: str) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    with pytest.raises(psycopg.Error) as refused:
        conn.execute(f"SELECT * FROM conflictdb.probe('s', {HERE}, NULL, {heights})".encode())
    assert refused.value.sqlstate == "ZC004"


@pytest.mark.parametrize(
    "question",
    [
        "conflicts_at(NULL, now())",
        "conflicts_of(NULL, 'A')",
        "approaches_of(NULL, 'A')",
        f"conflicts_within(NULL, {HERE}, NULL)",
        f"probe(NULL, {HERE})",
        "candidates(NULL)",
    ],
)
def test_a_scene_that_is_null_is_refused(conn: Conn, question: str) -> None:
    with pytest.raises(psycopg.Error, match="scene NULL: name: is not in this database"):
        conn.execute(f"SELECT * FROM conflictdb.{question}".encode())


@pytest.mark.parametrize("motion", list(Motion))
def test_a_span_that_is_null_is_all_time(conn: Conn, motion: Motion) -> None:
    load(conn, Scene("s", motion), [AREA, OTHER], [])
    detect(conn, "s", jobs=1)
    found = conn.execute(f"SELECT key FROM conflictdb.probe('s', {HERE}, NULL)".encode()).fetchall()
    assert sorted(found) == [("A",), ("B",)]
    found = conn.execute(f"SELECT a_key, b_key FROM conflictdb.conflicts_within('s', {HERE}, NULL)".encode()).fetchall()
    assert found == [("A", "B")]


@pytest.mark.parametrize("key", ["'nobody'", "NULL"])
def test_who_asks_for_an_object_that_is_not_there_is_told(conn: Conn, key: str) -> None:
    load(conn, Scene("s"), [AREA, OTHER], [])
    detect(conn, "s", jobs=1)
    notices: list[str | None] = []
    conn.add_notice_handler(lambda notice: notices.append(notice.message_primary))
    for question in ("conflicts_of", "approaches_of"):
        assert len(conn.execute(f"SELECT * FROM conflictdb.{question}('s', 'A')".encode()).fetchall()) == 1
        assert notices == []
        assert conn.execute(f"SELECT * FROM conflictdb.{question}('s', {key})".encode()).fetchall() == []
        assert notices == [f"scene 's': holds no object {key}"]
        notices.clear()
