"""Plans as they are written."""

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "10bdb2e8ff353c32cf4f9c66f6440e8e9fc6602c63b0a5a1fd0b9afe361fd7af"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

# Floor at the start and the end of the leg, then the ceilings; null where they do not change.
CLIMB = """
ALTER TABLE conflictdb.piece ADD COLUMN IF NOT EXISTS climb double precision[];
"""

# How far voyages may differ from a plan.
TOLERANCES = """
ALTER TABLE conflictdb.track ADD COLUMN IF NOT EXISTS tolerances jsonb;
"""

# Whose separation rules apply to an object, and whose objects are not compared with each other.
CLASSES = """
ALTER TABLE conflictdb.area ADD COLUMN IF NOT EXISTS class text, ADD COLUMN IF NOT EXISTS owner text;
ALTER TABLE conflictdb.track ADD COLUMN IF NOT EXISTS class text, ADD COLUMN IF NOT EXISTS owner text;
"""

# A row of an attached table. Functions of tables that are attached already return the type before it.
ATTACHED_PLAN = """
DO $$
BEGIN
    IF to_regtype('conflictdb.attached_plan') IS NULL THEN
        CREATE TYPE conflictdb.attached_plan AS (
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
            properties jsonb,
            class text,
            owner text,
            activations tstzmultirange,
            departures timestamptz[],
            schedule jsonb,
            tolerances jsonb
        );
    END IF;
END
$$;
"""

# One admission of a scene at a time. Not `scene_lock`, which detections hold for as long as they take.
ADMISSIONS = """
CREATE TABLE IF NOT EXISTS conflictdb.admission_lock (
    scene_id bigint NOT NULL CONSTRAINT admission_lock_pkey PRIMARY KEY,
    taken bigint NOT NULL
);
ALTER TABLE conflictdb.probe_request
    ADD COLUMN IF NOT EXISTS plans jsonb,
    ADD COLUMN IF NOT EXISTS owner text,
    ADD COLUMN IF NOT EXISTS allow_known boolean NOT NULL DEFAULT false,
    ADD COLUMN IF NOT EXISTS admission jsonb,
    DROP CONSTRAINT IF EXISTS probe_request_plan_given,
    ADD CONSTRAINT probe_request_plan_given CHECK (
        CASE WHEN plans IS NOT NULL THEN num_nonnulls(key, footprint, path, horizon) = 0
             WHEN horizon IS NOT NULL THEN object_kind = 1 AND key IS NOT NULL AND path IS NULL
             WHEN object_kind = 0 THEN num_nonnulls(footprint, active_span) = 2
             ELSE num_nonnulls(path, outline) = 2 END);
DROP FUNCTION IF EXISTS conflictdb_internal._next_probe();
CREATE INDEX IF NOT EXISTS area_scene_id_owner_btree ON conflictdb.area (scene_id, owner) WHERE owner IS NOT NULL;
CREATE INDEX IF NOT EXISTS track_scene_id_owner_btree ON conflictdb.track (scene_id, owner) WHERE owner IS NOT NULL;
"""

# Whether spans and height bands contain their upper ends.
INTERVALS = """
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS intervals text NOT NULL DEFAULT 'half_open',
    DROP CONSTRAINT IF EXISTS scene_intervals_known,
    ADD CONSTRAINT scene_intervals_known CHECK (intervals IN ('half_open', 'closed'));
"""


# A rule of two sides; empty texts stand for any object, so that either order of them is one key.
RULES = """
CREATE TABLE IF NOT EXISTS conflictdb.rule (
    rule_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT rule_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT rule_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    a_class text,
    b_class text,
    separation_m double precision,
    vertical_m double precision,
    time_s double precision,
    allowed boolean NOT NULL DEFAULT false,
    yields text,
    CONSTRAINT rule_side CHECK (num_nonnulls(a_class, b_class) > 0),
    CONSTRAINT rule_separation_on_earth CHECK (separation_m BETWEEN 0 AND 20000000),
    CONSTRAINT rule_vertical_on_earth CHECK (vertical_m BETWEEN 0 AND 20000000),
    CONSTRAINT rule_time_known CHECK (time_s BETWEEN 0 AND 2592000),
    CONSTRAINT rule_yields_known CHECK (yields IN ('a', 'b'))
);
CREATE UNIQUE INDEX IF NOT EXISTS rule_sides_unique ON conflictdb.rule (
    scene_id, least(coalesce(a_class, ''), coalesce(b_class, '')),
    greatest(coalesce(a_class, ''), coalesce(b_class, ''))
);
ALTER TABLE conflictdb.piece
    ADD COLUMN IF NOT EXISTS class_number bigint NOT NULL DEFAULT 0,
    ADD COLUMN IF NOT EXISTS owner_number bigint NOT NULL DEFAULT 0;
ALTER TABLE conflictdb.change ADD COLUMN IF NOT EXISTS with_number bigint;
"""

