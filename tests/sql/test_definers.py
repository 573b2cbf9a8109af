"""Functions that run with their owner's rights find no name that a user could have put there."""

import re
from pathlib import Path
from typing import Any

import psycopg
import pytest

Conn = psycopg.Connection[Any]
ROOT = Path(__file__).resolve().parents[2]
ONLY_OURS = ["search_path=conflictdb, conflictdb_internal, pg_temp"]
# A function that fits better than that of pg_catalog, which takes any type: its owner sees the callers.
TRAPS = """
GRANT CREATE ON SCHEMA public TO PUBLIC;
CREATE TABLE public.caught (by_role name);
GRANT INSERT ON public.caught TO PUBLIC;
SET ROLE conflictdb_editor;
CREATE FUNCTION public.format(text, bigint) RETURNS text LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO public.caught VALUES (current_user); RETURN pg_catalog.format($1, VARIADIC ARRAY[$2]); END $$;
CREATE FUNCTION public.format(text, text) RETURNS text LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO public.caught VALUES (current_user); RETURN pg_catalog.format($1, VARIADIC ARRAY[$2]); END $$;
CREATE FUNCTION public.format(text, text, text) RETURNS text LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO public.caught VALUES (current_user); RETURN pg_catalog.format($1, VARIADIC ARRAY[$2, $3]);
    END $$;
CREATE FUNCTION public.to_jsonb(conflictdb.scene) RETURNS jsonb LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO public.caught VALUES (current_user); RETURN pg_catalog.to_jsonb($1); END $$;
CREATE FUNCTION public.more(float8, integer) RETURNS boolean LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO public.caught VALUES (current_user); RETURN $1 >= $2::float8; END $$;
CREATE OPERATOR public.>= (LEFTARG = float8, RIGHTARG = integer, FUNCTION = public.more);
CREATE FUNCTION public.format(text, text, text, text) RETURNS text LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO public.caught VALUES (current_user); RETURN pg_catalog.format($1, VARIADIC ARRAY[$2, $3, $4]);
    END $$;
"""


def test_all_that_they_call_finds_only_what_is_ours(conn: Conn) -> None:
    """Functions in SQL are bound to their callees at creation; the others look names up when they run."""
    ours = """SELECT p.proname, p.prosecdef, p.proconfig, p.prosrc
              FROM pg_proc p JOIN pg_language l ON l.oid = p.prolang
              WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
                    AND l.lanname = 'plpgsql'"""
    functions = {name: (definer, path, code) for name, definer, path, code in conn.execute(ours.encode())}
    waiting = [name for name, (definer, *_) in functions.items() if definer]
    assert "_after_object_change" in waiting
    seen: set[str] = set()
    while waiting:
        name = waiting.pop()
        seen.add(name)
        _, path, code = functions[name]
        assert path[:1] == ONLY_OURS, name
        called = re.findall(r"(?<!')\b(\w+)\(", code)  # except names in hints
        waiting += [other for other in called if other in functions and other not in seen]
    assert "_raise" in seen


def test_nobody_else_can_put_a_name_there(conn: Conn) -> None:
    may = """SELECT r.rolname FROM pg_roles r WHERE has_schema_privilege(r.oid, 'conflictdb', 'CREATE')
             AND NOT r.rolsuper AND r.rolname LIKE 'conflictdb%'"""
    assert conn.execute(may.encode()).fetchall() == []


@pytest.mark.parametrize(
    "statement",
    [
        "SELECT conflictdb_internal._close_attached_schema()",
        "SELECT conflictdb.request_detection('s', true)",
        "SELECT conflictdb.put_area('s', 'A', 'SRID=4326;POLYGON((0 0, 0 1, 1 1, 1 0, 0 0))')",
        "SELECT conflictdb.remove_object('s', 'B')",
        # Branches follow their parents: triggers of the owner's rows run as the owner.
        "SELECT conflictdb.create_scene('s', p_separation_m => 5)",
        "SELECT conflictdb.create_scene('s', p_motion => 'great_circle')",
        "SELECT conflictdb.put_rule('s', 'ferry', 'tug', 500)",
        "SELECT conflictdb.remove_scene('s')",
    ],
)
def test_a_function_of_a_user_is_not_called_as_the_owner(conn: Conn, statement: str) -> None:
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.execute("SELECT conflictdb.put_area('s', 'B', 'SRID=4326;POLYGON((0 0, 0 1, 1 1, 1 0, 0 0))')")
    conn.execute("SELECT conflictdb.create_branch('s', 'b')")
    conn.execute(TRAPS.encode())
    conn.execute(statement.encode())
    conn.execute("RESET ROLE")
    caught = {role for (role,) in conn.execute("SELECT by_role FROM public.caught")}
    assert caught <= {"conflictdb_editor"}


def test_a_worker_makes_no_trigger_of_ours(conn: Conn) -> None:
    """It would run as its owner on rows that the worker made up."""
    conn.execute("GRANT CREATE ON SCHEMA public TO conflictdb_worker")
    conn.execute("SET ROLE conflictdb_worker")
    conn.execute("CREATE TABLE public.mine (scene_id bigint, key text, area_id bigint, version bigint)")
    with pytest.raises(psycopg.errors.InsufficientPrivilege):
        conn.execute(
            """CREATE TRIGGER mine AFTER DELETE ON public.mine REFERENCING OLD TABLE AS old_rows FOR EACH STATEMENT
               EXECUTE FUNCTION conflictdb_internal._after_object_change(0, area_id)"""
        )


def test_each_routine_that_runs_as_its_owner_says_what_restricts_it(conn: Conn) -> None:
    """These comments make the table in docs/reference/sql.md; a missing comment fails here."""
    query = """SELECT p.proname, obj_description(p.oid, 'pg_proc') FROM pg_proc p
               WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND p.prosecdef"""
    found = dict(conn.execute(query.encode()).fetchall())
    assert len(found) > 10
    assert [name for name, said in found.items() if "Restricted to " not in (said or "")] == []
    page = (ROOT / "docs/reference/sql.md").read_text()
    section = page.partition("## Routines that run as their owner")[2].partition("\n## ")[0]
    assert set(re.findall(r"^\| `(\w+)`", section, re.MULTILINE)) == set(found)
