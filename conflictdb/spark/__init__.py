"""Run the stages on Apache Spark with Apache Sedona, for scenes that outgrow one machine (extra `spark`).

This room only converts between Spark's Arrow batches and the functions that `detect` and `solve` use for pieces, pairs
and answers.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from conflictdb.spark.on_cluster import detect_on_spark

__all__ = ["detect_on_spark"]


def __getattr__(name: str) -> Any:
    if name != "detect_on_spark":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module("conflictdb.spark.on_cluster").detect_on_spark