# Changes of plans that clear a scene. Moves keep both paths, so that applying and undoing are exact.
PROPOSALS = """
CREATE TABLE IF NOT EXISTS conflictdb.proposal (
    proposal_id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT proposal_scene_fkey REFERENCES conflictdb.scene (scene_id) ON DELETE CASCADE,
    made_at timestamptz NOT NULL DEFAULT now(),
    made_by text NOT NULL DEFAULT current_user,
    goal text NOT NULL CONSTRAINT proposal_goal_known CHECK (goal IN ('total', 'largest')),
    objective_s double precision NOT NULL,
    bound_s double precision NOT NULL,
    is_least boolean NOT NULL,
    settings jsonb NOT NULL,
    last_version bigint NOT NULL,
    objects_hash bigint NOT NULL,
    applied_at timestamptz,
    applied_by text,
    undone_at timestamptz,
    undone_by text,
    CONSTRAINT proposal_of_scene UNIQUE (proposal_id, scene_id)
);
CREATE INDEX IF NOT EXISTS proposal_scene_id_btree ON conflictdb.proposal (scene_id);
CREATE TABLE IF NOT EXISTS conflictdb.proposal_move (
    proposal_id bigint NOT NULL,
    scene_id bigint NOT NULL,
    track_id bigint NOT NULL,
    key text COLLATE "C" NOT NULL,
    version bigint NOT NULL,
    planned geometry(LineStringM, 4326) NOT NULL,
    path geometry(LineStringM, 4326) NOT NULL,
    delay_s double precision NOT NULL,
    speed double precision NOT NULL,
    clears text[] NOT NULL,
    passes jsonb NOT NULL,
    detour jsonb,
    explanation text NOT NULL,
    version_after bigint,
    CONSTRAINT proposal_move_pkey PRIMARY KEY (proposal_id, track_id),
    CONSTRAINT proposal_move_proposal_fkey
        FOREIGN KEY (proposal_id, scene_id) REFERENCES conflictdb.proposal (proposal_id, scene_id) ON DELETE CASCADE
);
CREATE INDEX IF NOT EXISTS proposal_move_scene_id_btree ON conflictdb.proposal_move (scene_id);
CREATE TABLE IF NOT EXISTS conflictdb.proposal_left (
    proposal_id bigint NOT NULL,
    scene_id bigint NOT NULL,
    key text COLLATE "C" NOT NULL,
    blocked_by text[] NOT NULL,
    CONSTRAINT proposal_left_pkey PRIMARY KEY (proposal_id, key),
    CONSTRAINT proposal_left_proposal_fkey
        FOREIGN KEY (proposal_id, scene_id) REFERENCES conflictdb.proposal (proposal_id, scene_id) ON DELETE CASCADE
);
ALTER TABLE conflictdb.conflict_event ADD COLUMN IF NOT EXISTS proposal_id bigint;
"""

# When an area is active, and a track departs, several times; the schedule that says so, and how far it is expanded.
ACTIVATIONS = """
ALTER TABLE conflictdb.area ADD COLUMN IF NOT EXISTS activations tstzmultirange,
    ADD COLUMN IF NOT EXISTS schedule jsonb, ADD COLUMN IF NOT EXISTS schedule_error text;
ALTER TABLE conflictdb.track ADD COLUMN IF NOT EXISTS departures timestamptz[],
    ADD COLUMN IF NOT EXISTS schedule jsonb, ADD COLUMN IF NOT EXISTS schedule_error text;
CREATE INDEX IF NOT EXISTS area_scene_id_scheduled_btree ON conflictdb.area (scene_id) WHERE schedule IS NOT NULL;
CREATE INDEX IF NOT EXISTS track_scene_id_scheduled_btree ON conflictdb.track (scene_id) WHERE schedule IS NOT NULL;
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS horizon_days double precision NOT NULL DEFAULT 366.0,
    DROP CONSTRAINT IF EXISTS scene_horizon_days_known,
    ADD CONSTRAINT scene_horizon_days_known CHECK (horizon_days BETWEEN 0 AND 36525),
    ADD COLUMN IF NOT EXISTS expanded tstzrange;
"""

# A branch reads its parent's objects, but for the keys that it has edited: with the version that each had then.
BRANCHES = """
ALTER TABLE conflictdb.scene ADD COLUMN IF NOT EXISTS parent_scene_id bigint
    CONSTRAINT scene_parent_fkey REFERENCES conflictdb.scene (scene_id) ON DELETE CASCADE;
CREATE INDEX IF NOT EXISTS scene_parent_scene_id_btree ON conflictdb.scene (parent_scene_id)
    WHERE parent_scene_id IS NOT NULL;
CREATE TABLE IF NOT EXISTS conflictdb.branch_edit (
    scene_id bigint NOT NULL CONSTRAINT branch_edit_scene_fkey REFERENCES conflictdb.scene (scene_id)
        ON DELETE CASCADE,
    key text COLLATE "C" NOT NULL,
    object_kind smallint,
    object_id bigint,
    version bigint,
    CONSTRAINT branch_edit_pkey PRIMARY KEY (scene_id, key)
);
"""

# Whether all voyages within tolerances conflict.
CERTAINTY = """
ALTER TABLE conflictdb.conflict
    ADD COLUMN IF NOT EXISTS certainty text,
    DROP CONSTRAINT IF EXISTS conflict_certainty_known,
    ADD CONSTRAINT conflict_certainty_known CHECK (certainty IN ('must', 'may'));
ALTER TABLE conflictdb.probe_reply ADD COLUMN IF NOT EXISTS certainty text;
"""

# What the heights of a scene are above.
VERTICAL_DATUM = """
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS vertical_datum text NOT NULL DEFAULT 'msl',
    DROP CONSTRAINT IF EXISTS scene_vertical_datum_known,
    ADD CONSTRAINT scene_vertical_datum_known CHECK (vertical_datum IN ('msl', 'wgs84', 'flight_level'));
"""


def upgrade() -> None:
    more = (INTERVALS, PROPOSALS, RULES, ACTIVATIONS, CERTAINTY, BRANCHES, VERTICAL_DATUM)
    for statement in (CLIMB, TOLERANCES, CLASSES, ATTACHED_PLAN, ADMISSIONS, *more):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
