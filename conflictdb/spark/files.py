"""GeoParquet on Spark: objects in, conflicts out, by all workers at once; a path is what Spark can read and write."""

from collections.abc import Sequence

from pyspark.errors import AnalysisException
from pyspark.sql import DataFrame, SparkSession, functions

from conflictdb.arrays.arrow.found import GEOMETRIES
from conflictdb.arrays.arrow.objects import OBJECTS
from conflictdb.errors import InvalidInput
from conflictdb.io.computed import STATES, settings_text
from conflictdb.model import Scene


def read_objects(spark: SparkSession, paths: Sequence[str]) -> DataFrame:
    """Return the objects of GeoParquet files, or directories of them; raises InvalidInput for others."""
    try:
        objects = spark.read.parquet(*paths)
    except AnalysisException as error:
        raise InvalidInput(", ".join(paths), "", f"is no Parquet that Spark can read: {_first_line(error)}") from error
    missing = [one.name for one in OBJECTS.schema if not one.nullable and one.name not in objects.columns]
    if missing:
        rule = (
            f"is missing; objects are exported by `conflictdb export --format geoparquet`; there are {objects.columns}"
        )
        raise InvalidInput(", ".join(paths), missing[0], rule)
    return objects


def write_conflicts(found: DataFrame, path: str) -> None:
    """Write conflicts as a directory of GeoParquet files; raises InvalidInput where there is one."""
    for name in GEOMETRIES:
        found = found.withColumn(name, functions.call_function("ST_GeomFromWKB", functions.col(name)))
    try:
        # Without a name of their own, coordinates are longitude and latitude on WGS84.
        found.write.format("geoparquet").option("geoparquet.crs", "").save(path)
    except AnalysisException as error:
        raise InvalidInput(path, "", f"cannot be written: {_first_line(error)}") from error


def write_states(objects: DataFrame, scene: Scene, path: str) -> None:
    """Write beside conflicts which states of which objects they were computed from, if these have numbers."""
    if {"object_id", "version"} <= set(objects.columns):
        states = objects.select("kind", "id", "object_id", "version").where("object_id IS NOT NULL")
        states.withColumn("settings", functions.lit(settings_text(scene))).write.parquet(f"{path}/{STATES}")


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0]
