"""Attach tables of other schemas to scenes, detach them, follow their changes."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Final

import psycopg
from psycopg.types.json import Jsonb

from conflictdb.errors import ConflictDBError, InvalidInput
from conflictdb.store.connection import (
    call,
    call_by_name,
    call_many,
    require_idle,
    require_writable,
    transaction,
)

# Limits for running a map: it must end even if another session has locked the table.
READ_WITHIN_S: Final = 600.0
_LOCK_WITHIN: Final = "10s"
_WRONG_NAMES: Final = (
    psycopg.errors.UndefinedTable,
    psycopg.errors.InvalidName,
    psycopg.errors.InvalidSchemaName,
    psycopg.errors.InvalidParameterValue,
)


@dataclass(frozen=True, slots=True)
class Attachment:
    """A table that is attached to a scene: a row of the view `attachments`, whose comments describe the fields."""

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
    """A row of an attached table without an object, or whose object is out of date: a row of the view `unmapped`."""

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
    """The effect that attaching a table would have.

    steps : the steps, as sentences
    objects : the first objects, each a feature of a scene file (JSON)
    unmapped : for rows among the first that cannot become objects, the reasons
    """

    steps: list[str]
    objects: list[str]
    unmapped: list[str]


def attach(
    conn: psycopg.Connection[Any], scene: str, kind: str, table: str, mapped: Mapping[str, str], every: timedelta | None
) -> int:
    """Attach a table to a scene, in one transaction; return the number of the attachment.

    Raises InvalidInput, and changes nothing, if the table or the map cannot be used.
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
    """Detach a table from a scene, in one transaction; return the number of objects removed."""
    require_writable(conn)
    with transaction(conn), _named(table):
        return int(call(conn, "detach", scene, table, keep)[0])


def attachments(conn: psycopg.Connection[Any], scene: str | None) -> list[Attachment]:
    """Return the tables attached to a scene; None: to any scene."""
    with transaction(conn):
        return [Attachment(**row) for row in call_by_name(conn, "_attachments", scene)]


def unmapped(conn: psycopg.Connection[Any], scene: str) -> list[Unmapped]:
    """Return the rows of a scene's attached tables that have no object, or whose object is out of date."""
    with transaction(conn):
        return [Unmapped(**row) for row in call_by_name(conn, "_unmapped", scene)]


def attachments_to_follow(conn: psycopg.Connection[Any], scene: str, *, again: bool) -> list[int]:
    """Return the attachments of a scene, made by the connected role, that have changed rows or are due for comparison.

    again : also those that failed within the last minute
    """
    with transaction(conn):
        return [number for (number,) in call_many(conn, "_attachments_to_follow", scene, again)]


def follow_attachment(
    conn: psycopg.Connection[Any], attachment_id: int, read_within_s: float = READ_WITHIN_S
) -> str | None:
    """Update the objects of an attached table's changed rows, in one transaction.

    Runs the table's map, so it does nothing for a table that another role attached. Returns the reason if the table
    cannot be read, else None. Raises StoreError, and changes nothing, if that takes longer than `read_within_s`.
    """
    require_idle(conn, "following an attached table")
    with transaction(conn):
        limits = "SELECT set_config('statement_timeout', %s, true), set_config('lock_timeout', %s, true)"
        conn.execute(limits.encode(), (f"{1000.0 * read_within_s:.0f}ms", _LOCK_WITHIN), prepare=False)
        error = call(conn, "_follow_attachment", attachment_id)[-1]
    return None if error is None else str(error)


def attachment_failed(conn: psycopg.Connection[Any], attachment_id: int, error: str) -> None:
    """Record why an attached table cannot be read."""
    with transaction(conn):
        call(conn, "_attachment_failed", attachment_id, error)


def seconds_to_comparison(conn: psycopg.Connection[Any]) -> float | None:
    """Return the seconds until the next comparison of a table of the connected role; None: none attached."""
    with transaction(conn):
        found = call(conn, "_seconds_to_comparison")[0]
    return None if found is None else float(found)


@contextmanager
def _named(table: str) -> Iterator[None]:
    """Convert the server's errors about the name of a table to InvalidInput."""
    try:
        yield
    except ConflictDBError as error:
        cause = error.__cause__
        if isinstance(cause, _WRONG_NAMES):
            raise InvalidInput(f"table {table!r}", "name", str(cause.diag.message_primary)) from cause
        raise
