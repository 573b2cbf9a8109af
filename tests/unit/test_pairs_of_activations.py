"""Activations of areas, all in one place: joins of boxes compare times too, so that pairs stay few."""

import tracemalloc

from scenes import T0_US, box

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.stage1_broad_phase import batches
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import Area, Scene

MINUTE_US = 60_000_000


def hourly(key: str, west: float, spans: int) -> Area:
    """An area that is active for a minute of each hour."""
    starts_us = [T0_US + 60 * MINUTE_US * k for k in range(spans)]
    return box(key, west, -0.1, west + 1.0, 0.1, spans_us=[(start_us, start_us + MINUTE_US) for start_us in starts_us])


def test_pairs_of_activations_stay_few() -> None:
    """Pairs of boxes alone are the square of their number, which took 2.6 GB for areas active hourly in a year."""
    setup = Setup.of(Scene("s"))
    pieces = pieces_of(setup, AreaBatch.of([hourly("A", 0.0, 9_000), hourly("B", 0.5, 9_000)]), TrackBatch.of([]))
    tracemalloc.start()
    try:
        pairs = [len(a) for a, _ in batches(pieces, 1_000)]
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert sum(pairs) == 9_000
    assert peak <= 100_000_000, "bytes"
