"""Represent polygons as bytes: EWKB in longitude and latitude, the form that PostGIS stores."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Self

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.ragged import offsets, ragged_rows

SRID: Final = 4326


@dataclass(frozen=True, slots=True)
class Polygons:
    """n polygons or multipolygons, longitude and latitude: data[offset[i]:offset[i + 1]], empty if unknown."""

    data: NDArray[np.uint8]
    offset: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.offset) - 1

    @classmethod
    def none(cls, n: int) -> Self:
        """Return n unknown polygons."""
        return cls(np.empty(0, np.uint8), np.zeros(n + 1, np.int64))

    @classmethod
    def of(cls, geometries: NDArray[np.object_]) -> Self:
        """Return geometries (n,) as polygons; None: unknown."""
        wkb = [one or b"" for one in shapely.to_wkb(geometries, byte_order=1, include_srid=True).tolist()]
        return cls(np.frombuffer(b"".join(wkb), np.uint8), offsets([len(one) for one in wkb]))

    def take(self, rows: NDArray[np.int64]) -> "Polygons":
        """Return the polygons of some rows (k,)."""
        offset, data = ragged_rows(self.offset, rows)
        return Polygons(self.data[data], offset)

    def geometries(self) -> NDArray[np.object_]:
        """Return polygons as geometries (n,), None if unknown."""
        bounds, data = self.offset.tolist(), self.data.tobytes()
        wkb = [data[start:end] or None for start, end in pairwise(bounds)]
        return np.asarray(shapely.from_wkb(np.array(wkb, dtype=object)))
