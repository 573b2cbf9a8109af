"""COPY BINARY from arrays: rows encoded in bulk are those of PostgreSQL's own format, row by row."""

import struct
import tracemalloc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import shapely

from conflictdb.arrays.ragged import offsets
from conflictdb.kernel.rows import interleaved
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US
from conflictdb.store import copy_binary
from conflictdb.store.copy_binary import Ragged

EPOCH_US = 946_684_800_000_000


def strings(column: Ragged) -> list[bytes]:
    return [column.data[i:j].tobytes() for i, j in zip(column.offset[:-1], column.offset[1:], strict=True)]


def test_rows_are_field_counts_lengths_and_data() -> None:
    columns: list[Any] = [
        copy_binary.fixed([1, -2], "i4"),
        Ragged.of([b"abc", None]),
        copy_binary.fixed([0.5, 2], "f8"),
    ]
    expected = b"".join(
        [
            struct.pack(">hiii3sid", 3, 4, 1, 3, b"abc", 8, 0.5),
            struct.pack(">hiiiid", 3, 4, -2, -1, 8, 2.0),
        ]
    )
    assert b"".join(copy_binary._blocks(columns)) == expected


def test_blocks_of_many_rows_join_seamlessly() -> None:
    texts = [b"x" * (n % 7) if n % 5 else None for n in range(100)]
    columns: list[Any] = [Ragged.of(texts), copy_binary.fixed(np.arange(100), "i8")]
    whole = b"".join(copy_binary._blocks(columns))
    assert b"".join(copy_binary._blocks(columns, 7)) == whole


def test_no_rows_are_no_bytes() -> None:
    assert list(copy_binary._blocks([copy_binary.fixed([], "i8"), Ragged.of([])])) == []


def test_instants_count_from_2000_and_keep_infinities() -> None:
    us = np.array([0, EPOCH_US, MINUS_INFINITY_US, INFINITY_US, 1_700_000_000_000_001])
    sent = copy_binary.instants(us).view(">i8").ravel()
    assert sent.tolist() == [-EPOCH_US, 0, MINUS_INFINITY_US, INFINITY_US, 1_700_000_000_000_001 - EPOCH_US]
    np.testing.assert_array_equal(copy_binary.microseconds(sent.astype(np.int64)), us)


def test_multispans_are_counts_and_spans_with_their_lengths() -> None:
    bounds = np.array([[EPOCH_US + 1, EPOCH_US + 2], [MINUS_INFINITY_US, EPOCH_US], [EPOCH_US, INFINITY_US]])
    one, two, three = strings(copy_binary.spans(bounds[:, 0], bounds[:, 1], np.ones(3, np.bool_)))
    found = strings(copy_binary.multispans(bounds, np.array([0, 0, 1, 3, 3])))
    none = struct.pack(">i", 0)
    assert found == [
        none,
        struct.pack(">ii", 1, len(one)) + one,
        struct.pack(">ii", 2, len(two)) + two + struct.pack(">i", len(three)) + three,
        none,
    ]


def test_points_are_wrapped_or_null() -> None:
    found = copy_binary.points(np.array([[181.0, 50.0], [np.nan, 1.0], [-180.0, -90.0], [-540.5, 0.0]]), 4326)
    first, none, *rest = strings(found)
    assert first == shapely.to_wkb(shapely.set_srid(shapely.Point(-179, 50), 4326), byte_order=1, include_srid=True)
    assert none == b""
    assert [shapely.from_wkb(one).coords[0] for one in rest] == [(-180.0, -90.0), (179.5, 0.0)]
    assert found.is_null is not None
    assert found.is_null.tolist() == [False, True, False, False]


def test_nullable_columns_hold_what_is_not_null() -> None:
    column = copy_binary.nullable(copy_binary.fixed([1, 2, 3], "i2"), np.array([False, True, False]))
    assert b"".join(copy_binary._blocks([column])) == struct.pack(">hihhihih", 1, 2, 1, 1, -1, 1, 2, 3)


