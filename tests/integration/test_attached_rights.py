"""Only sessions of the role that attached a table read it; nobody else runs that role's code."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import psycopg
import pytest
from psycopg import sql
from psycopg.types.json import Jsonb

from conflictdb import connect, store
from conflictdb.errors import InvalidInput, StoreError
from conflictdb.jobs import detect, follow_attached

Conn = psycopg.Connection[Any]

MAP = {"key": "id", "footprint": "shape"}
AREA = "'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))'"


@pytest.fixture
def roles(conn: Conn) -> Iterator[dict[str, str]]:
    """Return the names of four roles: planner (an editor), writer, keeper (a worker), and another editor."""
    names = {role: f"{role}_{conn.info.dbname}" for role in ("planner", "writer", "keeper", "other")}
    groups = {"planner": "editor", "keeper": "worker", "other": "editor"}
    for role, name in names.items():
        conn.execute(sql.SQL("CREATE ROLE {} NOLOGIN").format(sql.Identifier(name)))
        if role in groups:
            group = sql.Identifier(f"conflictdb_{groups[role]}")
            conn.execute(sql.SQL("GRANT {} TO {}").format(group, sql.Identifier(name)))
    conn.execute(sql.SQL("CREATE SCHEMA mission AUTHORIZATION {}").format(sql.Identifier(names["planner"])))
    conn.execute(sql.SQL("GRANT USAGE ON SCHEMA mission TO {}").format(sql.Identifier(names["writer"])))
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.commit()
    with acting(conn, names["planner"]):
        conn.execute("CREATE TABLE mission.ops (id integer, shape geometry)")
        conn.execute(f"INSERT INTO mission.ops VALUES (1, {AREA})")
        conn.execute(sql.SQL("GRANT ALL ON mission.ops TO {}").format(sql.Identifier(names["writer"])))
    yield names
    conn.rollback()
    conn.execute("RESET ROLE")
    everybody = sql.SQL(", ").join(map(sql.Identifier, names.values()))
    conn.execute(sql.SQL("DROP OWNED BY {} CASCADE").format(everybody))
    conn.execute(sql.SQL("DROP ROLE {}").format(everybody))
    conn.commit()


@contextmanager
def acting(conn: Conn, role: str) -> Iterator[None]:
    """Work as a role, in transactions of its own."""
    conn.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(role)))
    conn.commit()
    yield
    conn.commit()
    conn.execute("RESET ROLE")
    conn.commit()


def follow(conn: Conn, role: str, read_within_s: float = 600.0) -> None:
    with acting(conn, role):
        follow_attached.follow(conn, "s", again=True, read_within_s=read_within_s)


def keys(conn: Conn) -> list[str]:
    with conn.transaction():
        return [key for (key,) in conn.execute("SELECT key FROM conflictdb.area ORDER BY key").fetchall()]


def test_each_role_needs_no_more_than_its_own(conn: Conn, roles: dict[str, str]) -> None:
    """The writer needs no right here, the keeper none on the table, and the planner none to create here."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.scene("s").attach("area", "mission.ops", MAP)
    with acting(conn, roles["writer"]):
        conn.execute(f"INSERT INTO mission.ops VALUES (2, {AREA})")
        conn.execute("UPDATE mission.ops SET id = 3 WHERE id = 1")
    follow(conn, roles["planner"])
    assert keys(conn) == ["2", "3"]
    with acting(conn, roles["keeper"]):
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            conn.execute("SELECT FROM mission.ops")
        conn.rollback()
    with acting(conn, roles["planner"]):
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            conn.execute("CREATE FUNCTION conflictdb.mine() RETURNS int LANGUAGE sql AS 'SELECT 1'")
        conn.rollback()
        with connect(conn) as db:
            assert db.scene("s").detach("mission.ops") == 2
    assert conn.execute("SELECT to_regnamespace('conflictdb_attached') IS NULL").fetchone() == (True,)


