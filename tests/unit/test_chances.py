"""Probabilities of conflicts: by hand, by quadrature, and against detections of plans that depart at random."""

import time
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from draws import draws
from scipy import integrate, stats
from shifting import stretched
from workloads import GROWING, GROWING_CIRCLES, LOW_LATITUDE, Workload, throw

from conflictdb import Area, InvalidInput, Scene, Track, chances, delays, rectangle_outline_m, solve, speeds
from conflictdb.in_memory.questions import numbered
from conflictdb.stages import chances as stage
from conflictdb.stages.at_any_time import AnyTime
from conflictdb.stages.contacts_at_speeds import Pace, meetings_of

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


@pytest.mark.parametrize("given", [stats.norm(1.0, 0.05), stats.uniform(0.9, 0.3), [0.95, 1.0, 1.0, 1.1]])
def test_the_speed_of_a_track_is_uncertain(given: Any) -> None:
    """The chance is that of its forbidden speeds."""
    closed = Area("closed", shapely.box(0.9, -0.1, 1.1, 0.1), None, T0_US + 9_000_000_000, T0_US + 9_500_000_000)
    plans = [EAST, NORTH, replace(NORTH, key="second", times_us=NORTH.times_us + 200_000_000)]
    found = chances(plans, [closed], SCENE, speeds={"east": given})

    def chance(of: Any, key: str) -> float:
        """Over the forbidden speeds of east because of one other object, or of any."""
        others = [one for one in plans if one.key in ("east", key) or key == "any"]
        areas = [closed] if key in ("any", "closed") else []
        spans = [
            (each.from_factor, each.to_factor) for each in speeds(others, areas, SCENE, "east", 0.3, 2.0)[0].forbidden
        ]
        if isinstance(of, list):
            return float(np.mean([any(low <= one <= high for low, high in spans) for one in of]))
        return float(sum(of.cdf(high) - of.cdf(low) for low, high in spans))

    for key in ("north", "second", "closed"):
        least, most = found.pairs.get(("east", key), (0.0, 0.0))
        assert least - 1e-7 <= chance(given, key) <= most + 1e-7
        assert most < least + 1e-6
        assert key == "closed" or found.tracks[key][0] >= least - 1e-9
    least, most = found.tracks["east"]
    assert least - 1e-7 <= chance(given, "any") <= most + 1e-7
    assert found.expected == pytest.approx([sum(one[k] for one in found.pairs.values()) for k in (0, 1)], abs=1e-9)


def test_an_uncertain_speed_is_as_often_in_conflict_as_computed() -> None:
    """Monte Carlo by `solve`, within four standard errors."""
    scene, areas, tracks = throw(LOW_LATITUDE, 4, 10, 40, tolerance_m=1.0)
    rng, runs, given, count = np.random.default_rng(0), 50, stats.norm(1.0, 0.15), 0
    for one in (track for track in tracks if track.key in ("T5", "T9", "T13")):
        found = {
            key: bounds
            for key, bounds in chances(tracks, areas, scene, speeds={one.key: given}).pairs.items()
            if one.key in key
        }
        met = {other for key in found for other in key} - {one.key}
        rest, closed = [track for track in tracks if track.key in met], [area for area in areas if area.key in met]
        seen: Counter[frozenset[str]] = Counter()
        for _ in range(runs):
            faster = stretched(one, float(given.rvs(random_state=rng)))
            seen.update({frozenset((row.a_key, row.b_key)) for row in solve([faster, *rest], closed, scene)})
        for key, (least, most) in found.items():
            error = 4.0 * np.sqrt(max(least * (1.0 - least), 1.0 / runs) / runs)
            assert least - error <= seen[frozenset(key)] / runs <= most + error
            assert most - least < 1e-6
            count += 0.05 < least < 0.95
    assert count > 10


def moved(plan: Track, factor: float, delay_s: float) -> Track:
    """The plan at another speed, departing later."""
    fast = stretched(plan, factor)
    return replace(fast, times_us=fast.times_us + round(1e6 * delay_s), max_speed_kn=np.inf)


