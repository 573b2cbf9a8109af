"""Mark every object, and remove the method `window`: its scenes become `exact`."""

from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "73e8de200051e56fde99bce7844db83fd57aabea915d1e20f91ad6aa516ada49"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = True

# Their arguments or results change; sql/ creates the new ones.
REPLACED_ROUTINES = (
    "_approaches(text, boolean, text[])",
    "_conflicts(text, timestamptz, boolean, text[])",
    "_scene_state(text)",
)


# Functions of an earlier release may name columns that a revision dropped. sql/ makes the triggers again.
DROP_TRIGGERS = """
DO $$
DECLARE
    v_trigger record;
BEGIN
    FOR v_trigger IN
        SELECT t.tgname, t.tgrelid::regclass AS on_table FROM pg_trigger t JOIN pg_proc p ON p.oid = t.tgfoid
        WHERE t.tgrelid IN ('conflictdb.scene'::regclass, 'conflictdb.conflict'::regclass, 'conflictdb.run'::regclass)
          AND NOT t.tgisinternal AND p.pronamespace = 'conflictdb'::regnamespace
    LOOP
        EXECUTE format('DROP TRIGGER %I ON %s', v_trigger.tgname, v_trigger.on_table);
    END LOOP;
END
$$
"""

# Of what `window` found the promises of `screen` hold: no conflict is missed, and pairs that move are unresolved.
REPLACE_METHOD = (
    "UPDATE conflictdb.scene SET method = 'exact' WHERE method = 'window'",
    "UPDATE conflictdb.run SET method = 'screen' WHERE method = 'window'",
    "UPDATE conflictdb.conflict SET method = 'screen' WHERE method = 'window'",
)


def upgrade() -> None:
    for routine in REPLACED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")
    for statement in (DROP_TRIGGERS, *REPLACE_METHOD):
        op.execute(statement)
    op.drop_constraint("scene_method_known", "scene", schema="conflictdb")
    op.create_check_constraint(
        "scene_method_known", "scene", "method IN ('screen', 'exact', 'nlp')", schema="conflictdb"
    )


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
