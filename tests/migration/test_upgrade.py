"""Upgrades: from nothing or from any revision to the same schema, all or nothing, also by several at once."""

import os
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import alembic.command
import alembic.config
import psycopg
import pytest
import sqlalchemy
from catalog import TOGETHER, describe, details, privileges
from commands import runner
from databases import TestServer
from made_scenes import sea
from psycopg import conninfo, sql
from sqlalchemy.pool import NullPool

from conflictdb import connect, store
from conflictdb.errors import LockTimeout, SchemaMissing, SchemaOutdated, SchemaTooNew, ServerError, StoreError
from conflictdb.jobs import schema
from conflictdb.model.methods import Method
from conflictdb.model.plans import Scene
from conflictdb.model.results import Verdict

ROOT = Path(schema.__file__).resolve().parents[2]
SNAPSHOT = ROOT / "docs" / "reference" / "schema.sql"
PRIVILEGES = SNAPSHOT.with_name("privileges.txt")

# A scene of any revision, detected: with no marks, and with a run.
DETECTED = """
INSERT INTO conflictdb.scene (name) VALUES ('s');
INSERT INTO conflictdb.run (scene_id, started_at, finished_at, method, settings, objects, conflicts)
VALUES (1, now(), now(), 'exact', '{}', 2, 0);
"""
AREAS = """
INSERT INTO conflictdb.area (scene_id, key, footprint, version{column})
SELECT 1, 'A' || n, ST_Multi(ST_MakeEnvelope(n * 0.5, 0, n * 0.5 + 1, 1, 4326)), n{value} FROM generate_series(1, 2) n;
SELECT setval('conflictdb.version_seq', 2);
"""


@pytest.fixture
def other_dsn(_server: TestServer, worker_id: str) -> Iterator[str]:
    name = f"{_server.prefix}_{worker_id}_other"
    yield _server.clone("template0", name)
    _server.drop(name)


def catalog(dsn: str) -> tuple[str, list[str]]:
    with psycopg.connect(dsn) as conn:
        return describe(conn), details(conn)


@pytest.fixture(scope="module")
def installed(_server: TestServer, template: str, worker_id: str) -> Iterator[tuple[str, list[str]]]:
    """Return the catalog of a fresh install of this release."""
    name = f"{_server.prefix}_{worker_id}_installed"
    found = catalog(_server.clone(template, name))
    yield found
    _server.drop(name)


def alembic_do(dsn: str, command: Any, revision: str) -> None:
    """Run an alembic command as its command line does, with our environment."""
    config = alembic.config.Config()
    config.set_main_option("script_location", str(schema._folder("migrations")))
    engine = sqlalchemy.create_engine("postgresql+psycopg://", creator=lambda: psycopg.connect(dsn), poolclass=NullPool)
    with engine.connect() as connection:
        config.attributes["connection"] = connection
        command(config, revision)


def test_fresh_schema_is_the_documented_one(dsn: str) -> None:
    """docs/reference/schema.sql is reviewed as a diff."""
    found, _ = catalog(dsn)
    if os.environ.get("CONFLICTDB_UPDATE_SNAPSHOT"):
        SNAPSHOT.write_text(found)
    assert found == SNAPSHOT.read_text()


def test_privileges_are_the_documented_ones(conn: psycopg.Connection[Any]) -> None:
    """docs/reference/privileges.txt is reviewed as a diff; nothing of it is PUBLIC's."""
    found = privileges(conn)
    if os.environ.get("CONFLICTDB_UPDATE_SNAPSHOT"):
        PRIVILEGES.write_text(found)
    assert found == PRIVILEGES.read_text()
    public = """SELECT o.name FROM (
                    SELECT n.nspname, coalesce(n.nspacl, acldefault('n', n.nspowner)) FROM pg_namespace n
                    WHERE n.nspname IN ('conflictdb', 'conflictdb_internal')
                    UNION ALL
                    SELECT c.relname, coalesce(c.relacl, acldefault('r', c.relowner)) FROM pg_class c
                    WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
                          AND c.relkind IN ('r', 'v', 'S')
                    UNION ALL
                    SELECT p.proname, coalesce(p.proacl, acldefault('f', p.proowner)) FROM pg_proc p
                    WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])) o (name, acl),
                    LATERAL aclexplode(o.acl) x
                WHERE x.grantee = 0"""
    assert conn.execute(public.encode()).fetchall() == []


