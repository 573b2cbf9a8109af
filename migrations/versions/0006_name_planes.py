"""Mark new routines: what names a plane is called so, and regions are where the plane says."""

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "1106b30eb18c426733e70738db9691eae30635042d6960bbe76fd6e7b38dd1ff"


def upgrade() -> None:
    """Nothing: the structure stays."""


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