@pytest.mark.parametrize("role", ["keeper", "other", None])
def test_other_roles_pass_a_table_over_and_say_so(conn: Conn, roles: dict[str, str], role: str | None) -> None:
    """A worker, another editor, a superuser: the scene is not current until its role has followed the table."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.scene("s").attach("area", "mission.ops", MAP)
    name = roles[role] if role else str(conn.info.user)
    follow(conn, name)
    assert keys(conn) == []
    if role != "other":
        with acting(conn, name):
            assert detect.detect(conn, "s", jobs=1).conflicts == 0
            assert store.waiting_scenes(conn) == {}, "nothing that it could do"
    with conn.transaction():
        state = store.scene_state(conn, "s")
    assert not state.is_current
    assert f"changes wait for role {roles['planner']}" in str(state.remark)
    follow(conn, roles["planner"])
    assert keys(conn) == ["1"]
    with acting(conn, roles["keeper"]):
        detect.detect(conn, "s", jobs=1)
        assert store.scene_state(conn, "s").is_current


def test_tables_of_others_are_refused(conn: Conn, roles: dict[str, str]) -> None:
    """Functions of a view, of row-level security and of indexes would run with the reader's rights."""
    with acting(conn, roles["other"]), connect(conn) as db, pytest.raises(StoreError, match="schema mission"):
        db.scene("s").attach("area", "mission.ops", MAP)
    with acting(conn, roles["planner"]):
        conn.execute(sql.SQL("GRANT USAGE ON SCHEMA mission TO {}").format(sql.Identifier(roles["other"])))
    with acting(conn, roles["other"]), connect(conn) as db, pytest.raises(InvalidInput, match="cannot be read by role"):
        db.scene("s").attach("area", "mission.ops", MAP)
    with acting(conn, roles["planner"]):
        conn.execute("CREATE VIEW mission.seen AS SELECT * FROM mission.ops")
        grant = sql.SQL("GRANT SELECT ON mission.ops, mission.seen TO {}")
        conn.execute(grant.format(sql.Identifier(roles["other"])))
    with acting(conn, roles["other"]), connect(conn) as db:
        for table, every_s in (("mission.ops", None), ("mission.ops", 60.0), ("mission.seen", None)):
            with pytest.raises(InvalidInput, match="must belong to the role that attaches it"):
                db.scene("s").attach("area", table, MAP, every_s=every_s)
    # A superuser could run code as any role: its views are as safe as one's own.
    conn.execute("CREATE SCHEMA shared; CREATE VIEW shared.seen AS SELECT * FROM mission.ops")
    conn.execute("GRANT USAGE ON SCHEMA shared TO PUBLIC; GRANT SELECT ON shared.seen TO PUBLIC")
    conn.commit()
    with acting(conn, roles["other"]), connect(conn) as db:
        db.scene("s").attach("area", "shared.seen", MAP)
    follow(conn, roles["other"])
    assert keys(conn) == ["1"]
    # Rights that are taken away are gone here too.
    conn.execute("REVOKE SELECT ON shared.seen FROM PUBLIC")
    conn.execute("UPDATE conflictdb.attachment SET compared_at = compared_at - interval '1 hour'")
    conn.commit()
    follow(conn, roles["other"])
    with connect(conn) as db:
        (one,) = db.attachments()
    assert "permission denied for view seen" in str(one.error)
    assert "was compared last" in str(one.remark)
    assert keys(conn) == ["1"]


def test_row_level_security_that_hides_rows_is_refused(conn: Conn, roles: dict[str, str]) -> None:
    """Also when it comes later: rows that are hidden are not gone."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.scene("s").attach("area", "mission.ops", MAP)
    follow(conn, roles["planner"])
    with acting(conn, roles["planner"]):
        conn.execute("ALTER TABLE mission.ops ENABLE ROW LEVEL SECURITY")
        conn.execute("UPDATE mission.ops SET id = 2")
    follow(conn, roles["planner"])
    assert keys(conn) == ["2"], "its owner sees all"
    with acting(conn, roles["planner"]):
        conn.execute("ALTER TABLE mission.ops FORCE ROW LEVEL SECURITY")
        conn.execute("TRUNCATE mission.ops")
    follow(conn, roles["planner"])
    with connect(conn) as db:
        assert "would be affected by row-level security" in str(db.attachments()[0].error)
    assert keys(conn) == ["2"]
    with acting(conn, roles["planner"]), connect(conn) as db, pytest.raises(InvalidInput, match="hides rows from role"):
        db.scene("s").attach("area", "mission.ops", MAP)


def test_a_table_that_has_another_owner_can_be_detached(conn: Conn, roles: dict[str, str]) -> None:
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.scene("s").attach("area", "mission.ops", MAP)
        conn.execute(sql.SQL("GRANT USAGE ON SCHEMA mission TO {}").format(sql.Identifier(roles["other"])))
    conn.execute(sql.SQL("ALTER TABLE mission.ops OWNER TO {}").format(sql.Identifier(roles["other"])))
    conn.commit()
    with acting(conn, roles["other"]), connect(conn) as db:
        db.scene("s").detach("mission.ops")
    left = "SELECT count(*) FROM pg_trigger WHERE tgrelid = 'mission.ops'::regclass"
    assert conn.execute(left.encode()).fetchone() == (0,)


@pytest.mark.parametrize(
    "table", ["pg_temp.mine", "conflictdb.area", "pg_catalog.pg_class", "mission.ops_id", "public.spatial_ref_sys_pkey"]
)
def test_what_is_no_table_of_a_mission_is_refused(conn: Conn, table: str) -> None:
    conn.execute("CREATE SCHEMA mission; CREATE SEQUENCE mission.ops_id")
    conn.execute("CREATE TEMPORARY TABLE mine (id integer, shape geometry)")
    conn.execute("SELECT conflictdb.create_scene('s')")
    conn.commit()
    with connect(conn) as db, pytest.raises(InvalidInput, match=r"table: (is|must be)"):
        db.scene("s").attach("area", table, MAP)


# Ways to have code of the planner run when the attached relation is read: each notes as whom it ran.
EVIL = """
CREATE TABLE mission.caught (by_role name, by_session name);
GRANT INSERT, SELECT ON mission.caught TO PUBLIC; GRANT USAGE ON SCHEMA mission TO PUBLIC;
CREATE FUNCTION mission.evil() RETURNS boolean LANGUAGE plpgsql AS
    $$ BEGIN INSERT INTO mission.caught VALUES (current_user, session_user); RETURN true;
       EXCEPTION WHEN read_only_sql_transaction THEN RETURN true; END $$;
