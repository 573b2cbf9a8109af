"""Let scenes have great circles: another motion, and the centre of their plane.

A centre is longitude and latitude in degrees; scenes with rhumb lines have none.
"""

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "8396a1374dd48e0dcdcc9b7e8ec00057c294e2ddb3471402853b0f9f63c020aa"

SCENE = """
ALTER TABLE conflictdb.scene
    ADD COLUMN centre_lon double precision,
    ADD COLUMN centre_lat double precision,
    DROP CONSTRAINT scene_motion_known,
    ADD CONSTRAINT scene_motion_known CHECK (motion IN ('rhumb', 'great_circle')),
    ADD CONSTRAINT scene_circles_on_sphere CHECK (motion = 'rhumb' OR earth = 'sphere'),
    ADD CONSTRAINT scene_centre_of_circles CHECK (motion = 'great_circle' OR num_nulls(centre_lon, centre_lat) = 2),
    ADD CONSTRAINT scene_centre_on_earth CHECK (
        num_nulls(centre_lon, centre_lat) IN (0, 2)
        AND (centre_lon BETWEEN -180 AND 180 AND centre_lat BETWEEN -90 AND 90) IS NOT FALSE
    )
"""

# Their arguments or results change; a database that has none of them yet is as good.
CHANGED_ROUTINES = (
    "create_scene(text, text, text, text, double precision, double precision, double precision)",
    "_load(text, text, text, text, double precision, double precision, double precision, boolean)",
    "_scenes()",
    "_scene(bigint)",
    "_scene_named(text)",
)


def upgrade() -> None:
    op.execute(SCENE)
    for routine in CHANGED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
