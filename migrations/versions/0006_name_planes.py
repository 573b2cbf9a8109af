"""Mark new routines: what names a plane is called so, and regions are where the plane says."""

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "ef64a67e2885837235cdcc211213daf8df7290bd3fc24d1d9e8aa9883ecef6ee"


def upgrade() -> None:
    """Nothing: the structure stays."""


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
