"""Open connections, run transactions, and convert psycopg's errors to this package's: the only place that does."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import count
from math import ceil
from typing import Any, Final, TypeVar
from weakref import WeakKeyDictionary

import psycopg
from psycopg.postgres import types
from psycopg.pq import TransactionStatus
from psycopg.rows import RowFactory, RowMaker, tuple_row

from conflictdb.errors import (
    ConflictDBError,
    InvalidInput,
    LockTimeout,
    NotCurrent,
    NotPermitted,
    ReadOnlyDatabase,
    StoreError,
)
from conflictdb.store.fit_connections import NAMES_MISSING, forget_fit
from conflictdb.store.parameters import Array, ArrayDumper
from conflictdb.store.remedies import with_remedy

# SQLSTATE class of the errors of sql/10_refusals.sql. Some of them do not concern input.
REFUSAL_CLASS: Final = "ZC"
WRONG_SEQUENCE: Final = "ZC013"
NOT_CURRENT: Final = "ZC014"
NOT_ANSWERED: Final = "ZC015"

# COPY sends and receives texts as UTF-8, so the connection must use it.
_ENCODING: Final = "UTF8"

# Rows of a long answer fetched at a time: bounds the memory of reading it.
_ROWS_AT_ONCE: Final = 2_000
_CURSORS: Final = count()  # unique names of cursors
_INSTANT: Final = types["timestamptz"].oid

# Any role that may delete rows of a table may lock it. Connections of this program wait at most this long for a lock,
# unless the role or database sets a limit.
LOCK_WAIT_S: Final = 300.0
# Seconds that transactions begun on a connection wait for a lock.
_WAITS: Final[WeakKeyDictionary[psycopg.Connection[Any], float]] = WeakKeyDictionary()
# Sessions that hold a lock. Both sides of each operator have the same type.
_LOCK_HOLDERS: Final = """
SELECT a.pid, a.application_name, coalesce(a.usename, ''::name)::text, a.xact_start
FROM pg_catalog.pg_stat_activity a
WHERE a.pid <> pg_backend_pid()
  AND EXISTS (SELECT FROM pg_catalog.pg_locks l LEFT JOIN pg_catalog.pg_class c ON c.oid = l.relation
              WHERE l.pid = a.pid AND l.granted AND ({which})
                AND l.database = (SELECT d.oid FROM pg_catalog.pg_database d WHERE d.datname = current_database()))
ORDER BY a.xact_start, a.pid
"""
ON_OUR_TABLE: Final = "c.relnamespace = to_regnamespace('conflictdb')::oid"
_BLOCKS_WRITERS: Final = (
    f"{ON_OUR_TABLE} AND l.mode IN ('ShareLock', 'ShareRowExclusiveLock', 'ExclusiveLock', 'AccessExclusiveLock')"
)

# Characters that the encoding and PostgreSQL's type text cannot store.
_TEXT_RULE: Final = "must have no NUL character and no unpaired surrogate"
# SQLSTATEs that end a session: admin_shutdown, crash_shutdown, idle_in_transaction_session_timeout,
# idle_session_timeout; and the class of connection exceptions.
_SESSION_ENDS: Final = ("57P01", "57P02", "25P03", "57P05")
_CONNECTION_CLASS: Final = "08"
_BREAK: Final = "\n"
_LOST: Final = "the connection to the database is lost"
_LOST_BEFORE: Final = ("the connection is lost", "the connection is closed")  # psycopg's messages without a reason

_Row = TypeVar("_Row")

# Whether a user may use the schema, one of its routines and temporary tables, and the least role that may call that
# routine. Each role includes the rights of the roles before it (sql/05_roles.sql).
_RIGHTS: Final = """
SELECT pg_catalog.quote_ident(current_user), pg_catalog.quote_ident(current_database()),
       has_schema_privilege('conflictdb', 'USAGE'),
       coalesce((SELECT bool_and(has_function_privilege(p.oid, 'EXECUTE')) FROM pg_catalog.pg_proc p
                 WHERE p.pronamespace = to_regnamespace(%(schema)s)::oid AND p.proname = %(routine)s::name), true),
       has_database_privilege(current_database(), 'TEMPORARY'),
       (SELECT r.rolname FROM pg_catalog.pg_roles r
        WHERE r.rolname IN ('conflictdb_reader', 'conflictdb_editor', 'conflictdb_worker')
              AND (SELECT bool_and(has_function_privilege(r.oid, p.oid, 'EXECUTE')) FROM pg_catalog.pg_proc p
                   WHERE p.pronamespace = to_regnamespace(%(schema)s)::oid AND p.proname = %(routine)s::name)
        ORDER BY pg_catalog.array_position(ARRAY['conflictdb_reader', 'conflictdb_editor'], r.rolname::text) LIMIT 1)
