"""Find conflicts by the key of either object."""

from alembic import op

revision = "0022"
down_revision = "0021"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "c2b2738102a1bb376852ef7801161051eee72c56feed0af468de7526f08d1fc4"

# The first is also the way to all conflicts of a scene.
BY_A_KEY = "CREATE INDEX conflict_scene_id_a_key_btree ON conflictdb.conflict (scene_id, a_key)"
BY_B_KEY = "CREATE INDEX conflict_scene_id_b_key_btree ON conflictdb.conflict (scene_id, b_key)"


def upgrade() -> None:
    op.execute("DROP INDEX conflictdb.conflict_scene_id_btree")
    op.execute(BY_A_KEY)
    op.execute(BY_B_KEY)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
