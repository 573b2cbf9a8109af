"""Probabilities of conflicts: by hand, by quadrature, and against detections of plans that depart at random."""

import time
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from draws import draws
from layouts import GROWING, GROWING_CIRCLES, LOW_LATITUDE, Workload
from mixed_scenes import plain_scene
from scipy import integrate, stats

from conflictdb import Area, InvalidInput, Scene, Track, chances, delays, rectangle_outline_m, solve
from conflictdb.core import chances as stage

T0_US = 1_780_000_000_000_000
SCENE = Scene("chances")


def track(key: str, start: tuple[float, float], end: tuple[float, float], departs_s: float = 0.0) -> Track:
    start_us = T0_US + round(1e6 * departs_s)
    return Track(
        key, [start, end], [start_us, start_us + 11_000_000_000], rectangle_outline_m(1000.0, 500.0, 100.0, 100.0)
    )


EAST, NORTH = track("east", (0.0, 0.0), (1.0, 0.0)), track("north", (0.5, -0.5), (0.5, 0.5), 300.0)


def difference(a: Track, b: Track) -> tuple[float, float]:
    """The ends of the forbidden delays of a."""
    [found] = delays([a, b], [], SCENE, a.key)[0].forbidden
    return found.from_s, found.to_s


def by_quadrature(a: Any, b: Any, low_s: float, high_s: float) -> float:
    """P(low <= X_a - X_b <= high)."""
    x = np.linspace(b.ppf(1e-13), b.isf(1e-13), 1_000_001)
    return float(integrate.trapezoid(b.pdf(x) * (a.cdf(high_s + x) - a.cdf(low_s + x)), x))


NORMAL, WIDE = stats.norm(60.0, 300.0), stats.norm(-20.0, 500.0)
UNIFORM, SHORT = stats.uniform(-300.0, 900.0), stats.uniform(10.0, 50.0)


@pytest.mark.parametrize(
    ("of_a", "of_b"),
    [(NORMAL, WIDE), (UNIFORM, SHORT), (SHORT, UNIFORM), (NORMAL, UNIFORM), (UNIFORM, NORMAL), (SHORT, WIDE)],
)
def test_two_continuous_departures(of_a: Any, of_b: Any) -> None:
    found = chances([EAST, NORTH], [], SCENE, {"east": of_a, "north": of_b})
    least, most = found.pairs["east", "north"]
    expected = by_quadrature(of_a, of_b, *difference(EAST, NORTH))
    assert 0.0 <= most - least < 1e-6
    assert least - 1e-7 <= expected <= most + 1e-7
    assert found.expected == pytest.approx((least, most), abs=1e-9)
    for bounds in found.tracks.values():
        assert bounds == pytest.approx((least, most), abs=1e-9)


@pytest.mark.parametrize("of_b", [NORMAL, UNIFORM, [-100.0, 400.0], None])
def test_an_empirical_departure_is_a_mean_over_its_delays(of_b: Any) -> None:
    of_a = [-700.0, -250.0, 0.0, 0.0, 333.0]
    low_s, high_s = difference(EAST, NORTH)
    both = {"east": of_a} | ({"north": of_b} if of_b is not None else {})
    least, most = chances([EAST, NORTH], [], SCENE, both).pairs["east", "north"]
    if of_b is None or isinstance(of_b, list):
        met = [low_s <= x - y <= high_s for x in of_a for y in of_b or [0.0]]
        expected = float(np.mean(met))
    else:
        expected = float(np.mean([of_b.cdf(x - low_s) - of_b.cdf(x - high_s) for x in of_a]))
    assert most - least < 1e-6
    assert least - 1e-7 <= expected <= most + 1e-7


def test_a_departure_as_planned_is_certain() -> None:
    same = replace(NORTH, times_us=EAST.times_us)
    assert chances([EAST, same], [], SCENE).pairs["east", "north"] == pytest.approx((1.0, 1.0), abs=1e-9)
    later = replace(NORTH, times_us=NORTH.times_us + 9_000_000_000)
    assert chances([EAST, later], [], SCENE).pairs == {}
    assert chances([], [], SCENE).expected == (0.0, 0.0)


def test_what_departs_as_planned_is_met_together_exactly() -> None:
    """Intervals of several objects overlap: the chance to meet any is that of their union."""
    second = replace(NORTH, key="second", times_us=NORTH.times_us + 200_000_000)
    closed = Area("closed", shapely.box(0.9, -0.1, 1.1, 0.1), None, T0_US + 9_000_000_000, T0_US + 12_000_000_000)
    found = chances([EAST, NORTH, second], [closed], SCENE, {"east": NORMAL})
    forbidden = delays([EAST, NORTH, second], [closed], SCENE, "east", 20_000.0)[0].forbidden
    expected = sum(NORMAL.cdf(one.to_s) - NORMAL.cdf(one.from_s) for one in forbidden)
    least, most = found.tracks["east"]
    assert least - 1e-7 <= expected <= most + 1e-7
    assert most - least < 1e-6
    assert set(found.pairs) == {("east", "north"), ("east", "second"), ("north", "second"), ("east", "closed")}


