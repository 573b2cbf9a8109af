"""Names that a user plants where PostgreSQL might look run with the rights of that user, never with those of another.

If its schema is on the search path, a function or operator whose argument types fit better is called in place of
PostgreSQL's own. A relation that a routine does not find in its schemas is looked up among temporary relations.
"""

import re
from typing import Any

import psycopg
import pytest
from psycopg import sql

from conflictdb import store
from conflictdb.jobs import schema
from conflictdb.store import connection

Conn = psycopg.Connection[Any]

PLANTER = "conflictdb_editor"
TYPES = [
    *("text", "name", "smallint", "integer", "bigint", "double precision", "numeric", "boolean", "oid", "regclass"),
    *("regnamespace", "timestamptz", "interval", "tstzrange", "jsonb", "text[]", "bigint[]", "double precision[]"),
]
# Overloads of each name, with all types that PostgreSQL's own takes: each does the same and notes as whom it runs.
# Notices outlive a statement that fails.
PLANT = r"""
DO $plant$
DECLARE
    v_name text;
    v_types text[];
    v_call text;
    v_result text;
    v_body text;
BEGIN
    FOR v_name, v_types IN
        SELECT n, array_remove(ARRAY[a, b], NULL) FROM unnest({names}::text[]) n, unnest({types}::text[]) a,
             (SELECT unnest({types}::text[]) UNION ALL SELECT NULL) b (b)
        WHERE (b IS NOT NULL OR n ~ '^\w') AND NOT (n = '||' AND concat(a, b) ~ ']') LOOP
        v_call := CASE WHEN v_name ~ '^\w' THEN pg_catalog.format('pg_catalog.%I($1%s)', v_name,
                                                       CASE WHEN v_types[2] IS NOT NULL THEN ', $2' ELSE '' END)
                       ELSE pg_catalog.format('$1 OPERATOR(pg_catalog.%s) $2', v_name) END;
        BEGIN
            EXECUTE 'SELECT pg_typeof(' || replace(replace(v_call, '$1', 'NULL::' || v_types[1]), '$2',
                                                   'NULL::' || coalesce(v_types[2], 'text')) || ')' INTO v_result;
            v_body := 'BEGIN RAISE WARNING ''planted %: %'', ' || quote_literal(v_name) || ', current_user; RETURN '
                      || v_call || '; END';
            EXECUTE pg_catalog.format('CREATE FUNCTION public.%I(%s) RETURNS %s LANGUAGE plpgsql AS %L',
                           CASE WHEN v_name ~ '^\w' THEN v_name ELSE 'operator ' || v_name END,
                           array_to_string(v_types, ', '), v_result, v_body);
            IF v_name !~ '^\w' THEN
                EXECUTE pg_catalog.format(
                    'CREATE OPERATOR public.%s (LEFTARG = %s, RIGHTARG = %s, FUNCTION = public.%I)',
                    v_name, v_types[1], v_types[2], 'operator ' || v_name);
            END IF;
        EXCEPTION WHEN OTHERS THEN
            NULL; -- There is no such one.
        END;
    END LOOP;
END
$plant$
"""
SHAPE = "'SRID=4326;POLYGON((0 0,1 0,1 1,0 1,0 0))'"
OPS = "CREATE TABLE conflictdb_editor.ops (id integer PRIMARY KEY, shape public.geometry)"
ATTACH = """SELECT conflictdb.attach('s', 'area', 'conflictdb_editor.ops', '{"key": "id", "footprint": "shape"}')"""
# All statements that an editor may run, and so all routines that run as the owner.
STATEMENTS = [
    "SELECT conflictdb.create_scene('s')",
    f"SELECT conflictdb.put_area('s', 'A', {SHAPE})",
    """SELECT conflictdb.put_track('s', 'T', 'SRID=4326;LINESTRING M (0 0 0, 1 1 3600)',
                                   conflictdb.rectangle_outline(9, 9, 9, 9))""",
    f"SELECT conflictdb.put_area('s', 'A', ST_Translate({SHAPE}, 1, 0))",
    "UPDATE conflictdb.area SET key = 'B', floor_m = 3",
    "UPDATE conflictdb.track SET key = 'U'",
    "UPDATE conflictdb.scene SET tolerance_m = 3",
    "SELECT conflictdb.request_detection('s', true)",
    "SELECT conflictdb.share_scene('s', 'conflictdb_worker', 'write')",
    "SELECT conflictdb.unshare_scene('s', 'conflictdb_worker')",
    "SELECT * FROM conflictdb.scenes",
    "SELECT * FROM conflictdb.queue",
    "SELECT * FROM conflictdb_internal._scene_holders(1)",
    "CREATE SCHEMA AUTHORIZATION conflictdb_editor",
    OPS,
    ATTACH,
    f"INSERT INTO conflictdb_editor.ops VALUES (1, {SHAPE})",
    "UPDATE conflictdb_editor.ops SET id = 2",
    "DELETE FROM conflictdb_editor.ops",
    "SELECT conflictdb.detach('s', 'conflictdb_editor.ops')",
    "SELECT conflictdb.remove_object('s', 'B')",
    "DELETE FROM conflictdb.track",
    "DELETE FROM conflictdb.scene",
]


