"""Add separation in time, and the differences of departure times that scenes store."""

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "a9e967e96803eb74b8006e9ddf6198483f9ac438212d92d45be415d5bd2f108e"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


def upgrade() -> None:
    pass


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
