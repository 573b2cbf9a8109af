"""Detect a scene through the four stages on Spark, with the answer of `detect`.

Workers cut objects into pieces; join the pieces of each unit of space and time; and solve the pairs of each group of
objects. Repeated tasks give the same rows.
"""

import math
import warnings
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
import pyarrow as pa
import shapely
from pyspark.sql import DataFrame, SparkSession, functions
from pyspark.sql.pandas.types import from_arrow_schema
from pyspark.sql.types import BinaryType
from pyspark.storagelevel import StorageLevel

from conflictdb.arrays.arrow.object_rows import OBJECTS
from conflictdb.core.memory_budget import MEMORY_MB, MemoryBudget
from conflictdb.core.world import horizon, hull
from conflictdb.earth.registry import middle_deg, summed_directions
from conflictdb.errors import IncompleteWarning, InvalidInput, UnknownScheduleWarning
from conflictdb.model.plans import Motion, Scene
from conflictdb.model.recurring_plans import Window, idle_text, unknown_text
from conflictdb.model.results import Kind
from conflictdb.model.speed_limits import MAX_SPEED_KN
from conflictdb.spark import cut_objects, joining, solving
from conflictdb.spark.engine import with_sedona
from conflictdb.spark.work_units import blocks_for

# Partitions per processor of the cluster: several, so that the last to end are short.
_PER_PROCESSOR: Final = 4
# Groups of pairs for each partition, so that partitions are about equal; most pairs of a group, for a worker's memory.
_GROUPS: Final = 4
_MOST_PAIRS: Final = 500_000
# Memory of a worker for pyspark and pandas, beyond that of a process of `detect`.
_SPARK_MB: Final = 64
# Columns that no stage reads.
_UNUSED: Final = ("name", "properties")
_SUMS: Final = pa.schema([pa.field(name, pa.float64()) for name in ("count", "x", "y", "z")])


@dataclass(frozen=True, slots=True)
class Detected:
    """The result of `detect_on_spark`, and the objects it was computed from.

    conflicts : rows of the form FOUND
    objects : key, kind (code), object_id (NO_NUMBER where unknown), version, and a digest of the data that was cut into
        pieces
    """

    conflicts: DataFrame
    objects: DataFrame


def detect_on_spark(
    spark: SparkSession,
    objects: DataFrame,
    scene: Scene,
    *,
    partitions: int | None = None,
    memory_mb: int = MEMORY_MB,
    max_speed_kn: float = MAX_SPEED_KN,
) -> DataFrame:
    """Return the conflicts of a scene: the same rows as `detect`, for any number of partitions.

    Objects are cut and counted at once; conflicts are computed lazily. Pieces stay in Spark's cache, on disk where
    memory ends, as long as this DataFrame is referenced.

    Parameters
    ----------
    objects : rows of the Arrow form OBJECTS, as in GeoParquet files of conflictdb; `geometry` is WKB, or Sedona's type
    scene : settings; great circles without a centre get the middle of the objects
    partitions : of pieces and of pairs of objects; by default four per processor
    memory_mb : of each Python worker, megabytes, that it keeps below
    max_speed_kn : the speed over the ground beyond which a leg is refused, knots

    Raises
    ------
    EngineMissing
        Sedona's jars are missing.
    InvalidInput
        An object is refused, or two have the same key.
    """
    found = detected(spark, objects, scene, partitions=partitions, memory_mb=memory_mb, max_speed_kn=max_speed_kn)
    return found.conflicts


def detected(
    spark: SparkSession,
    objects: DataFrame,
    scene: Scene,
    *,
    partitions: int | None = None,
    memory_mb: int = MEMORY_MB,
    max_speed_kn: float = MAX_SPEED_KN,
) -> Detected:
    """Detect as `detect_on_spark` does; the objects stay cached as long as the conflicts are referenced."""
    with_sedona(spark)
    cut_objects.check_case("objects", objects.columns)
    if not isinstance(objects.schema["geometry"].dataType, BinaryType):
        objects = objects.withColumn("geometry", functions.expr("ST_AsBinary(geometry)"))
    names = objects.select("id", "name").where("name IS NOT NULL") if "name" in objects.columns else None
    objects = objects.select([name for name in objects.columns if name in OBJECTS.schema.names and name not in _UNUSED])
    scene = _centred(objects, scene)
    count = partitions or spark.sparkContext.defaultParallelism * _PER_PROCESSOR
    window = _window(objects, scene)
    into_pieces = partial(cut_objects.cut, scene=scene, max_speed_kn=max_speed_kn, window=window)
    cut = mapped(objects.repartition(count, "id"), into_pieces, cut_objects.SCHEMA)
    cut = cut.persist(StorageLevel.MEMORY_AND_DISK)
    rows, large, schedules = joining.counted(cut)
    if schedules and window is not None:
        _warn_of_schedules(cut, window)
    cells = joining.cells_of(cut, rows, count)
    in_units = joining.placed(spark, cut, cells).repartition(count, "unit").sortWithinPartitions("unit")
    blocks = blocks_for(max(_GROUPS * count, math.ceil(cells.pairs / _MOST_PAIRS)))
    met = mapped(
        in_units, partial(solving.meeting, cells=cells, blocks=blocks, within_us=scene.longest_time_us), solving.MET
    )
    together = met.repartition(count, "group").sortWithinPartitions("group")
    outlines = _outlines(spark, cut if large else None)
    solve = partial(
        solving.solved, scene=scene, outlines=outlines, pairs_at_once=MemoryBudget.of(memory_mb - _SPARK_MB).pairs
    )
    found = _named(mapped(together, solve, solving.SCHEMA), names)
    weakref.finalize(found, _free, cut).atexit = False
    read = cut.where("digest IS NOT NULL").select("key", "kind", "object_id", "version", "digest")
    return Detected(found, read)


