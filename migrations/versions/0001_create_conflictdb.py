"""Create the tables: input (scene, area, track), derived (piece, conflict) and records (change, run, history).

Heights are metres above mean sea level, longitude and latitude degrees, hulls metres of the plane.
Comments on tables and columns are in sql/, with the routines.
"""

from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

# Whether a detection may find other conflicts than the release before it did. There is none before it.
changes_answers = False

# Object numbers have the kind above 62 bits of id (_object_number); restores and replicas also bring ids.
LARGEST_ID = 2**62 - 1

# Roles by name, so that a dump can be restored on a server without some of them.
SCENE = f"""
CREATE TABLE conflictdb.scene (
    scene_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT scene_pkey PRIMARY KEY,
    name text COLLATE "C" NOT NULL CONSTRAINT scene_name_unique UNIQUE,
    motion text NOT NULL DEFAULT 'rhumb',
    earth text NOT NULL DEFAULT 'wgs84',
    method text NOT NULL DEFAULT 'exact',
    tolerance_m double precision NOT NULL DEFAULT 1.0,
    separation_m double precision NOT NULL DEFAULT 0.0,
    nearest_m double precision NOT NULL DEFAULT 0.0,
    centre_lon double precision,
    centre_lat double precision,
    history_kept interval,
    owner name DEFAULT current_user,
    CONSTRAINT scene_scene_id_in_range CHECK (scene_id BETWEEN 1 AND {LARGEST_ID}),
    CONSTRAINT scene_name_valid CHECK (btrim(name) <> '' AND octet_length(name) <= 1000),
    CONSTRAINT scene_motion_known CHECK (motion IN ('rhumb', 'great_circle')),
    CONSTRAINT scene_earth_known CHECK (earth IN ('wgs84', 'sphere')),
    CONSTRAINT scene_circles_on_sphere CHECK (motion = 'rhumb' OR earth = 'sphere'),
    CONSTRAINT scene_method_known CHECK (method IN ('screen', 'window', 'exact', 'nlp')),
    CONSTRAINT scene_tolerance_finite CHECK (tolerance_m >= 0 AND tolerance_m < 'infinity'),
    CONSTRAINT scene_separation_finite CHECK (separation_m >= 0 AND separation_m < 'infinity'),
    CONSTRAINT scene_nearest_finite CHECK (nearest_m >= 0 AND nearest_m < 'infinity'),
    CONSTRAINT scene_centre_of_circles CHECK (motion = 'great_circle' OR num_nulls(centre_lon, centre_lat) = 2),
    CONSTRAINT scene_centre_on_earth CHECK (
        num_nulls(centre_lon, centre_lat) IN (0, 2)
        AND (centre_lon BETWEEN -180 AND 180 AND centre_lat BETWEEN -90 AND 90) IS NOT FALSE
    ),
    CONSTRAINT scene_history_kept_positive CHECK (history_kept >= interval '0')
)
"""

SCENE_SHARE = """
CREATE TABLE conflictdb.scene_share (
    scene_id bigint NOT NULL CONSTRAINT scene_share_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    role name NOT NULL,
    may_write boolean NOT NULL,
    shared_by name NOT NULL DEFAULT current_user,
    shared_at timestamptz NOT NULL DEFAULT now(),
    CONSTRAINT scene_share_pkey PRIMARY KEY (scene_id, role)
)
"""

# A detection locks the row of its scene until its transaction ends. No foreign key: removal of the scene would wait.
SCENE_LOCK = """
CREATE TABLE conflictdb.scene_lock (
    scene_id bigint NOT NULL CONSTRAINT scene_lock_pkey PRIMARY KEY,
    taken bigint NOT NULL DEFAULT 0
)
"""

# Versions and marks share a sequence, so that no number repeats, also after an object was removed.
VERSIONS = "CREATE SEQUENCE conflictdb.version_seq AS bigint"

