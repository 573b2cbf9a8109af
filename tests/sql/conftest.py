"""A database that the tests of this folder share; each works in a transaction that is rolled back."""

from collections.abc import Iterator
from typing import Any

import psycopg
import pytest
from databases import TestServer
from reused import FORGET_ALL, state_of

from conflictdb.jobs import schema


@pytest.fixture(scope="session")
def elsewhere_template(_server: TestServer, worker_id: str) -> Iterator[str]:
    """Return the name of a database with PostGIS in schema "My GIS", off everybody's search path, to be cloned."""
    name = f"{_server.prefix}_{worker_id}_elsewhere_template"
    dsn = _server.clone("template0", name)
    with psycopg.connect(dsn) as conn:
        conn.execute('CREATE SCHEMA "My GIS"')
        conn.execute('CREATE EXTENSION postgis SCHEMA "My GIS"')
        conn.execute('CREATE EXTENSION btree_gist SCHEMA "My GIS"')
    schema.upgrade(dsn)
    yield name
    _server.drop(name)


@pytest.fixture(scope="session")
def shared_dsn(_server: TestServer, template: str, worker_id: str) -> Iterator[str]:
    """Return the connection string of a database with the schema; tests must not commit to it."""
    name = f"{_server.prefix}_{worker_id}_shared"
    yield _server.clone(template, name)
    _server.drop(name)


@pytest.fixture(scope="session")
def _session(shared_dsn: str) -> Iterator[list[psycopg.Connection[Any]]]:
    """The session of earlier tests, if there is one: a new one reads catalogs and compiles routines first."""
    kept: list[psycopg.Connection[Any]] = []
    yield kept
    for connection in kept:
        connection.close()


@pytest.fixture
def rolled_back(shared_dsn: str, _session: list[psycopg.Connection[Any]]) -> Iterator[psycopg.Connection[Any]]:
    """Return a connection whose transaction is rolled back; names mean those of the schema, then PostGIS's."""
    options = "-c timezone=UTC -c search_path=conflictdb,conflictdb_internal,public"
    connection = _session.pop() if _session else psycopg.connect(shared_dsn, options=options, prepare_threshold=None)
    before = state_of(connection)
    yield connection
    connection.rollback()
    if state_of(connection) == before:
        connection.execute(FORGET_ALL)
        connection.commit()
        _session.append(connection)
    else:
        connection.close()
