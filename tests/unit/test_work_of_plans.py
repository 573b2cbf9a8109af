"""How many calls it takes to make a plan, and to compare one: these are made and asked by the hundred thousand."""

import gc
import itertools
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from counted_calls import calls_of

from conflictdb import Area, Index, Motion, Scene, Track
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.stage1_broad_phase import rows_of
from conflictdb.kernel.boxes import RowBoxes

T0_US = 1_700_000_000_000_000
HOUR_US = 3_600_000_000
SQUARE = shapely.MultiPolygon([shapely.box(4.0, 57.0, 5.0, 58.0)])
RING_M = np.array([(10.0, 100.0), (10.0, -100.0), (-10.0, -100.0), (-10.0, 100.0)])
POSITIONS_DEG = np.array([(4.0 + 0.1 * k, 57.0) for k in range(5)])
TIMES_US = T0_US + HOUR_US * np.arange(5)


@pytest.mark.parametrize(
    ("given", "most"),
    [
        ({}, 100),
        ({"start_us": T0_US, "end_us": T0_US + HOUR_US}, 125),
        ({"spans_us": [(T0_US + 2 * k * HOUR_US, T0_US + (2 * k + 1) * HOUR_US) for k in range(5)]}, 300),
    ],
)
def test_an_area_is_made_by_few_calls(given: dict[str, Any], most: int) -> None:
    """Rules of columns that it does not have cost nothing, and a time that is a whole number next to nothing."""
    assert calls_of(lambda: Area("A", SQUARE, **given)) <= most


@pytest.mark.parametrize(
    ("given", "most"),
    [
        ({}, 165),
        ({"departures_us": [T0_US + 24 * k * HOUR_US for k in range(5)]}, 265),
        ({"outlines_m": np.stack([RING_M] * 5)}, 450),
        ({"floors_m": [0.0, 1.0, 2.0, 3.0], "ceilings_m": [10.0, 11.0, 12.0, 13.0]}, 345),
        ({"legs": Motion.RHUMB}, 175),
    ],
)
def test_a_track_is_made_by_few_calls(given: dict[str, Any], most: int) -> None:
    assert calls_of(lambda: Track("T", POSITIONS_DEG, TIMES_US, RING_M, **given)) <= most


def track(key: str) -> Track:
    return Track(key, POSITIONS_DEG - [0.0, 7.0], TIMES_US, RING_M, floor_m=0.0, ceiling_m=10.0)


def area(key: str) -> Area:
    return Area(key, [(4.5, 50.0), (5.0, 50.0), (5.0, 51.0)], None, T0_US, T0_US + HOUR_US, 0.0, 10.0)


@pytest.mark.parametrize(("plan", "most"), [(area, 695), (track, 1140)])
def test_a_plan_is_compared_by_few_calls(plan: Callable[[str], Area | Track], most: int) -> None:
    """What a question needs of its settings is made once, and nothing for plans of another kind."""
    index = Index(Scene("calls"))
    for k in range(20):
        ring = [(4.0 + k, 57.0), (4.5 + k, 57.0), (4.5 + k, 57.5)]
        index.put(Area(f"A{k}", ring, None, T0_US, T0_US + HOUR_US, 0.0, 10.0), f"owner {k}")
    # The same plan again would not be cut again.
    asked = itertools.cycle([plan("P"), plan("Q")])
    assert calls_of(lambda: index.probe(next(asked), "asker")) <= most


@pytest.mark.parametrize(("plan", "most"), [(area, 1975), (track, 2585)])
def test_a_conflict_is_found_by_few_calls(plan: Callable[[str], Area | Track], most: int) -> None:
    """Stages that have nothing to decide cost next to nothing."""
    index = Index(Scene("calls"))
    index.put(plan("A"), "owner")
    asked = itertools.cycle([plan("P"), plan("Q")])
    assert calls_of(lambda: index.probe(next(asked), "asker")) <= most


@pytest.mark.parametrize(("plan", "most"), [(area, 290), (track, 320)])
def test_a_compared_plan_is_put_by_few_calls(plan: Callable[[str], Area | Track], most: int) -> None:
    """It is neither checked nor cut again."""
    index, asked = Index(Scene("calls")), plan("P")
    index.probe(asked, "asker")
    assert calls_of(lambda: index.put(asked, "asker")) <= most


@pytest.mark.parametrize("plan", [area, track])
def test_boxes_of_a_compared_plan_are_made_once(
    plan: Callable[[str], Area | Track], monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def counted(pieces: Pieces) -> RowBoxes:
        made.append(len(pieces))
        return rows_of(pieces)

    monkeypatch.setattr("conflictdb.memory.index.rows_of", counted)
    index, asked = Index(Scene("calls")), plan("P")
    index.probe(asked, "asker")
    index.probe(asked, "asker")
    index.put(asked, "asker")
    assert len(made) == 1


def test_an_index_takes_few_bytes_a_volume() -> None:
    """Also while plans that were put together are cut."""

    def flights() -> list[list[Area]]:
        rings = [[(4.0 + 0.1 * i, 57.0), (4.1 + 0.1 * i, 57.0), (4.1 + 0.1 * i, 57.1)] for i in range(6)]
        return [
            [
                Area(f"{k}#{i}", ring, None, T0_US + i * HOUR_US, T0_US + (i + 1) * HOUR_US, 0.0, 10.0)
                for i, ring in enumerate(rings)
            ]
            for k in range(100)
        ]

    def put(plans: list[list[Area]]) -> Index:
        index = Index(Scene("bytes"))
        for k, volumes in enumerate(plans):
            index.put(volumes, f"owner {k}")
        index.probe(Area("P", [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]), "asker")
        return index

    plans = flights()
    put(plans)  # what a first use imports and makes is no volume
    gc.collect()
    tracemalloc.start()
    try:
        index = put(plans)
        gc.collect()
        held, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(index) == 600
    assert held / 600 < 560
    assert most / 600 < 930
