"""Let a row of pieces hold a bundle of some that lie near each other."""

from alembic import op

revision = "0027"
down_revision = "0026"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "f6229a2aa9ebefd3391b4a751a0da6df06cfc039f5579a9b5f132c26f62d19d4"

# Rows that are there are of one piece each, and stay so until their objects change.
COLUMNS = """
ALTER TABLE conflictdb.piece
    ADD COLUMN pieces integer NOT NULL DEFAULT 1,
    ADD COLUMN parts integer[],
    ADD COLUMN hulls geometry(MultiPolygon),
    ADD COLUMN shapes geometry(MultiPolygon),
    ADD COLUMN cuts timestamptz[],
    ADD COLUMN leg_times timestamptz[],
    ADD COLUMN legs double precision[],
    ALTER COLUMN shape DROP NOT NULL,
    ALTER COLUMN hulls SET STORAGE EXTERNAL,
    ALTER COLUMN shapes SET STORAGE EXTERNAL,
    DROP CONSTRAINT piece_motion_of_tracks,
    ADD CONSTRAINT piece_motion_of_tracks CHECK (
        num_nulls(leg_start, leg_end, start_lon_deg, start_lat_deg, end_lon_deg, end_lat_deg, bearing_deg)
        = CASE WHEN object_kind = 1 AND pieces = 1 THEN 0 ELSE 7 END),
    ADD CONSTRAINT piece_bundle_complete CHECK (
        CASE WHEN pieces = 1
             THEN shape IS NOT NULL AND num_nonnulls(parts, hulls, shapes, cuts, leg_times, legs) = 0
             WHEN object_kind = 0
             THEN num_nonnulls(parts, hulls, shapes) = 3 AND num_nonnulls(shape, shape_to, cuts, leg_times, legs) = 0
             ELSE num_nonnulls(parts, hulls, shape, cuts, leg_times, legs) = 6
                  AND num_nonnulls(shapes, shape_to) = 0 END)
"""

# No query asks where these lie among others: taking stock of them costs as much as of all else.
UNCOUNTED = (
    *("shape", "shape_to", "parts", "hulls", "shapes", "cuts", "leg_times", "legs", "leg_start", "leg_end"),
    *("start_lon_deg", "start_lat_deg", "end_lon_deg", "end_lat_deg", "bearing_deg"),
)

# Their arguments or results change; sql/ makes what follows them.
REPLACED_ROUTINES = (
    "_candidates(bigint, bigint)",
    "_candidates_of_all(bigint)",
    "_candidates_of_dirty(bigint)",
    "_pieces(bigint, bigint[])",
    "_pieces_meeting(bigint, text, bytea[], bigint[], bigint[], boolean[], float8[], float8[], integer[])",
    (
        "_put_pieces(bigint, bigint, smallint[], bigint[], bigint[], integer[], smallint[], bytea[], tstzrange[],"
        " float8[], float8[], bytea[], bytea[], timestamptz[], timestamptz[], float8[], float8[], float8[], float8[],"
        " float8[])"
    ),
)


def upgrade() -> None:
    op.execute(COLUMNS)
    for column in UNCOUNTED:
        op.execute(f"ALTER TABLE conflictdb.piece ALTER COLUMN {column} SET STATISTICS 0;")
    for routine in REPLACED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
