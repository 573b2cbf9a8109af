"""Let numbers of marks repeat: a restore makes marks of its own, and sets the sequence back to that of the dump."""

from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "86bcc3429cabb69b1c51d59c890a8adc59572190496499dea65eb535a1959d1b"


def upgrade() -> None:
    op.execute("ALTER TABLE conflictdb.change DROP CONSTRAINT change_pkey")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
