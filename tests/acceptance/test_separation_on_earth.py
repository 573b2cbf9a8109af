"""The required separation is the least distance on the earth, which need not be at the plane's nearest points.

Strips between meridians are narrowest nearer the pole, by 1.7 km at 60 to 62 degrees and 50 km apart, and constant all
along in the plane. The answers rest on geodesics between known points; those of moving pairs also on the oracle.
"""

from dataclasses import replace

import numpy as np
import oracle
import pytest
import shapely
from oracle_motion import Globe
from pyproj import Geod
from scenes import HOUR_S, T0_US, area, track
from verdicts import Reported, compared, solved

from conflictdb.model.plans import Area, EarthModel, Scene, Track
from conflictdb.model.results import Verdict

earths = pytest.mark.parametrize("earth", EarthModel)
# From the latitude nearer the equator to the one nearer the pole.
BANDS = [(60.0, 62.0), (-60.0, -62.0), (-1.0, 3.0), (1.0, -3.0), (75.0, 80.0), (-40.0, -40.5)]
bands = pytest.mark.parametrize(("equatorial", "polar"), BANDS)
some_bands = pytest.mark.parametrize(
    ("equatorial", "polar"), [BANDS[0], *(pytest.param(*band, marks=pytest.mark.slow) for band in BANDS[1:])]
)
slow = pytest.mark.slow  # the oracle takes minutes where the distance hardly changes all day


def geodesic_m(earth: EarthModel, lon: float, lat: float) -> float:
    """Metres between two points of a parallel, by the geodesic, for a difference of longitude."""
    globe = Globe.of(earth)
    return float(Geod(a=globe.a, es=globe.e2).inv(0.0, lat, lon, lat)[2])


def strip(key: str, west: float, east: float, one: float, two: float) -> Area:
    return area(key, shapely.box(west, min(one, two), east, max(one, two)))


def scene_of(earth: EarthModel, separation_m: float, tolerance_m: float = 0.01) -> Scene:
    return Scene("s", earth=earth, tolerance_m=tolerance_m, separation_m=separation_m)


def check(scene: Scene, areas: list[Area], tracks: list[Track]) -> dict[tuple[str, str], Reported]:
    """Solve, compare with the oracle, and nothing may be wrong or left open."""
    reported = solved(scene, areas, tracks)
    result = compared(scene, areas, tracks, reported)
    assert not result.wrong
    assert result.unresolved == 0
    return reported


@earths
@bands
@pytest.mark.parametrize("reverse", [False, True])
def test_strips_between_meridians(earth: EarthModel, equatorial: float, polar: float, reverse: bool) -> None:
    """Reported exactly when the separation is more than the distance at the end nearer the pole."""
    zones = [strip("A", 0.0, 1.0, equatorial, polar), strip("B", 1.5, 2.5, equatorial, polar)]
    if reverse:
        zones = [replace(zones[0], key="B"), replace(zones[1], key="A")]
    narrow, wide = geodesic_m(earth, 0.5, polar), geodesic_m(earth, 0.5, equatorial)
    assert narrow < wide - 5.0
    for separation_m, verdict in (
        (narrow - 1.0, None),
        (narrow + 1.0, Verdict.CONFLICT),
        ((narrow + wide) / 2, Verdict.CONFLICT),
        (wide - 1.0, Verdict.CONFLICT),
        (wide + 1.0, Verdict.CONFLICT),
    ):
        reported = solved(scene_of(earth, separation_m), zones, [])
        assert (reported["A", "B"].verdict if reported else None) is verdict, separation_m


