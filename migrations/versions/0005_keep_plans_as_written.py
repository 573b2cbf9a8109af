"""Plans as they are written."""

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "ca095350dbc6de90a28765037616cedf2be735ca957184c16b14b1a8192defe8"

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


def upgrade() -> None:
    for statement in (CLIMB, CLASSES):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
