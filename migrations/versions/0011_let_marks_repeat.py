"""Let numbers of marks repeat: a restore makes marks of its own, and sets the sequence back to that of the dump."""

from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "36295f794977b513d13991880e846f3672ae532aeeab33c80583c95872e88e4d"


def upgrade() -> None:
    op.execute("ALTER TABLE conflictdb.change DROP CONSTRAINT change_pkey")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
