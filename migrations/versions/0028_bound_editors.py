"""Bound what editors and readers can make others do: requests of probes, attached tables, numbers of objects."""

from alembic import op

revision = "0028"
down_revision = "0027"
branch_labels = None
depends_on = None

# SHA-256 of sql/ at this revision (`conflictdb.db.schema.routines_sha256()`); see tests/migration.
routines_sha256 = "696020bc2ea055f3a5edf946f1cc5067304ea72c0683f2f338d474644009a4a4"

REQUESTS = "ALTER TABLE conflictdb.probe_request ADD COLUMN failures smallint NOT NULL DEFAULT 0"
# Their arguments or results change, or they are gone; sql/ makes what follows them.
REPLACED_ROUTINES = (
    "_attached_work(bigint)",
    "_drop_note(bigint)",
    "_next_probe()",
    "_prune_probes(name)",
    "_take_over_attached(bigint, bigint, bigint[], boolean)",
)
# Only the role that attached a table may read it now (sql/43_attached_rows.sql).
ATTACHED = r"""
DO $$
DECLARE
    v_routine regprocedure;
BEGIN
    FOR v_routine IN SELECT p.oid FROM pg_catalog.pg_proc p
                     JOIN pg_catalog.pg_namespace n ON n.oid = p.pronamespace
                     WHERE n.nspname = 'conflictdb_attached' AND p.proname ~ '^rows_\d+$' LOOP
        EXECUTE format('REVOKE ALL ON FUNCTION %s FROM conflictdb_worker', v_routine);
    END LOOP;
END
$$
"""

# An object goes by one number, its kind above 62 bits of its id (_object_number). Restores and replicas bring ids too.
LARGEST_ID = 2**62 - 1
# The constraints below would not say what to do.
NUMBERS_CHECKED = f"""
DO $$
DECLARE
    v_bad record;
BEGIN
    SELECT o.kind, o.key, s.name INTO v_bad
        FROM (SELECT 'area' AS kind, a.area_id AS id, a.key, a.scene_id FROM conflictdb.area a
              UNION ALL SELECT 'track', t.track_id, t.key, t.scene_id FROM conflictdb.track t) o
        JOIN conflictdb.scene s USING (scene_id) WHERE o.id NOT BETWEEN 1 AND {LARGEST_ID} LIMIT 1;
    IF FOUND THEN
        RAISE EXCEPTION 'scene %: % %: id: must be 1 to {LARGEST_ID}', quote_literal(v_bad.name), v_bad.kind,
                        quote_literal(v_bad.key)
            USING ERRCODE = 'check_violation', HINT = 'Remove the object, upgrade, and put it again.';
    END IF;
END
$$;
DELETE FROM conflictdb.change WHERE object_id NOT BETWEEN 1 AND {LARGEST_ID}
"""  # noqa: S608 - a number of this file
NUMBERS = tuple(
    f"ALTER TABLE conflictdb.{table} ADD CONSTRAINT {table}_{column}_in_range "
    f"CHECK ({column} BETWEEN 1 AND {LARGEST_ID});"
    for table, column in (("scene", "scene_id"), ("area", "area_id"), ("track", "track_id"), ("change", "object_id"))
)


def upgrade() -> None:
    op.execute(REQUESTS)
    for routine in REPLACED_ROUTINES:
        op.execute(f"DROP FUNCTION IF EXISTS conflictdb.{routine}")
    # The lock of its row keeps sessions that follow a table apart.
    op.execute("ALTER TABLE conflictdb.attachment DROP COLUMN turn")
    op.execute(ATTACHED)
    for statement in (NUMBERS_CHECKED, *NUMBERS):
        op.execute(statement)


def downgrade() -> None:
    raise NotImplementedError("conflictdb does not downgrade; DROP SCHEMA conflictdb CASCADE removes it")
