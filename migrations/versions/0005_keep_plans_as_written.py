"""Plans as they are written."""

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "73dfd89e535cc83e0a20f31fda15b3dee41f86ce52563c2b83b67b3135a414fe"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

# Floor at the start and the end of the leg, then the ceilings; null where they do not change.
CLIMB = """
ALTER TABLE conflictdb.piece ADD COLUMN IF NOT EXISTS climb double precision[];
"""


def upgrade() -> None:
    for statement in (CLIMB,):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
