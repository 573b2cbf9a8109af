"""Keep positions of objects, and compare them with their plans; scenes without regions of conflicts."""

from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "0641896f6da1ddbe97203e1764a48c6424a976beafa2bab9a30903388aab485b"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

# Eight partitions of half a day each, used in turn: what is old is emptied as a whole, and no partition is created or
# dropped while feeds write. No foreign key: a check per row would cost more than the row.
SLOTS = 8
POSITION = f"""
CREATE TABLE IF NOT EXISTS conflictdb.position (
    scene text NOT NULL,
    key text COLLATE "C" NOT NULL,
    instant timestamptz NOT NULL,
    place geometry(Point, 4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL DEFAULT 10,
    scene_id bigint NOT NULL,
    received_at timestamptz NOT NULL DEFAULT clock_timestamp(),
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    slot smallint NOT NULL DEFAULT floor(extract(epoch FROM clock_timestamp()) / 43200)::bigint % {SLOTS}
) PARTITION BY LIST (slot)
"""
PARTITIONS = tuple(
    f"CREATE TABLE IF NOT EXISTS conflictdb.position_{slot} PARTITION OF conflictdb.position FOR VALUES IN ({slot})"
    for slot in range(SLOTS)
)
POSITION_INDEXES = (
    "CREATE INDEX IF NOT EXISTS position_scene_id_key_btree ON conflictdb.position (scene_id, key, instant)",
    # A look reads what transactions since the last one have committed.
    "CREATE INDEX IF NOT EXISTS position_transaction_id_btree ON conflictdb.position (transaction_id)",
)
# What the last look at positions saw: one row.
POSITION_LOOK = """
CREATE TABLE IF NOT EXISTS conflictdb.position_look (
    is_only boolean CONSTRAINT position_look_pkey PRIMARY KEY CONSTRAINT position_look_one CHECK (is_only),
    seen pg_snapshot NOT NULL
)
"""
LIVE_STATE = """
CREATE TABLE IF NOT EXISTS conflictdb.live_state (
    scene_id bigint NOT NULL CONSTRAINT live_state_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    key text COLLATE "C" NOT NULL,
    state text NOT NULL,
    late_from_s double precision,
    late_to_s double precision,
    off_m double precision,
    instant timestamptz NOT NULL,
    place geometry(Point, 4326) NOT NULL,
    height_m double precision,
    error_m double precision NOT NULL,
    seen_from_s double precision,
    seen_to_s double precision,
    slack_s double precision,
    as_of timestamptz NOT NULL,
    version bigint NOT NULL,
    fastest_mps double precision,
    CONSTRAINT live_state_pkey PRIMARY KEY (scene_id, key),
    CONSTRAINT live_state_known CHECK (
        state IN ('on plan', 'late', 'early', 'off', 'silent', 'past its end', 'not yet under way')
    ),
    CONSTRAINT live_state_late_ordered CHECK (late_from_s <= late_to_s AND seen_from_s <= seen_to_s)
)
"""

# Few tracks stray, of many.
LIVE_STATE_STRAYING = """
CREATE INDEX IF NOT EXISTS live_state_straying_btree ON conflictdb.live_state (scene_id)
    WHERE state IN ('late', 'early', 'off', 'silent')
"""

# No foreign key to objects: what follows for a removed one ends at the next look.
LIVE_CONFLICT = """
CREATE TABLE IF NOT EXISTS conflictdb.live_conflict (
    scene_id bigint NOT NULL CONSTRAINT live_conflict_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    key text COLLATE "C" NOT NULL,
    other_key text COLLATE "C" NOT NULL,
    verdict text NOT NULL,
    reason text,
    first_contact timestamptz,
    last_contact timestamptz,
    place geometry(Point, 4326),
    alarm_id bigint NOT NULL,
    opened_at timestamptz NOT NULL,
    acknowledged_by text,
    acknowledged_at timestamptz,
    acknowledged_for text,
    as_of timestamptz NOT NULL,
    CONSTRAINT live_conflict_pkey PRIMARY KEY (scene_id, key, other_key),
    CONSTRAINT live_conflict_verdict_known CHECK (verdict IN ('now', 'must', 'may')),
    CONSTRAINT live_conflict_contacts_ordered CHECK (first_contact <= last_contact)
)
"""
LIVE_CONFLICT_OTHER = """
CREATE INDEX IF NOT EXISTS live_conflict_other_btree ON conflictdb.live_conflict (scene_id, other_key)
"""

