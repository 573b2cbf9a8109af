"""Sunrise, sunset and civil twilight.

The sun's place is that of J. Meeus, Astronomical Algorithms (1998), chapter 25, low accuracy: 0.01 degrees. Times are
for a horizon at sea level, with the usual 34' of refraction and 16' of the sun's radius. Outward times are those of a
sun MARGIN_DEG higher (at day) or lower (at night), which bounds the error also near the poles, where the sun moves
along the horizon and a small angle is a long time.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

RISE_DEG: Final = -0.8333
CIVIL_DEG: Final = -6.0
# Error of the sun's altitude: 0.01 degrees of its place, and its movement between two steps of the iteration.
MARGIN_DEG: Final = 0.02

# Altitude and side of noon of each event, in the order of a day.
EVENTS: Final = {
    "civil_dawn": (CIVIL_DEG, -1.0),
    "sunrise": (RISE_DEG, -1.0),
    "sunset": (RISE_DEG, 1.0),
    "civil_dusk": (CIVIL_DEG, 1.0),
}

_DAY_S: Final = 86400.0
_J2000_S: Final = 946_728_000.0  # 2000-01-01T12:00Z
# Nearer to a pole the sun has no daily course.
_MOST_LATITUDE_DEG: Final = 89.99


def solar_position(at_s: Floats) -> tuple[Floats, Floats]:
    """Return declination (radians) and equation of time (seconds) of the sun at Unix times."""
    century = (at_s - _J2000_S) / (36525.0 * _DAY_S)
    mean_deg = 280.46646 + century * (36000.76983 + century * 0.0003032)
    anomaly = np.radians(357.52911 + century * (35999.05029 - century * 0.0001537))
    centre_deg = (
        np.sin(anomaly) * (1.914602 - century * (0.004817 + century * 0.000014))
        + np.sin(2.0 * anomaly) * (0.019993 - century * 0.000101)
        + np.sin(3.0 * anomaly) * 0.000289
    )
    node = np.radians(125.04 - 1934.136 * century)
    apparent = np.radians(mean_deg + centre_deg - 0.00569 - 0.00478 * np.sin(node))
    obliquity = np.radians(23.4392911 - 0.0130042 * century + 0.00256 * np.cos(node))
    declination = np.arcsin(np.sin(obliquity) * np.sin(apparent))
    ascension_deg = np.degrees(np.arctan2(np.cos(obliquity) * np.sin(apparent), np.cos(apparent)))
    difference_deg = (mean_deg - 0.0057183 - ascension_deg + 180.0) % 360.0 - 180.0
    return declination, 240.0 * difference_deg


def sun_times(event: str, noon_s: Floats, places_deg: Floats, higher_deg: float = 0.0) -> Floats:
    """Return the Unix times of an event on solar days, at places: (d, p) seconds.

    On a day without it, the event is at its limit: at midnight if the sun stays above its altitude, so that a polar day
    lasts from midnight to midnight, and at noon if it stays below, so that the day of a polar night is empty.

    noon_s : (d,) mean noon of each day at longitude 0, Unix seconds
    places_deg : (p, 2) longitude and latitude
    higher_deg : the sun is taken to be this much higher
    """
    altitude_deg, side = EVENTS[event]
    altitude = np.radians(altitude_deg - higher_deg)
    latitude = np.radians(np.clip(places_deg[:, 1], -_MOST_LATITUDE_DEG, _MOST_LATITUDE_DEG))
    mean_s = noon_s[:, None] - 240.0 * places_deg[None, :, 0]
    at_s = mean_s
    for _ in range(4):
        declination, equation_s = solar_position(at_s)
        cosine = (np.sin(altitude) - np.sin(latitude) * np.sin(declination)) / (np.cos(latitude) * np.cos(declination))
        half_day_s = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))) * 240.0
        at_s = mean_s - equation_s + side * half_day_s
    return np.asarray(at_s)
