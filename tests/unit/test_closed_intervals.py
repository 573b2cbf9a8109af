"""In a scene with closed intervals the last instant of a span and the ceiling of a band belong to an object."""

from dataclasses import replace
from itertools import product

import oracle
import pytest
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from scenes import T0_US

from conflictdb import Area, Index, InvalidInput, Scene, Track, solve

CLOSED = Scene("closed", intervals="closed")  # type: ignore[arg-type]
OPEN = Scene("open")


def square(key: str, span: tuple[int, int] = (0, 2), band: tuple[float, float] = (0.0, 2.0)) -> Area:
    ring = [(0.0, 0.0), (0.1, 0.0), (0.1, 0.1), (0.0, 0.1)]
    return Area(key, ring, None, T0_US + span[0] * 10**6, T0_US + span[1] * 10**6, *(0.1 * x for x in band))


@pytest.mark.parametrize(
    "scene", [OPEN, CLOSED, replace(CLOSED, vertical_separation_m=0.1)], ids=["open", "closed", "apart"]
)
def test_areas_that_share_an_end_meet_where_intervals_are_closed(scene: Scene) -> None:
    """Of all spans and bands on a grid, whose numbers are no exact doubles."""
    spans = [(a, b) for a, b in product(range(4), repeat=2) if a < b]
    closed, wanted = scene.intervals == "closed", scene.vertical_separation_m / 0.1
    for span, band in product(spans, spans):
        expected = (span[1] >= 1 and span[0] <= 2) if closed else (span[1] > 1 and span[0] < 2)
        gap = max(1, band[0]) - min(2, band[1])
        expected &= gap <= wanted if closed else gap < wanted or (wanted == 0 and gap < 0)
        found = solve([], [square("a", (1, 2), (1.0, 2.0)), square("b", span, band)], scene)
        assert len(found) == expected, (span, band)
        if expected:
            [(start, end)] = found[0].periods
            assert (end - start).total_seconds() == min(2, span[1]) - max(1, span[0])


@pytest.mark.parametrize("scene", [OPEN, CLOSED], ids=["open", "closed"])
def test_the_last_instant_of_a_track_counts(scene: Scene) -> None:
    """It reaches the area as both end, and an area begins as it ends."""
    times = [T0_US - 10**7, T0_US]
    arrives = Track("t", [(-0.01, 0.05), (0.0, 0.05)], times, [(0.0, 0.0)])
    ends, begins = square("ends", (-20, 0)), square("begins", (0, 20))
    fine = replace(scene, tolerance_m=0.0)
    assert [(one.a_key, one.b_key) for one in solve([arrives], [ends, begins], fine)] == (
        [("begins", "ends"), ("begins", "t"), ("ends", "t")] if scene is CLOSED else []
    )
    index = Index(fine)
    index.put([ends, begins])
    assert len(index.probe(arrives)) == (2 if scene is CLOSED else 0)


@pytest.mark.parametrize("seed", [1, 2])
def test_closed_scenes_have_the_conflicts_of_the_oracle(seed: int) -> None:
    """Spans and bands end at few instants and heights, so that many touch."""
    scene, areas, tracks = plain_scene(LOW_LATITUDE, seed, 5, 5)
    scene = replace(scene, intervals="closed")
    hour = 3_600_000_000
    for k, one in enumerate(areas):
        start = T0_US // hour * hour + k % 3 * 4 * hour
        areas[k] = replace(
            one, start_us=start, end_us=start + 4 * hour, floor_m=100.0 * (k % 2), ceiling_m=100.0 * (k % 2) + 100.0
        )
    tracks = [
        replace(
            one,
            times_us=one.times_us // hour * hour + [4 * hour * j for j in range(len(one.times_us))],
            floor_m=100.0 * (k % 3),
        )
        for k, one in enumerate(tracks)
    ]
    expected = {pair for pair, found in oracle.meetings(scene, areas, tracks).items() if found.intervals}
    grazing = {pair for pair, found in oracle.meetings(scene, areas, tracks).items() if found.least_m <= 2.0}
    found = {(one.a_key, one.b_key) for one in solve(tracks, areas, scene)}
    assert expected <= found <= expected | grazing
    assert found


def test_other_words_are_refused() -> None:
    with pytest.raises(InvalidInput, match="intervals: must be one of half_open, closed"):
        Scene("s", intervals="open")  # type: ignore[arg-type]