@pytest.mark.parametrize(
    ("departures", "fast"),
    [
        ({}, {"east": stats.norm(1.0, 0.05), "north": stats.norm(1.0, 0.05)}),
        ({"east": NORMAL, "north": WIDE}, {"east": stats.norm(1.0, 0.05), "north": stats.uniform(0.9, 0.3)}),
        ({"north": UNIFORM}, {"east": [0.95, 1.0, 1.0, 1.1], "north": [0.9, 1.1]}),
        ({"north": [-300.0, 0.0, 900.0]}, {"east": stats.norm(1.0, 0.1), "north": stats.norm(1.0, 0.1)}),
    ],
)
def test_speeds_and_departures_are_uncertain_together(
    monkeypatch: pytest.MonkeyPatch, departures: dict[str, Any], fast: dict[str, Any]
) -> None:
    """Monte Carlo by `solve`, within four standard errors. A tenth of the work gives bounds that are narrow enough."""
    monkeypatch.setattr(stage, "MOST_VALUES", 20_000_000)
    plans = [EAST, NORTH]
    closed = Area("closed", shapely.box(0.9, -0.1, 1.1, 0.1), None, T0_US + 9_000_000_000, T0_US + 9_500_000_000)
    found = chances(plans, [closed], SCENE, departures, fast)
    rng, runs = np.random.default_rng(0), 60
    seen: Counter[frozenset[str]] = Counter()
    met: Counter[str] = Counter()
    for _ in range(runs):
        flown = [
            moved(
                plan,
                *(_draw(of[plan.key], rng) if plan.key in of else 1.0 - n for n, of in enumerate([fast, departures])),
            )
            for plan in plans
        ]
        conflicts = {frozenset((row.a_key, row.b_key)) for row in solve(flown, [closed], SCENE)}
        seen.update(conflicts)
        met.update({key for both in conflicts for key in both})
    assert set(found.pairs) == {("east", "north"), ("east", "closed")}
    for (least, most), count in [
        *((bounds, seen[frozenset(key)]) for key, bounds in found.pairs.items()),
        *((bounds, met[key]) for key, bounds in found.tracks.items()),
    ]:
        error = 4.0 * np.sqrt(max(least * (1.0 - least), 1.0 / runs) / runs)
        assert least - error <= count / runs <= most + error
    assert max(most - least for least, most in found.pairs.values()) < 5e-3
    assert max(most - least for least, most in found.tracks.values()) < 0.15


def test_an_uncertain_speed_and_departure_equal_a_quadrature() -> None:
    """The mean over speeds of the probability of the forbidden delays of the plan at that speed."""
    speed, departure, count = stats.norm(1.0, 0.05), stats.norm(100.0, 600.0), 4000
    least, most = chances([EAST, NORTH], [], SCENE, {"east": departure}, {"east": speed}).pairs["east", "north"]
    assert 0.0 <= most - least < 1e-6
    factors = speed.ppf((np.arange(count) + 0.5) / count)
    nodes = np.linspace(factors[0], factors[-1], 65)
    ends = np.array([difference(stretched(EAST, float(factor)), NORTH) for factor in nodes])
    # Ends are smooth, but for a few kinks.
    low, high = (np.interp(factors, nodes, ends[:, k]) for k in (0, 1))
    assert np.mean(departure.cdf(high) - departure.cdf(low)) == pytest.approx(0.5 * (least + most), abs=3e-5)


