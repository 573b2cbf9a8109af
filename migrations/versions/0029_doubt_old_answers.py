"""Mark every object: answers of earlier releases may differ."""

from alembic import op

revision = "0029"
down_revision = "0028"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "a445f52263a137468f011df915ad33269dcd39b5bcf4b857ad9a0be5ecb526d2"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = True

# Their arguments or results change; sql/ makes what follows them.
REPLACED_ROUTINES = (
    "_approaches(text, boolean, text[])",
    "_conflicts(text, timestamptz, boolean, text[])",
    "_scene_state(text)",
)


def upgrade() -> None:
    for routine in REPLACED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
