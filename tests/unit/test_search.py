"""The search on motions made for it (`swinging`), which meet and come near as often as one likes; answers by hand."""

import numpy as np
import pytest
from swinging import SWING_S, encounters, half_s

from conflictdb.arrays.answers import Contacts
from conflictdb.earth.geodesy import earth_of
from conflictdb.model import EarthModel
from conflictdb.motion.mercator import Mercator
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.search import CONFLICT, GRAZING, UNRESOLVED, search


def searched(pairs: Encounters, tolerance_m: float, low_s: float, high_s: float) -> Contacts:
    n = len(pairs)
    return search(pairs, tolerance_m, np.full(n, low_s), np.full(n, high_s), np.full(n, np.inf), None)


@pytest.mark.parametrize("least_m", [-1.0, -99.0, -0.01])
@pytest.mark.parametrize(("low_s", "high_s"), [(0.0, 500.0), (10.0, 1000.0), (50.0, 950.0)])
def test_every_contact_of_many_is_found_with_its_ends(least_m: float, low_s: float, high_s: float) -> None:
    """Also from contact to contact, where the window begins and ends in one."""
    found = searched(encounters([least_m]), 0.0, low_s, high_s)
    swings = np.arange(50.0, high_s + 1.0, 100.0)
    wanted = np.stack([swings - half_s(least_m), swings + half_s(least_m)]).clip(low_s, high_s)
    wanted = wanted[:, wanted[0] < wanted[1]]
    assert found.verdict.tolist() == [CONFLICT] * wanted.shape[1]
    assert found.touches.all()
    for given, true, outward in ((found.start_s, wanted[0], -1.0), (found.end_s, wanted[1], 1.0)):
        further = outward * (given - true)
        assert (further >= -1e-9).all()
        assert (further <= found.error_s + 1e-9).all()
    # The last 1e-7 m take so long.
    assert found.error_s.max() < 4e-7 / (2.0 * np.pi / SWING_S * np.sqrt(min(-least_m, 50.0) * 50.0)) + 2e-6


@pytest.mark.parametrize(("low_s", "high_s"), [(20.0, 90.0), (1.0, 53.3), (48.0, 99.0)])
@pytest.mark.parametrize(("least_m", "touches"), [(-0.5, True), (0.0, True), (0.1, False), (0.5, False)])
def test_what_is_within_the_tolerance_grazes(least_m: float, touches: bool, low_s: float, high_s: float) -> None:
    """And it is told when; beyond the tolerance it is clear, deeper than it in conflict."""
    found = searched(encounters([least_m, 1.5, -1.5]), 1.0, low_s, high_s)
    assert found.pair.tolist() == [0, 2]
    assert found.verdict.tolist() == [GRAZING, CONFLICT]
    assert found.touches.tolist() == [touches, True]
    half = half_s(least_m, 0.0 if touches else 1.0)
    for outside_s in (max(50.0 - half, low_s) - found.start_s[0], found.end_s[0] - min(50.0 + half, high_s)):
        assert -1e-9 <= outside_s <= found.error_s[0] + 1e-9


def test_what_may_be_further_apart_than_the_tolerance_is_unresolved() -> None:
    """3,000 km apart on the ellipsoid distances are understated by up to a metre: more than a tolerance of 0.5 m."""
    far_m = 3e6
    plane = Mercator(earth_of(EarthModel.WGS84))
    error_m = float(plane.distance_error_m(far_m))
    assert 0.9 < error_m < 1.0
    pairs = encounters([error_m + 0.2, error_m + 0.8, 0.2 * error_m, -3.0], far_m, EarthModel.WGS84)
    found = searched(pairs, 0.5, 20.0, 90.0)
    assert found.pair.tolist() == [0, 2, 3]
    assert found.verdict.tolist() == [UNRESOLVED, UNRESOLVED, CONFLICT]
