"""Private routines are replaced by upgrades."""

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "bf1e0de39e141ec472b4a32b0d9c29f0cd42121955e7bac2bd84a015b34fec3f"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


def upgrade() -> None:
    pass


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
