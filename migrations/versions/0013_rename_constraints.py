"""Rename the constraints on keys and names: what they check is that those are valid."""

from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "411c454e2d9c2a7c821cff1a4d17930f263fc383838221ff220e9e8407f4a099"


RENAMED = (("area", "area_key"), ("track", "track_key"), ("scene", "scene_name"))


def upgrade() -> None:
    for table, name in RENAMED:
        op.execute(f"ALTER TABLE conflictdb.{table} RENAME CONSTRAINT {name}_speakable TO {name}_valid")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
