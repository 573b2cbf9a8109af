"""GeoParquet on Spark: objects in, conflicts out, by all workers at once; a path is what Spark can read and write."""

import json
from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet
from pyspark.errors import AnalysisException
from pyspark.sql import DataFrame, SparkSession, functions

from conflictdb.arrays.arrow.forms import METADATA_KEY
from conflictdb.arrays.arrow.found import GEOMETRIES
from conflictdb.arrays.arrow.objects import OBJECTS
from conflictdb.errors import InvalidInput
from conflictdb.io.computed import STATES, settings_text
from conflictdb.io.scene_file import scene_of
from conflictdb.model import Scene


def settings_in(path: str) -> Scene | None:
    """Return the settings of the scene that a file was exported of; None for what is no file here, or says nothing."""
    if not Path(path).is_file():
        return None
    try:
        told = json.loads((parquet.read_schema(path).metadata or {}).get(METADATA_KEY, b"{}"))
    except (pa.ArrowException, ValueError) as error:
        raise InvalidInput(path, "", f"is no Parquet of conflictdb: {_first_line(error)}") from error
    return None if told.get("scene") is None else scene_of(told["scene"], Path(path).stem)


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
    # Of several geometries Sedona takes any for the main one, so there is one; the points stay WKB.
    region, *_ = GEOMETRIES
    found = found.withColumn(region, functions.call_function("ST_GeomFromWKB", functions.col(region)))
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
