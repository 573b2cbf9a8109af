"""Distances and places in the units that a person has chosen."""

import math
from enum import StrEnum
from typing import Final

METRES_PER_NMI: Final = 1852.0  # exact, by definition
_METRES_PER_KM: Final = 1000.0
# Of tenths: the error of a product of doubles is no part of one.
_ROUNDING: Final = 1e-6


class Units(StrEnum):
    """Nautical miles, and places in degrees and minutes; or kilometres, and decimal degrees."""

    NAUTICAL = "nautical"
    METRIC = "metric"

    @property
    def step_m(self) -> float:
        """A tenth of the larger unit, metres: distances that are proposed are whole numbers of these."""
        return (METRES_PER_NMI if self is Units.NAUTICAL else _METRES_PER_KM) / 10.0

    @property
    def _name(self) -> str:
        return "nmi" if self is Units.NAUTICAL else "km"

    def distance(self, metres: float) -> str:
        """Return a distance to a tenth of the larger unit, below a tenth of it in metres."""
        if metres >= self.step_m:
            return f"{metres / self.step_m / 10.0:.1f} {self._name}"
        return f"{metres:.0f} m" if metres >= 10.0 else f"{metres:.1f} m"

    def least_distance(self, metres: float) -> str:
        """Return a distance as `distance` does, rounded down."""
        tenths = math.floor(metres / self.step_m + _ROUNDING)
        return f"{tenths / 10} {self._name}" if tenths else f"{int(metres)} m"

    def most_distance(self, metres: float) -> str:
        """Return a distance as `distance` does, rounded up."""
        if metres <= self.step_m * (1.0 - _ROUNDING):
            return f"{math.ceil(metres)} m"
        return f"{math.ceil(metres / self.step_m - _ROUNDING) / 10} {self._name}"

    def exact_distance(self, metres: float) -> str:
        """Return a distance that is a whole number of tenths of the larger unit, else to 0.1 m, rounded up."""
        tenths = round(metres / self.step_m)
        if tenths and abs(metres / self.step_m - tenths) <= _ROUNDING:
            return f"{tenths / 10} {self._name}"
        return f"{math.ceil(10.0 * metres - _ROUNDING) / 10} m"

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
