"""Let havens change along their track: an outward speed of their sides, or an outline per waypoint.

Units: metres per second for the speed, metres to starboard and ahead for outlines.
"""

from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "15ce22f9763e790043d211c8b1c07232cb52c94bc632649387b9df3bdd05390a"

GROWTH = """
ALTER TABLE conflictdb.track
    ADD COLUMN grow_mps double precision NOT NULL DEFAULT 0,
    ADD COLUMN outlines geometry(MultiPolygon),
    ADD CONSTRAINT track_growth_in_range CHECK (grow_mps BETWEEN 0 AND 1e6),
    ADD CONSTRAINT track_growth_given_once CHECK (grow_mps = 0 OR outlines IS NULL)
"""

PIECE_SHAPE = "ALTER TABLE conflictdb.piece ADD COLUMN shape_to geometry(Polygon)"

# Their arguments or results change; sql/ makes them anew.
CHANGED_ROUTINES = (
    "put_track(text, text, geometry, geometry, double precision, double precision, text, jsonb)",
    "_read_tracks(bigint)",
    "_changed_tracks(bigint)",
    "_intersecting_pieces(bigint)",
    "_check_haven(text, geometry, geometry, text)",
    "_check_outline(text, geometry)",
)


def upgrade() -> None:
    op.execute(GROWTH)
    op.execute(PIECE_SHAPE)
    for routine in CHANGED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
