"""Plans as they are written."""

from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "7d1c2dc63d07318f1c054f044a341e94d9cb4384731d61e7bb730ce48b956e40"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = False

# Whose separation rules apply to an object, and whose objects are not compared with each other.
CLASSES = """
ALTER TABLE conflictdb.area ADD COLUMN IF NOT EXISTS class text, ADD COLUMN IF NOT EXISTS owner text;
ALTER TABLE conflictdb.track ADD COLUMN IF NOT EXISTS class text, ADD COLUMN IF NOT EXISTS owner text;
DO $$
BEGIN
    IF NOT EXISTS (SELECT FROM pg_attribute a
                   WHERE a.attrelid = 'conflictdb.attached_row'::regclass AND a.attname = 'class') THEN
        ALTER TYPE conflictdb.attached_row ADD ATTRIBUTE class text, ADD ATTRIBUTE owner text;
    END IF;
END
$$;
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


def upgrade() -> None:
    for statement in (CLASSES, PROPOSALS):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
