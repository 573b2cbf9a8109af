"""Names are data: whatever characters they have, they are kept, compared and given back, and never run."""

import json
from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from commands import runner
from psycopg import sql

from conflictdb.cli.codes import DONE
from conflictdb.jobs import detect, follow_attached

Conn = psycopg.Connection[Any]

HARM = "DROP TABLE conflictdb.area"
NAMES = {
    "quotes": f"""'; {HARM}; --""",
    "double quotes": f""""; {HARM}; --""",
    "dollars": f"$$ {HARM} $$ $body$ %1$s",
    "percent": "%s %I %L %% %1$I",
    "backslashes": r"\'; \x41 \\ \n",
    "lines": f"a\n{HARM};\r\n--",
    "right to left": "\u202egnp.\u2066exe\u200f",
    "terminal": "\x1b]0;owned\x07\x1b[2J\x9b31m",
    "braces": '{"a", NULL} ${HOME} `id` \\{0}',
    "case": "MiXed Case é \U0001f6a2",
}
BOX = "SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 1, 0 0))"
# Objects that a role may create in a schema earlier on the path: functions, operators, relations that fit better.
TRAPS = """
CREATE SCHEMA trap;
CREATE TABLE trap.caught (by_role name DEFAULT current_user, what text);
GRANT USAGE ON SCHEMA trap TO PUBLIC;
GRANT INSERT ON trap.caught TO PUBLIC;
CREATE FUNCTION trap.format(text, text) RETURNS text LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO trap.caught (what) VALUES ('format'); RETURN $1; END $$;
CREATE FUNCTION trap.st_npoints(public.geometry) RETURNS integer LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO trap.caught (what) VALUES ('st_npoints'); RETURN 1; END $$;
CREATE FUNCTION trap.st_intersects(public.geometry, public.geometry) RETURNS boolean LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO trap.caught (what) VALUES ('st_intersects'); RETURN false; END $$;
CREATE FUNCTION trap.st_isvalidreason(public.geometry) RETURNS text LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO trap.caught (what) VALUES ('st_isvalidreason'); RETURN 'Valid Geometry'; END $$;
CREATE FUNCTION trap.apart(public.geometry, public.geometry) RETURNS boolean LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO trap.caught (what) VALUES ('&&'); RETURN false; END $$;
CREATE OPERATOR trap.&& (LEFTARG = public.geometry, RIGHTARG = public.geometry, FUNCTION = trap.apart);
CREATE FUNCTION trap.same(text, text) RETURNS boolean LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO trap.caught (what) VALUES ('='); RETURN true; END $$;
CREATE OPERATOR trap.= (LEFTARG = text, RIGHTARG = text, FUNCTION = trap.same);
CREATE FUNCTION trap.same(bigint, bigint) RETURNS boolean LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO trap.caught (what) VALUES ('='); RETURN true; END $$;
CREATE OPERATOR trap.= (LEFTARG = bigint, RIGHTARG = bigint, FUNCTION = trap.same);
CREATE VIEW trap.scene AS SELECT 1 AS scene_id, 'trap' AS name;
CREATE VIEW trap.area AS SELECT 1 AS area_id, 'trap' AS key;
GRANT SELECT ON ALL TABLES IN SCHEMA trap TO PUBLIC;
"""
# Search paths that put schemas even before pg_catalog, as any role may set.
HOSTILE_PATHS = ["trap, pg_catalog, public, conflictdb", "pg_temp, trap, pg_catalog, public", "trap"]


@pytest.fixture(params=NAMES.values(), ids=NAMES.keys())
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def hostile_role(conn: Conn, name: str) -> Iterator[str]:
    """Return the name of an editor's role, as bytes, different in each worker."""
    role = (name[:20] + conn.info.dbname[-20:]).strip()
    conn.execute(sql.SQL("CREATE ROLE {} IN ROLE conflictdb_editor").format(sql.Identifier(role)))
    conn.commit()
    yield role
    conn.rollback()
    conn.execute(sql.SQL("DROP OWNED BY {0} CASCADE; DROP ROLE {0}").format(sql.Identifier(role)))
    conn.commit()