@pytest.mark.parametrize("time_separation_s", [45.0, 1800.0])
@pytest.mark.parametrize(("seed", "workload"), [(3, LOW_LATITUDE), (4, GROWING), (5, GROWING_CIRCLES)])
def test_departures_with_a_separation_in_time_are_those_of_sampled_shifts(
    workload: Workload, seed: int, time_separation_s: float
) -> None:
    """The share of sampled shifts of a track at which `solve` finds a conflict lies in the bounds, climbs and all."""
    scene, areas, tracks = plain_scene(workload, seed, 3, 10)
    rng = np.random.default_rng(seed)
    scene, tracks = replace(scene, time_separation_s=time_separation_s), [climbing(one, rng) for one in tracks]
    compared = 0
    for one in tracks:
        rest = [track for track in tracks if track is not one]
        # As planned, and around the ends of what is forbidden: there the separation in time decides.
        ends_s = [
            end for found in delays(tracks, areas, scene, one.key)[0].forbidden for end in (found.from_s, found.to_s)
        ]
        shifts_s = [
            0.0,
            *(end + by for end in ends_s[:6] for by in (-0.5 * time_separation_s, 0.5 * time_separation_s)),
        ]
        met: Counter[str] = Counter()
        for shift_s in shifts_s:
            moved = replace(one, times_us=one.times_us + round(1e6 * shift_s))
            conflicts = solve([moved, *rest], areas, scene)
            met.update(other_of(one.key, row.a_key, row.b_key) for row in conflicts)
        found = chances(tracks, areas, scene, {one.key: shifts_s})
        bounds = {other_of(one.key, *key): each for key, each in found.pairs.items()}
        for other in {*met, *bounds} - {""}:
            least, most = bounds.get(other, (0.0, 0.0))
            assert least - 1e-9 <= met[other] / len(shifts_s) <= most + 1e-9, (one.key, other)
            compared += most > 0.0
    assert compared >= 5


def test_heights_that_differ_by_less_than_their_rounding_prove_nothing() -> None:
    """East climbs so slowly that rounding hides when it reaches the height of north: after it has passed."""
    times_s, separated = 10_000.0, Scene("s", time_separation_s=1800.0)
    crossing = 0.5 * times_s + 30.0
    box = rectangle_outline_m(50.0, 50.0, 50.0, 50.0)
    times_us = [T0_US, T0_US + round(1e6 * times_s)]
    rise_m = 1e-6
    east = Track(
        "east",
        [(0, 0), (1, 0)],
        times_us,
        box,
        floors_m=np.array([0.0, rise_m]),
        ceilings_m=np.array([1.0, 1.0 + rise_m]),
    )
    north = Track(
        "north", [(0.5, -0.5), (0.5, 0.5)], times_us, box, floor_m=1.0 + rise_m * crossing / times_s, ceiling_m=9.0
    )
    assert chances([east, north], [], SCENE).pairs["east", "north"] == (0.0, 1.0)
    assert chances([east, north], [], separated).pairs["east", "north"] == (0.0, 1.0)


def other_of(key: str, *pair: str) -> str:
    """The other object of a pair; of other pairs none."""
    return next(one for one in pair if one != key) if key in pair else ""


def climbing(one: Track, rng: np.random.Generator) -> Track:
    """The track, of which two in three climb or descend from waypoint to waypoint."""
    floors_m = np.zeros(len(one.times_us)) if rng.random() < 1 / 3 else rng.uniform(0.0, 100.0, len(one.times_us))
    return replace(one, floors_m=floors_m, ceilings_m=floors_m + 30.0, max_speed_kn=np.inf)


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ({"departures": [0.0]}, "departures: must be distributions by the keys"),
        ({"departures": {3: [0.0]}}, "3 is not known"),
        ({"departures": {"east": [1e18]}}, "finite delays in seconds, from -1e\\+09"),
    ],
)
def test_uncertainty_has_limits(given: dict[str, Any], rule: str) -> None:
    with pytest.raises(InvalidInput, match=rule):
        chances([EAST, NORTH], [], SCENE, **given)


