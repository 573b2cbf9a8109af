"""Connections, transactions and the one border where psycopg's errors become this package's."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import psycopg
from psycopg.pq import TransactionStatus
from psycopg.rows import tuple_row

from conflictdb.errors import ConflictDBError, InvalidInput, LockTimeout, StoreError

# SQLSTATE class of the refusals of sql/10_refusals.sql; one of them is not about input.
REFUSAL_CLASS: Final = "ZC"
WRONG_SEQUENCE: Final = "ZC013"


def connect(dsn: str) -> psycopg.Connection[Any]:
    """Return a connection whose sessions show instants in UTC; raises StoreError if it cannot be made."""
    with translated():
        conn = psycopg.connect(dsn)
        try:
            conn.execute("SELECT set_config('TimeZone', 'UTC', false)")
            conn.commit()
        except BaseException:
            conn.close()
            raise
    return conn


@contextmanager
def translated() -> Iterator[None]:
    """Turn psycopg's errors into InvalidInput (the database refused a row) or StoreError (anything else)."""
    try:
        yield
    except psycopg.Error as error:
        raise _translation(error) from error


def call(conn: psycopg.Connection[Any], routine: str, *arguments: object) -> tuple[Any, ...]:
    """Return the single row of a routine of the schema conflictdb."""
    rows = call_many(conn, routine, *arguments)
    return rows[0]


def call_many(conn: psycopg.Connection[Any], routine: str, *arguments: object) -> list[tuple[Any, ...]]:
    """Return the rows of a routine of the schema conflictdb."""
    places = ", ".join(["%s"] * len(arguments))
    with translated(), conn.cursor(row_factory=tuple_row) as cursor:
        # Names of routines come from this package only, values are always parameters.
        cursor.execute(f"SELECT * FROM conflictdb.{routine}({places})".encode(), arguments)  # noqa: S608
        return cursor.fetchall()


@contextmanager
def transaction(conn: psycopg.Connection[Any]) -> Iterator[None]:
    """Do everything inside or nothing; an open transaction of the caller's goes on, otherwise none stays open."""
    with translated(), conn.transaction():
        yield


def require_idle(conn: psycopg.Connection[Any], what: str) -> None:
    """Raise StoreError if a transaction is open."""
    if conn.info.transaction_status != TransactionStatus.IDLE:
        raise StoreError(f"{what} needs a connection without an open transaction: commit or roll back first")


def begin_snapshot(conn: psycopg.Connection[Any]) -> None:
    """Begin a transaction that sees one state of the database throughout; commit or roll back ends it."""
    require_idle(conn, "a snapshot")
    begin = "BEGIN" if conn.autocommit else "SET TRANSACTION"
    with translated():
        conn.execute(f"{begin} ISOLATION LEVEL REPEATABLE READ".encode())


def _translation(error: psycopg.Error) -> ConflictDBError:
    if (error.sqlstate or "").startswith(REFUSAL_CLASS) and error.sqlstate != WRONG_SEQUENCE:
        diag = error.diag
        key, field = diag.message_detail or "", diag.column_name or ""
        rule = (diag.message_primary or "").removeprefix(f"{key}: {field}: ")
        return InvalidInput(key, field, f"{rule} ({diag.message_hint})" if diag.message_hint else rule)
    where = f" (SQLSTATE {error.sqlstate})" if error.sqlstate else ""
    kind = LockTimeout if isinstance(error, psycopg.errors.LockNotAvailable) else StoreError
    return kind(f"database: {str(error).strip()}{where}")
