"""Find conflicts by where and when they are."""

from alembic import op

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "f3cf2e00cb25a8d76b2f0f83db3a22480a70ac11612eb4c193262a364c7efce4"

# Pairs that are only near have neither.
WHERE_AND_WHEN = """
CREATE INDEX conflict_scene_id_region_periods_gist ON conflictdb.conflict USING gist (scene_id, region, periods)
    WHERE verdict <> 'near'
"""


def upgrade() -> None:
    op.execute(WHERE_AND_WHEN)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
