"""Answer probes: what somebody asks the workers about a plan, and what they say."""

from alembic import op

revision = "0023"
down_revision = "0022"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "eb2a16c306a9403d1f758549167ffa8c868b99ae22b51d3dfedf3fc0da517635"

REQUEST = """
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
    CONSTRAINT probe_request_kind_known CHECK (object_kind IN (0, 1)),
    CONSTRAINT probe_request_plan_given CHECK (
        CASE object_kind WHEN 0 THEN num_nonnulls(footprint, active_span) = 2 ELSE num_nonnulls(path, outline) = 2 END
    )
)
"""
# When was the scene answered last, and what waits?
REQUEST_SCENE = "CREATE INDEX probe_request_scene_btree ON conflictdb.probe_request (scene_id, answered_at)"

REPLY = """
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
    for statement in (REQUEST, REQUEST_SCENE, REPLY):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
