"""Remember conflicts: a number for each, what became of them, who acknowledged them, how far back is known."""

from alembic import op

revision = "0024"
down_revision = "0023"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "f732d9cf33b52bd81cad8a64d6dc70d086a90697b3a508d9068574f06c67dcb4"

# Conflicts that are there already get a number each; found_at is when they opened.
LIFE = """
CREATE SEQUENCE conflictdb.conflict_seq;
ALTER TABLE conflictdb.conflict
    ADD COLUMN conflict_id bigint NOT NULL DEFAULT nextval('conflictdb.conflict_seq'),
    ADD COLUMN changed_at timestamptz,
    ADD COLUMN told_periods tstzmultirange;
ALTER TABLE conflictdb.conflict ALTER COLUMN conflict_id DROP DEFAULT
"""

# By foreign keys neither scene nor run, as for conflicts: they would cost more than the rows.
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

# What was known before the upgrade is not known: history begins with what is known now.
HISTORY = """
CREATE TABLE conflictdb.history (
    scene_id bigint CONSTRAINT history_pkey PRIMARY KEY
        CONSTRAINT history_scene_fkey REFERENCES conflictdb.scene ON DELETE CASCADE,
    first_run_id bigint,
    pruned_at timestamptz NOT NULL
);
INSERT INTO conflictdb.history (scene_id, first_run_id, pruned_at)
    SELECT r.scene_id, max(r.run_id), now() FROM conflictdb.run r WHERE r.error IS NULL GROUP BY r.scene_id;
INSERT INTO conflictdb.conflict_event (scene_id, run_id, conflict_id, kind, at, opened_at, a_kind, a_key, b_kind, b_key,
                                       periods, verdict, time_error_s, closest_at, closest_m, closest_error_m)
    SELECT c.scene_id, c.run_id, c.conflict_id, 'opened', c.found_at, c.found_at, c.a_kind, c.a_key, c.b_kind, c.b_key,
           c.periods, c.verdict, c.time_error_s, c.closest_at, c.closest_m, c.closest_error_m
    FROM conflictdb.conflict c WHERE c.verdict <> 'near';
ALTER TABLE conflictdb.scene ADD COLUMN history_kept interval
    CONSTRAINT scene_history_kept_positive CHECK (history_kept >= interval '0')
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
# One at a time for a conflict.
ACKNOWLEDGEMENT_CONFLICT = """
CREATE UNIQUE INDEX acknowledgement_conflict_id_btree ON conflictdb.acknowledgement (conflict_id)
    WHERE ended_at IS NULL
"""
ACKNOWLEDGEMENT_SCENE = "CREATE INDEX acknowledgement_scene_id_btree ON conflictdb.acknowledgement (scene_id)"


def upgrade() -> None:
    for statement in (
        LIFE,
        CONFLICT_EVENT,
        HISTORY,
        ACKNOWLEDGEMENT,
        ACKNOWLEDGEMENT_CONFLICT,
        ACKNOWLEDGEMENT_SCENE,
    ):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
