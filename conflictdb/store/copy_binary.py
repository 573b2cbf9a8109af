"""Encode and decode PostgreSQL's COPY BINARY format, a whole column at a time.

Ragged columns (texts, geometries, spans) are concatenated bytes with offsets. Reference: PostgreSQL documentation,
COPY, "Binary Format"; all numbers are big-endian. Geometries are WKB, little-endian on every machine.
"""

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, cast

import numpy as np
import psycopg
from numpy.typing import ArrayLike, NDArray
from psycopg.pq.abc import PGresult

from conflictdb.arrays.ragged import offsets, ragged_rows
from conflictdb.kernel.rows import Part, interleaved
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US
from conflictdb.store.connection import call, query_of, translated
from conflictdb.store.parameters import Array, ArrayDumper

Bytes = NDArray[np.uint8]
Offsets = NDArray[np.int64]

# PostgreSQL counts microseconds from 2000-01-01.
_EPOCH_US: Final = 946_684_800_000_000
_SIGNATURE: Final = b"PGCOPY\n\xff\r\n\0"
_HEADER: Final = _SIGNATURE + bytes(8)
_TRAILER: Final = b"\xff\xff"
_NULL: Final = struct.pack(">i", -1)  # replaces the length of a value
_FEW: Final = 32  # up to this many rows, encoding one by one is faster than calling the kernel
_ROWS_PER_BLOCK: Final = 20_000  # bounds the memory of sending
_CHUNK_BYTES: Final = 2**20  # decoded at a time: enough for numpy, small beside a large answer

_ARRAY_HEADER: Final = 20  # bytes for one dimension; an array without elements has 12 bytes

# OIDs of the element types of arrays (pg_type.dat), the same on every server.
_OID: Final = {
    "boolean": 16,
    "bytea": 17,
    "bigint": 20,
    "smallint": 21,
    "integer": 23,
    "text": 25,
    "tid": 27,
    "double precision": 701,
    "tstzrange": 3910,
    "timestamptz": 1184,
    "tstzmultirange": 4534,
    "int8multirange": 4536,
}

WKB_POINT: Final = 1
WKB_POLYGON: Final = 3
WKB_MULTIPOLYGON: Final = 6
WKB_LINESTRING_M: Final = 2002
EWKB_SRID: Final = 0x2000_0000


@dataclass(frozen=True, slots=True)
class Ragged:
    """n byte strings: string i is data[offset[i]:offset[i + 1]]; null where is_null."""

    data: Bytes
    offset: Offsets
    is_null: NDArray[np.bool_] | None = None

    @classmethod
    def of(cls, strings: Sequence[bytes | None]) -> "Ragged":
        """Encode byte strings; None becomes null."""
        data = np.frombuffer(b"".join(s for s in strings if s is not None), dtype=np.uint8)
        is_null = np.array([s is None for s in strings], dtype=np.bool_)
        return cls(data, offsets([0 if s is None else len(s) for s in strings]), is_null)

    def take(self, rows: NDArray[np.int64]) -> "Ragged":
        """Return the strings of the given rows, in that order, repeats allowed."""
        is_null = None if self.is_null is None else self.is_null[rows]
        offset, index = ragged_rows(self.offset, rows)
        return Ragged(self.data[index], offset, is_null)

    def but_null(self, is_null: NDArray[np.bool_]) -> "Ragged":
        """Return the same strings, but null where `is_null`."""
        kept = np.repeat(~is_null, np.diff(self.offset))
        return Ragged(self.data[kept], offsets(np.where(is_null, 0, np.diff(self.offset))), is_null)


Column = Bytes | Ragged  # (n, width) bytes of a fixed-width type, or ragged


def fixed(values: ArrayLike, dtype: str) -> Bytes:
    """Return a column of a fixed-width type: i2, i4, i8, f8 or b1."""
    array = np.ascontiguousarray(np.asarray(values), dtype=np.dtype(dtype).newbyteorder(">"))
    return array.view(np.uint8).reshape(len(array), array.dtype.itemsize)


def instants(us: NDArray[np.int64]) -> Bytes:
    """Return a column of timestamptz; MINUS_INFINITY_US and INFINITY_US become -infinity and infinity."""
    # PostgreSQL's infinities are the same two numbers.
    unbounded = (us == MINUS_INFINITY_US) | (us == INFINITY_US)
    return fixed(us - np.where(unbounded, 0, _EPOCH_US), "i8")


