"""Let a scene be removed while it is detected: its row of scene_lock goes by a trigger that waits for nobody."""

from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "3eb85445f019b0f885a3a2980c8907e4be8898641cde065c4e7d31194ec77776"


def upgrade() -> None:
    op.execute("ALTER TABLE conflictdb.scene_lock DROP CONSTRAINT IF EXISTS scene_lock_scene_fkey;")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
