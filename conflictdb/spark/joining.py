"""Stage 1 on Spark: send the pieces to the units of work (`work_units`) in which they are joined.

A piece goes to each cell that it meets, and there to each unit with the block of its object. A pair counts once: in the
cell with the least corner of the common box, and in the unit of the two blocks.
"""

from typing import Final

import numpy as np
from pyspark.sql import DataFrame, SparkSession, functions

from conflictdb.spark.cut_objects import refusal_of
from conflictdb.spark.solving import PLACED
from conflictdb.spark.work_units import Cells

# Corners of a piece in space and time.
_CORNER: Final = {"x": "west", "y": "south", "t": "double(start_us)"}
_FAR_CORNER: Final = {"x": "east", "y": "north", "t": "double(end_us)"}
_BOUNDS: Final = tuple(f"{end}_{axis}" for end in ("low", "high") for axis in _CORNER)
# Units for each partition, so that partitions are about equal; and most pieces of a unit, for a worker's memory.
_UNITS: Final = 4
_MOST_PIECES: Final = 25_000


def counted(pieces: DataFrame) -> tuple[int, int, int]:
    """Return, in one pass, the numbers of rows of pieces, of outlines with rows of their own, and of schedules to name.

    Raises InvalidInput if a row is a refused object.
    """
    lone = functions.when(functions.col("pieces").isNull(), functions.col("outline"))
    counted = (functions.count(one) for one in ("pieces", lone, "schedule"))
    refused, *counts = pieces.agg(functions.min("refused"), *counted).head() or (None, 0, 0, 0)
    if refused:
        raise refusal_of(refused)
    rows, outlines, schedules = counts
    return rows, outlines, schedules


def cells_of(pieces: DataFrame, rows: int, partitions: int) -> Cells:
    """Return the cells of a scene, from a sample of its pieces. rows: number of rows of pieces."""
    share = Cells.share(rows)
    some = pieces.where("pieces IS NOT NULL").selectExpr(*_CORNER.values(), *_FAR_CORNER.values())
    seen = np.array((some if share == 1.0 else some.sample(share, seed=1)).collect(), np.float64).reshape(-1, 6)
    return Cells.of(seen[:, :3], seen[:, 3:], share, max(_UNITS * partitions, rows // _MOST_PIECES))


def placed(spark: SparkSession, pieces: DataFrame, cells: Cells) -> DataFrame:
    """Return pieces once for each unit that they are in (form PLACED)."""
    bounds = np.concatenate([cells.low, cells.high], axis=1).tolist()
    # As literals in a query: as rows they would pass through workers, which takes a second.
    rows = [
        f"({', '.join(map(_double, bound))}, {blocks}, {first})"
        for bound, blocks, first in zip(bounds, cells.blocks.tolist(), cells.first_unit.tolist(), strict=False)
    ]
    names = ", ".join(_BOUNDS)
    table = spark.sql(f"SELECT * FROM VALUES {', '.join(rows)} AS cells({names}, blocks, first)")  # noqa: S608 numbers
    meets = " AND ".join(f"{_CORNER[axis]} < high_{axis} AND {_FAR_CORNER[axis]} >= low_{axis}" for axis in _CORNER)
    met = pieces.where("pieces IS NOT NULL").join(functions.broadcast(table), functions.expr(meets))
    met = met.selectExpr("*", "hash(key) AS dealt", "pmod(hash(key), blocks) AS block")
    # As `work_units.two_blocks` counts.
    of_two = "greatest(block, other) * (greatest(block, other) + 1) DIV 2 + least(block, other)"
    units = f"explode(transform(sequence(0, blocks - 1), other -> int(first + {of_two}))) AS unit"
    return met.selectExpr("*", units).select(PLACED.names)


def _double(value: float) -> str:
    return f"double('{value!r}')"
