"""Which connections have the schema of this program: a pool lends each of them again and again."""

import time
from typing import Any, Final
from weakref import WeakKeyDictionary

import psycopg

# A schema that another program upgrades, or drops, is noticed after this time, or by the first name that it lacks.
FIT_FOR_S: Final = 60.0
# SQLSTATEs of names that a database lacks: schema, table, column, function, type.
NAMES_MISSING: Final = ("3F000", "42P01", "42703", "42883", "42704")

_CHECKED_S: Final[WeakKeyDictionary[psycopg.Connection[Any], float]] = WeakKeyDictionary()


def is_fit(conn: psycopg.Connection[Any]) -> bool:
    """Return whether the schema was checked on this connection, less than FIT_FOR_S ago."""
    return time.monotonic() - _CHECKED_S.get(conn, float("-inf")) < FIT_FOR_S


def note_fit(conn: psycopg.Connection[Any]) -> None:
    """Remember that this connection has the schema of this program; a connection made in its place is another one."""
    _CHECKED_S[conn] = time.monotonic()


def forget_fit() -> None:
    """Let all connections be checked again."""
    _CHECKED_S.clear()
