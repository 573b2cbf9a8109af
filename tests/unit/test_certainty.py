"""Whether all voyages within tolerances conflict: `must` and "never" against voyages at the extremes."""

from collections import Counter
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from conflictdb import Index, solve
from conflictdb.arrays import Floats
from conflictdb.formats.scene_file import read_scene
from conflictdb.model.plans import Area, Motion, Scene, Track, rectangle_outline_m
from conflictdb.model.results import Certainty
from conflictdb.model.rules import Rule

T0_US = 1_772_323_200_000_000
SHIP = rectangle_outline_m(150.0, 150.0, 20.0, 20.0)
MPS_PER_KNOT = 1852.0 / 3600.0
M_PER_DEG = 111_195.0


def moment(us: float) -> np.datetime64:
    return np.datetime64(int(us), "us")


def moved(place: Floats, bearing: float, metres: float, aside_m: float = 0.0) -> Floats:
    """A place so far along a rhumb line, then to starboard, by the middle latitude: to a metre on such short ways."""
    angle = np.radians(bearing)
    east = metres * np.sin(angle) + aside_m * np.cos(angle)
    lat = place[1] + (metres * np.cos(angle) - aside_m * np.sin(angle)) / M_PER_DEG
    return np.array([place[0] + east / M_PER_DEG / np.cos(np.radians(0.5 * (lat + place[1]))), lat])


class Plan:
    """A plan of one or two legs with tolerances, and voyages within them as plans of their own."""

    def __init__(self, rng: np.random.Generator, key: str, start: Floats, bearing: float, length_m: float) -> None:
        self.key, self.legs = key, int(rng.integers(1, 3))
        self.bearings = [bearing, bearing + float(rng.uniform(-60.0, 60.0))][: self.legs]
        self.lengths = [length_m] * self.legs
        way = [start]
        for heading in self.bearings:
            way.append(moved(way[-1], heading, length_m))
        self.way, self.speed = np.array(way), float(rng.uniform(6.0, 10.0))
        self.departs = T0_US + int(rng.integers(0, 600)) * 1_000_000
        spread = float(rng.choice([0.0, 0.01, 0.2]))
        self.speeds = (self.speed * (1.0 - spread), self.speed * (1.0 + spread))
        self.sides = float(rng.choice([0.0, 100.0, 800.0])), float(rng.choice([0.0, 100.0]))
        late = int(rng.choice([0, 20, 300, 1800]))
        self.window = self.departs - late * 500_000, self.departs + late * 500_000

    def track(self) -> Track:
        """The plan with its tolerances."""
        times = self.departs + np.append(0, np.cumsum(np.rint(1e6 * np.array(self.lengths) / self.speed)))
        limits: dict[str, Any] = {
            "xtd_port_m": self.sides[0],
            "xtd_starboard_m": self.sides[1],
            "min_speed_kn": self.speeds[0] / MPS_PER_KNOT,
            "max_speed_kn": self.speeds[1] / MPS_PER_KNOT,
            "departure_window": [moment(at) for at in self.window],
        }
        return Track(self.key, self.way, times.astype(np.int64), SHIP, tolerances=limits)

    def voyage(self, key: str, departs: float, speeds: tuple[float, float], aside: tuple[float, float]) -> list[Track]:
        """A voyage without its turn: each leg is a track, in two halves of their own speeds."""
        found, at = [], departs
        for k, (bearing, length) in enumerate(zip(self.bearings, self.lengths, strict=True)):
            offset = aside[k] * self.sides[1] if aside[k] > 0.0 else aside[k] * self.sides[0]
            half = 0.5e6 * length / np.array(speeds)
            way = np.array([moved(self.way[k], bearing, share * length, offset) for share in (0.0, 0.5, 1.0)])
            times = at + np.append(0.0, np.cumsum(half))
            found.append(Track(f"{key}/{k}", way, np.rint(times).astype(np.int64), SHIP, owner=self.key))
            at = times[-1]
        return found

    def extremes(self, rng: np.random.Generator, count: int) -> list[list[Track]]:
        """Voyages at the extremes of all tolerances, and a few between."""
        ends = product(self.window, product(self.speeds, repeat=2), ((-1.0, -1.0), (1.0, 1.0)))
        chosen = [one for one in ends if rng.random() < count / 16.0]
        while len(chosen) < count:
            departs, speeds = rng.uniform(*self.window), tuple(rng.uniform(*self.speeds, 2).tolist())
            chosen.append((departs, speeds, tuple(rng.uniform(-1.0, 1.0, 2).tolist())))  # type: ignore[arg-type]
        return [self.voyage(f"{self.key}#{i}", *one) for i, one in enumerate(chosen)]


