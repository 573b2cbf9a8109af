"""Read large backlogs of positions in parts."""

from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "f093525a6ac55d9a4f2a191bb82fce81109e3c2229ff9c0f453760e8b9602bcf"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


# Which transaction looks read in parts, and up to which position.
POSITION_LOOK = """
ALTER TABLE conflictdb.position_look
    ADD COLUMN IF NOT EXISTS renamed pg_snapshot,
    ADD COLUMN IF NOT EXISTS transaction_id xid8,
    ADD COLUMN IF NOT EXISTS scene_id bigint,
    ADD COLUMN IF NOT EXISTS instant timestamptz,
    ADD COLUMN IF NOT EXISTS key text COLLATE "C",
    ADD COLUMN IF NOT EXISTS is_behind boolean NOT NULL DEFAULT false,
    DROP CONSTRAINT IF EXISTS position_look_parts,
    ADD CONSTRAINT position_look_parts CHECK (num_nulls(transaction_id, scene_id, instant, key) IN (0, 4))
"""
# A part is read from where the last one ended, without a sort of all that waits.
POSITION_TRANSACTION_ID = """
DROP INDEX IF EXISTS conflictdb.position_transaction_id_btree;
CREATE INDEX position_transaction_id_btree ON conflictdb.position (transaction_id, scene_id, instant, key)
"""
# As which verdict an alarm was acknowledged.
ACKNOWLEDGED_AS = """
ALTER TABLE conflictdb.live_conflict ADD COLUMN IF NOT EXISTS acknowledged_as text;
UPDATE conflictdb.live_conflict SET acknowledged_as = verdict
    WHERE acknowledged_at IS NOT NULL AND acknowledged_as IS NULL
"""
# Looks follow renames by their transactions; few edits are renames.
EDIT_RENAMES = """
CREATE INDEX IF NOT EXISTS edit_renames_btree ON conflictdb.edit (transaction_id) WHERE action = 'rename'
"""


def upgrade() -> None:
    op.execute(POSITION_LOOK)
    op.execute(POSITION_TRANSACTION_ID)
    op.execute(ACKNOWLEDGED_AS)
    op.execute(EDIT_RENAMES)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
