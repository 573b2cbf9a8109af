"""Stage 1 on Spark: candidate pairs of pieces, by Sedona's spatial join.

Pieces are candidates if their boxes overlap in space, time and height. Sedona joins boxes in a plane, which it
partitions by a tree built from the data. Time is therefore mapped to place: it is cut into buckets, and the boxes of
each are shifted east by more than the scene's width, so that boxes of different times do not touch. In the same way the
lots of crowded cells (`crowding`) are shifted north. A piece is in every bucket of its span and in every cell that it
meets. A pair counts once: in the cell, and the bucket, of the least corner of their common box. The predicates are
those of `sql/20_stage1_broad_phase.sql`.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from pyspark.sql import DataFrame, SparkSession, functions

from conflictdb.model import INFINITY_US, MINUS_INFINITY_US
from conflictdb.spark.crowding import Cells
from conflictdb.spark.pieces import refusal_of

# Padding of boxes, metres, and as much again where Sedona compares them: more than the rounding of shifts. Stage 2 uses
# exact hulls.
_PAD_M: Final = 0.01
# More buckets would cost coordinates their digits.
_MOST_BUCKETS: Final = 10_000
# Average number of rows per piece allowed for pieces in several buckets.
_COPIES: Final = 1.25
# Corners of a piece in space and time; the least common corner of two pieces decides where their pair counts.
_CORNER: Final = {"x": f"west - {_PAD_M}D", "y": f"south - {_PAD_M}D", "t": "double(start_us)"}
_FAR_CORNER: Final = {"x": f"east + {_PAD_M}D", "y": f"north + {_PAD_M}D", "t": "double(end_us)"}

_PAIR: Final = ("kind", "key", "pieces", "outline")
_MEMBER: Final = ("turn", "start_us", "end_us", "end_inclusive", "floor_m", "ceiling_m", *_PAIR)
_BOUNDS: Final = tuple(f"{end}_{axis}" for end in ("low", "high") for axis in _CORNER)


@dataclass(frozen=True, slots=True)
class Extent:
    """The extent of a scene's pieces in metres of the plane and in time.

    rows : of pieces; `outlines` : outlines that have rows of their own
    first_us, last_us : of all bounded spans; equal if there are none
    span_us : sum over all pieces, unbounded ones counted from first to last
    """

    rows: int
    outlines: int
    width_m: float
    height_m: float
    first_us: int
    last_us: int
    span_us: float

    @classmethod
    def of(cls, pieces: DataFrame) -> "Extent":
        """Return the extent of pieces, in one pass. Raises InvalidInput if a row is a refused object."""
        is_bounded = [functions.col("start_us") != MINUS_INFINITY_US, functions.col("end_us") != INFINITY_US]
        start, end = (
            functions.when(bounded, functions.col(name))
            for bounded, name in zip(is_bounded, ("start_us", "end_us"), strict=True)
        )
        row = pieces.agg(
            functions.count("refused"),
            functions.count("pieces"),
            functions.count("outline"),
            functions.count(functions.when(functions.col("pieces").isNotNull(), functions.col("outline"))),
            functions.max("east") - functions.min("west"),
            functions.max("north") - functions.min("south"),
            functions.least(functions.min(start), functions.min(end)),
            functions.greatest(functions.max(start), functions.max(end)),
            functions.sum((end - start).cast("double")),
            functions.count(functions.when(~(is_bounded[0] & is_bounded[1]), 1)),
        ).head()
        refused, rows, outlines, carried, width_m, height_m, first_us, last_us, span_us, unbounded = row or (0,) * 10
        if refused:
            refusal = pieces.where("refused IS NOT NULL").agg(functions.min("refused")).head() or ("",)
            raise refusal_of(refusal[0])
        first_us, last_us = first_us or 0, last_us or 0
        span_us = (span_us or 0.0) + unbounded * float(last_us - first_us)
        return cls(rows, outlines - carried, width_m or 0.0, height_m or 0.0, first_us, last_us, span_us)

    @property
    def buckets(self) -> int:
        """The number of time buckets: as many as keep most pieces in few of them."""
        duration = float(self.last_us - self.first_us)
        if not self.span_us or not duration:
            return 1
        return max(1, min(_MOST_BUCKETS, int((_COPIES - 1.0) * self.rows * duration / self.span_us)))


def candidates(spark: SparkSession, pieces: DataFrame, extent: Extent) -> DataFrame:
    """Return kind, key, pieces and outline of both members of each pair, a before b in the order of kinds and keys."""
    pieces = pieces.where("pieces IS NOT NULL")
    placed = _placed(pieces, _cells(spark, pieces, extent), extent)
    # Sedona partitions by equal numbers of rows of its first side: that side has a row for each lot.
    sides = {
        "a": placed.withColumn("lot", functions.expr("explode(sequence(0L, lots - 1))")),
        "b": placed.withColumn("lot", functions.expr("pmod(hash(key, turn, start_us), lots)")),
    }
    a, b = (_renamed(side, _boxed(rows, extent)) for side, rows in sides.items())
    b = b.drop(*(f"b_{name}" for name in _BOUNDS))
    met = a.join(b, functions.expr(f"ST_Intersects(a_box, b_box) AND {_MAY_MEET}"))
    return met.select([f"{side}_{name}" for side in "ab" for name in _PAIR])


def _cells(spark: SparkSession, pieces: DataFrame, extent: Extent) -> DataFrame:
    """Return the cells of a scene, one row each: bounds, lots, and the number of lots before it."""
    share = Cells.share(extent.rows)
    some = pieces.selectExpr(*_CORNER.values(), *_FAR_CORNER.values())
    seen = np.array((some if share == 1.0 else some.sample(share, seed=1)).collect(), np.float64).reshape(-1, 6)
    cells = Cells.of(seen[:, :3], seen[:, 3:], share)
    bounds = np.concatenate([cells.low, cells.high], axis=1).tolist()
    before = (np.cumsum(cells.lots) - cells.lots).tolist()
    # As literals in a query: as rows they would pass through workers, which takes a second.
    rows = [
        f"({', '.join(map(_double, bound))}, {lots}L, {first}L)"
        for bound, lots, first in zip(bounds, cells.lots.tolist(), before, strict=True)
    ]
    names = ", ".join(_BOUNDS)
    return spark.sql(f"SELECT * FROM VALUES {', '.join(rows)} AS cells({names}, lots, before)")  # noqa: S608 numbers


def _double(value: float) -> str:
    return f"double('{value!r}')"


def _placed(pieces: DataFrame, cells: DataFrame, extent: Extent) -> DataFrame:
    """Return pieces once for each cell that they meet and each bucket of their span in it."""
    count = extent.buckets
    bucket_us = max(float(extent.last_us - extent.first_us), 1.0) / count

    def bucket(instant: str) -> str:
        place = f"(({instant}) - {float(extent.first_us)!r}D) / {bucket_us!r}D"
        return f"bigint(floor(least(greatest({place}, 0.0D), {count - 1.0!r}D)))"

    corners = [f"{value} AS {axis}" for axis, value in _CORNER.items()]
    far = [f"{value} AS far_{axis}" for axis, value in _FAR_CORNER.items()]
    buckets = [f"{bucket('double(start_us)')} AS first", f"{bucket('double(end_us)')} AS last"]
    meets = " AND ".join(f"{axis} < high_{axis} AND far_{axis} >= low_{axis}" for axis in _CORNER)
    placed = pieces.selectExpr(*_MEMBER, *corners, *far, *buckets).join(
        functions.broadcast(cells), functions.expr(meets)
    )
    # Include the bucket of a cell's end itself, although that instant belongs to the next cell.
    within = f"sequence(greatest(first, {bucket('low_t')}), least(last, {bucket('high_t')}))"
    return placed.withColumn("bucket", functions.expr(f"explode({within})"))


def _boxed(placed: DataFrame, extent: Extent) -> DataFrame:
    """Return placed pieces with their boxes, shifted by bucket and lot."""
    # Separate neighbours by more than twice the padding.
    east = f"bucket * {extent.width_m + 10.0!r}D"
    north = f"(before + lot) * {extent.height_m + 10.0!r}D"
    box = (
        f"ST_PolygonFromEnvelope(x - {_PAD_M}D + {east}, y - {_PAD_M}D + {north},"
        f" far_x + {_PAD_M}D + {east}, far_y + {_PAD_M}D + {north})"
    )
    return placed.selectExpr(*_MEMBER, *_CORNER, *_BOUNDS, "first", "bucket", f"{box} AS box")


def _renamed(side: str, rows: DataFrame) -> DataFrame:
    return rows.toDF(*(f"{side}_{name}" for name in rows.columns))


# The conditions of stage 1 besides boxes, and where a pair counts.
_MAY_MEET: Final = """(a_kind < b_kind OR a_kind = b_kind AND a_key < b_key) AND (a_turn = 0 OR b_turn = 0)
    AND a_floor_m < b_ceiling_m AND b_floor_m < a_ceiling_m
    AND (greatest(a_start_us, b_start_us) < least(a_end_us, b_end_us)
         OR greatest(a_start_us, b_start_us) = least(a_end_us, b_end_us)
            AND (a_end_us > b_end_us OR a_end_inclusive) AND (b_end_us > a_end_us OR b_end_inclusive))
    AND a_bucket = greatest(a_first, b_first) AND """ + " AND ".join(
    f"greatest(a_{axis}, b_{axis}) >= a_low_{axis} AND greatest(a_{axis}, b_{axis}) < a_high_{axis}" for axis in _CORNER
)
