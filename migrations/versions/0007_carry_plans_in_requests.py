"""Requests to workers carry plans as they are written."""

from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "de83f4bce80aa98dbf2a75b5a5a71a5df5f3410ff5b113492d9c258e688b6208"

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
