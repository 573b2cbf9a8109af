"""Contacts that end, or begin, as a plan ends, to rounding."""

from datetime import UTC, datetime, timedelta

import ends
import numpy as np
import pyproj
import pytest
import shapely
from draws import draws
from exact_ends import RADIUS_M, Globe, Riders, way_m
from mpmath import mp, mpf
from precise import PreciseGlobe, precise_legs

from conflictdb import Area, Scene, Track, Verdict, solve
from conflictdb.model.plans import EarthModel

T0_US = 1_780_000_000_000_000
AREA = Area("closed", shapely.box(5.05, 56.818, 5.323, 56.905))
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
HAVEN_M = [(-20, 281), (20, 281), (20, -281), (-20, -281)]
# Where the stern, 281 m behind, is at the area's northern side (a geodesic on WGS84), and the contact's first instant.
CLEARS_DEG = 56.90752338860283
MEETS_US = T0_US + 3_027_807_494


def instant_us(at: datetime | None) -> int:
    assert at is not None
    return (at - EPOCH) // timedelta(microseconds=1)


@pytest.mark.parametrize("off_deg", [-1e-9, -1e-12, -1e-14, 0.0, 1e-14, 1e-12, 1e-9])
@pytest.mark.parametrize("tolerance_m", [0.0, 1e-6, 1.0])
def test_a_ship_whose_plan_ends_as_its_stern_clears_the_area_is_in_conflict_until_then(
    tolerance_m: float, off_deg: float
) -> None:
    """The clearance at the excluded end does not decide: 47 minutes of contact before it do."""
    last_us = T0_US + 5_887_000_000
    ship = Track("ship", [(5.1865, 56.718), (5.1865, CLEARS_DEG + off_deg)], [T0_US, last_us], HAVEN_M)
    (found,) = solve([ship], [AREA], Scene("s", tolerance_m=tolerance_m))
    ((start, end),) = ((instant_us(first), instant_us(last)) for first, last in found.periods)
    assert found.verdict is Verdict.CONFLICT
    assert abs(start - MEETS_US) <= 20
    # A thousandth of a millimetre, at 3.6 m/s.
    assert last_us - 50 <= end <= last_us


@draws("scenes", 15, 500)
def test_contacts_that_begin_or_end_at_ends_of_plans_are_right(scenes: int) -> None:
    """None is missed, none is false, and every end is within its bound."""
    total = ends.Count()
    for seed in range(1, 1 + scenes):
        total.add(ends.check(seed, 30))
    assert not total.problems, "\n".join(total.problems)
    assert total.pairs > 20 * scenes


@pytest.mark.parametrize("earth", EarthModel)
def test_the_motion_in_long_double_is_that_in_forty_digits(earth: EarthModel) -> None:
    """To a nanometre, which is less than the kernel rounds by."""
    globe, precise, rng = Globe.of(earth), PreciseGlobe.of(earth), np.random.default_rng(1)
    outline_m = np.array([[700.0, 900.0], [-800.0, 1000.0], [-600.0, -2900.0], [900.0, -400.0]])
    haven = outline_m[None].astype(np.longdouble)
    for size_deg in (2.0, 0.1, 1e-3):
        start = rng.uniform([-170.0, -70.0], [170.0, 70.0])
        way = np.array([[start, start + size_deg * rng.uniform(-1.0, 1.0, 2)]])
        riders = Riders(globe, way, np.array([3600.0], np.longdouble), haven, haven)
        ring = riders.ring(np.array([1234.5], np.longdouble))[0] * globe.a
        with mp.workdps(40):
            (leg,) = precise_legs(precise, Track("t", way[0], [T0_US, T0_US + 3_600_000_000], outline_m))
            for mine, exact in zip(ring, leg.ring(precise, mpf(1234.5)), strict=True):
                for x, y in zip(mine, exact, strict=True):
                    assert abs(mpf(np.format_float_positional(x, unique=False, precision=20)) - y) < 1e-9


@pytest.mark.parametrize("earth", EarthModel)
def test_ways_in_long_double_are_geodesics(earth: EarthModel) -> None:
    """To the rounding of the library, some nanometres, at the lengths of `ends.py`."""
    geodesics = pyproj.Geod(ellps="WGS84") if earth is EarthModel.WGS84 else pyproj.Geod(a=float(RADIUS_M), f=0.0)
    rng = np.random.default_rng(3)
    one = rng.uniform([-170.0, -74.0], [170.0, 74.0], (200, 2))
    lon, lat, _ = geodesics.fwd(*one.T, rng.uniform(-180.0, 180.0, 200), 10.0 ** rng.uniform(2.0, 5.0, 200))
    other = np.stack([lon, lat], axis=1)
    _, _, expected_m = geodesics.inv(*one.T, *other.T)
    found_m = way_m(Globe.of(earth), one.astype(np.longdouble), other.astype(np.longdouble))
    assert np.abs(found_m.astype(np.float64) - expected_m).max() < 2e-8