def test_upgrade_returns_the_revision_and_again_changes_nothing(empty_dsn: str) -> None:
    assert schema.upgrade(empty_dsn) == schema.head()
    before = catalog(empty_dsn)
    assert schema.upgrade(empty_dsn) == schema.head()
    assert catalog(empty_dsn) == before
    with psycopg.connect(empty_dsn) as conn:
        schema.check(conn)
        assert schema.revision(conn) == schema.head()
        assert conn.info.transaction_status == psycopg.pq.TransactionStatus.IDLE


def test_stepwise_upgrade_is_the_fresh_install(empty_dsn: str, other_dsn: str, next_release: Path) -> None:
    """Every revision in turn, with objects in the tables, gives the schema of a fresh install."""
    for revision in schema.revisions():
        alembic_do(empty_dsn, alembic.command.upgrade, revision)
        with psycopg.connect(empty_dsn) as conn:
            assert schema.revision(conn) == revision
            at_head = revision == schema.head()
            found = conn.execute("SELECT to_regproc('conflictdb.put_area') IS NOT NULL").fetchone()
            assert found == (at_head,)  # older revisions never meet newer routines
            if not at_head:
                conn.execute("INSERT INTO conflictdb.scene (name) VALUES (%s)", [revision])
    schema.upgrade(other_dsn)
    assert catalog(empty_dsn) == catalog(other_dsn)
    with psycopg.connect(empty_dsn) as conn:
        assert conn.execute("SELECT conflictdb.scene_note('0001')").fetchone() == ("none: 100% :x",)


