"""The product has all names that docs/reference/stability.md promises."""

import re
from pathlib import Path

import psycopg

import conflictdb
from conflictdb.cli.commands import GROUPS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "stability.md"


def promised(section: str) -> set[str]:
    """Return the names of a section of the page."""
    [text] = re.findall(rf"^## {section}\n(.*?)(?=^## |\Z)", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    return set(re.findall(r"`(\w+)`", text))


def test_promised_names_are_there(conn: psycopg.Connection) -> None:
    """Users' programs need them. To remove a name, deprecate it first, as the page says."""
    found = {
        kind: {name for (name,) in conn.execute(query).fetchall()}
        for kind, query in {
            "Views": "SELECT viewname FROM pg_views WHERE schemaname = 'conflictdb'",
            "Tables": "SELECT tablename FROM pg_tables WHERE schemaname = 'conflictdb' UNION SELECT attname "
            "FROM pg_attribute WHERE attrelid = 'conflictdb.position'::regclass AND attnum > 0 AND NOT attisdropped",
            "Routines": "SELECT proname FROM pg_proc WHERE pronamespace = 'conflictdb'::regnamespace",
            "Roles": "SELECT rolname FROM pg_roles",
        }.items()
    }
    found["Python"] = {"conflictdb", *conflictdb.__all__}
    found["Commands"] = {name for _, names in GROUPS for name in names}
    for section, names in found.items():
        assert len(promised(section)) >= 3
        assert promised(section) - names == set(), section
