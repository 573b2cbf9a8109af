"""Compute rhumb lines on the sphere and on the WGS84 ellipsoid, in the Mercator plane.

Three latitudes are used. On the meridian, distance is proportional to the *rectifying* latitude mu. The *conformal*
latitude chi maps the ellipsoid's Mercator ordinate to the sphere's, psi = asinh(tan chi). And chi is mu plus a short
Fourier series. A rhumb line is straight in (longitude, psi), and its length is linear in mu. Only the divided
difference (psi2 - psi1) / (mu2 - mu1) needs care: computed as a quotient of rounded differences, it loses all digits on
an east-west line. Here it is one expression, the same for every bearing.

References
----------
C. F. F. Karney, "Transverse Mercator with an accuracy of a few nanometers", J. Geodesy 85 (2011),
doi:10.1007/s00190-011-0445-3, eqs. 7-9 (conformal latitude), 14 (rectifying radius), 35, 36 (series, order 6).
C. F. F. Karney, "The area of rhumb polygons", Stud. Geophys. Geod. 68 (2024), doi:10.1007/s11200-024-0709-z, section 3
(divided differences).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb.arrays import Floats
from conflictdb.model.plans import EarthModel

MEAN_RADIUS_M: Final = 6_371_008.771415  # (2a + b) / 3 of WGS84, the sphere of this package
WGS84_RADIUS_M: Final = 6_378_137.0
WGS84_FLATTENING: Final = 1.0 / 298.257223563

# Newton steps from conformal to geographic latitude: two reach the last digit for WGS84 (Karney 2011), one is spare.
_NEWTON_STEPS: Final = 3
# A difference of latitudes, radians, over which the rounding of psi is 5e-16 of its difference.
_LONG_WAY: Final = 0.5


@dataclass(frozen=True, slots=True)
class Earth:
    """A figure of the earth, for the plane of rhumb lines.

    radius_m : equatorial radius a, metres; plane x = a * longitude, y = a * psi
    rectifying_m : metres of meridian per radian of rectifying latitude
    eccentricity : first eccentricity, 0 on the sphere
    to_rectifying, to_conformal : series mu(chi) and chi(mu) in sin(2 j .), j = 1, 2, ...; empty on the sphere
    conformal_radius : power series in sin(chi)^2 of the radius of the conformal sphere, metres
    """

    radius_m: float
    rectifying_m: float
    eccentricity: float
    to_rectifying: tuple[float, ...]
    to_conformal: tuple[float, ...]
    conformal_radius: tuple[float, ...]

    @property
    def polar_conformal_radius_m(self) -> float:
        """The least radius of the conformal sphere, metres; the largest is the equatorial one."""
        return sum(self.conformal_radius)

    @property
    def oblateness(self) -> float:
        """ln(largest / least radius of the conformal sphere): also a bound on the change of ln radius per radian."""
        return math.log(self.radius_m / sum(self.conformal_radius))

    def rectifying(self, latitude: ArrayLike) -> Floats:
        """Return the rectifying latitude mu of a geographic latitude, radians."""
        chi = np.arctan(self._conformal_tangent(np.tan(np.asarray(latitude, dtype=np.float64))))
        mu = chi.copy()
        for j, alpha in enumerate(self.to_rectifying, 1):
            mu += alpha * np.sin(2 * j * chi)
        return mu

    def conformal(self, mu: ArrayLike) -> Floats:
        """Return the conformal latitude chi of a rectifying latitude, radians."""
        mu = np.asarray(mu, dtype=np.float64)
        if not self.to_conformal:
            return mu
        # Clenshaw summation: one sine and one cosine for the whole series.
        cosine, first = 2.0 * np.cos(2.0 * mu), np.sin(2.0 * mu)
        ahead = np.zeros_like(mu)
        this = np.zeros_like(mu)
        for beta in reversed(self.to_conformal):
            this, ahead = beta + cosine * this - ahead, this
        return mu + first * this

    def isometric(self, mu: ArrayLike) -> Floats:
        """Return the isometric latitude psi (Mercator ordinate over a) of a rectifying latitude."""
        return np.arcsinh(np.tan(self.conformal(mu)))

    def latitude(self, psi: ArrayLike) -> Floats:
        """Return the geographic latitude of an isometric latitude, radians."""
        target = np.sinh(np.asarray(psi, dtype=np.float64))
        e2 = self.eccentricity**2
        tau = target / (1.0 - e2)
        for _ in range(_NEWTON_STEPS if e2 else 0):
            now = self._conformal_tangent(tau)
            tau = tau + (target - now) / np.hypot(1.0, now) * (1.0 + (1.0 - e2) * tau**2) / (
                (1.0 - e2) * np.hypot(1.0, tau)
            )
        return np.arctan(tau)

    def stretch(self, mu1: ArrayLike, mu2: ArrayLike) -> Floats:
        """Return (psi2 - psi1) / (mu2 - mu1), also for mu1 equal to mu2; arrays broadcast."""
        mu1, mu2 = np.asarray(mu1, dtype=np.float64), np.asarray(mu2, dtype=np.float64)
        chi1, chi2 = self.conformal(mu1), self.conformal(mu2)
        # The quotient of differences of chi and of mu.
        ratio = np.ones(np.broadcast_shapes(mu1.shape, mu2.shape))
        for beta, (cosine, spread) in zip(self.to_conformal, _harmonics(mu1 + mu2, mu2 - mu1), strict=False):
            ratio += 2.0 * beta * cosine * spread
        half = 0.5 * ratio * (mu2 - mu1)
        z = _sinc(half) * half / np.cos(0.5 * (chi1 + chi2))
        found = ratio * _atanhc(z) * _sinc(half) / np.cos(0.5 * (chi1 + chi2))
        # Over long distances nothing cancels, while z approaches 1 from near one pole to near the other.
        is_long = np.abs(mu2 - mu1) > _LONG_WAY
        if not is_long.any():
            return found
        way = np.where(is_long, mu2 - mu1, 1.0)
        return np.where(is_long, (np.arcsinh(np.tan(chi2)) - np.arcsinh(np.tan(chi1))) / way, found)

    def conformal_radius_m(self, psi: Floats) -> Floats:
        """Return metres on the earth per radian of the conformal sphere, which has the same Mercator plane."""
        if not self.to_conformal:
            return np.full_like(psi, self.radius_m)
        square = np.tanh(psi) ** 2
        value = np.full_like(square, self.conformal_radius[-1])
        for coefficient in self.conformal_radius[-2::-1]:
            value *= square
            value += coefficient
        return value

    def plane_scale(self, psi: Floats) -> Floats:
        """Return plane metres per metre on the earth at an isometric latitude (the projection is conformal)."""
        return np.asarray(np.cosh(psi) * self.radius_m / self.conformal_radius_m(psi))

    def to_plane(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return plane x and y in metres of longitudes and latitudes in degrees."""
        x = self.radius_m * np.radians(np.asarray(lon_deg, dtype=np.float64))
        tau = np.tan(np.radians(np.asarray(lat_deg, dtype=np.float64)))
        return x, self.radius_m * np.arcsinh(self._conformal_tangent(tau))

    def from_plane(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[Floats, Floats]:
        """Return longitudes (not wrapped) and latitudes in degrees of plane x and y in metres."""
        x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
        return np.degrees(x / self.radius_m), np.degrees(self.latitude(y / self.radius_m))

    def _conformal_tangent(self, tau: Floats) -> Floats:
        """Return tan chi of tan latitude (Karney 2011, eqs. 7-9)."""
        secant = np.hypot(1.0, tau)
        sigma = np.sinh(self.eccentricity * np.arctanh(self.eccentricity * tau / secant))
        return np.asarray(np.hypot(1.0, sigma) * tau - sigma * secant)


def _conformal_radius(radius_m: float, flattening: float) -> tuple[float, ...]:
    """Return the power series in sin(chi)^2 of N cos(phi) / cos(chi), from the equator, where it is the radius."""
    e2 = flattening * (2.0 - flattening)
    sine2 = 0.5 - 0.5 * np.cos(np.pi * (np.arange(200) + 0.5) / 200)
    chi = np.arcsin(np.sqrt(sine2))
    phi = chi
    for _ in range(20):
        e = np.sqrt(e2)
        phi = np.arctan(np.sinh(np.arcsinh(np.tan(chi)) + e * np.arctanh(e * np.sin(phi))))
    values = radius_m * np.cos(phi) / np.sqrt(1.0 - e2 * np.sin(phi) ** 2) / np.cos(chi)
    # Terms shrink by e^2 = 0.0067 each: the seventh is below float64's precision.
    return tuple(float(c) for c in np.polynomial.Polynomial.fit(sine2, values, 6).convert().coef)


def _harmonics(total: Floats, difference: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield cos(j total) and sin(j difference) / difference for j = 1, 2, ..., without end.

    A divided difference of sin(2 j mu) is 2 cos(j (mu1 + mu2)) sin(j (mu2 - mu1)) / (mu2 - mu1).
    """
    turn, swing = 2.0 * np.cos(total), 2.0 * np.cos(difference)
    cosine, spread = 0.5 * turn, _sinc(difference)
    before: tuple[Floats | float, Floats | float] = (1.0, 0.0)
    while True:
        yield cosine, spread
        (cosine, spread), before = (turn * cosine - before[0], swing * spread - before[1]), (cosine, spread)


def _series(n: float, rows: tuple[tuple[float, ...], ...], sign: float) -> tuple[float, ...]:
    """Return the coefficients of sin(2 j .), without trailing ones below float64's precision."""
    terms = [sign * sum(c * n ** (j + k) for k, c in enumerate(row)) for j, row in enumerate(rows, 1)]
    while terms and 2.0 * len(terms) * abs(terms[-1]) < 0.1 * np.finfo(np.float64).eps:
        terms.pop()
    return tuple(terms)


def _ellipsoid(radius_m: float, flattening: float) -> Earth:
    n = flattening / (2.0 - flattening)
    alpha = (
        (1 / 2, -2 / 3, 5 / 16, 41 / 180, -127 / 288, 7891 / 37800),
        (13 / 48, -3 / 5, 557 / 1440, 281 / 630, -1983433 / 1935360),
        (61 / 240, -103 / 140, 15061 / 26880, 167603 / 181440),
        (49561 / 161280, -179 / 168, 6601661 / 7257600),
        (34729 / 80640, -3418889 / 1995840),
        (212378941 / 319334400,),
    )
    beta = (
        (1 / 2, -2 / 3, 37 / 96, -1 / 360, -81 / 512, 96199 / 604800),
        (1 / 48, 1 / 15, -437 / 1440, 46 / 105, -1118711 / 3870720),
        (17 / 480, -37 / 840, -209 / 4480, 5569 / 90720),
        (4397 / 161280, -11 / 504, -830251 / 7257600),
        (4583 / 161280, -108847 / 3991680),
        (20648693 / 638668800,),
    )
    return Earth(
        radius_m=radius_m,
        rectifying_m=radius_m / (1.0 + n) * (1.0 + n**2 / 4 + n**4 / 64 + n**6 / 256),
        eccentricity=float(np.sqrt(flattening * (2.0 - flattening))),
        to_rectifying=_series(n, alpha, 1.0),
        to_conformal=_series(n, beta, -1.0),
        conformal_radius=_conformal_radius(radius_m, flattening),
    )


_EARTHS: Final = {
    EarthModel.SPHERE: Earth(MEAN_RADIUS_M, MEAN_RADIUS_M, 0.0, (), (), (MEAN_RADIUS_M,)),
    EarthModel.WGS84: _ellipsoid(WGS84_RADIUS_M, WGS84_FLATTENING),
}


def earth_of(model: EarthModel) -> Earth:
    """Return the figure of the earth for a model."""
    return _EARTHS[model]


def shorter_way_deg(difference_deg: ArrayLike) -> Floats:
    """Normalise a difference of longitudes to [-180, 180] degrees.

    Exactly half a turn keeps its sign.
    """
    difference = np.asarray(difference_deg, dtype=np.float64)
    return np.where(np.abs(difference) > 180.0, difference - 360.0 * np.round(difference / 360.0), difference)


def is_standing(start_deg: Floats, end_deg: Floats) -> NDArray[np.bool_]:
    """Return (n,) whether legs between places (n, 2) or one place (1, 2) stand still: whole turns are no movement."""
    turns = (end_deg[:, 0] - start_deg[:, 0]) % 360.0 == 0.0
    return np.asarray((start_deg[:, 1] == end_deg[:, 1]) & (turns | (np.abs(end_deg[:, 1]) == 90.0)))


def direction_of(bearing_deg: ArrayLike) -> tuple[Floats, Floats]:
    """Return the (east, north) components of a bearing in degrees, exact at multiples of 90."""
    bearing = np.asarray(bearing_deg, dtype=np.float64)
    quarter = np.round(bearing / 90.0)
    rest = np.radians(bearing - 90.0 * quarter)
    sine, cosine = np.sin(rest), np.cos(rest)
    if not quarter.any():
        return sine + 0.0, cosine + 0.0
    # After an odd number of quarter turns sine and cosine swap; two quarters of each turn are negative.
    turn = np.mod(quarter, 4.0)
    swaps = np.mod(quarter, 2.0) != 0.0
    east = np.where(swaps, cosine, sine) * np.where(turn >= 2.0, -1.0, 1.0)
    north = np.where(swaps, sine, cosine) * np.where(np.abs(turn - 1.5) < 1.0, -1.0, 1.0)
    return east + 0.0, north + 0.0


def rhumb_inverse(
    earth: Earth, lon1_deg: ArrayLike, lat1_deg: ArrayLike, lon2_deg: ArrayLike, lat2_deg: ArrayLike
) -> tuple[Floats, Floats]:
    """Return the length (metres) and bearing (degrees clockwise from north, in (-180, 180]) of rhumb lines.

    Longitude takes the shorter way round. Arrays broadcast. Two equal points have length 0 and bearing 0.
    """
    mu1 = earth.rectifying(np.radians(np.asarray(lat1_deg, dtype=np.float64)))
    mu2 = earth.rectifying(np.radians(np.asarray(lat2_deg, dtype=np.float64)))
    turn = np.asarray(lon2_deg, dtype=np.float64) - np.asarray(lon1_deg, dtype=np.float64)
    east = np.radians(shorter_way_deg(turn)) / earth.stretch(mu1, mu2)
    north = mu2 - mu1
    return earth.rectifying_m * np.hypot(east, north), np.degrees(np.arctan2(east, north))


def rhumb_distance(
    earth: Earth, lon1_deg: ArrayLike, lat1_deg: ArrayLike, lon2_deg: ArrayLike, lat2_deg: ArrayLike
) -> Floats:
    """Return the length of rhumb lines in metres, the shorter way round; arrays broadcast."""
    return rhumb_inverse(earth, lon1_deg, lat1_deg, lon2_deg, lat2_deg)[0]


def rhumb_direct(
    earth: Earth, lon_deg: ArrayLike, lat_deg: ArrayLike, bearing_deg: ArrayLike, distance_m: ArrayLike
) -> tuple[Floats, Floats]:
    """Return longitude (not wrapped) and latitude in degrees after a rhumb step; NaN beyond a pole."""
    east, north = direction_of(bearing_deg)
    steps = np.asarray(distance_m, dtype=np.float64) / earth.rectifying_m
    mu1 = earth.rectifying(np.radians(np.asarray(lat_deg, dtype=np.float64)))
    mu2 = mu1 + steps * north
    mu2 = np.where(np.abs(mu2) < 0.5 * np.pi, mu2, np.nan)
    lon = np.asarray(lon_deg, dtype=np.float64) + np.degrees(steps * east * earth.stretch(mu1, mu2))
    return lon, np.degrees(earth.latitude(earth.isometric(mu2)))


def great_circle_step(
    lon1_deg: ArrayLike, lat1_deg: ArrayLike, lon2_deg: ArrayLike, lat2_deg: ArrayLike
) -> tuple[Floats, Floats, Floats]:
    """Return sin(d) sin(b), sin(d) cos(b) and cos(d) of great circles of length d radians and initial bearing b.

    Longitude takes the shorter way round. Arrays broadcast. Differences keep the digits of short distances.
    """
    lat1, lat2 = np.asarray(lat1_deg, dtype=np.float64), np.asarray(lat2_deg, dtype=np.float64)
    turn = shorter_way_deg(np.asarray(lon2_deg, dtype=np.float64) - np.asarray(lon1_deg, dtype=np.float64))
    (sine1, cosine1), (sine2, cosine2), (sine, cosine) = (direction_of(angle) for angle in (lat1, lat2, turn))
    versine = 2.0 * np.sin(np.radians(0.5 * turn)) ** 2
    north = np.sin(np.radians(lat2 - lat1)) + sine1 * cosine2 * versine
    return cosine2 * sine, north, sine1 * sine2 + cosine1 * cosine2 * cosine


def great_circle_distance(lon1_deg: ArrayLike, lat1_deg: ArrayLike, lon2_deg: ArrayLike, lat2_deg: ArrayLike) -> Floats:
    """Return the length of great circles on the sphere of mean radius in metres; arrays broadcast."""
    east, north, cosine = great_circle_step(lon1_deg, lat1_deg, lon2_deg, lat2_deg)
    return np.asarray(MEAN_RADIUS_M * np.arctan2(np.hypot(east, north), cosine))


def unit_vectors(places_deg: Floats) -> Floats:
    """Return longitudes and latitudes (n, 2) as unit vectors (n, 3)."""
    lon, lat = np.radians(places_deg).T
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)


def _sinc(x: Floats) -> Floats:
    """Return sin(x) / x, 1 at 0."""
    return np.divide(np.sin(x), x, out=np.ones_like(x), where=x != 0.0)


def _atanhc(z: Floats) -> Floats:
    """Return atanh(z) / z, 1 at 0."""
    safe = np.where(z == 0.0, 0.5, z)
    with np.errstate(invalid="ignore", divide="ignore"):  # beyond a pole
        return np.where(z == 0.0, 1.0, np.arctanh(safe) / safe)