def test_names_of_everything_are_data(conn: Conn, name: str, hostile_role: str) -> None:
    """A scene, its objects, an attached table with its columns, and the role that owns it all."""
    role, table, column = sql.Identifier(hostile_role), sql.Identifier(name), sql.Identifier(name[:30])
    conn.execute("SELECT conflictdb.protect_scenes()")
    conn.execute(sql.SQL("CREATE SCHEMA {} AUTHORIZATION {}").format(table, role))
    conn.execute(sql.SQL("SET ROLE {}").format(role))
    conn.execute("SELECT conflictdb.create_scene(%s)", [name])
    conn.execute("SELECT conflictdb.put_area(%s, %s, %s, p_name => %s)", [name, name, BOX, name])
    conn.execute(
        """SELECT conflictdb.put_track(%s, %s, 'SRID=4326;LINESTRING M (0 0.5 1772323200, 2 0.5 1772409600)',
                                       conflictdb.rectangle_outline(9, 9, 5, 5))""",
        [name, name + "T"],
    )
    conn.execute(sql.SQL("CREATE TABLE {0}.{0} ({1} text, shape public.geometry)").format(table, column))
    # Without parameters, % in a name is not a placeholder.
    rows = sql.SQL("INSERT INTO {0}.{0} VALUES ({1}, {2}), ({3}, 'POINT(1 1)')")
    conn.execute(rows.format(table, *map(sql.Literal, (name + "R", BOX, name))))
    mapped = json.dumps({"key": name[:30], "footprint": "shape"})
    qualified = sql.SQL("{0}.{0}").format(table).as_string(conn)
    conn.execute("SELECT * FROM conflictdb.preview_attachment(%s, 'area', %s, %s)", [name, qualified, mapped])
    conn.execute("SELECT conflictdb.attach(%s, 'area', %s, %s)", [name, qualified, mapped])
    conn.execute("SELECT conflictdb.share_scene(%s, %s, 'write')", [name, hostile_role])
    conn.commit()
    follow_attached.follow(conn, name, again=False)
    conn.execute("RESET ROLE")
    conn.commit()
    assert detect.detect(conn, name, jobs=1).conflicts == 3
    conn.execute(sql.SQL("SET ROLE {}").format(role))
    keys = {(name, name + "R"), (name + "R", name), (name, name + "T"), (name + "R", name + "T")}
    found = conn.execute("SELECT a_key, b_key FROM conflictdb.conflicts WHERE scene = %s", [name]).fetchall()
    assert len(found) == 3
    assert set(found) <= keys
    for query in (
        "SELECT count(*) FROM conflictdb.conflicts_of(%(name)s, %(name)s)",
        "SELECT count(conflictdb.explain_conflict_text(%(name)s, %(name)s, %(track)s))",
        "SELECT count(conflictdb.haven_at(%(name)s, %(track)s, '2026-03-01 12:00Z'))",
        "SELECT count(conflictdb.acknowledge(%(name)s, %(name)s, %(track)s, %(name)s))",
        "SELECT count(*) FROM conflictdb.conflict_history(%(name)s, %(name)s)",
        "SELECT octet_length(conflictdb.tile_areas(0, 0, 0, json_build_object('scene', %(name)s::text)))",
        "SELECT count(*) FROM conflictdb.unmapped WHERE scene = %(name)s AND key = %(name)s",
        "SELECT count(*) FROM conflictdb.attachments WHERE scene = %(name)s AND role = %(role)s",
        "SELECT count(*) FROM conflictdb.shares WHERE scene = %(name)s AND role = %(role)s",
        "SELECT conflictdb.request_detection(%(name)s, true)",
        "SELECT conflictdb.detach(%(name)s, %(table)s)",
        "SELECT conflictdb.remove_object(%(name)s, %(name)s)::integer",
        "SELECT conflictdb.unshare_scene(%(name)s, %(role)s)::integer",
    ):
        values = {"name": name, "track": name + "T", "role": hostile_role, "table": qualified}
        row = conn.execute(query.encode(), values).fetchone()
        assert row is not None, query
        assert row[0] > 0, query
    conn.execute("RESET ROLE")
    assert conn.execute("SELECT count(*) FROM conflictdb.area").fetchone() == (0,)


