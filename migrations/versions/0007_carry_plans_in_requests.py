"""Requests to workers carry plans as they are written.

Requests and replies of the older form go: they live an hour, and nobody waits for them across an upgrade.
"""

from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "4fad277114473f38011807518f9b72b05d2b401d4be16fae25ad235d6709653a"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = True


REQUESTS = """
DELETE FROM conflictdb.probe_request;
-- Their bodies name the columns that go.
DROP FUNCTION IF EXISTS conflictdb_internal._probe_request(bigint), conflictdb_internal._requested_admission(bigint);
ALTER TABLE conflictdb.probe_request
    DROP CONSTRAINT IF EXISTS probe_request_plan_given,
    DROP CONSTRAINT IF EXISTS probe_request_kind_known,
    DROP COLUMN IF EXISTS object_kind, DROP COLUMN IF EXISTS key, DROP COLUMN IF EXISTS footprint,
    DROP COLUMN IF EXISTS active_span, DROP COLUMN IF EXISTS path, DROP COLUMN IF EXISTS outline,
    DROP COLUMN IF EXISTS grow_mps, DROP COLUMN IF EXISTS floor_m, DROP COLUMN IF EXISTS ceiling_m,
    DROP COLUMN IF EXISTS horizon, DROP COLUMN IF EXISTS delays, DROP COLUMN IF EXISTS owner,
    DROP COLUMN IF EXISTS allow_known, DROP COLUMN IF EXISTS admission,
    ADD COLUMN IF NOT EXISTS kind text NOT NULL
        CONSTRAINT probe_request_kind_known CHECK (kind IN ('probe', 'delays', 'admit')),
    -- As text: jsonb would drop the sign of zeros.
    ALTER COLUMN plans TYPE json USING plans::json,
    ADD COLUMN IF NOT EXISTS options jsonb NOT NULL DEFAULT '{}',
    ADD COLUMN IF NOT EXISTS answer jsonb,
    ADD CONSTRAINT probe_request_plans_given CHECK ((plans IS NULL) = (kind = 'delays'));
ALTER TABLE conflictdb.probe_reply
    ADD COLUMN IF NOT EXISTS plan_key text COLLATE "C" NOT NULL,
    ADD COLUMN IF NOT EXISTS name text,
    ADD COLUMN IF NOT EXISTS closest_a_point geometry(Point, 4326),
    ADD COLUMN IF NOT EXISTS closest_b_point geometry(Point, 4326),
    DROP CONSTRAINT probe_reply_pkey,
    ADD CONSTRAINT probe_reply_pkey PRIMARY KEY (probe_id, plan_key, key);
"""

# A foreign key locks the row of the scene: a role that may only read it would make its owner wait.
LOCKS = """
ALTER TABLE conflictdb.scene DROP CONSTRAINT IF EXISTS scene_parent_fkey;
ALTER TABLE conflictdb.change DROP CONSTRAINT IF EXISTS change_scene_fkey;
ALTER TABLE conflictdb.probe_request DROP CONSTRAINT IF EXISTS probe_request_scene_fkey;
"""


def upgrade() -> None:
    op.execute(REQUESTS)
    op.execute(LOCKS)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