@pytest.mark.parametrize("revision", [name for name in schema.revisions() if schema.marking_sql(name)])
def test_after_an_upgrade_that_changes_answers_everything_is_detected_again(
    empty_dsn: str, revision: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever revision it began at: the answers are those of the release before."""
    alembic_do(empty_dsn, alembic.command.upgrade, revision)
    with psycopg.connect(empty_dsn) as conn:
        conn.execute(DETECTED.encode())
        # These columns follow from others; only some revisions have them, and they have no defaults.
        columns = conn.execute(
            "SELECT attname FROM pg_attribute WHERE attrelid = 'conflictdb.area'::regclass"
        ).fetchall()
        more = ", first_version" if ("first_version",) in columns else ""
        conn.execute(AREAS.format(column=more, value=more and ", n").encode())
    assert runner(empty_dsn, capsys)("admin", "upgrade").err == (
        "conflictdb: s: not complete: 2 objects wait for detection (`conflictdb detect --scene s` does it)\n"
    )
    state = "SELECT is_current, objects, pending FROM conflictdb.scenes"
    with psycopg.connect(empty_dsn) as conn:
        assert conn.execute(state).fetchall() == [(False, 2, 2)]
    assert schema.upgrade(empty_dsn) == schema.head()
    with connect(empty_dsn) as db:
        db.scene("s").detect()
        assert [(one.a_key, one.b_key) for one in db.scene("s").conflicts()] == [("A1", "A2")]
        assert db.connection.execute(state).fetchall() == [(True, 2, 0)]


# Requests of the form before 0007, and a routine whose body names their columns.
REQUESTS = """
INSERT INTO conflictdb.scene (name, motion, earth, method, tolerance_m, separation_m)
    VALUES ('s', 'rhumb', 'wgs84', 'exact', 1, 0);
INSERT INTO conflictdb.probe_request (scene_id, object_kind, footprint, active_span)
    SELECT scene_id, 0, 'SRID=4326;MULTIPOLYGON(((0 0, 1 0, 1 1, 0 0)))', '(,)' FROM conflictdb.scene;
INSERT INTO conflictdb.probe_reply (probe_id, object_kind, key, verdict, periods, time_error_s)
    SELECT probe_id, 0, 'A', 'conflict', '{}', 0 FROM conflictdb.probe_request;
INSERT INTO conflictdb.probe_request (scene_id, object_kind, key, horizon)
    SELECT scene_id, 1, 'T', '1 hour' FROM conflictdb.scene;
INSERT INTO conflictdb.probe_request (scene_id, object_kind, plans)
    SELECT scene_id, 0, '[{"key": "A"}]' FROM conflictdb.scene;
CREATE FUNCTION conflictdb_internal._requested_admission(p_probe_id bigint)
    RETURNS TABLE (owner text, allow_known boolean) LANGUAGE sql STABLE STRICT
    BEGIN ATOMIC SELECT p.owner, p.allow_known FROM conflictdb.probe_request p WHERE p.probe_id = p_probe_id; END;
"""


def test_requests_of_the_older_form_go(empty_dsn: str, dsn: str) -> None:
    """Nothing waits for them; the tables are those of a fresh schema."""
    alembic_do(empty_dsn, alembic.command.upgrade, "0006")
    with psycopg.connect(empty_dsn) as conn:
        conn.execute(REQUESTS.encode())
    assert schema.upgrade(empty_dsn) == schema.head()
    with psycopg.connect(empty_dsn) as conn, psycopg.connect(dsn) as fresh:
        assert conn.execute("SELECT count(*) FROM conflictdb.probe_request").fetchone() == (0,)
        conn.execute("SELECT conflictdb.request_probe('s', 'SRID=4326;POLYGON((0 0, 1 0, 1 1, 0 0))')")
        assert conn.execute("SELECT kind, answer FROM conflictdb.probe_request").fetchall() == [("probe", None)]
        assert describe(conn) == describe(fresh)


# A scene of the release before 0002, detected by a method that is gone.
OF_WINDOW = """
ALTER TABLE conflictdb.scene DISABLE TRIGGER USER;
ALTER TABLE conflictdb.scene DROP CONSTRAINT scene_method_known;
ALTER TABLE conflictdb.scene
    ADD CONSTRAINT scene_method_known CHECK (method IN ('screen', 'window', 'exact', 'nlp'));
UPDATE conflictdb.scene SET method = 'window';
UPDATE conflictdb.run SET method = 'window';
UPDATE conflictdb.conflict SET method = 'window';
ALTER TABLE conflictdb.scene ENABLE TRIGGER USER;
DELETE FROM conflictdb.change;
UPDATE conflictdb.alembic_version SET version_num = '0001';
DROP TABLE conflictdb.probe_reply, conflictdb.probe_request CASCADE;
DROP TRIGGER scene_before ON conflictdb.scene;
DROP TRIGGER scene_changed ON conflictdb.scene;
ALTER TABLE conflictdb.scene DROP COLUMN vertical_separation_m CASCADE, DROP COLUMN time_separation_s CASCADE,
    DROP COLUMN delays_within_s CASCADE, DROP COLUMN intervals CASCADE, DROP COLUMN horizon_days CASCADE,
    DROP COLUMN expanded CASCADE, DROP COLUMN parent_scene_id CASCADE, DROP COLUMN vertical_datum CASCADE,
    DROP COLUMN regions CASCADE;
"""


def test_scenes_of_the_method_window_become_exact(dsn: str) -> None:
    """Triggers of the earlier release do not run; the found conflicts have the guarantee of `screen`."""
    ((areas, tracks),) = sea(40, 1)
    with connect(dsn) as db:
        store.replace_scene(db.connection, Scene("s", method=Method.SCREEN), areas, tracks, merge=False)
        db.scene("s").detect()
        screened = store.conflicts(db.connection, "s")
    assert any(one.verdict is Verdict.UNRESOLVED for one in screened)
    with psycopg.connect(dsn) as conn:
        before = describe(conn)
    with psycopg.connect(dsn) as conn:
        conn.execute(OF_WINDOW.encode())
        first = runpy.run_path(str(next((Path(__file__).parents[2] / "migrations" / "versions").glob("0001_*.py"))))
        for name in ("PROBE_REQUEST", "PROBE_REQUEST_SCENE", "PROBE_REPLY"):
            conn.execute(first[name].encode())
    assert schema.upgrade(dsn) == schema.head()
    with psycopg.connect(dsn) as conn:
        assert describe(conn) == before
        assert conn.execute("SELECT method, pending = objects FROM conflictdb.scenes").fetchall() == [("exact", True)]
        assert conn.execute("SELECT DISTINCT method FROM conflictdb.run").fetchall() == [("screen",)]
        with pytest.raises(psycopg.Error, match="got 'window', which was removed: use exact"):
            conn.execute("UPDATE conflictdb.scene SET method = 'window'")
    with connect(dsn) as db:
        still = store.conflicts(db.connection, "s")
        assert [replace(one, is_current=True, scene_is_current=True) for one in still] == screened
        db.scene("s").detect()
        assert db.scene("s").conflicts()
        assert {one.method for one in db.scene("s").conflicts()} == {Method.EXACT}
        assert all(one.verdict is not Verdict.UNRESOLVED for one in db.scene("s").conflicts())


@pytest.mark.parametrize("changes", [True, False])
def test_the_next_release_says_whether_answers_change(dsn: str, next_release: Path, changes: bool) -> None:
    """Nothing waits after an upgrade that changes none."""
    (file,) = (next_release / "migrations" / "versions").glob(f"{schema.head()}_*.py")
    file.write_text(file.read_text().replace("changes_answers = False", f"changes_answers = {changes}"))
    with psycopg.connect(dsn) as conn:
        conn.execute("SELECT conflictdb.create_scene('s')")
        conn.execute("SELECT conflictdb.put_area('s', 'A', ST_MakeEnvelope(0, 0, 1, 1, 4326))")
        conn.execute("DELETE FROM conflictdb.change")
    schema.upgrade(dsn)
    with psycopg.connect(dsn) as conn:
        assert conn.execute("SELECT pending FROM conflictdb.scenes").fetchall() == [(int(changes),)]


def test_older_schema_is_outdated_and_upgraded(dsn: str, next_release: Path) -> None:
    with psycopg.connect(dsn) as conn:
        conn.execute("SELECT conflictdb.create_scene('s')")
        with pytest.raises(SchemaOutdated, match="conflictdb admin upgrade"):
            schema.check(conn)
    assert schema.upgrade(dsn) == schema.head()
    with psycopg.connect(dsn) as conn:
        schema.check(conn)
        assert conn.execute("SELECT conflictdb.scene_note('s')").fetchone() == ("none: 100% :x",)


def test_other_routines_at_the_same_revision_are_outdated_and_upgraded(dsn: str) -> None:
    with psycopg.connect(dsn) as conn:
        conn.execute("DROP FUNCTION conflictdb_internal._footprints")
        conn.execute("COMMENT ON TABLE conflictdb.alembic_version IS 'Routines: SHA-256 0'")
        with pytest.raises(SchemaOutdated, match="routines"):
            schema.check(conn)
    schema.upgrade(dsn)
    with psycopg.connect(dsn) as conn:
        schema.check(conn)
        conn.execute("SELECT conflictdb_internal._footprints('{}')")


def test_private_routines_leave_the_schema_of_the_public_ones(dsn: str, installed: tuple[str, list[str]]) -> None:
    """Earlier programs had all in one schema; objects that depend on a routine, as a user's view does, stay."""
    with psycopg.connect(dsn) as conn:
        conn.execute("CREATE VIEW public.mine AS SELECT conflictdb_internal._globe(), a_key FROM conflictdb.conflicts")
        conn.execute("SELECT conflictdb.protect_scenes()")
        conn.execute(TOGETHER.encode())
        conn.execute("DROP SCHEMA conflictdb_internal")
    schema.upgrade(dsn)
    with psycopg.connect(dsn) as conn:
        schema.check(conn)
        assert conn.execute("SELECT * FROM public.mine").fetchall() == []
        conn.execute("DROP VIEW public.mine")
        conn.execute("SELECT conflictdb.protect_scenes(false)")
    assert catalog(dsn) == installed


def test_views_of_users_survive_when_routines_are_retired(dsn: str, other_dsn: str, next_release: Path) -> None:
    """A routine with other parameters, of the same types, replaces the old one; a routine that is gone is dropped.

    All private routines, and public ones that are listed; not a private one that a view of a user reads.
    """
    with psycopg.connect(dsn) as conn:
        conn.execute("CREATE VIEW public.mine AS SELECT a_key, region FROM conflictdb.conflicts")
        conn.execute(
            """UPDATE pg_proc SET proargnames = array_replace(proargnames, 'p_plane', 'p_earth')
               WHERE pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
                     AND proname = '_from_plane'"""
        )
        conn.execute(
            "CREATE FUNCTION conflictdb_internal._gone(p_a text) RETURNS SETOF text LANGUAGE sql AS 'SELECT p_a'"
        )
        conn.execute(
            "CREATE FUNCTION conflictdb_internal._gone(p_b integer) RETURNS integer LANGUAGE sql AS 'SELECT p_b'"
        )
        conn.execute("CREATE FUNCTION conflictdb.gone(p_a text) RETURNS text LANGUAGE sql AS 'SELECT p_a'")
        conn.execute("CREATE VIEW public.other AS SELECT conflictdb_internal._gone(1)")
    retired = next_release / "sql" / "06_retired.sql"
    assert "ARRAY[" in retired.read_text()
    names = "ARRAY['gone(p_a)', "
    retired.write_text(retired.read_text().replace("ARRAY[", names, 1))
    schema.upgrade(dsn)
    with psycopg.connect(dsn) as conn:
        assert conn.execute("SELECT * FROM public.mine").fetchall() == []
        assert conn.execute("SELECT * FROM public.other").fetchall() == [(1,)]
        conn.execute("DROP VIEW public.mine, public.other")
        conn.execute("DROP FUNCTION conflictdb_internal._gone(integer)")
    schema.upgrade(dsn)  # its rights were among those that the upgrade noted
    schema.upgrade(other_dsn)
    assert catalog(dsn) == catalog(other_dsn)


def test_routines_that_are_listed_as_retired_are_replaced(empty_dsn: str, installed: tuple[str, list[str]]) -> None:
    """Those of a database at revision 0002, which have other parameters or results, and private ones."""
    listed = (schema.routine_files()[0].parent / "06_retired.sql").read_text().partition("ARRAY[")[2].partition("];")[0]
    headers = re.findall(r"'([^']+)'", re.sub(r"'\s+'", "", listed))
    assert "acknowledge(p_scene, p_a_key, p_b_key, p_reason, p_until)" in headers
    headers += ["_keys_of(p_scene_id, p_kinds, p_ids, kind, id, key)", "_scene(p_scene_id, name)"]
    alembic_do(empty_dsn, alembic.command.upgrade, "0002")
    with psycopg.connect(empty_dsn) as conn:
        for header in headers:
            name, _, parameters = header.removesuffix(")").partition("(")
            some = ", ".join(f"{one} text" for one in parameters.split(", "))
            conn.execute(f"CREATE FUNCTION conflictdb.{name}({some}) RETURNS text LANGUAGE sql AS 'SELECT NULL'")
    assert schema.upgrade(empty_dsn) == schema.head()
    assert catalog(empty_dsn) == installed


def test_newer_schema_is_refused_and_left_alone(dsn: str) -> None:
    with psycopg.connect(dsn) as conn:
        conn.execute("UPDATE conflictdb.alembic_version SET version_num = '9999'")
    with psycopg.connect(dsn) as conn, pytest.raises(SchemaTooNew, match="9999"):
        schema.check(conn)
    with pytest.raises(SchemaTooNew, match="install a newer conflictdb"):
        schema.upgrade(dsn)


def test_the_last_revision_before_the_squash_is_upgraded(empty_dsn: str, installed: tuple[str, list[str]]) -> None:
    """Its structure is that of the present 0001, under the number 0028."""
    alembic_do(empty_dsn, alembic.command.upgrade, "0001")
    with psycopg.connect(empty_dsn) as conn:
        conn.execute("UPDATE conflictdb.alembic_version SET version_num = '0028'")
        conn.execute("INSERT INTO conflictdb.scene (name, method) VALUES ('old', 'window')")
    with psycopg.connect(empty_dsn) as conn, pytest.raises(SchemaOutdated, match="run `conflictdb admin upgrade`"):
        schema.check(conn)
    assert schema.upgrade(empty_dsn) == schema.head()
    assert catalog(empty_dsn) == installed
    with psycopg.connect(empty_dsn) as conn:
        assert conn.execute("SELECT name, method FROM conflictdb.scene").fetchall() == [("old", "exact")]


@pytest.mark.parametrize("revision", ["0015", "0027"])
def test_a_revision_from_before_the_first_release_is_refused(dsn: str, revision: str) -> None:
    """Revisions 0001 to 0028 of then are 0001 now; the message says how to go on."""
    with psycopg.connect(dsn) as conn:
        conn.execute("UPDATE conflictdb.alembic_version SET version_num = %s", [revision])
    with pytest.raises(SchemaTooNew, match=r"before the first release, export its scenes .* DROP SCHEMA .* init"):
        schema.upgrade(dsn)


def test_a_former_revision_of_the_same_number_is_refused(dsn: str) -> None:
    """It lacks tables that the present revision 0001 has."""
    with psycopg.connect(dsn) as conn:
        conn.execute("DROP TABLE conflictdb.scene_share CASCADE")
        conn.execute("COMMENT ON TABLE conflictdb.alembic_version IS 'Routines: SHA-256 0'")
    for revision in schema.revisions():
        with psycopg.connect(dsn) as conn:
            conn.execute("UPDATE conflictdb.alembic_version SET version_num = %s", [revision])
        with pytest.raises(SchemaOutdated, match=r"made before the first release: export its scenes .* DROP SCHEMA"):
            schema.upgrade(dsn)
        with psycopg.connect(dsn) as conn:
            assert schema.revision(conn) == revision


def test_missing_schema_is_said(empty_dsn: str) -> None:
    with psycopg.connect(empty_dsn) as conn, pytest.raises(SchemaMissing, match="conflictdb admin init"):
        schema.check(conn)


def test_broken_routine_rolls_everything_back(empty_dsn: str, next_release: Path) -> None:
    (next_release / "sql" / "87_broken.sql").write_text("SELECT no_such_function();")
    with pytest.raises(StoreError, match="no_such_function"):
        schema.upgrade(empty_dsn)
    with psycopg.connect(empty_dsn) as conn:
        assert schema.revision(conn) is None
        assert conn.execute("SELECT count(*) FROM pg_namespace WHERE nspname LIKE 'conflictdb%'").fetchone() == (0,)


def test_changed_routines_are_applied_without_a_revision(dsn: str, next_release: Path) -> None:
    """While a revision is being written, routines change under it."""
    schema.upgrade(dsn)
    file = next_release / "sql" / "86_note.sql"
    file.write_text(file.read_text().replace(":x", ":y"))
    schema.upgrade(dsn)
    with psycopg.connect(dsn) as conn:
        conn.execute("SELECT conflictdb.create_scene('s')")
        assert conn.execute("SELECT conflictdb.scene_note('s')").fetchone() == ("none: 100% :y",)


def test_several_programs_at_once_all_succeed(empty_dsn: str, other_dsn: str) -> None:
    """On one database, and on two that share the server's roles."""
    program = "import sys; from conflictdb.jobs import schema; print(schema.upgrade(sys.argv[1]))"
    running = [
        subprocess.Popen([sys.executable, "-c", program, dsn], stdout=subprocess.PIPE, cwd=ROOT, text=True)
        for dsn in (empty_dsn, other_dsn, empty_dsn, other_dsn)
    ]
    assert [process.communicate(timeout=300.0)[0].strip() for process in running] == [schema.head()] * 4
    assert catalog(empty_dsn) == catalog(other_dsn)


def test_several_threads_at_once_all_succeed(empty_dsn: str) -> None:
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(schema.upgrade, [empty_dsn] * 4)) == [schema.head()] * 4


