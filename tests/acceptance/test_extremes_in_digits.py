"""Extremes compared with more digits than the product and the float oracle have, or with exact answers.

The end of every period is examined in 30 digits: just outside it, by more than the reported bound, the pair is apart,
and just inside it touches. `test_extremes.py` lists the test of each extreme.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import shapely
from mpmath import mp, mpf
from precise import separation
from scenes import HOUR_S, T0_US, area, meridian_m, parallel_m, track
from verdicts import CERTIFIED, ROUNDING_S, Reported, solved

from conflictdb.errors import InvalidInput
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, EarthModel, Scene, Track
from conflictdb.model.results import Verdict

earths = pytest.mark.parametrize("earth", EarthModel)
methods = pytest.mark.parametrize("method", CERTIFIED)

DIGITS = 30
UNIT = area("A", shapely.box(0, 0, 1, 1))
YEAR_S = 365.25 * 24 * HOUR_S


def line(shape: Sequence[tuple[float, float]], seconds: float, **sizes: float) -> Track:
    return track("T", list(shape), [seconds * k / (len(shape) - 1) for k in range(len(shape))], **sizes)


SMALL = {"fore": 0.005, "aft": 0.005, "port": 0.005, "starboard": 0.005}
HUGE = {"fore": 463e3, "aft": 463e3, "port": 463e3, "starboard": 463e3}
PAIRS = {
    "at 89 degrees": (area("A", shapely.box(-20, 88.5, 20, 88.9)), line([(-90, 88.7), (80, 88.99)], 24 * HOUR_S)),
    "at 89 degrees south": (area("A", shapely.box(-20, -88.9, 20, -88.5)), line([(80, -88.9), (-90, -88.6)], 1e5)),
    "across the seam": (area("A", shapely.box(179.5, -1, 180.5, 1)), line([(178, -1), (-178, 1)], 4 * HOUR_S)),
    "a leg of ten thousand miles": (area("A", shapely.box(-60, 2, -58, 30)), line([(60, -40), (-110, 35)], 1.5e6)),
    "a leg of a millimetre": (UNIT, line([(-5000.001 / 111319.5, 0.5), (-4999.999 / 111319.5, 0.5)], HOUR_S)),
    "a millionth of a knot": (UNIT, line([(-0.0450, 0.5), (-0.0449, 0.5)], 22.2 / 5.1e-7)),
    "two thousand knots": (UNIT, line([(-10, -10), (12, 12)], 1800.0)),
    "a century": (UNIT, line([(-1, 0.5), (2, 0.7)], 100 * YEAR_S)),
    "eight millennia": (
        area("A", shapely.box(4.0, 57.0, 4.6, 57.3)),
        line([(3.5, 57.1), (5.0, 57.15)], 7900 * YEAR_S, fore=100.0, aft=100.0, port=100.0, starboard=100.0),
    ),
    "a centimetre": (UNIT, line([(-1, 0.2), (2, 0.7)], 3 * HOUR_S, **SMALL)),
    "five hundred miles": (area("A", shapely.box(40, 60, 45, 62)), line([(0, 40), (35, 62)], 10 * HOUR_S, **HUGE)),
    "a metre": (
        area("A", shapely.box(8, 47, 8 + 1e-5, 47 + 1e-5)),
        line([(8 - 1e-5, 47 + 4e-6), (8 + 2e-5, 47 + 6e-6)], 60.0, fore=0.1, aft=0.1, port=0.05, starboard=0.05),
    ),
    "half a turn": (area("A", shapely.box(100, -1, 120, 1)), line([(0, 0), (180, 0)], 100 * HOUR_S)),
    "twice in a leg": (
        area("A", shapely.Polygon([(2, -1), (5, -1), (5, 1), (4, 1), (4, -0.8), (3, -0.8), (3, 1), (2, 1)])),
        line([(0, 0.1), (20, 0.3)], 20 * HOUR_S, fore=2000.0, aft=1000.0, port=500.0, starboard=500.0),
    ),
}
CASES = {
    **PAIRS,
    **{
        f"{quarter} degrees and 1e-{digits} of one": (
            area("A", shapely.box(9.9, 59.9, 10.1, 60.1)),
            line(
                [
                    tuple(np.array([10.0, 60.0]) - step * (1.0, 0.5)),
                    tuple(np.array([10.0, 60.0]) + step * (1.0, 0.5)),
                ],
                HOUR_S,
            ),
        )
        for quarter in (0, 90, 180, 270)
        for digits in (9, 15)
        for bearing in [np.radians(quarter) + np.radians(10.0**-digits)]
        for step in [np.array([np.sin(bearing), np.cos(bearing)])]
    },
}

# Largest bound of an end, seconds: tenths of a micrometre at the speed at which the pair meets. A wider bound would
# excuse any end.
BOUND_S = dict.fromkeys(CASES, 1e-5) | {
    "a millionth of a knot": 1.0,
    "a century": 0.01,
    "eight millennia": 2.0,
}


def touches(scene: Scene, one: Area, two: Track, second: mpf) -> bool:
    return separation(scene, one, two, second, int(two.times_us[0])) == 0


@methods
@earths
@pytest.mark.parametrize("name", CASES)
def test_ends_in_thirty_digits(name: str, earth: EarthModel, method: Method) -> None:
    one, two = CASES[name]
    scene = Scene("s", earth=earth, tolerance_m=0.0, method=method)
    found = solved(scene, [one], [two])["A", "T"]
    assert found.verdict is Verdict.CONFLICT
    assert len(found.periods_us) == 1 + (name == "twice in a leg")
    assert found.time_error_s <= BOUND_S[name]
    zero, last = int(two.times_us[0]), int(two.times_us[-1])
    allowed = mpf(found.time_error_s + ROUNDING_S)
    with mp.workdps(DIGITS):
        for start, end in found.periods_us:
            assert start is not None
            assert end is not None
            middle = mpf(start + end - 2 * zero) / 2_000_000
            for instant, outward in ((start, -1), (end, 1)):
                second = mpf(instant - zero) / 1_000_000
                outside, inside = second + outward * allowed, second - outward * allowed
                inside = middle if (inside - middle) * outward < 0 else inside
                assert touches(scene, one, two, inside), f"{instant} is too early or late, or no end at all"
                if 0 <= outside <= mpf(last - zero) / 1_000_000:
                    assert not touches(scene, one, two, outside), f"there is contact beyond {instant}"


def verdict_of(found: dict[tuple[str, str], Reported]) -> Verdict | None:
    (one,) = found.values() or (None,)
    return one and one.verdict


@methods
def test_closing_at_a_nanometre_a_second(method: Method) -> None:
    """Rounding shifts times by minutes there, and tracks are cut within them: the bound is right across the cuts."""
    lons_a, lons_b = (0.0, 0.3233935022830277), (0.0008983153002891965, 0.3242918175509776)
    two = [
        track(key, [(lon, 0.0) for lon in lons], [0, HOUR_S], 50.0, 50.0, 10.0, 10.0)
        for key, lons in (("a", lons_a), ("b", lons_b))
    ]
    found = solved(Scene("s", tolerance_m=0.0, method=method), [], two)["a", "b"]
    with mp.workdps(DIGITS):
        first, last = (mpf(b) - mpf(a) for a, b in zip(lons_a, lons_b, strict=True))
        begins = HOUR_S * (first - 100 / (mpf(6378137) * mp.pi / 180)) / (first - last)
    ((start_us, end_us),) = found.periods_us
    assert end_us == T0_US + round(HOUR_S * 1e6)
    start_s = (start_us - T0_US) / 1e6
    assert start_s <= begins <= start_s + found.time_error_s
    assert found.time_error_s < 200.0


@methods
@earths
@pytest.mark.parametrize("lat", [0.0, -50.0, 75.0])
def test_side_by_side_at_one_speed(earth: EarthModel, method: Method, lat: float) -> None:
    """One ahead of the other, touching exactly all day; a millimetre nearer is contact, further apart is not."""
    degree = parallel_m(earth, lat)
    day = 24 * HOUR_S
    for apart_m, verdicts in ((-1e-3, {Verdict.CONFLICT}), (0.0, set(Verdict)), (1e-3, {None})):
        ahead = (10000.0 + apart_m) / degree
        two = [
            track("a", [(0, lat), (5, lat)], [0, day], 5000, 5000, 100, 100),
            track("b", [(ahead, lat), (5 + ahead, lat)], [0, day], 5000, 5000, 100, 100),
        ]
        found = solved(Scene("s", earth=earth, tolerance_m=0.0, method=method), [], two)
        assert verdict_of(found) in verdicts, apart_m
        if found:
            assert found["a", "b"].periods_us == ((T0_US, T0_US + round(day * 1e6)),)


@methods
def test_abreast_at_one_speed_along_the_equator(method: Method) -> None:
    """Side to side instead, on either side of it: as deep as they are all day, or as far apart."""
    metre = 1.0 / meridian_m(EarthModel.SPHERE, 1.0)
    for apart_m, verdict in ((-1e-2, Verdict.CONFLICT), (1e-2, None)):
        aside = (5000.0 + apart_m / 2) * metre
        two = [
            track(key, [(0, y), (5, y)], [0, 24 * HOUR_S], 900, 900, 5000, 5000)
            for key, y in (("a", aside), ("b", -aside))
        ]
        found = solved(Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0, method=method), [], two)
        assert verdict_of(found) is verdict, apart_m


@methods
@earths
def test_area_rings_as_they_come(earth: EarthModel, method: Method) -> None:
    """Either way round, with repeated corners and corners on a straight side: the same area, the same answer."""
    corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    rings = {
        "plain": corners,
        "other way": corners[::-1],
        "repeated": [c for c in corners for _ in range(3)],
        "straight": [(0.0, 0.0), (0.25, 0.0), (0.5, 0.0), (1.0, 0.0), (1.0, 0.3), (1.0, 1.0), (0.0, 1.0), (0.0, 0.1)],
        "later": corners[2:] + corners[:2],
    }
    moving = track("T", [(-1, 0.2), (2, 0.7)], [0, 3 * HOUR_S])
    scene = Scene("s", earth=earth, tolerance_m=0.0, method=method)
    answers = [solved(scene, [area("A", shapely.Polygon(ring))], [moving])["A", "T"] for ring in rings.values()]
    for one in answers[1:]:
        assert one.verdict is answers[0].verdict
        assert np.abs(np.subtract(one.periods_us, answers[0].periods_us)).max() <= 2


@earths
@pytest.mark.parametrize("top", [90.0, -90.0, 89.5])
def test_area_that_holds_a_pole_is_refused(earth: EarthModel, top: float) -> None:
    """As a box up to it; the error names the object, the limit and what to do instead."""
    low, high = sorted((top, np.sign(top) * 80.0))
    cap = area("cap", shapely.box(-180, low, 180, high))
    with pytest.raises(InvalidInput, match=r"'cap'.*89 degrees.*great_circle"):
        solved(Scene("s", earth=earth), [cap], [])


@methods
def test_contact_that_begins_where_a_span_ends(method: Method) -> None:
    """The last instant does not belong to a span: a microsecond earlier there is no contact, one later there is."""
    degree = parallel_m(EarthModel.SPHERE, 0.0)
    moving = track("T", [(0, 0), (10, 0)], [0, 10 * HOUR_S], 5000, 5000, 100, 100)
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0, method=method)
    west = 3.0 + 5000.0 / degree  # reached at 3 hours
    for late_us, expected in ((-100, False), (100, True)):
        zone = replace(area("A", shapely.box(west, -1, 5, 1)), end_us=T0_US + round(3 * HOUR_S * 1e6) + late_us)
        assert bool(solved(scene, [zone], [moving])) is expected


@methods
@pytest.mark.parametrize("speed_mps", [10.0, 1000.0])
def test_contact_of_the_last_fraction_of_a_microsecond_is_reported(speed_mps: float, method: Method) -> None:
    """A contact counts if it is deeper than 0.25 um at the span's end; not if it begins at that instant."""
    degree = parallel_m(EarthModel.SPHERE, 0.0)
    moving = track("T", [(0, 0), (1000.0 * speed_mps / degree, 0)], [0, 1000.0], 100.0, 100.0, 100.0, 100.0)
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0, method=method)
    for early_s, expected in ((7e-7, True), (4e-7, True), (1e-7, True), (3e-8, True), (0.0, False), (-1e-6, False)):
        west = (speed_mps * (500.0 - early_s) + 100.0) / degree
        found = solved(scene, [area("A", shapely.box(west, -0.5, west + 0.5, 0.5), end_s=500.0)], [moving])
        assert [one.verdict for one in found.values()] == [Verdict.CONFLICT] * expected
        for one in found.values():
            ((start_us, end_us),) = one.periods_us
            assert (T0_US + 500_000_000 - start_us, end_us) == (1, T0_US + 500_000_000)