CREATE FUNCTION mission.evil_text(text) RETURNS text LANGUAGE plpgsql IMMUTABLE AS
    $$ BEGIN PERFORM mission.evil(); RETURN $1; END $$;
"""
WAYS = {
    "function that reads": """
        CREATE OR REPLACE FUNCTION conflictdb_attached.rows_{n}(text[], text) RETURNS SETOF conflictdb.attached_plan
        LANGUAGE plpgsql VOLATILE AS $$ BEGIN PERFORM mission.evil(); RETURN; END $$""",
    "function that reads, as its owner": """
        CREATE OR REPLACE FUNCTION conflictdb_attached.rows_{n}(text[], text) RETURNS SETOF conflictdb.attached_plan
        LANGUAGE plpgsql VOLATILE SECURITY DEFINER AS $$ BEGIN PERFORM mission.evil(); RETURN; END $$""",
    "view": """
        ALTER TABLE mission.ops RENAME TO hidden;
        CREATE VIEW mission.ops AS SELECT id, shape FROM mission.hidden WHERE mission.evil()""",
    "cast": """
        CREATE TYPE mission.mood AS (word text);
        CREATE FUNCTION mission.as_text(mission.mood) RETURNS text LANGUAGE sql AS 'SELECT mission.evil()::text';
        CREATE CAST (mission.mood AS text) WITH FUNCTION mission.as_text(mission.mood) AS IMPLICIT;
        ALTER TABLE mission.ops ALTER COLUMN id TYPE mission.mood USING ROW(id::text)::mission.mood""",
    "operator": """
        CREATE OPERATOR mission.= (LEFTARG = integer, RIGHTARG = integer, FUNCTION = mission.evil_equal);
        ALTER ROLE {planner} SET search_path = mission, pg_catalog""",
    "column default": """
        ALTER TABLE mission.ops ADD COLUMN note text DEFAULT mission.evil_text('x');
        INSERT INTO mission.ops (id, shape) SELECT 7, shape FROM mission.ops LIMIT 1""",
    "domain check": """
        CREATE DOMAIN mission.number AS integer CHECK (mission.evil_text(VALUE::text) IS NOT NULL);
        ALTER TABLE mission.ops ALTER COLUMN id TYPE mission.number""",
    "index expression": "CREATE INDEX ON mission.ops ((mission.evil_text('const') || id))",
    "row-security policy": """
        CREATE POLICY evil ON mission.ops USING (mission.evil());
        ALTER TABLE mission.ops ENABLE ROW LEVEL SECURITY""",
    "trigger": """
        CREATE FUNCTION mission.spring() RETURNS trigger LANGUAGE plpgsql AS
            $$ BEGIN PERFORM mission.evil(); RETURN NULL; END $$;
        CREATE TRIGGER spring AFTER INSERT OR UPDATE ON mission.ops
            FOR EACH STATEMENT EXECUTE FUNCTION mission.spring();
        UPDATE mission.ops SET id = id""",
}


@pytest.mark.parametrize("way", WAYS)
def test_code_of_who_attached_runs_as_nobody_else(conn: Conn, roles: dict[str, str], way: str) -> None:
    """Whatever the planner makes of the table, the worker and the superuser never run it."""
    planner = roles["planner"]
    with acting(conn, planner), connect(conn) as db:
        number = db.scene("s").attach("area", "mission.ops", MAP)
    follow(conn, planner)
    with acting(conn, planner):
        conn.execute(EVIL)
        conn.execute(
            """CREATE FUNCTION mission.evil_equal(integer, integer) RETURNS boolean LANGUAGE sql AS
               'SELECT mission.evil() AND $1 OPERATOR(pg_catalog.=) $2'"""
        )
    conn.execute(WAYS[way].format(n=number, planner=planner).encode()) if way == "operator" else None
    conn.commit()
    if way != "operator":
        with acting(conn, planner):
            conn.execute(WAYS[way].format(n=number).encode())
    conn.execute("UPDATE conflictdb.attachment SET compared_at = NULL")
    conn.execute("DELETE FROM mission.caught")
    conn.commit()
    superuser = str(conn.info.user)
    for role in (roles["keeper"], superuser):
        with acting(conn, role):
            follow_attached.follow(conn, "s", again=True)
            detect.detect(conn, "s", jobs=1)
            detect.detect_pending(conn, "s", jobs=1)
            conn.execute("SELECT * FROM conflictdb.attachments; SELECT * FROM conflictdb.scenes")
            conn.execute("SELECT * FROM conflictdb.follow_attached('s')")
    assert conn.execute("SELECT DISTINCT by_role FROM mission.caught").fetchall() == []
    follow(conn, planner)
    caught = {role for (role,) in conn.execute("SELECT DISTINCT by_role FROM mission.caught")}
    assert caught <= {planner}


# The table's column, a value of it, and what is stored of it.
PLANS = {
    "activations": ("area", "tstzmultirange", "{[2026-03-01 06:00Z, 2026-03-01 07:00Z)}", "upper(activations)::text"),
    "schedule of areas": ("area", "jsonb", '{"days": ["TUE"], "timezone": "UTC"}', "schedule ->> 'timezone'"),
    "departures": ("track", "timestamptz[]", "{2026-03-01 06:00Z, 2026-03-02 06:00Z}", "cardinality(departures)"),
    "schedule of tracks": (
        "track", "jsonb", '{"days": ["TUE"], "timezone": "UTC", "periods": [["06:00", "07:00"]]}',
        "schedule ->> 'timezone'"),
    "tolerances": ("track", "jsonb", '{"xtd_port_m": 50}', "tolerances ->> 'xtd_port_m'"),
}  # fmt: skip


@pytest.mark.parametrize("way", ["function", "domain"])
@pytest.mark.parametrize("plan", PLANS)
def test_plans_of_rows_are_computed_by_the_role_that_attached(
    conn: Conn, roles: dict[str, str], plan: str, way: str
) -> None:
    """Expressions and types of the table's owner run in its own sessions; schedules are expanded by everybody."""
    kind, type_, value, stored = PLANS[plan]
    planner = roles["planner"]
    field, path = plan.split()[0], "ST_MakeLine(ST_MakePointM(0, 0, 1772344800), ST_MakePointM(0, 1, 1772352000))"
    where = (
        {"footprint": "shape"} if kind == "area" else {"path": "way", "outline": "ST_MakeEnvelope(-50, -50, 50, 50)"}
    )
    with acting(conn, planner):
        conn.execute(EVIL)
        conn.execute(
            f"""CREATE FUNCTION mission.evil_plan({type_}) RETURNS {type_} LANGUAGE plpgsql IMMUTABLE AS
                    $$ BEGIN PERFORM mission.evil(); RETURN $1; END $$;
                CREATE DOMAIN mission.plan AS {type_} CHECK (mission.evil());
                ALTER TABLE mission.ops ADD plan {type_}, ADD way geometry;
                UPDATE mission.ops SET plan = '{value}', way = ST_SetSRID({path}, 4326)""".encode()
        )
        given = "mission.evil_plan(plan)" if way == "function" else f"plan::mission.plan::{type_}"
        with connect(conn) as db:
            db.scene("s").attach(kind, "mission.ops", {"key": "id", **where, field: given})
    conn.execute("DELETE FROM mission.caught")
    conn.commit()
    for role in (roles["keeper"], str(conn.info.user)):
        with acting(conn, role):
            follow_attached.follow(conn, "s", again=True)
            detect.detect(conn, "s", jobs=1)
    assert conn.execute("SELECT DISTINCT by_role FROM mission.caught").fetchall() == []
    assert conn.execute(f"SELECT count(*) FROM conflictdb.{kind}".encode()).fetchone() == (0,)
    follow(conn, planner)
    caught = {role for (role,) in conn.execute("SELECT DISTINCT by_role FROM mission.caught")}
    assert caught <= {planner}
    ((found,),) = conn.execute(f"SELECT {stored} FROM conflictdb.{kind}".encode()).fetchall()
    assert found is not None
    with acting(conn, roles["keeper"]):
        detect.detect(conn, "s", jobs=1)
        assert store.scene_state(conn, "s").is_current
    assert {role for (role,) in conn.execute("SELECT DISTINCT by_role FROM mission.caught")} <= {planner}


