"""Contacts at the edge: random pairs moved sideways until they only just touch, then a little back and forth."""

from dataclasses import replace

import numpy as np
import oracle
import pytest
import shapely
from layouts import HARBOUR, HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE, Workload
from mixed_scenes import plain_scene
from verdicts import Pair, Reported, compare, solved

from conflictdb import solve
from conflictdb.model.plans import Area, EarthModel, Scene, Track
from conflictdb.model.results import Verdict

# Degrees of latitude moved back (deeper) and on (apart) from where contact ends: 10 micrometres to 100 m.
ASIDE_DEG = [0.0, 1e-10, 1e-8, 3e-6, 2e-5, 1e-3, -1e-10, -1e-8, -3e-6, -2e-5, -1e-3]
BISECTIONS = 45


def moved(track: Track, north_deg: float) -> Track:
    return replace(track, positions_deg=track.positions_deg + np.array([0.0, north_deg]))


def edge_of_contact(scene: Scene, other: Area | Track, track: Track) -> float | None:
    """Northward shift of the track at which the contact ends, degrees; None if it is more than half its window."""
    low, high = 0.0, None
    for far in (0.01, 0.1, 0.5, 1.0, 2.0):
        if np.abs(track.positions_deg[:, 1]).max() + far > 86:
            return None
        if not oracle.meeting(scene, other, moved(track, far), 1.0).touches:
            high = far
            break
        low = far
    if high is None:
        return None
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        if oracle.meeting(scene, other, moved(track, middle), 1.0).touches:
            low = middle
        else:
            high = middle
    return low


def grazing_problems(workload: Workload, seed: int, earth: EarthModel, most: int) -> tuple[list[str], int]:
    """Disagreements with the oracle, and the number of pairs compared."""
    scene, areas, tracks = plain_scene(workload, seed, 8, 8, earth)
    objects: dict[str, Area | Track] = {thing.key: thing for thing in (*areas, *tracks)}
    pairs = [
        pair
        for pair, meeting in oracle.meetings(scene, areas, tracks, 1.0).items()
        if meeting.touches and pair[1].startswith("T")
    ]
    wrong, looked = [], 0
    for a, b in pairs[:most]:
        other, track = objects[a], objects[b]
        assert isinstance(track, Track)
        edge = edge_of_contact(scene, other, track)
        if edge is None:
            continue
        for aside in ASIDE_DEG:
            one = moved(track, edge + aside)
            mine, theirs = ([other], [one]) if isinstance(other, Area) else ([], [other, one])
            truth: dict[Pair, oracle.Meeting] = {(a, b): oracle.meeting(scene, other, one, 200.0)}
            reported = solved(scene, mine, theirs)
            result = compare(scene, truth, reported)
            looked += 1
            wrong += [f"{workload.name} {seed} {earth} {aside:g}: {line}" for line in result.wrong]
            wrong += [f"{workload.name} {seed} {earth} {aside:g}: unresolved"] * result.unresolved
            wrong += missing_grazing(
                scene, truth[a, b], reported.get((a, b)), f"{workload.name} {seed} {(a, b)} {aside:g}"
            )
    return wrong, looked


def missing_grazing(scene: Scene, meeting: oracle.Meeting, answer: Reported | None, who: str) -> list[str]:
    """A pair within the tolerance is reported, and as grazing if it does not touch."""
    if 1e-5 < meeting.least_m < 0.99 * scene.tolerance_m:
        if answer is None:
            return [f"{who}: {meeting.least_m} m apart, not reported"]
        if answer.verdict is not Verdict.GRAZING:
            return [f"{who}: {meeting.least_m} m apart, {answer.verdict}"]
    return []


@pytest.mark.parametrize(("workload", "earth"), [(LOW_LATITUDE, EarthModel.WGS84), (HIGH_LATITUDE, EarthModel.SPHERE)])
def test_pairs_at_the_edge_of_contact(workload: Workload, earth: EarthModel) -> None:
    wrong, looked = grazing_problems(workload, 2, earth, most=1)
    assert not wrong
    assert looked == len(ASIDE_DEG)


@pytest.mark.slow
@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS, HARBOUR], ids=lambda w: w.name)
@pytest.mark.parametrize("seed", range(70, 74))
def test_pairs_at_the_edge_of_contact_sweep(workload: Workload, earth: EarthModel, seed: int) -> None:
    wrong, _ = grazing_problems(workload, seed, earth, most=6)
    assert not wrong


def test_micrometres_apart_for_an_hour_is_grazing() -> None:
    """Edges that are nearly parallel stay ten micrometres apart for long: decided by depth, not left unresolved."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 70, 8, 8, EarthModel.WGS84)
    (zone,) = (area for area in areas if area.key == "A3")
    (other,) = (track for track in tracks if track.key == "T7")
    edge_deg = 0.37986166457839093  # from edge_of_contact
    (found,) = solve([moved(other, edge_deg + 1e-10)], [zone], scene)
    assert found.verdict is Verdict.GRAZING


def test_the_period_of_a_near_miss_has_a_small_error() -> None:
    """A hull passes a straight side of an area, 0.9 m from it."""
    zone = Area("zone", shapely.box(5.0, 40.0, 5.02, 40.02))
    aside_deg, times_us = 40.0 - 10.9 / 111_034.6, [1_780_000_000_000_000, 1_780_001_000_000_000]
    hull = Track("hull", [(4.9, aside_deg), (5.03, aside_deg)], times_us, [(-10, 50), (10, 50), (10, -50), (-10, -50)])
    (found,) = solve([hull], [zone], Scene("s", tolerance_m=1.0))
    ((start, end),) = found.periods
    assert found.verdict is Verdict.GRAZING
    assert found.time_error_s < 0.1
    # The way along the area and the hull's length, at 11.1 m/s.
    assert start
    assert end
    assert (end - start).total_seconds() == pytest.approx(0.02 / 0.13 * 1000.0 + 9.1, abs=0.3)
