"""A connection that a pool lends for each request is checked once, and again when its schema may be another one."""

import math
from typing import Any

import psycopg
import pytest
from psycopg_pool import ConnectionPool

import conflictdb
from conflictdb import SchemaOutdated, StoreError, store
from conflictdb.jobs import schema
from conflictdb.store import connection, fit_connections


@pytest.fixture
def round_trips(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that gets the server's process for each statement, BEGIN and COMMIT that psycopg sends."""
    pids: list[int] = []
    original = psycopg.Connection.wait

    def wait(self: psycopg.Connection[Any], *given: Any, **options: Any) -> Any:
        pids.append(self.info.backend_pid)
        return original(self, *given, **options)

    monkeypatch.setattr(psycopg.Connection, "wait", wait)
    return pids


def borrow(pool: ConnectionPool) -> None:
    """Use a connection of a pool, and nothing else."""
    with pool.connection() as lent, conflictdb.connect(lent):
        pass


def test_a_pool_checks_each_connection_once(dsn: str, round_trips: list[int]) -> None:
    """A connection made in place of a lost one may be to another server: it is checked, too."""
    with ConnectionPool(dsn, min_size=1, max_size=1) as pool:
        counts = []
        for _ in range(4):
            with pool.connection() as lent:
                round_trips.clear()
                with conflictdb.connect(lent):
                    counts.append(len(round_trips))
        assert counts[0] > counts[1]
        assert counts[1:] == [0, 0, 0]
        with pool.connection() as lent, pytest.raises(psycopg.OperationalError):
            lent.execute("SELECT pg_terminate_backend(pg_backend_pid())")
        with pool.connection() as lent:
            round_trips.clear()
            with conflictdb.connect(lent):
                assert len(round_trips) == counts[0]


def test_a_schema_that_changes_is_noticed(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the first call of a routine that it lacks, by an upgrade in this process, and after a minute."""
    monkeypatch.setattr(fit_connections, "FIT_FOR_S", math.inf)
    with ConnectionPool(dsn, min_size=1, max_size=1) as pool, psycopg.connect(dsn, autocommit=True) as admin:
        (newest,) = admin.execute("SELECT version_num FROM conflictdb.alembic_version").fetchone() or ()

        def revise(revision: str) -> None:
            admin.execute("UPDATE conflictdb.alembic_version SET version_num = %s", (revision,))

        borrow(pool)
        revise("0001")
        borrow(pool)
        with pool.connection() as lent, pytest.raises(StoreError, match="42883"), store.transaction(lent):
            connection.call(lent, "routine_of_another_program")
        with pytest.raises(SchemaOutdated):
            borrow(pool)
        revise(newest)
        borrow(pool)
        revise("0001")
        borrow(pool)
        with monkeypatch.context() as patched:
            patched.setattr(fit_connections, "FIT_FOR_S", 0.0)
            with pytest.raises(SchemaOutdated):
                borrow(pool)
        revise(newest)
        borrow(pool)
        assert schema.upgrade(dsn) == newest
        revise("0001")
        with pytest.raises(SchemaOutdated):
            borrow(pool)
        revise(newest)
