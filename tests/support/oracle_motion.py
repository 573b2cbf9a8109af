"""The motion of havens, written plainly for the oracle: shares nothing with the package but the classes of a scene.

Motion (all that is assumed):

- A leg is a rhumb line at constant speed; longitudes are unwrapped the shortest way.
- A haven vertex (starboard, forward) is reached from the reference point by a rhumb step forward along the leg's
  bearing, then one to starboard. The haven is the convex hull of its vertices in the Mercator plane.
- A haven may change: its vertices then move steadily, on each leg, from their places in the body frame at one waypoint
  to those at the next. Growing at a speed means that its sides move outward, from the first waypoint on.
- Spans are half-open, polygons are closed; at inner waypoints both orientations count.

Units: metres, radians; degrees and microseconds where objects are read.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipeinc

from conflictdb.model.plans import EarthModel, Track

Floats = NDArray[np.float64]

NODES, WEIGHTS = np.polynomial.legendre.leggauss(20)


@dataclass(frozen=True)
class Globe:
    """Figure of the earth: equatorial radius in metres and squared eccentricity; latitudes in radians."""

    a: float
    e2: float

    @classmethod
    def of(cls, earth: EarthModel) -> "Globe":
        if earth is EarthModel.SPHERE:
            return cls(6371008.771415, 0.0)
        f = 1 / 298.257223563
        return cls(6378137.0, f * (2 - f))

    def isometric(self, lat: Floats) -> Floats:
        e = np.sqrt(self.e2)
        return np.arcsinh(np.tan(lat)) - e * np.arctanh(e * np.sin(lat))

    def latitude_of_isometric(self, psi: Floats) -> Floats:
        e = np.sqrt(self.e2)
        lat = np.arctan(np.sinh(psi))
        for _ in range(12):
            lat = np.arctan(np.sinh(psi + e * np.arctanh(e * np.sin(lat))))
        return lat

    def meridian_m(self, lat: Floats) -> Floats:
        """Metres from the equator to a latitude, along the meridian."""
        sin, cos = np.sin(lat), np.cos(lat)
        return self.a * (ellipeinc(lat, self.e2) - self.e2 * sin * cos / np.sqrt(1 - self.e2 * sin**2))

    def latitude_of_meridian(self, m: Floats) -> Floats:
        lat = np.asarray(m / self.a)
        for _ in range(5):
            lat = lat - (self.meridian_m(lat) - m) / self.along_m(lat)
        return lat

    def along_m(self, lat: Floats) -> Floats:
        """Metres per radian of latitude."""
        return self.a * (1 - self.e2) / (1 - self.e2 * np.sin(lat) ** 2) ** 1.5

    def across_m(self, lat: Floats) -> Floats:
        """Metres per radian of longitude."""
        return self.a * np.cos(lat) / np.sqrt(1 - self.e2 * np.sin(lat) ** 2)

    def turn_per_m(self, lat1: Floats, lat2: Floats) -> Floats:
        """Radians of longitude per metre made good to the east on the rhumb line between two latitudes.

        The mean over the meridian of 1/across: by quadrature for short arcs (nothing cancels), else as the quotient.
        """
        lat1, lat2 = np.broadcast_arrays(np.asarray(lat1, float), np.asarray(lat2, float))
        middle, half = (lat1 + lat2) / 2, (lat2 - lat1) / 2
        lat = middle[..., None] + half[..., None] * NODES
        along = self.along_m(lat)
        short = (along / self.across_m(lat)) @ WEIGHTS / (along @ WEIGHTS)
        wide = np.abs(half) > 0.025
        if not wide.any():
            return short
        span = np.where(wide, self.meridian_m(lat2) - self.meridian_m(lat1), 1.0)
        return np.where(wide, (self.isometric(lat2) - self.isometric(lat1)) / span, short)

    def step(self, lon: Floats, lat: Floats, north_m: Floats, east_m: Floats) -> tuple[Floats, Floats]:
        """Go along a rhumb line by so many metres made good to the north and to the east."""
        lat2 = np.where(north_m == 0.0, lat, self.latitude_of_meridian(self.meridian_m(lat) + north_m))
        return lon + east_m * self.turn_per_m(lat, lat2), lat2

    def between(self, lat1_deg: float, lat2_deg: float, dlon_deg: float) -> tuple[float, float]:
        """Metres made good to the north and to the east on the rhumb line between two points, unwrapped."""
        lat1, lat2 = np.radians(lat1_deg), np.radians(lat2_deg)
        north = self.meridian_m(lat2) - self.meridian_m(lat1)
        half = np.radians(lat2_deg - lat1_deg) / 2
        if abs(half) < 0.025:  # the difference of two large distances would be rounded
            north = half * (self.along_m((lat1 + lat2) / 2 + half * NODES) @ WEIGHTS)
        return float(north), float(np.radians(dlon_deg) / self.turn_per_m(lat1, lat2))


@dataclass(frozen=True)
class Leg:
    """One leg of a track, longitudes unwrapped, in radians; heading as a unit vector (north, east).

    outline_m : (m, 2) the haven at the start of the leg
    growth_m : (m, 2) how far each vertex moves on it
    """

    start_us: int
    end_us: int
    lon: float
    lat: float
    north_m: float
    east_m: float
    heading: tuple[float, float]
    outline_m: Floats
    growth_m: Floats

    def vertices(self, globe: Globe, outline_m: Floats, fraction: Floats) -> tuple[Floats, Floats]:
        """Longitudes and latitudes in radians, (n, m), of the haven's vertices at n fractions of the leg.

        outline_m : (m, 2) the haven at the start of the leg
        """
        lon, lat = globe.step(
            self.lon, np.full(len(fraction), self.lat), fraction * self.north_m, fraction * self.east_m
        )
        outlines = outline_m + fraction[:, None, None] * self.growth_m
        (cos, sin), starboard, forward = self.heading, outlines[..., 0], outlines[..., 1]
        lon, lat = globe.step(lon[:, None], lat[:, None], forward * cos, forward * sin)
        return globe.step(lon, lat, -starboard * sin, starboard * cos)


def legs(globe: Globe, track: Track) -> list[Leg]:
    """The legs of a track; a loiter keeps the heading before it, else that of the next moving leg, else north."""
    turns = np.diff(track.positions_deg[:, 0])
    turns = np.where(
        np.abs(turns) > 180.0, turns - 360.0 * np.round(turns / 360.0), turns
    )  # half a turn keeps its sign
    lon = np.radians(track.positions_deg[0, 0] + np.concatenate([[0.0], np.cumsum(turns)]))
    lat = track.positions_deg[:, 1]
    moves = [globe.between(lat[i], lat[i + 1], turn) for i, turn in enumerate(turns)]
    headings = [(n / np.hypot(n, e), e / np.hypot(n, e)) if np.hypot(n, e) > 0.0 else None for n, e in moves]
    heading = next((h for h in headings if h), (1.0, 0.0))
    found = []
    havens = outlines(track)
    for i, (north, east) in enumerate(moves):
        heading = headings[i] or heading
        start, end = int(track.times_us[i]), int(track.times_us[i + 1])
        change = havens[i + 1] - havens[i]
        found.append(Leg(start, end, float(lon[i]), float(np.radians(lat[i])), north, east, heading, havens[i], change))
    return found


def outlines(track: Track) -> list[Floats]:
    """The haven at every waypoint, (m, 2) each."""
    if track.outlines_m is not None:
        return list(track.outlines_m)
    if not track.grow_mps:
        return [track.outline_m] * len(track.times_us)
    return [grown(track.outline_m, track.grow_mps * (us - int(track.times_us[0])) / 1e6) for us in track.times_us]


def grown(outline_m: Floats, by_m: float) -> Floats:
    """An outline with its sides moved outward: every corner is where the two moved sides meet."""
    ring = [p for i, p in enumerate(outline_m) if np.any(p != outline_m[i - 1])] or [outline_m[0]]
    if len(ring) <= 2:  # a rectangle without length or width
        along = ring[-1] - ring[0] if len(ring) == 2 else np.array([0.0, 1.0])
        along = by_m * along / np.hypot(*along)
        across = np.array([along[1], -along[0]])
        a, b = ring[0], ring[-1]
        return np.array([a - along + across, b + along + across, b + along - across, a - along - across])
    middle = np.mean(ring, axis=0)
    corners = []
    for i, corner in enumerate(ring):
        sides = []
        for other in (ring[i - 1], ring[(i + 1) % len(ring)]):
            x, y = corner - other
            normal = np.array([y, -x]) / np.hypot(x, y)
            sides.append(normal if normal @ (corner - middle) > 0.0 else -normal)
        one, other = sides
        # Solving for where the two lines meet would lose the digits of nearly straight corners.
        corners.append(corner + by_m * (one + other) / (1.0 + one @ other))
    return np.array(corners)
