"""Reads Parquet files of one schema in a process of its own, and writes what they hold to stdout as a stream of Arrow.

What is compressed or coded may unpack to any size, and the library that does it is in C++. So this process has an
environment of its own, cannot write files, and may use only so much memory and time; `parquet_process` starts it, gives
it its limits and reads what it says. It imports nothing of the package, which takes longer than reading a file.

    parquet_child.py MOST_BYTES MOST_MEMORY_BYTES MOST_SECONDS PATH...

What is wrong is told on stderr as JSON: ``too_large`` or ``refused``.
"""

import json
import resource
import sys
from typing import Final

# Rows that are decoded at once: enough to be quick, little in memory.
ROWS_AT_ONCE: Final = 8_192


def main(most_bytes: int, most_memory_bytes: int, most_seconds: int, paths: list[str]) -> dict[str, str]:
    """Write the rows of files of one schema; return what is wrong, empty if nothing is."""
    for what, most in (
        (resource.RLIMIT_AS, most_memory_bytes),
        (resource.RLIMIT_CPU, most_seconds),
        (resource.RLIMIT_FSIZE, 0),  # of regular files; a pipe is none
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, most))
    import pyarrow as pa
    import pyarrow.parquet as pq

    size, schema = 0, None
    try:
        with pa.output_stream(sys.stdout.buffer) as stream:
            writer = None
            for path in paths:
                with pq.ParquetFile(path, pre_buffer=False) as file:
                    schema = schema or file.schema_arrow
                    if not file.schema_arrow.equals(schema):
                        return {"refused": f"its parts have different columns: {paths[0]} and {path}"}
                    for batch in file.iter_batches(ROWS_AT_ONCE, use_threads=False):
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
                            return {"too_large": ""}
                        writer = writer or pa.ipc.new_stream(stream, plain.schema)
                        writer.write_batch(plain)
            writer = writer or pa.ipc.new_stream(stream, schema)
            writer.close()
    except (MemoryError, pa.ArrowMemoryError):
        return {"too_large": ""}
    except Exception as error:  # whatever it is, this file cannot be read
        return {"refused": str(error)}
    return {}


if __name__ == "__main__":
    most_bytes, most_memory_bytes, most_seconds, *paths = sys.argv[1:]
    wrong = main(int(most_bytes), int(most_memory_bytes), int(most_seconds), paths)
    json.dump(wrong, sys.stderr)
    sys.exit(bool(wrong))