"""


@dataclass(frozen=True, slots=True)
class Holder:
    """The session that holds a lock, as far as the server shows it; `str` gives text for people."""

    pid: int
    application: str
    role: str
    since: datetime | None

    def __str__(self) -> str:
        since = f", since {self.since.astimezone(UTC):%Y-%m-%d %H:%M:%S} UTC" if self.since else ""
        application = f", {self.application!r}" if self.application else ""
        return f"process {self.pid} of the server (user {self.role!r}{application}{since})"


def connect(dsn: str) -> psycopg.Connection[Any]:
    """Return a connection that shows instants in UTC and ISO 8601; raises StoreError if it cannot connect.

    It works behind poolers that give each transaction another session. Statements are not prepared. The only settings
    are those that poolers keep per client (PgBouncer: TimeZone, DateStyle, client_encoding), and
    client_connection_check_interval, which does not harm other clients.

    Its transactions (`transaction`, `begin_snapshot`) wait LOCK_WAIT_S for a lock, or as long as the role or database
    sets.

    If this process is killed, the server notices within a second and stops its work.
    """
    with translated():
        conn = psycopg.connect(dsn, client_encoding=_ENCODING, prepare_threshold=None)
        try:
            row = conn.execute(
                "SELECT current_setting('lock_timeout'), set_config('TimeZone', 'UTC', false), "
                "set_config('DateStyle', 'ISO', false)"
            ).fetchone()
            if row is not None and row[0] == "0":
                _WAITS[conn] = LOCK_WAIT_S
            with suppress(psycopg.errors.InvalidParameterValue), conn.transaction():
                conn.execute("SELECT set_config('client_connection_check_interval', '1s', false)")
            conn.commit()
        except BaseException:
            conn.close()
            raise
    return conn


@contextmanager
def translated(routine: str = "") -> Iterator[None]:
    """Convert psycopg's errors to InvalidInput (a row or text is refused) or StoreError (all others).

    routine : the routine of schema conflictdb that is called, for `naming_grants`
    """
    try:
        yield
    except psycopg.Error as error:
        raise _translation(error, routine) from error
    except UnicodeEncodeError as error:  # a parameter with an unpaired surrogate
        raise InvalidInput("", "text", _TEXT_RULE) from error


@contextmanager
def naming_grants(conn: psycopg.Connection[Any]) -> Iterator[None]:
    """Make NotPermitted name the missing grant and LockTimeout the sessions that hold the lock, where they are known.

    The caller must roll back statements that fail inside.
    """
    try:
        yield
    except LockTimeout as timeout:
        if not isinstance(timeout.__cause__, psycopg.errors.LockNotAvailable) or "; locked by: " in str(timeout):
            raise
        holders: list[Holder] = []
        with suppress(psycopg.Error):
            holders = lock_holders(conn, _BLOCKS_WRITERS)
        if not holders:
            raise
        raise LockTimeout(f"{timeout}; locked by: {' and '.join(map(str, holders))}") from timeout.__cause__
    except NotPermitted as refused:
        missing, cause = None, refused.__cause__
        if isinstance(cause, psycopg.Error) and refused.routine is not None:
            with suppress(psycopg.Error):
                missing = _missing_grant(conn, cause, refused.routine)
        if missing is None:
            raise
        (user, grant), message = missing, str(cause).partition("\n")[0]
        raise NotPermitted(
            f"user {user} may not do this in database {conn.info.dbname!r} ({message}); "
            f"let an administrator run: {grant}"
        ) from cause


def _missing_grant(conn: psycopg.Connection[Any], refusal: psycopg.Error, routine: str) -> tuple[str, str] | None:
    """Return the user, and the grant that the user lacks for a refused routine; None if it is unknown."""
    if conn.info.transaction_status not in (TransactionStatus.IDLE, TransactionStatus.INTRANS):
        return None
    with conn.transaction(), psycopg.Cursor(conn, row_factory=tuple_row) as cursor:
        names = {"schema": _schema_of(routine), "routine": routine}
        rights = cursor.execute(_RIGHTS.encode(), names, prepare=False).fetchone()
    if rights is None:
        return None
    user, database, may_use, may_call, may_have_tables, role = rights
    if not (may_use and may_call):
        if role is not None:
            return user, f"GRANT {role} TO {user}"
        more = "conflictdb_editor for who changes plans, conflictdb_worker for who detects them, too"
        return None if may_use else (user, f"GRANT conflictdb_reader TO {user} ({more})")
    # The statement inside the routine: servers translate messages, but not statements.
    statements = (refusal.diag.internal_query, refusal.diag.context)
    is_of_table = any("CREATE TEMPORARY TABLE" in statement for statement in statements if statement)
    if may_have_tables or not is_of_table:
        return None
    return user, f"GRANT TEMPORARY ON DATABASE {database} TO {user}"


def lock_holders(conn: psycopg.Connection[Any], which: str) -> list[Holder]:
    """Return the other sessions that hold a lock, as far as the server shows them.

    which : condition on the lock (l) and its table (c), SQL of this package
    """
    if conn.info.transaction_status not in (TransactionStatus.IDLE, TransactionStatus.INTRANS):
        return []
    with conn.transaction(), psycopg.Cursor(conn, row_factory=tuple_row) as cursor:
        query = _LOCK_HOLDERS.format(which=which).encode()
        return [Holder(*row) for row in cursor.execute(query, prepare=False, binary=True)]


def call(conn: psycopg.Connection[Any], routine: str, *arguments: object) -> tuple[Any, ...]:
    """Return the single row of a routine of schema conflictdb."""
    rows = call_many(conn, routine, *arguments)
    return rows[0]


def call_many(conn: psycopg.Connection[Any], routine: str, *arguments: object) -> list[tuple[Any, ...]]:
    """Return the rows of a routine of schema conflictdb."""
    return _rows(conn, tuple_row, routine, arguments)


def call_each(
    conn: psycopg.Connection[Any], routine: str, *arguments: object, rows_at_once: int | None = None
) -> Generator[tuple[Any, ...], None, None]:
    """Yield the rows of a routine of schema conflictdb, fetched as they are consumed; needs an open transaction."""
    return _each_row(conn, tuple_row, routine, arguments, rows_at_once or _ROWS_AT_ONCE)


def call_by_name(conn: psycopg.Connection[Any], routine: str, *arguments: object) -> list[dict[str, Any]]:
    """Return the rows of a routine of schema conflictdb as dictionaries by column name; instants in UTC."""
    return _rows(conn, _named_row, routine, arguments)


def call_each_by_name(
    conn: psycopg.Connection[Any], routine: str, *arguments: object
) -> Generator[dict[str, Any], None, None]:
    """Yield the rows of `call_by_name` as `call_each` does."""
    return _each_row(conn, _named_row, routine, arguments, _ROWS_AT_ONCE)


def _named_row(cursor: psycopg.Cursor[Any]) -> RowMaker[dict[str, Any]]:
    """Make dictionaries by column name, with instants in UTC whatever the time zone of the caller's connection."""
    names = [column.name for column in cursor.description or ()]
    instants = [column.name for column in cursor.description or () if column.type_code == _INSTANT]

    def make(row: Sequence[Any]) -> dict[str, Any]:
        columns = dict(zip(names, row, strict=True))
        for name in instants:
            if columns[name] is not None:
                columns[name] = columns[name].astimezone(UTC)
        return columns

    return make


