"""Create the tables: input (scene, area, track), derived (piece, conflict) and records (change, run).

Units: metres above mean sea level for heights, degrees for longitude and latitude, plane metres for hulls.
Comments on tables and columns are in sql/, with the routines.
"""

from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "b6ad51854357ef91e44f989069d913a0b7d0ef38a372b2d4e6650cc937f5e49d"

SETTINGS = """
CREATE TABLE conflictdb.scene (
    scene_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT scene_pkey PRIMARY KEY,
    name text COLLATE "C" NOT NULL CONSTRAINT scene_name_unique UNIQUE,
    motion text NOT NULL DEFAULT 'rhumb',
    earth text NOT NULL DEFAULT 'wgs84',
    method text NOT NULL DEFAULT 'nlp',
    tolerance_m double precision NOT NULL DEFAULT 1.0,
    separation_m double precision NOT NULL DEFAULT 0.0,
    CONSTRAINT scene_name_speakable CHECK (btrim(name) <> '' AND octet_length(name) <= 1000),
    CONSTRAINT scene_motion_known CHECK (motion IN ('rhumb')),
    CONSTRAINT scene_earth_known CHECK (earth IN ('wgs84', 'sphere')),
    CONSTRAINT scene_method_known CHECK (method IN ('screen', 'window', 'nlp')),
    CONSTRAINT scene_tolerance_finite CHECK (tolerance_m >= 0 AND tolerance_m < 'infinity'),
    CONSTRAINT scene_separation_finite CHECK (separation_m >= 0 AND separation_m < 'infinity')
)
"""

# Versions and marks come from one sequence, so that no number ever repeats, also after an object was removed.
VERSIONS = "CREATE SEQUENCE conflictdb.version_seq AS bigint"

AREA = """
CREATE TABLE conflictdb.area (
    area_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT area_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT area_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    key text COLLATE "C" NOT NULL,
    name text,
    footprint geometry(MultiPolygon, 4326) NOT NULL,
    active_span tstzrange NOT NULL DEFAULT tstzrange(NULL, NULL),
    floor_m double precision,
    ceiling_m double precision,
    properties jsonb NOT NULL DEFAULT '{}',
    version bigint NOT NULL,
    CONSTRAINT area_key_unique UNIQUE (scene_id, key),
    CONSTRAINT area_key_speakable CHECK (key <> '' AND octet_length(key) <= 1000),
    CONSTRAINT area_span_not_empty CHECK (NOT isempty(active_span)),
    CONSTRAINT area_heights_finite CHECK (
        (floor_m > '-infinity' AND floor_m < 'infinity') IS NOT FALSE
        AND (ceiling_m > '-infinity' AND ceiling_m < 'infinity') IS NOT FALSE
    ),
    CONSTRAINT area_ceiling_above_floor CHECK (ceiling_m > floor_m),
    CONSTRAINT area_properties_object CHECK (jsonb_typeof(properties) = 'object')
)
"""

TRACK = """
CREATE TABLE conflictdb.track (
    track_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT track_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT track_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    key text COLLATE "C" NOT NULL,
    name text,
    path geometry(LineStringM, 4326) NOT NULL,
    outline geometry(Polygon) NOT NULL,
    floor_m double precision,
    ceiling_m double precision,
    properties jsonb NOT NULL DEFAULT '{}',
    version bigint NOT NULL,
    CONSTRAINT track_key_unique UNIQUE (scene_id, key),
    CONSTRAINT track_key_speakable CHECK (key <> '' AND octet_length(key) <= 1000),
    CONSTRAINT track_heights_finite CHECK (
        (floor_m > '-infinity' AND floor_m < 'infinity') IS NOT FALSE
        AND (ceiling_m > '-infinity' AND ceiling_m < 'infinity') IS NOT FALSE
    ),
    CONSTRAINT track_ceiling_above_floor CHECK (ceiling_m > floor_m),
    CONSTRAINT track_properties_object CHECK (jsonb_typeof(properties) = 'object')
)
"""

# One key names one object, whether area or track: a primary key decides, also between concurrent writers.
OBJECT_KEY = """
CREATE TABLE conflictdb.object_key (
    scene_id bigint NOT NULL CONSTRAINT object_key_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    key text COLLATE "C" NOT NULL,
    object_kind smallint NOT NULL,
    CONSTRAINT object_key_pkey PRIMARY KEY (scene_id, key),
    CONSTRAINT object_key_kind_known CHECK (object_kind IN (0, 1))
)
"""

CHANGE = """
CREATE TABLE conflictdb.change (
    change_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT change_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT change_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    object_kind smallint NOT NULL,
    object_id bigint NOT NULL,
    version bigint NOT NULL,
    changed_at timestamptz NOT NULL DEFAULT now(),
    is_covered boolean NOT NULL DEFAULT false,
    CONSTRAINT change_kind_known CHECK (object_kind IN (0, 1))
)
"""