def test_strings_are_taken_as_often_as_asked_for() -> None:
    assert strings(Ragged.of([b"a", b"bcd"]).take(np.array([1, 0, 1]))) == [b"bcd", b"a", b"bcd"]


def test_spans_name_their_bounds() -> None:
    start = np.array([EPOCH_US + 1, MINUS_INFINITY_US, EPOCH_US, MINUS_INFINITY_US])
    end = np.array([EPOCH_US + 2, EPOCH_US, INFINITY_US, INFINITY_US])
    found = strings(copy_binary.spans(start, end, np.array([True, False, False, True])))
    assert found == [
        struct.pack(">Biqiq", 0x02 | 0x04, 8, 1, 8, 2),
        struct.pack(">Biq", 0x08, 8, 0),
        struct.pack(">Biq", 0x02 | 0x10, 8, 0),
        struct.pack(">B", 0x08 | 0x10),
    ]


@pytest.mark.parametrize("srid", [0, 3395])
def test_polygons_are_wkb_that_shapely_reads(srid: int) -> None:
    rings = [
        [(0.0, 0.0), (1.0, 0.0), (1.0, 2.0), (0.0, 0.0)],
        [(5.0, 5.0), (6.0, 5.0), (6.0, 6.5), (5.5, 7.0), (5.0, 5.0)],
    ]
    xy = np.concatenate([np.array(ring) for ring in rings])
    column = copy_binary.polygons(xy, offsets([4, 5]), srid)
    polygons = shapely.from_wkb(strings(column))
    assert [list(polygon.exterior.coords) for polygon in polygons] == rings
    assert shapely.get_srid(polygons).tolist() == [srid, srid]


def test_lines_with_m_are_wkb_and_come_back_to_the_bit() -> None:
    xym = np.array([[0.1, 0.2, 1.7e9 + 1e-6], [-179.999, 89.0, 1.8e9], [3.0, -0.0, 0.0], [4.0, 5.0, 6.0]])
    column = copy_binary.lines_m(xym, offsets([2, 2]))
    lines = shapely.from_wkb(strings(column))
    assert [line.has_m and not line.has_z for line in lines] == [True, True]
    back, offset = copy_binary.vertices(strings(column), copy_binary.WKB_LINESTRING_M)
    assert back.tobytes() == xym.tobytes()
    assert offset.tolist() == [0, 2, 4]


def test_rings_close_and_open_again_also_points_and_lines() -> None:
    rings = [
        [(1.0, 2.0)],
        [(1.0, 2.0), (3.0, 4.0)],
        [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)],
        [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)],
    ]
    xy = np.concatenate([np.array(ring) for ring in rings])
    offset = offsets([len(ring) for ring in rings])
    closed, closed_offset = copy_binary.closed_rings(xy, offset)
    assert np.diff(closed_offset).tolist() == [4, 4, 4, 5]
    assert closed[:4].tolist() == [[1, 2]] * 4
    assert closed[4:8].tolist() == [[1, 2], [3, 4], [3, 4], [1, 2]]
    np.testing.assert_array_equal(closed[closed_offset[:-1]], closed[closed_offset[1:] - 1])
    back, back_offset = copy_binary.open_rings(closed, closed_offset)
    assert back.tobytes() == xy.tobytes()
    assert back_offset.tolist() == offset.tolist()


def test_no_rings_stay_no_rings() -> None:
    closed, offset = copy_binary.closed_rings(np.empty((0, 2)), np.zeros(1, np.int64))
    assert closed.shape == (0, 2)
    opened, offset = copy_binary.open_rings(closed, offset)
    assert opened.shape == (0, 2)
    assert offset.tolist() == [0]


HEADER, TRAILER = b"PGCOPY\n\xff\r\n\0" + bytes(8), b"\xff\xff"


