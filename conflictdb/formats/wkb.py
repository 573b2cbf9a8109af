"""Check the structure of well-known binary (WKB) before GEOS decodes it.

GEOS decodes nested geometries by recursion in C++, without a limit: 100,000 levels overflow the stack and end the
process.
"""

from collections.abc import Iterable
from struct import Struct
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

# Levels of nested collections: more than any honest file has, and few enough for every thread's stack.
MAX_NESTING: Final = 32

_POINT, _LINESTRING, _POLYGON, _COLLECTION = 1, 2, 3, 7
# Kinds of multi-geometries, and the kind of their members.
_MEMBER: Final = {4: _POINT, 5: _LINESTRING, 6: _POLYGON}
_ANY: Final = 0
_COUNT: Final = Struct(">I"), Struct("<I")
_HEAD: Final = 5  # bytes: the byte order and the kind
# Flags of PostGIS's EWKB; ISO adds 1000 for Z, 2000 for M, 3000 for both.
_Z, _M, _SRID, _KIND = 0x80000000, 0x40000000, 0x20000000, 0x1FFFFFFF


def decoded(values: Iterable[bytes | str | None], first_row: int = 0) -> NDArray[np.object_]:
    """Return geometries (n,), None where there is none.

    Raises ValueError, which names the row, or shapely.errors.GEOSException for invalid WKB.

    first_row : number of the first row in messages
    """
    as_bytes = [bytes.fromhex(one) if isinstance(one, str) else one for one in values]
    check(as_bytes, first_row)
    column = np.empty(len(as_bytes), dtype=object)
    column[:] = as_bytes
    with np.errstate(invalid="ignore"):  # NaN coordinates are refused later, with their object
        return np.asarray(shapely.from_wkb(column), dtype=object)


def check(values: Iterable[bytes | None], first_row: int = 0) -> None:
    """Raise ValueError, which names the row, for bytes that GEOS must not decode."""
    for row, data in enumerate(values, first_row):
        flaw = "" if data is None else _flaw(data)
        if flaw:
            raise ValueError(f"row {row} {flaw}; write the file again from its source")


def _flaw(data: bytes) -> str:
    """Return the error in the structure of a geometry, empty if there is none."""
    size = len(data)
    at = 0
    waiting = [(1, _ANY, 0)]  # geometries to come: how many, of which kind, at which level
    while waiting:
        left, expected, level = waiting.pop()
        if left > 1:
            waiting.append((left - 1, expected, level))
        if at + _HEAD + 4 > size:
            return _SHORT
        if data[at] > 1:
            return f"has the byte order {data[at]}, which must be 0 or 1"
        count = _COUNT[data[at]].unpack_from
        code = count(data, at + 1)[0]
        at += _HEAD + (4 if code & _SRID else 0)
        iso, kind = divmod(code & _KIND, 1000)
        if iso > 3 or not _POINT <= kind <= _COLLECTION:
            return f"has a geometry of the unknown kind {code}"
        if expected not in (_ANY, kind):
            return f"has a geometry of kind {kind} where only kind {expected} may be"
        stride = 8 * (2 + bool(code & _Z or iso & 1) + bool(code & _M or iso & 2))
        if kind == _POINT:
            at += stride
        elif at + 4 > size:
            return _SHORT
        else:
            n = count(data, at)[0]
            at += 4
            if kind == _LINESTRING:
                at += n * stride
            elif kind == _POLYGON:
                for _ in range(n):
                    if at + 4 > size:
                        return _SHORT
                    at += 4 + count(data, at)[0] * stride
            elif n:
                if level == MAX_NESTING:
                    return f"nests geometries more than {MAX_NESTING} deep"
                waiting.append((n, _MEMBER.get(kind, _ANY), level + 1))
        if at > size:
            return _SHORT
    return ""


_SHORT: Final = "ends before all that its counts announce"
