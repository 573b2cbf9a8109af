"""Write back the result of a detection in parts, then the run, in its second transaction; record failed runs.

    begin_write; for each part: differing, and stage for each Part that it yields; end_write; commit

The row of a pair stores a digest. An answer with the same digest is neither sent nor written, and its region is not
computed. Another thread sends rows that differ while the next are computed.
"""

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.object_numbers import numbers_of
from conflictdb.arrays.polygons import Polygons
from conflictdb.core.conflict_regions import EDITION
from conflictdb.kernel.waiting import ThreadWork, run_in_thread
from conflictdb.model.methods import Method
from conflictdb.model.plans import Scene
from conflictdb.model.record import MEASURED, STATES, ColumnType
from conflictdb.model.results import Verdict
from conflictdb.model.rules import REPLACED
from conflictdb.model.settings import SETTINGS, Regions
from conflictdb.store import copy_binary
from conflictdb.store.conflict_encoding import Columns, columns_of
from conflictdb.store.connection import call, transaction
from conflictdb.store.known_pairs import DIGEST_KEY_BYTES, KnownPairs, digests
from conflictdb.store.new_rows import NewRows, begin_new, copy_new, finish_new
from conflictdb.store.parameters import Array

# Rows per statement: enough to amortise it, little memory.
_ROWS_AT_ONCE: Final = 5_000
# From this many new rows on, COPY pays for its four statements.
_MANY_NEW: Final = 300
_SENT_AS: Final = {
    ColumnType.POINT: "bytea",
    ColumnType.NUMBER: "double precision",
    ColumnType.INSTANT: "timestamptz",
    ColumnType.NAME: "text",
}
# Columns of a row that _write_run reads, in its order.
_TYPES: Final = {
    "a_kind": "smallint",
    "a_id": "bigint",
    "a_version": "bigint",
    "b_kind": "smallint",
    "b_id": "bigint",
    "b_version": "bigint",
    "place": "tid",
    "digest": "bigint",
    "verdict": "text",
    "periods": "tstzmultirange",
    "region": "bytea",
} | {one.name: _SENT_AS[one.type] for one in MEASURED}
# Rules act through the settings of the pairs that they concern.
_OF_NO_ANSWER: Final = {"rules"} | {setting.name for setting in SETTINGS if not setting.decides_conflicts}


@dataclass(frozen=True, slots=True)
class RunRecord:
    """The record of a detection.

    counted : pairs that remained after each stage, and seconds of each stage, by column of table `run`, as far as it
        got; other names are ignored
    more_objects : growth of the number of objects since the last detection; None: count them
    """

    method: str
    settings: Mapping[str, Any]
    started_at: datetime
    counted: Mapping[str, float] = field(default_factory=dict)
    more_objects: int | None = None

    @property
    def has_regions(self) -> bool:
        """Whether rows store regions."""
        return self.settings.get("regions") != Regions.OFF and self.method != Method.SCREEN

    def digest_key(self, of_pairs: Scene | None = None) -> bytes:
        """Return the key for digests: method, settings and edition, on which answers depend besides their columns.

        of_pairs : settings that the pairs have by separation rules
        """
        known = {name: value for name, value in self.settings.items() if name not in _OF_NO_ANSWER}
        if not self.has_regions:
            known["regions"] = str(Regions.OFF)
        if of_pairs is not None:
            known |= {name: getattr(of_pairs, name) for name in REPLACED.values()}
        settings = json.dumps([self.method, known, EDITION], sort_keys=True)
        return hashlib.blake2b(settings.encode(), digest_size=DIGEST_KEY_BYTES).digest()

    def as_json(self, **more: float) -> str:
        """Encode the record for the database."""
        started_at = self.started_at.isoformat()
        record: dict[str, Any] = {"method": self.method, "settings": self.settings, "started_at": started_at}
        if self.more_objects is not None:
            record["more_objects"] = self.more_objects
        return json.dumps({**record, **self.counted, **more})


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """The changes made by a detection: conflicts opened, changed (other periods or verdict), closed; and the totals."""

    run_id: int
    opened: int
    changed: int
    closed: int
    conflicts: int
    unresolved: int


@dataclass(frozen=True, slots=True)
class Part:
    """Conflicts that differ from the stored ones.

    rows : (k,) their indices among all conflicts found
    conflicts : the object of the smaller kind and number first
    row : (k,) the stored rows of the pairs, -1 for none (KnownPairs)
    digest : (k,)
    """

    rows: NDArray[np.int64]
    conflicts: Conflicts
    row: NDArray[np.int64]
    digest: NDArray[np.int64]

    def take(self, some: NDArray[np.int64]) -> "Part":
        """Return a selection."""
        return Part(self.rows[some], self.conflicts.take(some), self.row[some], self.digest[some])