def contradictions(seed: int, pairs: int) -> Counter[str]:
    """Counts of answers of random pairs, and of `must` with a free voyage and "never" with one that conflicts."""
    rng, counts = np.random.default_rng(seed), Counter[str]()
    for _ in range(pairs):
        motion = rng.choice(list(Motion))
        place = np.array([rng.uniform(-180.0, 180.0), rng.uniform(-70.0, 70.0)])
        separation_m = float(rng.choice([0.0, 500.0, 3_000.0]))
        scene = Scene("s", motion, "sphere", separation_m=separation_m)  # the ways of `moved` are on the sphere
        heading, length = float(rng.uniform(0.0, 360.0)), float(rng.choice([3_000.0, 15_000.0]))
        mine = Plan(rng, "T", moved(place, heading, -0.5 * length), heading, length)
        of_mine = mine.extremes(rng, 6)
        if rng.random() < 0.5:
            middle = moved(place, heading, float(rng.uniform(-0.6, 0.6)) * length, float(rng.normal(0.0, 1500.0)))
            size = rng.choice([300.0, 2_000.0, 8_000.0], 2) * rng.uniform(0.5, 1.5, 2)
            corners = [
                moved(middle, heading, x * size[0], y * size[1]) for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1))
            ]
            first = mine.departs + int(rng.uniform(-0.5, 1.0) * 1e6 * length / mine.speed)
            lasts = int(rng.choice([60, 1200, 20_000])) * 1_000_000
            area = Area("A", shapely.MultiPolygon([shapely.Polygon(corners)]), None, first, first + lasts)
            found = solve([mine.track()], [area], scene)
            tracks = [track for voyage in of_mine for track in voyage]
            met = {(one.b_key.split("/")[0], "") for one in solve(tracks, [area], scene)}
            voyages = {(voyage[0].key.split("/")[0], "") for voyage in of_mine}
        else:
            other = Plan(rng, "U", moved(place, heading + 100.0, -0.5 * length), heading + 100.0, length)
            if rng.random() < 0.3:
                other.window, other.sides, other.speeds = (other.departs,) * 2, (0.0, 0.0), (other.speed,) * 2
            of_other = other.extremes(rng, 6)
            found = solve([mine.track(), other.track()], [], scene)
            tracks = [track for voyage in (*of_mine, *of_other) for track in voyage]
            met = {tuple(key.split("/")[0] for key in (one.a_key, one.b_key)) for one in solve(tracks, [], scene)}
            voyages = {(a[0].key.split("/")[0], b[0].key.split("/")[0]) for a in of_mine for b in of_other}
        if not found:
            answer, wrong = "never", met
        else:
            answer, wrong = str(found[0].certainty), voyages - met if found[0].certainty == "must" else set()
        counts[answer] += 1
        counts["contradictions"] += bool(wrong)
        counts["of all voyages"] += met == voyages
        counts["of no voyage"] += not met
    return counts


@pytest.mark.parametrize(
    ("seed", "pairs"), [(1, 60), *(pytest.param(seed, 1_000, marks=pytest.mark.slow) for seed in range(2, 12))]
)
def test_no_voyage_contradicts_must_or_never(seed: int, pairs: int) -> None:
    counts = contradictions(seed, pairs)
    assert counts["contradictions"] == 0
    assert min(counts["must"], counts["may"], counts["never"]) >= pairs // 20
    assert counts["must"] >= 0.5 * counts["of all voyages"]


WAY = np.array([[4.0, 57.0], [4.5, 57.1], [5.0, 57.0]])
TIMES = T0_US + np.array([0, 7_200_000_000, 14_400_000_000])
LATE = {"departure_window": [moment(T0_US), moment(T0_US + 1_800_000_000)]}


def ferry(**more: Any) -> Track:
    limits = {"xtd_port_m": 500.0, "xtd_starboard_m": 500.0, **LATE, **more.pop("limits", {})}
    return Track("F", WAY, TIMES, SHIP, tolerances=limits, **more)


def band(west: float, east: float, key: str = "A", **more: Any) -> Area:
    return Area(key, shapely.MultiPolygon([shapely.box(west, 56.9, east, 57.2)]), **more)


def certainty(track: Track, other: Area | Track, **settings: Any) -> Certainty | None:
    areas, tracks = ([other], [track]) if isinstance(other, Area) else ([], [track, other])
    (found,) = solve(tracks, areas, Scene("s", **settings))
    return found.certainty


def test_a_band_across_the_route_must_conflict_while_it_is_closed_for_all_voyages() -> None:
    assert certainty(ferry(), band(4.2, 4.21)) == "must"
    passes_us = 0.4 * 7_200_000_000
    start, end = T0_US + int(passes_us) - 600_000_000, T0_US + int(passes_us) + 2_600_000_000
    assert certainty(ferry(), band(4.2, 4.21, start_us=start, end_us=end)) == "must"
    assert certainty(ferry(), band(4.2, 4.21, start_us=start + 900_000_000, end_us=end)) == "may"
    # In two spans that no voyage passes between.
    spans = [(start, T0_US + int(passes_us) + 900_000_000), (T0_US + int(passes_us) + 1_000_000_000, end)]
    assert certainty(ferry(), Area("A", band(4.2, 4.21).footprint, spans_us=spans)) == "may"


