"""Distances, speeds and places in the units that a person has chosen."""

import math
from enum import StrEnum
from typing import Final

from conflictdb.model.place_text import minutes_text

METRES_PER_NMI: Final = 1852.0  # exact, by definition
_METRES_PER_KM: Final = 1000.0
_MPS_OF_KN: Final = METRES_PER_NMI / 3600.0
# Of tenths: the error of a product of doubles is no part of one.
_ROUNDING: Final = 1e-6


class Units(StrEnum):
    """Nautical miles, knots, degrees and minutes; or kilometres, metres a second, decimal degrees."""

    NAUTICAL = "nautical"
    METRIC = "metric"

    @property
    def step_m(self) -> float:
        """A tenth of the larger unit, metres: distances that are proposed are whole numbers of these."""
        return (METRES_PER_NMI if self is Units.NAUTICAL else _METRES_PER_KM) / 10.0

    @property
    def _name(self) -> str:
        return "nmi" if self is Units.NAUTICAL else "km"

    def least_distance(self, metres: float) -> str:
        """Return a distance that something has at least (apart, off, clear), rounded down.

        To a tenth of the larger unit, below a tenth of it to a metre, below 10 m to a tenth of one. What is rounded
        stays true: 1000 km within which nothing comes are 539.9 nmi, not 540.
        """
        tenths = math.floor(metres / self.step_m + _ROUNDING)
        if tenths:
            return f"{tenths / 10} {self._name}"
        return f"{int(metres)} m" if metres >= 10.0 else f"{int(10.0 * metres) / 10.0} m"

    def most_distance(self, metres: float) -> str:
        """Return a distance that is at most missing, or more, to the same digits as `least_distance`, rounded up."""
        if metres > self.step_m * (1.0 - _ROUNDING):
            return f"{math.ceil(metres / self.step_m - _ROUNDING) / 10} {self._name}"
        return f"{math.ceil(metres)} m" if metres > 9.9 else f"{math.ceil(10.0 * metres) / 10.0} m"

    def exact_distance(self, metres: float) -> str:
        """Return a distance that is a whole number of tenths of the larger unit, else to 0.1 m, rounded up."""
        tenths = round(metres / self.step_m)
        if tenths and abs(metres / self.step_m - tenths) <= _ROUNDING:
            return f"{tenths / 10} {self._name}"
        return f"{math.ceil(10.0 * metres - _ROUNDING) / 10} m"

    def given_distance(self, metres: float) -> str:
        """Return a distance in the larger unit if it is whole hundredths of it, else in metres, not rounded."""
        hundredths = 10.0 * metres / self.step_m
        if hundredths > 0.5 and abs(hundredths - round(hundredths)) < _ROUNDING:
            return f"{round(hundredths) / 100.0:g} {self._name}"
        return f"{metres:g} m"

    def speed(self, kn: float) -> float:
        """Return a speed in `speed_unit`."""
        return kn if self is Units.NAUTICAL else kn * _MPS_OF_KN

    @property
    def speed_unit(self) -> str:
        """The unit of speeds."""
        return "kn" if self is Units.NAUTICAL else "m/s"

    def bound(self, degrees: float, signs: str) -> str:
        """Return a limit in latitude (signs ``NS``) or longitude (``EW``): `57°41'N`, or `57.69 N`."""
        if self is Units.NAUTICAL:
            return minutes_text(degrees, signs)
        if signs == "EW":
            degrees = (degrees + 180.0) % 360.0 - 180.0
        return f"{abs(degrees):.2f} {signs[1 if degrees < 0.0 else 0]}"

    def place(self, lon: float, lat: float) -> str:
        """Return a latitude and a longitude, degrees: `57°54.300'N 008°45.600'E`, or `57.90500 N 8.76000 E`."""
        lon = (lon + 180.0) % 360.0 - 180.0
        angle = _minutes if self is Units.NAUTICAL else _degrees
        return f"{angle(lat, 2)}{'S' if lat < 0.0 else 'N'} {angle(lon, 3)}{'W' if lon < 0.0 else 'E'}"


def _minutes(degrees: float, width: int) -> str:
    whole, thousandths = divmod(round(abs(degrees) * 60_000.0), 60_000)
    return f"{whole:0{width}d}°{thousandths / 1000.0:06.3f}'"


def _degrees(degrees: float, width: int) -> str:
    return f"{abs(degrees):.5f} "