class _Rows(psycopg.ServerCursor[_Row]):
    """A cursor that is closed even if closing it finds that the connection is lost."""

    def close(self) -> None:
        try:
            super().close()
        finally:
            psycopg.Cursor.close(self)


def _each_row(
    conn: psycopg.Connection[Any],
    row_factory: RowFactory[_Row],
    routine: str,
    arguments: Sequence[object],
    rows_at_once: int,
) -> Generator[_Row, None, None]:
    name = f"conflictdb_{next(_CURSORS)}"
    with translated(routine), _Rows(conn, name, row_factory=row_factory) as cursor:
        cursor.itersize = rows_at_once
        cursor.execute(query_of(routine, arguments), arguments, binary=True)
        yield from cursor


def _rows(
    conn: psycopg.Connection[Any], row_factory: RowFactory[_Row], routine: str, arguments: Sequence[object]
) -> list[_Row]:
    """Return the rows of a routine.

    Statements are not prepared: a pooler may run the next one in another session.
    """
    # Do not use the cursor class of the caller's connection: client-side cursors have no binary results.
    with translated(routine), psycopg.Cursor(conn, row_factory=row_factory) as cursor:
        if any(isinstance(argument, Array) for argument in arguments):
            cursor.adapters.register_dumper(Array, ArrayDumper)
        cursor.execute(query_of(routine, arguments), arguments, prepare=False, binary=True)
        return cursor.fetchall()


