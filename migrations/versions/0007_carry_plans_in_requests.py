"""Requests to workers carry plans as they are written."""

from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "d8585eee331bd93e81c16ef7939c49a4809476333985284869a64bd1a2b44832"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = True


REQUESTS = """
ALTER TABLE conflictdb.probe_request ADD COLUMN IF NOT EXISTS replace text[];
"""


def upgrade() -> None:
    op.execute(REQUESTS)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