@dataclass(slots=True)
class Staged:
    """A write-back in progress.

    run : as known at the beginning
    known : the pairs that have a row, and which of them were found
    held : rows that differ and are not sent yet, at most some thousand
    expected : numbers of both objects of new rows that are not begun yet, if there are many
    new : the values that complete new rows
    sending : a part being sent by another thread; until it ends no other thread may use the connection
    run_id : set once a part was sent
    took_s : time spent so far, seconds
    """

    scene_id: int
    run: RunRecord
    known: KnownPairs
    held: list[Columns] = field(default_factory=list)
    expected: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None
    new: NewRows | None = None
    sending: ThreadWork[int] | None = None
    run_id: int | None = None
    took_s: float = 0.0


def begin_write(
    conn: psycopg.Connection[Any], scene_id: int, run: RunRecord, numbers: list[int] | None = None
) -> Staged:
    """Begin to write back the conflicts of a scene, in the second transaction of a detection.

    numbers : of the changed objects, if these are few
    """
    began = time.perf_counter()
    known = KnownPairs.read(conn, scene_id, numbers)
    return Staged(scene_id, run, known, took_s=time.perf_counter() - began)


def differing(staged: Staged, conflicts: Conflicts, of_pairs: Scene | None = None) -> Iterator[Part]:
    """Yield, for `stage`, the conflicts of a part that differ from the stored ones, some thousand rows at a time.

    No pair of objects may be in two parts. The connection is busy until the last is consumed.

    of_pairs : settings that the pairs have by separation rules
    """
    began = time.perf_counter()
    found = _ordered(conflicts)
    digest = _digests(found, staged.run.digest_key(of_pairs))
    row, is_same = staged.known.find(found.a_kind, found.a_id, found.b_kind, found.b_id, digest)
    rows = np.flatnonzero(~is_same)
    new = rows[row[rows] < 0]
    staged.expected, staged.new = None, None
    if len(new) >= _MANY_NEW:
        staged.expected = (
            numbers_of(found.a_kind[new], found.a_id[new]),
            numbers_of(found.b_kind[new], found.b_id[new]),
        )
    staged.took_s += time.perf_counter() - began
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        some = rows[first : first + _ROWS_AT_ONCE]
        yield Part(some, found.take(some), row[some], digest[some])
    began = time.perf_counter()
    _await_sent(staged)
    staged.took_s += time.perf_counter() - began


def stage(conn: psycopg.Connection[Any], staged: Staged, part: Part, region: Polygons) -> None:
    """Queue conflicts that differ, with their regions (k,), for sending."""
    began = time.perf_counter()
    if staged.expected is not None:
        (a, b), staged.expected = staged.expected, None
        run = staged.scene_id, staged.run_id, staged.run.as_json(), staged.run.method
        staged.new = begin_new(conn, *run, np.unique(np.concatenate([a, b])), len(a))
    if staged.new is not None:
        # A region that the kernel leaves unknown has no COPY: the statement computes it.
        is_known = (np.diff(region.offset) > 0) | (part.conflicts.verdict == Verdict.NEAR.code)
        is_new = (part.row < 0) & (is_known | (not staged.run.has_regions))
        rows, rest = np.flatnonzero(is_new), np.flatnonzero(~is_new)
        new = part if not len(rest) else part.take(rows)
        finished = finish_new(staged.new, new.conflicts, new.digest, region if not len(rest) else region.take(rows))
        _send_in_thread(conn, staged, lambda: copy_new(conn, finished))
        part, region = part.take(rest), region.take(rest)
    if len(part.rows):
        columns = columns_of(part.conflicts, region)
        columns |= {"place": staged.known.places(part.row), "digest": copy_binary.fixed(part.digest, "i8")}
        _hold(conn, staged, columns)
    staged.took_s += time.perf_counter() - began


def end_write(conn: psycopg.Connection[Any], staged: Staged, run: RunRecord) -> RunOutcome:
    """Replace the conflicts of every pair with a changed member by those staged, record the run, clear the marks.

    Equal rows stay unchanged. The caller commits; then listeners on channel conflictdb are notified.
    """
    began = time.perf_counter()
    gone = staged.known.gone()
    for first in range(0, len(gone), _ROWS_AT_ONCE):
        _hold(conn, staged, _gone(staged.known, gone[first : first + _ROWS_AT_ONCE]))
    _await_sent(staged)
    arrays = _taken(staged.held)
    staged.took_s += time.perf_counter() - began
    return RunOutcome(*_send(conn, staged, arrays, run.as_json(write_s=staged.took_s), is_last=True))


