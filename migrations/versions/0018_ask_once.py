"""Ask once for a scene whether it is current, and by the index."""

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "04630dee22e4069d7f5a3c43e19b39745662d077387b84f62705819c94d67f0a"


def upgrade() -> None:
    pass


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
