"""Mark every object, remove the method `window` (its scenes become `exact`), and add `vertical_separation_m`."""

from alembic import op
from sqlalchemy import Column, Double, text

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "8c3e2ca33c83b5a46a711ad1792c1a8e641ae6be5ab68597290d34cf595e0c47"

# Whether a detection may find other conflicts than the release before it did. The upgrade then marks every object.
changes_answers = True

# Parameters that were settings, one by one.
SETTINGS = f"{', '.join(['text'] * 4)}, {', '.join(['double precision'] * 5)}"

# Their arguments or results change; sql/ creates the new ones.
REPLACED_ROUTINES = (
    "_approaches(text, boolean, text[])",
    "_begin_detection(text, double precision, integer, boolean)",
    "_conflicts(text, timestamptz, boolean, text[])",
    "_explained_object(bigint, text)",
    "_keys_of(bigint, smallint[], bigint[])",
    f"_load({SETTINGS}, boolean)",
    (
        "_pieces_meeting(bigint, text, bytea[], bigint[], bigint[], boolean[], double precision[], double precision[], "
        "integer[])"
    ),
    (
        "_put_pieces(bigint, bigint, smallint[], bigint[], bigint[], integer[], integer[], smallint[], bytea[], "
        "tstzrange[], double precision[], double precision[], bytea[], bytea[], timestamptz[], timestamptz[], "
        "double precision[], double precision[], double precision[], double precision[], double precision[], "
        "integer[], bytea[], bytea[], integer[], timestamptz[], timestamptz[], double precision[])"
    ),
    "_refuse(text, text, text, text, text, text)",
    "_scene(bigint)",
    "_scene_named(text)",
    "_scene_state(text)",
    "_scenes()",
    f"_set_scene({SETTINGS})",
    "_wait_for_probe(bigint, interval)",
    "acknowledge(text, text, text, text, timestamptz)",
    f"create_scene({SETTINGS})",
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

# Who acknowledged, where several people share a role.
NAME = """
ALTER TABLE conflictdb.acknowledgement ADD COLUMN IF NOT EXISTS given_name text
    CONSTRAINT acknowledgement_given_name_valid CHECK (btrim(given_name) <> '' AND octet_length(given_name) <= 1000);
"""


def upgrade() -> None:
    for routine in REPLACED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")
    for statement in (DROP_TRIGGERS, *REPLACE_METHOD, NAME):
        op.execute(statement)
    op.add_column(
        "scene",
        Column("vertical_separation_m", Double, nullable=False, server_default=text("0.0")),
        schema="conflictdb",
    )
    op.create_check_constraint(
        "scene_vertical_separation_finite",
        "scene",
        "vertical_separation_m >= 0 AND vertical_separation_m < 'infinity'",
        schema="conflictdb",
    )
    op.drop_constraint("scene_method_known", "scene", schema="conflictdb")
    op.create_check_constraint(
        "scene_method_known", "scene", "method IN ('screen', 'exact', 'nlp')", schema="conflictdb"
    )


def downgrade() -> None:
    raise NotImplementedError(
        "conflictdb does not downgrade; DROP SCHEMA conflictdb, conflictdb_internal CASCADE removes it"
    )