AREA = f"""
CREATE TABLE conflictdb.area (
    area_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT area_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT area_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    key text COLLATE "C" NOT NULL,
    name text,
    footprint geometry(MultiPolygon, 4326) NOT NULL,
    active_span tstzrange NOT NULL DEFAULT tstzrange(NULL, NULL),
    floor_m double precision,
    ceiling_m double precision,
    properties jsonb NOT NULL DEFAULT '{{}}',
    version bigint NOT NULL,
    first_version bigint NOT NULL DEFAULT 0,
    CONSTRAINT area_area_id_in_range CHECK (area_id BETWEEN 1 AND {LARGEST_ID}),
    CONSTRAINT area_key_unique UNIQUE (scene_id, key),
    CONSTRAINT area_key_valid CHECK (key <> '' AND octet_length(key) <= 1000),
    CONSTRAINT area_span_not_empty CHECK (NOT isempty(active_span)),
    CONSTRAINT area_heights_finite CHECK (
        (floor_m > '-infinity' AND floor_m < 'infinity') IS NOT FALSE
        AND (ceiling_m > '-infinity' AND ceiling_m < 'infinity') IS NOT FALSE
    ),
    CONSTRAINT area_ceiling_above_floor CHECK (ceiling_m > floor_m),
    CONSTRAINT area_properties_object CHECK (jsonb_typeof(properties) = 'object')
)
"""

TRACK = f"""
CREATE TABLE conflictdb.track (
    track_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT track_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT track_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    key text COLLATE "C" NOT NULL,
    name text,
    path geometry(LineStringM, 4326) NOT NULL,
    outline geometry(Polygon) NOT NULL,
    floor_m double precision,
    ceiling_m double precision,
    properties jsonb NOT NULL DEFAULT '{{}}',
    version bigint NOT NULL,
    grow_mps double precision NOT NULL DEFAULT 0,
    outlines geometry(MultiPolygon),
    floors_m double precision[],
    ceilings_m double precision[],
    first_version bigint NOT NULL DEFAULT 0,
    CONSTRAINT track_track_id_in_range CHECK (track_id BETWEEN 1 AND {LARGEST_ID}),
    CONSTRAINT track_key_unique UNIQUE (scene_id, key),
    CONSTRAINT track_key_valid CHECK (key <> '' AND octet_length(key) <= 1000),
    CONSTRAINT track_heights_finite CHECK (
        (floor_m > '-infinity' AND floor_m < 'infinity') IS NOT FALSE
        AND (ceiling_m > '-infinity' AND ceiling_m < 'infinity') IS NOT FALSE
    ),
    CONSTRAINT track_ceiling_above_floor CHECK (ceiling_m > floor_m),
    CONSTRAINT track_heights_in_a_row CHECK (array_ndims(floors_m) = 1 AND array_ndims(ceilings_m) = 1),
    CONSTRAINT track_growth_in_range CHECK (grow_mps BETWEEN 0 AND 1e6),
    CONSTRAINT track_growth_given_once CHECK (grow_mps = 0 OR outlines IS NULL),
    CONSTRAINT track_properties_object CHECK (jsonb_typeof(properties) = 'object')
)
"""

# A primary key makes keys unique across areas and tracks, also between concurrent writers.
OBJECT_KEY = """
CREATE TABLE conflictdb.object_key (
    scene_id bigint NOT NULL CONSTRAINT object_key_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    key text COLLATE "C" NOT NULL,
    object_kind smallint NOT NULL,
    CONSTRAINT object_key_pkey PRIMARY KEY (scene_id, key),
    CONSTRAINT object_key_kind_known CHECK (object_kind IN (0, 1))
)
"""

