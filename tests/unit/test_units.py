"""Distances and places in nautical and metric units."""

import pytest

from conflictdb.model.margin import Margin
from conflictdb.model.units import Units


@pytest.mark.parametrize(
    ("lon", "lat", "nautical", "metric"),
    [
        (8.76, 57.905, "57°54.300'N 008°45.600'E", "57.90500 N 8.76000 E"),
        (181.0, -2.0, "02°00.000'S 179°00.000'W", "2.00000 S 179.00000 W"),
        (-0.0001, 0.0, "00°00.000'N 000°00.006'W", "0.00000 N 0.00010 W"),
        (9.99999999, 59.99999999, "60°00.000'N 010°00.000'E", "60.00000 N 10.00000 E"),
        (-180.0, 90.0, "90°00.000'N 180°00.000'W", "90.00000 N 180.00000 W"),
    ],
)
def test_a_place_in_degrees_and_minutes_or_decimal_degrees(lon: float, lat: float, nautical: str, metric: str) -> None:
    assert Units.NAUTICAL.place(lon, lat) == nautical
    assert Units.METRIC.place(lon, lat) == metric


def test_a_distance_is_in_the_unit_that_fits_it() -> None:
    assert [Units.METRIC.least_distance(m) for m in (9.94, 12.0, 99.0, 100.0, 8704.4)] == [
        *("9.9 m", "12 m", "99 m", "0.1 km", "8.7 km"),
    ]
    assert [Units.NAUTICAL.least_distance(m) for m in (370.0, 371.0, 184.9, 1851.9, 0.19)] == [
        *("0.1 nmi", "0.2 nmi", "184 m", "0.9 nmi", "0.1 m"),
    ]


@pytest.mark.parametrize("units", Units)
@pytest.mark.parametrize("metres", [0.0, 0.04, 9.91, 9.99, 42.4, 99.99, 185.1, 185.3, 370.4, 1_000_000.0])
def test_what_is_rounded_stays_true(units: Units, metres: float) -> None:
    """1000 km are at least 539.9 nmi, and at most 540.0."""
    metres_of = {"m": 1.0, "km": 1000.0, "nmi": 1852.0}
    least, most = (
        float(text.split()[0]) * metres_of[text.split()[1]]
        for text in (units.least_distance(metres), units.most_distance(metres))
    )
    assert least <= metres * (1 + 1e-9)
    assert most >= metres * (1 - 1e-9)
    assert most - least <= (units.step_m if metres >= units.step_m - 1.0 else 1.0) + 1e-6


def test_a_distance_that_must_be_kept_is_rounded_up() -> None:
    """The error of a product is no part of a tenth: 31 steps of 185.2 m are 3.1 nmi, not 3.2 or 3.0."""
    assert [Units.NAUTICAL.most_distance(m) for m in (371.0, 31 * 185.2, 12.1)] == ["0.3 nmi", "3.1 nmi", "13 m"]
    assert [Units.NAUTICAL.least_distance(n * 185.2) for n in (31, 33, 57)] == ["3.1 nmi", "3.3 nmi", "5.7 nmi"]


def test_a_proposed_distance_is_not_rounded() -> None:
    """To a tenth of the unit only if it is one: 3.1 nautical miles are 5.7412 km, and 5.7 would be too near."""
    assert [Units.NAUTICAL.exact_distance(m) for m in (3.1 * 1852.0, 5700.0)] == ["3.1 nmi", "5700.0 m"]
    assert [Units.METRIC.exact_distance(m) for m in (3.1 * 1852.0, 5700.0, 42.31)] == ["5741.2 m", "5.7 km", "42.4 m"]


def test_limits_and_speeds_of_a_load_are_in_the_units() -> None:
    assert (Units.NAUTICAL.bound(57.6867, "NS"), Units.METRIC.bound(190.0, "EW")) == ("57°41'N", "170.00 W")
    assert (Units.NAUTICAL.speed(18.0), Units.NAUTICAL.speed_unit) == (18.0, "kn")
    assert (Units.METRIC.speed(18.0), Units.METRIC.speed_unit) == (pytest.approx(9.26), "m/s")


def test_a_margin_is_said_as_it_was_given() -> None:
    """To hundredths of the unit, else in metres; no more than was given is promised."""
    assert [Units.NAUTICAL.given_distance(m) for m in (926.0, 1000.0, 0.1)] == ["0.5 nmi", "1000 m", "0.1 m"]
    assert [Units.METRIC.given_distance(m) for m in (926.0, 1000.0, 2050.0)] == ["926 m", "1 km", "2.05 km"]
    assert Margin(distance_m=2000.0).text(Units.METRIC) == "clear by 2 km"
    assert Margin(300_000_000, 926.0).text() == "clear by 5 min and 0.5 nmi"