def test_stamp_applies_no_routines(empty_dsn: str) -> None:
    alembic_do(empty_dsn, alembic.command.stamp, "head")
    with psycopg.connect(empty_dsn) as conn:
        assert schema.revision(conn) == schema.head()
        assert conn.execute("SELECT to_regproc('conflictdb.put_area')").fetchone() == (None,)


def test_nothing_is_made_outside_the_schema(empty_dsn: str) -> None:
    """Except the two extensions."""
    outside = """SELECT n.nspname, c.relname FROM pg_class c JOIN pg_namespace n ON n.oid = c.relnamespace
                 WHERE n.nspname NOT IN ('conflictdb', 'conflictdb_internal', 'pg_toast') AND c.oid >= 16384
                   AND NOT EXISTS (SELECT FROM pg_depend d WHERE d.objid = c.oid AND d.deptype IN ('e', 'i'))
                   AND c.relkind <> 'i'"""
    schema.upgrade(empty_dsn)
    with psycopg.connect(empty_dsn) as conn:
        assert conn.execute(outside.encode()).fetchall() == []
        conn.execute("DROP SCHEMA conflictdb, conflictdb_internal CASCADE")
    with psycopg.connect(empty_dsn) as conn:
        assert schema.revision(conn) is None


def test_everything_is_commented(dsn: str) -> None:
    with psycopg.connect(dsn) as conn:
        bare = conn.execute(
            """SELECT c.relname || coalesce('.' || a.attname, '')
               FROM pg_class c LEFT JOIN pg_attribute a ON a.attrelid = c.oid AND a.attnum > 0 AND NOT a.attisdropped
               WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
                     AND c.relkind IN ('r', 'v')
                 AND c.relname <> 'alembic_version'
                 AND (col_description(c.oid, a.attnum) IS NULL OR obj_description(c.oid, 'pg_class') IS NULL)
               UNION ALL
               SELECT p.oid::regprocedure::text FROM pg_proc p
               WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
                     AND obj_description(p.oid, 'pg_proc') IS NULL"""
        ).fetchall()
    assert bare == []


