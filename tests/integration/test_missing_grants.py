"""A missing right is reported with the grant that gives it; with the grant, it works."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psycopg
import pytest
from commands import STRAIT, Run, runner
from psycopg import conninfo, sql

from conflictdb import NotPermitted, connect

TOLD = "let an administrator run: "
MORE = " (conflictdb_editor for who changes plans, conflictdb_worker for who detects them, too)"


class User:
    """A user of a database, to whom an administrator may grant something."""

    def __init__(self, dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
        self.run: Run = runner(dsn, capsys)
        self.dsn = dsn
        self.quoted = sql.Identifier(str(conninfo.conninfo_to_dict(dsn)["user"])).as_string()

    def refused(self, *words: str | Path) -> str:
        """The grant that a command asks for."""
        outcome = self.run(*words)
        assert outcome.code == 1, outcome
        assert outcome.err.count("\n") == 1, outcome
        assert f"user {self.quoted} may not" in outcome.err
        return outcome.err.strip().partition(TOLD)[2]


@pytest.fixture
def administrator(dsn: str) -> Iterator[psycopg.Connection[Any]]:
    with psycopg.connect(dsn, autocommit=True) as conn:
        yield conn


@pytest.fixture
def user(
    administrator: psycopg.Connection[Any], dsn: str, capsys: pytest.CaptureFixture[str]
) -> Iterator[Callable[..., User]]:
    """Return a function that creates a user with some roles; names need quotes."""
    made: list[sql.Identifier] = []

    def make(*roles: str) -> User:
        name = f'Some "one" {len(made)} of {administrator.info.dbname}'
        made.append(sql.Identifier(name))
        administrator.execute(sql.SQL("CREATE ROLE {} LOGIN").format(made[-1]))
        for role in roles:
            administrator.execute(sql.SQL("GRANT {} TO {}").format(sql.Identifier(role), made[-1]))
        return User(conninfo.make_conninfo(dsn, user=name), capsys)

    yield make
    for one in made:
        administrator.execute(sql.SQL("DROP OWNED BY {0}; DROP ROLE {0}").format(one))


LOAD = ["load", STRAIT]
DETECT = ["detect", "--scene", "strait"]
ACKNOWLEDGE = ["acknowledge", "--scene", "strait", "FERRY", "DIVING", "--reason", "seen"]


@pytest.mark.parametrize(
    ("roles", "words", "role"),
    [
        ([], ["conflicts", "--scene", "strait"], "conflictdb_reader"),
        ([], ["admin", "init"], "conflictdb_reader"),
        (["conflictdb_reader"], LOAD, "conflictdb_editor"),
        (["conflictdb_reader"], ACKNOWLEDGE, "conflictdb_editor"),
        (["conflictdb_reader"], DETECT, "conflictdb_worker"),
        (["conflictdb_reader"], ["worker", "--once"], "conflictdb_worker"),
        (["conflictdb_editor"], DETECT, "conflictdb_worker"),
        (["conflictdb_editor"], [*DETECT, "--full"], "conflictdb_worker"),
    ],
)
def test_a_role_that_is_missing_is_named(
    administrator: psycopg.Connection[Any],
    user: Callable[..., User],
    run: Run,
    roles: list[str],
    words: list[str | Path],
    role: str,
) -> None:
    run("detect", STRAIT)
    one = user(*roles)
    grant = one.refused(*words)
    assert grant == f"GRANT {role} TO {one.quoted}{'' if roles else MORE}"
    administrator.execute(grant.removesuffix(MORE).encode())
    assert one.run(*words).code == 0


@pytest.mark.parametrize("words", [LOAD, ["detect", STRAIT], [*DETECT, "--full"]])
def test_temporary_tables_that_are_missing_are_named(
    administrator: psycopg.Connection[Any], user: Callable[..., User], run: Run, words: list[str | Path]
) -> None:
    """Nothing is changed; a detection that asks for none is done."""
    run("detect", STRAIT)
    one, database = user("conflictdb_worker"), administrator.info.dbname
    administrator.execute(sql.SQL("REVOKE TEMPORARY ON DATABASE {} FROM PUBLIC").format(sql.Identifier(database)))
    assert one.run(*DETECT).code == 0
    before = run("export", "--scene", "strait", "-").out
    grant = one.refused(*words)
    assert grant == f"GRANT TEMPORARY ON DATABASE {database} TO {one.quoted}"
    assert run("export", "--scene", "strait", "-").out == before
    administrator.execute(grant.encode())
    assert one.run(*words).code == 0


def test_python_is_told_the_same(user: Callable[..., User], run: Run) -> None:
    """Also within a transaction of the caller's, which goes on."""
    run("load", STRAIT)
    dsn = user("conflictdb_reader").dsn
    with psycopg.connect(dsn, autocommit=True) as conn, connect(conn) as db:
        with conn.transaction():
            with pytest.raises(NotPermitted, match=r"_begin_load\); let an administrator run: GRANT conflictdb_editor"):
                db.load(STRAIT)
            assert [one.scene.name for one in db.scenes()] == ["strait"]
        with pytest.raises(NotPermitted, match="GRANT conflictdb_worker") as caught:
            db.scene("strait").detect()
        assert isinstance(caught.value.__cause__, psycopg.errors.InsufficientPrivilege)


