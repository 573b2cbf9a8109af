"""Keep edits, limits and positions."""

from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "f877ec03775c0318380f93612d24002d26677776c48207cf821ab0b39b940e0e"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


# A layer of a map program looks its rows up by number.
CONFLICT_ID = """
CREATE INDEX IF NOT EXISTS conflict_conflict_id_btree ON conflictdb.conflict (conflict_id) WHERE verdict <> 'near'
"""


def upgrade() -> None:
    op.execute(CONFLICT_ID)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
