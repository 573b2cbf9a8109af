"""Give every scene a row to lock: a detection holds it to the end of its transaction, and nobody else can.

Rows come when a scene is detected for the first time.
"""

from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "fb023b8218283f6a59469e5149a491d26dbc564c8ebb4e8b91409ca0b435f38d"

SCENE_LOCK = """
CREATE TABLE conflictdb.scene_lock (
    scene_id bigint NOT NULL CONSTRAINT scene_lock_pkey PRIMARY KEY
        CONSTRAINT scene_lock_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    taken bigint NOT NULL DEFAULT 0
);
"""

# Session locks, which a pooler gives to somebody else.
FORMER_ROUTINES = ("_lock_scene(bigint, boolean)", "_unlock_scene(bigint)")


def upgrade() -> None:
    op.execute(SCENE_LOCK)
    for routine in FORMER_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
