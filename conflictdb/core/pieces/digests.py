"""Compute digests of all data of objects that conflicts depend on; equal objects have equal digests, wherever read.

Keys, numbers, versions, names and properties are left out. 64 bits; collision probability 2^-64 per pair.
"""

import json
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.objects import Activations, AreaBatch, TrackBatch
from conflictdb.kernel.rows import Bytes, Part, digests
from conflictdb.model.tolerances import as_members

# Digests are stored with computed conflicts: another key would match no object.
_KEY: Final = b"what objects are"
_NUMBERS: Final = ("track_id", "version")


def area_digests(areas: AreaBatch) -> NDArray[np.int64]:
    """Return a digest (n,) of each area."""
    outlines = shapely.to_wkb(areas.footprint, byte_order=1, include_srid=False).tolist()
    offset = np.cumsum([0, *map(len, outlines)])
    measures = np.column_stack([areas.floor_m, areas.ceiling_m])
    outline: Part = np.frombuffer(b"".join(outlines), np.uint8), offset
    active = areas.active
    # The counts make the concatenation unambiguous.
    counts = np.column_stack([np.diff(offset), np.diff(active.offset)])
    return _digests(
        [_fixed(counts), _ragged(active.at_us, active.offset), _fixed(measures), _fixed(areas.numbers), outline],
    )


def track_digests(tracks: TrackBatch) -> NDArray[np.int64]:
    """Return a digest (n,) of each track."""
    # The counts make the concatenation unambiguous.
    counts, parts = [], []
    for name, values in tracks.columns():
        offset = tracks.offset_of(name)
        if name.endswith("_offset"):
            counts.append(np.diff(values))
        elif isinstance(values, Activations):
            parts.append(_ragged(values.at_us, values.offset))
        elif offset is not None:
            parts.append(_ragged(values, offset))
        elif values.dtype == object:
            parts.append(_members(values))
        elif name not in _NUMBERS:
            parts.append(_fixed(np.column_stack([values])))
    counts.append(np.diff(tracks.departs.offset))
    return _digests([_fixed(np.column_stack(counts)), *parts])


def _members(tolerances: NDArray[np.object_]) -> Part:
    # Sorted, as the database gives them in an order of its own.
    texts = [b"" if one is None else json.dumps(as_members(one), sort_keys=True).encode() for one in tolerances]
    return np.frombuffer(b"".join(texts), np.uint8), np.cumsum([0, *map(len, texts)])


def _digests(parts: list[Part]) -> NDArray[np.int64]:
    return digests(parts, _KEY).view(np.int64)


def _fixed(values: NDArray[Any]) -> Bytes:
    return np.ascontiguousarray(values).view(np.uint8)


def _ragged(values: NDArray[Any], offset: NDArray[np.int64]) -> Part:
    width = values.itemsize * (values.shape[1] if values.ndim > 1 else 1)
    return np.ascontiguousarray(values).reshape(-1).view(np.uint8), offset * width
