"""CREATE EXTENSION conflictdb: the schema of `conflictdb admin init`, dumped, restored and updated with its data.

On a server whose files are a copy: files of other servers must not change.
"""

import subprocess
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import psycopg
import pytest
from catalog import TOGETHER, describe, details
from commands import STRAIT, runner
from installations import own_installation
from psycopg import conninfo, sql

from conflictdb import connect
from conflictdb.client.database import Database
from conflictdb.errors import IncompleteWarning, SchemaMissing, SchemaOutdated
from conflictdb.jobs import extension, schema

NUMBERS = count(1)
CREATE = "CREATE EXTENSION conflictdb CASCADE"
ELSEWHERE = """
CREATE SCHEMA "My GIS"; CREATE EXTENSION postgis SCHEMA "My GIS"; CREATE EXTENSION btree_gist SCHEMA "My GIS";
"""
READABLE = 'GRANT USAGE ON SCHEMA "My GIS" TO conflictdb_reader'
TABLE = 'CREATE TABLE public.op (id text PRIMARY KEY, shape "My GIS".geometry)'
ROW = "INSERT INTO public.op VALUES ('OP', 'SRID=4326;POLYGON((0 0,0 1,1 1,1 0,0 0))')"
ATTACH = """SELECT conflictdb.attach(%s, 'area', 'public.op', '{"key": "id", "footprint": "shape"}')"""
STRAY = """
SELECT c.relname FROM pg_class c
WHERE c.relnamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[]) AND c.relkind IN ('r', 'v', 'S')
    AND NOT EXISTS (SELECT FROM pg_depend d WHERE d.objid = c.oid AND d.deptype = 'e')
UNION ALL SELECT p.proname FROM pg_proc p
WHERE p.pronamespace = ANY ('{conflictdb, conflictdb_internal}'::regnamespace[])
    AND NOT EXISTS (SELECT FROM pg_depend d WHERE d.objid = p.oid AND d.deptype = 'e')
"""


@pytest.fixture(scope="module")
def server() -> Iterator[tuple[Path, str]]:
    """A server, with one database made by `init` and one by the extension: its programs, and how to connect to it."""
    with own_installation() as (programs, running):
        dsn = conninfo.make_conninfo(running.admin_dsn, dbname="postgres")
        extension.build(extension.install_directory(str(programs / "pg_config")))
        schema.upgrade(new(dsn, name="by_init"))
        new(dsn, CREATE, name="by_extension")
        yield programs, dsn


@pytest.fixture
def installed(server: tuple[Path, str], capsys: pytest.CaptureFixture[str]) -> str:
    """A server with the files of this program: how to connect to it."""
    programs, dsn = server
    done = runner("", capsys)("admin", "extension", "--pg-config", str(programs / "pg_config"))
    assert done.code == 0, done.err
    assert f"conflictdb--{schema.head()}.sql" in done.out
    return dsn


def new(dsn: str, *statements: str, name: str | None = None, template: str = "template0") -> str:
    """Make a database on a server, and return how to connect to it."""
    name = name or f"db{next(NUMBERS)}"
    made = sql.SQL("CREATE DATABASE {} TEMPLATE {}").format(sql.Identifier(name), sql.Identifier(template))
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(made)
    database = conninfo.make_conninfo(dsn, dbname=name)
    with psycopg.connect(database) as conn:
        for statement in statements:
            conn.execute(statement.encode())
    return database


def catalog(dsn: str) -> set[str]:
    with psycopg.connect(dsn) as conn:
        return {*describe(conn).splitlines(), *details(conn)}


def rows(dsn: str, query: str) -> list[tuple[Any, ...]]:
    with psycopg.connect(dsn) as conn:
        return conn.execute(query.encode()).fetchall()


def answer(db: Database) -> list[tuple[Any, ...]]:
    return [(c.a_key, c.b_key, c.periods, c.region) for c in db.scene("strait").conflicts()]


def restored(server: tuple[Path, str], dsn: str) -> str:
    """Dump a database, restore it as a new one, and return how to connect to that."""
    programs, _ = server
    to = new(server[1])
    archive = subprocess.run([programs / "pg_dump", "-Fc", "-d", dsn], check=True, stdout=subprocess.PIPE).stdout
    subprocess.run([programs / "pg_restore", "-e", "-d", to], check=True, input=archive)
    return to


