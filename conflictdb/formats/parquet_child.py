"""Read Parquet files of one schema, and write them as an Arrow stream: a program of `confined_child`.

    parquet_child.py PATH...

Compressed data in them may unpack to any size.
"""

import json
import sys
from pathlib import Path
from typing import IO, Any, Final

# Least size counted per value: that of a Python reference, since Arrow stores nulls and booleans in bits.
VALUE_BYTES: Final = 8
# Rows decoded at a time (at least one): enough for speed, little memory.
ROWS_AT_ONCE: Final = 8_192
BYTES_AT_ONCE: Final = 16_000_000


def main(sink: IO[bytes], most_bytes: int, paths: list[str]) -> None:
    """Write the rows of files of one schema."""
    sys.modules["numpy"] = None  # type: ignore[assignment]  # half of the start, for functions that are not called here
    import pyarrow as pa
    import pyarrow.parquet as pq

    size = 0
    first: Any = None
    writer: Any = None  # set by the first part; there is at least one
    with pa.output_stream(sink) as stream:
        for path in paths:
            try:
                with pq.ParquetFile(path, pre_buffer=False) as file:
                    first = first or file.schema_arrow
                    _require_alike(first, file.schema_arrow)
                    plain = pa.schema([field.with_type(_plain(field.type)) for field in first], first.metadata)
                    writer = writer or pa.ipc.new_stream(stream, plain)
                    for batch in file.iter_batches(_rows_at_once(file), use_threads=False):
                        columns = [
                            column if column.type == field.type else column.cast(field.type)
                            for column, field in zip(batch.columns, plain, strict=True)
                        ]
                        plain_batch = pa.RecordBatch.from_arrays(columns, schema=plain)
                        size += max(plain_batch.nbytes, VALUE_BYTES * plain_batch.num_rows * plain_batch.num_columns)
                        if size > most_bytes:
                            raise MemoryError
                        writer.write_batch(plain_batch)
            except MemoryError:
                raise
            except Exception as error:  # any error is reported with the part's name
                raise ValueError(str(error) if len(paths) == 1 else f"{Path(path).name}: {error}") from error
        writer.close()


def _plain(of: Any) -> Any:
    """Return the type without dictionaries and views."""
    import pyarrow as pa

    if pa.types.is_dictionary(of):
        return _plain(of.value_type)
    if pa.types.is_string_view(of):
        return pa.string()
    if pa.types.is_binary_view(of):
        return pa.binary()
    if pa.types.is_list(of):
        return pa.list_(of.value_field.with_type(_plain(of.value_type)))
    if pa.types.is_large_list(of):
        return pa.large_list(of.value_field.with_type(_plain(of.value_type)))
    if pa.types.is_fixed_size_list(of):
        return pa.list_(of.value_field.with_type(_plain(of.value_type)), of.list_size)
    if pa.types.is_map(of):
        return pa.map_(_plain(of.key_type), of.item_field.with_type(_plain(of.item_type)))
    if pa.types.is_struct(of):
        return pa.struct([field.with_type(_plain(field.type)) for field in of])
    return of


def _rows_at_once(file: Any) -> int:
    groups = [file.metadata.row_group(i) for i in range(file.num_row_groups)]
    row_bytes = max((of.total_byte_size // max(of.num_rows, 1) for of in groups), default=0)
    row_bytes = max(row_bytes, VALUE_BYTES * file.metadata.num_columns)
    return min(ROWS_AT_ONCE, max(1, BYTES_AT_ONCE // max(row_bytes, 1)))


def _require_alike(first: Any, other: Any) -> None:
    """Raise ValueError for a part whose columns or metadata differ from the first part's."""
    if not other.equals(first):
        names = dict.fromkeys([*first.names, *other.names])
        differing = ", ".join(name for name in names if _fields(first, name) != _fields(other, name))
        raise ValueError(f"has different columns than the parts before: {differing or 'in another order'}")
    if _meaning(other) != _meaning(first):
        raise ValueError(
            "says other things of itself than the parts before, such as another reference system or other settings of "
            "the scene"
        )


def _fields(schema: Any, name: str) -> list[Any]:
    return [schema.field(i) for i in schema.get_all_field_indices(name)]


def _meaning(schema: Any) -> tuple[Any, Any]:
    """Return the metadata that concern all rows of a part, without bounding boxes and lists of geometry types."""
    metadata = schema.metadata or {}
    geo = metadata.get(b"geo")
    try:
        geo_metadata = json.loads(geo or b"null")
        columns = {
            name: {key: value for key, value in column.items() if key not in ("bbox", "geometry_types")}
            for name, column in geo_metadata["columns"].items()
        }
        return (geo_metadata["primary_column"], columns), metadata.get(b"conflictdb")
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return geo, metadata.get(b"conflictdb")