def test_a_planted_function_of_another_role_is_not_run(conn: Conn, roles: dict[str, str]) -> None:
    """An editor may create functions next to the reading functions: only the caller's own function is called."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.scene("s").attach("area", "mission.ops", MAP)
        conn.execute(EVIL)
        conn.execute(f"DROP FUNCTION conflictdb_attached.rows_{number}(text[], text)".encode())
    with acting(conn, roles["other"]):
        conn.execute(WAYS["function that reads"].format(n=number).encode())
    follow(conn, roles["planner"])
    assert conn.execute("SELECT count(*) FROM mission.caught").fetchone() == (0,)


def test_a_function_that_seems_to_fit_better_is_not_run(conn: Conn, roles: dict[str, str]) -> None:
    """Calls name the types of the function that reads, so that no overload of another editor is taken for it."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.scene("s").attach("area", "mission.ops", MAP)
        conn.execute(EVIL)
    with acting(conn, roles["other"]):
        for types in ("text, text", "text[], character varying", "anyarray, text", "name[], name"):
            overload = WAYS["function that reads"].format(n=number).replace("text[], text", types)
            conn.execute(overload.encode())
    follow(conn, roles["planner"])
    assert keys(conn) == ["1"]
    conn.execute("UPDATE conflictdb.attachment SET compared_at = NULL")
    conn.commit()
    follow(conn, roles["planner"])
    assert conn.execute("SELECT count(*) FROM mission.caught").fetchone() == (0,)


