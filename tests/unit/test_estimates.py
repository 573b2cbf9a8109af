"""The statistics behind `advise`: what is wrong, what a sample says of the whole, and how it is put in words."""

import math
from dataclasses import replace

import numpy as np
import pytest

from conflictdb.advice.estimates import (
    Answer,
    Cost,
    Count,
    Errors,
    Estimate,
    Sampling,
    Setting,
    Share,
    duration,
    errors_of,
    extrapolated_s,
    object_error,
    percent,
    recommendation,
    whole,
)
from conflictdb.advice.sample import Frame
from conflictdb.model import INFINITY_US, MINUS_INFINITY_US, EarthModel, Method

HOUR_US = 3_600_000_000
NO_COST = Cost(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def answer(*rows: tuple[int, int, int, bool]) -> Answer:
    """Return an answer of (pair, first, last, is_unresolved)."""
    columns = np.array([row[:3] for row in rows], np.int64).reshape(-1, 3)
    return Answer(*columns.T, np.array([row[3] for row in rows], np.bool_), np.full(len(rows), 0.25))


def test_an_answer_is_not_wrong_against_itself() -> None:
    same = answer((3, 0, HOUR_US, False), (7, MINUS_INFINITY_US, INFINITY_US, False))
    wrong = errors_of(same, same)
    assert wrong == Errors(2, 0, 2, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.25)


def test_false_missed_and_unresolved_pairs_are_told_apart() -> None:
    """What the truth leaves open is neither false nor missed."""
    truth = answer((1, 0, 10, False), (2, 0, 10, False), (3, 0, 10, True), (4, 0, 10, True))
    found = answer((9, 0, 10, True), (2, 0, 10, False), (3, 0, 99, False))
    wrong = errors_of(found, truth)
    assert (wrong.reported, wrong.false_pairs, wrong.unresolved) == (3, 1, 1)
    assert (wrong.meeting_pairs, wrong.missed_pairs) == (2, 1)
    assert wrong.slack_worst_s == 0.0


def test_slack_is_taken_over_both_ends_and_shortness_apart() -> None:
    truth = answer((1, 10_000_000, 20_000_000, False), (2, 10_000_000, 20_000_000, False))
    found = answer((2, 9_000_000, 24_000_000, False), (1, 12_000_000, 20_000_000, False))
    wrong = errors_of(found, truth)
    assert (wrong.slack_median_s, wrong.slack_worst_s, wrong.short_worst_s) == (0.5, 4.0, 2.0)
    assert wrong.slack_p95_s == pytest.approx(np.quantile([0.0, 0.0, 1.0, 4.0], 0.95))


def test_without_a_pair_that_meets_there_is_no_slack() -> None:
    wrong = errors_of(answer((1, 0, 1, False)), answer())
    assert math.isnan(wrong.slack_median_s)
    assert math.isnan(wrong.slack_worst_s)
    assert (wrong.reported, wrong.false_pairs, wrong.meeting_pairs) == (1, 1, 0)


EVERYTHING = Sampling(1.0, 1.0)
LITTLE = Sampling(0.0, 1.0)


def test_a_whole_that_was_counted_has_no_error() -> None:
    assert whole(np.array([1.0, 0.0, 5.0]), 3, EVERYTHING, 0.0, 1.0) == Count(6.0, 6.0, 6.0)
    assert whole(np.zeros(3), 3, EVERYTHING, 0.0, 1.0) == Count(0.0, 0.0, 0.0)
    assert whole(np.empty(0), 0, EVERYTHING, 0.0, 1.0) == Count(0.0, 0.0, 0.0)


@pytest.mark.parametrize("is_count", [True, False])
@pytest.mark.parametrize("rate", [0.003, 0.05, 0.5, 2.0])
@pytest.mark.parametrize("n", [20, 150])
def test_intervals_of_totals_hold_the_truth(rate: float, n: int, is_count: bool) -> None:
    """Of 400 pairs of which hardly any, some or most have a value; also where none of the sample has one."""
    rng = np.random.default_rng(5)
    population = rng.poisson(rate, 400).astype(np.float64)
    population[0] = 1.0
    if not is_count:
        population = np.minimum(population, 1.0)
    counts = [whole(rng.permutation(population)[:n], 400, Sampling(n / 400, 1.0), 0.0, 1.0) for _ in range(600)]
    assert all(one.low <= one.value <= one.high for one in counts)
    # Shares are exact: 5 % at most, and what 600 draws make of it. Means of few counts, which are skewed, miss more.
    missed = np.mean([not one.low <= population.sum() <= one.high for one in counts])
    assert missed < (0.075 if is_count else 0.06)
    if rate >= 0.5:  # and they are of use
        assert np.median([one.high - one.low for one in counts]) < 5.0 * np.std([one.value for one in counts])


def test_values_that_differ_widen_the_interval() -> None:
    """Two of them do already."""
    alike, apart = (whole(np.array([*values, 0.0, 0.0]), 1e6, LITTLE, 0.0, 1.0) for values in ((5.0, 5.0), (1.0, 9.0)))
    assert alike.value == apart.value
    assert apart.high > 1.1 * alike.high
    assert whole(np.array([5.0]), 1e6, LITTLE, 0.0, 1.0).high == 5e6


def test_an_unknown_number_of_pairs_widens_the_interval() -> None:
    """By the error of the objects looked at, in squares."""
    of_pair = np.ones(10_000)
    sharp, wide = (whole(of_pair, 1e6, Sampling(0.01, 1.0), error, 1.0) for error in (0.0, 0.1))
    assert (sharp.value, wide.value) == (1e6, 1e6)
    assert sharp.high == 1e6
    assert sharp.low == pytest.approx(1e6, rel=4e-4)
    assert (wide.low, wide.high) == pytest.approx((1e6 - 1.96e5, 1e6 + 1.96e5), rel=1e-4)


@pytest.mark.parametrize(
    ("count", "of", "low", "high"),
    [
        # C. J. Clopper, E. S. Pearson, Biometrika 26 (1934): 1 - 0.025^(1/n) where there is none, and so on.
        (0, 10, 0.0, 0.3085),
        (0, 100, 0.0, 0.03622),
        (1, 10, 0.00253, 0.4450),
        (5, 10, 0.1871, 0.8129),
        (9, 10, 0.5550, 0.99747),
        (10, 10, 0.6915, 1.0),
    ],
)
def test_interval_of_a_share_is_the_exact_one(count: int, of: int, low: float, high: float) -> None:
    share = LITTLE.share(count, of)
    assert (share.low, share.high) == pytest.approx((low, high), abs=1e-4)
    assert share.value == count / of
    assert Sampling(0.0, 2.0).share(2 * count, 2 * of).low == pytest.approx(low, abs=1e-4)
    narrow = Sampling(0.75, 1.0).share(count, of)
    assert narrow.high - narrow.low == pytest.approx(0.5 * (high - low), abs=1e-4)
    assert EVERYTHING.share(count, of) == Share.certain(count, of) == Share(count, of, count / of, count / of)


def test_the_share_of_nothing_may_be_any() -> None:
    for share in (LITTLE.share(0, 0), EVERYTHING.share(0, 0)):
        assert (share.low, share.high) == (0.0, 1.0)
        assert math.isnan(share.value)


def test_intervals_hold_the_truth_where_pairs_share_objects() -> None:
    """Among a part of the objects, some of which are wrong with whomever they meet: the worst that can be."""
    rng = np.random.default_rng(7)
    objects, looked_at, drawn = 2000, 100, 60
    is_bad = np.arange(objects) < 60
    true = 1.0 - (1940 * 1939) / (2000 * 1999)
    outside = np.zeros(2)
    for _ in range(400):
        some = rng.permutation(objects)[:looked_at]
        a, b = np.triu_indices(looked_at, 1)
        chosen = rng.permutation(len(a))[:drawn]
        a, b = some[a[chosen]], some[b[chosen]]
        keys = np.minimum(a, b) * objects + np.maximum(a, b)
        frame = Frame(objects, some, np.arange(4950), np.arange(4950), 404.0, 0.1, 1e-3, 1e4)
        share = frame.sampling(drawn, keys).share(int((is_bad[a] | is_bad[b]).sum()), drawn)
        outside += (share.high < true, share.low > true)
    assert (outside / 400 < 0.05).all()


def test_pairs_that_share_objects_count_for_less_where_objects_were_drawn() -> None:
    """A star of pairs is as one; pairs apart are each one; and of all objects it is pairs that were drawn."""
    star, apart = np.array([1, 2, 3, 4]), np.array([1, 203, 405, 607])  # of 100 objects: 0-1, 0-2, ...; 0-1, 2-3, ...
    some = Frame(100, np.arange(50), np.arange(40), np.arange(40), 4.0, 0.1, 1e-3, 1e4)
    assert some.sampling(4, star).effect == 4.0
    assert some.sampling(4, apart).effect == 1.0
    assert some.sampling(4, star).fraction == 4 / 160
    everyone = replace(some, looked_at=np.arange(100), scale=1.0)
    assert (everyone.sampling(4, star).effect, everyone.sampling(4, star).fraction) == (1.0, 0.1)


def test_no_pair_among_some_objects_is_not_none_among_all() -> None:
    nobody = np.empty(0, np.int64)
    some = Frame(1000, np.arange(100), nobody, nobody, 999_000 / 9_900, 0.0, 1e-3, 1e4)
    assert (some.pairs_whole.value, some.pairs_whole.low) == (0.0, 0.0)
    # Three objects that meet all others would be overlooked as often as not: that is 3000 pairs.
    assert 3000.0 < some.pairs_whole.high < 499_500.0
    everyone = replace(some, looked_at=np.arange(1000), scale=1.0)
    assert everyone.pairs_whole == Count(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (Share.certain(0, 5), "none"),
        (Share.certain(5, 5), "all"),
        (Share.certain(1, 8), "12 %"),
        (Share.certain(0, 0), "-"),
        (LITTLE.share(0, 100), "at most 3.6 %"),
        (LITTLE.share(100, 100), "at least 96 %"),
        (LITTLE.share(1, 100), "0.025-5.4 %"),
        (LITTLE.share(999, 1000), "99-99.99 %"),
    ],
)
def test_shares_in_words(share: Share, text: str) -> None:
    """Never rounded to none or all where that is not certain."""
    assert percent(share) == text


