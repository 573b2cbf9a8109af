"""Write scenes and conflicts as GeoParquet 1.1, one row group at a time, in bounded memory (extra `parquet`)."""

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from typing import IO, Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.arrow.columns import of_numbers
from conflictdb.arrays.arrow.forms import METADATA_KEY, ArrowForm
from conflictdb.arrays.arrow.found import FOUND, GEOMETRIES, of_rows
from conflictdb.arrays.arrow.object_rows import OBJECTS
from conflictdb.formats.geoparquet import COVERING, GEOMETRY, SIDES, metadata
from conflictdb.formats.scene_file import settings_of
from conflictdb.model.plans import Scene
from conflictdb.model.results import Conflict

# Rows of a row group: about what a reader decodes at once, and small enough for a useful bounding box.
_ROWS: Final = 20_000
_BOX: Final = pa.struct([pa.field(side, pa.float64(), nullable=False) for side in SIDES])
_KINDS: Final = {
    int(shapely.GeometryType.LINESTRING): "LineString",
    int(shapely.GeometryType.POLYGON): "Polygon",
    int(shapely.GeometryType.MULTIPOLYGON): "MultiPolygon",
}


def write_objects(stream: IO[bytes], scene: Scene, batches: "Iterable[pa.RecordBatch]") -> None:
    """Write a scene from which `read` reads exactly these settings and objects.

    batches : of the form OBJECTS
    """
    schema = OBJECTS.schema.append(pa.field(COVERING, _BOX, nullable=False))
    bounds, kinds = np.full(4, np.nan), set()
    with _written(stream, OBJECTS, schema, {"scene": settings_of(scene)}) as writer:
        for table in _grouped(batches):
            shapes = shapely.from_wkb(table.column(GEOMETRY).to_numpy())
            boxes = shapely.bounds(shapes)
            bounds = _around(bounds, boxes)
            kinds |= {_KINDS[kind] for kind in np.unique(shapely.get_type_id(shapes)).tolist()}
            box = pa.StructArray.from_arrays([of_numbers(side) for side in boxes.T], fields=list(_BOX))
            writer.write_table(table.append_column(schema.field(COVERING), box), row_group_size=_ROWS)
        writer.add_key_value_metadata({"geo": metadata(bounds, sorted(kinds), {}, GEOMETRY)})


def write_conflicts(stream: IO[bytes], conflicts: Iterable[Conflict]) -> None:
    """Write conflicts, as they come, with the columns of the form FOUND."""
    with _written(stream, FOUND, FOUND.schema, {}) as writer:
        rows = iter(conflicts)
        while batch := list(islice(rows, _ROWS)):
            writer.write_batch(of_rows(batch))
        region, *others = GEOMETRIES
        geo = metadata(np.full(4, np.nan), [], {name: ["Point"] for name in others}, region)
        writer.add_key_value_metadata({"geo": geo})


@contextmanager
def _written(
    stream: IO[bytes], form: ArrowForm, schema: "pa.Schema", more: Mapping[str, Any]
) -> "Iterator[pq.ParquetWriter]":
    about = {"form": form.name, "edition": form.edition, **more}
    # With its own schema in the file Arrow reads no metadata but those, and `geo` is known when all is written.
    with pq.ParquetWriter(stream, schema.remove_metadata(), compression="zstd", store_schema=False) as writer:
        yield writer
        writer.add_key_value_metadata({METADATA_KEY: json.dumps(about, ensure_ascii=False)})


def _grouped(batches: "Iterable[pa.RecordBatch]") -> "Iterator[pa.Table]":
    """Yield small batches joined to tables of row group size."""
    small: list[pa.RecordBatch] = []
    rows = 0
    for batch in batches:
        small.append(batch)
        rows += batch.num_rows
        if rows >= _ROWS:
            yield pa.Table.from_batches(small)
            small, rows = [], 0
    if small:
        yield pa.Table.from_batches(small)


def _around(bounds: NDArray[np.float64], boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the union of bounding boxes: (4,) `bounds`, NaN if empty, and (n, 4) `boxes`."""
    every = np.vstack([bounds, boxes])
    return np.concatenate([np.fmin.reduce(every[:, :2]), np.fmax.reduce(every[:, 2:])])