def sent(n: int, size: int | None = None) -> Iterator[bytes]:
    """Messages of a COPY TO of n rows of two numbers, and a text of `size` bytes; the first begins with the header."""
    start = HEADER
    for i in range(n):
        text = b"" if size is None else struct.pack(">i", size) + b"%*d" % (size, i)
        yield start + struct.pack(">hiqid", 2 + (size is not None), 8, -i, 8, i / 2) + text
        start = b""
    yield start + TRAILER


COLUMNS = [("i", "i8"), ("half", "f8")]


@pytest.mark.parametrize("n", [0, 1, 100_000])
@pytest.mark.parametrize("size", [None, 12])
def test_rows_are_decoded_as_they_come(n: int, size: int | None) -> None:
    columns, texts = copy_binary.decoded(sent(n, size), COLUMNS, [] if size is None else ["text"])
    assert [columns[name].dtype.str for name in ("i", "half")] == ["<i8", "<f8"]
    np.testing.assert_array_equal(columns["i"], -np.arange(n))
    np.testing.assert_array_equal(columns["half"], np.arange(n) / 2)
    assert texts == ({} if size is None else {"text": [b"%12d" % i for i in range(n)]})


def test_header_and_trailer_may_come_by_themselves_and_rows_be_large() -> None:
    rows = list(sent(3, 2**20))
    first = rows[0].removeprefix(HEADER)
    for messages in ([HEADER, first, *rows[1:]], [rows[0] + rows[1] + rows[2] + rows[3]], rows):
        columns, texts = copy_binary.decoded(messages, COLUMNS, ["text"])
        assert columns["i"].tolist() == [0, -1, -2]
        assert [int(text) for text in texts["text"]] == [0, 1, 2]


@pytest.mark.parametrize("size", [None, 100])
def test_an_answer_is_not_held_twice(size: int | None) -> None:
    """At most one and a half times the answer, and a few chunks: the largest of these columns is half of them."""
    row = struct.pack(">hiqid", 2, 8, 7, 8, 0.5) if size is None else next(sent(1, size)).removeprefix(HEADER)
    message, count = 1000 * row, 1000 if size is None else 50
    messages = [HEADER, *[message] * count, TRAILER]
    tracemalloc.start()
    try:
        answer = copy_binary.decoded(messages, COLUMNS, [] if size is None else ["text"])
        held, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(answer[0]["i"]) == 1000 * count
    assert peak < 1.5 * held + 6 * 2**20


@pytest.mark.parametrize("offset", [[0, 4, 2], [-1, 1, 2], [0, 2, 9], [1, 0, 3]])
def test_parts_beyond_their_bytes_are_refused(offset: list[int]) -> None:
    with pytest.raises(ValueError, match="kernel"):
        interleaved([np.zeros((2, 3), np.uint8), (np.zeros(4, np.uint8), np.array(offset))])


def test_parts_of_other_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="kernel"):
        interleaved([np.zeros((2, 3), np.uint8), np.zeros((3, 1), np.uint8)])


def test_rows_are_their_parts_one_after_the_other() -> None:
    """Also of empty parts, and of bytes that are not used at all."""
    fixed = np.arange(4, dtype=np.uint8).reshape(2, 2)
    ragged = np.arange(10, 20, dtype=np.uint8), np.array([1, 1, 4])
    assert interleaved([fixed, ragged, np.empty((2, 0), np.uint8)]).tolist() == [0, 1, 2, 3, 11, 12, 13]
    assert interleaved([fixed[:0]]).tolist() == []


def test_arrays_of_few_values_are_those_of_many() -> None:
    """Whether they are written one by one or by the kernel, nulls and all."""
    strings = [None if i % 7 == 3 else bytes([i]) * (i % 5) for i in range(100)]
    many = copy_binary.array([copy_binary.Ragged.of(strings)], "bytea").sent
    few = [copy_binary.array([copy_binary.Ragged.of(strings[i : i + 4])], "bytea").sent for i in range(0, 100, 4)]
    head = 20  # dimensions, nulls, type, length, lower bound
    assert many[head:] == b"".join(sent[head:] for sent in few)
