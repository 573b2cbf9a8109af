"""Every method: no misses, correct bounds, and exactly the outputs that its row of `METHODS` names."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest
import scenes
from scenes import Known
from sources import InMemory
from verdicts import periods_us

from conflictdb import solve
from conflictdb.arrays.pairs import Pairs
from conflictdb.cli import main
from conflictdb.core import run
from conflictdb.core.stage2_intersection import intersections
from conflictdb.earth.registry import Setup
from conflictdb.model.methods import METHODS, Method
from conflictdb.model.plans import EarthModel
from conflictdb.model.results import Kind, Verdict

# Periods are whole microseconds, rounded outward; instants known by hand are rounded too.
ROUNDING_S: Final = 3e-6
KNOWN: Final = [
    scenes.equator_crossing(EarthModel.WGS84),
    scenes.overtaking(EarthModel.SPHERE),
    scenes.loiter(EarthModel.WGS84),
    scenes.hole(EarthModel.SPHERE),
    scenes.heights(EarthModel.WGS84),
    scenes.growing(EarthModel.WGS84),
    scenes.circles_over_the_pole(),
]

every_method = pytest.mark.parametrize("method", Method)
every_scene = pytest.mark.parametrize("known", KNOWN, ids=lambda known: known.name)


def asked(known: Known, method: Method) -> Known:
    return replace(known, scene=replace(known.scene, method=method))


@every_method
@every_scene
def test_nothing_is_missed_and_bounds_hold(method: Method, known: Known) -> None:
    """Every true contact lies in a period; if a method is certified, its ends are right up to its own bound."""
    known = asked(known, method)
    reported = {(one.a_key, one.b_key): one for one in solve(known.tracks, known.areas, known.scene)}
    assert set(known.expected) <= set(reported)
    is_certain = METHODS[method].solver is not None
    if is_certain:
        assert set(reported) <= set(known.expected) | known.undecided
    for pair, intervals in known.expected.items():
        periods = [
            tuple(np.nan if end is None else (end - scenes.T0_US) / 1e6 for end in period)
            for period in periods_us(reported[pair])
        ]
        if is_certain:
            assert len(periods) == len(intervals)
        else:
            assert len(periods) >= 1
        for start, end in intervals:
            # None is unbounded, both in the truth and in the report.
            holds = [
                (start is None or not s > start + ROUNDING_S) and (end is None or not e < end - ROUNDING_S)
                for s, e in periods
            ]
            assert any(holds), (pair, start, end, periods)
            s, e = periods[holds.index(True)]
            if is_certain and start is not None and end is not None:
                allowed = reported[pair].time_error_s + ROUNDING_S
                assert abs(s - start) <= allowed
                assert abs(e - end) <= allowed


@every_method
@every_scene
def test_what_it_gives_is_what_its_row_says(method: Method, known: Known) -> None:
    """Verdicts, places and closest approaches where it has a solver; otherwise none of these."""
    spec = METHODS[method]
    for one in solve(known.tracks, known.areas, asked(known, method).scene):
        assert one.method is method
        moves = Kind.TRACK in (one.a_kind, one.b_kind)
        if spec.solver is None:
            assert one.first_contact_deg is None
            assert one.closest_m is None
            assert one.verdict is Verdict.UNRESOLVED or not moves
        else:
            assert one.verdict in (Verdict.CONFLICT, Verdict.GRAZING)
            assert one.first_contact_deg is not None
            assert one.closest_m == 0.0 or one.verdict is Verdict.GRAZING


@every_method
def test_it_stops_where_its_row_says(method: Method, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stage 2 intersects hulls, stage 3 is run, and stage 4, where the method needs it, and nowhere else."""
    spec, known = METHODS[method], asked(KNOWN[0], method)
    asked_for: list[bool] = []

    def watched(*chunk: Any, regions: bool) -> Pairs:
        asked_for.append(regions)
        return intersections(*chunk, regions=regions)

    monkeypatch.setattr(run, "intersections", watched)
    source = InMemory.of(known.scene, known.areas, known.tracks)
    ((_, funnel),) = run.run_scene(Setup(known.scene, source.plane), source)
    assert asked_for == [spec.needs_regions]
    projected = funnel.window_pairs if spec.needs_regions else funnel.effort.exact.closed_forms
    assert funnel.projected_pairs >= projected
    assert spec.needs_regions or funnel.projected_pairs == projected
    assert (funnel.solved_pairs > 0) == (spec.solver is not None)


@every_method
def test_near_pairs_are_reported_by_methods_that_measure(method: Method) -> None:
    """A pair that passes by is near, or nothing, as its row has a solver or not."""
    track = scenes.track("T", [(0, 0), (2, 0)], [0, 7200], 100, 100, 100, 100)
    beside = scenes.track("U", [(0, 0.5), (2, 0.5)], [0, 7200], 100, 100, 100, 100)
    found = solve([track, beside], [], replace(KNOWN[0].scene, method=method, nearest_m=60_000.0))
    if METHODS[method].solver is None:
        assert found == []
        return
    (near,) = found
    assert near.verdict is Verdict.NEAR
    assert near.closest_m is not None
    assert near.closest_m + 200.0 == pytest.approx(scenes.meridian_m(EarthModel.WGS84, 0.5), abs=1.0)
    assert near.closest_at is not None


def test_the_command_line_offers_these_methods_and_refuses_others(capsys: pytest.CaptureFixture[str]) -> None:
    """As the scene does and SQL (`test_methods` of the unit tests, `test_refusals` of SQL)."""
    with pytest.raises(SystemExit) as ended:
        main(["detect", "--scene", "s", "--method", "guess"])
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert all(str(method) in said for method in Method)