def test_the_ferry_of_the_page_must_conflict_if_the_area_is_closed_for_longer() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs/how-to/plan-with-tolerances.md").read_text()
    text = page.split("<<'END'\n")[1].split("END\n")[0]
    for given, expected in ((text, "may"), (text.replace('"2026-03-01T11:00', '"2026-03-01T10:00'), "must")):
        found = read_scene(given, "ferry")
        assert [one.certainty for one in solve(found.tracks, found.areas, found.scene)] == [expected]


def test_a_gap_of_a_ship_s_width_is_no_must() -> None:
    """Two parts of an area beside the route: a ship between them is free if the gap is wide enough."""
    for gap_deg, expected in ((0.0002, "must"), (0.003, "may")):
        parts = [shapely.box(4.2, 57.04 + gap_deg, 4.21, 57.2), shapely.box(4.2, 56.9, 4.21, 57.04)]
        assert certainty(ferry(), Area("A", shapely.MultiPolygon(parts))) == expected


def test_what_cannot_be_tested_may_conflict() -> None:
    """A turn with a radius, a stop, a haven that changes, heights of a climb, and verdicts that are not certain."""
    corner = Area("C", shapely.MultiPolygon([shapely.box(4.49, 57.09, 4.51, 57.11)]))
    assert certainty(ferry(limits={"turn_radius_m": 2_000.0}), corner) == "may"
    grown = Track("G", WAY[::-1] + np.array([0.0, 0.001]), TIMES, SHIP, grow_mps=0.1)
    assert certainty(ferry(limits={"departure_window": LATE["departure_window"][:1] * 2}), grown) == "may"
    climbing = ferry(floors_m=np.array([0.0, 100.0, 100.0]), ceilings_m=np.array([50.0, 150.0, 150.0]))
    assert certainty(climbing, band(4.2, 4.21, floor_m=60.0, ceiling_m=120.0)) == "may"
    assert certainty(climbing, band(4.2, 4.21, floor_m=60.0, ceiling_m=120.0), vertical_separation_m=40.0) == "must"
    assert certainty(climbing, band(4.2, 4.21, floor_m=20.0, ceiling_m=120.0)) == "must"
    assert certainty(climbing, band(4.6, 4.61, floor_m=120.0)) == "must"
    assert certainty(climbing, band(4.2, 4.21)) == "must"
    assert certainty(ferry(), band(4.2, 4.21), method="screen") is None


def test_plans_without_tolerances_have_no_certainty() -> None:
    plain = Track("P", WAY, TIMES, SHIP)
    assert certainty(plain, band(4.2, 4.21)) is None
    assert certainty(plain, Track("Q", WAY[::-1], TIMES, SHIP)) is None
    back = Track("Q", WAY[::-1] + np.array([0.0, 0.001]), TIMES, SHIP)
    assert certainty(ferry(), back, separation_m=1_500.0) == "may"
    assert (
        certainty(ferry(limits={"departure_window": LATE["departure_window"][:1] * 2}), back, separation_m=1_500.0)
        == "must"
    )


def test_settings_and_rules_of_a_pair_count() -> None:
    beside = Area("B", shapely.MultiPolygon([shapely.box(4.2, 57.05, 4.21, 57.2)]), object_class="x")
    assert certainty(ferry(), beside, separation_m=1_000.0) == "may"
    assert certainty(ferry(), beside, separation_m=3_000.0) == "must"
    rules = (Rule(a_class="x", b_class=None, separation_m=3_000.0),)
    assert certainty(ferry(), beside, rules=rules) == "must"
    assert certainty(ferry(), band(4.2, 4.21), time_separation_s=600.0) == "must"


def test_an_index_has_the_certainties_of_solve() -> None:
    areas = [
        band(4.0 + 0.1 * i, 4.01 + 0.1 * i, f"A{i}", start_us=T0_US, end_us=T0_US + (5 - i % 5) * 3_000_000_000)
        for i in range(1, 9)
    ]
    other = Track("P", WAY, TIMES, SHIP)
    index = Index(Scene("s"))
    index.put(areas)
    index.put(other)
    solved = {(one.a_key, one.b_key): one.certainty for one in solve([ferry(), other], areas, Scene("s"))}
    probed = {(one.a_key, one.b_key): one.certainty for one in index.probe(ferry())}
    assert set(probed.values()) == {"may", "must"}
    assert probed == {pair: solved[pair] for pair in probed}
    index.put(ferry())
    (area, _), expected = next((pair, one) for pair, one in solved.items() if one == "must")
    answer = index.probe(next(one for one in areas if one.key == area))
    assert [one.certainty for one in answer if one.b_key == "F"] == [expected]