def test_the_catalog_is_that_of_init(installed: str) -> None:
    by_init, by_extension = (new(installed, template=name) for name in ("by_init", "by_extension"))
    assert catalog(by_extension) == catalog(by_init)
    with psycopg.connect(by_extension) as conn:
        schema.check(conn)
        assert schema.upgrade(by_extension) == schema.head()
        # All of it goes with the extension.
        conn.execute("DROP EXTENSION conflictdb")
        conn.commit()
        with pytest.raises(SchemaMissing):
            schema.check(conn)
        conn.execute("CREATE EXTENSION conflictdb")
    assert catalog(by_extension) == catalog(by_init)


def test_everything_belongs_to_the_extension(installed: str) -> None:
    database = new(installed, template="by_extension")
    assert rows(database, STRAY) == []
    # Routines that change between releases, and triggers that were reset, are repaired as without an extension.
    with psycopg.connect(database) as conn:
        conn.execute("ALTER EXTENSION conflictdb DROP FUNCTION conflictdb_internal._footprints")
        conn.execute("DROP FUNCTION conflictdb_internal._footprints")
        conn.execute("ALTER TABLE conflictdb.area ENABLE TRIGGER ALL")
        conn.execute("COMMENT ON TABLE conflictdb.alembic_version IS 'Routines: SHA-256 0'")
    schema.upgrade(database)
    assert rows(database, STRAY) == []
    with psycopg.connect(database) as conn:
        schema.check(conn)
        # So is an extension of a program that had private routines in another schema.
        conn.execute(TOGETHER.encode())
        conn.execute("ALTER EXTENSION conflictdb DROP SCHEMA conflictdb_internal")
        conn.execute("DROP SCHEMA conflictdb_internal")
    schema.upgrade(database)
    assert rows(database, STRAY) == []
    assert catalog(database) == catalog(new(installed, template="by_init"))
    with psycopg.connect(database) as conn:
        conn.execute("DROP EXTENSION conflictdb")
        assert conn.execute("SELECT to_regnamespace('conflictdb_internal')").fetchone() == (None,)


def test_dump_and_restore_keep_everything(server: tuple[Path, str], installed: str) -> None:
    """Objects, conflicts, attached tables, numbers, and grants; and then work goes on as before."""
    database = new(installed, ELSEWHERE, CREATE, READABLE, TABLE, ROW)
    with connect(database) as db:
        db.load(STRAIT)
        db.connection.execute(ATTACH.encode(), ["strait"])
        db.connection.commit()
        db.scene("strait").detect()
        db.connection.execute("SELECT conflictdb.acknowledge('strait', a_key, b_key, 'seen') FROM conflictdb.conflicts")
        before = answer(db)
        db.connection.execute("GRANT SELECT ON conflictdb.conflicts TO pg_monitor")
        db.connection.execute('GRANT USAGE ON SCHEMA conflictdb, "My GIS" TO pg_monitor')
        db.connection.commit()
    counted = """SELECT (SELECT count(*) FROM conflictdb.area), (SELECT count(*) FROM conflictdb.track),
                        (SELECT count(*) FROM conflictdb.run), (SELECT count(*) FROM conflictdb.conflict),
                        (SELECT count(*) FROM conflictdb.attached_object),
                        (SELECT count(*) FROM conflictdb.object_key)"""
    granted = """SELECT has_table_privilege('pg_monitor', 'conflictdb.conflicts', 'SELECT'),
                        has_schema_privilege('pg_monitor', 'conflictdb', 'USAGE'),
                        has_schema_privilege('pg_monitor', 'My GIS', 'USAGE'),
                        has_schema_privilege('conflictdb_reader', 'My GIS', 'USAGE')"""
    copy = restored(server, database)
    assert catalog(copy) ^ catalog(database) == set()
    assert rows(copy, counted) == rows(database, counted)
    assert rows(copy, granted) == [(True,) * 4]
    with connect(copy) as db:
        # Rows that come back through triggers are marked, and computed again.
        with pytest.warns(IncompleteWarning, match="12 objects wait for detection"):
            assert answer(db) == before
        run = db.scene("strait").detect()
        assert (run.opened, run.changed, run.closed) == (0, 0, 0), "each conflict keeps its number"
        assert answer(db) == before
        assert {conflict.acknowledged_for for conflict in db.scene("strait").conflicts()} == {"seen"}
        # Numbers go on where they were, and attached tables are followed.
        db.load(STRAIT, "another")
        db.connection.execute("UPDATE public.op SET id = 'OTHER'")
        db.connection.commit()
        db.scene("strait").detect()
    assert rows(copy, "SELECT key FROM conflictdb.area WHERE key LIKE 'O%'") == [("OTHER",)]