def query_of(routine: str, arguments: Sequence[object]) -> bytes:
    """Return the statement that calls a routine of conflictdb, with a parameter for each argument."""
    # Names of routines come from this package only; values are always parameters.
    called = f"{_schema_of(routine)}.{routine}({', '.join(['%s'] * len(arguments))})"
    return f"SELECT * FROM {called}".encode()  # noqa: S608


def _schema_of(routine: str) -> str:
    return "conflictdb_internal" if routine.startswith("_") else "conflictdb"


@contextmanager
def transaction(conn: psycopg.Connection[Any]) -> Iterator[None]:
    """Run the block atomically: in the caller's open transaction, or in one of its own, which it ends."""
    is_own = conn.info.transaction_status == TransactionStatus.IDLE
    with naming_grants(conn), translated(), conn.transaction():
        if is_own and conn in _WAITS:
            conn.execute(_limit(_WAITS[conn]), prepare=False)
        former = _use_utf8(conn)
        yield
        if former is not None:
            _set_encoding(conn, former)


@contextmanager
def waiting_at_most(conn: psycopg.Connection[Any], lock_timeout_s: float | None) -> Iterator[None]:
    """Limit how long transactions begun inside wait for a lock, seconds; None keeps the present limit."""
    former = _WAITS.get(conn)
    if lock_timeout_s is not None:
        _WAITS[conn] = lock_timeout_s
    try:
        yield
    finally:
        if former is None:
            _WAITS.pop(conn, None)
        else:
            _WAITS[conn] = former


def _limit(lock_timeout_s: float) -> bytes:
    """Return the statement that limits the open transaction's lock wait; 0 s becomes 1 ms (0: no limit)."""
    return f"SET LOCAL lock_timeout = {min(max(1, ceil(1000 * lock_timeout_s)), 2**31 - 1)}; ".encode()


@contextmanager
def snapshot(conn: psycopg.Connection[Any]) -> Iterator[None]:
    """Read one state of the database inside; in an open transaction of the caller, the state that it sees."""
    is_own = conn.info.transaction_status == TransactionStatus.IDLE
    with transaction(conn):
        if is_own:
            conn.execute(b"SET TRANSACTION ISOLATION LEVEL REPEATABLE READ", prepare=False)
        yield


def _use_utf8(conn: psycopg.Connection[Any]) -> str | None:
    """Set the open transaction's encoding to UTF-8; return the former encoding, None if it was UTF-8."""
    former = conn.info.parameter_status("client_encoding")
    if former == _ENCODING:
        return None
    _set_encoding(conn, _ENCODING)
    return former


def _set_encoding(conn: psycopg.Connection[Any], name: str) -> None:
    # The name of the encoding comes from the server.
    conn.execute(f"SET LOCAL client_encoding = '{name}'".encode(), prepare=False)


def require_writable(conn: psycopg.Connection[Any]) -> None:
    """Raise ReadOnlyDatabase if the server reports that this connection cannot write."""
    where = f"database {conn.info.dbname!r} on {conn.info.host}"
    if conn.info.parameter_status("in_hot_standby") == "on":
        raise ReadOnlyDatabase(f"{where} is a hot standby, which takes no changes: connect to the primary server")
    if conn.info.parameter_status("default_transaction_read_only") == "on":
        raise ReadOnlyDatabase(
            f"transactions on {where} are read-only by default: turn off default_transaction_read_only for user "
            f"{conn.info.user!r}, or connect as another user"
        )


