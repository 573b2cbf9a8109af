"""Let numbers of marks repeat: a restore makes marks of its own, and sets the sequence back to that of the dump."""

from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "2b87a447d6a3d97e982a9b65437e9b6a7168be91c139982d6eaa7905c4387045"


def upgrade() -> None:
    op.execute("ALTER TABLE conflictdb.change DROP CONSTRAINT change_pkey")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