# No primary key: a restore sets the sequence back, so numbers of marks may repeat.
CHANGE = f"""
CREATE TABLE conflictdb.change (
    change_id bigint GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL CONSTRAINT change_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    object_kind smallint NOT NULL,
    object_id bigint NOT NULL,
    version bigint NOT NULL,
    changed_at timestamptz NOT NULL DEFAULT now(),
    is_covered boolean NOT NULL DEFAULT false,
    CONSTRAINT change_kind_known CHECK (object_kind IN (0, 1)),
    CONSTRAINT change_object_id_in_range CHECK (object_id BETWEEN 1 AND {LARGEST_ID})
)
"""
CHANGE_OBJECT = "CREATE INDEX change_scene_id_object_btree ON conflictdb.change (scene_id, object_kind, object_id)"

# No foreign key to the scene: it would cost more than the rows. sql/18_locking.sql removes pieces with their scene.
PIECE = """
CREATE TABLE conflictdb.piece (
    piece_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT piece_pkey PRIMARY KEY,
    scene_id bigint NOT NULL,
    object_kind smallint NOT NULL,
    object_id bigint NOT NULL,
    version bigint NOT NULL,
    part integer NOT NULL,
    turn smallint NOT NULL,
    hull geometry(Polygon) NOT NULL,
    span tstzrange NOT NULL,
    floor_m double precision NOT NULL,
    ceiling_m double precision NOT NULL,
    shape geometry(Polygon),
    leg_start timestamptz,
    leg_end timestamptz,
    start_lon_deg double precision,
    start_lat_deg double precision,
    end_lon_deg double precision,
    end_lat_deg double precision,
    bearing_deg double precision,
    shape_to geometry(Polygon),
    pieces integer NOT NULL DEFAULT 1,
    parts integer[],
    hulls geometry(MultiPolygon),
    shapes geometry(MultiPolygon),
    cuts timestamptz[],
    leg_times timestamptz[],
    legs double precision[],
    CONSTRAINT piece_kind_known CHECK (object_kind IN (0, 1)),
    CONSTRAINT piece_span_not_empty CHECK (NOT isempty(span)),
    CONSTRAINT piece_ceiling_above_floor CHECK (ceiling_m > floor_m),
    CONSTRAINT piece_motion_of_tracks CHECK (
        num_nulls(leg_start, leg_end, start_lon_deg, start_lat_deg, end_lon_deg, end_lat_deg, bearing_deg)
        = CASE WHEN object_kind = 1 AND pieces = 1 THEN 0 ELSE 7 END),
    CONSTRAINT piece_bundle_complete CHECK (
        CASE WHEN pieces = 1
             THEN shape IS NOT NULL AND num_nonnulls(parts, hulls, shapes, cuts, leg_times, legs) = 0
             WHEN object_kind = 0
             THEN num_nonnulls(parts, hulls, shapes) = 3 AND num_nonnulls(shape, shape_to, cuts, leg_times, legs) = 0
             ELSE num_nonnulls(parts, hulls, shape, cuts, leg_times, legs) = 6
                  AND num_nonnulls(shapes, shape_to) = 0 END)
)
"""
PIECE_STORAGE = """
ALTER TABLE conflictdb.piece ALTER COLUMN hulls SET STORAGE EXTERNAL, ALTER COLUMN shapes SET STORAGE EXTERNAL
"""
# No query filters by these columns, and ANALYZE of them would cost as much as of all others.
WITHOUT_STATISTICS = (
    *("version", "part", "shape", "shape_to", "parts", "hulls", "shapes", "cuts", "leg_times", "legs", "leg_start"),
    *("leg_end", "start_lon_deg", "start_lat_deg", "end_lon_deg", "end_lat_deg", "bearing_deg"),
)
PIECE_STATISTICS = "ALTER TABLE conflictdb.piece " + ", ".join(
    f"ALTER COLUMN {column} SET STATISTICS 0" for column in WITHOUT_STATISTICS
)
# Stage 1 is one join on this index: scene, box and time span.
PIECE_GIST = "CREATE INDEX piece_scene_id_hull_span_gist ON conflictdb.piece USING gist (scene_id, hull, span)"
PIECE_OBJECT = "CREATE INDEX piece_object_btree ON conflictdb.piece (object_kind, object_id)"

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
    CONSTRAINT run_scene_unique UNIQUE (scene_id, run_id),
    CONSTRAINT run_failed_or_counted CHECK ((error IS NULL) = (conflicts IS NOT NULL))
)
"""

# No foreign keys: to scene and run they would cost more than the rows (sql/18_locking.sql removes conflicts with their
# scene); conflicts of a removed object stay, shown as not current, until the next detection.
CONFLICTS = "CREATE SEQUENCE conflictdb.conflict_seq"
CONFLICT = """
CREATE TABLE conflictdb.conflict (
    scene_id bigint NOT NULL,
    run_id bigint NOT NULL,
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
    closest_at timestamptz,
    closest_m double precision,
    closest_error_m double precision,
    closest_a_point geometry(Point, 4326),
    closest_b_point geometry(Point, 4326),
    digest bigint NOT NULL DEFAULT 0,
    conflict_id bigint NOT NULL,
    changed_at timestamptz,
    told_periods tstzmultirange,
    CONSTRAINT conflict_pkey PRIMARY KEY (a_kind, a_id, b_kind, b_id, scene_id),
    CONSTRAINT conflict_kinds_known CHECK (a_kind IN (0, 1) AND b_kind IN (0, 1)),
    CONSTRAINT conflict_members_ordered CHECK (a_kind < b_kind OR (a_kind = b_kind AND a_key < b_key)),
    CONSTRAINT conflict_verdict_known CHECK (verdict IN ('conflict', 'grazing', 'unresolved', 'near')),
    CONSTRAINT conflict_periods_unless_near CHECK (isempty(periods) = (verdict = 'near')),
    CONSTRAINT conflict_time_error_positive CHECK (time_error_s >= 0),
    CONSTRAINT conflict_closest_positive CHECK (closest_m >= 0 AND closest_error_m >= 0),
    CONSTRAINT conflict_closest_complete CHECK (
        num_nulls(closest_m, closest_error_m, closest_a_point, closest_b_point) IN (0, 4)
        AND (closest_at IS NULL OR closest_m IS NOT NULL)
        AND (verdict <> 'near' OR closest_m IS NOT NULL)
    )
)
"""
CONFLICT_INDEXES = (
    "CREATE INDEX conflict_scene_id_a_key_btree ON conflictdb.conflict (scene_id, a_key)",
    "CREATE INDEX conflict_scene_id_b_key_btree ON conflictdb.conflict (scene_id, b_key)",
    "CREATE INDEX conflict_b_btree ON conflictdb.conflict (b_kind, b_id)",
    # As quick as GiST on (scene_id, region, periods), at a third of its size.
    "CREATE INDEX conflict_region_spgist ON conflictdb.conflict USING spgist (region) WHERE verdict <> 'near'",
)

# No foreign keys, as for conflicts.
CONFLICT_EVENT = """
CREATE TABLE conflictdb.conflict_event (
    conflict_event_id bigint GENERATED ALWAYS AS IDENTITY,
    scene_id bigint NOT NULL,
    run_id bigint NOT NULL,
    conflict_id bigint NOT NULL,
    kind text NOT NULL,
    at timestamptz NOT NULL,
    opened_at timestamptz NOT NULL,
    a_kind smallint NOT NULL,
    a_key text COLLATE "C" NOT NULL,
    b_kind smallint NOT NULL,
    b_key text COLLATE "C" NOT NULL,
    periods tstzmultirange NOT NULL,
    verdict text NOT NULL,
    time_error_s double precision NOT NULL,
    closest_at timestamptz,
    closest_m double precision,
    closest_error_m double precision,
    CONSTRAINT conflict_event_pkey PRIMARY KEY (scene_id, conflict_event_id),
    CONSTRAINT conflict_event_kind_known CHECK (kind IN ('opened', 'changed', 'closed'))
)
"""

HISTORY = """
CREATE TABLE conflictdb.history (
    scene_id bigint CONSTRAINT history_pkey PRIMARY KEY
        CONSTRAINT history_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    first_run_id bigint,
    pruned_at timestamptz NOT NULL
)
"""

ACKNOWLEDGEMENT = """
CREATE TABLE conflictdb.acknowledgement (
    acknowledgement_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT acknowledgement_pkey PRIMARY KEY,
    scene_id bigint NOT NULL
        CONSTRAINT acknowledgement_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    conflict_id bigint NOT NULL,
    acknowledged_by text NOT NULL DEFAULT current_user,
    acknowledged_at timestamptz NOT NULL DEFAULT now(),
    reason text NOT NULL,
    until timestamptz,
    a_key text COLLATE "C" NOT NULL,
    b_key text COLLATE "C" NOT NULL,
    periods tstzmultirange NOT NULL,
    verdict text NOT NULL,
    time_error_s double precision NOT NULL,
    closest_m double precision,
    closest_error_m double precision,
    ended_by text,
    ended_at timestamptz,
    CONSTRAINT acknowledgement_end_told CHECK ((ended_at IS NULL) = (ended_by IS NULL)),
    CONSTRAINT acknowledgement_reason_given CHECK (btrim(reason) <> '')
)
"""
# At most one in force per conflict.
ACKNOWLEDGEMENT_CONFLICT = """
CREATE UNIQUE INDEX acknowledgement_conflict_id_btree ON conflictdb.acknowledgement (conflict_id)
    WHERE ended_at IS NULL
