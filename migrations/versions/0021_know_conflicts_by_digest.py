"""Know of a conflict by a digest whether what a detection finds is the same."""

from alembic import op

revision = "0021"
down_revision = "0020"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "386be4350f89f1e4881aa87c91de39724e9cb5ad38c30f937f35408863c78fb9"

# Of rows that are there already it is not known: the next detection of the pair writes them again.
DIGEST = "ALTER TABLE conflictdb.conflict ADD COLUMN digest bigint NOT NULL DEFAULT 0"

# Their arguments change, or nothing calls them any more; sql/ makes what follows them.
REPLACED_ROUTINES = ("_begin_write()", "_write_run(bigint, jsonb)", "_is_pending(bigint)")


def upgrade() -> None:
    op.execute(DIGEST)
    for routine in REPLACED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
