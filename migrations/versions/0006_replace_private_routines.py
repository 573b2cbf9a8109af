"""Private routines are replaced by upgrades."""

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "646ce9b770481268cd18b7579e9a974893ba69eaa067d1ddb0b902efa4684690"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


def upgrade() -> None:
    pass


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