def called_names(conn: Conn) -> list[str]:
    """Return the functions and operators of PostgreSQL that our routines call by name when they run."""
    code = "\n".join(
        re.sub("--.*", "", source)
        for (source,) in conn.execute(
            """SELECT p.prosrc FROM pg_proc p JOIN pg_language l ON l.oid = p.prolang
               WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
                     AND l.lanname = 'plpgsql'"""
        )
    )
    words = set(re.findall(r"(?<![\w.])(\w+)\(", code)) | set(re.findall(r"[-+*/<>=~!@#%^&|?]+", code))
    known = conn.execute(
        """SELECT p.proname FROM pg_proc p
           WHERE p.pronamespace = 'pg_catalog'::regnamespace AND p.prokind = 'f' AND p.proname = ANY (%(words)s)
           UNION SELECT o.oprname FROM pg_operator o
           WHERE o.oprnamespace = 'pg_catalog'::regnamespace AND o.oprname = ANY (%(words)s)""",
        {"words": list(words)},
    )
    return sorted(name for (name,) in known)


@pytest.fixture
def caught(conn: Conn) -> set[tuple[str, str]]:
    """Plant all of them in public, next to PostGIS, where users may create; return those that ran, and as whom."""
    found: set[tuple[str, str]] = set()

    def look(diag: psycopg.errors.Diagnostic) -> None:
        found.update(re.findall("^planted (.+): (.+)$", diag.message_primary or ""))

    names = called_names(conn)
    assert {"format", "concat", "=", "||", "@>", "unnest", "lower"} - set(names) <= {"concat", "@>"}
    conn.execute("GRANT CREATE ON SCHEMA public TO PUBLIC")
    conn.execute("SET LOCAL client_min_messages = error")
    conn.execute(sql.SQL("SET LOCAL ROLE {}").format(sql.Identifier(PLANTER)))
    conn.execute("SET LOCAL search_path = pg_catalog, pg_temp")
    conn.execute(sql.SQL(PLANT).format(names=sql.Literal(names), types=sql.Literal(TYPES)).as_bytes(conn))
    conn.commit()
    (planted,) = conn.execute("SELECT count(*) FROM pg_proc WHERE prosrc LIKE '%RAISE WARNING ''planted%'").fetchall()
    assert planted[0] > 1000
    conn.commit()
    conn.autocommit = True
    conn.add_notice_handler(look)
    return found


def test_what_runs_as_another_role_runs_nothing_that_a_user_planted(conn: Conn, caught: set[tuple[str, str]]) -> None:
    """Not even in the schema of PostGIS, where routines that run as their caller look."""
    (name,) = conn.execute("SELECT current_database()").fetchall()[0]
    conn.execute(sql.SQL("GRANT CREATE ON DATABASE {} TO {}").format(sql.Identifier(name), sql.Identifier(PLANTER)))
    conn.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(PLANTER)))
    for statement in STATEMENTS:
        conn.execute(statement.encode())
    assert ("format", PLANTER) in caught, "they are found at all"
    assert {role for _, role in caught} == {PLANTER}


