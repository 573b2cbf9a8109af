"""Connections of SQLAlchemy that the caller lends: asked for whenever they are needed, in the caller's transaction."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from conflictdb.db import store
from conflictdb.errors import InvalidInput

if TYPE_CHECKING:
    import psycopg
    from sqlalchemy import Connection, Engine
    from sqlalchemy.orm import Session


@dataclass(frozen=True, slots=True)
class Lent:
    """A connection that is asked for whenever it is needed: what lends it may have another, or begin a transaction."""

    connection: "Callable[[], psycopg.Connection[Any]]"


def lend(target: "Engine | Connection | Session") -> tuple[Lent, list[Callable[[], None]]]:
    """Return what lends a connection, and what gives it back; raises InvalidInput for anything else."""
    from sqlalchemy import Connection, Engine
    from sqlalchemy.orm import Session

    bind = target.get_bind() if isinstance(target, Session) else target
    driver = bind.dialect.driver if isinstance(bind, Connection | Engine) else None
    if driver != "psycopg":
        what = f"one with driver {driver!r}" if driver else f"a {type(target).__name__}"
        rule = "must be a DSN, a psycopg 3 connection, or an SQLAlchemy engine, connection or session"
        raise InvalidInput("connect", "target", f"{rule} of postgresql+psycopg; got {what}")
    release: list[Callable[[], None]] = []
    if isinstance(target, Engine):
        pooled = target.raw_connection()
        lent = Lent(lambda: cast("psycopg.Connection[Any]", pooled.driver_connection))
        release = [pooled.close]
    elif isinstance(target, Session):
        lent = Lent(lambda: _of_session(target))
    else:
        lent = Lent(lambda: _of_connection(target))
    return lent, release


def _of_connection(lender: "Connection") -> "psycopg.Connection[Any]":
    """Return the connection behind one of SQLAlchemy, in a transaction if that says that it is in one.

    SQLAlchemy leaves it to the first statement to begin it; then this one would be a transaction of its own.
    """
    connection = cast("psycopg.Connection[Any]", lender.connection.driver_connection)
    if lender.in_transaction():
        store.join(connection)
    return connection


def _of_session(lender: "Session") -> "psycopg.Connection[Any]":
    """Return the connection of a session in its transaction, what is pending written, as before any query of it."""
    if lender.autoflush:
        lender.flush()
    return _of_connection(lender.connection())
