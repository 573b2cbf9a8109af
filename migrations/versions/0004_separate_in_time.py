"""Add separation in time, and the differences of departure times that scenes store."""

from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "ea17d863f69bb24b3ebbe08e92f35dce1f279b77d78649782ae0bbedf5daf1fc"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False


# As for conflicts, no foreign keys: they would cost more than writing a row.
DIFFERENCES = """
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS delays_within_s double precision NOT NULL DEFAULT 0.0,
    DROP CONSTRAINT IF EXISTS scene_delays_within_known,
    ADD CONSTRAINT scene_delays_within_known CHECK (delays_within_s BETWEEN 0 AND 2592000);
CREATE TABLE IF NOT EXISTS conflictdb.difference (
    scene_id bigint NOT NULL,
    track_id bigint NOT NULL,
    other_kind smallint NOT NULL,
    other_id bigint NOT NULL,
    forbidden_us int8multirange NOT NULL,
    proven_us int8multirange NOT NULL
);
CREATE INDEX IF NOT EXISTS difference_scene_id_track_btree ON conflictdb.difference (scene_id, track_id);
CREATE INDEX IF NOT EXISTS difference_other_btree ON conflictdb.difference (other_kind, other_id);
"""


def upgrade() -> None:
    op.execute(DIFFERENCES)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