def test_counts_among_some_objects_scatter_as_their_error_says() -> None:
    """Pairs of objects nearer than 0.1 on a line; a third of the objects is looked at."""
    rng = np.random.default_rng(6)
    at = rng.random(300) ** 2
    near = np.triu(np.abs(at[:, None] - at) < 0.1, 1)
    totals, errors = [], []
    for _ in range(300):
        some = rng.permutation(300)[:100]
        degree = (near | near.T)[np.ix_(some, some)].sum(axis=1).astype(np.float64)
        totals.append(degree.sum() / 2 * 300 * 299 / (100 * 99))
        errors.append(totals[-1] * object_error(degree, 300))
    assert np.mean(totals) == pytest.approx(near.sum(), rel=0.02)
    assert 0.8 < np.std(totals) / np.mean(errors) < 1.25


def test_all_objects_or_none_that_meet_leave_no_error() -> None:
    assert object_error(np.ones(5), 5) == 0.0
    assert object_error(np.zeros(5), 50) == 0.0
    assert object_error(np.empty(0), 0) == 0.0


@pytest.mark.parametrize(
    ("once", "copied", "copies", "pairs", "wanted", "seconds"),
    [
        (1.0, 1.0, 1, 100, 100, 1.0),  # all of it was measured
        (1.0, 1.0, 1, 100, 1000, 10.0),  # no copies: in proportion
        (1.0, 1.7, 8, 100, 1100, 2.0),  # 0.9 s are paid once
        (1.0, 9.0, 8, 100, 1100, 11.0),  # dearer than in proportion: chance
        (1.0, 0.5, 8, 100, 1100, 2.0),  # cheaper than nothing: chance too
        (0.0, 0.0, 1, 0, 1000, 0.0),
    ],
)
def test_extrapolation(once: float, copied: float, copies: int, pairs: int, wanted: float, seconds: float) -> None:
    assert extrapolated_s(once, copied, copies, pairs, wanted) == pytest.approx(seconds)


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
    wrong = Errors(reported, false_pairs, 10, 0, 0, 0.0, 60.0, 600.0, 0.0, 0.0)
    none = Count(0.0, 0.0, 0.0)
    setting = Setting(method, EarthModel.WGS84, tolerance_m)
    cost = replace(NO_COST, stage4_s=seconds)
    shares = [Sampling(fraction, 1.0).share(*of) for of in ((false_pairs, reported), (0, reported), (0, 10))]
    return Estimate(setting, 10, none, none, none, none, cost, wrong, *shares)