@pytest.mark.parametrize("workload", [GROWING, LOW_LATITUDE, GROWING_CIRCLES], ids=lambda workload: workload.name)
def test_differences_at_any_speeds_are_those_of_plans_at_these(workload: Workload) -> None:
    """What is proven in contact at some speeds is forbidden by a computation with these, and the other way round."""
    scene, _, tracks = throw(workload, 3, 0, 8, tolerance_m=1.0, separation_m=200.0)
    setup, pieces, keys, numbers, tracks = numbered("chances", tracks, [], scene)
    limits = (0.5, 2.0)
    paces = {
        number: Pace(int(one.times_us[0]), float(np.ptp(one.times_us)) / 1e6, (-1e6, 1e6), limits)
        for number, one in zip(numbers.tolist(), tracks, strict=True)
    }
    of_number, rng, compared = dict(zip(numbers.tolist(), tracks, strict=True)), np.random.default_rng(0), 0
    for (a, b), meeting in meetings_of(setup, AnyTime.of(pieces), paces).items():
        factors = rng.uniform(*limits, (2, 1, 1))
        low, high = (
            np.concatenate(some) for some in zip(meeting.inner(*factors), meeting.outer(*factors), strict=True)
        )
        inner, outer = np.split(np.column_stack([low.ravel(), high.ravel()]), 2)
        plans = [stretched(of_number[n], 1.0 / float(factors[k, 0, 0])) for k, n in enumerate((a, b))]
        [found] = delays(plans, [], scene, keys[a], 9e5)
        spans = [(one.from_s, one.to_s) for one in found.forbidden if one.is_proven]
        for start, end in inner[inner[:, 0] <= inner[:, 1]].tolist():
            assert any(one.from_s <= start and end <= one.to_s for one in found.forbidden)
        for start, end in [(one.from_s + one.from_error_s, one.to_s - one.to_error_s) for one in found.forbidden]:
            for at in np.linspace(start, end, 7):
                assert ((outer[:, 0] <= at) & (at <= outer[:, 1])).any()
        compared += len(spans)
    assert compared > 5


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ({"speeds": {"east": stats.norm(1.0, 0.5)}}, "finite factors, from 0.01 to 100"),
        ({"speeds": {"east": [0.0]}}, "finite factors"),
        ({"speeds": {"east": stats.norm(0.0, 0.0)}}, "finite factors"),
        ({"departures": [0.0]}, "departures: must be distributions by the keys"),
        ({"speeds": "east"}, "speeds: must be distributions by the keys"),
        ({"departures": {3: [0.0]}}, "3 is not known"),
        ({"departures": {"east": [1e18]}}, "finite delays in seconds, from -1e\\+09"),
    ],
)
def test_uncertainty_has_limits(given: dict[str, Any], rule: str) -> None:
    with pytest.raises(InvalidInput, match=rule):
        chances([EAST, NORTH], [], SCENE, **given)


@pytest.mark.parametrize("has_speeds", [False, True])
@pytest.mark.parametrize("kind", ["normal", "empirical"])
def test_the_work_is_bounded(monkeypatch: pytest.MonkeyPatch, kind: str, has_speeds: bool) -> None:
    """A small budget is kept, and gives wider bounds; distributions of 100,000 values do not hang."""
    scene, areas, tracks = throw(LOW_LATITUDE, 4, 4, 12, tolerance_m=1.0)
    rng = np.random.default_rng(0)

    def given(mean: float, sd: float, values: int) -> dict[str, Any]:
        """Distributions of the tracks but one."""
        many: list[Any] = [np.clip(rng.normal(mean, sd, values), mean - 4.0 * sd, mean + 4.0 * sd) for _ in tracks[1:]]
        some = many if kind == "empirical" else [stats.norm(mean, sd)] * len(many)
        return {one.key: each for one, each in zip(tracks[1:], some, strict=True)}

    spent: list[int] = []
    spend = stage.Budget.spend

    def counted(self: stage.Budget, values: int) -> None:
        spent.append(values)
        spend(self, values)

    monkeypatch.setattr(stage.Budget, "spend", counted)
    few = given(0.0, 3000.0, 2000), given(1.0, 0.05, 30) if has_speeds else None
    monkeypatch.setattr(stage, "MOST_VALUES", 2_000_000)
    sharp = chances(tracks, areas, scene, *few)
    spent.clear()
    monkeypatch.setattr(stage, "MOST_VALUES", 100_000)
    rough = chances(tracks, areas, scene, *few)
    # The least of each computation, besides the budgets of pairs and of tracks.
    assert sum(spent) < 200_000 + 60_000 * len(spent)
    apart = 0.0
    for key, (least, most) in {**sharp.pairs, **sharp.tracks}.items():
        low, high = {**rough.pairs, **rough.tracks}[key]  # type: ignore[index]
        assert low <= least + 1e-9
        assert most <= high + 1e-9
        apart = max(apart, (high - low) - (most - least))
    assert apart > 1e-3
    many = given(0.0, 3000.0, 100_000), given(1.0, 0.05, 100_000) if has_speeds else None
    began = time.process_time()
    found = chances(tracks, areas, scene, *many)
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
    scene, areas, tracks = throw(LOW_LATITUDE, 4, 10, 40, tolerance_m=1.0)
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


def _draw(given: Any, rng: np.random.Generator) -> float:
    return float(rng.choice(given) if isinstance(given, list) else given.rvs(random_state=rng))


def _drawn(departure: Any, rng: np.random.Generator) -> int:
    delay_s = rng.choice(departure) if isinstance(departure, np.ndarray) else departure.rvs(random_state=rng)
    return round(1e6 * float(delay_s))