def test_plpgsql_pins_its_search_path_and_sql_is_atomic(dsn: str) -> None:
    with psycopg.connect(dsn) as conn:
        loose = conn.execute(
            """SELECT p.oid::regprocedure::text FROM pg_proc p JOIN pg_language l ON l.oid = p.prolang
               WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
                 AND CASE WHEN l.lanname = 'sql' THEN p.prosqlbody IS NULL OR p.proconfig IS NOT NULL
                     WHEN p.prosecdef
                         THEN coalesce(p.proconfig[1], '') <> 'search_path=conflictdb, conflictdb_internal, pg_temp'
                     ELSE NOT coalesce(p.proconfig[1], '') LIKE 'search_path=conflictdb, conflictdb_internal, %pg_temp'
                     END"""
        ).fetchall()
    assert loose == []


def test_what_only_raises_is_not_immutable(dsn: str) -> None:
    """An immutable call may be made while a plan is made, also in a branch that is never taken."""
    with psycopg.connect(dsn) as conn:
        folded = conn.execute(
            """SELECT p.proname FROM pg_proc p
               WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND p.provolatile = 'i'
                 AND (p.prorettype = 'void'::regtype OR p.prosrc ~ '_raise|_check_|RAISE EXCEPTION'
                      OR pg_get_function_sqlbody(p.oid) ~ '_raise|_check_|_near_centre')"""
        ).fetchall()
    # They return values, and may refuse their input.
    values = {"_timed_path", "instant", "_instants_of", "_span_of", "_spans_of"}
    assert {name for (name,) in folded} == values