def test_triggers_of_attached_tables_read_no_temporary_view(conn: Conn, roles: dict[str, str]) -> None:
    """They run as the owner of conflictdb; an editor may put them on another table, without transition tables."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.scene("s").attach("area", "mission.ops", MAP)
        conn.execute(EVIL)
        conn.execute("CREATE TABLE mission.bait (id integer)")
        conn.execute(
            f"""CREATE TEMPORARY VIEW new_rows AS SELECT 1 AS id WHERE mission.evil();
                CREATE TEMPORARY VIEW old_rows AS SELECT 1 AS id WHERE mission.evil();
                CREATE TRIGGER bait AFTER INSERT OR UPDATE OR DELETE ON mission.bait FOR EACH STATEMENT
                    EXECUTE FUNCTION conflictdb_internal._note_{number}()""".encode()
        )
        conn.execute("INSERT INTO mission.bait VALUES (1); UPDATE mission.bait SET id = 2; DELETE FROM mission.bait")
    assert conn.execute("SELECT * FROM mission.caught").fetchall() == []


def test_notes_show_no_other_columns(conn: Conn, roles: dict[str, str]) -> None:
    """Attaching fixes the columns that triggers record: another editor cannot add columns."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.scene("s").attach("area", "mission.ops", MAP)
    with acting(conn, roles["other"]):
        for statement in (
            "UPDATE conflictdb.attachment SET identity_columns = '{shape}'",
            "UPDATE conflictdb.attachment SET table_name = 'other'",
            "UPDATE conflictdb.attachment SET map = '{}'",
            f"""INSERT INTO conflictdb.attachment (attachment_id, scene_id, object_kind, table_schema, table_name, map,
                    identity_columns, has_triggers, every) OVERRIDING SYSTEM VALUE
                SELECT {number + 1}, scene_id, 0, 'mission', 'ops', '{{}}', '{{shape}}', true, '1 h'
                FROM conflictdb.scene""",
        ):
            with pytest.raises(psycopg.DatabaseError) as refused:
                conn.execute(statement.encode())
            assert refused.value.sqlstate in ("ZC009", "55000", "42501")
            conn.rollback()


VOYAGES = """
CREATE TABLE mission.fix (voyage text, n integer, at timestamptz, lon float, lat float);
INSERT INTO mission.fix VALUES
    ('E', 1, '2026-03-01 05:00Z', 0, 0), ('E', 2, '2026-03-01 06:00Z', 0.2, 0),
    ('N', 1, '2026-03-01 05:00Z', 0.1, -0.1), ('N', 2, '2026-03-01 06:00Z', 0.1, 0.1),
    ('far', 1, '2026-03-01 05:00Z', 9, 9), ('far', 2, '2026-03-01 06:00Z', 9.1, 9);
"""
VOYAGE_MAP = {
    "key": "voyage",
    "position": "ST_SetSRID(ST_MakePoint(lon, lat), 4326)",
    "time": "at",
    "order": "n",
    **dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"), "100"),
}
TIMES = "SELECT voyage, n, at FROM mission.fix ORDER BY voyage, n"


@pytest.fixture
def proposal(conn: Conn, roles: dict[str, str]) -> int:
    """Return a proposal that moves voyage E of a table that planner, an editor, has attached; scenes are protected."""
    conn.execute("SELECT conflictdb.give_scene('s', %s)", [roles["planner"]])
    conn.execute("SELECT conflictdb.share_scene('s', %s, 'write')", [roles["other"]])
    conn.execute("SELECT conflictdb.protect_scenes()")
    conn.commit()
    with acting(conn, roles["planner"]), connect(conn) as db:
        conn.execute(VOYAGES.encode())
        conn.commit()
        db.scene("s").attach("track", "mission.fix", VOYAGE_MAP)
    follow(conn, roles["planner"])
    with connect(conn) as db:
        db.scene("s").detect()
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.scene("s").resolve(keep=["N", "far"]).proposal_id
    assert number is not None
    return number


