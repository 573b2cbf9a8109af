"""Requests count their attempts and bytes; workers leave a stamp."""

from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "9a480350f3eda9c85fdd978186ce56e18ab40a532ca30556c7a3a5480e3cabad"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


REQUESTS = """
DO $$
BEGIN
    -- Routines of the former revision read the column by its name until they are replaced, in this transaction.
    IF EXISTS (SELECT FROM pg_catalog.pg_attribute a
               WHERE a.attrelid = 'conflictdb.probe_request'::regclass AND a.attname = 'failures') THEN
        ALTER TABLE conflictdb.probe_request RENAME COLUMN failures TO attempts;
    END IF;
END
$$;
ALTER TABLE conflictdb.probe_request
    ADD COLUMN IF NOT EXISTS attempted_at timestamptz,
    ADD COLUMN IF NOT EXISTS bytes bigint NOT NULL DEFAULT 0;
"""

# No foreign key and no scene: all roles read it.
STAMPS = """
CREATE TABLE IF NOT EXISTS conflictdb.worker_stamp (
    worker_id uuid CONSTRAINT worker_stamp_pkey PRIMARY KEY,
    pid integer,
    seen_at timestamptz NOT NULL
)
"""


def upgrade() -> None:
    op.execute(REQUESTS)
    op.execute(STAMPS)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
