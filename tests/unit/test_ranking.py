"""Which conflicts come first: both move before one, certain before possible, soonest, then the most missing."""

from datetime import UTC, datetime, timedelta

import pytest

from conflictdb.core.depths import DeepestContact
from conflictdb.core.ranking import missing_text, worst_first
from conflictdb.model.methods import Method
from conflictdb.model.results import Certainty, Conflict, Kind, Verdict
from conflictdb.model.units import Units

START = datetime(2026, 6, 1, 9, tzinfo=UTC)


def conflict(
    pair: str,
    kinds: str = "at",
    hours: float | None = 0.0,
    verdict: Verdict = Verdict.CONFLICT,
    certainty: Certainty | None = None,
    scene: str = "s",
) -> Conflict:
    start = None if hours is None else START + timedelta(hours=hours)
    a_kind, b_kind = (Kind.AREA if kind == "a" else Kind.TRACK for kind in kinds)
    return Conflict(
        scene=scene, a_key=pair[0], a_kind=a_kind, b_key=pair[1], b_kind=b_kind, periods=((start, None),),
        verdict=verdict, method=Method.EXACT, time_error_s=0.0, certainty=certainty,
    )  # fmt: skip


def test_the_rank_is_by_what_conflicts_mean() -> None:
    expected = [
        conflict("ab", "tt", 5.0),
        conflict("ac", "tt", 6.0, certainty=Certainty.MUST),
        conflict("ad", "tt", 0.0, certainty=Certainty.MAY),
        conflict("ae", "tt", 1.0, Verdict.GRAZING),
        conflict("af", "tt", 2.0, Verdict.UNRESOLVED),
        conflict("xa", "at", None),
        conflict("xb", "at", 1.0),  # 500 m missing
        conflict("xc", "at", 1.0),  # 20 m
        conflict("xd", "at", 1.0),  # not known
        conflict("xe", "at", 1.0),
        conflict("yz", "aa", None),
    ]
    known = {("x", "b"): DeepestContact(500.0, None), ("x", "c"): DeepestContact(20.0, None)}
    assert worst_first(expected[::-1], known) == expected
    assert worst_first([*expected[::2], *expected[1::2]], known) == expected


def test_scenes_of_one_list_stay_apart() -> None:
    mixed = [conflict("aa", "aa", scene="later"), conflict("bb", "tt", scene="first"), conflict("cc", scene="later")]
    assert [one.a_key for one in worst_first(mixed, {})] == ["c", "a", "b"]


@pytest.mark.parametrize(
    ("moving", "depth_m", "separation_m", "words"),
    [
        (1, 4.7 * 1852.0, 0.0, "inside by 4.7 nmi"),
        (1, 4.7 * 1852.0 + 500.0, 500.0, "inside by 4.7 nmi"),
        (1, 300.0, 500.0, "too close by 0.2 nmi"),
        (1, 500.0, 500.0, "too close by 0.3 nmi"),
        (2, 0.4 * 1852.0, 0.0, "too close by 0.4 nmi"),
        (2, 0.4 * 1852.0, 100.0, "too close by 0.4 nmi"),
        (0, 42.4, 0.0, "overlapping by 43 m"),
        (0, 42.4, 50.0, "too close by 43 m"),
        (2, 0.01, 50.0, "just touching"),
        (1, -0.0, 0.0, "just touching"),
    ],
)
def test_what_is_missing_in_words(moving: int, depth_m: float, separation_m: float, words: str) -> None:
    assert missing_text(moving, DeepestContact(depth_m, None, separation_m)) == words


def test_unknown_depths_have_no_words() -> None:
    assert missing_text(2, None) == ""
    assert [Units.NAUTICAL.most_distance(metres) for metres in (1.25, 9.9, 10.4, 185.0, 185.1, 185.2)] == [
        "1.3 m", "9.9 m", "11 m", "185 m", "186 m", "0.1 nmi",
    ]  # fmt: skip
