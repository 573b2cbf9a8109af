"""docs/reference/sql.md, made from the comments in the catalog, is up to date; nothing public lacks a comment."""

import importlib.util
import re
from pathlib import Path

import psycopg

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_page_is_up_to_date(conn: psycopg.Connection) -> None:
    """Otherwise: ./run python docs/generate.py."""
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    assert spec
    assert spec.loader
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    page = generate.sql(conn)
    assert "|  |" not in page  # a column without a comment
    assert "```\n\n\n" not in page  # a routine without one
    assert page == (DOCS / "reference" / "sql.md").read_text()


def test_page_has_all_that_is_public_and_nothing_else(conn: psycopg.Connection) -> None:
    """A relation or routine without an underscore is public; each has a comment, and so has every column."""
    named = conn.execute(
        """SELECT c.relname, obj_description(c.oid, 'pg_class') FROM pg_class c
           WHERE c.relnamespace = 'conflictdb'::regnamespace AND c.relkind IN ('r', 'p', 'v') AND NOT c.relispartition
             AND c.relname <> 'alembic_version' AND left(c.relname, 1) <> '_'
           UNION ALL
           SELECT p.proname, obj_description(p.oid, 'pg_proc') FROM pg_proc p
           WHERE p.pronamespace = 'conflictdb'::regnamespace"""
    ).fetchall()
    page = (DOCS / "reference" / "sql.md").read_text()
    assert {name for name, _ in named} == set(re.findall(r"^### (\w+)$", page, re.MULTILINE))
    assert [name for name, said in named if not said] == []
    bare = conn.execute(
        """SELECT c.relname || '.' || a.attname FROM pg_attribute a JOIN pg_class c ON c.oid = a.attrelid
           WHERE c.relnamespace = 'conflictdb'::regnamespace AND c.relkind IN ('r', 'v') AND a.attnum > 0
             AND NOT a.attisdropped AND c.relname <> 'alembic_version' AND left(c.relname, 1) <> '_'
             AND coalesce(col_description(a.attrelid, a.attnum), '') = ''"""
    ).fetchall()
    assert bare == []


def test_psql_lists_public_routines_only(conn: psycopg.Connection) -> None:
    """`\\df conflictdb.*` and `\\dv conflictdb.*` show what the page documents; the rest is in conflictdb_internal."""
    of = """SELECT p.proname FROM pg_proc p WHERE p.pronamespace = to_regnamespace(%(schema)s)
            UNION ALL SELECT c.relname FROM pg_class c
            WHERE c.relnamespace = to_regnamespace(%(schema)s) AND c.relkind IN ('r', 'v', 'm', 'S')"""
    public, private = (
        {name for (name,) in conn.execute(of.encode(), {"schema": name})}
        for name in ("conflictdb", "conflictdb_internal")
    )
    assert {name for name in public if name.startswith("_")} == set()
    assert {name for name in private if not name.startswith("_")} == set()
    assert len(private) > 200


def test_columns_that_may_be_null_say_what_null_means(conn: psycopg.Connection) -> None:
    """No column of a table leaves it to guessing."""
    silent = conn.execute(
        """SELECT c.relname || '.' || a.attname FROM pg_attribute a JOIN pg_class c ON c.oid = a.attrelid
           WHERE c.relnamespace = 'conflictdb'::regnamespace AND c.relkind = 'r' AND a.attnum > 0
             AND NOT a.attnotnull AND NOT a.attisdropped AND c.relname <> 'alembic_version'
             AND col_description(a.attrelid, a.attnum) !~* '\\mnull\\M'"""
    ).fetchall()
    assert silent == []
