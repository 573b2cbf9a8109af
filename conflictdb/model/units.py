"""Distances and places in the units that a person has chosen."""

from enum import StrEnum
from typing import Final

_NMI_M: Final = 1852.0
_KM_M: Final = 1000.0


class Units(StrEnum):
    """Nautical miles, and places in degrees and minutes; or kilometres, and decimal degrees."""

    NAUTICAL = "nautical"
    METRIC = "metric"

    def distance(self, metres: float) -> str:
        """Return a distance to a tenth of the larger unit, below a tenth of it in metres."""
        unit_m, name = (_NMI_M, "nmi") if self is Units.NAUTICAL else (_KM_M, "km")
        if metres >= unit_m / 10.0:
            return f"{metres / unit_m:.1f} {name}"
        return f"{metres:.0f} m" if metres >= 10.0 else f"{metres:.1f} m"

    def least_distance(self, metres: float) -> str:
        """Return a distance as `distance` does, rounded down."""
        unit_m, name = (_NMI_M, "nmi") if self is Units.NAUTICAL else (_KM_M, "km")
        tenths = int(10.0 * metres / unit_m)
        return f"{tenths / 10} {name}" if tenths else f"{int(metres)} m"

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
