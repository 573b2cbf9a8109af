"""Let numbers of marks repeat: a restore brings marks of its own, and sets the sequence back to what it was in the dump."""

from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "5beb0809a906b811eff2bbc81a988a1bef8c8edd5f767300081daf4cf3956a7f"


def upgrade() -> None:
    op.execute("ALTER TABLE conflictdb.change DROP CONSTRAINT change_pkey")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
