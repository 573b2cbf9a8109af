"""Rhumb lines against reference data, 50 digits, and themselves."""

import csv
from functools import cache
from pathlib import Path

import kernel_planes
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf
from precise import PreciseGlobe
from reference import data

from conflictdb.earth.geodesy import (
    direction_of,
    earth_of,
    rhumb_direct,
    rhumb_distance,
    rhumb_inverse,
    shorter_way_deg,
)
from conflictdb.earth.mercator import Mercator
from conflictdb.model.plans import EarthModel

WGS84 = earth_of(EarthModel.WGS84)


def columns(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline="") as file:
        table = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in table]) for name in table[0] if name != "kind"}


def test_lengths_and_bearings_agree_with_the_reference() -> None:
    table = columns(data("rhumb", "rhumb_inverse_wgs84.csv"))
    ends = [table[name] for name in ("lon1", "lat1", "lon2", "lat2")]
    length, bearing = rhumb_inverse(WGS84, *ends)
    np.testing.assert_allclose(length, table["s12_m_mpmath40"], rtol=1e-9)
    turned = (bearing - table["azi12_mpmath40"] + 180.0) % 360.0 - 180.0
    # A millionth of a metre across at the far end.
    assert (np.abs(np.radians(turned)) * length).max() < 1e-6
    sphere = rhumb_distance(earth_of(EarthModel.SPHERE), *ends)
    np.testing.assert_allclose(sphere, table["s12_m_sphere_R6371008.771415_RhumbSolve"], rtol=1e-9)


def test_positions_agree_with_the_reference() -> None:
    table = columns(data("rhumb", "rhumb_direct_wgs84.csv"))
    lon, lat = rhumb_direct(WGS84, table["lon1"], table["lat1"], table["azi12"], table["s12_m"])
    east = np.radians((lon - table["lon2_RhumbSolve"] + 180.0) % 360.0 - 180.0) * np.cos(np.radians(lat))
    assert (6378137.0 * np.hypot(east, np.radians(lat - table["lat2_RhumbSolve"]))).max() < 1e-5


BEARINGS = [
    quarter + sign * away
    for quarter in (0.0, 90.0, 180.0, 270.0)
    for away in (0.0, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 1.0)
    for sign in (1.0, -1.0)
]


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize(
    ("lat", "distance_m"), [(0.0, 2e5), (45.0, 1e-3), (-60.0, 1e3), (30.0, 1e6), (80.0, 5e5), (-88.0, 5e4)]
)
def test_steps_at_every_bearing_agree_with_thirty_digits(earth: EarthModel, lat: float, distance_m: float) -> None:
    lon, found = rhumb_direct(earth_of(earth), 10.0, lat, np.array(BEARINGS), distance_m)
    with mp.workdps(30):
        globe = PreciseGlobe.of(earth)
        for k, bearing in enumerate(BEARINGS):
            course = mp.radians(mpf(bearing))
            x, y = globe.step(
                mp.radians(10), mp.radians(mpf(lat)), distance_m * mp.cos(course), distance_m * mp.sin(course)
            )
            east = (x - mp.radians(mpf(float(lon[k])))) * globe.across_m(y)
            north = (y - mp.radians(mpf(float(found[k])))) * globe.along_m(y)
            assert mp.hypot(east, north) < 2e-8, bearing


@pytest.mark.parametrize("earth", EarthModel)
def test_lengths_near_east_west_agree_with_thirty_digits(earth: EarthModel) -> None:
    for lat in (0.0, 20.0, -55.0, 85.0, 88.9):
        for dlat in (0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-5, 1e-2):
            found = float(rhumb_distance(earth_of(earth), -170.0, lat, 175.0, lat + dlat))
            with mp.workdps(30):
                exact = PreciseGlobe.of(earth).length_m(-170.0, lat, -185.0, lat + dlat)
                assert abs(found / exact - 1) < 1e-12


