"""Areas with several spans and repeated voyages conflict exactly as one object for each activation does."""

import random
from dataclasses import replace

import numpy as np
import pytest
import shapely

import conflictdb
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import Area, Scene, Track, rectangle_outline_m

HOUR = 3_600_000_000
START = 1_780_000_000_000_000 // HOUR * HOUR


def at(hours: float) -> np.datetime64:
    return np.datetime64(START + round(hours * HOUR), "us")


def objects(seed: int) -> tuple[list[Area], list[Track]]:
    """Return areas with several spans and tracks with several departures, near each other."""
    dice = random.Random(seed)  # noqa: S311
    areas, tracks = [], []
    for n in range(6):
        lon, lat = dice.uniform(178, 182), dice.uniform(-1, 1)
        ring = [(lon, lat), (lon + 1.2, lat), (lon + 0.5, lat + 0.4), (lon + 1, lat + 1.1), (lon, lat + 1)]
        starts = sorted(dice.sample(range(60), dice.choice([1, 3, 6])))
        spans = [(at(s), at(s + dice.choice([0.5, 1, 3]))) for s in starts]
        areas.append(Area(f"A{n}", shapely.Polygon(ring), spans_us=spans))
    for n in range(6):
        course = [(dice.uniform(178, 183), dice.uniform(-1, 2)) for _ in range(3)]
        times = [at(5), at(5 + dice.uniform(2, 4)), at(9 + dice.uniform(1, 2))]
        departs = [at(first) for first in sorted(dice.sample(range(0, 60, 7), dice.choice([1, 2, 4])))]
        outline = rectangle_outline_m(5000, 9000, 3000, 3000)
        tracks.append(Track(f"T{n}", course, times, outline, departures_us=departs, grow_mps=dice.choice([0.0, 0.1])))
    return areas, tracks


def alone(areas: list[Area], tracks: list[Track]) -> tuple[list[Area], list[Track]]:
    """Return one object for each activation, entered by hand."""
    every_area = [
        Area(f"{area.key}/{n}", area.footprint, start_us=np.datetime64(start, "us"), end_us=np.datetime64(end, "us"))
        for area in areas
        for n, (start, end) in enumerate(area.spans_us or ())
    ]
    every_track = [
        replace(
            track,
            key=f"{track.key}/{n}",
            times_us=(track.times_us + departs - track.times_us[0]).view("datetime64[us]"),
            departures_us=None,
        )
        for track in tracks
        for n, departs in enumerate(track.departures_us or ())
    ]
    return every_area, every_track


def by_object(conflicts: list[conflictdb.Conflict]) -> dict[tuple[str, str], list[tuple[object, object]]]:
    """Return periods by pair of objects, those of activations joined where they touch."""
    found: dict[tuple[str, str], list[tuple[object, object]]] = {}
    for one in conflicts:
        pair = tuple(sorted(key.split("/")[0] for key in (one.a_key, one.b_key)))
        if pair[0] != pair[1]:
            found.setdefault(pair, []).extend(one.periods)
    joined = {}
    for pair, periods in found.items():
        merged: list[tuple[object, object]] = []
        for start, end in sorted(periods):
            if merged and start <= merged[-1][1]:
                merged[-1] = merged[-1][0], max(end, merged[-1][1])
            else:
                merged.append((start, end))
        joined[pair] = merged
    return joined


@pytest.mark.parametrize("setting", [{}, {"separation_m": 4000.0}, {"time_separation_s": 1800.0}])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_activations_conflict_as_objects_entered_by_hand(seed: int, setting: dict[str, float]) -> None:
    areas, tracks = objects(seed)
    scene = Scene("recurring", **setting)
    found = by_object(conflictdb.solve(tracks, areas, scene))
    by_hand_areas, by_hand_tracks = alone(areas, tracks)
    wanted = by_object(conflictdb.solve(by_hand_tracks, by_hand_areas, scene))
    assert found == wanted
    assert sum(len(periods) for periods in found.values()) >= 5


def test_an_area_without_activations_conflicts_with_nothing() -> None:
    areas, tracks = objects(1)
    never = [replace(area, start_us=None, end_us=None, spans_us=()) for area in areas]
    still = [replace(track, departures_us=()) for track in tracks]
    assert conflictdb.solve(tracks, never) == conflictdb.solve(tracks, [])
    assert conflictdb.solve(still, never) == []


def test_voyages_that_overlap_are_refused() -> None:
    with pytest.raises(InvalidInput, match=r"track 'T': departures\[1\]: is before the voyage before it has ended"):
        Track("T", [(0, 0), (1, 0)], [at(0), at(3)], [(0, 0)], departures_us=[at(1), at(3)])
    with pytest.raises(InvalidInput, match=r"area 'A': spans\[0\]: must end after it starts"):
        Area("A", [(0, 0), (1, 0), (0, 1)], spans_us=[(at(2), at(2))])
    with pytest.raises(InvalidInput, match=r"area 'A': start: must not be given together with spans"):
        Area("A", [(0, 0), (1, 0), (0, 1)], start_us=at(1), spans_us=[(at(2), at(3))])


def test_a_schedule_in_memory_is_expanded_over_all_voyages() -> None:
    """A voyage years ahead or ago meets the area on the days of its schedule, and on no others."""
    schedule = {"days": ["TUE"], "periods": [["08:00", "10:00"]]}
    area = Area("A", [(0, 0), (1, 0), (1, 1), (0, 1)], schedule=schedule)
    for day, is_closed in (("2019-06-04", True), ("2019-06-05", False), ("2041-06-04", True)):
        times = [np.datetime64(f"{day}T09:00"), np.datetime64(f"{day}T09:30")]
        found = conflictdb.solve([Track("T", [(0.4, 0.5), (0.5, 0.5)], times, [(0, 0)])], [area])
        assert len(found) == is_closed
