"""Plans as they are written."""

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "ed2d6fa8aa0826151cfaf27d74db9d4c2634e80b0e9777f539de6534ac726d23"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

# Floor at the start and the end of the leg, then the ceilings; null where they do not change.
CLIMB = """
ALTER TABLE conflictdb.piece ADD COLUMN IF NOT EXISTS climb double precision[];
"""

# How far voyages may differ from a plan.
TOLERANCES = """
ALTER TABLE conflictdb.track ADD COLUMN IF NOT EXISTS tolerances jsonb;
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


def upgrade() -> None:
    for statement in (CLIMB, TOLERANCES, CLASSES, ADMISSIONS, INTERVALS):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
