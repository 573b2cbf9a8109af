"""Audit edits, and keep limits and history in tables."""

from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "5a857ea94de7ee076e672443bb9b580f42699da26d417e6cb062ea9ebb5da033"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

# Limits that administrators set; a setting of a session or role only lowers them. A dump restores tables by name: these
# limits come after the objects, which may be older than the limits.
UPPER_LIMIT = """
CREATE TABLE IF NOT EXISTS conflictdb.upper_limit (
    name text CONSTRAINT upper_limit_pkey PRIMARY KEY,
    value double precision NOT NULL CONSTRAINT upper_limit_positive CHECK (value >= 0 AND value <= 'infinity')
)
"""

STATEMENTS: tuple[str, ...] = (UPPER_LIMIT,)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