"""
ACKNOWLEDGEMENT_SCENE = "CREATE INDEX acknowledgement_scene_id_btree ON conflictdb.acknowledgement (scene_id)"

# A row of an attached table, as fields of an area or track.
ATTACHED_ROW = """
CREATE TYPE conflictdb.attached_row AS (
    identity text,
    hash bigint,
    is_asked boolean,
    error text,
    key text,
    name text,
    shape geometry,
    at timestamptz,
    times timestamptz[],
    span tstzrange,
    starts_at timestamptz,
    ends_at timestamptz,
    floor_m double precision,
    ceiling_m double precision,
    floors_m double precision[],
    ceilings_m double precision[],
    outline geometry,
    outlines geometry,
    fore_m double precision,
    aft_m double precision,
    port_m double precision,
    starboard_m double precision,
    grow_mps double precision,
    properties jsonb
)
"""

# A scene cannot be removed while tables are attached to it: their triggers would stay behind.
ATTACHMENT = """
CREATE TABLE conflictdb.attachment (
    attachment_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT attachment_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT attachment_scene_fkey REFERENCES conflictdb.scene,
    object_kind smallint NOT NULL,
    table_schema text NOT NULL,
    table_name text NOT NULL,
    map jsonb NOT NULL,
    identity_columns text[] NOT NULL,
    has_triggers boolean NOT NULL,
    every interval NOT NULL,
    attached_at timestamptz NOT NULL DEFAULT now(),
    compared_at timestamptz,
    failed_at timestamptz,
    error text,
    CONSTRAINT attachment_kind_known CHECK (object_kind IN (0, 1)),
    CONSTRAINT attachment_every_positive CHECK (every >= interval '1 second'),
    CONSTRAINT attachment_failure_told CHECK ((failed_at IS NULL) = (error IS NULL))
)
"""
ATTACHMENT_SCENE = "CREATE INDEX attachment_scene_id_btree ON conflictdb.attachment (scene_id)"

# No foreign key: writers of the attached table would wait for, or fail with, whoever detaches it.
ATTACHED_CHANGE = """
CREATE TABLE conflictdb.attached_change (
    attached_change_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT attached_change_pkey PRIMARY KEY,
    attachment_id bigint NOT NULL,
    identities text[],
    changed_at timestamptz NOT NULL DEFAULT now()
)
"""

ATTACHED_OBJECT = """
CREATE TABLE conflictdb.attached_object (
    attachment_id bigint NOT NULL
        CONSTRAINT attached_object_attachment_fkey REFERENCES conflictdb.attachment ON DELETE CASCADE,
    identity text COLLATE "C" NOT NULL,
    hash bigint,
    key text COLLATE "C",
    object_id bigint,
    version bigint,
    reason text,
    is_taken boolean NOT NULL DEFAULT false,
    since timestamptz NOT NULL DEFAULT now(),
    CONSTRAINT attached_object_pkey PRIMARY KEY (attachment_id, identity),
    CONSTRAINT attached_object_mapped_or_told CHECK (num_nonnulls(object_id, reason) > 0)
)
"""
ATTACHED_OBJECT_INDEXES = (
    "CREATE INDEX attached_object_object_btree ON conflictdb.attached_object (attachment_id, object_id)",
    "CREATE INDEX attached_object_reason_btree ON conflictdb.attached_object (attachment_id) WHERE reason IS NOT NULL",
)

PROBE_REQUEST = """
CREATE TABLE conflictdb.probe_request (
    probe_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT probe_request_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT probe_request_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    asked_by name NOT NULL DEFAULT current_user,
    asked_at timestamptz NOT NULL DEFAULT now(),
    object_kind smallint NOT NULL,
    key text COLLATE "C",
    footprint geometry(MultiPolygon, 4326),
    active_span tstzrange,
    path geometry(LineStringM, 4326),
    outline geometry(Polygon),
    grow_mps double precision NOT NULL DEFAULT 0,
    floor_m double precision,
    ceiling_m double precision,
    answered_at timestamptz,
    is_current boolean,
    error text,
    failures smallint NOT NULL DEFAULT 0,
    CONSTRAINT probe_request_kind_known CHECK (object_kind IN (0, 1)),
    CONSTRAINT probe_request_plan_given CHECK (
        CASE object_kind WHEN 0 THEN num_nonnulls(footprint, active_span) = 2 ELSE num_nonnulls(path, outline) = 2 END
    )
)
"""
PROBE_REQUEST_SCENE = "CREATE INDEX probe_request_scene_btree ON conflictdb.probe_request (scene_id, answered_at)"

PROBE_REPLY = """
CREATE TABLE conflictdb.probe_reply (
    probe_id bigint NOT NULL
        CONSTRAINT probe_reply_request_fkey REFERENCES conflictdb.probe_request ON DELETE CASCADE,
    object_kind smallint NOT NULL,
    key text COLLATE "C" NOT NULL,
    verdict text NOT NULL,
    periods tstzmultirange NOT NULL,
    time_error_s double precision NOT NULL,
    first_contact_point geometry(Point, 4326),
    closest_at timestamptz,
    closest_m double precision,
    closest_error_m double precision,
    CONSTRAINT probe_reply_pkey PRIMARY KEY (probe_id, key),
    CONSTRAINT probe_reply_kind_known CHECK (object_kind IN (0, 1))
)
"""


def upgrade() -> None:
    for statement in (
        *(SCENE, SCENE_SHARE, SCENE_LOCK, VERSIONS, AREA, TRACK, OBJECT_KEY, CHANGE, CHANGE_OBJECT),
        *(PIECE, PIECE_STORAGE, PIECE_STATISTICS, PIECE_GIST, PIECE_OBJECT),
        *(RUN, CONFLICTS, CONFLICT, *CONFLICT_INDEXES, CONFLICT_EVENT, HISTORY),
        *(ACKNOWLEDGEMENT, ACKNOWLEDGEMENT_CONFLICT, ACKNOWLEDGEMENT_SCENE),
        *(ATTACHED_ROW, ATTACHMENT, ATTACHMENT_SCENE, ATTACHED_CHANGE, ATTACHED_OBJECT, *ATTACHED_OBJECT_INDEXES),
        *(PROBE_REQUEST, PROBE_REQUEST_SCENE, PROBE_REPLY),
    ):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