@pytest.mark.parametrize("kind", ["normal", "empirical"])
def test_the_work_is_bounded(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """A small budget is kept, and gives wider bounds; distributions of 100,000 values do not hang."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 4, 4, 12, tolerance_m=1.0)
    rng = np.random.default_rng(0)

    def given(mean: float, sd: float, values: int) -> dict[str, Any]:
        """Distributions of the tracks but one."""
        many: list[Any] = [np.clip(rng.normal(mean, sd, values), mean - 4.0 * sd, mean + 4.0 * sd) for _ in tracks[1:]]
        some = many if kind == "empirical" else [stats.norm(mean, sd)] * len(many)
        return {one.key: each for one, each in zip(tracks[1:], some, strict=True)}

    spent: list[int] = []
    spend = stage._Budget.spend

    def counted(self: stage._Budget, values: int) -> None:
        spent.append(values)
        spend(self, values)

    monkeypatch.setattr(stage._Budget, "spend", counted)
    few = given(0.0, 3000.0, 2000)
    monkeypatch.setattr(stage, "MOST_VALUES", 2_000_000)
    sharp = chances(tracks, areas, scene, few)
    spent.clear()
    monkeypatch.setattr(stage, "MOST_VALUES", 100_000)
    rough = chances(tracks, areas, scene, few)
    # The least of each computation, besides the budgets of pairs and of tracks.
    assert sum(spent) < 200_000 + 60_000 * len(spent)
    apart = 0.0
    for key, (least, most) in {**sharp.pairs, **sharp.tracks}.items():
        low, high = {**rough.pairs, **rough.tracks}[key]  # type: ignore[index]
        assert low <= least + 1e-9
        assert most <= high + 1e-9
        apart = max(apart, (high - low) - (most - least))
    assert apart > 1e-3
    many = given(0.0, 3000.0, 100_000)
    began = time.process_time()
    found = chances(tracks, areas, scene, many)
    assert time.process_time() - began < 20.0
    assert 1.0 < found.expected[0] <= found.expected[1]


def test_a_waiting_track_shifts_as_a_whole() -> None:
    """It does not occupy its first waypoint before it departs: nothing comes by meanwhile."""
    waits = Track(
        "east", [(0.0, 0.0), (0.0, 0.0), (1.0, 0.0)], [T0_US, T0_US + 1_000_000, T0_US + 11_000_000_000], EAST.outline_m
    )
    by = track("by", (0.0, -0.5), (0.0, 0.5), 100_000.0)
    assert chances([waits, by], [], SCENE, {"east": [200_000.0]}).tracks["east"] == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("given", ["soon", [], [np.nan], [[np.inf]], stats.expon(), stats.norm(0.0, 0.0), object()])
def test_other_distributions_are_refused(given: Any) -> None:
    with pytest.raises(InvalidInput, match="must be norm or uniform"):
        chances([EAST], [], SCENE, {"east": given})


def test_an_unknown_track_is_refused() -> None:
    with pytest.raises(InvalidInput, match="'south' is not known"):
        chances([EAST], [], SCENE, {"south": NORMAL})


@draws("runs", 40, 120)
def test_200_pairs_are_as_often_in_conflict_as_computed(runs: int) -> None:
    """Monte Carlo by `solve`: each pair, each track, and the number of conflicts, within four standard errors."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 4, 10, 40, tolerance_m=1.0)
    rng = np.random.default_rng(0)
    kinds: list[Any] = [stats.norm(0.0, 1800.0), stats.uniform(-3600.0, 7200.0), rng.normal(0.0, 3000.0, 50)]
    departures = {one.key: kinds[k % 3] for k, one in enumerate(tracks)}
    found = chances(tracks, areas, scene, departures)
    pairs: Counter[tuple[str, str]] = Counter()
    met: Counter[str] = Counter()
    counts = []
    for _ in range(runs):
        moved = [replace(one, times_us=one.times_us + _drawn(departures[one.key], rng)) for one in tracks]
        conflicts = {frozenset((one.a_key, one.b_key)) for one in solve(moved, areas, scene) if one.b_key in departures}
        counts.append(len(conflicts))
        pairs.update(key for key in found.pairs if frozenset(key) in conflicts)
        met.update({key for both in conflicts for key in both})
        assert conflicts <= {frozenset(key) for key in found.pairs}
    assert len(found.pairs) >= 200
    for bounds, seen in [
        *((found.pairs[key], pairs[key]) for key in found.pairs),
        *((found.tracks[one.key], met[one.key]) for one in tracks),
    ]:
        error = 4.0 * np.sqrt(max(bounds[0] * (1.0 - bounds[0]), 1.0 / runs) / runs)
        assert bounds[0] - error <= seen / runs <= bounds[1] + error
    error = 4.0 * float(np.std(counts)) / np.sqrt(runs)
    assert found.expected[0] - error <= np.mean(counts) <= found.expected[1] + error
    assert max(most - least for least, most in found.pairs.values()) < 1e-6
    assert max(most - least for least, most in found.tracks.values()) < 1e-2


def _drawn(departure: Any, rng: np.random.Generator) -> int:
    delay_s = rng.choice(departure) if isinstance(departure, np.ndarray) else departure.rvs(random_state=rng)
    return round(1e6 * float(delay_s))
