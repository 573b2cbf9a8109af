"""Tell whether what is known of a scene is complete: routines that read conflicts and scenes have one column more."""

from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "da37b912bd296b0c54d166302084eaac7ea45c2fb68d37aebf9d6a0b524a9947"

# Their results change; sql/ makes them anew.
CHANGED_ROUTINES = ("_conflicts(text, timestamptz, boolean)", "_approaches(text)", "_scenes()")


def upgrade() -> None:
    for routine in CHANGED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
