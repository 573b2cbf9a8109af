"""Add `vertical_separation_m`, names of who acknowledged, and requests for delays."""

from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "c1a2722783c493694b3e94dd69720737469c640de13e777f8d804e6dedcf189b"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = True

# Their functions name columns that were added. sql/ makes them again.
DROP_TRIGGERS = """
DO $$
DECLARE
    v_trigger record;
BEGIN
    FOR v_trigger IN
        SELECT t.tgname, t.tgrelid::regclass AS on_table FROM pg_trigger t JOIN pg_proc p ON p.oid = t.tgfoid
        WHERE t.tgrelid IN ('conflictdb.scene'::regclass, 'conflictdb.conflict'::regclass, 'conflictdb.run'::regclass,
                            'conflictdb.probe_request'::regclass)
              AND NOT t.tgisinternal
              AND p.pronamespace IN (to_regnamespace('conflictdb'), to_regnamespace('conflictdb_internal'))
    LOOP
        EXECUTE format('DROP TRIGGER %I ON %s', v_trigger.tgname, v_trigger.on_table);
    END LOOP;
END
$$
"""

# Who acknowledged, where several people share a role.
NAME = """
ALTER TABLE conflictdb.acknowledgement ADD COLUMN IF NOT EXISTS given_name text
    CONSTRAINT acknowledgement_given_name_valid CHECK (btrim(given_name) <> '' AND octet_length(given_name) <= 1000);
"""

HEIGHTS = """
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS vertical_separation_m double precision NOT NULL DEFAULT 0.0,
    DROP CONSTRAINT IF EXISTS scene_vertical_separation_finite,
    ADD CONSTRAINT scene_vertical_separation_finite
        CHECK (vertical_separation_m >= 0 AND vertical_separation_m < 'infinity');
"""

DELAYS = """
ALTER TABLE conflictdb.probe_request
    ADD COLUMN IF NOT EXISTS horizon interval,
    ADD COLUMN IF NOT EXISTS delays jsonb,
    DROP CONSTRAINT probe_request_plan_given,
    ADD CONSTRAINT probe_request_plan_given CHECK (
        CASE WHEN horizon IS NOT NULL THEN object_kind = 1 AND key IS NOT NULL AND path IS NULL
             WHEN object_kind = 0 THEN num_nonnulls(footprint, active_span) = 2
             ELSE num_nonnulls(path, outline) = 2 END
    );
"""


def upgrade() -> None:
    for statement in (DROP_TRIGGERS, NAME, HEIGHTS, DELAYS):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
