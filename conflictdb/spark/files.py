"""Read objects from GeoParquet on Spark and write conflicts, on all workers; any path that Spark supports."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial, reduce
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
from pyspark.errors import AnalysisException
from pyspark.sql import DataFrame, SparkSession, functions
from pyspark.sql.pandas.types import from_arrow_schema

from conflictdb.arrays.arrow.forms import metadata_of
from conflictdb.arrays.arrow.found import GEOMETRIES
from conflictdb.arrays.arrow.object_rows import OBJECTS
from conflictdb.errors import InvalidInput
from conflictdb.formats.computed import STATES, settings_text
from conflictdb.formats.file_objects import AREA_GUARDED, AREA_MEMBERS, TRACK_GUARDED, TRACK_MEMBERS
from conflictdb.formats.geoparquet import GEOMETRY, METADATA_KEY, PLANAR, Layout
from conflictdb.formats.names import RENAME_COLUMN, misnamed
from conflictdb.formats.scene_file import scene_of
from conflictdb.formats.time_columns import is_time_name
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind
from conflictdb.spark.cut_objects import NO_NUMBER, check_case
from conflictdb.spark.storage import listed, parquet_reader, plain_path, require_new, schemas_of, shown

# Known names that other columns may resemble; and names with a meaning in other files, which `load` reads.
_GUARDED: Final = tuple(sorted({*AREA_GUARDED, *TRACK_GUARDED}))
_OF_FILES: Final = frozenset({*AREA_MEMBERS, *TRACK_MEMBERS, "radius_m"} - set(OBJECTS.schema.names))

# Beginnings of the names that `write_conflicts` and `write_states` leave, also unfinished.
_WRITTEN: Final = ("part-", "_SUCCESS", "_temporary", STATES)


def read_scene(
    spark: SparkSession, paths: Sequence[str], say: Callable[[str], None] = lambda text: None
) -> tuple[Scene | None, DataFrame]:
    """Return the settings and the objects of GeoParquet files: paths, URIs, globs, or directories.

    Settings are None if no file has them. Objects have the columns of the form OBJECTS that occur in any file. Raises
    InvalidInput, naming the file, for a file that is not Parquet, has other settings than the first, has another
    reference system than longitude and latitude, or has columns that would be lost.

    say : called once with each remark on assumptions about the files
    """
    found = listed(spark, paths)
    schemas = schemas_of(spark, found.inputFiles())
    named = {shown(file): schema for file, schema in schemas.items()}
    settings = settings_of(named)
    of_directories = [name for name in found.columns if name != "id"]
    for text in dict.fromkeys(
        text for file, schema in named.items() for text in _checked(file, schema, of_directories)
    ):
        say(text)
    return settings, _read(spark, paths, schemas, of_directories)


def read_objects(spark: SparkSession, paths: Sequence[str]) -> DataFrame:
    """Return the objects of GeoParquet files, as `read_scene` does."""
    return read_scene(spark, paths)[1]


def settings_of(schemas: Mapping[str, pa.Schema]) -> Scene | None:
    """Return the settings of the exported scene in files' schemas; None if no file has them.

    Raises InvalidInput if a file has other settings than the first.
    """
    first: tuple[str, Scene] | None = None
    for file, schema in schemas.items():
        said = metadata_of(file, schema).get("scene")
        if said is None:
            continue
        scene = scene_of(said, Path(file).stem)
        first = first or (file, scene)
        if differing := scene.differing(first[1]):
            rule = f"differs from that in {first[0]}; a scene has one set of settings"
            raise InvalidInput(f"scene {scene.name!r}", differing[0], rule, file)
    return first[1] if first else None


def _checked(file: str, schema: pa.Schema, of_directories: Sequence[str]) -> Iterator[str]:
    """Yield remarks on the schema of a file; raises InvalidInput if it is no table of objects.

    of_directories : columns given by directory names, as `kind=area/part.parquet`
    """
    try:
        layout = Layout.of(schema)
        _check_columns(schema, of_directories)
        OBJECTS.columns(_with(schema, of_directories).empty_table())
    except InvalidInput as refused:
        raise refused.at(file) from refused.__cause__
    if layout.to_degrees is not None or layout.encoding != "WKB" or layout.geometry not in (None, GEOMETRY):
        rule = f"must say that column {GEOMETRY} is longitude and latitude in WKB: load the file, and export it"
        raise InvalidInput(file, "metadata geo", rule)
    is_own = _is_own(schema)
    if not (layout.is_sure or (is_own and METADATA_KEY not in (schema.metadata or {}))):
        yield "the input does not say its reference system: taken for longitude and latitude on WGS84"
    if layout.edges != PLANAR:
        yield f"the input says that edges are {layout.edges[:60]!r}; here they are what the motion of the scene says"
    unread = [field.name for field in schema if field.name not in OBJECTS.schema.names and _is_time(field)]
    if unread:
        yield f"columns of the input look like times and are not read: {', '.join(unread[:20])}"
    if layout.epoch is not None:
        yield f"the input says that its coordinates are of epoch {layout.epoch:g}; they are used as they are"


def _is_time(field: pa.Field) -> bool:
    """Return whether a column has instants or dates, or may have them by its name."""
    return pa.types.is_date(field.type) or pa.types.is_timestamp(field.type) or is_time_name(field.name)


def _is_own(schema: pa.Schema) -> bool:
    return metadata_of("file", schema).get("form") == OBJECTS.name


def _with(schema: pa.Schema, of_directories: Sequence[str]) -> pa.Schema:
    """Return a schema with the columns from directory names added, with the types of the form OBJECTS."""
    said = [OBJECTS.schema.field(name) for name in of_directories if name in OBJECTS.schema.names]
    return pa.schema([*schema, *(field for field in said if field.name not in schema.names)], schema.metadata)


def _check_columns(schema: pa.Schema, of_directories: Sequence[str]) -> None:
    """Raise InvalidInput, as `load` does, for a column that was probably meant as more than a property."""
    names = [*schema.names, *of_directories]
    check_case("file", names)
    for name in names:
        if name.lower() in _OF_FILES and not _is_own(schema):
            rule = "is not read here: `conflictdb load` the file, and export it"
            raise InvalidInput("file", f"column {name}", rule)
    if not _is_own(schema):
        values = {field.name: _sample(field.type) for field in schema} | dict.fromkeys(of_directories, "1")
        for refused in misnamed("file", values, _GUARDED, foreign=OBJECTS.schema.names, remedy=RENAME_COLUMN):
            raise refused


def _sample(of: pa.DataType) -> Any:
    """Return a JSON value such as a column of the type may contain."""
    if pa.types.is_null(of) or pa.types.is_boolean(of):
        return None
    if pa.types.is_integer(of) or pa.types.is_floating(of) or pa.types.is_decimal(of):
        return 1
    return [1] if pa.types.is_nested(of) else "1"


def _read(
    spark: SparkSession, paths: Sequence[str], schemas: Mapping[str, pa.Schema], of_directories: Sequence[str]
) -> DataFrame:
    """Return the objects of files with these schemas; columns that a file lacks, or that have no type, are null."""
    alike: dict[tuple[tuple[str, str], ...], list[str]] = defaultdict(list)
    for file, schema in schemas.items():
        known = [field for field in schema if field.name in OBJECTS.schema.names and not pa.types.is_null(field.type)]
        alike[tuple(sorted((field.name, str(field.type)) for field in known))].append(file)
    reader = parquet_reader(spark)
    if len(alike) == 1:
        ((columns, (first, *_)),) = alike.items()
        known = pa.schema([field for field in schemas[first] if field.name in dict(columns)])
        if all(field.type == OBJECTS.schema.field(field.name).type for field in known):
            reader = reader.schema(from_arrow_schema(known))  # else Spark runs a job to read a file's types
        objects = reader.parquet(*paths)
        return objects.select([*(name for name, _ in columns), *_said(of_directories, columns)])
    if any(name in OBJECTS.schema.names for name in of_directories):
        first, second, *_ = (shown(files[0]) for files in alike.values())
        rule = f"are others than in {first}, and directories say {', '.join(of_directories)}: give each its own run"
        raise InvalidInput(second, "columns", rule)
    types = {field.name: field.dataType for field in from_arrow_schema(OBJECTS.schema)}
    parts = []
    for columns, files in alike.items():
        part = reader.parquet(*(plain_path(spark, file) for file in files))
        parts.append(part.select([functions.col(name).cast(types[name]) for name, _ in columns]))
    return reduce(partial(DataFrame.unionByName, allowMissingColumns=True), parts)


def _said(of_directories: Sequence[str], columns: Sequence[tuple[str, str]]) -> list[str]:
    return [name for name in of_directories if name in OBJECTS.schema.names and name not in dict(columns)]


def require_output(spark: SparkSession, path: str, objects: DataFrame | None = None, *, overwrite: bool) -> None:
    """Raise InvalidInput if conflicts cannot be written to a path because of existing files.

    objects : input files, which must not be in it
    overwrite : output of `write_conflicts` may be replaced
    """
    require_new(spark, path, _WRITTEN, objects.inputFiles() if objects else [], overwrite=overwrite)


def write_conflicts(found: DataFrame, path: str, *, overwrite: bool = False) -> None:
    """Write conflicts as a directory of GeoParquet files; raises InvalidInput if it exists.

    overwrite : remove an existing one, with all contents, when work begins
    """
    # Sedona takes any of several geometries as the primary one, so convert only one; the points stay WKB.
    region, *_ = GEOMETRIES
    found = found.withColumn(region, functions.call_function("ST_GeomFromWKB", functions.col(region)))
    try:
        # Without a CRS, coordinates are longitude and latitude on WGS84.
        mode = "overwrite" if overwrite else "error"
        found.write.format("geoparquet").option("geoparquet.crs", "").mode(mode).save(path)
    except AnalysisException as error:
        raise InvalidInput(path, "", f"cannot be written: {_first_line(error)}") from error


def write_states(objects: DataFrame, scene: Scene, path: str, pairs: int) -> None:
    """Write the states that `pairs` conflicts were computed from beside them, if any of the objects has a number.

    objects : as in `detection.Detected`
    """
    kind = f"CASE kind WHEN {Kind.TRACK.code} THEN '{Kind.TRACK.value}' ELSE '{Kind.AREA.value}' END AS kind"
    states = objects.where(f"object_id <> {NO_NUMBER}").selectExpr(kind, "key AS id", "object_id", "version", "digest")
    if not states.isEmpty():
        columns = {"settings": functions.lit(settings_text(scene)), "pairs": functions.lit(pairs).cast("bigint")}
        states.withColumns(columns).write.parquet(f"{path}/{STATES}")


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0]
