"""Reads Parquet files of one schema, and writes what they hold as a stream of Arrow: a program of `confined_child`.

    parquet_child.py PATH...

What is compressed or coded in them may unpack to any size.
"""

import json
from typing import IO, Any, Final

# What is decoded at once, but for a row that is larger: enough to be quick, little in memory.
ROWS_AT_ONCE: Final = 8_192
BYTES_AT_ONCE: Final = 16_000_000


def main(sink: IO[bytes], most_bytes: int, paths: list[str]) -> None:
    """Write the rows of files of one schema."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    size, schema, meaning = 0, None, None
    with pa.output_stream(sink) as stream:
        writer = None
        for path in paths:
            with pq.ParquetFile(path, pre_buffer=False) as file:
                schema = schema or file.schema_arrow
                if not file.schema_arrow.equals(schema):
                    raise ValueError(f"its parts have different columns: {paths[0]} and {path}")
                meaning = meaning or _meaning(schema)
                if _meaning(file.schema_arrow) != meaning:
                    raise ValueError(
                        f"its parts say different things of themselves, such as another reference system or other "
                        f"settings of the scene: {paths[0]} and {path}"
                    )
                groups = [file.metadata.row_group(i) for i in range(file.num_row_groups)]
                row_bytes = max((of.total_byte_size // max(of.num_rows, 1) for of in groups), default=0)
                rows = min(ROWS_AT_ONCE, max(1, BYTES_AT_ONCE // max(row_bytes, 1)))
                for batch in file.iter_batches(rows, use_threads=False):
                    # What stands for many equal values is as large as these.
                    plain = pa.RecordBatch.from_arrays(
                        [
                            column.dictionary_decode() if pa.types.is_dictionary(column.type) else column
                            for column in batch.columns
                        ],
                        names=batch.schema.names,
                    ).replace_schema_metadata(schema.metadata)
                    size += plain.nbytes
                    if size > most_bytes:
                        raise MemoryError
                    writer = writer or pa.ipc.new_stream(stream, plain.schema)
                    writer.write_batch(plain)
        writer = writer or pa.ipc.new_stream(stream, schema)
        writer.close()


def _meaning(schema: Any) -> tuple[Any, Any]:
    """Return what the metadata of a part say of all its rows, but for where they are and what is among them."""
    metadata = schema.metadata or {}
    geo = metadata.get(b"geo")
    try:
        told = json.loads(geo or b"null")
        columns = {
            name: {key: value for key, value in column.items() if key not in ("bbox", "geometry_types")}
            for name, column in told["columns"].items()
        }
        return (told["primary_column"], columns), metadata.get(b"conflictdb")
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return geo, metadata.get(b"conflictdb")
