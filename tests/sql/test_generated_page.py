"""docs/reference/sql.md, made from the comments in the catalog, is up to date; nothing public lacks a comment."""

import importlib.util
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