def said(exact_s: float, screen_s: float, own: Method = Method.EXACT) -> str:
    return recommendation(
        [
            estimate(Method.EXACT, 1.0, exact_s, 100, 0),
            estimate(Method.SCREEN, 1.0, screen_s, 200, 112),
        ],
        own,
        EarthModel.WGS84,
        1.0,
    )


def test_a_cheap_exact_is_recommended() -> None:
    text = said(1.2, 0.9)
    assert text == (
        "exact costs 1.2 s for this scene; screen would save only 300 ms and report pairs of which 56 % never meet: "
        "stay with exact."
    )
    assert said(1.2, 0.9, Method.SCREEN).endswith(": use exact.")


def test_what_saves_much_is_named() -> None:
    text = said(20.0, 5.0)
    assert "screen would save 15 s and report pairs of which 56 % never meet" in text
    assert text.endswith("stay with exact.")


def test_a_tenth_of_the_cost_is_worth_saving() -> None:
    """Of 20 s these are 2; and half a second of what takes less than 5."""
    assert "screen would save 2.1 s and" in said(20.0, 17.9)
    assert "screen would save only 1.9 s and" in said(20.0, 18.1)
    assert "screen would save 600 ms and" in said(2.0, 1.4)
    assert "screen would save only 400 ms and" in said(2.0, 1.6)


