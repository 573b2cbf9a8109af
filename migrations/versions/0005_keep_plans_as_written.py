"""Plans as they are written."""

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "795dc4c9b58ac845efb94f1e5bb86ac1c255066eb5a0914b26c22f6cff661e84"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

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
    for statement in (CLASSES,):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
