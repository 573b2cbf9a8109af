"""Audit edits, and keep limits and history in tables."""

from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.jobs.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "5698e88cc658b1af13201f9233b84d54e8f19a4c8071a39fbcc8fb1c8981c7dc"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

# Limits that administrators set; a setting of a session or role only lowers them. A dump restores tables by name: these
# limits come after the objects, which may be older than the limits.
UPPER_LIMIT = """
CREATE TABLE IF NOT EXISTS conflictdb.upper_limit (
    name text CONSTRAINT upper_limit_pkey PRIMARY KEY,
    value double precision NOT NULL CONSTRAINT upper_limit_positive CHECK (value >= 0 AND value <= 'infinity')
)
"""

# The audit: one row per statement, scene and kind. No foreign key: edits outlive their scenes.
EDIT = """
CREATE TABLE IF NOT EXISTS conflictdb.edit (
    edit_id bigint GENERATED ALWAYS AS IDENTITY CONSTRAINT edit_pkey PRIMARY KEY,
    transaction_id xid8 NOT NULL DEFAULT pg_current_xact_id(),
    edited_at timestamptz NOT NULL DEFAULT clock_timestamp(),
    scene_id bigint NOT NULL,
    scene text,
    kind text NOT NULL,
    action text NOT NULL,
    keys text[] NOT NULL,
    former_keys text[],
    role text NOT NULL DEFAULT coalesce(nullif(current_setting('role'), 'none'), session_user::text),
    login text NOT NULL DEFAULT session_user,
    pid integer NOT NULL DEFAULT pg_backend_pid(),
    application text NOT NULL DEFAULT current_setting('application_name'),
    client text DEFAULT host(inet_client_addr())
);
CREATE INDEX IF NOT EXISTS edit_scene_btree ON conflictdb.edit (scene_id, edit_id);
"""
EDIT_SEAL = """
CREATE TABLE IF NOT EXISTS conflictdb.edit_seal (
    seal_id bigint CONSTRAINT edit_seal_pkey PRIMARY KEY,
    edit_ids int8multirange NOT NULL,
    edits bigint NOT NULL,
    digest bytea NOT NULL,
    sealed_at timestamptz NOT NULL DEFAULT clock_timestamp(),
    given_id bigint NOT NULL,
    next_transaction xid8 NOT NULL,
    settled_id bigint NOT NULL
)
"""

# Pruning reads what is old, and questions what is new. Times of a run are equal, so entries take 7 bytes. Times come
# first: an index that begins with the scene would be taken for the primary key while the statistics know of no events.
EVENT_TIMES = """
CREATE INDEX IF NOT EXISTS conflict_event_at_scene_id_btree ON conflictdb.conflict_event (at, scene_id)
"""

STATEMENTS: tuple[str, ...] = (
    UPPER_LIMIT,
    EDIT,
    EDIT_SEAL,
    EVENT_TIMES,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
