"""Sessions of a database that the commands of a test use in turn, each as if it were new."""

from functools import partial
from typing import Any

import psycopg
from psycopg.pq import TransactionStatus
from reused import FORGET_ALL, state_of

from conflictdb.store.fit_connections import forget_fit

# Settings that a new session would have.
SET_FOR_SESSIONS = """
SELECT array_agg(setconfig ORDER BY setdatabase, setrole)::text FROM pg_db_role_setting
WHERE setrole IN (0, current_user::regrole)
      AND setdatabase IN (0, (SELECT oid FROM pg_database WHERE datname = current_database()))
"""


class LentSessions:
    """Sessions that are lent again when they are closed.

    New sessions take the server 75 ms to read catalogs and to compile routines, more than most commands.
    """

    def __init__(self) -> None:
        self._free: dict[str, psycopg.Connection[Any]] = {}
        self._before: dict[psycopg.Connection[Any], tuple[list[object], object]] = {}

    def connect(self, dsn: str, **options: Any) -> psycopg.Connection[Any]:
        """Do what `psycopg.connect` does."""
        conn = self._free.pop(dsn, None)
        if conn is not None:
            try:
                if self._settings(conn) == self._before[conn][1]:
                    return conn
            except psycopg.Error:
                pass  # the test ended the session
            self._end(conn)
        conn = psycopg.connect(dsn, **options)
        state = state_of(conn)
        self._before[conn] = state, self._settings(conn)
        conn.close = partial(self._give_back, dsn, conn)  # type: ignore[method-assign]
        return conn

    def close(self) -> None:
        """End those that nobody uses."""
        for conn in self._free.values():
            self._end(conn)
        self._free.clear()

    def _give_back(self, dsn: str, conn: psycopg.Connection[Any]) -> None:
        if conn.closed or conn in self._free.values():
            return
        try:
            if dsn not in self._free and conn.info.transaction_status is not TransactionStatus.ACTIVE:
                conn.rollback()
                if state_of(conn) == self._before[conn][0]:
                    conn.autocommit = True
                    conn.execute(FORGET_ALL)
                    conn.autocommit = False
                    forget_fit()
                    self._free[dsn] = conn
                    return
        except psycopg.Error:
            pass  # the server ended the session
        self._end(conn)

    def _end(self, conn: psycopg.Connection[Any]) -> None:
        del self._before[conn]
        psycopg.Connection.close(conn)

    @staticmethod
    def _settings(conn: psycopg.Connection[Any]) -> object:
        settings = conn.execute(SET_FOR_SESSIONS).fetchone()
        conn.rollback()
        return settings
