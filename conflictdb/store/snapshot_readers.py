"""Read a scene's objects on many connections at once, all in the same state of the database.

A reader begins with the statements of `Shared.begin` and runs `query` for a range of ids. Every row names the state it
was read in; `require_state` refuses rows of another state.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray
from psycopg.rows import tuple_row

from conflictdb.errors import StoreError
from conflictdb.model.results import Kind
from conflictdb.store.connection import require_idle, snapshot, translated
from conflictdb.store.stored_objects import (
    AREA_STRINGS,
    TRACK_STRINGS,
    Numbered,
    areas_of,
    fixed_columns,
    string_columns,
    tracks_of,
)

# The query of readers. Texts and instants are bytes, so they do not depend on connection settings. Names and properties
# are not read.
_NOT_READ: Final = ("name", "properties")


def _query(kind: Kind, own: str) -> str:
    words = "".join(f", convert_to({name}, 'UTF8') AS {name}" for name in string_columns(kind) if name not in _NOT_READ)
    numbers = "".join(f", {name}" for name, _ in fixed_columns(kind))
    return (
        f"SELECT {kind.value}_id AS object_id, version{numbers}, {own}, convert_to(key, 'UTF8') AS key{words},"  # noqa: S608
        f" pg_current_snapshot()::text AS state FROM conflictdb_internal._read_{kind.value}s({{scene_id}}, NULL)"
    )


_ROWS: Final = {
    Kind.AREA: _query(
        Kind.AREA,
        f'timestamptz_send(span_start) AS start, timestamptz_send(span_end) AS "end", {", ".join(AREA_STRINGS)}',
    ),
    Kind.TRACK: _query(Kind.TRACK, ", ".join(TRACK_STRINGS)),
}
# The first of every n ids.
_FIRSTS: Final = {
    kind: (
        f"SELECT {kind.value}_id FROM (SELECT {kind.value}_id, row_number() OVER (ORDER BY {kind.value}_id) AS place"  # noqa: S608
        f" FROM conflictdb_internal._read_{kind.value}s(%s, NULL)) one WHERE (place - 1) %% %s = 0 ORDER BY 1"
    )
    for kind in Kind
}
# Lift these limits, where the server knows them: the transaction lasts as long as its readers.
_WAITS: Final = (
    "SELECT set_config(name, '0', true) FROM pg_catalog.pg_settings"
    " WHERE name IN ('idle_in_transaction_session_timeout', 'transaction_timeout')"
)
_STATE: Final = "SELECT pg_export_snapshot(), pg_current_snapshot()::text"


@dataclass(frozen=True, slots=True)
class Shared:
    """A state of the database that other connections can read while the transaction that shares it is open.

    begin : SQL with which each of them begins its transaction
    state : the text that rows read in it carry
    """

    begin: str
    state: str


@contextmanager
def shared_snapshot(conn: psycopg.Connection[Any]) -> Iterator[Shared]:
    """Read one state of the database inside, and share it with other connections until the block ends."""
    require_idle(conn, "a snapshot for others")
    with snapshot(conn), translated(), psycopg.Cursor(conn, row_factory=tuple_row) as cursor:
        cursor.execute(_WAITS.encode(), prepare=False)
        name, state = cursor.execute(_STATE.encode(), prepare=False).fetchone() or ("", "")
        # The name comes from the server: digits and signs only.
        begin = f"SET TRANSACTION ISOLATION LEVEL REPEATABLE READ, READ ONLY; SET TRANSACTION SNAPSHOT '{name}'"
        yield Shared(begin, state)


def firsts(conn: psycopg.Connection[Any], scene_id: int, kind: Kind, every: int) -> list[int]:
    """Return every n-th object id of a kind, starting with the first, in increasing order."""
    with translated(), psycopg.Cursor(conn, row_factory=tuple_row) as cursor:
        return [row[0] for row in cursor.execute(_FIRSTS[kind].encode(), [scene_id, every], prepare=False)]


def query(scene_id: int, kind: Kind) -> str:
    """Return the query of all objects of a kind; readers select ranges by its column `object_id`."""
    return _ROWS[kind].format(scene_id=int(scene_id))


def numbered(kind: Kind, columns: Mapping[str, NDArray[Any]], strings: Mapping[str, Sequence[bytes]]) -> Numbered:
    """Decode the objects of rows of `query`, without names and properties.

    columns : the numeric columns (n,)
    strings : all other columns but `state`, as bytes
    """
    n = len(columns["object_id"])
    none = {"name": [b""] * n, "properties": [b"{}"] * n}
    of = columns["object_id"], columns["version"]
    if kind == Kind.TRACK:
        return Numbered([], tracks_of(columns, {**strings, **none}), *of)
    spans = {name: np.frombuffer(b"".join(strings[name]), ">i8").astype(np.int64) for name in ("start", "end")}
    return Numbered(areas_of({**columns, **spans}, {**strings, **none}), [], *of)


def require_state(states: Sequence[str], shared: Shared) -> None:
    """Raise StoreError unless all rows were read in the shared state."""
    if any(state != shared.state for state in states):
        raise StoreError("readers did not read the state of the database that they were to read: nothing can be said")
