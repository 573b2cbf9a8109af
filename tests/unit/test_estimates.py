"""The statistics behind `advise`: errors on a sample, intervals of shares, and their words."""

import math

import numpy as np
import pytest

from conflictdb.client import advise
from conflictdb.client.estimates import Count, Estimate, Proportion, Trial, duration, recommendation
from conflictdb.model.methods import Method
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US


def answer(*rows: tuple[int, int, bool] | None) -> np.ndarray:
    """Return an answer about pairs of objects: (first, last, is unresolved), None if the pair is not reported."""
    columns = np.zeros(len(rows), advise._ANSWER)
    for name, nth in (("first_us", 0), ("last_us", 1), ("open", 2)):
        columns[name] = [row[nth] if row else 0 for row in rows]
    columns["found"] = [row is not None for row in rows]
    return columns


def test_periods_are_compared_at_both_ends_of_pairs_that_meet() -> None:
    """Unbounded ends are equal, short periods are not too long, and other pairs do not count."""
    truth = answer((0, 9, True), (10_000_000, 20_000_000, False), (MINUS_INFINITY_US, INFINITY_US, False), None)
    found = answer(
        (0, 99, False), (9_000_000, 24_000_000, False), (MINUS_INFINITY_US, INFINITY_US, False), (0, 9, True)
    )
    assert sorted(advise._too_long_s(found, truth)) == [0.0, 0.0, 1.0, 4.0]
    assert sorted(advise._too_long_s(truth, truth)) == [0.0] * 4
    assert sorted(advise._too_long_s(answer(None, (12_000_000, 20_000_000, False), None, None), truth)) == [0.0, 0.0]
    assert len(advise._too_long_s(answer(None, None, None, (0, 9, True)), truth)) == 0


@pytest.mark.parametrize("rate", [0.003, 0.05, 0.5])
@pytest.mark.parametrize("n", [20, 150])
def test_intervals_of_shares_contain_the_truth(rate: float, n: int) -> None:
    """Hardly any, some or half of 400 pairs have a property; also if none of the sample has it."""
    rng = np.random.default_rng(5)
    population = rng.random(400) < rate
    population[0] = True
    shares = [Proportion.sampled(int(rng.permutation(population)[:n].sum()), n, n / 400) for _ in range(600)]
    true = population.mean()
    assert all(one.low <= one.count / one.of <= one.high for one in shares)
    assert np.mean([not one.low <= true <= one.high for one in shares]) < 0.06
    if rate >= 0.5:  # and they are of use
        assert np.median([one.high - one.low for one in shares]) < 5.0 * np.std([one.count / n for one in shares])


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [
        # C. J. Clopper, E. S. Pearson, Biometrika 26 (1934): 1 - 0.025^(1/n) if the count is 0, and so on.
        (0, 10, 0.0, 0.3085),
        (0, 100, 0.0, 0.03622),
        (1, 10, 0.00253, 0.4450),
        (5, 10, 0.1871, 0.8129),
        (9, 10, 0.5550, 0.99747),
        (10, 10, 0.6915, 1.0),
    ],
)
def test_interval_of_a_share_is_the_exact_one(count: int, of: int, low: float, high: float) -> None:
    share = Proportion.sampled(count, of, 0.0)
    assert (share.low, share.high) == pytest.approx((low, high), abs=1e-4)
    narrow = Proportion.sampled(count, of, 0.75)
    assert narrow.high - narrow.low == pytest.approx(0.5 * (high - low), abs=1e-4)
    assert Proportion.sampled(count, of, 1.0) == Proportion(count, of, count / of, count / of)


