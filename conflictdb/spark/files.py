"""GeoParquet on Spark: objects in, conflicts out, by all workers at once; a path is what Spark can read and write."""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet
from pyspark.errors import AnalysisException
from pyspark.sql import DataFrame, SparkSession, functions

from conflictdb.arrays.arrow.forms import told
from conflictdb.arrays.arrow.found import GEOMETRIES
from conflictdb.arrays.arrow.objects import OBJECTS
from conflictdb.errors import InvalidInput
from conflictdb.io.computed import STATES, settings_text
from conflictdb.io.geoparquet import GEOMETRY, Layout
from conflictdb.io.scene_file import scene_of
from conflictdb.model import Scene
from conflictdb.results import Kind
from conflictdb.spark.pieces import NO_NUMBER


def settings_in(paths: Sequence[str]) -> Scene | None:
    """Return the settings of the scene that files, or directories of them, were exported of.

    None for what is not here, or says nothing; raises InvalidInput where some say other settings than the first, or a
    reference system that is not longitude and latitude.
    """
    first: tuple[str, Scene] | None = None
    for file in (file for path in paths for file in _files(Path(path))):
        scene = _settings(file)
        if scene is None:
            continue
        first = first or (file, scene)
        if differing := scene.differing(first[1]):
            rule = f"differs from that in {first[0]}; a scene has one set of settings"
            raise InvalidInput(f"scene {scene.name!r}", differing[0], rule, file)
    return first[1] if first else None


def _files(path: Path) -> list[str]:
    """Return a file, or those in a directory that Spark reads, whatever they end in; none of what is elsewhere."""
    if path.is_dir():
        return sorted(str(one) for one in path.rglob("*") if one.is_file() and not _is_hidden(one, path))
    return [str(path)] if path.is_file() else []


def _is_hidden(file: Path, directory: Path) -> bool:
    return any(part[0] in "._" for part in file.relative_to(directory).parts)


def _settings(path: str) -> Scene | None:
    try:
        schema = parquet.read_schema(path)
    except pa.ArrowException as error:
        raise InvalidInput(path, "", f"is no Parquet of conflictdb: {_first_line(error)}") from error
    try:
        layout = Layout.of(schema)
    except InvalidInput as refused:
        raise refused.at(path) from refused.__cause__
    if layout.to_degrees is not None or layout.encoding != "WKB" or layout.geometry not in (None, GEOMETRY):
        rule = f"must say that column {GEOMETRY} is longitude and latitude in WKB: load the file, and export it"
        raise InvalidInput(path, "metadata geo", rule)
    scene = told(path, schema).get("scene")
    return None if scene is None else scene_of(scene, Path(path).stem)


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


def write_states(objects: DataFrame, scene: Scene, path: str, pairs: int) -> None:
    """Write beside so many pairs what they were computed from, if some of these objects have numbers.

    objects : as `detection.Detected` has them
    """
    kind = f"CASE kind WHEN {Kind.TRACK.code} THEN '{Kind.TRACK.value}' ELSE '{Kind.AREA.value}' END AS kind"
    states = objects.where(f"object_id <> {NO_NUMBER}").selectExpr(kind, "key AS id", "object_id", "version", "digest")
    if not states.isEmpty():
        told = {"settings": functions.lit(settings_text(scene)), "pairs": functions.lit(pairs).cast("bigint")}
        states.withColumns(told).write.parquet(f"{path}/{STATES}")


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0]
