"""The rules of plans: of many plans together and of one alone they are the same."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely

from conflictdb.errors import InvalidInput
from conflictdb.model import plan_rules
from conflictdb.model.plan_rows import Broken, Many, One

COUNT = 300


def said(broken: Broken, row: int = 0) -> str:
    """Return the refusal of a plan, empty for none."""
    try:
        broken.raise_for(row, "plan")
    except InvalidInput as error:
        return str(error)
    return ""


def assert_alike(together: Broken, alone: Callable[[int], Broken], least: int) -> None:
    """Compare the refusals of COUNT plans together with those of each alone; there are several kinds of these."""
    found = [said(together, i) for i in range(COUNT)]
    assert found == [said(alone(i)) for i in range(COUNT)]
    assert list(together.is_sound) == [not one for one in found] == [bool(alone(i).is_sound) for i in range(COUNT)]
    assert len({one.partition(";")[0][:30] for one in found}) >= least


def ragged(rng: np.random.Generator, most: int) -> tuple[Many, list[slice]]:
    rows = Many.of(rng.choice(most, COUNT))
    return rows, [rows.places(i) for i in range(COUNT)]


@pytest.mark.parametrize("seed", range(3))
def test_courses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    way, of_way = ragged(rng, 5)
    clock = Many.of(np.where(rng.random(COUNT) < 0.9, way.count, 3))
    lonlat = rng.choice(
        [3.0, 50.0, 89.0, 90.5, 370.0, np.nan, np.inf], (way.offset[-1], 2), p=[0.45, 0.45, *[0.02] * 5]
    )
    times_us = np.cumsum(rng.choice([10, 10, 10, 10, 0, -5], clock.offset[-1]))
    times_us[rng.random(len(times_us)) < 0.02] = 2**62

    def alone(i: int) -> Broken:
        line, times = lonlat[of_way[i]], times_us[clock.places(i)]
        return plan_rules.courses(line, One(len(line)), times, One(len(times)))

    assert_alike(plan_rules.courses(lonlat, way, times_us, clock), alone, 6)


@pytest.mark.parametrize("seed", range(3))
def test_outlines(seed: int) -> None:
    """Rings of a grid of few places: vertices are repeated, and sides go back the way they came."""
    rng = np.random.default_rng(seed)
    ring, of_ring = ragged(rng, 7)
    outline_m = rng.choice([-1.0, 0.0, 1.0, 3e7, np.nan], (ring.offset[-1], 2), p=[0.33, 0.33, 0.32, 0.01, 0.01])

    def alone(i: int) -> Broken:
        return plan_rules.outlines(outline_m[of_ring[i]], One(ring.count[i]), lambda _: f"outline {i}")

    assert_alike(plan_rules.outlines(outline_m, ring, lambda i: f"outline {i}"), alone, 4)


def test_footprints() -> None:
    rng = np.random.default_rng(0)
    box, gone = shapely.box(0, 0, 1, 1), shapely.Polygon()
    kinds: list[Any] = [
        shapely.MultiPolygon([box]),
        shapely.MultiPolygon([box, shapely.box(2, 0, 3, 1)]),
        shapely.MultiPolygon([box, box]),
        shapely.MultiPolygon(),
        shapely.multipolygons([box, gone]),
        shapely.Point(1, 1),
        shapely.MultiPolygon([shapely.box(-200, 0, 200, 1)]),
        shapely.MultiPolygon([shapely.box(0, 0, 1, 91)]),
        shapely.MultiPolygon([shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])]),
        shapely.MultiPolygon([shapely.Polygon([(0, 0), (np.inf, 1), (1, 0)])]),
    ]
    given = np.array([kinds[i] for i in rng.choice(len(kinds), COUNT)], object)
    assert_alike(plan_rules.footprints(given), lambda i: plan_rules.footprints(given[i]), 7)


def test_bounds() -> None:
    rng = np.random.default_rng(0)
    each = Many.each(COUNT)
    low, high = rng.choice([0, 5, 10, 2**62], (2, COUNT))
    has_low, has_high = rng.random((2, COUNT)) < 0.8
    given = [(int(low[i]), int(high[i]), bool(has_low[i]), bool(has_high[i]), One(1)) for i in range(COUNT)]
    assert_alike(plan_rules.spans(low, high, has_low, has_high, each), lambda i: plan_rules.spans(*given[i]), 4)
    low, high = rng.choice([0.0, 5.0, 10.0, np.nan, -np.inf], (2, COUNT))
    heights = [(float(low[i]), float(high[i]), bool(has_low[i]), bool(has_high[i]), One(1)) for i in range(COUNT)]
    assert_alike(plan_rules.heights(low, high, has_low, has_high, each), lambda i: plan_rules.heights(*heights[i]), 4)
