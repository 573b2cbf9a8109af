"""Requests count their attempts."""

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "4fad277114473f38011807518f9b72b05d2b401d4be16fae25ad235d6709653a"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


def upgrade() -> None:
    pass


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
