"""Tables of others that are attached to scenes: attach, detach, and take over rows that changed."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from tempfile import SpooledTemporaryFile
from typing import IO, Any, Final, cast

import psycopg
from psycopg.types.json import Jsonb

from conflictdb.db.store.connection import (
    call,
    call_by_name,
    call_many,
    require_idle,
    require_writable,
    transaction,
    translated,
)
from conflictdb.errors import ConflictDBError, InvalidInput

# Rows that are read are kept so far in memory, the rest in a temporary file, until they are written.
_IN_MEMORY_BYTES: Final = 64_000_000
# What is foreign code must come to an end, also if somebody has locked the table.
_READ_WITHIN: Final = "10min"
_LOCK_WITHIN: Final = "10s"
_BLOCK_BYTES: Final = 65_536
_WRONG_NAMES: Final = (
    psycopg.errors.UndefinedTable,
    psycopg.errors.InvalidName,
    psycopg.errors.InvalidSchemaName,
    psycopg.errors.InvalidParameterValue,
)


@dataclass(frozen=True, slots=True)
class Attachment:
    """A table that is attached to a scene: a row of the view `attachments`, which says what the fields are."""

    scene: str
    attachment_id: int
    kind: str
    table: str
    map: dict[str, str]
    role: str | None
    has_triggers: bool
    every: timedelta
    objects: int
    unmapped: int
    is_waiting: bool
    compared_at: datetime | None
    failed_at: datetime | None
    error: str | None
    remark: str | None


@dataclass(frozen=True, slots=True)
class Unmapped:
    """A row of an attached table that is no object, or not as it is now: a row of the view `unmapped`."""

    scene: str
    attachment_id: int
    table: str
    identity_columns: list[str]
    identity: str
    key: str | None
    reason: str
    since: datetime
    is_kept: bool


@dataclass(frozen=True, slots=True)
class AttachmentPreview:
    """What attaching a table would do.

    steps : in words
    objects : the first objects, each a feature of a scene file (JSON)
    unmapped : why others of the first cannot be made
    """

    steps: list[str]
    objects: list[str]
    unmapped: list[str]


@dataclass(frozen=True, slots=True)
class AttachedWork:
    """What there is to do for an attachment, as the transaction sees it.

    turn : how often rows were taken over before
    change_ids : notes of changes that are to be done with
    is_full : whether all rows are compared
    """

    turn: int
    change_ids: list[int]
    is_full: bool


@dataclass(frozen=True, slots=True)
class TakenOver:
    """What became of rows of an attached table: objects made or found right, objects removed, rows left out."""

    mapped: int
    removed: int
    unmapped: int


def attach(
    conn: psycopg.Connection[Any], scene: str, kind: str, table: str, mapped: Mapping[str, str], every: timedelta | None
) -> int:
    """Attach a table to a scene, in one transaction, and return the number of the attachment.

    Raises InvalidInput if the table or the map cannot be used; then nothing is changed.
    """
    require_writable(conn)
    with transaction(conn), _named(table):
        return int(call(conn, "attach", scene, kind, table, Jsonb(dict(mapped)), every)[0])


def preview_attachment(
    conn: psycopg.Connection[Any], scene: str, kind: str, table: str, mapped: Mapping[str, str], every: timedelta | None
) -> AttachmentPreview:
    """Return what `attach` would do; changes nothing. Raises InvalidInput as `attach` does."""
    parts: dict[str, list[str]] = {"would": [], "object": [], "unmapped": []}
    require_writable(conn)
    with transaction(conn), _named(table):
        for part, what in call_many(conn, "preview_attachment", scene, kind, table, Jsonb(dict(mapped)), every):
            parts[part].append(what)
    return AttachmentPreview(parts["would"], parts["object"], parts["unmapped"])


def detach(conn: psycopg.Connection[Any], scene: str, table: str, *, keep: bool) -> int:
    """Detach a table from a scene, in one transaction, and return how many objects were removed."""
    require_writable(conn)
    with transaction(conn), _named(table):
        return int(call(conn, "detach", scene, table, keep)[0])


def attachments(conn: psycopg.Connection[Any], scene: str | None) -> list[Attachment]:
    """Return what is attached to a scene, or to all."""
    with transaction(conn):
        return [Attachment(**row) for row in call_by_name(conn, "_attachments", scene)]


def unmapped(conn: psycopg.Connection[Any], scene: str) -> list[Unmapped]:
    """Return the rows of attached tables that are no objects of a scene, or not as they are now."""
    with transaction(conn):
        return [Unmapped(**row) for row in call_by_name(conn, "_unmapped", scene)]


def attachments_to_follow(conn: psycopg.Connection[Any], scene: str, *, again: bool) -> list[int]:
    """Return the attachments of a scene whose rows changed or are to be compared.

    again : also those that failed within the last minute
    """
    with transaction(conn):
        return [number for (number,) in call_many(conn, "_attachments_to_follow", scene, again)]


def read_attached(
    conn: psycopg.Connection[Any], attachment_id: int, rows: IO[bytes], *, carefully: bool
) -> AttachedWork:
    """Write the rows that changed to a file, as COPY has them in binary, and return what is done with them.

    Runs code of whoever attached the table, in a transaction that is rolled back: neither its settings nor anything
    else of it lasts.

    carefully : one row after the other, so that one that cannot be mapped says why, and the others come all the same
    """
    with _rolled_back(conn):
        work = AttachedWork(*call(conn, "_attached_work", attachment_id))
        query = b"COPY (SELECT * FROM conflictdb._attached_rows(%s, %s, %s, %s)) TO STDOUT (FORMAT BINARY)"
        arguments = (attachment_id, work.change_ids, work.is_full, "carefully" if carefully else "rows")
        with translated(), conn.cursor() as cursor, cursor.copy(query, arguments) as copy:
            for block in copy:
                rows.write(block)
    return work


def take_over_attached(
    conn: psycopg.Connection[Any], attachment_id: int, work: AttachedWork, rows: IO[bytes]
) -> TakenOver | None:
    """Make objects of rows that `read_attached` wrote, in one transaction; None if somebody else was quicker."""
    with transaction(conn):
        call(conn, "_begin_attached")
        with conn.cursor() as cursor, cursor.copy(b"COPY pg_temp.staged_attached FROM STDIN (FORMAT BINARY)") as copy:
            while block := rows.read(_BLOCK_BYTES):
                copy.write(block)
        is_done, *counts = call(conn, "_take_over_attached", attachment_id, work.turn, work.change_ids, work.is_full)
    return TakenOver(*counts) if is_done else None


def attachment_failed(conn: psycopg.Connection[Any], attachment_id: int, error: str) -> None:
    """Record why an attached table cannot be read."""
    with transaction(conn):
        call(conn, "_attachment_failed", attachment_id, error)


def seconds_to_comparison(conn: psycopg.Connection[Any]) -> float | None:
    """Return after how many seconds the next attached table is to be compared; None if none is attached."""
    with transaction(conn):
        found = call(conn, "_seconds_to_comparison")[0]
    return None if found is None else float(found)


def kept_rows() -> IO[bytes]:
    """Return a file for rows between two transactions: in memory, unless there are very many."""
    return cast("IO[bytes]", SpooledTemporaryFile(max_size=_IN_MEMORY_BYTES))


@contextmanager
def _rolled_back(conn: psycopg.Connection[Any]) -> Iterator[None]:
    """Read on one snapshot, change nothing, and leave nothing in the session."""
    require_idle(conn, "reading an attached table")
    begin = "BEGIN" if conn.autocommit else "SET TRANSACTION"
    try:
        with translated():
            conn.execute(f"{begin} ISOLATION LEVEL REPEATABLE READ READ ONLY".encode(), prepare=False)
            conn.execute(
                f"SELECT set_config('statement_timeout', '{_READ_WITHIN}', true), "
                f"set_config('lock_timeout', '{_LOCK_WITHIN}', true), "
                "set_config('client_encoding', 'UTF8', true)".encode(),
                prepare=False,
            )
        yield
    finally:
        if not conn.closed:
            with translated():
                conn.rollback()


@contextmanager
def _named(table: str) -> Iterator[None]:
    """Turn the server's error about the name of a table into InvalidInput."""
    try:
        yield
    except ConflictDBError as error:
        cause = error.__cause__
        if isinstance(cause, _WRONG_NAMES):
            raise InvalidInput(f"table {table!r}", "name", str(cause.diag.message_primary)) from cause
        raise
