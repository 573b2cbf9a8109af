"""Attach tables of other schemas to scenes, detach them, follow their changes."""

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
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

# Limit for running a map.
READ_WITHIN_S: Final = 600.0
# Objects of a preview.
_PREVIEWED: Final = 5
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


@dataclass(frozen=True, slots=True)
class Attaching:
    """What `attach` is given: `again` permits a table that the scene has already."""

    kind: str
    table: str
    mapped: Mapping[str, str]
    every: timedelta | None = None
    again: bool = False


@dataclass(frozen=True, slots=True)
class Reattaching:
    """What `reattach` is given: a table that is attached, by name or number, and what changes.

    to, every : None: stays
    changes : fields of the map that change; None removes one
    """

    table: str
    changes: Mapping[str, str | None]
    to: str | None = None
    every: timedelta | None = None


def attach(conn: psycopg.Connection[Any], scene: str, given: Attaching | Reattaching) -> int:
    """Attach a table to a scene, or change how it is; return the number of the attachment. In one transaction.

    Raises InvalidInput, and changes nothing, if the table or the map cannot be used.
    """
    require_writable(conn)
    with transaction(conn), _named(given):
        if isinstance(given, Attaching):
            mapped = Jsonb(dict(given.mapped))
            return int(call(conn, "attach", scene, given.kind, given.table, mapped, given.every, given.again)[0])
        return int(call(conn, "reattach", scene, *_changes(given))[0])


def preview_attachment(conn: psycopg.Connection[Any], scene: str, given: Attaching | Reattaching) -> AttachmentPreview:
    """Return what `attach` would do; changes nothing. Raises InvalidInput as `attach` does."""
    parts: dict[str, list[str]] = {"would": [], "object": [], "unmapped": []}
    require_writable(conn)
    with transaction(conn), _named(given):
        if isinstance(given, Attaching):
            mapped, shown = Jsonb(dict(given.mapped)), _PREVIEWED
            found = call_many(
                conn, "preview_attachment", scene, given.kind, given.table, mapped, given.every, shown, given.again
            )
        else:
            found = call_many(conn, "preview_reattachment", scene, *_changes(given))
        for part, what in found:
            parts[part].append(what)
    return AttachmentPreview(parts["would"], parts["object"], parts["unmapped"])


def _changes(given: Reattaching) -> tuple[object, ...]:
    return given.table, Jsonb(dict(given.changes)), given.to, given.every


def detach(conn: psycopg.Connection[Any], scene: str, table: str, *, keep: bool) -> int:
    """Detach a table from a scene, in one transaction; return the number of objects removed."""
    require_writable(conn)
    with transaction(conn), _naming(table):
        return int(call(conn, "detach", scene, table, keep)[0])


def attachments(conn: psycopg.Connection[Any], scene: str | None) -> list[Attachment]:
    """Return the tables attached to a scene; None: to any scene."""
    with transaction(conn):
        return [Attachment(**row) for row in call_by_name(conn, "_attachments", scene)]


def unmapped(conn: psycopg.Connection[Any], scene: str) -> list[Unmapped]:
    """Return the rows of a scene's attached tables that have no object, or whose object is out of date."""
    with transaction(conn):
        return [Unmapped(**row) for row in call_by_name(conn, "_unmapped", scene)]


def attachments_to_follow(conn: psycopg.Connection[Any], scene: str, *, again: bool) -> list[tuple[int, bool]]:
    """Return the attachments of a scene, made by the connected role, that have changed rows or are due for comparison.

    With each, whether `rewatch_attachment` comes first.

    again : also those that failed within the last minute
    """
    with transaction(conn):
        return [(number, is_moved) for number, is_moved in call_many(conn, "_attachments_to_follow", scene, again)]


def rewatch_attachment(conn: psycopg.Connection[Any], attachment_id: int) -> str | None:
    """Follow a table that was renamed, and create triggers that are missing, in one short transaction.

    Returns why that is not possible. None also if other sessions have locked the tables: then try again.
    """
    require_idle(conn, "following an attached table")
    with transaction(conn):
        error = call(conn, "_rewatch_attached", attachment_id)[0]
    return None if error is None else str(error)


def follow_attachment(
    conn: psycopg.Connection[Any], attachment_id: int, read_within_s: float = READ_WITHIN_S, *, waits: bool = True
) -> str | None:
    """Update the objects of an attached table's changed rows, in one transaction.

    Runs the table's map, so it does nothing for a table that another role attached. Returns the reason if the table
    cannot be read, else None. Raises StoreError, and changes nothing, if that takes longer than `read_within_s`.

    waits : for another session that follows the table, instead of leaving it to that one

    Raises LockTimeout, and changes nothing, if another session has the attachment or the scene.
    """
    require_idle(conn, "following an attached table")
    with transaction(conn):
        limit = "SELECT set_config('statement_timeout', %s, true)"
        conn.execute(limit.encode(), (f"{1000.0 * read_within_s:.0f}ms",), prepare=False)
        error = call(conn, "_follow_attachment", attachment_id, waits)[-1]
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


def _named(given: Attaching | Reattaching) -> AbstractContextManager[None]:
    return _naming(given.table if isinstance(given, Attaching) or given.to is None else given.to)


@contextmanager
def _naming(table: str) -> Iterator[None]:
    """Convert the server's errors about the name of a table to InvalidInput."""
    try:
        yield
    except ConflictDBError as error:
        cause = error.__cause__
        if isinstance(cause, _WRONG_NAMES):
            raise InvalidInput(f"table {table!r}", "name", str(cause.diag.message_primary)) from cause
        raise
