"""A release after this one, for tests of upgrades."""

import shutil
from pathlib import Path

import pytest

from conflictdb.jobs import schema

ROOT = Path(schema.__file__).resolve().parents[2]


@pytest.fixture
def next_release(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the tree of a next release: a revision that adds a column, and a routine that reads it."""
    for name in ("sql", "migrations"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    number = int(schema.head()) + 1
    (tmp_path / "migrations" / "versions" / f"{number:04}_add_scene_note.py").write_text(
        f"""from alembic import op
revision = "{number:04}"
down_revision = "{schema.head()}"
changes_answers = False


def upgrade() -> None:
    op.execute("ALTER TABLE conflictdb.scene ADD COLUMN note text DEFAULT 'none: 100%'")
"""
    )
    (tmp_path / "sql" / "86_note.sql").write_text(
        """CREATE OR REPLACE FUNCTION scene_note(p_scene text) RETURNS text LANGUAGE sql STABLE PARALLEL SAFE
BEGIN ATOMIC SELECT format('%s :x', s.note) FROM scene s WHERE s.name = p_scene; END;
"""
    )
    monkeypatch.setattr(schema, "_folder", lambda name: tmp_path / name)
    return tmp_path
