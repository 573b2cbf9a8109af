"""Read large backlogs of positions in parts."""

from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "e3405465289ee7a3c4311f4dfcabf7055ecefe35f58ca88fbfe745c938cd688f"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


# Which transactions a look reads in parts, and up to which position.
POSITION_LOOK = """
ALTER TABLE conflictdb.position_look
    ADD COLUMN IF NOT EXISTS reading pg_snapshot,
    ADD COLUMN IF NOT EXISTS scene_id bigint,
    ADD COLUMN IF NOT EXISTS instant timestamptz,
    ADD COLUMN IF NOT EXISTS key text COLLATE "C",
    DROP CONSTRAINT IF EXISTS position_look_parts,
    ADD CONSTRAINT position_look_parts CHECK (num_nulls(reading, scene_id, instant, key) IN (0, 4))
"""


def upgrade() -> None:
    op.execute(POSITION_LOOK)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