@pytest.mark.parametrize("earth", EarthModel)
def test_divided_differences_and_derivatives_agree_with_thirty_digits(earth: EarthModel) -> None:
    """Those of psi as a function of mu, here and in the kernel; differenced and derived in 30 digits."""
    figure = earth_of(earth)
    plane = Mercator(figure)
    with mp.workdps(40):
        globe = PreciseGlobe.of(earth)
        rectifying = globe.meridian_m(mp.pi / 2) / (mp.pi / 2)
        assert abs(figure.rectifying_m / rectifying - 1) < 1e-15

        @cache
        def latitude(mu: mpf) -> mpf:
            return globe.latitude_of_meridian(mu * rectifying)

        def psi(mu: mpf) -> mpf:
            return globe.isometric(latitude(mu))

        def slope(mu: mpf) -> mpf:
            return rectifying / globe.across_m(latitude(mu))

        for mu1 in (0.0, 0.5, -1.2, 1.5):
            for step in (0.0, 1e-13, 1e-9, 1e-5, -0.04):
                a, b = mpf(mu1), mpf(mu1) + mpf(step)
                mu2 = float(b)
                b = mpf(mu2)
                exact = slope(a) if a == b else (psi(b) - psi(a)) / (b - a)
                for found in (float(figure.stretch(mu1, mu2)), kernel_planes.stretch(plane, mu1, mu2)):
                    assert abs(found / exact - 1) < 1e-12
            assert abs(kernel_planes.slope(plane, mu1) / slope(mpf(mu1)) - 1) < 1e-13


@given(st.sampled_from(list(EarthModel)), st.floats(-89.4, 89.4), st.floats(-360, 360))
def test_plane_and_back(earth: EarthModel, lat: float, lon: float) -> None:
    figure = earth_of(earth)
    back = figure.from_plane(*figure.to_plane(lon, lat))
    np.testing.assert_allclose(back, (lon, lat), atol=1e-12, rtol=0)
    mu = figure.rectifying(np.radians(lat))
    np.testing.assert_allclose(np.degrees(figure.latitude(figure.isometric(mu))), lat, atol=1e-12, rtol=0)
    np.testing.assert_allclose(figure.rectifying(figure.latitude(figure.isometric(mu))), mu, atol=1e-14, rtol=0)


@settings(max_examples=300)
@given(
    st.sampled_from(list(EarthModel)),
    st.floats(-88, 88),
    st.floats(-180, 180),
    st.floats(-88, 88),
    st.floats(-179, 179),
)
def test_inverse_and_direct_are_inverse(earth: EarthModel, lat1: float, lon1: float, lat2: float, dlon: float) -> None:
    figure = earth_of(earth)
    length, bearing = rhumb_inverse(figure, lon1, lat1, lon1 + dlon, lat2)
    lon, lat = rhumb_direct(figure, lon1, lat1, bearing, length)
    east = np.radians(lon - (lon1 + dlon)) * np.cos(np.radians(lat2))
    # The bearing in degrees has 16 digits: over 10,000 km and at 88 degrees that is a fraction of a millimetre.
    assert 6.4e6 * np.hypot(east, np.radians(lat - lat2)) < 1e-4


def test_plane_is_epsg_3395() -> None:
    """Figures of the EPSG registry's own kind: the world's extent at 80 S to 84 N."""
    x, y = WGS84.to_plane([-180.0, 180.0, 0.0], [-80.0, 84.0, 0.0])
    np.testing.assert_allclose(x, [-20037508.342789244, 20037508.342789244, 0.0], rtol=1e-15)
    np.testing.assert_allclose(y, [-15496570.739723722, 18764656.231380563, 0.0], rtol=1e-13)


def test_directions_are_exact_at_quarters() -> None:
    east, north = direction_of([0.0, 90.0, 180.0, 270.0, -90.0, 360.0, -180.0])
    assert east.tolist() == [0, 1, 0, -1, -1, 0, 0]
    assert north.tolist() == [1, 0, -1, 0, 0, 1, -1]


def test_shorter_way_keeps_digits_and_the_sign_of_half_a_turn() -> None:
    turns = [180.0, -180.0, 0.1, 190.0, -359.0]
    assert shorter_way_deg(turns).tolist() == [180.0, -180.0, 0.1, -170.0, 1.0]


def test_beyond_the_pole_there_is_no_position() -> None:
    lon, lat = rhumb_direct(WGS84, 0.0, 89.0, [0.0, 180.0], 2e5)
    assert np.isnan([lon[0], lat[0]]).all()
    assert np.isfinite([lon[1], lat[1]]).all()
