"""WKB as attackers write it never reaches GEOS; all honest WKB does."""

import random
import struct
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
import shapely

from conflictdb.formats import wkb

COLLECTION, MULTIPOLYGON, POLYGON, LINESTRING = 7, 6, 3, 2
SQUARE = shapely.box(4, 57, 5, 58)
HONEST = [
    shapely.Point(1, 2),
    shapely.Point(),
    shapely.Point(1, 2, 3),
    shapely.LineString([(0, 0), (1, 1)]),
    shapely.LineString(),
    SQUARE,
    shapely.Polygon(),
    shapely.Polygon([(0, 0), (9, 0), (9, 9)], [[(1, 1), (2, 1), (2, 2)]]),
    shapely.Polygon([(0, 0, 1), (9, 0, 1), (9, 9, 1)]),
    shapely.MultiPoint([(0, 0), (1, 1)]),
    shapely.MultiLineString([[(0, 0), (1, 1)], [(2, 2), (3, 3)]]),
    shapely.MultiPolygon([SQUARE, shapely.box(6, 57, 7, 58)]),
    shapely.MultiPolygon(),
    shapely.GeometryCollection([SQUARE, shapely.GeometryCollection([shapely.Point(1, 2)])]),
    shapely.from_wkt("LINESTRING ZM (0 0 1 2, 1 1 3 4)"),
    shapely.from_wkt("MULTIPOLYGON M (((0 0 1, 1 0 1, 1 1 1, 0 0 1)))"),
    shapely.set_srid(SQUARE, 4326),
]


def head(kind: int, count: int, order: str = "<") -> bytes:
    return struct.pack(f"{order}BII", order == "<", kind, count)


def nested(kind: int, depth: int) -> bytes:
    return head(kind, 1) * depth + head(kind, 0)


@pytest.mark.parametrize("flavor", ["iso", "extended"])
@pytest.mark.parametrize("order", [0, 1])
def test_honest_geometries_are_decoded(flavor: Any, order: int) -> None:
    held = [shapely.to_wkb(one, byte_order=order, flavor=flavor, include_srid=flavor == "extended") for one in HONEST]
    decoded = wkb.decoded([*held, None, held[0].hex()])
    assert shapely.equals_identical(decoded[:-2], np.array(HONEST)).all()
    assert decoded[-2] is None
    assert decoded[-1] == HONEST[0]


HOSTILE = {
    "nothing": (b"", "ends before"),
    "a head": (b"\1\3", "ends before"),
    "collections in collections": (nested(COLLECTION, 100_000), "more than 32 deep"),
    "collections, each in two": (head(COLLECTION, 2) * 100_000, "more than 32 deep"),
    "polygons in polygons": (nested(MULTIPOLYGON, 100_000), "where only kind 3 may be"),
    "4,000,000,000 points": (head(LINESTRING, 2**32 - 1), "ends before"),
    "4,000,000,000 rings": (head(POLYGON, 2**32 - 1) + bytes(400), "ends before"),
    "4,000,000,000 polygons": (head(MULTIPOLYGON, 2**32 - 1), "ends before"),
    "a ring of 4,000,000,000 points": (head(POLYGON, 1) + struct.pack("<I", 2**32 - 1), "ends before"),
    "an unknown kind": (head(17, 0), "unknown kind 17"),
    "an unknown dimension": (head(4003, 0), "unknown kind 4003"),
    "another byte order": (b"\2" + head(POLYGON, 0)[1:], "byte order 2"),
    "a truncated polygon": (SQUARE.wkb[:-1], "ends before"),
}


@pytest.mark.parametrize("name", list(HOSTILE))
def test_hostile_geometries_are_refused_by_row(name: str) -> None:
    data, rule = HOSTILE[name]
    with pytest.raises(ValueError, match=f"^row 8 .*{rule}.*; write the file again"):
        wkb.decoded([SQUARE.wkb, data], 7)


def test_any_bytes_are_decoded_or_refused() -> None:
    """The only error left to GEOS is an open ring."""
    chance = random.Random(7)  # noqa: S311
    for _ in range(20_000):
        data = bytearray(shapely.to_wkb(chance.choice(HONEST)))
        for _ in range(chance.randint(1, 3)):
            data[chance.randrange(min(len(data), 40))] = chance.choice([0, 1, 2, 3, 4, 5, 6, 7, 32, 64, 128, 255])
        with suppress(ValueError, shapely.errors.GEOSException):
            wkb.decoded([bytes(data)])
