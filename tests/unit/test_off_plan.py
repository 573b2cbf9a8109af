"""Tracks that are off their plans: which may meet, without a comparison of each with each."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from conflictdb.core.delays import Differences
from conflictdb.earth.geodesy import great_circle_distance
from conflictdb.jobs import off_plan
from conflictdb.model.plans import Scene
from conflictdb.model.results import Kind
from conflictdb.store import Straying

SCENE = Scene("sea", separation_m=500.0)


def stray(key: str, lon: float, lat: float, error_m: float = 100.0) -> Straying:
    return Straying(key, True, None, None, 0, lon, lat, None, error_m, 10.0, None, None)


def places(count: int, seed: int) -> list[Straying]:
    """All around the earth, some with a large error, some beyond the antimeridian."""
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(-200.0, 200.0, count), np.degrees(np.arcsin(rng.uniform(-1.0, 1.0, count)))
    error_m = 10.0 ** rng.uniform(1.0, 6.0, count)
    return [
        stray(f"T{k}", *row) for k, row in enumerate(zip(lon.tolist(), lat.tolist(), error_m.tolist(), strict=True))
    ]


@pytest.mark.parametrize("seed", range(20))
def test_those_within_reach_are_those_of_all_pairs(seed: int) -> None:
    mine, others = places(30, seed), places(200, 1000 + seed)
    (lon, lat, reach_m), (other_lon, other_lat, other_reach_m) = (
        np.array([(one.lon, one.lat, one.error_m + 6000.0) for one in some]).T for some in (mine, others)
    )
    away_m = great_circle_distance(lon[:, None], lat[:, None], other_lon, other_lat)
    apart_m = reach_m[:, None] + other_reach_m + SCENE.largest_separation_m + SCENE.reach_m
    expected = np.flatnonzero((away_m <= 1.01 * apart_m).any(axis=0)).tolist()
    assert len(expected) < 200
    assert off_plan._within_reach(SCENE, mine, others, 600_000_000) == expected


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers of distances that were computed."""
    sizes: list[int] = []

    def counted(*places: Any) -> Any:
        found = great_circle_distance(*places)
        sizes.append(found.size)
        return found

    monkeypatch.setattr(off_plan, "great_circle_distance", counted)
    return sizes


def test_distances_are_those_of_neighbours(measured: list[int]) -> None:
    """A row of ships, 0.1 degrees apart: each has a few neighbours, however many there are."""
    mine = [stray(f"M{k}", 0.1 * k, 50.0) for k in range(500)]
    others = [stray(f"O{k}", 0.1 * k, 50.01) for k in range(500)]
    assert off_plan._within_reach(SCENE, mine, others, 60_000_000) == list(range(500))
    assert sum(measured) < 5 * 500


class Counted(np.ndarray[Any, Any]):
    """Numbers that count how many of them are compared."""

    compared = 0

    def __array_ufunc__(self, ufunc: Callable[..., Any], method: str, *inputs: Any, **named: Any) -> Any:
        Counted.compared += max(np.size(one) for one in inputs)
        plain = [np.asarray(one) if isinstance(one, Counted) else one for one in inputs]
        found = getattr(ufunc, method)(*plain, **named)
        return found.view(Counted) if isinstance(found, np.ndarray) else found


def compared(pairs: int) -> int:
    """Return how many numbers are compared for so many pairs, each with two intervals."""
    track, other = np.repeat(np.arange(pairs), 2), np.repeat(np.arange(pairs) + pairs, 2)
    low = np.tile([-5, 3], pairs)
    columns: dict[str, Any] = {name: np.zeros(2 * pairs) for name in Differences.__dataclass_fields__}
    columns |= {"track": track, "other": other, "low": low, "high": low + 2}
    found = Differences(**{name: column.view(Counted) for name, column in columns.items()})

    plans: Any = SimpleNamespace(each=[SimpleNamespace(key=f"K{k}", kind=Kind.TRACK) for k in range(2 * pairs)])
    Counted.compared = 0
    ends = np.full(2 * pairs, 10)
    rows = off_plan._following(plans, found, -ends, ends)
    assert len(rows) == pairs
    assert {tuple(one.ends_us) for one in rows} == {(-5, -3, 3, 5)}
    return Counted.compared


def test_pairs_are_not_sought_among_all_rows() -> None:
    assert compared(400) < 3 * compared(200)
