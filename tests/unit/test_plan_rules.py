"""The rules of plans: of many plans together and of one alone they are the same."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
import shapely

from conflictdb.errors import InvalidInput
from conflictdb.model import inputs, many, plan_rules
from conflictdb.model.plan_rows import Broken, Many, One
from conflictdb.model.plans import Area, Track

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


def _one_of(rng: np.random.Generator, values: list[Any]) -> Any:
    return values[rng.choice(len(values))]


def test_columns_that_few_plans_have() -> None:
    """Plans together are those that each makes alone, and the same are left out."""
    rng = np.random.default_rng(0)
    lonlat, ring = np.array([[3.0, 50.0], [3.1, 50.0], [3.1, 50.1]]), np.array([[1.0, 1.0], [1, -1], [-1, -1], [-1, 1]])
    times_us = np.array([0, 3600, 7200]) * 1_000_000
    hours = [np.datetime64(hour, "h").astype("datetime64[us]") for hour in range(10)]
    choices: dict[str, list[Any]] = {
        "departures_us": [[0, 2, 4], [0, 1], [2, 1], [], [10**8]],
        "floors_m": [[0.0, 1.0], [0.0, -np.inf, 5.0], [np.nan, 1.0], [1.0], []],
        "ceilings_m": [[2.0, 4.0], [3.0, 3.0, np.inf], [0.5, 9.0]],
        "floor_m": [0.0, 1.0],
        "grow_mps": [1.0, -1.0, 2e6, 0.0],
        "outlines_m": [
            [ring] * 3,
            [ring] * 2,
            [ring, ring[::-1], ring],
            [2 * ring] * 3,
            [ring, ring[[0, 2, 1, 3]], ring],
        ],
        "tolerances": [{"xtd_port_m": 5.0}, {"xtd_port_m": -1.0}, {"departure_window": ["1970-01-01T00:00Z"]}],
    }
    members = []
    for _ in range(COUNT):
        names = rng.choice(list(choices), rng.choice(3), replace=False)
        own = {name: _one_of(rng, choices[name]) for name in names}
        if "departures_us" in own:
            own["departures_us"] = [np.datetime64(hour, "h").astype("datetime64[us]") for hour in own["departures_us"]]
        members.append({name: np.array(one) if name[-3:] == "s_m" else one for name, one in own.items()})
    keys, count = [f"T{i}" for i in range(COUNT)], np.arange(COUNT + 1)
    shapes = [np.tile(lonlat, (COUNT, 1)), 3 * count, np.tile(times_us, COUNT), np.tile(ring, (COUNT, 1)), 4 * count]
    assert_made(
        many.tracks(keys, *shapes, members),  # type: ignore[arg-type]
        lambda i: Track(keys[i], lonlat, inputs.all_certain(times_us), ring, **members[i]),
    )
    spans = [[], [[1, 2]], [[3, 4], [None, 2], [4, 5]], [[2, 2]], [[1, None], [2, 3]]]
    members = [
        {"spans_us": [[None if at is None else hours[at] for at in span] for span in _one_of(rng, spans)]}
        | _one_of(rng, [{}, {"start_us": 3_600_000_000}])
        for _ in range(COUNT)
    ]
    square = shapely.MultiPolygon([shapely.box(0, 0, 1, 1)])
    given = [{name: hours[1] if name == "start_us" else one for name, one in own.items()} for own in members]
    assert_made(
        many.areas(keys, np.array([square] * COUNT, object), members), lambda i: Area(keys[i], square, **given[i])
    )


def assert_made(together: Sequence[Area | Track | None], alone: Callable[[int], Area | Track]) -> None:
    refused = 0
    for i, one in enumerate(together):
        try:
            expected = alone(i)
        except InvalidInput:
            refused += 1
            assert one is None
        else:
            np.testing.assert_equal(
                *({field.name: getattr(each, field.name) for field in fields(each)} for each in (one, expected))  # type: ignore[type-var, arg-type]
            )
    assert 10 < refused < COUNT - 10
