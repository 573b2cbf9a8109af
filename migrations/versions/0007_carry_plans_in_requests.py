"""Requests to workers carry plans as they are written."""

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "4f15848e73c86ce1f7e56a5d8c2dcbcdd093b28eddcfa77f153b604981260113"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = True


def upgrade() -> None:
    pass


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
