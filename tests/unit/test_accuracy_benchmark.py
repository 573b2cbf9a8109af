"""benchmarks/accuracy.py: it measures the product's own answer, and an error that is put in comes out."""

from dataclasses import replace

import accuracy
import oracle
import pytest
from accuracy import Row, Scenes, by_name, row_of, table
from layouts import LOW_LATITUDE
from verdicts import Reported, periods_us

from conflictdb import Scene, Verdict, solve
from conflictdb.core.run import run_stages
from conflictdb.earth.registry import Setup
from conflictdb.model.methods import Method
from conflictdb.model.plans import EarthModel
from conflictdb.model.results import Kind

EPOCH_US = 1_000_000
MEETS = oracle.Meeting(EPOCH_US, ((10.0, 20.0), (30.0, 40.0)), 0.0, 10.0)
NEAR = oracle.Meeting(EPOCH_US, (), 5.0, 10.0)
FAR = oracle.Meeting(EPOCH_US, (), float("inf"), float("nan"))


def reported(verdict: Verdict, *periods_s: tuple[float, float], error_s: float = 0.0) -> Reported:
    """Return an answer with periods in seconds after the epoch."""
    spans = tuple((EPOCH_US + round(1e6 * start), EPOCH_US + round(1e6 * end)) for start, end in periods_s)
    return Reported(verdict, spans, error_s)


def row(truth: dict[accuracy.Pair, oracle.Meeting], answer: accuracy.Answer, tolerance_m: float = 1.0) -> Row:
    """Return the row of one answer."""
    scene = Scene("s", tolerance_m=tolerance_m)
    return row_of(LOW_LATITUDE, scene, Method.NLP, truth, answer, [14e-6, 7e-6, 21e-6], 7)


def test_row_of_a_right_answer_has_no_errors() -> None:
    """Cost is the median of the turns."""
    pair, other = ("A0", "T0"), ("A1", "T0")
    found = row({pair: MEETS, other: FAR}, {pair: reported(Verdict.CONFLICT, (10, 20), (30, 40))})
    assert (found.missed, found.apart, found.false, found.unresolved, found.wrong) == (0, 0, 0, 0, 0)
    assert (found.pairs, found.meet, found.pieces) == (2, 1, 7)
    assert found.pair_us == pytest.approx(2.0)
    assert found.end_s == (0.0, 0.0)


def test_row_tells_unsafe_ends_from_slack() -> None:
    """A start 2 s late is unsafe, an end 3 s late is slack."""
    found = row({("A0", "T0"): MEETS}, {("A0", "T0"): reported(Verdict.CONFLICT, (12, 43))})
    assert found.unsafe_s[1] == pytest.approx(2.0)
    assert found.slack_s[1] == pytest.approx(3.0)
    assert found.end_s[1] == pytest.approx(3.0)
    assert found.wrong > 0


def test_row_counts_what_is_missed_false_and_only_near() -> None:
    """Five metres apart: a false conflict, false grazing at 1 m, right at 10 m, and open if unresolved."""
    pair = ("A0", "T0")
    assert row({pair: MEETS}, {}).missed == 1
    assert row({pair: NEAR}, {pair: reported(Verdict.CONFLICT, (1, 2))}, 10.0).false == 1
    assert row({pair: NEAR}, {pair: reported(Verdict.GRAZING, (1, 2))}, 1.0).false == 1
    assert row({pair: NEAR}, {pair: reported(Verdict.GRAZING, (1, 2))}, 10.0).false == 0
    open_ = row({pair: NEAR}, {pair: reported(Verdict.UNRESOLVED, (1, 2))})
    assert (open_.apart, open_.false, open_.unresolved) == (1, 0, 1)


@pytest.mark.parametrize("earth", EarthModel)
def test_batch_of_scenes_gives_the_answers_of_each(earth: EarthModel) -> None:
    """The answers of scenes timed in one batch are those of `solve` on each scene."""
    scenes = Scenes.of(LOW_LATITUDE, earth, scenes=3, objects=5)
    batch = replace(scenes.scene, method=Method.SCREEN, tolerance_m=10.0)
    answer = by_name(run_stages(Setup.of(batch), *scenes.batch(10.0), scenes.footprints)[0])
    expected = {}
    for k, (areas, tracks) in enumerate(scenes.thrown):
        for one in solve(tracks, areas, batch):
            if one.b_kind == Kind.TRACK:
                pair = tuple(f"{key[0]}{5 * k + int(key[1:])}" for key in (one.a_key, one.b_key))
                expected[pair] = periods_us(one)
    assert expected
    assert {pair: one.periods_us for pair, one in answer.items()} == expected


def test_table_has_both_earths_in_a_row() -> None:
    """Counts are added, and the worse of two errors counts."""
    one = row({("A0", "T0"): MEETS}, {("A0", "T0"): reported(Verdict.CONFLICT, (10, 40.004))}, 0.0)
    one = replace(one, method=accuracy.REFERENCE, earth="wgs84", missed=1)
    text = table([one, replace(one, earth="sphere", missed=2, pair_us=4.0, slack_s=(0.0, 7.0))])
    assert f"| `{accuracy.REFERENCE}` | 0 | 2 / 4 | 1 / 1 | 3 |" in text
    assert "| 4 ms / 7 s |" in text