def _warn_of_schedules(cut: DataFrame, window: Window) -> None:
    """Issue the warnings of `occupy` that name objects without an activation, or without an understood schedule."""
    rows = cut.where("schedule IS NOT NULL").select("kind", "key", "schedule").sort("kind", "key").collect()
    named: dict[str, list[str]] = {cut_objects.UNKNOWN: [], cut_objects.IDLE: []}
    for code, key, said in rows:
        named[said].append(f"{'area' if code == Kind.AREA.code else 'track'} {key!r}")
    if unknown := named[cut_objects.UNKNOWN]:
        warnings.warn(unknown_text(unknown), UnknownScheduleWarning, stacklevel=3)
    if idle := named[cut_objects.IDLE]:
        warnings.warn(idle_text(idle, window), IncompleteWarning, stacklevel=3)


def _named(found: DataFrame, names: DataFrame | None) -> DataFrame:
    """Return conflicts with the names of their objects; names: their columns id and name, None if there are none."""
    if names is None:
        return found
    columns = found.columns
    for side in ("a", "b"):
        own = names.select(
            names.id.cast("string").alias(f"{side}_key"), names.name.cast("string").alias(f"{side}_name")
        )
        found = found.drop(f"{side}_name").join(own, f"{side}_key", "left")
    return found.select(columns)


def _free(cached: DataFrame) -> None:
    """Release cached rows, if their session still runs."""
    if cached.sparkSession.sparkContext._jsc is not None:
        cached.unpersist()


def mapped(
    rows: DataFrame, function: Callable[[Iterable[pa.RecordBatch]], Iterable[pa.RecordBatch]], schema: pa.Schema
) -> DataFrame:
    """Apply a function on workers to the batches of each partition."""
    return rows.mapInArrow(function, from_arrow_schema(schema))


def _centred(objects: DataFrame, scene: Scene) -> Scene:
    """Return the scene with a centre, if its motion needs one, as `earth.registry.centred` does.

    Raises InvalidInput for objects all around the earth, for which no centre is valid.
    """
    if scene.motion != Motion.GREAT_CIRCLE or scene.centre is not None:
        return scene
    sums = mapped(objects.select("geometry"), _directions, _SUMS).collect()
    if not any(row["count"] for row in sums):
        return scene
    middle = middle_deg(np.array([math.fsum(column) for column in zip(*sums, strict=True)]))
    if middle is None:
        rule = (
            "does not follow from objects all around the earth; with motion 'great_circle' all must lie within 60 "
            "degrees of it: split the scene, or use motion 'rhumb'"
        )
        raise InvalidInput(f"scene {scene.name!r}", "centre", rule)
    return replace(scene, centre=middle)


def _window(objects: DataFrame, scene: Scene) -> Window | None:
    """Return the time over which the schedules of objects are expanded, as of `World.of`; None: there are none."""
    if "schedule" not in objects.columns or objects.where("schedule IS NOT NULL").isEmpty():
        return None
    times = mapped(objects, partial(cut_objects.touched_times, scene=scene), cut_objects.TIMES)
    return horizon(scene, hull(*((row["start_us"], row["end_us"]) for row in times.collect())))


def _directions(batches: Iterable[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
    """Yield the number of corners and waypoints of objects, and the sums of their direction vectors."""
    for batch in batches:
        places = shapely.get_coordinates(shapely.from_wkb(np.array(batch.column(0).to_pylist(), dtype=object)))
        yield pa.RecordBatch.from_arrays(list(summed_directions(places).reshape(4, 1)), schema=_SUMS)


class _Outlines:
    """Large outlines of areas by key, broadcast once to each machine, and read on demand."""

    def __init__(self, sent: Any) -> None:
        self._sent = sent

    def __call__(self) -> Mapping[str, bytes]:
        outlines: Mapping[str, bytes] = self._sent.value
        return outlines


def _outlines(spark: SparkSession, cut: DataFrame | None) -> solving.Outlines:
    rows = (
        cut.where("pieces IS NULL AND outline IS NOT NULL").select("key", "outline").collect()
        if cut is not None
        else []
    )
    return _Outlines(spark.sparkContext.broadcast({key: bytes(outline) for key, outline in rows}))
