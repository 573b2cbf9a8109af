"""Keep edits, limits and positions."""

from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "9b5da53f1ea97d2d7556adf6b89307a54bb659a1e60321b911e85af0c19ec7bb"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


# A layer of a map program looks its rows up by number.
CONFLICT_ID = """
CREATE INDEX IF NOT EXISTS conflict_conflict_id_btree ON conflictdb.conflict (conflict_id) WHERE verdict <> 'near'
"""

# The tables that an attachment watches. A dump writes a regclass as a name, or as a number if the table was dropped. A
# table of its own: a restore into a database without these tables loses nothing else, and their names count then.
ATTACHED_RELATION = """
CREATE TABLE IF NOT EXISTS conflictdb.attached_relation (
    attachment_id bigint NOT NULL
        CONSTRAINT attached_relation_attachment_fkey REFERENCES conflictdb.attachment ON DELETE CASCADE,
    relation regclass NOT NULL,
    is_root boolean NOT NULL,
    CONSTRAINT attached_relation_pkey PRIMARY KEY (attachment_id, relation)
);
CREATE UNIQUE INDEX IF NOT EXISTS attached_relation_root_btree
    ON conflictdb.attached_relation (attachment_id) WHERE is_root;
"""
ATTACHED_RELATIONS = """
WITH RECURSIVE tree AS (
    SELECT a.attachment_id, c.oid AS relation, true AS is_root, a.has_triggers
    FROM conflictdb.attachment a
    JOIN pg_catalog.pg_namespace n ON n.nspname = a.table_schema
    JOIN pg_catalog.pg_class c ON c.relnamespace = n.oid AND c.relname = a.table_name
    UNION
    SELECT t.attachment_id, i.inhrelid, false, true
    FROM tree t JOIN pg_catalog.pg_inherits i ON i.inhparent = t.relation WHERE t.has_triggers
)
INSERT INTO conflictdb.attached_relation (attachment_id, relation, is_root)
SELECT t.attachment_id, t.relation::regclass, t.is_root FROM tree t ON CONFLICT DO NOTHING
"""
COMPARISON_S = "ALTER TABLE conflictdb.attachment ADD COLUMN IF NOT EXISTS comparison_s double precision"
IDENTITY_JSON = "ALTER TABLE conflictdb.attached_object ADD COLUMN IF NOT EXISTS identity_json jsonb"


def upgrade() -> None:
    op.execute(CONFLICT_ID)
    op.execute(ATTACHED_RELATION)
    op.execute(ATTACHED_RELATIONS)
    op.execute(COMPARISON_S)
    op.execute(IDENTITY_JSON)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
