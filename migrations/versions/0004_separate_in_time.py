"""Add separation in time, and the differences of departure times that scenes store."""

from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "ad66d42814d279286c296fe8fb69306e7783d737e208e07329e167e64a711936"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


# Their functions name columns that were added. sql/ makes them again.
DROP_TRIGGERS = """
DO $$
DECLARE
    v_trigger record;
BEGIN
    FOR v_trigger IN
        SELECT t.tgname, t.tgrelid::regclass AS on_table FROM pg_trigger t JOIN pg_proc p ON p.oid = t.tgfoid
        WHERE t.tgrelid IN ('conflictdb.scene'::regclass, 'conflictdb.conflict'::regclass)
              AND NOT t.tgisinternal
              AND p.pronamespace IN (to_regnamespace('conflictdb'), to_regnamespace('conflictdb_internal'))
    LOOP
        EXECUTE format('DROP TRIGGER %I ON %s', v_trigger.tgname, v_trigger.on_table);
    END LOOP;
END
$$;
"""

# Two plans may not use one place within so many seconds, and how many are lacking.
TIME = """
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS time_separation_s double precision NOT NULL DEFAULT 0.0,
    DROP CONSTRAINT IF EXISTS scene_time_separation_known,
    ADD CONSTRAINT scene_time_separation_known CHECK (time_separation_s BETWEEN 0 AND 2592000),
    DROP CONSTRAINT IF EXISTS scene_time_separation_solved,
    ADD CONSTRAINT scene_time_separation_solved CHECK (time_separation_s = 0 OR method <> 'nlp');
ALTER TABLE conflictdb.conflict ADD COLUMN IF NOT EXISTS lacking_s double precision
    CONSTRAINT conflict_lacking_positive CHECK (lacking_s >= 0);
ALTER TABLE conflictdb.probe_reply ADD COLUMN IF NOT EXISTS lacking_s double precision;
"""


def upgrade() -> None:
    for statement in (DROP_TRIGGERS, TIME):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