def test_the_share_of_nothing_may_be_any() -> None:
    for fraction in (0.0, 1.0):
        share = Proportion.sampled(0, 0, fraction)
        assert (share.low, share.high, str(share)) == (0.0, 1.0, "-")


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (Proportion.sampled(0, 5, 1.0), "none"),
        (Proportion.sampled(5, 5, 1.0), "all"),
        (Proportion.sampled(1, 8, 1.0), "12 %"),
        (Proportion.sampled(0, 100, 0.0), "at most 3.6 %"),
        (Proportion.sampled(100, 100, 0.0), "at least 96 %"),
        (Proportion.sampled(1, 100, 0.0), "0.025-5.4 %"),
        (Proportion.sampled(999, 1000, 0.0), "99-99.99 %"),
    ],
)
def test_shares_in_words(share: Proportion, text: str) -> None:
    """Never rounded to none or all where that is not certain."""
    assert str(share) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0"),
        (4e-7, "0"),
        (1e-6, "1.0 us"),
        (9.96e-6, "10 us"),
        (0.0009996, "1.0 ms"),
        (0.25, "250 ms"),
        (0.9999, "1.0 s"),
        (119.0, "119 s"),
        (600.0, "10 min"),
        (9000.0, "2.5 h"),
        (864000.0, "10 d"),
        (math.inf, "unbounded"),
        (math.nan, "-"),
    ],
)
def test_durations(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def estimate(
    method: Method, tolerance_m: float, seconds: float, reported: int, false_pairs: int, fraction: float = 1.0
) -> Estimate:
    shares = [Proportion.sampled(count, reported, fraction) for count in (false_pairs, 0)]
    count = Count(reported, reported, reported)
    return Estimate(Trial(method, tolerance_m), seconds, 0.0, 10.0, 10.0, count, *shares, 60.0, 600.0, 0.0)


def said(exact_s: float, screen_s: float, own: Method = Method.EXACT) -> str:
    pair = [estimate(Method.EXACT, 1.0, exact_s, 100, 0), estimate(Method.SCREEN, 1.0, screen_s, 200, 112)]
    return recommendation(pair, own, 1.0)


def test_a_cheap_exact_is_recommended() -> None:
    assert said(1.2, 0.9) == (
        "exact costs 1.2 s for this scene; screen costs 900 ms, 56 % of its pairs never meet, and its periods are up "
        "to 10 min too long: stay with exact."
    )
    assert said(1.2, 0.9, Method.SCREEN).endswith(": use exact.")
    assert said(1.2, 0.9, Method.NLP).endswith(": use exact.")
    assert said(59.0, 1.0).endswith(": stay with exact.")
    assert said(7000.0, 3600.0).endswith(": stay with exact.")


def test_screen_is_recommended_for_a_first_look_at_slow_scenes() -> None:
    look = "look with screen whether there is trouble, and use exact for what goes into an order."
    assert said(7000.0, 3400.0).endswith(look)
    assert said(61.0, 30.0).endswith(look)


def test_a_smaller_tolerance_with_fewer_false_pairs_is_named() -> None:
    """The largest of the smaller tolerances that does best."""
    text = recommendation(
        [
            estimate(Method.EXACT, 1000.0, 9.0, 100, 8),
            estimate(Method.EXACT, 10.0, 2.0, 92, 0),
            estimate(Method.EXACT, 0.0, 3.0, 92, 0),
            estimate(Method.SCREEN, 1000.0, 8.9, 110, 18),
        ],
        Method.EXACT,
        1000.0,
    )
    assert text.endswith(
        " Of the pairs that exact reports at 1000 m 8 % come close and do not meet; at 10 m none would, for 2.0 s."
    )


def test_an_equal_tolerance_is_not_named() -> None:
    estimates = [estimate(method, m, 1.0, 100, 8) for method in (Method.EXACT, Method.SCREEN) for m in (1.0, 10.0)]
    assert "Of the pairs" not in recommendation(estimates, Method.EXACT, 10.0)


def test_no_false_pair_in_a_sample_is_not_said_to_be_none() -> None:
    text = recommendation(
        [
            estimate(Method.EXACT, 1.0, 9.0, 100, 8, 0.0),
            estimate(Method.EXACT, 0.5, 9.0, 100, 0, 0.0),
            estimate(Method.SCREEN, 1.0, 8.9, 110, 0, 0.0),
        ],
        Method.EXACT,
        1.0,
    )
    assert "at most 3.3 % of its pairs never meet" in text
    assert text.endswith(
        " Of the pairs that exact reports at 1 m 3.5-15 % come close and do not meet; at 0.5 m at most 3.6 % would, "
        "for 9.0 s."
    )