def test_an_editor_moves_its_own_rows(conn: Conn, roles: dict[str, str], proposal: int) -> None:
    """To apply a proposal with p_attached needs the rights of an editor and no more, and neither does undoing it."""
    before = conn.execute(TIMES).fetchall()
    conn.commit()
    with acting(conn, roles["planner"]):
        assert conn.execute("SELECT conflictdb.apply_proposal(%s, true)", [proposal]).fetchone() == (1,)
        after = conn.execute(TIMES).fetchall()
        assert {one for one, other in zip(after, before, strict=True) if one != other} == set(after[:2])
        assert conn.execute("SELECT conflictdb.undo_proposal(%s, true)", [proposal]).fetchone() == (1,)
        assert conn.execute(TIMES).fetchall() == before


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE conflictdb.attached_object SET identity = '{x}' WHERE key = 'E'",
        "UPDATE conflictdb.attached_object SET hash = 0",
        "UPDATE conflictdb.attached_object SET object_id = object_id + 1",
        "DELETE FROM conflictdb.attached_object",
        (
            "INSERT INTO conflictdb.attached_object (attachment_id, identity, hash, key, reason) "
            "SELECT attachment_id, '{y}', 0, 'y', 'none' FROM conflictdb.attachment"
        ),
        (
            "INSERT INTO conflictdb.attached_change (attachment_id) SELECT attachment_id FROM conflictdb.attachment;"
            "DELETE FROM conflictdb.attached_change"
        ),
        (
            "INSERT INTO conflictdb.attached_change (attachment_id) SELECT attachment_id FROM conflictdb.attachment;"
            "UPDATE conflictdb.attached_change SET identities = '{}'"
        ),
    ],
)
def test_only_the_attaching_role_writes_what_it_has_read(
    conn: Conn, roles: dict[str, str], proposal: int, statement: str
) -> None:
    """An editor who may change the scene would make a proposal move another row, or changes of rows be missed."""
    with acting(conn, roles["other"]):
        with pytest.raises(psycopg.errors.InsufficientPrivilege, match="alone, which attached the table"):
            conn.execute(statement.encode())
        conn.rollback()


def test_a_proposal_moves_the_track_that_it_names(conn: Conn, roles: dict[str, str], proposal: int) -> None:
    """Its readers see keys, and routines move numbers: another editor cannot give the number of another track."""
    copy = """
        WITH made AS (INSERT INTO conflictdb.proposal
            (scene_id, goal, objective_s, bound_s, is_least, settings, last_version, objects_hash)
            SELECT scene_id, goal, objective_s, bound_s, is_least, settings, last_version, objects_hash
            FROM conflictdb.proposal)
        SELECT 1"""
    move = """
        INSERT INTO conflictdb.proposal_move
            (proposal_id, scene_id, track_id, key, version, planned, path, delay_s, speed, clears, passes, explanation)
        SELECT (SELECT max(proposal_id) FROM conflictdb.proposal), m.scene_id, t.track_id, m.key, t.version, t.path,
               t.path, m.delay_s, 1, m.clears, m.passes, m.explanation
        FROM conflictdb.proposal_move m JOIN conflictdb.track t ON t.key = '{}'"""
    with acting(conn, roles["other"]):
        conn.execute(copy)
        conn.execute(move.format("E").encode())
        with pytest.raises(psycopg.Error, match="name plan 'E', which has another number"):
            conn.execute(move.format("far").encode())
        conn.rollback()


