"""Contacts that end, or begin, as a plan ends, to rounding."""

from datetime import UTC, datetime, timedelta

import pytest
import shapely

from conflictdb import Area, Scene, Track, Verdict, solve

T0_US = 1_780_000_000_000_000
AREA = Area("closed", shapely.box(5.05, 56.818, 5.323, 56.905))
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
HAVEN_M = [(-20, 281), (20, 281), (20, -281), (-20, -281)]
# Where the stern, 281 m behind, is at the area's northern side (a geodesic on WGS84), and the contact's first instant.
CLEARS_DEG = 56.90752338860283
MEETS_US = T0_US + 3_027_807_494


def instant_us(at: datetime) -> int:
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
