"""Convert conflicts of numbered objects to and from Arrow: the columns are the fields of `Conflicts`, and the region.

Periods are flat lists of whole microseconds, start, end, start, end, …; unknown numbers are NaN, and unknown instants
MINUS_INFINITY_US, as in the arrays. Regions are EWKB in longitude and latitude, null if unknown.
"""

from typing import Any, Final

import numpy as np
import pyarrow as pa

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.arrow.columns import lists, numbers, of_lists, of_numbers, of_polygons, polygons
from conflictdb.arrays.arrow.forms import Batch, Form
from conflictdb.arrays.polygons import Polygons
from conflictdb.errors import InvalidInput

_NUMBERS: Final = {
    "a_kind": pa.int8(),
    "a_id": pa.int64(),
    "a_version": pa.int64(),
    "b_kind": pa.int8(),
    "b_id": pa.int64(),
    "b_version": pa.int64(),
    "verdict": pa.int8(),
    "time_error_s": pa.float64(),
    "closest_us": pa.int64(),
    "closest_m": pa.float64(),
    "closest_error_m": pa.float64(),
}
_PLACES: Final = {
    f"{name}_deg": (f"{name}_lon_deg", f"{name}_lat_deg") for name in ("first_contact", "closest_a", "closest_b")
}

CONFLICTS: Final = Form.of(
    "conflicts",
    1,
    [
        *(pa.field(name, of, nullable=False) for name, of in _NUMBERS.items()),
        *(pa.field(name, pa.float64(), nullable=False) for names in _PLACES.values() for name in names),
        pa.field("period_us", pa.list_(pa.int64()), nullable=False),
        pa.field("region", pa.binary()),
    ],
)


def of_conflicts(found: Conflicts, region: Polygons | None = None) -> "pa.RecordBatch":
    """Return conflicts as a batch of the form CONFLICTS.

    region : their regions; None: as `where` of the conflicts computes them
    """
    if region is None:
        region = found.where(np.arange(len(found)))
    columns = {name: of_numbers(getattr(found, name)) for name in _NUMBERS}
    for name, (lon, lat) in _PLACES.items():
        places_deg = getattr(found, name)
        columns |= {lon: of_numbers(places_deg[:, 0]), lat: of_numbers(places_deg[:, 1])}
    columns["period_us"] = of_lists(found.period_us, found.period_offset)
    columns["region"] = of_polygons(region)
    return CONFLICTS.batch(columns)


def to_conflicts(given: Batch) -> tuple[Conflicts, Polygons]:
    """Return the conflicts of a batch or table of the form CONFLICTS, without `where`, and their regions (n,).

    Raises InvalidInput if it does not fit the form.
    """
    columns = CONFLICTS.columns(given)
    ends, offset = lists(columns["period_us"])
    if (offset % 2).any() or ends.null_count:
        raise InvalidInput(
            f"Arrow form {CONFLICTS.name!r}", "period_us", "must be lists of starts and ends, none of them null"
        )
    fields: dict[str, Any] = {name: numbers(columns[name]) for name in _NUMBERS}
    for name, (lon, lat) in _PLACES.items():
        fields[name] = np.column_stack([numbers(columns[lon]), numbers(columns[lat])])
    found = Conflicts(period_us=numbers(ends).reshape(-1, 2), period_offset=offset // 2, **fields)
    return found, polygons(columns["region"])
