"""Convert objects and conflicts to and from Arrow, for other engines, processes and files.

Needs the extra `parquet`: ``pip install 'conflictdb[parquet]'``; without it importing this raises ConflictDBError.
Numbers are converted bit by bit, most of them without copying. docs/reference/arrow.md lists the columns.
"""

from conflictdb.errors import ConflictDBError

try:
    import pyarrow as pa  # noqa: F401
except ImportError:
    raise ConflictDBError("Arrow and Parquet need pyarrow: pip install 'conflictdb[parquet]'") from None
