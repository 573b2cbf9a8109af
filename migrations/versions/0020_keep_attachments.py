"""Keep attachments: tables of others, which of their rows changed, and the objects that were made of them."""

from alembic import op

revision = "0020"
down_revision = "0019"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "c29486d0faac50e444b86e7947b2d058afb8a1b83e8f80e58d85a9dc7c0e74b9"

# What the function of an attachment returns: a row of the table in the terms of conflictdb, whatever the kind.
ATTACHED_ROW = """
CREATE TYPE conflictdb.attached_row AS (
    identity text,
    hash bigint,
    is_asked boolean,
    error text,
    key text,
    name text,
    shape geometry,
    at timestamptz,
    times timestamptz[],
    span tstzrange,
    starts_at timestamptz,
    ends_at timestamptz,
    floor_m double precision,
    ceiling_m double precision,
    floors_m double precision[],
    ceilings_m double precision[],
    outline geometry,
    outlines geometry,
    fore_m double precision,
    aft_m double precision,
    port_m double precision,
    starboard_m double precision,
    grow_mps double precision,
    properties jsonb
)
"""

# A scene cannot go while tables are attached to it: their triggers would stay behind.
ATTACHMENT = """
CREATE TABLE conflictdb.attachment (
    attachment_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT attachment_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT attachment_scene_fkey REFERENCES conflictdb.scene,
    object_kind smallint NOT NULL,
    table_schema text NOT NULL,
    table_name text NOT NULL,
    map jsonb NOT NULL,
    identity_columns text[] NOT NULL,
    has_triggers boolean NOT NULL,
    every interval NOT NULL,
    attached_at timestamptz NOT NULL DEFAULT now(),
    turn bigint NOT NULL DEFAULT 0,
    compared_at timestamptz,
    failed_at timestamptz,
    error text,
    CONSTRAINT attachment_kind_known CHECK (object_kind IN (0, 1)),
    CONSTRAINT attachment_every_positive CHECK (every >= interval '1 second'),
    CONSTRAINT attachment_failure_told CHECK ((failed_at IS NULL) = (error IS NULL))
)
"""
ATTACHMENT_SCENE = "CREATE INDEX attachment_scene_id_btree ON conflictdb.attachment (scene_id)"

# No foreign key: it would make the writers of somebody else's table wait for, and fail with, whoever detaches it.
ATTACHED_CHANGE = """
CREATE TABLE conflictdb.attached_change (
    attached_change_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT attached_change_pkey PRIMARY KEY,
    attachment_id bigint NOT NULL,
    identities text[],
    changed_at timestamptz NOT NULL DEFAULT now()
)
"""

ATTACHED_OBJECT = """
CREATE TABLE conflictdb.attached_object (
    attachment_id bigint NOT NULL
        CONSTRAINT attached_object_attachment_fkey REFERENCES conflictdb.attachment ON DELETE CASCADE,
    identity text COLLATE "C" NOT NULL,
    hash bigint,
    key text COLLATE "C",
    object_id bigint,
    version bigint,
    reason text,
    is_taken boolean NOT NULL DEFAULT false,
    since timestamptz NOT NULL DEFAULT now(),
    CONSTRAINT attached_object_pkey PRIMARY KEY (attachment_id, identity),
    CONSTRAINT attached_object_mapped_or_told CHECK (num_nonnulls(object_id, reason) > 0)
)
"""
# Of a changed object: is it attached?
ATTACHED_OBJECT_OBJECT = (
    "CREATE INDEX attached_object_object_btree ON conflictdb.attached_object (attachment_id, object_id)"
)
# Few rows cannot be mapped, and they are asked for often.
ATTACHED_OBJECT_REASON = (
    "CREATE INDEX attached_object_reason_btree ON conflictdb.attached_object (attachment_id) WHERE reason IS NOT NULL"
)


def upgrade() -> None:
    for statement in (
        ATTACHED_ROW,
        ATTACHMENT,
        ATTACHMENT_SCENE,
        ATTACHED_CHANGE,
        ATTACHED_OBJECT,
        ATTACHED_OBJECT_OBJECT,
        ATTACHED_OBJECT_REASON,
    ):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