@earths
@pytest.mark.parametrize("seam", [0.0, 178.75])
def test_strips_of_unequal_height(earth: EarthModel, seam: float) -> None:
    """The nearest places are a corner and a point along an edge, near neither end of it; also across 180 degrees."""
    globe = Globe.of(earth)
    zones = [strip("A", seam, seam + 1, 58.0, 60.5), strip("B", seam + 1.5, seam + 2.5, 60.0, 64.0)]
    lat = np.linspace(60.0, 64.0, 40001)
    geodesic = Geod(a=globe.a, es=globe.e2)
    metres = geodesic.inv(np.zeros(40001), np.full(40001, 60.5), np.full(40001, 0.5), lat)[2]
    narrow = float(metres.min())
    assert metres[0] > narrow + 50.0
    for separation_m, meets in ((narrow - 0.1, False), (narrow + 0.1, True), (narrow + 20.0, True)):
        assert bool(solved(scene_of(earth, separation_m), zones, [])) is meets


@earths
@some_bands
def test_a_haven_beside_a_strip(earth: EarthModel, equatorial: float, polar: float) -> None:
    """It stands still off a strip between meridians, much higher than the distance; and then it comes nearer."""
    zone = strip("A", 0.0, 1.0, equatorial, polar)
    middle = (equatorial + polar) / 2
    half = abs(polar - equatorial) / 2 * 111e3 * 0.9
    waits = track("T", [(2.0, middle), (2.0, middle)], [0, HOUR_S], half, half, 1000.0, 1000.0)
    comes = track("U", [(3.0, middle), (1.3, middle)], [0, 5 * HOUR_S], 1000.0, 1000.0, half, half)
    oblique = track("V", [(3.0, middle), (1.4, polar)], [0, 5 * HOUR_S], 1000.0, 1000.0, half / 2, half / 2)
    at_rest = oracle.meeting(Scene("s", earth=earth), zone, waits, care_m=1e9).least_m
    for separation_m in (at_rest - 5.0, at_rest + 5.0, at_rest * 1.01):
        reported = check(scene_of(earth, separation_m), [zone], [waits, comes, oblique])
        assert (("A", "T") in reported) is (separation_m > at_rest)
        assert {("A", "U"), ("A", "V")} <= set(reported)


@slow
@earths
@bands
def test_havens_beside_each_other(earth: EarthModel, equatorial: float, polar: float) -> None:
    """Side by side towards the pole, whose meridians converge, and away from it; then one turns towards the other."""
    half = 50e3
    points = [(0.0, equatorial), (0.0, polar)]
    aside = [(0.7, equatorial), (0.7, polar)]
    day = [0.0, 24 * HOUR_S]
    one = track("a", points, day, half, half, 1000.0, 1000.0)
    two = track("b", aside, day, half, half, 1000.0, 1000.0)
    away = track("c", [(1.6, polar), (1.6, equatorial)], day, half, half, 1000.0, 1000.0)
    near = oracle.meeting(Scene("s", earth=earth), one, two, care_m=1e9).least_m
    for separation_m in (near - 5.0, near + 5.0, near * 1.02):
        reported = check(scene_of(earth, separation_m), [], [one, two, away])
        assert (("a", "b") in reported) is (separation_m > near)


@earths
def test_havens_that_pass_at_a_distance(earth: EarthModel) -> None:
    """Long sides along meridians pass each other; in contact from one instant to another, not at one place."""
    half = 100e3
    one = track("a", [(0.0, 59.0), (0.0, 63.0)], [0, 24 * HOUR_S], half, half, 5e3, 5e3)
    two = track("b", [(0.9, 63.0), (0.9, 59.0)], [0, 24 * HOUR_S], half, half, 5e3, 5e3)
    zone = strip("A", 0.5, 0.6, 60.9, 61.1)
    least = oracle.meeting(Scene("s", earth=earth), one, two, care_m=1e9).least_m
    for separation_m in (least * 1.001, least * 1.05):
        reported = check(scene_of(earth, separation_m), [zone], [one, two])
        assert ("a", "b") in reported
        assert reported["a", "b"].periods_us[0][0] is not None
        assert reported["a", "b"].periods_us[0][0] > T0_US
