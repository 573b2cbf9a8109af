"""Stage 1 on Spark: the pairs of pieces whose boxes meet in space, time and height, by Sedona's spatial join.

Time is cut into buckets, and the boxes of a bucket are moved east by so many widths of the scene: so what Sedona
partitions, by a tree over what there is, are space and time together, and a scene of long duration does not become
pairs that are never there at once. A piece is in every bucket of its span; a pair counts in the bucket in which the
later of the two begins. By the predicates of `sql/20_stage1_broad_phase.sql`.
"""

from dataclasses import dataclass
from typing import Final

from pyspark.sql import Column, DataFrame, functions

from conflictdb.model import FOR_EVER_US, SINCE_EVER_US
from conflictdb.spark.pieces import refusal_of

# Boxes are wider by this, metres: more than moving them rounds. Stage 2 looks at hulls as they are.
_PAD_M: Final = 0.01
# More buckets than this would cost coordinates their digits, and no scene is that long.
_MOST_BUCKETS: Final = 10_000
# So many rows may a piece become, on average, by being in several buckets.
_COPIES: Final = 2.0

_MEMBER: Final = ("kind", "key", "turn", "start_us", "end_us", "end_inclusive", "floor_m", "ceiling_m", "piece")
_PAIR: Final = ("kind", "key", "piece")


@dataclass(frozen=True, slots=True)
class Extent:
    """What a scene's pieces cover: their number, metres of the plane from west to east, and times.

    first_us, last_us : of all bounded spans; the same where there are none
    span_us : of all pieces together, unbounded ones counted from first to last
    """

    pieces: int
    width_m: float
    first_us: int
    last_us: int
    span_us: float

    @classmethod
    def of(cls, pieces: DataFrame) -> "Extent":
        """Return what pieces cover: one pass over them. Raises InvalidInput where a row is of an object refused."""
        is_bounded = [functions.col("start_us") != SINCE_EVER_US, functions.col("end_us") != FOR_EVER_US]
        start, end = (
            functions.when(bounded, functions.col(name))
            for bounded, name in zip(is_bounded, ("start_us", "end_us"), strict=True)
        )
        row = pieces.agg(
            functions.min("refused"),
            functions.count("*"),
            functions.max("east") - functions.min("west"),
            functions.least(functions.min(start), functions.min(end)),
            functions.greatest(functions.max(start), functions.max(end)),
            functions.sum((end - start).cast("double")),
            functions.count(functions.when(~(is_bounded[0] & is_bounded[1]), 1)),
        ).head()
        refused, count, width_m, first_us, last_us, span_us, unbounded = row or (None, 0, None, None, None, None, 0)
        if refused is not None:
            raise refusal_of(refused)
        first_us, last_us = first_us or 0, last_us or 0
        return cls(count, width_m or 0.0, first_us, last_us, (span_us or 0.0) + unbounded * float(last_us - first_us))

    @property
    def buckets(self) -> int:
        """Into how many equal parts its time is cut: so many that pieces are in few of them each."""
        duration = float(self.last_us - self.first_us)
        if not self.span_us or not duration:
            return 1
        return max(1, min(_MOST_BUCKETS, int((_COPIES - 1.0) * self.pieces * duration / self.span_us)))


def candidates(pieces: DataFrame, extent: Extent) -> DataFrame:
    """Return kind, key and piece of both members of each pair, a before b in the order of kinds and keys."""
    boxed = _boxed(pieces, extent)
    a, b = (boxed.select([functions.col(name).alias(f"{side}_{name}") for name in boxed.columns]) for side in "ab")
    met = a.join(b, functions.expr("ST_Intersects(a_box, b_box)") & _may_meet())
    return met.select([f"{side}_{name}" for side in "ab" for name in _PAIR])


def _boxed(pieces: DataFrame, extent: Extent) -> DataFrame:
    """Return pieces once for each bucket of their span: with the first of these, that one, and their box in it."""
    count = extent.buckets
    bucket_us = max(float(extent.last_us - extent.first_us), 1.0) / count

    def bucket_of(name: str) -> Column:
        return functions.floor(
            functions.least(
                functions.greatest(
                    (functions.col(name) - functions.lit(float(extent.first_us))) / bucket_us, functions.lit(0.0)
                ),
                functions.lit(count - 1.0),
            )
        )

    boxed = pieces.select(
        *_MEMBER,
        "west",
        "south",
        "east",
        "north",
        bucket_of("start_us").alias("first"),
        bucket_of("end_us").alias("last"),
    )
    boxed = boxed.withColumn("bucket", functions.explode(functions.sequence("first", "last")))
    # Apart by twice the padding, and more.
    away = functions.col("bucket") * functions.lit(extent.width_m + 10.0)
    box = functions.call_function(
        "ST_PolygonFromEnvelope",
        functions.col("west") + away - _PAD_M,
        functions.col("south") - _PAD_M,
        functions.col("east") + away + _PAD_M,
        functions.col("north") + _PAD_M,
    )
    return boxed.select(*_MEMBER, "first", "bucket", box.alias("box"))


def _may_meet() -> Column:
    """Return what stage 1 asks beside boxes, of columns a_… and b_…."""
    return functions.expr(
        """(a_kind < b_kind OR a_kind = b_kind AND a_key < b_key) AND (a_turn = 0 OR b_turn = 0)
        AND a_floor_m < b_ceiling_m AND b_floor_m < a_ceiling_m
        AND (greatest(a_start_us, b_start_us) < least(a_end_us, b_end_us)
             OR greatest(a_start_us, b_start_us) = least(a_end_us, b_end_us)
                AND (a_end_us > b_end_us OR a_end_inclusive) AND (b_end_us > a_end_us OR b_end_inclusive))
        AND a_bucket = greatest(a_first, b_first)"""
    )
