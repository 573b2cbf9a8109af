"""The models of SQLAlchemy are the database, and the product works within transactions of SQLAlchemy's."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psycopg
import pytest
import sqlalchemy
from geoalchemy2 import Geometry, WKTElement
from patience import WAIT_S
from sqlalchemy import func, inspect, select
from sqlalchemy.dialects import postgresql
from sqlalchemy.orm import Session
from sqlalchemy.pool import NullPool

import conflictdb
from conflictdb import StoreError, models

STRAIT = Path(__file__).resolve().parents[2] / "conflictdb/scenes/strait.geojson"
MODELS = sorted(models.Base.__subclasses__(), key=lambda one: one.__name__)
COLUMNS = """
SELECT a.attname, format_type(a.atttypid, a.atttypmod), a.attnotnull, d.oid IS NOT NULL, c.relkind,
       coalesce(col_description(a.attrelid, a.attnum), '')
FROM pg_attribute a JOIN pg_class c ON c.oid = a.attrelid
LEFT JOIN pg_attrdef d ON (d.adrelid, d.adnum) = (a.attrelid, a.attnum)
WHERE a.attrelid = %s::regclass AND a.attnum > 0 AND NOT a.attisdropped ORDER BY a.attnum
"""
TYPES = {"name": "text", "xid8": "text"}  # types that read the same


@pytest.fixture
def engine(dsn: str) -> Iterator[sqlalchemy.Engine]:
    made = sqlalchemy.create_engine("postgresql+psycopg://", creator=lambda: psycopg.connect(dsn), poolclass=NullPool)
    yield made
    made.dispose()


def type_of(column: sqlalchemy.Column[Any]) -> str:
    """Return the type of a column as the catalog names it."""
    if isinstance(column.type, Geometry):
        kind = {"MULTIPOLYGON": "MultiPolygon", "LINESTRINGM": "LineStringM"}.get(str(column.type.geometry_type))
        kind = kind or str(column.type.geometry_type).capitalize()
        return f"geometry({kind},{column.type.srid})" if column.type.srid > 0 else f"geometry({kind})"
    said = column.type.compile(postgresql.dialect()).lower()
    many = "[]" if said.endswith("[]") else ""
    return said if "timestamp" not in said else f"timestamp with time zone{many}"


@pytest.mark.parametrize("model", MODELS, ids=lambda one: one.__name__)
def test_model_has_the_columns_of_the_database(model: type[models.Base], conn: psycopg.Connection[Any]) -> None:
    """Names, types, nullability; the comment of a view's column on null counts."""
    table = inspect(model).local_table
    rows = conn.execute(COLUMNS.encode(), [str(table)]).fetchall()
    names, stored = [column.name for column in table.columns], [row[0] for row in rows]
    assert sorted(names) == sorted(stored)
    for name, kind, is_not_null, has_default, relkind, comment in rows:
        column = table.columns[name]
        assert type_of(column) == TYPES.get(kind, kind), name
        if relkind == "r":
            assert column.nullable is not is_not_null, name
            assert column.server_default is not None or not has_default, name
        elif "null" in comment.split():
            assert column.nullable, name


def test_every_table_of_inputs_and_every_view_has_a_model(conn: psycopg.Connection[Any]) -> None:
    views = "SELECT relname FROM pg_class WHERE relnamespace = 'conflictdb'::regnamespace AND relkind = 'v'"
    # Layers for maps repeat columns of other views.
    named = {name for (name,) in conn.execute(f"{views} AND relname !~ '^(_|map_)'".encode())}
    assert {one.__tablename__ for one in MODELS} == named | {"scene", "area", "track"}


