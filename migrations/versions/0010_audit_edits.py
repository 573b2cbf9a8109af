"""Audit edits, and keep limits and history in tables."""

from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "9b5da53f1ea97d2d7556adf6b89307a54bb659a1e60321b911e85af0c19ec7bb"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

STATEMENTS: tuple[str, ...] = ()


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
