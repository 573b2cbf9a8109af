"""Stage 4: the two programs on passages with known times, and their certificates when they fail."""

from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
import scenes
import shapely
from threadpoolctl import threadpool_info, threadpool_limits
from verdicts import solved

from conflictdb import kernel
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.cutting import area_pieces, track_pieces
from conflictdb.core.published import linear_program, nonlinear_program
from conflictdb.core.published.encounters import Encounters
from conflictdb.earth.registry import Setup
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, EarthModel, Scene, Track
from conflictdb.model.results import Verdict

DEGREE = scenes.parallel_m(EarthModel.SPHERE, 0.0)
SCENE = Scene("s", earth=EarthModel.SPHERE)
PROGRAMS = pytest.mark.parametrize("program", [linear_program, nonlinear_program], ids=["lp", "nlp"])


def leg(area: Area, track: Track, separation_m: float = 0.0) -> Encounters:
    """An area and the first leg of a track, seconds from its start."""
    setup = Setup.of(SCENE)
    still, moving = area_pieces(setup, AreaBatch.of([area])), track_pieces(setup, TrackBatch.of([track]))
    pieces = Pieces.concatenate([still, moving])
    row, none = np.zeros(1, np.int64), np.zeros(2, np.int64)
    pairs = Pairs(row, row + len(still), np.empty((0, 2)), none)
    return Encounters.of(
        setup.plane, separation_m, kernel.KernelScene(setup.plane.kernel_plane, pieces), pairs, row, track.times_us[:1]
    )


@PROGRAMS
def test_first_and_last_contact_on_the_equator(program: object) -> None:
    box = scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 4000, 2000, 500, 500)
    pair = leg(box, track)
    first = program.extreme_contact(pair, 0.0, 3600.0, latest=False)
    last = program.extreme_contact(pair, 0.0, 3600.0, latest=True)
    assert first == pytest.approx((0.5 - 4000 / DEGREE) * 3600, abs=1e-2)
    assert last == pytest.approx((0.6 + 2000 / DEGREE) * 3600, abs=1e-2)


@PROGRAMS
def test_contact_that_lasts_the_whole_window(program: object) -> None:
    box = scenes.area("A", shapely.box(-1, -1, 2, 1))
    pair = leg(box, scenes.track("T", [(0, 0), (1, 0)], [0, 3600]))
    assert program.extreme_contact(pair, 0.0, 3600.0, latest=False) == pytest.approx(0.0, abs=1e-2)
    assert program.extreme_contact(pair, 0.0, 3600.0, latest=True) == pytest.approx(3600.0, abs=1e-2)


@PROGRAMS
def test_no_contact_is_no_answer(program: object) -> None:
    box = scenes.area("A", shapely.box(0.5, 0.1, 0.6, 0.2))
    pair = leg(box, scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 500, 500, 500, 500))
    assert program.extreme_contact(pair, 0.0, 3600.0, latest=False) is None


def test_separation_wanted_in_the_nonlinear_program() -> None:
    """Head-on towards an edge: 3 km before it, less the haven's nose."""
    box = scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))
    pair = leg(box, scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 4000, 2000, 500, 500), separation_m=3000.0)
    first = nonlinear_program.extreme_contact(pair, 0.0, 3600.0, latest=False)
    assert first == pytest.approx((0.5 - 7000 / DEGREE) * 3600, abs=0.1)


def test_uniform_motion_is_told_from_other() -> None:
    """East-west moves evenly in the plane, on any parallel; north does not, unless it is slow or near the equator."""
    box = scenes.area("A", shapely.box(0.5, 60, 0.6, 61))
    hour = np.array([3600.0])
    nothing = np.zeros(1)
    east = leg(box, scenes.track("T", [(0, 60), (1, 60)], [0, 3600]))
    north = leg(box, scenes.track("T", [(0, 60), (0, 61)], [0, 3600]))
    creeping = leg(box, scenes.track("T", [(0, 60), (0, 60.0001)], [0, 3600], 10, 10, 10, 10))
    assert linear_program.is_uniform(east, nothing, hour).tolist() == [True]
    assert linear_program.is_uniform(north, nothing, hour).tolist() == [False]
    assert linear_program.is_uniform(creeping, nothing, hour).tolist() == [True]


@pytest.mark.parametrize("answer", [None, 0.0, 1e9, -1e9, 1800.0], ids=str)
def test_a_solver_that_fails_or_errs_changes_no_answer(monkeypatch: pytest.MonkeyPatch, answer: float | None) -> None:
    """Its answer is a guess: whatever it says, contacts are found, bracketed and certified on the true motion."""
    known = [
        scenes.meridian_entry(EarthModel.WGS84),
        scenes.twice_in_a_leg(EarthModel.SPHERE),
        scenes.seam(EarthModel.SPHERE),
    ]
    before = [solved(k.scene, k.areas, k.tracks) for k in known]
    asked = []

    def misled(program: ModuleType) -> None:
        def wrong(_pair: Encounters, start_s: float, end_s: float, *, latest: bool) -> float | None:
            asked.append(program)
            return None if answer is None else min(max(answer, start_s), end_s)

        monkeypatch.setattr(program, "extreme_contact", wrong)

    misled(nonlinear_program)
    misled(linear_program)
    for k, expected in zip(known, before, strict=True):
        found = solved(replace(k.scene, method=Method.NLP), k.areas, k.tracks)
        assert found.keys() == expected.keys()
        for pair, one in found.items():
            other = expected[pair]
            assert one.verdict is other.verdict
            # A wide bound would excuse any answer.
            assert max(one.time_error_s, other.time_error_s) < 1e-5
            assert len(one.periods_us) == len(other.periods_us)
            for mine, theirs in zip(one.periods_us, other.periods_us, strict=True):
                for x, y in zip(mine, theirs, strict=True):
                    assert (x is None) == (y is None)
                    assert x is None or y is None or abs(x - y) <= 2 + 1e6 * (one.time_error_s + other.time_error_s)
    assert {linear_program, nonlinear_program} <= set(asked)


def test_programs_do_their_linear_algebra_by_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Last digits depend on the number of threads, and that on the number of processors: it is one on every machine."""
    program, seen = nonlinear_program.extreme_contact, []

    def watched(pair: Encounters, start_s: float, end_s: float, *, latest: bool) -> float | None:
        seen.extend(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")
        return program(pair, start_s, end_s, latest=latest)

    monkeypatch.setattr(nonlinear_program, "extreme_contact", watched)
    known = scenes.meridian_entry(EarthModel.WGS84)
    with threadpool_limits(2, user_api="blas"):
        solved(replace(known.scene, method=Method.NLP), known.areas, known.tracks)
        after = {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}
    assert set(seen) == {1}
    assert after == {2}


def test_verdicts_by_depth() -> None:
    """Half a metre apart or half a metre deep is too close to call; three metres deep is not, nor five apart."""
    metre = 1.0 / DEGREE

    def verdict(gap_m: float) -> Verdict | None:
        box = scenes.area("A", shapely.box(0.4, 500 * metre + gap_m * metre, 0.6, 0.2))
        track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 500, 500, 500, 500)
        found = solved(SCENE, [box], [track])
        return found["A", "T"].verdict if found else None

    assert verdict(5.0) is None
    assert verdict(1.5) is None
    assert verdict(0.5) is Verdict.GRAZING
    assert verdict(0.0) is Verdict.GRAZING
    assert verdict(-0.5) is Verdict.GRAZING
    assert verdict(-3.0) is Verdict.CONFLICT