REGIONS = """
ALTER TABLE conflictdb.scene
    ADD COLUMN IF NOT EXISTS regions text NOT NULL DEFAULT 'on',
    DROP CONSTRAINT IF EXISTS scene_regions_known,
    ADD CONSTRAINT scene_regions_known CHECK (regions IN ('on', 'off'))
"""
# Nulls cost the index of regions as much as regions do. Those without are looked up by scene.
CONFLICT_REGIONS = """
DROP INDEX IF EXISTS conflictdb.conflict_region_spgist;
CREATE INDEX conflict_region_spgist ON conflictdb.conflict USING spgist (region)
    WHERE verdict <> 'near' AND region IS NOT NULL;
CREATE INDEX IF NOT EXISTS conflict_placeless_btree ON conflictdb.conflict (scene_id)
    WHERE verdict <> 'near' AND region IS NULL
"""

# Not rows of conflict_event: looks take no scene's lock, which keeps the ids of those in order. One session looks at a
# time, which keeps the ids of these in order.
LIVE_EVENT = """
CREATE TABLE IF NOT EXISTS conflictdb.live_event (
    live_event_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT live_event_pkey PRIMARY KEY,
    scene_id bigint NOT NULL CONSTRAINT live_event_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    kind text NOT NULL,
    at timestamptz NOT NULL,
    alarm_id bigint NOT NULL,
    key text COLLATE "C" NOT NULL,
    other_key text COLLATE "C" NOT NULL,
    verdict text NOT NULL,
    reason text,
    first_contact timestamptz,
    last_contact timestamptz,
    place geometry(Point, 4326),
    CONSTRAINT live_event_kind_known CHECK (kind IN ('begun', 'ended'))
)
"""
LIVE_EVENT_SCENE = """
CREATE INDEX IF NOT EXISTS live_event_scene_id_btree ON conflictdb.live_event (scene_id, live_event_id)
"""

# A proposal moves areas, too: in time, by `delay_s`, and in place, to another footprint.
AREA_MOVES = """
ALTER TABLE conflictdb.proposal_move
    DROP CONSTRAINT IF EXISTS proposal_move_pkey,
    ADD CONSTRAINT proposal_move_pkey PRIMARY KEY (proposal_id, key);
ALTER TABLE conflictdb.proposal_move
    ADD COLUMN IF NOT EXISTS area_id bigint,
    ADD COLUMN IF NOT EXISTS planned_footprint geometry(MultiPolygon, 4326),
    ADD COLUMN IF NOT EXISTS footprint geometry(MultiPolygon, 4326),
    ADD COLUMN IF NOT EXISTS planned_span tstzrange,
    ADD COLUMN IF NOT EXISTS planned_activations tstzmultirange,
    ADD COLUMN IF NOT EXISTS place jsonb,
    ALTER COLUMN track_id DROP NOT NULL,
    ALTER COLUMN planned DROP NOT NULL,
    ALTER COLUMN path DROP NOT NULL,
    DROP CONSTRAINT IF EXISTS proposal_move_of_one,
    ADD CONSTRAINT proposal_move_of_one CHECK (
        num_nulls(track_id, planned, path) = CASE WHEN area_id IS NULL THEN 0 ELSE 3 END
        AND num_nonnulls(planned_footprint, footprint) = CASE WHEN area_id IS NULL THEN 0 ELSE 2 END)
"""

STATEMENTS: tuple[str, ...] = (
    POSITION,
    *PARTITIONS,
    *POSITION_INDEXES,
    POSITION_LOOK,
    LIVE_STATE,
    LIVE_STATE_STRAYING,
    LIVE_CONFLICT,
    LIVE_CONFLICT_OTHER,
    LIVE_EVENT,
    LIVE_EVENT_SCENE,
    REGIONS,
    CONFLICT_REGIONS,
    AREA_MOVES,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
