"""An exception on one object or pair costs that one its answer; all others keep theirs."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from verdicts import periods_us

import conflictdb
from conflictdb import kernel
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core import closest_approaches, run, whole_areas
from conflictdb.core.pieces import covers
from conflictdb.core.stage4 import contact_search
from conflictdb.earth.registry import Setup
from conflictdb.errors import KernelMissing
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Motion, Scene, Track, rectangle_outline_m
from conflictdb.model.results import Verdict

T0_US = 1_700_000_000_000_000
HOUR_US = 3_600_000_000


@given(st.integers(0, 40), st.sets(st.integers(0, 39)))
def test_each_row_has_an_answer_and_the_failing_ones_the_safe_one(count: int, failing: set[int]) -> None:
    def work(rows: Any) -> list[int]:
        if failing & set(rows.tolist()):
            raise ZeroDivisionError
        return [2 * row for row in rows.tolist()]

    found = isolated(np.arange(count), work, lambda rows: [-1] * len(rows), "row")
    answers = {row: answer for rows, some in found for row, answer in zip(rows.tolist(), some, strict=True)}
    assert answers == {row: -1 if row in failing else 2 * row for row in range(count)}


def test_a_warning_that_was_made_an_error_is_one() -> None:
    def work(rows: Any) -> None:
        raise RuntimeWarning("overflow")

    with pytest.raises(RuntimeWarning):
        isolated(np.arange(3), work, lambda rows: None, "row")


def area(key: str, lon: float, **more: Any) -> Area:
    return Area(key, shapely.MultiPolygon([shapely.box(lon, 57.0, lon + 0.5, 57.5)]), **more)


def track(key: str, lon: float, lat: float = 57.2) -> Track:
    positions = np.array([(lon, lat), (lon + 1.0, lat)])
    outline = rectangle_outline_m(100.0, 100.0, 100.0, 100.0)
    return Track(key, positions, np.array([T0_US, T0_US + HOUR_US]), outline)


AREAS = [area("A0", 4.5), area("A1", 4.9), area("A2", 40.0), area("A3", 41.0, start_us=T0_US + 2 * HOUR_US)]
TRACKS = [track("T0", 4.0), track("T1", 4.4), track("T2", 40.0, 30.0)]
SCENES = [
    Scene("s"),
    Scene("s", separation_m=100.0, nearest_m=1e6),
    Scene("s", motion=Motion.GREAT_CIRCLE),
    Scene("s", method=Method.NLP),
    Scene("s", method=Method.SCREEN),
]


def answer(scene: Scene) -> dict[tuple[str, str], conflictdb.Conflict]:
    return {(one.a_key, one.b_key): one for one in conflictdb.solve(TRACKS, AREAS, scene)}


def failing_for(function: Callable[..., Any], is_hit: Callable[..., bool]) -> Callable[..., Any]:
    def failing(*arguments: Any, **more: Any) -> Any:
        if is_hit(*arguments):
            raise FloatingPointError("planted")
        return function(*arguments, **more)

    return failing


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: f"{scene.motion.value} {scene.method.value}")
@pytest.mark.parametrize(("which", "number", "key"), [("area_pieces", 1, "A1"), ("track_pieces", 0, "T0")])
def test_an_object_that_cannot_be_cut_is_unresolved_with_all_it_could_meet(
    scene: Scene, which: str, number: int, key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With every object that shares its time; every other pair stays the same."""
    expected = answer(scene)
    ids = "area_id" if which == "area_pieces" else "track_id"
    planted = failing_for(getattr(covers, which), lambda setup, batch: number in getattr(batch, ids))
    monkeypatch.setattr(covers, which, planted)
    found = answer(scene)
    with_it = {pair for pair in found if key in pair}
    assert {pair: one for pair, one in found.items() if key not in pair} == {
        pair: one for pair, one in expected.items() if key not in pair
    }
    assert {found[pair].verdict for pair in with_it} == {Verdict.UNRESOLVED}
    assert {other for pair in with_it for other in pair} == (
        {"A0", "A1", "A2", "A3", "T0", "T1", "T2"} if key == "A1" else {"A0", "A1", "A2", "T0", "T1", "T2"}
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_an_object_whose_pieces_are_no_numbers_is_unresolved(bad: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """NaN would meet nothing, silently."""
    cut = covers.track_pieces

    def spoilt(setup: Setup, batch: Any) -> Any:
        pieces = cut(setup, batch)
        pieces.hull_xy[np.repeat(pieces.object_id, np.diff(pieces.hull_offset)) == 1, 0] = bad
        return pieces

    monkeypatch.setattr(covers, "track_pieces", spoilt)
    found = answer(Scene("s"))
    assert {found[pair].verdict for pair in found if "T1" in pair} == {Verdict.UNRESOLVED}
    assert len([pair for pair in found if "T1" in pair]) == 5  # not A3, which is active later


@pytest.mark.parametrize("motion", Motion)
@pytest.mark.parametrize("corner", [(8.2, np.nan), (np.nan, 47.0), (-172.0, -47.0)])
def test_a_stored_corner_without_a_place_is_no_smaller_area(motion: Motion, corner: tuple[float, float]) -> None:
    """Such a corner is damage: the hull of the others would miss conflicts."""
    scene = Scene("s", motion=motion, centre=(8.0, 47.0) if motion is Motion.GREAT_CIRCLE else None)
    ring = [(8.0, 47.0), (8.01, 47.0), (8.01, 47.01)]
    areas = AreaBatch.of([Area("a", ring), Area("b", ring)])
    with np.errstate(invalid="ignore"):
        areas.footprint[1] = shapely.MultiPolygon([shapely.Polygon([*ring, corner])])
    pieces = covers.pieces_of(Setup.of(scene), areas, TrackBatch.of([]))
    has_place = motion is Motion.RHUMB and np.isfinite(corner).all()
    assert pieces.part[pieces.object_id == 0].tolist() == [0]
    assert (covers.COVER in pieces.part[pieces.object_id == 1]) != has_place


def test_a_pair_that_the_kernel_cannot_decide_is_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """While their pieces are near each other; pieces with NaN or infinity decide nothing."""
    expected = answer(Scene("s"))

    def spoilt(plane: kernel.KernelPlane, pieces: Any, *members: Any) -> kernel.KernelScene:
        return kernel.KernelScene(plane, replace(pieces, shape_xy=np.nan * pieces.shape_xy), *members)

    monkeypatch.setattr(run, "kernel", SimpleNamespace(KernelScene=spoilt))
    found = answer(Scene("s"))
    assert set(expected) <= set(found)
    for pair, one in found.items():
        assert one.verdict == Verdict.UNRESOLVED
        if any(key.startswith("T") for key in pair):
            for start, end in periods_us(one):
                assert start is not None
                assert end is not None
                assert T0_US <= start <= end <= T0_US + HOUR_US


def test_pairs_of_areas_whose_judgement_fails_are_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel returns NaN for NaN."""
    monkeypatch.setattr(contact_search, "distances", lambda scene, a, *_: np.full(len(a), np.nan))
    assert answer(Scene("s"))["A0", "A1"].verdict == Verdict.UNRESOLVED


def test_an_approach_that_cannot_be_found_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A conflict stays one without it; a pair that may come near, and has no other row, is unresolved.

    Objects that touch are closest at their first touch, which the search for contacts finds.
    """
    scene = SCENES[1]
    expected = answer(scene)
    approaches = closest_approaches.approaches

    def lost(prepared: kernel.KernelScene, *given: Any) -> Any:
        none = replace(prepared.pieces, shape_xy=np.nan * prepared.pieces.shape_xy)
        return approaches(kernel.KernelScene(Setup.of(scene).plane.kernel_plane, none), *given)

    monkeypatch.setattr(closest_approaches, "approaches", lost)
    found = answer(scene)
    assert set(found) >= set(expected)
    for pair, one in expected.items():
        assert found[pair].verdict == (Verdict.UNRESOLVED if one.verdict == Verdict.NEAR else one.verdict)
        assert found[pair].closest_m is None or one.closest_m == 0.0
        assert found[pair].periods
    assert None in {found[pair].closest_m for pair in expected}


def test_a_depth_that_cannot_be_found_is_unresolved(monkeypatch: pytest.MonkeyPatch) -> None:
    # Side by side: grazing. One has a dent, and so several parts.
    corners = [(4.5, 57.0), (4.5, 57.5), (4.0, 57.5), (4.3, 57.25), (4.0, 57.0)]
    areas = [Area("A", shapely.MultiPolygon([shapely.Polygon(corners)])), area("B", 4.5)]
    assert [one.verdict for one in conflictdb.solve([], areas, Scene("s"))] == [Verdict.GRAZING]
    monkeypatch.setattr(whole_areas, "whole_depths", failing_for(whole_areas.whole_depths, lambda *_: True))
    assert [one.verdict for one in conflictdb.solve([], areas, Scene("s"))] == [Verdict.UNRESOLVED]


def test_a_kernel_that_is_missing_is_no_objects_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is raised at once, not once for every object."""

    def missing(*_: Any) -> Any:
        raise KernelMissing("planted")

    monkeypatch.setattr(covers, "track_pieces", missing)
    with pytest.raises(KernelMissing, match="planted"):
        answer(Scene("s"))