def test_commands_show_names_and_run_none(dsn: str, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with psycopg.connect(dsn) as conn:
        for key in ("A", "B"):
            conn.execute("SELECT conflictdb.create_scene(%s)", [name])
            conn.execute("SELECT conflictdb.put_area(%s, %s, %s)", [name, key + name, BOX])
    run = runner(dsn, capsys)
    keys = ["A" + name, "B" + name]
    for words in (
        ["detect", "--scene", name],
        ["conflicts", "--scene", name],
        ["explain", *keys, "--scene", name],
        ["history", *keys, "--scene", name],
        ["acknowledge", *keys, "--scene", name, "--reason", name],
        ["admin", "share", "--scene", name],
        ["status"],
    ):
        done = run(*words)
        assert done.code == DONE, (words, done.err)
        assert not {"\x1b", "\x9b", "\x07", "\u202e"} & set(done.out + done.err), words
    assert run("admin", "share", name, "--scene", name).code != DONE
    with psycopg.connect(dsn) as conn:
        assert conn.execute("SELECT count(*) FROM conflictdb.area").fetchone() == (2,)


@pytest.mark.parametrize("path", HOSTILE_PATHS)
def test_a_hostile_search_path_changes_nothing(conn: Conn, path: str) -> None:
    """For a superuser, who would run any planted function, and for an editor."""
    conn.execute(TRAPS.encode())
    conn.execute("CREATE TEMPORARY VIEW change AS SELECT 1 AS scene_id; SET search_path = public")
    conn.commit()
    for role in ("postgres", "conflictdb_editor"):
        name = f"s of {role}"
        if role != "postgres":
            conn.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(role)))
        conn.execute(sql.SQL("SELECT set_config('search_path', {}, false)").format(sql.Literal(path)))
        conn.execute("SELECT conflictdb.create_scene(%s)", [name])
        for key in ("A", "B"):
            conn.execute("SELECT conflictdb.put_area(%s, %s, conflictdb_internal._wrapped(%s))", [name, key, BOX])
        with pytest.raises(psycopg.Error, match="valid"), conn.transaction():
            conn.execute("SELECT conflictdb.put_area(%s, 'C', %s)", [name, BOX.replace("1 1, 0 1", "0 1, 1 1")])
        conn.execute("SELECT conflictdb.request_detection(%s, true)", [name])
        conn.execute("SELECT conflictdb.remove_object(%s, 'none')", [name])
        conn.execute("RESET ROLE")
        conn.commit()
        detect.detect(conn, name, jobs=1)
        if role != "postgres":
            conn.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(role)))
        for query, rows in (
            ("SELECT count(*) FROM conflictdb.conflicts_within(%s, 'SRID=4326;POINT(0.5 0.5)', '(,)')", 1),
            ("SELECT count(*) FROM conflictdb.candidates(%s)", 1),
            ("SELECT count(*) FROM conflictdb.probe(%s, 'SRID=4326;POINT(0.5 0.5)')", 2),
            ("SELECT count(conflictdb.acknowledge(%s, 'A', 'B', 'seen'))", 1),
            ("SELECT count(conflictdb.explain_conflict_text(%s, 'A', 'B'))", 1),
        ):
            assert conn.execute(query.encode(), [name]).fetchone() == (rows,), query
        conn.execute("RESET ROLE; RESET search_path")
        conn.commit()
    assert conn.execute("SELECT by_role, what FROM trap.caught").fetchall() == []
