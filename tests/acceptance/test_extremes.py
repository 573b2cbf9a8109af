"""Answers at the extremes: a test for each, against the oracle or an answer worked out by hand.

Every method that certifies its answers is tested (the reference one on demand). "in digits" is
`test_extremes_in_digits.py`, against 30 digits; "known" are the scenes of `scenes.py`, worked out by hand.

| extreme | tested by |
|---|---|
| equator crossing, both hemispheres | known `equator_crossing`, `head_on`; workloads `EQUATOR`, `SOUTH` |
| +-180 in both directions, and exactly on it | known `seam`, `on_the_seam`; in digits `across the seam` |
| latitude up to 89; beyond, and areas with a pole | `..at_89_degrees`, `..beyond_89..`; in digits `..holds_a_pole..` |
| scenes 1 m and 20,000 km across | `test_scene_a_metre_across`, `test_half_a_turn..`; in digits |
| bearings at and near the quarters | `test_bearings_at_and_near_the_quarters`; in digits at 1e-9 and 1e-15 |
| legs of 1 mm and 10,000 nmi | `test_legs_of_ten_thousand_miles..`; in digits |
| loiter | known `loiter`; `test_waits_half_a_metre_short..`, `test_stops_at_a_touch` |
| speeds of 1e-6 kn and 2,000 kn | `test_speeds_..`; in digits |
| years 1900 and 2200 | `test_years` |
| windows of 1 us, 100 years, infinite | `test_windows_..`, `test_unbounded_spans`; in digits `a century` |
| havens of 1 cm and 500 nmi | `test_havens_..`; in digits |
| slivers 1e-9 wide | `test_slivers`, `test_outlines[sliver]` |
| repeated and collinear vertices, both windings | `test_outlines`; of areas in digits `test_area_rings_as_they_come` |
| 5,000 vertices | `test_five_thousand_vertices` |
| holes, several parts, a track in a hole | known `hole`, `twice_in_a_leg`; all workloads |
| identical objects; shared edge | known `identical`, `touching` |
| side by side at one speed, exactly touching | in digits `test_side_by_side_at_one_speed`, `test_abreast_..` |
| corner to corner | `test_corner_to_corner` |
| contact shorter than 1 us | `test_contact_shorter_than_a_microsecond` |
| contact at the end of a time range | known `spans`; `test_span_that_ends_..`; in digits `..where_a_span_ends` |
| overtaking at 1e-6 kn | `test_overtaking_at_a_millionth_of_a_knot` |
| twice in a leg, three times over legs | known `twice_in_a_leg`, `several_legs`; in digits |
| separation where meridians converge | `test_separation_on_earth.py` |
| bad input | `unit/test_io_bad_input.py`, `sql/test_refusals.py`; not half loaded: `sql/test_objects.py` |
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scenes
import shapely
from scenes import HOUR_S, T0_US, Known, area, meridian_m, parallel_m, track
from verdicts import CERTIFIED, Comparison, Reported, compared, solved
from wild import throw_wild

from conflictdb.errors import InvalidInput
from conflictdb.model.plans import Area, EarthModel, Scene, Track
from conflictdb.model.results import Verdict

earths = pytest.mark.parametrize("earth", EarthModel)
POINT = {"fore": 0.0, "aft": 0.0, "port": 0.0, "starboard": 0.0}


@pytest.fixture(params=CERTIFIED, autouse=True)
def _method(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SETTINGS, "method", request.param)


SETTINGS: dict[str, Any] = {}  # that every scene of a test gets


def check(scene: Scene, areas: list[Area], tracks: list[Track]) -> tuple[Comparison, dict[tuple[str, str], Reported]]:
    """Solve, compare with the oracle, and nothing may be wrong or left open."""
    scene = replace(scene, **SETTINGS)
    reported = solved(scene, areas, tracks)
    result = compared(scene, areas, tracks, reported)
    assert not result.wrong
    assert result.unresolved == 0
    return result, reported


def touching(scene: Scene, areas: list[Area], tracks: list[Track]) -> int:
    return check(scene, areas, tracks)[0].touching


UNIT = area("A", shapely.box(0, 0, 1, 1))


# Geography


@earths
@pytest.mark.parametrize("lat", [88.9, -88.9])
def test_at_89_degrees(earth: EarthModel, lat: float) -> None:
    low, high = sorted((lat, np.sign(lat) * 88.5))
    cap = area("A", shapely.box(-20, low, 20, high))
    near = track("T", [(-90, np.sign(lat) * 88.7), (80, np.sign(lat) * 88.99)], [0, 24 * HOUR_S], 1e3, 1e3, 1e3, 1e3)
    assert touching(Scene("s", earth=earth), [cap], [near]) == 1


@earths
def test_haven_that_points_away_from_the_pole(earth: EarthModel) -> None:
    """Latitude plus reach passes the pole, but no vertex does."""
    zone = area("A", shapely.box(-30, 72, 30, 75))
    long = track("T", [(0, 88), (0, 80)], [0, 48 * HOUR_S], 9e5, 1e3, 5e4, 5e4)
    assert touching(Scene("s", earth=earth), [zone], [long]) == 1


@earths
@pytest.mark.parametrize("sign", [1, -1])
def test_wide_haven_near_the_pole(earth: EarthModel, sign: int) -> None:
    """Havens of hundreds of kilometres a few degrees from the pole, whose image bends a lot within a slice."""
    far = track("T", [(124, sign * 86), (-117, sign * 72.5)], [0, 20 * HOUR_S], 22e3, 134e3, 336e3, 25e3)
    near = track("U", [(150, sign * 76.6), (-124, sign * 75.1)], [0, 20 * HOUR_S], 48e3, 41e3, 40e3, 22e3)
    low, high = sorted((sign * 74.0, sign * 75.0))
    zones = [area(f"A{lon}", shapely.box(lon, low, lon + 4, high)) for lon in range(-140, -100, 10)]
    assert touching(Scene("s", earth=earth), zones, [far, near]) >= 2


@earths
def test_haven_wider_than_the_world(earth: EarthModel) -> None:
    """At 88 degrees a haven of 1,600 km from side to side spans more than a turn: it meets objects behind it, too."""
    wide = track("T", [(170, 87.5), (170, 88.0)], [0, 2 * HOUR_S], 1e3, 1e3, 8e5, 8e5)
    zones = [area(f"A{lon}", shapely.box(lon, 87.6, lon + 5, 87.7)) for lon in range(-175, 180, 35)]
    check(Scene("s", earth=earth), zones, [wide])


@earths
@pytest.mark.parametrize("sign", [1, -1])
def test_deep_overlap_near_the_pole(earth: EarthModel, sign: int) -> None:
    """Hundreds of kilometres deep at 86 degrees, where depth in metres changes faster than the polygons move."""
    low, high = sorted((sign * 74.0, sign * 88.0))
    zone = area("A", shapely.box(120, low, 139, high))
    wide = track("T", [(1, sign * 86), (177, sign * 86)], [0, 400 * HOUR_S], 32e4, 32e4, 7e4, 7e4)
    assert touching(Scene("s", earth=earth), [zone], [wide]) == 1


@earths
def test_areas_as_wide_as_the_world(earth: EarthModel) -> None:
    areas = [
        area("band", shapely.box(-180, 10, 180, 20)),
        area("most", shapely.box(-170, 30, 170, 40)),
        area("rest", shapely.box(-175, 31, -172, 33)),
    ]
    tracks = [
        track("T", [(0, 0), (175, 41)], [0, 400 * HOUR_S]),
        track("U", [(175, 41), (-175, 29)], [0, 40 * HOUR_S]),
    ]
    assert touching(Scene("s", earth=earth), areas, tracks) >= 2


@earths
def test_half_a_turn_goes_the_way_it_is_written(earth: EarthModel) -> None:
    tracks = [track("T", [(0, 0), (180, 0)], [0, 100 * HOUR_S]), track("U", [(180, 1), (0, 1)], [0, 100 * HOUR_S])]
    areas = [area("east", shapely.box(80, -5, 90, 5)), area("west", shapely.box(-90, -5, -80, 5))]
    _, reported = check(Scene("s", earth=earth), areas, tracks)
    assert set(reported) == {("east", "T"), ("east", "U")}


@earths
def test_scene_a_metre_across(earth: EarthModel) -> None:
    micro = 1e-5
    zone = area("A", shapely.box(8.0, 47.0, 8.0 + micro, 47.0 + micro))
    toy = track(
        "T", [(8.0 - micro, 47.0 + micro / 2), (8.0 + 2 * micro, 47.0 + micro / 2)], [0, 60], 0.1, 0.1, 0.05, 0.05
    )
    beside = track(
        "U", [(8.0 - micro, 47 + 2 * micro), (8.0 + 2 * micro, 47 + 2 * micro)], [0, 60], 0.1, 0.1, 0.05, 0.05
    )
    scene = Scene("s", earth=earth, tolerance_m=0.001)
    _, reported = check(scene, [zone], [toy, beside])
    assert {pair: found.verdict for pair, found in reported.items()} == {("A", "T"): Verdict.CONFLICT}


@earths
def test_legs_of_ten_thousand_miles_and_of_a_millimetre(earth: EarthModel) -> None:
    long = [
        track("T", [(60, -40), (-110, 35)], [0, 400 * HOUR_S]),
        track("U", [(-110, 20), (60, -30)], [0, 400 * HOUR_S]),
    ]
    areas = [area("A", shapely.box(-60, 20, -58, 30)), area("B", shapely.box(-100, -1, -99, 50))]
    assert touching(Scene("s", earth=earth), areas, long) >= 2
    short = [
        track("T", [(-0.0449, 0.5), (-0.0449 + 1e-8, 0.5)], [0, HOUR_S]),
        track("U", [(-0.04, 0.5), (-0.04 + 1e-8, 0.5 + 1e-8)], [0, HOUR_S]),
    ]
    assert touching(Scene("s", earth=earth), [UNIT], short) == 3


# Bearings


@earths
@pytest.mark.parametrize("quarter", [0, 90, 180, 270])
def test_bearings_at_and_near_the_quarters(earth: EarthModel, quarter: int) -> None:
    """Out of a box into a second one, and past a track that comes the opposite way; 0 to 1e-6 degrees off a quarter."""
    areas, tracks = [], []
    for k, (lat, away) in enumerate((lat, away) for lat in (0.0, 60.0) for away in (0.0, 1e-15, 1e-12, 1e-9, 1e-6)):
        bearing = np.radians(quarter) + np.radians(away)
        step = np.array([np.sin(bearing), np.cos(bearing)])
        step[np.abs(step) < 1e-16] = 0.0
        start = np.array([10.0 * k, lat])
        end = start + step * (1.0, 0.7)
        areas += [area(f"A{k}", shapely.box(*(start - 0.1), *(start + 0.1)))]
        areas += [area(f"B{k}", shapely.box(*(end - 0.2), *(end + 0.2)))]
        tracks += [track(f"T{k}", [tuple(start), tuple(end)], [0, HOUR_S], 8000, 3000, 2000, 4000)]
        tracks += [track(f"U{k}", [tuple(end), tuple(start)], [0, HOUR_S], 500, 500, 500, 500)]
    result, _ = check(Scene("s", earth=earth), areas, tracks)
    assert result.touching == 5 * 10  # each track both boxes, and the other track


# Speeds and times


@earths
def test_speeds_from_a_millionth_of_a_knot_to_two_thousand(earth: EarthModel) -> None:
    edge = 5000.0 / parallel_m(earth, 0.5)
    slow = track("slow", [(-edge - 1e-4, 0.5), (-edge + 1e-4, 0.5)], [0, 22.2 / 5.1e-7])
    assert touching(Scene("s", earth=earth), [UNIT], [slow]) == 1
    fast = track("fast", [(-10, -10), (12, 12)], [0, 1800])
    assert touching(Scene("s", earth=earth), [UNIT], [fast]) == 1


@earths
def test_overtaking_at_a_millionth_of_a_knot(earth: EarthModel) -> None:
    """The faster is a metre faster in a month, and begins half a metre short: two weeks until they touch."""
    degree = parallel_m(earth, 0.0)
    month = 30 * 24 * HOUR_S
    apart = 20000.0 + 5.0
    tracks = [
        track("behind", [(0, 0), (5 + 10 / degree, 0)], [0, month], 10000, 10000, 100, 100),
        track("before", [(apart / degree, 0), (5 + apart / degree, 0)], [0, month], 10000, 10000, 100, 100),
    ]
    _, reported = check(Scene("s", earth=earth, tolerance_m=0.01), [], tracks)
    start = reported["before", "behind"].periods_us[0][0]
    assert start is not None
    assert (start - T0_US) / 1e6 == pytest.approx(month / 2, abs=2 * reported["before", "behind"].time_error_s + 1e-3)


@pytest.mark.parametrize("year", [1, 1600, 1900, 2200, 9999])
def test_years(year: int) -> None:
    """The answer does not depend on the year."""
    since = float((np.datetime64(f"{year:04d}-03-01") - np.datetime64("2026-03-01")) / np.timedelta64(1, "s"))

    def period(since: float) -> tuple[int, int]:
        zone = area("A", shapely.box(0, 0, 1, 1), since, since + 2 * HOUR_S)
        _, reported = check(Scene("s"), [zone], [track("T", [(-1, 0.5), (2, 0.5)], [since, since + 3 * HOUR_S])])
        ((start, end),) = reported["A", "T"].periods_us
        assert start is not None
        assert end is not None
        return start - round(since * 1e6), end - round(since * 1e6)

    assert period(since) == period(0.0)


@earths
def test_windows_of_a_microsecond_and_of_a_century(earth: EarthModel) -> None:
    scene = Scene("s", earth=earth)
    moving = track("T", [(-1, 0.5), (2, 0.5)], [0, 3 * HOUR_S])
    instant = area("A", shapely.box(0, 0, 1, 1), 1.5 * HOUR_S, 1.5 * HOUR_S + 1e-6)
    _, reported = check(scene, [instant], [moving])
    assert reported["A", "T"].periods_us == ((T0_US + 5_400_000_000, T0_US + 5_400_000_001),)
    flash = track("T", [(-0.1, 0.5), (0.2, 0.5)], [0, 1e-6])
    assert touching(scene, [UNIT], [flash]) == 1
    century = track("T", [(-1, 0.5), (2, 0.7)], [0, 100 * 365.25 * 24 * HOUR_S])
    assert touching(scene, [UNIT], [century]) == 1


@earths
def test_contact_shorter_than_a_microsecond(earth: EarthModel) -> None:
    """At 1,000 m/s a corner is 0.2 mm deep in a corner: reported, whatever the tolerance."""
    degree = parallel_m(earth, 0.0)
    zone = area("A", shapely.box(0, 0, 1, 1))
    for tolerance_m in (0.0, 1.0):
        fall = track("T", [(-0.5 - 1e-4 / degree, 0.5), (0.5, -0.5 - 1e-4 / degree)], [0, 157], **POINT)
        rise = track("U", [(-0.5 + 1e-4 / degree, 0.5), (0.5, -0.5 + 1e-4 / degree)], [0, 157], **POINT)
        scene = Scene("s", earth=earth, tolerance_m=tolerance_m)
        _, reported = check(scene, [zone], [fall, rise])
        assert ("A", "U") in reported


def test_unbounded_spans() -> None:
    forever = area("A", shapely.box(0, 0, 1, 1))
    since = area("B", shapely.box(0.5, 0.5, 2, 2), 0, None)
    until = area("C", shapely.box(0.9, 0.9, 3, 3), None, HOUR_S)
    moving = track("T", [(-1, 0.95), (4, 0.95)], [-HOUR_S, 4 * HOUR_S])
    _, reported = check(Scene("s"), [forever, since, until], [moving])
    assert reported["A", "B"].periods_us == ((T0_US, None),)
    assert reported["A", "C"].periods_us == ((None, T0_US + 3_600_000_000),)
    assert reported["B", "C"].periods_us == ((T0_US, T0_US + 3_600_000_000),)
    assert len(reported) == 6


# Shapes


@earths
def test_havens_of_a_centimetre_and_of_500_miles(earth: EarthModel) -> None:
    huge = 500 * 1852.0 / 2
    tracks = [
        track("speck", [(0, 0), (5, 1)], [0, 10 * HOUR_S], 0.005, 0.005, 0.005, 0.005),
        track("cloud", [(15, 10), (2, 1)], [0, 10 * HOUR_S], huge, huge, huge, huge),
        track("north", [(0, 40), (35, 62)], [0, 10 * HOUR_S], huge, huge, huge, huge),
    ]
    assert touching(Scene("s", earth=earth), [area("A", shapely.box(40, 60, 45, 62))], tracks) >= 2


CROSS = np.array([(5e3, 5e3), (5e3, -5e3), (-5e3, -5e3), (-5e3, 5e3)])
OUTLINES = {
    "clockwise": CROSS,
    "counter-clockwise": CROSS[::-1],
    "repeated": np.repeat(CROSS, 2, axis=0),
    "collinear": np.array([(5e3, 5e3), (5e3, 0), (5e3, -5e3), (0, -5e3), (-5e3, -5e3), (-5e3, 5e3)]),
    "ahead of itself": CROSS + np.array([0, 2e4]),
    "sliver": np.array([(0, 1e4), (1e-9, -1e4), (-1e-9, -1e4)]),
    "needle": np.array([(0, 1e4), (0, -1e4)]),
    "point": np.array([(0.0, 0.0)]),
    "point aside": np.array([(2000.0, 3000.0)]),
    "many sides": 5e3 * np.array([(np.sin(a), np.cos(a)) for a in np.linspace(0, 2 * np.pi, 200, endpoint=False)]),
}


@earths
@pytest.mark.parametrize("name", OUTLINES)
def test_outlines(earth: EarthModel, name: str) -> None:
    moving = Track("T", np.array([(-1, 0.2), (2, 0.7)]), np.array([T0_US, T0_US + 10_800_000_000]), OUTLINES[name])
    other = track("U", [(2, 0.2), (-1, 0.9)], [0, 3 * HOUR_S])
    assert touching(Scene("s", earth=earth), [UNIT], [moving, other]) >= 2


@earths
def test_slivers(earth: EarthModel) -> None:
    """A ten-thousandth of a millimetre wide, both of them, and they cross."""
    flat = area("flat", shapely.Polygon([(0, 0), (1, 0), (1, 1e-9)]))
    upright = area("upright", shapely.Polygon([(0.5, -0.5), (0.5 + 1e-9, -0.5), (0.5, 0.5)]))
    through = track("T", [(-1, 0.0), (2, 0.0)], [0, 3 * HOUR_S], 10, 10, 10, 10)
    assert touching(Scene("s", earth=earth), [flat, upright], [through]) == 3


@pytest.mark.parametrize("earth", [EarthModel.WGS84, pytest.param(EarthModel.SPHERE, marks=pytest.mark.slow)])
def test_five_thousand_vertices(earth: EarthModel) -> None:
    angle = np.linspace(0, 2 * np.pi, 5001)[:-1]
    round_ = shapely.Polygon(np.stack([np.cos(angle), 0.5 * np.sin(angle)], axis=1))
    wavy = 1 + 0.3 * np.sin(60 * angle)
    star = shapely.Polygon(np.stack([4 + wavy * np.cos(angle), 0.5 * wavy * np.sin(angle)], axis=1))
    tracks = [
        track("T", [(-2, 0.3), (6, 0.1)], [0, 8 * HOUR_S], 500, 500, 500, 500),
        track("U", [(-2, 0.51), (6, 0.5)], [0, 8 * HOUR_S], 500, 500, 500, 500),
    ]
    _, reported = check(Scene("s", earth=earth), [area("A", round_), area("B", star)], tracks)
    assert len(reported["B", "U"].periods_us) > 3, "in and out of the points of a star"


# Contacts


@earths
def test_points_that_meet_and_that_miss(earth: EarthModel) -> None:
    east, north = [(0, 0), (1, 0)], [(0.5, -0.5), (0.5, 0.5)]
    for tolerance_m, delay_s, verdict in ((1.0, 0.0, Verdict.GRAZING), (0.0, 0.0, Verdict.GRAZING), (1.0, -1.0, None)):
        tracks = [track("a", east, [0, HOUR_S], **POINT), track("b", north, [0, HOUR_S + delay_s], **POINT)]
        _, reported = check(Scene("s", earth=earth, tolerance_m=tolerance_m), [], tracks)
        assert (reported["a", "b"].verdict if reported else None) is verdict


@earths
def test_lines_end_to_end_and_across(earth: EarthModel) -> None:
    line = {"fore": 3000.0, "aft": 3000.0, "port": 0.0, "starboard": 0.0}
    day = [0, HOUR_S]
    scene = Scene("s", earth=earth)
    towards = [track("a", [(0, 10), (1, 10)], day, **line), track("b", [(1, 10), (0, 10)], day, **line)]
    assert touching(scene, [], towards) == 1
    behind = [track("a", [(0, 10), (1, 10)], day, **line), track("b", [(1.2, 10), (2.2, 10)], day, **line)]
    assert touching(scene, [], behind) == 0
    across = [track("a", [(0, 10), (1, 10)], day, **line), track("b", [(0.5, 9.5), (0.5, 10.5)], day, **line)]
    assert touching(scene, [], across) == 1


@earths
@pytest.mark.parametrize("short_m", [0.5, -0.5, 3.0])
def test_waits_half_a_metre_short_and_then_enters(earth: EarthModel, short_m: float) -> None:
    """Closeness on one leg is not contact: a pair that meets is reported while it meets."""
    degree = parallel_m(earth, 0.0)
    stop = 1 - (5000.0 + short_m) / degree
    moving = track("T", [(0, 0), (stop, 0), (stop, 0), (2, 0)], [0, 2 * HOUR_S, 4 * HOUR_S, 6 * HOUR_S])
    creeping = track("U", [(0, 10), (stop, 10), (1 - 4990 / degree, 10)], [0, 2 * HOUR_S, 8 * HOUR_S])
    zones = [area("A", shapely.box(1, -1, 2, 1)), area("B", shapely.box(1, 9, 2, 11))]
    check(Scene("s", earth=earth), zones, [moving, creeping])


@earths
def test_stops_at_a_touch(earth: EarthModel) -> None:
    degree = parallel_m(earth, 0.0)
    for into_m, verdict in ((0.5, Verdict.GRAZING), (3.0, Verdict.CONFLICT)):
        stop = 1 - (5000.0 - into_m) / degree
        moving = track("T", [(0, 0), (stop, 0), (stop, 0)], [0, 2 * HOUR_S, 4 * HOUR_S])
        _, reported = check(Scene("s", earth=earth), [area("A", shapely.box(1, -1, 2, 1))], [moving])
        assert reported["A", "T"].verdict is verdict


@earths
@pytest.mark.parametrize("beyond_um", [-0.5, 0.2, 0.9])
def test_span_that_ends_within_a_micrometre_of_the_contact(earth: EarthModel, beyond_um: float) -> None:
    """At a millimetre a second the last micrometre takes a millisecond: the bound says so, also where the span ends."""
    degree = parallel_m(earth, 0.0)
    end = 1 + (5000.0 + beyond_um * 1e-6) / degree
    leaves = track("T", [(end - 10 / degree, 0), (end, 0)], [0, 1e4], 100, 5000, 100, 100)
    enters = track("U", [(-end, 0), (-end + 10 / degree, 0)], [0, 1e4], 5000, 100, 100, 100)
    zones = [area("A", shapely.box(0, -1, 1, 1)), area("B", shapely.box(-1, -1, 0, 1), 0, None, (5.0, 6.0))]
    check(Scene("s", earth=earth), zones, [leaves, enters])


@earths
def test_corner_to_corner(earth: EarthModel) -> None:
    """One eastbound and one northbound, equally fast: a north-east corner passes a south-west one."""
    size = 5000.0
    metre = 1.0 / parallel_m(earth, 0.0)
    for gap_m, verdict in ((2.0, None), (0.0, Verdict.GRAZING), (-2.0, Verdict.CONFLICT)):
        # Relative to the first the second moves north-west, so that the sum of its coordinates is constant.
        aside = (4 * size + gap_m * np.sqrt(2)) * metre / 2
        one = track("a", [(-0.1, 0), (0.1, 0)], [0, HOUR_S], size, size, size, size)
        two = track("b", [(aside, aside - 0.1), (aside, aside + 0.1)], [0, HOUR_S], size, size, size, size)
        if earth is EarthModel.SPHERE:
            _, reported = check(Scene("s", earth=earth), [], [one, two])
            assert (reported["a", "b"].verdict if reported else None) is verdict
        else:
            check(Scene("s", earth=earth), [], [one, two])


@earths
@pytest.mark.parametrize("maker", [scenes.touching, scenes.identical, scenes.spans, scenes.hole, scenes.on_the_seam])
def test_known_scenes_at_tolerance_nought(earth: EarthModel, maker: object) -> None:
    known: Known = maker(earth)  # type: ignore[operator]
    _, reported = check(replace(known.scene, tolerance_m=0.0), known.areas, known.tracks)
    assert set(known.expected) <= set(reported)


# All at once


@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(k, marks=pytest.mark.slow) for k in range(4, 100))])
def test_wild_scenes(seed: int) -> None:
    """Every size, latitude, speed and shape at once."""
    check(*throw_wild(seed))


# Empty scenes, and refused objects


def test_nothing_interferes_with_nothing() -> None:
    assert solved(Scene("s"), [], []) == {}
    assert solved(Scene("s"), [UNIT], []) == {}
    assert solved(Scene("s"), [], [track("T", [(0, 0), (1, 1)], [0, HOUR_S])]) == {}


def test_a_key_twice_is_refused() -> None:
    with pytest.raises(InvalidInput, match="A"):
        solved(Scene("s"), [UNIT, UNIT], [])


@pytest.mark.parametrize("lat", [89.01, -89.5, 90.0])
def test_beyond_89_degrees_is_refused(lat: float) -> None:
    far = track("T", [(0, 80 * np.sign(lat)), (0, lat)], [0, HOUR_S])
    with pytest.raises(InvalidInput, match=r"'T'.*89 degrees.*great_circle"):
        solved(Scene("s"), [UNIT], [far])


@earths
def test_meridian_distances_are_what_the_scenes_rest_on(earth: EarthModel) -> None:
    """The quarter of a meridian: 10,001,965.729 m on WGS84 (GeographicLib's published test), R pi / 2 on the sphere."""
    quarter = {EarthModel.WGS84: 10001965.729, EarthModel.SPHERE: 6371008.771415 * np.pi / 2}[earth]
    assert meridian_m(earth, 90.0) == pytest.approx(quarter, abs=1e-3)
