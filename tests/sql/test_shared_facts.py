"""Facts in both Python and SQL are equal: verdicts, kinds, choices, the earth's size, counts of a run."""

import re
from dataclasses import fields
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

import psycopg
import pytest

from conflictdb import connect, store
from conflictdb.core.funnel import MEASURES, Funnel
from conflictdb.earth.geodesy import MEAN_RADIUS_M, WGS84_FLATTENING, WGS84_RADIUS_M, earth_of
from conflictdb.jobs import schema
from conflictdb.jobs.detect import Run
from conflictdb.model.methods import Method
from conflictdb.model.plans import EarthModel, Motion
from conflictdb.model.results import Kind, Verdict

Conn = psycopg.Connection[Any]


@pytest.mark.parametrize(
    ("constraint", "names"),
    [
        ("conflict_verdict_known", Verdict),
        ("scene_method_known", Method),
        ("scene_earth_known", EarthModel),
        ("scene_motion_known", Motion),
    ],
)
def test_tables_take_the_names_that_python_has(conn: Conn, constraint: str, names: type[StrEnum]) -> None:
    (definition,) = conn.execute(
        "SELECT pg_get_constraintdef(oid) FROM pg_constraint WHERE conname = %s", [constraint]
    ).fetchone() or ("",)
    assert set(re.findall("'([^']*)'", definition)) == {one.value for one in names}


def test_kinds_have_one_code(conn: Conn) -> None:
    """An area and a track of a scene are marked, each with the code of its kind; views say its name."""
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute("SELECT conflictdb.put_area('s', 'A', ST_MakeEnvelope(4, 57, 5, 58, 4326))")
    assert conn.execute("SELECT object_kind FROM conflictdb.change").fetchall() == [(Kind.AREA.code,)]
    conn.execute("DELETE FROM conflictdb.change")
    conn.execute(
        """SELECT conflictdb.put_track('s', 'T', ST_GeomFromText('LINESTRING M (4 57 0, 5 58 3600)', 4326),
                                       ST_MakeEnvelope(-10, -10, 10, 10))"""
    )
    assert conn.execute("SELECT object_kind FROM conflictdb.change").fetchall() == [(Kind.TRACK.code,)]
    for view in ("conflicts", "approaches"):
        (text,) = conn.execute("SELECT pg_get_viewdef(%s::regclass)", [f"conflictdb.{view}"]).fetchone() or ("",)
        cases = re.findall(r"WHEN (\d) THEN '(\w+)'::text\s+ELSE '(\w+)'::text", text)
        assert cases == [(str(Kind.AREA.code), Kind.AREA, Kind.TRACK)] * 2
    for kind in Kind:
        assert Kind.of_code(kind.code) is kind
    for verdict in Verdict:
        assert Verdict.of_code(verdict.code) is verdict


def test_the_earth_has_one_size(conn: Conn) -> None:
    """And SQL has it once; constants derived from the flattening equal those of Python."""
    found = conn.execute(
        """SELECT conflictdb_internal._radius_m('sphere'), conflictdb_internal._radius_m('wgs84'),
                  conflictdb_internal._rectifying_m('sphere'), conflictdb_internal._rectifying_m('wgs84'),
                  conflictdb_internal._latitude(conflictdb_internal._rectifying(0.7, 'wgs84'), 'wgs84'),
                  conflictdb_internal._rectifying(0.7, 'wgs84'), conflictdb_internal._globe()"""
    ).fetchone()
    assert found is not None
    wgs84 = earth_of(EarthModel.WGS84)
    assert found[:2] == (MEAN_RADIUS_M, WGS84_RADIUS_M)
    assert found[2:4] == (MEAN_RADIUS_M, pytest.approx(wgs84.rectifying_m, rel=1e-15))
    assert found[4] == pytest.approx(0.7, rel=1e-15)
    assert found[5] == pytest.approx(float(wgs84.rectifying(0.7)), rel=1e-15)
    assert found[6] == f"+proj=longlat +R={MEAN_RADIUS_M} +no_defs"
    assert pytest.approx(WGS84_RADIUS_M * (1.0 - WGS84_FLATTENING / 3.0), rel=1e-12) == MEAN_RADIUS_M
    text = "".join(re.sub("--.*|^COMMENT(.|\n)*?;$", "", f.read_text(), flags=re.M) for f in schema.routine_files())
    for number in ("6371008", "6378137"):
        assert len(re.findall(number, text)) == 1, number


def test_the_table_of_runs_has_the_names_of_what_is_counted(conn: Conn) -> None:
    """Its columns are those of RunStatus; other counts are stored with the settings, or not at all."""
    columns = [
        name
        for (name,) in conn.execute(
            """SELECT attname FROM pg_attribute
               WHERE attrelid = 'conflictdb.run'::regclass AND attnum > 0 AND NOT attisdropped"""
        )
    ]
    assert set(columns) == {field.name for field in fields(store.RunStatus)}
    assert {one.name for one in MEASURES if one.column} <= set(columns)
    assert {name for name in columns if name.endswith(("_pairs", "_s"))} == {
        "write_s",
        *(one.name for one in MEASURES if one.column),
    }
    measured = [one.name for one in MEASURES]
    assert [field.name for field in fields(Funnel)] == [*measured, "effort", "settings"]
    assert set(measured) <= {field.name for field in fields(Run)}


def test_comments_of_the_table_of_runs_say_what_is_counted(conn: Conn) -> None:
    for one in MEASURES:
        if one.column:
            row = conn.execute(
                """SELECT col_description(attrelid, attnum) FROM pg_attribute
                   WHERE attrelid = 'conflictdb.run'::regclass AND attname = %s""",
                [one.name],
            ).fetchone()
            assert row == (f"{one.meaning}; null if the run failed.",)


def test_every_measure_is_recorded(conn: Conn) -> None:
    """For a run that succeeds, and a failed run up to its failure; measures without a column are in the settings."""
    with connect(conn) as db:
        db.load_demo()
        done = db.scene("strait").detect()
        (run,) = store.runs(conn, "strait")
    kept = {one.name: run.settings.get(one.name, getattr(run, one.name, None)) for one in MEASURES}
    assert kept == {one.name: getattr(done, one.name) for one in MEASURES}
    assert {"closed_forms", "searched_pairs", "lp_calls", "tolerance_m"} <= set(run.settings)
    counted = {one.name: 3 + k for k, one in enumerate(MEASURES)}
    record = store.RunRecord("exact", {}, datetime.now(UTC), counted)
    store.record_failure(conn, run.scene_id, record, "failed")
    (failed,) = store.runs(conn, "strait")
    assert {name: getattr(failed, name, None) for name in counted} == {
        one.name: counted[one.name] if one.column else None for one in MEASURES
    }
