"""Mark every object: answers of earlier releases may differ."""

revision = "0029"
down_revision = "0028"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "696020bc2ea055f3a5edf946f1cc5067304ea72c0683f2f338d474644009a4a4"


def upgrade() -> None:
    pass


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