def microseconds(instant: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return microseconds since 1970 of decoded timestamptz (the reverse of `instants`)."""
    unbounded = (instant == MINUS_INFINITY_US) | (instant == INFINITY_US)
    return np.asarray(instant + np.where(unbounded, 0, _EPOCH_US), dtype=np.int64)


def spans(start_us: NDArray[np.int64], end_us: NDArray[np.int64], end_inclusive: NDArray[np.bool_]) -> Ragged:
    """Return a column of tstzrange: [start, end) or [start, end], without a bound where unbounded."""
    no_start, no_end = start_us == MINUS_INFINITY_US, end_us == INFINITY_US
    flags = np.where(no_start, 0x08, 0x02) | np.where(no_end, 0x10, np.where(end_inclusive, 0x04, 0))
    length = fixed(np.full(len(start_us), 8), "i4")
    whole = np.concatenate(
        [flags.astype(np.uint8)[:, None], length, instants(start_us), length, instants(end_us)], axis=1
    )
    present = np.ones(whole.shape, dtype=np.bool_)
    present[no_start, 1:13] = False
    present[no_end, 13:25] = False
    return Ragged(whole[present], offsets(present.sum(axis=1)))


def multispans(bounds_us: NDArray[np.int64], offset: Offsets) -> Ragged:
    """Return a column of tstzmultirange: row i contains the spans (m, 2) from offset[i] on, both ends included."""
    return _together(spans(bounds_us[:, 0], bounds_us[:, 1], np.ones(len(bounds_us), dtype=np.bool_)), offset)


def half_open_multispans(bounds_us: NDArray[np.int64], offset: Offsets, is_null: NDArray[np.bool_]) -> Ragged:
    """Return a column of tstzmultirange: row i contains the spans [start, end) (m, 2) from offset[i] on."""
    spans_of_rows = spans(bounds_us[:, 0], bounds_us[:, 1], np.zeros(len(bounds_us), dtype=np.bool_))
    return _together(spans_of_rows, offset).but_null(is_null)


def multiranges(bounds: NDArray[np.int64], offset: Offsets) -> Ragged:
    """Return a column of int8multirange: row i contains the ranges (m, 2) from offset[i] on, both ends included."""
    length = fixed(np.full(len(bounds), 8), "i4")
    inclusive = np.full((len(bounds), 1), 0x06, np.uint8)
    whole = np.concatenate([inclusive, length, fixed(bounds[:, 0], "i8"), length, fixed(bounds[:, 1], "i8")], axis=1)
    return _together(Ragged(whole.reshape(-1), whole.shape[1] * np.arange(len(bounds) + 1)), offset)


def _together(one: Ragged, offset: Offsets) -> Ragged:
    """Return a column of multiranges: row i contains the ranges from offset[i] on."""
    # Each span follows its length; the count of spans precedes the first span of a row.
    size = np.diff(one.offset)
    count = np.diff(offset)
    out = offsets(4 + np.bincount(np.repeat(np.arange(len(count)), count), 4 + size, len(count)).astype(np.int64))
    result = np.empty(out[-1], dtype=np.uint8)
    result[out[:-1, None] + np.arange(4)] = fixed(count, "i4")
    # Offset of each span: after all spans before it and the counts of all rows up to its own.
    start = one.offset[:-1] + 4 * np.arange(len(size)) + 4 * np.repeat(np.arange(len(count)) + 1, count)
    result[start[:, None] + np.arange(4)] = fixed(size, "i4")
    result[_rows_of(start + 4, size)] = one.data
    return Ragged(result, out)


def points(lonlat: NDArray[np.float64], srid: int) -> Ragged:
    """Return a column of points (EWKB), longitudes normalised to +-180 degrees; null where a longitude is NaN."""
    lon = lonlat[:, 0]
    beyond = np.abs(lon) > 180.0
    lon = np.where(beyond, lon - 360.0 * np.round(lon / 360.0), lon)
    head = b"\x01" + np.array([WKB_POINT | EWKB_SRID, srid], dtype="<u4").tobytes()
    whole = np.empty((len(lonlat), len(head) + 16), dtype=np.uint8)
    whole[:, : len(head)] = np.frombuffer(head, dtype=np.uint8)
    whole[:, len(head) :] = np.stack([lon, lonlat[:, 1]], axis=1).astype("<f8").view(np.uint8)
    return nullable(whole, np.isnan(lon))


def nullable(values: Bytes, is_null: NDArray[np.bool_]) -> Ragged:
    """Return a column of a fixed-width type with nulls."""
    return Ragged(values[~is_null].reshape(-1), offsets(np.where(is_null, 0, values.shape[1])), is_null)


def polygons(xy: NDArray[np.float64], offset: Offsets, srid: int) -> Ragged:
    """Return a column of polygons (EWKB), one closed ring each, from concatenated vertices."""
    return _wkb(WKB_POLYGON, [1], xy, offset, srid)


def multipolygons(xy: NDArray[np.float64], offset: Offsets, of_row: Offsets, srid: int) -> Ragged:
    """Return a column of multipolygons (EWKB) of closed rings, from concatenated vertices.

    of_row : (m + 1,) row i has the rings [of_row[i], of_row[i + 1]), at least one
    """
    rings = polygons(xy, offset, 0)
    words = [WKB_MULTIPOLYGON | (EWKB_SRID if srid else 0), *([srid] if srid else [])]
    head = np.empty((len(of_row) - 1, 5 + 4 * len(words)), dtype=np.uint8)
    head[:, 0] = 1  # little-endian
    head[:, 1:-4] = np.array(words, dtype="<u4").view(np.uint8)
    head[:, -4:] = np.diff(of_row).astype("<u4").view(np.uint8).reshape(-1, 4)
    of_bytes = rings.offset[of_row]
    return Ragged(interleaved([head, (rings.data, of_bytes)]), offsets(head.shape[1] + np.diff(of_bytes)))


def arrays(values: Bytes, offset: Offsets, of: str) -> Ragged:
    """Return a column of arrays of a fixed-width type: row i has values [offset[i], offset[i + 1]), at least one."""
    m = len(offset) - 1
    head = np.empty((m, _ARRAY_HEADER), dtype=np.uint8)
    head[:] = np.frombuffer(struct.pack(">iiiii", 1, 0, _OID[of], 0, 1), np.uint8)
    head[:, 12:16] = fixed(np.diff(offset), "i4")
    sized = np.concatenate([fixed(np.full(len(values), values.shape[1]), "i4"), values], axis=1)
    width = sized.shape[1]
    return Ragged(
        interleaved([head, (sized.reshape(-1), width * offset)]), offsets(_ARRAY_HEADER + width * np.diff(offset))
    )


def where(column: Ragged, is_there: NDArray[np.bool_]) -> Ragged:
    """Return a column that has the values of `column` in rows where `is_there`, in order, and null elsewhere."""
    length = np.zeros(len(is_there), dtype=np.int64)
    length[is_there] = np.diff(column.offset)
    return Ragged(column.data, offsets(length), ~is_there)


def array_values(sent: Iterable[bytes], kind: str) -> NDArray[Any]:
    """Return the concatenated values of arrays in the format of array_send, without nulls.

    kind : numpy type without byte order
    """
    data = b"".join([one[_ARRAY_HEADER:] for one in sent])
    return _native(np.frombuffer(data, [("length", ">i4"), ("value", f">{kind}")])["value"])


def array_length(sent: bytes, kind: str) -> int:
    """Return the number of values of an array in the format of array_send, without nulls; 0 for no bytes."""
    return max(len(sent) - _ARRAY_HEADER, 0) // (4 + np.dtype(kind).itemsize)


def int8_array(sent: bytes) -> NDArray[np.int64]:
    """Return the numbers of a one-dimensional array in the format of array_send, without nulls."""
    # The header, then each number after its length.
    numbers = np.frombuffer(sent, [("length", ">i4"), ("number", ">i8")], offset=20 if sent[3] else len(sent))
    return _native(numbers["number"])


def float8_array(sent: bytes) -> NDArray[np.float64]:
    """Return the numbers of a one-dimensional array in the format of array_send; NaN for null."""
    count = int.from_bytes(sent[12:16], "big") if sent[3] else 0
    numbers, at = np.full(count, np.nan), 20
    for i in range(count):
        size = int.from_bytes(sent[at : at + 4], "big", signed=True)
        at += 4
        if size > 0:
            numbers[i] = np.frombuffer(sent, dtype=">f8", count=1, offset=at)[0]
            at += size
    return numbers


def lines_m(xym: NDArray[np.float64], offset: Offsets) -> Ragged:
    """Return a column of LineStringM (WKB), from concatenated vertices."""
    return _wkb(WKB_LINESTRING_M, [], xym, offset, 0)


def _wkb(code: int, before: list[int], vertices: NDArray[np.float64], offset: Offsets, srid: int) -> Ragged:
    count = np.diff(offset)
    n = len(count)
    words = [code | (EWKB_SRID if srid else 0), *([srid] if srid else []), *before]
    head = np.empty((n, 5 + 4 * len(words)), dtype=np.uint8)
    head[:, 0] = 1  # little-endian
    head[:, 1:-4] = np.array(words, dtype="<u4").view(np.uint8)
    head[:, -4:] = count.astype("<u4").view(np.uint8).reshape(n, 4)
    size = 8 * vertices.shape[1]
    data = np.ascontiguousarray(vertices, dtype="<f8").view(np.uint8).reshape(-1)
    return Ragged(interleaved([head, (data, size * offset)]), offsets(head.shape[1] + size * count))


def closed_rings(xy: NDArray[np.float64], offset: Offsets) -> tuple[NDArray[np.float64], Offsets]:
    """Close open rings; a single point becomes [a, a, a, a], a line [a, b, b, a]: a ring has at least four points."""
    count = np.diff(offset)
    closed = offsets(np.maximum(count, 3) + 1)
    nth = np.arange(closed[-1]) - np.repeat(closed[:-1], np.diff(closed))
    of = np.repeat(np.arange(len(count)), np.diff(closed))
    last = nth == np.diff(closed)[of] - 1
    index = np.where(last, 0, np.minimum(nth, count[of] - 1))
    return xy[offset[:-1][of] + index], closed


def open_rings(xy: NDArray[np.float64], offset: Offsets) -> tuple[NDArray[np.float64], Offsets]:
    """Open closed rings: the reverse of `closed_rings`."""
    count = np.diff(offset) - 1
    small = np.flatnonzero(count == 3)
    a, b, c = (xy[offset[small] + k] for k in range(3))
    line = (b == c).all(axis=1)
    count[small[line]] = 2
    count[small[line & (a == b).all(axis=1)]] = 1
    return xy[_rows_of(offset[:-1], count)], offsets(count)


def send(conn: psycopg.Connection[Any], table: str, columns: Mapping[str, Column]) -> None:
    """COPY columns into a table; the names of table and columns come from this package only."""
    send_rows(conn, table, columns, _blocks(list(columns.values())))


def rows(columns: Mapping[str, Column]) -> list[bytes]:
    """Encode columns as rows, for `send_rows`."""
    return list(_blocks(list(columns.values())))


def send_rows(conn: psycopg.Connection[Any], table: str, columns: Iterable[str], blocks: Iterable[bytes]) -> None:
    """COPY encoded rows of the named columns into a table; see `send`."""
    statement = f"COPY {table} ({', '.join(columns)}) FROM STDIN (FORMAT BINARY)"
    with translated(), conn.cursor() as cursor, cursor.copy(statement.encode()) as copy:
        copy.write(_HEADER)
        for block in blocks:
            copy.write(block)
        copy.write(_TRAILER)


def _blocks(columns: list[Column], rows: int = _ROWS_PER_BLOCK) -> Iterator[bytes]:
    n = length(columns[0])
    for first in range(0, n, rows):
        yield _block(columns, first, min(first + rows, n)).tobytes()


def _block(columns: list[Column], first: int, end: int) -> Bytes:
    """Encode rows [first, end): per row the number of fields, per field its length (-1 null) and data."""
    n = end - first
    parts: list[Part] = [fixed(np.full(n, len(columns)), "i2")]
    for column in columns:
        parts += fields(column, first, end)
    return interleaved(parts)


def array(columns: Sequence[Column], of: str) -> Array:
    """Return the concatenated values of columns of one type as an array: a parameter of a statement."""
    count = sum(map(length, columns))
    if not count:
        return Array(struct.pack(">iii", 0, 0, _OID[of]))
    values = b"".join(_with_lengths(column) for column in columns)
    return Array(struct.pack(">iiiii", 1, 1, _OID[of], count, 1) + values)


def _with_lengths(column: Column) -> bytes:
    """Return the concatenated values of a column, each after its length (-1 null)."""
    if not isinstance(column, np.ndarray):
        return _few_with_lengths(column) if length(column) <= _FEW else interleaved(fields(column)).tobytes()
    n, width = column.shape
    values = np.empty((n, 4 + width), np.uint8)
    values[:, :4] = np.frombuffer(struct.pack(">i", width), np.uint8)
    values[:, 4:] = column
    return values.tobytes()


def _few_with_lengths(column: Ragged) -> bytes:
    """Return the same as `_with_lengths`, for few rows."""
    data, offset = column.data.tobytes(), column.offset.tolist()
    values = [struct.pack(">i", end - start) + data[start:end] for start, end in pairwise(offset)]
    if column.is_null is not None:
        values = [_NULL if is_null else value for value, is_null in zip(values, column.is_null.tolist(), strict=True)]
    return b"".join(values)


def length(column: Column) -> int:
    """Return the number of values in a column."""
    return len(column) if isinstance(column, np.ndarray) else len(column.offset) - 1


def fields(column: Column, first: int = 0, end: int | None = None) -> list[Part]:
    """Return the values [first, end) of a column as parts of rows: the length of each (-1 null), and its bytes."""
    if isinstance(column, np.ndarray):
        data = column[first:end]
        return [fixed(np.full(len(data), data.shape[1]), "i4"), data]
    offset = column.offset[first : None if end is None else end + 1]
    lengths = np.diff(offset)
    announced = lengths if column.is_null is None else np.where(column.is_null[first:end], -1, lengths)
    return [fixed(announced, "i4"), (column.data, offset)]


def taken(column: Column, rows: NDArray[np.int64]) -> Column:
    """Return the values of a column at the given rows."""
    return column[rows] if isinstance(column, np.ndarray) else column.take(rows)


def receive(
    conn: psycopg.Connection[Any],
    routine: str,
    arguments: Sequence[object],
    dtype: Sequence[tuple[str, str]],
    ragged: Sequence[str] = (),
) -> tuple[dict[str, NDArray[Any]], dict[str, list[bytes]]]:
    """Return the rows of a set-returning routine: fixed-width columns as arrays, ragged columns as lists of bytes.

    The routine's columns are those of `dtype` (numpy types without byte order), then those of `ragged`; none is null.
    Rows are decoded as they arrive.
    """
    with _copied(conn, routine, arguments) as messages:
        return decoded(messages, dtype, ragged)


def receive_each(
    conn: psycopg.Connection[Any],
    routine: str,
    arguments: Sequence[object],
    dtype: Sequence[tuple[str, str]],
    ragged: Sequence[str] = (),
) -> Iterator[tuple[dict[str, NDArray[Any]], dict[str, list[bytes]]]]:
    """Yield the result of `receive` in chunks of rows, possibly empty; the connection is busy until the last chunk."""
    row_type = _row_type(dtype)
    with _copied(conn, routine, arguments) as messages:
        for rows in _chunks(messages):
            strings: dict[str, list[bytes]] = {name: [] for name in ragged}
            table = np.frombuffer(_cut(rows, row_type.itemsize, strings) if ragged else rows, dtype=row_type)
            yield {name: _native(table[name]) for name, _ in dtype}, strings


@contextmanager
def _copied(
    conn: psycopg.Connection[Any], routine: str, arguments: Sequence[object]
) -> Iterator[Iterable[bytes | bytearray | memoryview]]:
    """Yield the messages of a COPY of a routine's rows."""
    statement = b"COPY (%s) TO STDOUT (FORMAT BINARY)" % query_of(routine, arguments)
    with translated(routine), conn.cursor() as cursor, cursor.copy(statement, arguments) as copy:
        yield copy


def receive_arrays(
    conn: psycopg.Connection[Any], routine: str, arguments: Sequence[object], dtype: Sequence[tuple[str, str]]
) -> dict[str, NDArray[Any]]:
    """Return the columns of a routine that returns each column as one array (array_send), without nulls."""
    columns = {}
    for (name, kind), sent in zip(dtype, call(conn, routine, *arguments), strict=True):
        values = np.frombuffer(sent[_ARRAY_HEADER:], [("length", ">i4"), ("value", f">{kind}")])
        columns[name] = _native(values["value"])
    return columns


def few(
    conn: psycopg.Connection[Any],
    routine: str,
    arguments: Sequence[object],
    dtype: Sequence[tuple[str, str]],
    ragged: Sequence[str] = (),
) -> tuple[dict[str, NDArray[Any]], dict[str, list[bytes]]]:
    """Return the rows of a set-returning routine as `receive` does; faster if there are few.

    Arguments may be arrays (`array`).
    """
    with translated(routine), psycopg.Cursor(conn) as cursor:
        cursor.adapters.register_dumper(Array, ArrayDumper)
        cursor.execute(query_of(routine, arguments), arguments, prepare=False, binary=True)
        sent = cast("PGresult", cursor.pgresult)
        rows, value = range(sent.ntuples), sent.get_value
        columns = [[value(row, column) or b"" for row in rows] for column in range(len(dtype) + len(ragged))]
    fixed_width = {
        name: _native(np.frombuffer(b"".join(column), dtype=f">{kind}"))
        for (name, kind), column in zip(dtype, columns[: len(dtype)], strict=True)
    }
    return fixed_width, dict(zip(ragged, columns[len(dtype) :], strict=True))


def decoded(
    messages: Iterable[bytes | bytearray | memoryview], dtype: Sequence[tuple[str, str]], ragged: Sequence[str] = ()
) -> tuple[dict[str, NDArray[Any]], dict[str, list[bytes]]]:
    """Decode the messages of a COPY TO; returns columns as `receive` does."""
    row_type = _row_type(dtype)
    chunks: dict[str, list[NDArray[Any]]] = {name: [] for name, _ in dtype}
    strings: dict[str, list[bytes]] = {name: [] for name in ragged}
    for rows in _chunks(messages):
        table = np.frombuffer(_cut(rows, row_type.itemsize, strings) if ragged else rows, dtype=row_type)
        for name, _ in dtype:
            chunks[name].append(_native(table[name]))
    # Free the chunks of each column before the next column is joined.
    return {name: np.concatenate(chunks.pop(name)) for name, _ in dtype}, strings


def _row_type(dtype: Sequence[tuple[str, str]]) -> np.dtype[Any]:
    """Return the numpy layout of the fixed-width columns of an encoded row."""
    layout = [("fields", ">i2")]
    for name, kind in dtype:
        layout += [(f"{name} length", ">i4"), (name, f">{kind}")]
    return np.dtype(layout)


def _chunks(messages: Iterable[bytes | bytearray | memoryview]) -> Iterator[bytes]:
    """Yield the rows of a COPY TO in chunks, without its header and trailer; at least one chunk. No row spans two."""
    parts_of_chunk: list[bytes | bytearray | memoryview] = []
    size, start = 0, len(_HEADER)
    for message in messages:
        # The last message is the trailer. Keep each chunk until another message arrives.
        if size >= _CHUNK_BYTES:
            yield b"".join(parts_of_chunk)[start:]
            parts_of_chunk, size, start = [], 0, 0
        parts_of_chunk.append(message)
        size += len(message)
    yield b"".join(parts_of_chunk)[start : -len(_TRAILER)]


def _cut(rows: bytes, width: int, strings: dict[str, list[bytes]]) -> bytes:
    """Return the concatenated fixed-width parts of rows, and append the ragged values to their columns."""
    fixed_parts = []
    appends = [column.append for column in strings.values()]
    start, end = 0, len(rows)
    while start < end:
        fixed_parts.append(rows[start : start + width])
        start += width
        for append in appends:
            first = start + 4
            start = first + int.from_bytes(rows[start:first], "big")
            append(rows[first:start])
    return b"".join(fixed_parts)


def vertices(wkb: Sequence[bytes], code: int) -> tuple[NDArray[np.float64], Offsets]:
    """Return the concatenated vertices, and offsets, of geometries of one ring or line: Polygon or LineStringM."""
    head, ordinates = {WKB_POLYGON: (13, 2), WKB_LINESTRING_M: (9, 3)}[code]
    size = 8 * ordinates
    data = b"".join([item[head:] for item in wkb])
    count = np.array([(len(item) - head) // size for item in wkb], dtype=np.int64)
    return np.frombuffer(data, dtype="<f8").astype(np.float64).reshape(-1, ordinates), offsets(count)


def _native(values: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("="))


def _rows_of(start: Offsets, length: Offsets) -> NDArray[np.int64]:
    """Return the indices [start, start + length) of all rows, concatenated."""
    ends = np.cumsum(length)
    return np.arange(ends[-1] if len(ends) else 0) + np.repeat(start - (ends - length), length)
