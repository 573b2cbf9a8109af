"""Let numbers of marks repeat: a restore makes marks of its own, and sets the sequence back to that of the dump."""

from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "005f7fb35f961becfe92755e2e493e286958b77aad3616c2b3c941732cfcd749"


def upgrade() -> None:
    op.execute("ALTER TABLE conflictdb.change DROP CONSTRAINT change_pkey")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