def _hold(conn: psycopg.Connection[Any], staged: Staged, columns: Columns) -> None:
    """Queue columns of some thousand rows, and send the queue before it exceeds its limit."""
    count = sum(copy_binary.length(one["place"]) for one in (*staged.held, columns))
    if staged.held and count > _ROWS_AT_ONCE:
        _await_sent(staged)
        arrays = _taken(staged.held)
        staged.held.clear()
        _send_in_thread(conn, staged, lambda: _send(conn, staged, arrays, staged.run.as_json(), is_last=False)[0])
    staged.held.append(columns)


def _send_in_thread(conn: psycopg.Connection[Any], staged: Staged, work: Callable[[], int]) -> None:
    """Start `work`, which returns the run, in another thread, after the previous one ended."""
    _await_sent(staged)
    staged.sending = run_in_thread(conn, work)


def _await_sent(staged: Staged) -> None:
    """Wait for the other thread; re-raises its error."""
    if staged.sending is not None:
        sending, staged.sending = staged.sending, None
        staged.run_id = sending.result()


def _taken(held: list[Columns]) -> list[Array]:
    """Return columns of rows as arrays."""
    return [copy_binary.array([one[name] for one in held], of) for name, of in _TYPES.items()]


def _send(
    conn: psycopg.Connection[Any], staged: Staged, arrays: list[Array], run: str, *, is_last: bool
) -> tuple[Any, ...]:
    return call(conn, "_write_run", staged.scene_id, staged.run_id, run, is_last, *arrays)


def record_failure(conn: psycopg.Connection[Any], scene_id: int, run: RunRecord, error: str) -> int:
    """Record a failed detection, in a transaction of its own; conflicts and marks stay. Return the run."""
    with transaction(conn):
        return int(call(conn, "_record_failure", scene_id, run.as_json(), error)[0])


def _ordered(found: Conflicts) -> Conflicts:
    """Return conflicts with the object of the smaller kind and number first."""
    turned = (found.a_kind > found.b_kind) | ((found.a_kind == found.b_kind) & (found.a_id > found.b_id))
    return found.turned(turned)


def _digests(found: Conflicts, key: bytes) -> NDArray[np.int64]:
    """Return digests (n,) of conflicts; never 0, which means no digest.

    The region is left out: it follows from the rest, namely both objects at their versions, the times, and the key.
    """
    # With a certainty in the verdict's place, so that digests of other conflicts stay as they are.
    verdict = found.verdict + len(Verdict) * (found.certainty + 1)
    columns: list[copy_binary.Column] = [
        copy_binary.fixed(kind, "i2") for kind in (found.a_kind, found.b_kind, verdict)
    ]
    # By type: the order of columns is part of the digests that databases hold.
    of_type = {kind: [getattr(found, one.array) for one in MEASURED if one.type is kind] for kind in ColumnType}
    for numbers in (*(getattr(found, one.array) for one in STATES), *of_type[ColumnType.INSTANT]):
        columns.append(copy_binary.fixed(numbers, "i8"))
    columns += [_digested(measures[:, None]) for measures in of_type[ColumnType.NUMBER]]
    columns += [_digested(places) for places in of_type[ColumnType.POINT]]
    # Alone of no fixed width: so no two rows are the same bytes.
    columns.append(
        copy_binary.Ragged(copy_binary.fixed(found.period_us.ravel(), "i8").ravel(), 16 * found.period_offset)
    )
    return digests(columns, key)


def _digested(measures: NDArray[np.float64]) -> copy_binary.Bytes:
    """Encode numbers (n, k) as bytes, with a single encoding for NaN."""
    whole = np.where(np.isnan(measures), np.nan, measures)
    return copy_binary.fixed(whole.ravel(), "f8").reshape(len(measures), 8 * measures.shape[1])


def _gone(known: KnownPairs, rows: NDArray[np.int64]) -> Columns:
    """Return the columns of rows to delete."""
    (a_kind, a_id), (b_kind, b_id) = known.members(rows)
    nothing = copy_binary.Ragged.of([None] * len(rows))
    members: Columns = {
        "a_kind": copy_binary.fixed(a_kind, "i2"),
        "a_id": copy_binary.fixed(a_id, "i8"),
        "b_kind": copy_binary.fixed(b_kind, "i2"),
        "b_id": copy_binary.fixed(b_id, "i8"),
        "place": known.places(rows),
    }
    return {name: members.get(name, nothing) for name in _TYPES}
