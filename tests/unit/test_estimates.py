"""The statistics behind `advise`: what is wrong, what a sample says of the whole, and how it is put in words."""

import math
from dataclasses import replace

import numpy as np
import pytest

from conflictdb.estimates import (
    Answer,
    Cost,
    Count,
    Estimate,
    Setting,
    Wrongness,
    duration,
    extrapolated_s,
    object_error,
    recommendation,
    share_error,
    whole,
    wrongness,
)
from conflictdb.model import FOR_EVER_US, SINCE_EVER_US, EarthModel, Method

HOUR_US = 3_600_000_000
NO_COST = Cost(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def answer(*rows: tuple[int, int, int, bool]) -> Answer:
    """Return an answer of (pair, first, last, is_unresolved)."""
    columns = np.array([row[:3] for row in rows], np.int64).reshape(-1, 3)
    return Answer(*columns.T, np.array([row[3] for row in rows], np.bool_), np.full(len(rows), 0.25))


def test_an_answer_is_not_wrong_against_itself() -> None:
    same = answer((3, 0, HOUR_US, False), (7, SINCE_EVER_US, FOR_EVER_US, False))
    wrong = wrongness(same, same)
    assert wrong == Wrongness(2, 0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.25)
    assert wrong.false_share == 0.0


def test_false_missed_and_unresolved_pairs_are_told_apart() -> None:
    """What the truth leaves open is neither false nor missed."""
    truth = answer((1, 0, 10, False), (2, 0, 10, False), (3, 0, 10, True), (4, 0, 10, True))
    found = answer((9, 0, 10, True), (2, 0, 10, False), (3, 0, 99, False))
    wrong = wrongness(found, truth)
    assert (wrong.reported, wrong.false_pairs, wrong.missed_pairs, wrong.unresolved) == (3, 1, 1, 1)
    assert wrong.false_share == pytest.approx(1 / 3)
    assert wrong.slack_worst_s == 0.0


def test_slack_is_taken_over_both_ends_and_shortness_apart() -> None:
    truth = answer((1, 10_000_000, 20_000_000, False), (2, 10_000_000, 20_000_000, False))
    found = answer((2, 9_000_000, 24_000_000, False), (1, 12_000_000, 20_000_000, False))
    wrong = wrongness(found, truth)
    assert (wrong.slack_median_s, wrong.slack_worst_s, wrong.short_worst_s) == (0.5, 4.0, 2.0)
    assert wrong.slack_p95_s == pytest.approx(np.quantile([0.0, 0.0, 1.0, 4.0], 0.95))


def test_without_a_pair_that_meets_there_is_no_slack() -> None:
    wrong = wrongness(answer((1, 0, 1, False)), answer())
    assert math.isnan(wrong.slack_median_s)
    assert math.isnan(wrong.slack_worst_s)
    assert wrong.false_share == 1.0
    assert wrongness(answer(), answer()).false_share == 0.0


def test_a_whole_that_was_counted_has_no_error() -> None:
    assert whole(np.array([1.0, 0.0, 5.0]), 3, 1.0, 0.0) == Count(6.0, 0.0)
    assert whole(np.empty(0), 3, 1.0, 0.0) == Count(0.0, 0.0)


def test_estimated_totals_scatter_about_the_truth_as_their_error_says() -> None:
    rng = np.random.default_rng(5)
    population = rng.poisson(2.0, 400).astype(np.float64)
    estimates = [whole(rng.permutation(population)[:50], 400, 1.0, 0.0) for _ in range(400)]
    off = np.array([(one.value - population.sum()) / one.standard_error for one in estimates])
    assert abs(off.mean()) < 0.2
    assert 0.85 < off.std() < 1.15


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


def test_share_error() -> None:
    assert share_error(0.5, 100, 100, 10**9) == pytest.approx(0.05, rel=1e-6)
    assert share_error(0.5, 100, 200, 200) == 0.0
    assert share_error(0.0, 0, 10, 20) == 0.0


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


def estimate(method: Method, tolerance_m: float, seconds: float, reported: int, false_pairs: int) -> Estimate:
    wrong = Wrongness(reported, false_pairs, 0, 0, 0.0, 60.0, 600.0, 0.0, 0.0)
    none = Count(0.0, 0.0)
    setting = Setting(method, EarthModel.WGS84, tolerance_m)
    return Estimate(setting, 10, none, none, none, none, replace(NO_COST, stage4_s=seconds), wrong, 0.0)


def said(exact_s: float, window_s: float, screen_s: float, own: Method = Method.EXACT) -> str:
    return recommendation(
        [
            estimate(Method.EXACT, 1.0, exact_s, 100, 0),
            estimate(Method.WINDOW, 1.0, window_s, 100, 12),
            estimate(Method.SCREEN, 1.0, screen_s, 200, 112),
        ],
        own,
        EarthModel.WGS84,
        1.0,
    )


def test_a_cheap_exact_is_recommended() -> None:
    text = said(1.2, 1.0, 0.9)
    assert text == (
        "exact costs 1.2 s for this scene; screen would save only 300 ms and report pairs of which 56 % never meet: "
        "stay with exact."
    )
    assert said(1.2, 1.0, 0.9, Method.SCREEN).endswith(": use exact.")


def test_what_saves_much_is_named() -> None:
    text = said(20.0, 10.0, 5.0)
    assert "window would save 10 s and report pairs of which 12 % never meet" in text
    assert "screen would save 15 s and report pairs of which 56 % never meet" in text
    assert text.endswith("stay with exact.")


def test_who_would_have_to_wait_looks_first() -> None:
    assert said(7000.0, 600.0, 300.0).endswith(
        "look with screen whether there is trouble, and use exact for what goes into an order."
    )


def test_what_is_dearer_is_not_said_to_save() -> None:
    assert "window would cost 1.0 s more and report pairs" in said(1.0, 2.0, 3.0)


def test_a_tolerance_that_reports_what_does_not_meet_is_remarked() -> None:
    """The largest of the smaller tolerances that does best is named."""
    text = recommendation(
        [
            estimate(Method.EXACT, 1000.0, 9.0, 100, 8),
            estimate(Method.EXACT, 10.0, 2.0, 92, 0),
            estimate(Method.EXACT, 0.0, 2.0, 92, 0),
            estimate(Method.WINDOW, 1000.0, 8.9, 110, 18),
            estimate(Method.SCREEN, 1000.0, 8.9, 110, 18),
        ],
        Method.EXACT,
        EarthModel.WGS84,
        1000.0,
    )
    assert text.endswith(
        " Of the pairs that exact reports at 1000 m 8 % come close and do not meet; at 10 m none would, for 7.0 s less."
    )
