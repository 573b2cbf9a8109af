"""${message}."""

from alembic import op

revision = ${repr(up_revision)}
down_revision = ${repr(down_revision)}
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = ""

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


def upgrade() -> None:
    ${upgrades if upgrades else "pass"}


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
