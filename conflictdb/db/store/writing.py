"""Write-back: what a detection found, in parts, then the run, all in its second transaction; and runs that failed.

    begin_write; stage, as often as there are parts; end_write; commit

Parts wait in a temporary table. `end_write` compares them with the conflicts that are there, and writes what differs.
"""

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.db.store import copy_binary
from conflictdb.db.store.connection import call, transaction
from conflictdb.model import SINCE_EVER_US
from conflictdb.results import Verdict

_SRID = 4326
_VERDICT_NAMES = copy_binary.Ragged.of([Verdict.of_code(code).encode() for code in range(len(Verdict))])


@dataclass(frozen=True, slots=True)
class RunRecord:
    """What is recorded of a detection.

    counted : pairs that remained after each stage and seconds each stage took, by the names of the columns of the table
        `run`, as far as it came; other names are left aside
    """

    method: str
    settings: Mapping[str, Any]
    started_at: datetime
    counted: Mapping[str, float] = field(default_factory=dict)

    def as_json(self, **more: float) -> str:
        """Return it as the database takes it."""
        started_at = self.started_at.isoformat()
        return json.dumps(
            {"method": self.method, "settings": self.settings, "started_at": started_at, **self.counted, **more}
        )


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """What a detection changed: conflicts opened, changed (other periods or verdict) and closed; how many there are."""

    run_id: int
    opened: int
    changed: int
    closed: int
    conflicts: int
    unresolved: int


@dataclass(slots=True)
class Staged:
    """A write-back under way: its scene, and how long it took so far, seconds."""

    scene_id: int
    took_s: float = 0.0


def begin_write(conn: psycopg.Connection[Any], scene_id: int) -> Staged:
    """Begin to write back what is found of a scene, in the second transaction of a detection."""
    began = time.perf_counter()
    call(conn, "_begin_write")
    return Staged(scene_id, time.perf_counter() - began)


def stage(conn: psycopg.Connection[Any], staged: Staged, conflicts: Conflicts) -> None:
    """Hand over a part of what was found; no pair of objects may be in two parts."""
    began = time.perf_counter()
    copy_binary.send(conn, "pg_temp.found", _columns(conflicts))
    staged.took_s += time.perf_counter() - began


def end_write(conn: psycopg.Connection[Any], staged: Staged, run: RunRecord) -> RunOutcome:
    """Replace the conflicts of every pair with a changed member by those handed over, record the run, clear the marks.

    Rows that are what they were are not touched. The caller commits; then listeners on channel conflictdb are told.
    """
    return RunOutcome(*call(conn, "_write_run", staged.scene_id, run.as_json(write_s=staged.took_s)))


def record_failure(conn: psycopg.Connection[Any], scene_id: int, run: RunRecord, error: str) -> int:
    """Record a detection that failed, in a transaction of its own; conflicts and marks stay. Returns the run."""
    with transaction(conn):
        return int(call(conn, "_record_failure", scene_id, run.as_json(), error)[0])


def _columns(found: Conflicts) -> dict[str, copy_binary.Column]:
    """Return the columns of the table found: the object of the smaller kind and number first."""
    turned = (found.a_kind > found.b_kind) | ((found.a_kind == found.b_kind) & (found.a_id > found.b_id))

    def first(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
        return np.where(turned if a.ndim == 1 else turned[:, None], b, a)

    is_known = np.isfinite(found.closest_m)
    return {
        "a_kind": copy_binary.fixed(first(found.a_kind, found.b_kind), "i2"),
        "a_id": copy_binary.fixed(first(found.a_id, found.b_id), "i8"),
        "a_version": copy_binary.fixed(first(found.a_version, found.b_version), "i8"),
        "b_kind": copy_binary.fixed(first(found.b_kind, found.a_kind), "i2"),
        "b_id": copy_binary.fixed(first(found.b_id, found.a_id), "i8"),
        "b_version": copy_binary.fixed(first(found.b_version, found.a_version), "i8"),
        "periods": copy_binary.multispans(found.period_us, found.period_offset),
        "verdict": _VERDICT_NAMES.take(found.verdict.astype(np.int64)),
        "region": _geometries(found),
        "first_contact_point": copy_binary.points(found.first_contact_deg, _SRID),
        "time_error_s": copy_binary.fixed(found.time_error_s, "f8"),
        "closest_at": copy_binary.nullable(copy_binary.instants(found.closest_us), found.closest_us == SINCE_EVER_US),
        "closest_m": copy_binary.nullable(copy_binary.fixed(found.closest_m, "f8"), ~is_known),
        "closest_error_m": copy_binary.nullable(copy_binary.fixed(found.closest_error_m, "f8"), ~is_known),
        "closest_a_point": copy_binary.points(first(found.closest_a_deg, found.closest_b_deg), _SRID),
        "closest_b_point": copy_binary.points(first(found.closest_b_deg, found.closest_a_deg), _SRID),
    }


def _geometries(found: Conflicts) -> copy_binary.Ragged:
    """Return where conflicts are; null where that is not known."""
    if found.region is None:
        return copy_binary.Ragged.of([None] * len(found))
    return copy_binary.Ragged.of(shapely.to_wkb(found.region, byte_order=1, include_srid=True).tolist())
