"""Use a connection of the caller, also of SQLAlchemy: fetched for each use, within the caller's transaction."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import psycopg

from conflictdb import store
from conflictdb.errors import InvalidInput

if TYPE_CHECKING:
    from sqlalchemy import Connection, Engine
    from sqlalchemy.orm import Session


# Returns a caller's connection, for each use anew: its owner may replace it, or begin a transaction, in between.
Borrowed = Callable[[], psycopg.Connection[Any]]


def borrow(
    target: "psycopg.Connection[Any] | Engine | Connection | Session",
) -> tuple[Borrowed, list[Callable[[], None]]]:
    """Return a borrowed connection and the functions that release it; raises InvalidInput for other targets."""
    if isinstance(target, psycopg.Connection):
        return lambda: target, []
    from sqlalchemy import Connection, Engine
    from sqlalchemy.orm import Session

    bind = target.get_bind() if isinstance(target, Session) else target
    driver = bind.dialect.driver if isinstance(bind, Connection | Engine) else None
    if driver != "psycopg":
        what = f"one with driver {driver!r}" if driver else f"a {type(target).__name__}"
        rule = "must be a DSN, a psycopg 3 connection, or an SQLAlchemy engine, connection or session"
        raise InvalidInput("connect", "target", f"{rule} of postgresql+psycopg; got {what}")
    if isinstance(target, Engine):
        pooled = target.raw_connection()
        return lambda: cast("psycopg.Connection[Any]", pooled.driver_connection), [pooled.close]
    if isinstance(target, Session):
        return lambda: _of_session(target), []
    return lambda: _of_connection(target), []


def _of_connection(lender: "Connection") -> "psycopg.Connection[Any]":
    """Return the psycopg connection of an SQLAlchemy connection, in a transaction if SQLAlchemy considers it in one."""
    connection = cast("psycopg.Connection[Any]", lender.connection.driver_connection)
    if lender.in_transaction():
        store.join(connection)
    return connection


def _of_session(lender: "Session") -> "psycopg.Connection[Any]":
    """Return the connection of a session in its transaction, after writing pending changes, as before any query."""
    if lender.autoflush:
        lender.flush()
    return _of_connection(lender.connection())
