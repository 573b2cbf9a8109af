"""Write new conflicts by COPY, and find them by where they are through a smaller index."""

from alembic import op

revision = "0026"
down_revision = "0025"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "4f94569e16f4a688bc3cece4d12a9e54ea0c79c2a44b5313f6dd9ab4bb20c9c9"

# Half the time and a third of the size of (scene_id, region, periods) as GiST, and as quick to find what is asked for.
WHERE = """
CREATE INDEX conflict_region_spgist ON conflictdb.conflict USING spgist (region) WHERE verdict <> 'near'
"""


def upgrade() -> None:
    op.execute("DROP INDEX conflictdb.conflict_scene_id_region_periods_gist")
    op.execute(WHERE)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