def test_updates_take_the_data_along(
    installed: str, server: tuple[Path, str], capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest
) -> None:
    """Also with attached tables, whose functions are no part of the extension; a fresh extension is the same."""
    database = new(installed, TABLE.replace('"My GIS".', ""), ROW, template="by_extension")
    with connect(database) as db:
        db.load(STRAIT)
        db.connection.execute(ATTACH.encode(), ["strait"])
        db.connection.commit()
        db.scene("strait").detect()
        before = answer(db)
    former = schema.head()
    request.getfixturevalue("next_release")
    with psycopg.connect(database) as conn, pytest.raises(SchemaOutdated, match="conflictdb admin upgrade"):
        schema.check(conn)
    with pytest.raises(SchemaOutdated, match=f"of version {former}, .* no files of version {schema.head()}: run `conf"):
        schema.upgrade(database)
    done = runner("", capsys)("admin", "extension", "--pg-config", str(server[0] / "pg_config"))
    assert f"conflictdb--{former}--{schema.head()}.sql" in done.out
    assert schema.upgrade(database) == schema.head()
    with connect(database) as db:
        assert answer(db) == before
        db.connection.execute("UPDATE public.op SET id = 'OTHER'")
        db.connection.commit()
        db.scene("strait").detect()
    assert rows(database, "SELECT key FROM conflictdb.area WHERE key LIKE 'O%'") == [("OTHER",)]
    assert rows(database, "SELECT conflictdb.scene_note('strait')") == [("none: 100% :x",)]
    assert rows(database, STRAY) == [("_note_1",)]
    assert rows(database, "SELECT conflictdb.detach('strait', 'op')") == [(1,)]
    assert catalog(database) == catalog(new(installed, CREATE))


def test_dropped_with_a_table_attached_it_leaves_the_table(installed: str) -> None:
    database = new(installed, TABLE.replace('"My GIS".', ""), ROW, template="by_extension")
    with connect(database) as db:
        db.load(STRAIT)
        db.connection.execute(ATTACH.encode(), ["strait"])
        db.connection.commit()
    with psycopg.connect(database) as conn, pytest.raises(psycopg.errors.DependentObjectsStillExist):
        conn.execute("DROP EXTENSION conflictdb")
    with psycopg.connect(database) as conn:
        conn.execute("DROP EXTENSION conflictdb CASCADE")
        conn.execute("UPDATE public.op SET id = 'OTHER'")
        assert conn.execute("SELECT tgname FROM pg_trigger WHERE NOT tgisinternal").fetchall() == []


def test_beside_the_schema_that_init_made_it_is_refused(installed: str) -> None:
    database = new(installed, template="by_init")
    with pytest.raises(psycopg.errors.DuplicateSchema, match="made by `conflictdb admin init`"):
        rows(database, "CREATE EXTENSION conflictdb")
    with psycopg.connect(database) as conn:
        schema.check(conn)


def test_who_may_create_schemas_may_create_it_and_is_told_what_to_grant(installed: str) -> None:
    """No superuser is needed; a schema of PostGIS that is another's is left alone, and so are the grants on it."""
    database = new(installed, ELSEWHERE)
    said: list[str] = []
    with psycopg.connect(database) as conn:
        conn.add_notice_handler(lambda diag: said.append(f"{diag.message_primary}: {diag.message_hint}"))
        conn.execute("CREATE ROLE plain")
        conn.execute(sql.SQL("GRANT CREATE ON DATABASE {} TO plain").format(sql.Identifier(conn.info.dbname)))
        conn.execute('GRANT USAGE ON SCHEMA "My GIS" TO plain')
        conn.execute("SET ROLE plain")
        conn.execute("CREATE EXTENSION conflictdb")
        conn.execute("RESET ROLE")
        conn.execute(READABLE)
    assert said == [f"the roles of conflictdb cannot use PostGIS yet: Run: {READABLE}"]
    with connect(conninfo.make_conninfo(database, options="-c role=plain")) as db:
        db.load(STRAIT)
        assert db.scene("strait").detect().conflicts == 7
    assert rows(database, """SELECT FROM pg_init_privs WHERE objoid = '"My GIS"'::regnamespace""") == []


def test_a_server_that_is_not_there_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    done = runner("", capsys)("admin", "extension", "--pg-config", str(tmp_path / "pg_config"))
    assert (done.code, done.out) == (5, "")
    assert "--pg-config /usr/lib/postgresql/17/bin/pg_config, or" in done.err
