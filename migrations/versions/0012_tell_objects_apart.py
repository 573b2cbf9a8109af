"""Let an object be told from another that had its number before, and keep what refers to it in its scene."""

from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "5456a76dae05634ba2373b240ad1708e90f8d57bc971fecd3d42235c49a66c1f"

# What is there keeps all that was computed of it: every version is later than 0.
FIRST_VERSIONS = (
    "ALTER TABLE conflictdb.area ADD COLUMN first_version bigint NOT NULL DEFAULT 0",
    "ALTER TABLE conflictdb.track ADD COLUMN first_version bigint NOT NULL DEFAULT 0",
)

# The scene comes last: conflicts are looked up by one member.
PAIRS_OF_SCENES = """
ALTER TABLE conflictdb.conflict
    DROP CONSTRAINT conflict_pair_unique,
    ADD CONSTRAINT conflict_pair_unique UNIQUE (a_kind, a_id, b_kind, b_id, scene_id)
"""

RUNS_OF_SCENES = (
    "DROP INDEX conflictdb.run_scene_id_btree",
    "ALTER TABLE conflictdb.run ADD CONSTRAINT run_scene_unique UNIQUE (scene_id, run_id)",
    "ALTER TABLE conflictdb.conflict DROP CONSTRAINT conflict_run_fkey",
    """ALTER TABLE conflictdb.conflict
    ADD CONSTRAINT conflict_run_fkey FOREIGN KEY (scene_id, run_id) REFERENCES conflictdb.run (scene_id, run_id)
        DEFERRABLE INITIALLY DEFERRED""",  # both go when their scene goes, in whatever order
)


def upgrade() -> None:
    for statement in (*FIRST_VERSIONS, PAIRS_OF_SCENES, *RUNS_OF_SCENES):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
