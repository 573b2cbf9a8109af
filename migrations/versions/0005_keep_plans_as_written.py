"""Plans as they are written."""

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "0bc87693b39887e2c9565b1c3305beee2c7ef03309ee7db0fa7424adbc449a24"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

# Floor at the start and the end of the leg, then the ceilings; null where they do not change.
CLIMB = """
ALTER TABLE conflictdb.piece ADD COLUMN IF NOT EXISTS climb double precision[];
"""

# Whose separation rules apply to an object, and whose objects are not compared with each other.
CLASSES = """
ALTER TABLE conflictdb.area ADD COLUMN IF NOT EXISTS class text, ADD COLUMN IF NOT EXISTS owner text;
ALTER TABLE conflictdb.track ADD COLUMN IF NOT EXISTS class text, ADD COLUMN IF NOT EXISTS owner text;
DO $$
BEGIN
    IF NOT EXISTS (SELECT FROM pg_attribute a
                   WHERE a.attrelid = 'conflictdb.attached_row'::regclass AND a.attname = 'class') THEN
        ALTER TYPE conflictdb.attached_row ADD ATTRIBUTE class text, ADD ATTRIBUTE owner text;
    END IF;
END
$$;
"""

# One admission of a scene at a time. Not `scene_lock`, which detections hold for as long as they take.
ADMISSIONS = """
CREATE TABLE IF NOT EXISTS conflictdb.admission_lock (
    scene_id bigint NOT NULL CONSTRAINT admission_lock_pkey PRIMARY KEY,
    taken bigint NOT NULL
);
CREATE INDEX IF NOT EXISTS area_scene_id_owner_btree ON conflictdb.area (scene_id, owner) WHERE owner IS NOT NULL;
CREATE INDEX IF NOT EXISTS track_scene_id_owner_btree ON conflictdb.track (scene_id, owner) WHERE owner IS NOT NULL;
"""

# Whether spans and height bands contain their upper ends.
INTERVALS = """
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS intervals text NOT NULL DEFAULT 'half_open',
    DROP CONSTRAINT IF EXISTS scene_intervals_known,
    ADD CONSTRAINT scene_intervals_known CHECK (intervals IN ('half_open', 'closed'));
"""


# When an area is active, and a track departs, several times; the schedule that says so, and how far it is expanded.
ACTIVATIONS = """
ALTER TABLE conflictdb.area ADD COLUMN IF NOT EXISTS activations tstzmultirange,
    ADD COLUMN IF NOT EXISTS schedule jsonb;
ALTER TABLE conflictdb.track ADD COLUMN IF NOT EXISTS departures timestamptz[],
    ADD COLUMN IF NOT EXISTS schedule jsonb;
CREATE INDEX IF NOT EXISTS area_scene_id_scheduled_btree ON conflictdb.area (scene_id) WHERE schedule IS NOT NULL;
CREATE INDEX IF NOT EXISTS track_scene_id_scheduled_btree ON conflictdb.track (scene_id) WHERE schedule IS NOT NULL;
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS horizon_days double precision NOT NULL DEFAULT 366.0,
    DROP CONSTRAINT IF EXISTS scene_horizon_days_known,
    ADD CONSTRAINT scene_horizon_days_known CHECK (horizon_days BETWEEN 0 AND 36525),
    ADD COLUMN IF NOT EXISTS expanded tstzrange;
"""


def upgrade() -> None:
    for statement in (CLIMB, CLASSES, ADMISSIONS, INTERVALS, ACTIVATIONS):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
