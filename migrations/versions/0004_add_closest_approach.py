"""Add the closest approach of pairs, and `nearest_m`: how near pairs without conflict must come to be kept.

Pairs that are only near have the verdict near and no periods.
"""

from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "15669315d57c3b7c22c4e39b214a7e2259a4f66f3e02770d0fc2ecdd718df72f"

# Their arguments or results are others now.
CHANGED = (
    "create_scene(text, text, text, text, double precision, double precision)",
    "_load(text, text, text, text, double precision, double precision, boolean)",
    "_scenes()",
    "_scene(bigint)",
    "_scene_named(text)",
    "_conflicts(text, timestamptz, boolean)",
)
DROP = "DROP FUNCTION IF EXISTS conflictdb."

SCENE = """
ALTER TABLE conflictdb.scene
    ADD COLUMN nearest_m double precision NOT NULL DEFAULT 0.0,
    ADD CONSTRAINT scene_nearest_finite CHECK (nearest_m >= 0 AND nearest_m < 'infinity')
"""

CONFLICT = """
ALTER TABLE conflictdb.conflict
    ADD COLUMN closest_at timestamptz,
    ADD COLUMN closest_m double precision,
    ADD COLUMN closest_error_m double precision,
    ADD COLUMN closest_a_point geometry(Point, 4326),
    ADD COLUMN closest_b_point geometry(Point, 4326),
    DROP CONSTRAINT conflict_verdict_known,
    ADD CONSTRAINT conflict_verdict_known CHECK (verdict IN ('conflict', 'grazing', 'unresolved', 'near')),
    DROP CONSTRAINT conflict_periods_not_empty,
    ADD CONSTRAINT conflict_periods_unless_near CHECK (isempty(periods) = (verdict = 'near')),
    ADD CONSTRAINT conflict_closest_positive CHECK (closest_m >= 0 AND closest_error_m >= 0),
    ADD CONSTRAINT conflict_closest_complete CHECK (
        num_nulls(closest_m, closest_error_m, closest_a_point, closest_b_point) IN (0, 4)
        AND (closest_at IS NULL OR closest_m IS NOT NULL)
        AND (verdict <> 'near' OR closest_m IS NOT NULL)
    )
"""


def upgrade() -> None:
    for routine in CHANGED:
        op.execute(DROP + routine)
    op.execute(SCENE)
    op.execute(CONFLICT)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
