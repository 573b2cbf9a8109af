"""Add separation in time, and the differences of departure times that scenes store."""

from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "0f7ddf4b0c6d46dddda64f2a6e6c6d5455b7ed3e09a3e486f4148082c178bee4"

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

# As for conflicts, no foreign keys: they would cost more than writing a row.
DIFFERENCES = """
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS delays_within_s double precision NOT NULL DEFAULT 0.0,
    DROP CONSTRAINT IF EXISTS scene_delays_within_known,
    ADD CONSTRAINT scene_delays_within_known CHECK (delays_within_s BETWEEN 0 AND 2592000);
CREATE TABLE IF NOT EXISTS conflictdb.difference (
    scene_id bigint NOT NULL,
    track_id bigint NOT NULL,
    other_kind smallint NOT NULL,
    other_id bigint NOT NULL,
    forbidden_us int8multirange NOT NULL,
    proven_us int8multirange NOT NULL
);
CREATE INDEX IF NOT EXISTS difference_scene_id_track_btree ON conflictdb.difference (scene_id, track_id);
CREATE INDEX IF NOT EXISTS difference_other_btree ON conflictdb.difference (other_kind, other_id);
"""


def upgrade() -> None:
    for statement in (DROP_TRIGGERS, TIME, DIFFERENCES):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
