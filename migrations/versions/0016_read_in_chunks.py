"""Let changed objects be read in chunks, and say of a run and of a lock what had to be asked for."""

from alembic import op

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "affd659f98cb60f0378d1ae7568f522646abb9f6475ccd7a22b21168015eda9e"

# Their arguments or results change; sql/ makes them anew.
CHANGED_ROUTINES = (
    "_changed_areas(bigint)",
    "_changed_tracks(bigint)",
    "_begin_pieces(bigint)",
    "_add_scene_lock(bigint)",
    "_write_run(bigint, jsonb)",
)


def upgrade() -> None:
    for routine in CHANGED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
