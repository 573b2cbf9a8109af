"""Columns of rows of conflicts, as PostgreSQL takes them."""

import numpy as np

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.polygons import SRID, Polygons
from conflictdb.db.store import copy_binary
from conflictdb.model import SINCE_EVER_US
from conflictdb.results import Verdict

Columns = dict[str, copy_binary.Column]
_VERDICT_NAMES = copy_binary.Ragged.of([Verdict.of_code(code).encode() for code in range(len(Verdict))])


def columns_of(found: Conflicts, region: Polygons) -> Columns:
    """Return those that follow from what was found (n,), and where each is (n,)."""
    is_known = np.isfinite(found.closest_m)
    return {
        "a_kind": copy_binary.fixed(found.a_kind, "i2"),
        "a_id": copy_binary.fixed(found.a_id, "i8"),
        "a_version": copy_binary.fixed(found.a_version, "i8"),
        "b_kind": copy_binary.fixed(found.b_kind, "i2"),
        "b_id": copy_binary.fixed(found.b_id, "i8"),
        "b_version": copy_binary.fixed(found.b_version, "i8"),
        "verdict": _VERDICT_NAMES.take(found.verdict.astype(np.int64)),
        "periods": copy_binary.multispans(found.period_us, found.period_offset),
        "region": copy_binary.Ragged(region.data, region.offset, np.diff(region.offset) == 0),
        "first_contact_point": copy_binary.points(found.first_contact_deg, SRID),
        "time_error_s": copy_binary.fixed(found.time_error_s, "f8"),
        "closest_at": copy_binary.nullable(copy_binary.instants(found.closest_us), found.closest_us == SINCE_EVER_US),
        "closest_m": copy_binary.nullable(copy_binary.fixed(found.closest_m, "f8"), ~is_known),
        "closest_error_m": copy_binary.nullable(copy_binary.fixed(found.closest_error_m, "f8"), ~is_known),
        "closest_a_point": copy_binary.points(found.closest_a_deg, SRID),
        "closest_b_point": copy_binary.points(found.closest_b_deg, SRID),
    }