def test_names_of_attachments_cannot_be_taken(conn: Conn, roles: dict[str, str]) -> None:
    """Another editor may create functions in the schema of those that read tables."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        first = db.scene("s").attach("area", "mission.ops", MAP)
    with acting(conn, roles["other"]):
        for number in range(1, 5):
            for arguments in ("text[], text", "text[], text, integer", ""):
                conn.execute(
                    f"CREATE FUNCTION conflictdb_attached.rows_{first + number}({arguments}) "
                    "RETURNS integer LANGUAGE sql AS 'SELECT 1'".encode()
                )
    with acting(conn, roles["planner"]), connect(conn) as db:
        conn.execute("CREATE TABLE mission.more (id integer, shape geometry)")
        conn.commit()
        assert db.scene("s").attach("area", "mission.more", MAP) == first + 1
        # Restricted to the new attachment.
        conn.execute("SELECT conflictdb_internal._free_attached_name(%s)", [first])
        conn.execute("SELECT conflictdb_internal._free_attached_name(%s)", [first + 1])
        conn.execute("SELECT conflictdb_internal._free_attached_name(%s)", [first + 2])
    names = conn.execute(
        "SELECT proname, count(*) FROM pg_proc WHERE pronamespace = 'conflictdb_attached'::regnamespace GROUP BY 1"
    ).fetchall()
    assert dict(names) == {f"rows_{first + number}": 1 if number < 2 else 3 for number in range(5)}


def test_deletes_stay_in_the_scene_of_the_attachment(conn: Conn, roles: dict[str, str]) -> None:
    """An editor who writes numbers of other objects into attached_object changes nothing in other scenes."""
    conn.execute("SELECT conflictdb.create_scene('hers')")
    conn.execute(f"SELECT conflictdb.put_area('hers', 'A', {AREA}), conflictdb.put_area('hers', '1', {AREA})")
    conn.commit()
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.scene("s").attach("area", "mission.ops", MAP)
    follow(conn, roles["planner"])
    with acting(conn, roles["planner"]):
        # Its own row, which then goes; and rows that never were.
        conn.execute(
            """UPDATE conflictdb.attached_object SET object_id = (SELECT area_id FROM conflictdb.area a
               JOIN conflictdb.scene s USING (scene_id) WHERE s.name = 'hers' AND a.key = '1')"""
        )
        conn.execute(
            """INSERT INTO conflictdb.attached_object (attachment_id, identity, hash, key, object_id, version)
               SELECT attachment_id, '{99}', 0, 'A', (SELECT max(area_id) FROM conflictdb.area), 1
               FROM conflictdb.attachment"""
        )
        conn.execute(
            "INSERT INTO conflictdb.attached_change (attachment_id, identities) SELECT attachment_id, '{{99}}' "
            "FROM conflictdb.attachment"
        )
        conn.execute("DELETE FROM mission.ops")
    before = conn.execute(
        "SELECT a.* FROM conflictdb.area a JOIN conflictdb.scene s USING (scene_id) WHERE s.name = 'hers' ORDER BY key"
    ).fetchall()
    conn.execute("UPDATE conflictdb.attachment SET compared_at = NULL")
    conn.commit()
    follow(conn, roles["planner"])
    after = conn.execute(
        "SELECT a.* FROM conflictdb.area a JOIN conflictdb.scene s USING (scene_id) WHERE s.name = 'hers' ORDER BY key"
    ).fetchall()
    assert after == before
    assert len(after) == 2
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.scene("s").detach("mission.ops")
    assert conn.execute("SELECT count(*) FROM conflictdb.area WHERE key IN ('A', '1')").fetchone() == (2,)


def test_a_function_that_does_not_end_is_given_up(conn: Conn, roles: dict[str, str]) -> None:
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.scene("s").attach("area", "mission.ops", MAP)
        conn.execute(WAYS["function that reads"].format(n=number).replace("mission.evil()", "pg_sleep(60)").encode())
    follow(conn, roles["planner"], read_within_s=0.2)
    with connect(conn) as db:
        assert "statement timeout" in str(db.attachments()[0].error)
        assert list(store.waiting_scenes(conn)) == []
        assert not db.scenes()[0].is_current


PLANTED = """
CREATE FUNCTION conflictdb_attached.rows_{n}(text, text) RETURNS SETOF conflictdb.attached_plan LANGUAGE plpgsql AS
    $$ BEGIN PERFORM mission.evil(); RETURN; END $$
"""


def test_a_function_planted_beside_the_one_that_reads_is_not_run(conn: Conn, roles: dict[str, str]) -> None:
    """An untyped literal fits a parameter of type text better than text[]."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.scene("s").attach("area", "mission.ops", MAP)
        conn.execute(EVIL)
    with acting(conn, roles["other"]):
        for n in (number, number + 1, number + 2):
            conn.execute(PLANTED.format(n=n).encode())
    follow(conn, roles["planner"])
    with acting(conn, roles["planner"]), connect(conn) as db:
        conn.execute(f"CREATE TABLE mission.more AS SELECT 'm' || id AS id, {AREA}::geometry AS shape FROM mission.ops")
        conn.execute("SELECT * FROM conflictdb.preview_attachment('s', 'area', 'mission.more', %s)", [Jsonb(MAP)])
        db.scene("s").attach("area", "mission.more", MAP)
        conn.execute("UPDATE conflictdb.attachment SET compared_at = NULL")
    follow(conn, roles["planner"])
    assert conn.execute("SELECT * FROM mission.caught").fetchall() == []
    assert keys(conn) == ["1", "m1"]
    with connect(conn) as db:
        assert {one.role for one in db.attachments()} == {roles["planner"]}


@pytest.mark.parametrize("statement", ["_create_note({n})", "_drop_attachment({n})"])
def test_an_old_snapshot_gives_no_hold_on_a_new_attachment(conn: Conn, roles: dict[str, str], statement: str) -> None:
    """The attachment is not visible to it, but routines that are called by number reach its functions."""
    with psycopg.connect(conn.info.dsn, password=conn.info.password or None) as old:
        old.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        old.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(roles["other"])))
        old.execute("SET check_function_bodies = off")
        old.execute("SELECT FROM conflictdb.scene")  # takes the snapshot
        with acting(conn, roles["planner"]), connect(conn) as db:
            number = db.scene("s").attach("area", "mission.ops", MAP)
        with pytest.raises(psycopg.DatabaseError) as refused:
            old.execute(f"SELECT conflictdb_internal.{statement.format(n=number)}".encode())
        assert refused.value.sqlstate in ("ZC011", "42883")
    with acting(conn, roles["writer"]):
        conn.execute(f"INSERT INTO mission.ops VALUES (2, {AREA})")
    follow(conn, roles["planner"])
    assert keys(conn) == ["1", "2"]
    assert conn.execute("SELECT count(*) FROM pg_trigger WHERE tgrelid = 'mission.ops'::regclass").fetchone() == (5,)


