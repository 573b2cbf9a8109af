"""Offer method `exact` for scenes, and make it the default of new ones."""

from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "7b49f8976dd143144df1cc71af1d4e99234d2d82d93e6fdfad49a6e8ff2c33f4"


def upgrade() -> None:
    op.execute("ALTER TABLE conflictdb.scene DROP CONSTRAINT scene_method_known")
    op.execute(
        "ALTER TABLE conflictdb.scene ADD CONSTRAINT scene_method_known "
        "CHECK (method IN ('screen', 'window', 'exact', 'nlp'))"
    )
    op.execute("ALTER TABLE conflictdb.scene ALTER COLUMN method SET DEFAULT 'exact'")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
