"""Hand candidates out by ranges of objects, without temporary tables; what follows stage 1 is done by the client."""

from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "aa3d51cd0132c3c9c7b1f1cb487422691db6a0bedc17d06225d9a58a515cb808"

GONE = (
    "_join_all(bigint)",
    "_join_dirty(bigint)",
    "_find_candidates(bigint)",
    "_find_intersections(bigint, boolean)",
    "_intersecting_pieces(bigint)",
    "_intersecting_pairs()",
    "_intersecting_regions()",
)


def upgrade() -> None:
    for routine in GONE:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