def test_who_replaces_a_table_has_nothing_read(conn: Conn, roles: dict[str, str]) -> None:
    """The owner of a schema may drop other roles' tables in it, and give their names to views."""
    conn.execute(sql.SQL("CREATE SCHEMA team AUTHORIZATION {}").format(sql.Identifier(roles["other"])))
    conn.execute(sql.SQL("GRANT ALL ON SCHEMA team TO {}").format(sql.Identifier(roles["planner"])))
    conn.commit()
    with acting(conn, roles["planner"]), connect(conn) as db:
        conn.execute("CREATE TABLE team.ops AS SELECT * FROM mission.ops")
        db.scene("s").attach("area", "team.ops", MAP)
        conn.execute(EVIL)
    follow(conn, roles["planner"])
    assert keys(conn) == ["1"]
    with acting(conn, roles["other"]):
        conn.execute("DROP TABLE team.ops")
        conn.execute("CREATE VIEW team.ops AS SELECT 1 AS id, NULL::geometry AS shape WHERE mission.evil()")
        conn.execute("GRANT SELECT ON team.ops TO PUBLIC")
    conn.execute("UPDATE conflictdb.attachment SET compared_at = NULL")
    conn.commit()
    follow(conn, roles["planner"])
    assert conn.execute("SELECT * FROM mission.caught").fetchall() == []
    assert keys(conn) == ["1"]
    with connect(conn) as db:
        assert "was dropped, and another one has its name" in str(db.attachments()[0].error)
    refused = pytest.raises(InvalidInput, match=f"role {roles['planner']} does not own team.ops")
    with acting(conn, roles["planner"]), connect(conn) as db, refused:
        db.scene("s").reattach("team.ops")


def test_only_who_attaches_makes_notes(conn: Conn, roles: dict[str, str]) -> None:
    """Another editor would keep the scene from being current."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.scene("s").attach("area", "mission.ops", MAP)
    with acting(conn, roles["other"]):
        conn.execute("SELECT conflictdb.create_scene('own')")
        conn.execute("CREATE TEMPORARY TABLE bait (id integer)")
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            conn.execute(
                f"""CREATE TRIGGER bait AFTER INSERT ON bait REFERENCING NEW TABLE AS new_rows FOR EACH STATEMENT
                    EXECUTE FUNCTION conflictdb_internal._note_{number}()""".encode()
            )
        conn.rollback()


def test_members_of_the_owner_make_partitions(conn: Conn, roles: dict[str, str]) -> None:
    """A new partition gets the triggers of its table, which needs the right to execute their function."""
    group, writer, planner = (sql.Identifier(roles[role]) for role in ("writer", "writer", "planner"))
    conn.execute(sql.SQL("GRANT {} TO {}").format(group, planner))
    conn.execute(sql.SQL("GRANT ALL ON SCHEMA mission TO {}").format(writer))
    conn.commit()
    with acting(conn, roles["writer"]):
        conn.execute("CREATE TABLE mission.parted (id integer, shape geometry) PARTITION BY RANGE (id)")
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.scene("s").attach("area", "mission.parted", MAP)
    with acting(conn, roles["writer"]):
        conn.execute("CREATE TABLE mission.part PARTITION OF mission.parted FOR VALUES FROM (0) TO (10)")
        conn.execute(f"INSERT INTO mission.parted VALUES (3, {AREA})")
    follow(conn, roles["planner"])
    assert keys(conn) == ["3"]


@pytest.mark.parametrize(
    "values",
    [
        "SELECT repeat('1', 11000000)::varbit || i::bit(8) FROM generate_series(1, 100) i",
        f"SELECT {' || '.join(['b'] * 14)} FROM (SELECT 1::bit(80000000) OFFSET 0) x (b)",
    ],
    ids=["many", "one"],
)
def test_keys_of_any_size_fail_no_write(conn: Conn, roles: dict[str, str], values: str) -> None:
    """The texts of 100 keys, or of one, may be longer than any text can be: eight times as long as these are stored."""
    with acting(conn, roles["planner"]), connect(conn) as db:
        conn.execute("CREATE TABLE mission.long (id varbit, shape geometry)")
        number = db.scene("s").attach("area", "mission.long", {"key": "left(id::text, 9)", "footprint": "shape"})
        conn.execute("DELETE FROM conflictdb.attached_change")
        conn.execute(f"INSERT INTO mission.long {values}".encode())
        notes = conn.execute("SELECT attachment_id, identities FROM conflictdb.attached_change").fetchall()
    assert notes == [(number, None)]


def test_views_of_others_do_not_keep_a_table_attached(conn: Conn, roles: dict[str, str]) -> None:
    with acting(conn, roles["planner"]), connect(conn) as db:
        number = db.scene("s").attach("area", "mission.ops", MAP)
    with acting(conn, roles["other"]):
        conn.execute(
            f"CREATE TEMPORARY VIEW mine AS SELECT * FROM conflictdb_attached.rows_{number}(NULL, '')".encode()
        )
    with acting(conn, roles["planner"]), connect(conn) as db:
        db.scene("s").detach("mission.ops")
        assert db.attachments() == []