def require_detecting(conn: psycopg.Connection[Any]) -> None:
    """Raise ReadOnlyDatabase if the user of this connection may not write conflicts."""
    statement = "SELECT has_table_privilege('conflictdb.conflict', 'INSERT'), pg_catalog.quote_ident(current_user)"
    with translated(), conn.transaction(), psycopg.Cursor(conn, row_factory=tuple_row) as cursor:
        row = cursor.execute(statement, prepare=False).fetchone()
    if row is not None and not row[0]:
        raise ReadOnlyDatabase(
            f"user {row[1]} may not detect in database {conn.info.dbname!r}; let an administrator run: "
            f"GRANT conflictdb_worker TO {row[1]}"
        )


def require_idle(conn: psycopg.Connection[Any], what: str) -> None:
    """Raise StoreError if a transaction is open, or the connection is lost."""
    if conn.closed:
        raise StoreError(_LOST)
    if conn.info.transaction_status != TransactionStatus.IDLE:
        raise StoreError(f"{what} needs a connection without an open transaction: commit or roll back first")


def join(conn: psycopg.Connection[Any]) -> None:
    """Begin the transaction that the caller expects to be open; with autocommit do nothing."""
    if not conn.autocommit and conn.info.transaction_status == TransactionStatus.IDLE:
        with translated():
            conn.execute("SELECT", prepare=False)  # any statement begins it


def begin_snapshot(conn: psycopg.Connection[Any], first: str = "", routine: str = "") -> None:
    """Begin a transaction that sees one state of the database; commit or roll back ends it.

    first : a statement sent along, whose result is discarded
    routine : the routine that `first` calls
    """
    require_idle(conn, "a snapshot")
    begin = b"BEGIN" if conn.autocommit else b"SET TRANSACTION"
    limit = _limit(_WAITS[conn]) if conn in _WAITS else b""
    with translated(routine):
        conn.execute(begin + b" ISOLATION LEVEL REPEATABLE READ; " + limit + first.encode(), prepare=False)
        _use_utf8(conn)


def _translation(error: psycopg.Error, routine: str) -> ConflictDBError:
    if isinstance(error, psycopg.DataError) and error.sqlstate is None and "NUL" in str(error):
        return InvalidInput("", "text", _TEXT_RULE)
    if _is_loss(error):
        reason = str(error).strip().partition(_BREAK)[0]
        return StoreError(_LOST if reason in _LOST_BEFORE else f"{_LOST}: {reason}")
    if error.sqlstate in (NOT_CURRENT, NOT_ANSWERED):
        return NotCurrent(with_remedy(error.diag))
    if (error.sqlstate or "").startswith(REFUSAL_CLASS) and error.sqlstate != WRONG_SEQUENCE:
        diag = error.diag
        key, field = diag.table_name or "", diag.column_name or ""
        rule = (diag.message_primary or "").removeprefix(f"{key}: {field}: ")
        return InvalidInput(key, field, with_remedy(diag, rule))
    if error.sqlstate in NAMES_MISSING:
        forget_fit()
    where = f" (SQLSTATE {error.sqlstate})" if error.sqlstate else ""
    said = with_remedy(error.diag) or str(error).strip()  # errors of the client have no diagnostic
    if isinstance(error, psycopg.errors.ReadOnlySqlTransaction):
        return ReadOnlyDatabase(
            f"the database takes no changes in this transaction: {said}; connect to the primary server, or"
            " turn off the setting that makes transactions read-only"
        )
    message = f"database: {said}{where}"
    if isinstance(error, psycopg.errors.InsufficientPrivilege):
        # Errors of sql/10_refusals.sql name their subject and the remedy themselves.
        return NotPermitted(message, None if error.diag.table_name else routine)
    kind = LockTimeout if isinstance(error, psycopg.errors.LockNotAvailable) else StoreError
    return kind(message)


def _is_loss(error: psycopg.Error) -> bool:
    """Return whether an established connection was lost."""
    if not isinstance(error, psycopg.OperationalError | psycopg.InternalError) or error.pgconn is not None:
        return False  # pgconn: the connection was never established
    if error.sqlstate is None:
        return isinstance(error, psycopg.OperationalError)
    return error.sqlstate in _SESSION_ENDS or error.sqlstate.startswith(_CONNECTION_CLASS)
