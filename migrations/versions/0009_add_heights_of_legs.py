"""Let tracks have heights per leg: a floor, a ceiling or both for every leg, metres; a null among them is no limit."""

from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "23fe7878f967dba7ffddfc7cab2e4b54b4acf0ece8797cf28970fdbae47c1a76"

LEG_HEIGHTS = """
ALTER TABLE conflictdb.track
    ADD COLUMN floors_m double precision[],
    ADD COLUMN ceilings_m double precision[],
    ADD CONSTRAINT track_heights_in_a_row CHECK (array_ndims(floors_m) = 1 AND array_ndims(ceilings_m) = 1)
"""

# Their arguments or results change; sql/ makes them anew.
CHANGED_ROUTINES = (
    "put_track(text,text,geometry,geometry,double precision,double precision,text,jsonb,double precision,geometry)",
    "_read_tracks(bigint)",
    "_changed_tracks(bigint)",
)


def upgrade() -> None:
    op.execute(LEG_HEIGHTS)
    for routine in CHANGED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
