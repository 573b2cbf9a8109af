"""Let a piece cost less: no check of every row against its scene, and no statistics of what no query asks for.

Detection keeps the scene from being removed once for all of its pieces; pieces go with their scene by a trigger.
"""

from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "bd347f5effea67f546db9f4aa9cbc4f32ca8ea868bd310de7023afa7b90e4fca"

ONLY_READ = (
    "version", "part", "shape", "shape_to", "leg_start", "leg_end", "start_lon_deg", "start_lat_deg", "end_lon_deg",
    "end_lat_deg", "bearing_deg",
)  # fmt: skip


def upgrade() -> None:
    op.execute("DROP FUNCTION IF EXISTS conflictdb._end_pieces(bigint)")
    op.execute("ALTER TABLE conflictdb.piece DROP CONSTRAINT piece_scene_fkey")
    for column in ONLY_READ:
        op.execute(f"ALTER TABLE conflictdb.piece ALTER COLUMN {column} SET STATISTICS 0")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