def test_who_would_have_to_wait_looks_first() -> None:
    assert said(7000.0, 300.0).endswith(
        "look with screen whether there is trouble, and use exact for what goes into an order."
    )


def test_what_is_dearer_is_not_said_to_save() -> None:
    assert "screen would cost 2.0 s more and report pairs" in said(1.0, 3.0)


def test_a_tolerance_that_reports_what_does_not_meet_is_remarked() -> None:
    """The largest of the smaller tolerances that does best is named."""
    text = recommendation(
        [
            estimate(Method.EXACT, 1000.0, 9.0, 100, 8),
            estimate(Method.EXACT, 10.0, 2.0, 92, 0),
            estimate(Method.EXACT, 0.0, 2.0, 92, 0),
            estimate(Method.SCREEN, 1000.0, 8.9, 110, 18),
        ],
        Method.EXACT,
        EarthModel.WGS84,
        1000.0,
    )
    assert text.endswith(
        " Of the pairs that exact reports at 1000 m 8 % come close and do not meet; at 10 m none would, for 7.0 s less."
    )


def test_a_tolerance_that_is_as_good_is_not_remarked() -> None:
    text = recommendation(
        [estimate(method, m, 1.0, 100, 8) for method in Method for m in (1.0, 10.0)],
        Method.EXACT,
        EarthModel.WGS84,
        10.0,
    )
    assert "Of the pairs" not in text


def test_nothing_on_a_sample_is_not_told_as_nothing() -> None:
    """Neither of what a method would report, nor of what a tolerance would."""
    text = recommendation(
        [
            estimate(Method.EXACT, 1.0, 9.0, 100, 8, 0.0),
            estimate(Method.EXACT, 0.5, 9.0, 100, 0, 0.0),
            estimate(Method.SCREEN, 1.0, 8.9, 110, 18, 0.0),
        ],
        Method.EXACT,
        EarthModel.WGS84,
        1.0,
    )
    assert "and report pairs of which 10-25 % never meet: stay" in text
    assert text.endswith(
        " Of the pairs that exact reports at 1 m 3.5-15 % come close and do not meet; at 0.5 m at most 3.6 % would, "
        "at about the same cost."
    )
    certain, sampled = (
        recommendation(
            [
                estimate(Method.EXACT, 1.0, 9.0, 100, 0, fraction),
                estimate(Method.SCREEN, 1.0, 1.0, 100, 0, fraction),
            ],
            Method.EXACT,
            EarthModel.WGS84,
            1.0,
        )
        for fraction in (1.0, 0.0)
    )
    assert "screen would save 8.0 s and report no pair that never meets, but periods up to 10 min too long" in certain
    assert "report no pair that never meets (at most 3.6 % of all), but periods" in sampled