def test_what_no_grant_allows_is_told_as_it_is(
    administrator: psycopg.Connection[Any], user: Callable[..., User], run: Run
) -> None:
    """No grant gives access to a scene of another owner, whatever else is missing."""
    run("load", STRAIT)
    run("admin", "protect")
    one = user("conflictdb_worker")
    administrator.execute("SELECT conflictdb.share_scene('strait', 'conflictdb_worker')")
    database = sql.Identifier(administrator.info.dbname)
    administrator.execute(sql.SQL("REVOKE TEMPORARY ON DATABASE {} FROM PUBLIC").format(database))
    outcome = one.run("admin", "share", "--scene", "strait", "conflictdb_reader")
    assert outcome.code == 1
    assert "GRANT" not in outcome.err
    assert "owner" in outcome.err


def test_a_database_that_takes_no_schema_is_named(empty_dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    with psycopg.connect(empty_dsn, autocommit=True) as conn:
        name = f'Some "one" of {conn.info.dbname}'
        conn.execute("CREATE EXTENSION IF NOT EXISTS postgis; CREATE EXTENSION IF NOT EXISTS btree_gist")
        conn.execute(sql.SQL("CREATE ROLE {} LOGIN").format(sql.Identifier(name)))
        run = runner(conninfo.make_conninfo(empty_dsn, user=name), capsys)
        try:
            refused = run("admin", "init")
            assert refused.code == 5
            grant = refused.err.strip().partition(TOLD)[2]
            assert grant.startswith("GRANT CREATE ON DATABASE")
            conn.execute(grant.encode())
            assert grant not in run("admin", "init").err
        finally:
            conn.execute(sql.SQL("DROP OWNED BY {0}; DROP ROLE {0}").format(sql.Identifier(name)))


def test_what_a_refusal_of_rights_advises_is_a_command(
    run: Run, user: Callable[..., User], administrator: psycopg.Connection[Any]
) -> None:
    """One line, without the CONTEXT of the server and without SQL."""
    run("load", STRAIT)
    run("admin", "protect")
    shared = run("admin", "share", "public", "--scene", "strait")
    assert shared.err == ""
    outcome = user("conflictdb_editor").run("rename", "OTHER", "--scene", "strait")
    assert outcome.err.count("\n") == 1
    assert "CONTEXT" not in outcome.err
    assert "(Its owner may run `conflictdb admin share ROLE --scene NAME --access write`.)" in outcome.err
    administrator.execute("SELECT conflictdb.protect_scenes(false)")
    outcome = run("admin", "share", "public", "--scene", "strait")
    assert outcome.err.endswith("(The owner of schema conflictdb may run `conflictdb admin protect`.)\n")
    assert outcome.err.count("\n") == 1