def test_user_who_may_not_create_extensions_is_told_what_to_ask_for(server_dsn: str, empty_dsn: str) -> None:
    name = f"plain_{conninfo.conninfo_to_dict(empty_dsn)['dbname']}"
    user = sql.Identifier(name)
    with psycopg.connect(server_dsn, autocommit=True) as admin:
        admin.execute(sql.SQL("CREATE ROLE {} LOGIN").format(user))
        try:
            dsn = conninfo.make_conninfo(empty_dsn, options=f"-c role={name}")
            with pytest.raises(ServerError, match="let an administrator run: CREATE EXTENSION postgis"):
                schema.upgrade(dsn)
        finally:
            admin.execute(sql.SQL("DROP ROLE {}").format(user))


def test_an_upgrade_waits_for_nobody_without_an_end(
    empty_dsn: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A role that can only connect can take the lock of upgrades: the message names it, and the upgrade times out."""
    monkeypatch.setattr(schema, "_SAY_AFTER_S", 0.2)
    monkeypatch.setattr(schema, "_UPGRADE_WAIT_S", 0.6)
    with psycopg.connect(empty_dsn, application_name="the other") as other:
        other.execute("SELECT pg_advisory_lock(%s)", [int.from_bytes(b"conflict")])
        with pytest.raises(
            LockTimeout, match=f"waited 0.6 s for locks; they are held by: process {other.info.backend_pid} "
        ):
            schema.upgrade(empty_dsn)
        assert [record.message for record in caplog.records if "waiting for another upgrade" in record.message] == [
            record.message for record in caplog.records if "'the other'" in record.message
        ]
        other.execute("SELECT pg_advisory_unlock_all()")
        other.commit()
        schema.upgrade(empty_dsn)


def test_an_upgrade_waits_for_no_reader_without_an_end(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reader's open transaction keeps a table from being changed."""
    monkeypatch.setattr(schema, "_UPGRADE_WAIT_S", 0.5)
    with psycopg.connect(dsn) as conn:
        conn.execute("COMMENT ON TABLE conflictdb.alembic_version IS 'Routines: SHA-256 older'")
    with psycopg.connect(dsn) as reader:
        reader.execute("SELECT FROM conflictdb.conflicts")
        with pytest.raises(
            LockTimeout, match=f"waited 0.5 s for locks; .* process {reader.info.backend_pid} of the server"
        ):
            schema.upgrade(dsn)
        reader.rollback()
        schema.upgrade(dsn)