def test_programs_look_at_a_schema_and_run_nothing_that_a_user_planted(
    conn: Conn, caught: set[tuple[str, str]]
) -> None:
    """The first statements of every command, also those of an administrator."""
    schema.check(conn)
    assert schema.missing_grants(conn) is None
    assert schema._holders(conn) == ""
    store.require_writable(conn)
    store.require_detecting(conn)
    assert connection._missing_grant(conn, psycopg.errors.InsufficientPrivilege(), "_take_scene") is None
    assert store.service(conn).worker_count == 0
    assert caught == set()


# A trigger of a user's own on a function of ours, without the transition tables that this takes for there.
BORROWED = """
CREATE TABLE conflictdb_editor.mine (id integer);
CREATE FUNCTION conflictdb_editor.spy() RETURNS integer LANGUAGE plpgsql VOLATILE AS
    $$ BEGIN RAISE WARNING 'planted view: %', current_user; RETURN 1; END $$;
CREATE TEMPORARY VIEW new_rows AS SELECT conflictdb_editor.spy() AS id;
CREATE TEMPORARY VIEW old_rows AS SELECT conflictdb_editor.spy() AS id;
"""


@pytest.mark.parametrize(
    ("event", "declared"),
    [
        *(("INSERT", ""), ("INSERT", "new"), ("DELETE", ""), ("DELETE", "old")),
        *(("UPDATE", ""), ("UPDATE", "new"), ("UPDATE", "old")),
    ],
)
def test_a_view_does_not_pass_for_a_transition_table(conn: Conn, event: str, declared: str) -> None:
    """Editors may make triggers of the function that notes changes of an attached table, which runs as its owner."""
    caught: list[str] = []
    conn.add_notice_handler(lambda diag: caught.append(diag.message_primary or ""))
    conn.execute("CREATE SCHEMA AUTHORIZATION conflictdb_editor")
    conn.execute("SET ROLE conflictdb_editor")
    for statement in (STATEMENTS[0], OPS, ATTACH):
        conn.execute(statement.encode())
    (number,) = conn.execute("SELECT attachment_id FROM conflictdb.attachment").fetchall()[0]
    conn.execute(BORROWED.encode())
    conn.execute("INSERT INTO conflictdb_editor.mine VALUES (1)")
    tables = f"REFERENCING {declared} TABLE AS {declared}_rows" if declared else ""
    conn.execute(
        f"CREATE TRIGGER mine AFTER {event} ON conflictdb_editor.mine {tables} FOR EACH STATEMENT "
        f"EXECUTE FUNCTION conflictdb_internal._note_{number}()".encode()
    )
    changes = {"INSERT": "INSERT INTO {} VALUES (2)", "UPDATE": "UPDATE {} SET id = 3", "DELETE": "DELETE FROM {}"}
    conn.execute(changes[event].format("conflictdb_editor.mine").encode())
    assert {text for text in caught if text.startswith("planted")} <= {f"planted view: {PLANTER}"}


def test_a_schema_of_attached_tables_that_another_role_made_is_refused(conn: Conn) -> None:
    """That role could replace its functions. The schema is not removed."""
    conn.execute("CREATE SCHEMA conflictdb_attached AUTHORIZATION conflictdb_reader")
    conn.execute("CREATE SCHEMA AUTHORIZATION conflictdb_editor")
    conn.execute("SET ROLE conflictdb_editor")
    conn.execute(STATEMENTS[0].encode())
    conn.execute(OPS.encode())
    rule = "must be role .*, the owner of schema conflictdb; got role conflictdb_reader"
    with pytest.raises(psycopg.Error, match=rule), conn.transaction():
        conn.execute(ATTACH.encode())
    conn.execute("SELECT conflictdb_internal._close_attached_schema()")
    assert conn.execute("SELECT to_regnamespace('conflictdb_attached')::text").fetchone() == ("conflictdb_attached",)
