"""Let a conflict cost no more than its row: fewer indexes, and no checks of every row against its scene and run.

A detection writes its run, which refers to the scene, before its conflicts; conflicts go with their scene by a trigger.
"""

from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "6018b9081e44dc25e43a3032d2e3c68f137a20fd594fd404077b964a19f0d9c2"

CONFLICT = """
ALTER TABLE conflictdb.conflict
    DROP CONSTRAINT conflict_scene_fkey,
    DROP CONSTRAINT conflict_run_fkey,
    DROP COLUMN conflict_id,
    DROP CONSTRAINT conflict_pair_unique,
    ADD CONSTRAINT conflict_pkey PRIMARY KEY (a_kind, a_id, b_kind, b_id, scene_id)
"""

# All conflicts of a scene: no query looks for keys in the order that it had.
SCENE = (
    "DROP INDEX conflictdb.conflict_scene_id_btree",
    "CREATE INDEX conflict_scene_id_btree ON conflictdb.conflict (scene_id)",
)


def upgrade() -> None:
    for statement in (CONFLICT, *SCENE):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