PIECE = """
CREATE TABLE conflictdb.piece (
    piece_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT piece_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT piece_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    object_kind smallint NOT NULL,
    object_id bigint NOT NULL,
    version bigint NOT NULL,
    part integer NOT NULL,
    turn smallint NOT NULL,
    hull geometry(Polygon) NOT NULL,
    span tstzrange NOT NULL,
    floor_m double precision NOT NULL,
    ceiling_m double precision NOT NULL,
    shape geometry(Polygon) NOT NULL,
    leg_start timestamptz,
    leg_end timestamptz,
    start_lon_deg double precision,
    start_lat_deg double precision,
    end_lon_deg double precision,
    end_lat_deg double precision,
    bearing_deg double precision,
    CONSTRAINT piece_kind_known CHECK (object_kind IN (0, 1)),
    CONSTRAINT piece_span_not_empty CHECK (NOT isempty(span)),
    CONSTRAINT piece_ceiling_above_floor CHECK (ceiling_m > floor_m),
    CONSTRAINT piece_motion_of_tracks CHECK (
        (object_kind = 1) = (num_nulls(leg_start, leg_end, start_lon_deg, start_lat_deg, end_lon_deg, end_lat_deg,
                                       bearing_deg) = 0)
    )
)
"""

# Stage 1 is one join on this index: scene, box and time span in one tree.
PIECE_GIST = "CREATE INDEX piece_scene_id_hull_span_gist ON conflictdb.piece USING gist (scene_id, hull, span)"
# Replacing an object's pieces, and the region of a conflict.
PIECE_OBJECT = "CREATE INDEX piece_object_btree ON conflictdb.piece (object_kind, object_id)"
# Is a member of a conflict marked? And: what is pending in a scene?
CHANGE_OBJECT = "CREATE INDEX change_scene_id_object_btree ON conflictdb.change (scene_id, object_kind, object_id)"

RUN = """
CREATE TABLE conflictdb.run (
    run_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT run_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT run_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    started_at timestamptz NOT NULL,
    finished_at timestamptz NOT NULL,
    method text NOT NULL,
    settings jsonb NOT NULL,
    objects bigint NOT NULL,
    candidate_pairs bigint,
    intersecting_pairs bigint,
    window_pairs bigint,
    solved_pairs bigint,
    conflicts bigint,
    unresolved bigint,
    opened bigint,
    changed bigint,
    closed bigint,
    pieces_s double precision,
    stage1_s double precision,
    stage2_s double precision,
    stage3_s double precision,
    stage4_s double precision,
    write_s double precision,
    error text,
    CONSTRAINT run_failed_or_counted CHECK ((error IS NULL) = (conflicts IS NOT NULL))
)
"""

RUN_SCENE = "CREATE INDEX run_scene_id_btree ON conflictdb.run (scene_id, run_id)"

# Members carry no foreign key: a removed object's conflicts stay, shown as not current, until the next detection.
CONFLICT = """
CREATE TABLE conflictdb.conflict (
    conflict_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT conflict_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT conflict_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    run_id bigint NOT NULL CONSTRAINT conflict_run_fkey REFERENCES conflictdb.run
        DEFERRABLE INITIALLY DEFERRED, -- both go when their scene goes, in whatever order
    a_kind smallint NOT NULL,
    a_id bigint NOT NULL,
    a_version bigint NOT NULL,
    a_key text COLLATE "C" NOT NULL,
    b_kind smallint NOT NULL,
    b_id bigint NOT NULL,
    b_version bigint NOT NULL,
    b_key text COLLATE "C" NOT NULL,
    periods tstzmultirange NOT NULL,
    verdict text NOT NULL,
    region geometry(Geometry, 4326),
    first_contact_point geometry(Point, 4326),
    method text NOT NULL,
    time_error_s double precision NOT NULL,
    found_at timestamptz NOT NULL,
    CONSTRAINT conflict_pair_unique UNIQUE (a_kind, a_id, b_kind, b_id),
    CONSTRAINT conflict_kinds_known CHECK (a_kind IN (0, 1) AND b_kind IN (0, 1)),
    CONSTRAINT conflict_members_ordered CHECK (a_kind < b_kind OR (a_kind = b_kind AND a_key < b_key)),
    CONSTRAINT conflict_periods_not_empty CHECK (NOT isempty(periods)),
    CONSTRAINT conflict_verdict_known CHECK (verdict IN ('conflict', 'grazing', 'unresolved')),
    CONSTRAINT conflict_time_error_positive CHECK (time_error_s >= 0)
)
"""

CONFLICT_SCENE = "CREATE INDEX conflict_scene_id_btree ON conflictdb.conflict (scene_id, a_key, b_key)"
CONFLICT_B = "CREATE INDEX conflict_b_btree ON conflictdb.conflict (b_kind, b_id)"


def upgrade() -> None:
    for statement in (
        SETTINGS,
        VERSIONS,
        AREA,
        TRACK,
        OBJECT_KEY,
        CHANGE,
        CHANGE_OBJECT,
        PIECE,
        PIECE_GIST,
        PIECE_OBJECT,
        RUN,
        RUN_SCENE,
        CONFLICT,
        CONFLICT_SCENE,
        CONFLICT_B,
    ):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
