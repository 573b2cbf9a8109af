"""Requests to workers carry plans as they are written."""

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "1032c3e3a742c68cacb91129a62825c79d071cf5d1f6e1a348d067c036f9eba8"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = True


def upgrade() -> None:
    pass


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
