"""Replace routines."""

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "8650307c91af68e3ea6a9443a4fc1baaa67e5a1546d734ec3a6129825f56da5c"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


def upgrade() -> None:
    """Change nothing: the upgrade installs sql/ after each revision."""


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
