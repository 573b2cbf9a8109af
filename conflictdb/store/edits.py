"""Seal and verify the audit of edits."""

from dataclasses import dataclass
from typing import Any, Final

import psycopg

from conflictdb.store.connection import call, call_by_name, transaction


@dataclass(frozen=True, slots=True)
class Audit:
    """The state of the seals.

    anchor : number of the first stored seal, whose edits are pruned; None: nothing was ever sealed
    batches, edits : how many are as they were sealed, up to `first_wrong`
    unsealed : edits without a seal
    first_wrong, reason : number of the first batch that is not as it was sealed, and why; None: none
    last_batch, last_digest : number of the last batch, and its SHA-256, hex; None: nothing was ever sealed
    """

    anchor: int | None
    batches: int
    edits: int
    unsealed: int
    first_wrong: int | None
    reason: str | None
    last_batch: int | None
    last_digest: str | None


# Edits that are sealed at once, in less than a second.
_MOST: Final = 10_000


def seal_some_edits(conn: psycopg.Connection[Any]) -> bool:
    """Seal at most 10,000 edits; return whether there may be more. Another session that seals makes it False."""
    with transaction(conn):
        return int(call(conn, "_seal_batch", _MOST)[0]) == _MOST


def seal_edits(conn: psycopg.Connection[Any]) -> int:
    """Seal all edits that no batch has; return their number. Another session that seals makes it 0."""
    with transaction(conn):
        return int(call(conn, "seal_edits")[0])


def verify_edits(conn: psycopg.Connection[Any]) -> Audit:
    """Compare all edits with their seals. For workers and the owner of schema conflictdb, who see all edits."""
    with transaction(conn):
        (row,) = call_by_name(conn, "verify_edits")
    return Audit(**row)
