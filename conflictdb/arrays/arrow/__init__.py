"""The Arrow form of objects, pieces, pairs and answers: what other engines, processes and files hand the stages.

Needs the extra `parquet`: ``pip install 'conflictdb[parquet]'``; without it importing this raises ConflictDBError.
Numbers go from and to arrays bit by bit, most of them without being copied. docs/reference/arrow.md lists the columns.
"""

from conflictdb.errors import ConflictDBError

try:
    import pyarrow as pa  # noqa: F401
except ImportError:
    raise ConflictDBError("Arrow and Parquet need pyarrow: pip install 'conflictdb[parquet]'") from None
