"""Let scenes belong to roles: who made a scene, and with whom it is shared."""

from alembic import op

revision = "0025"
down_revision = "0024"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "bfa6039c0c57429853b6e4c6b1b1c6bd4af4e43ffaefa638cf97987e6caea171"

# Roles by name: a dump must be restorable where some of them are not. Of scenes that are there nobody knows who made
# them.
OWNER = """
ALTER TABLE conflictdb.scene ADD COLUMN owner name;
ALTER TABLE conflictdb.scene ALTER COLUMN owner SET DEFAULT current_user
"""
SCENE_SHARE = """
CREATE TABLE conflictdb.scene_share (
    scene_id bigint NOT NULL CONSTRAINT scene_share_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    role name NOT NULL,
    may_write boolean NOT NULL,
    shared_by name NOT NULL DEFAULT current_user,
    shared_at timestamptz NOT NULL DEFAULT now(),
    CONSTRAINT scene_share_pkey PRIMARY KEY (scene_id, role)
)
"""


def upgrade() -> None:
    for statement in (OWNER, SCENE_SHARE):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