def test_no_view_has_a_null_that_its_model_has_not(engine: sqlalchemy.Engine) -> None:
    """Rows of a scene that is detected, waits again, has closest approaches and an acknowledgement."""
    with conflictdb.connect(engine) as db:
        db.load(STRAIT)
        db.scene("strait").detect(nearest_m=20_000)
        db.scene("strait").resolve(limit_s=5.0)
        db.scene("strait").put_rule(conflictdb.Rule("ferry", None, 500.0))
    with Session(engine) as session:
        found = session.scalars(select(models.ConflictRow)).first()
        assert found is not None
        session.execute(select(func.conflictdb.acknowledge("strait", found.a_key, found.b_key, "seen")))
        session.execute(select(func.conflictdb.remove_object("strait", "FERRY")))
        seen = set()
        for model in MODELS:
            for row in session.scalars(select(model)):
                seen.add(model.__name__)
                for column in inspect(model).local_table.columns:
                    assert column.nullable or getattr(row, column.key) is not None, (model, column.key)
        assert seen == {one.__name__ for one in MODELS} - {
            "AttachmentRow",
            "LiveConflictRow",
            "LiveEventRow",
            "LiveRow",
            "UnmappedRow",
        }


def test_objects_are_added_changed_and_detected(engine: sqlalchemy.Engine) -> None:
    """By the unit of work of a session: two squares overlap until one is moved."""
    square = "MULTIPOLYGON((({0} 57, {1} 57, {1} 58, {0} 58, {0} 57)))"
    with Session(engine) as session:
        scene = models.SceneRow(name="plan")
        session.add(scene)
        session.flush()
        for key, west in (("A", 4.0), ("B", 4.5)):
            footprint = WKTElement(square.format(west, west + 1.0), srid=4326)
            session.add(models.AreaRow(scene_id=scene.scene_id, key=key, footprint=footprint))
        session.commit()
        with conflictdb.connect(engine) as db:
            db.scene("plan").detect()
        (found,) = session.scalars(select(models.ConflictRow).where(models.ConflictRow.scene == "plan"))
        assert (found.a_key, found.b_key, found.verdict) == ("A", "B", "conflict")
        assert found.first_contact is None
        assert found.periods[0].lower is None
        moved = session.scalars(select(models.AreaRow).where(models.AreaRow.key == "B")).one()
        before = moved.version
        moved.footprint = WKTElement(square.format(6.0, 7.0), srid=4326)
        session.commit()
        assert moved.version > before
        assert session.get(models.QueuedRow, "plan") is not None


@pytest.mark.parametrize("kind", ["connection", "session", "begun"])
def test_a_transaction_of_sqlalchemy_is_the_callers(engine: sqlalchemy.Engine, kind: str) -> None:
    """Changes within it disappear on rollback, and stay on commit."""

    def count() -> Any:
        with engine.connect() as other:
            return other.scalar(select(func.count()).select_from(models.SceneRow))

    with engine.connect() if kind != "session" else Session(engine) as lender:
        with conflictdb.connect(lender) as db:
            for is_kept in (False, True):
                lender.rollback()
                if kind == "begun":
                    lender.begin()  # no statement yet: the server knows nothing of it
                elif kind == "connection":
                    lender.execute(select(1))
                db.load(STRAIT)
                assert [one.scene.name for one in db.scenes()] == ["strait"]
                with pytest.raises(StoreError, match="without an open transaction: commit or roll back first"):
                    db.scene("strait").detect()
                assert count() == 0
                if is_kept:
                    lender.commit()
        assert count() == 1
        lender.execute(select(1))  # it stays open


def test_a_connection_of_sqlalchemy_without_transaction_detects(engine: sqlalchemy.Engine) -> None:
    with engine.connect() as lender, conflictdb.connect(lender) as db:
        db.load(STRAIT)
        assert db.scene("strait").detect().conflicts == 7
        assert lender.scalar(select(func.count()).select_from(models.ConflictRow)) == 7


def test_a_session_sees_what_it_has_not_written_yet(engine: sqlalchemy.Engine) -> None:
    """As for its own queries: pending changes are flushed first."""
    with Session(engine) as session, conflictdb.connect(session) as db:
        session.add(models.SceneRow(name="pending"))
        assert [one.scene.name for one in db.scenes()] == ["pending"]


def test_models_name_the_extra_that_they_need() -> None:
    script = "import sys\nsys.modules['geoalchemy2'] = None\nfrom conflictdb import models"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=WAIT_S)
    assert done.stderr.splitlines()[-1].endswith("needs geoalchemy2: pip install 'conflictdb[sqlalchemy]'")
