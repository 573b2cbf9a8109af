"""Where the polygon of a piece is at an instant: the one motion model that every stage evaluates.

A haven rides a rhumb line at constant speed. Each of its vertices is found from the reference point by two rhumb
steps: forward along the heading, then to starboard across it (rhumb steps do not commute). Everything is written with
the divided differences of `geodesy`, so no bearing is special. An area stands still.

Reference: Bienkowski, Sidoti, Pattipati, "Interference Identification for Time-Varying Polyhedra", IEEE Access 2021,
section III (constraints on the haven); corrected in that the haven's image in the Mercator plane is not rigid.
"""

from dataclasses import dataclass
from typing import Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.batches import Pieces
from conflictdb.geodesy import Earth, Floats, direction_of
from conflictdb.model import Kind

# The bounds on curvature below are written for the sphere. On WGS84 d chi/d mu differs from 1 by at most n = 0.0017
# and its derivatives by at most 4 n relative to tan: (1 + n)^3 (1 + 4 n) (1 + 8 n) < 1.03; rounded up.
ELLIPSOID_SLACK: Final = 1.05
# Plane coordinates reach 4e7 m, where float64 has a spacing of 7.5e-9 m; a vertex is a sum of about ten such terms.
ROUNDING_ALLOWANCE_M: Final = 1e-6


class Shapes(Protocol):
    """n convex polygons of v vertices each, as functions of time (seconds; each row has its own zero)."""

    @property
    def vertex_count(self) -> int:
        """Vertices per polygon."""

    @property
    def is_convex(self) -> bool:
        """Whether the vertices are known to be in convex position in the plane (else their hull is meant)."""

    def take(self, rows: NDArray[np.int64]) -> "Shapes":
        """Return the shapes of some rows."""

    def positions(self, t: Floats) -> Floats:
        """Return the vertices at times t (n,), (n, v, 2) plane metres."""

    def velocities(self, t: Floats) -> Floats:
        """Return the vertices' velocities at times t (n,), (n, v, 2) plane metres per second."""

    def bend(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) bounds on the second derivative of every vertex during [t0, t1], plane metres per s^2."""


@dataclass(frozen=True, slots=True)
class StaticShapes:
    """Polygons that stand still; xy : (n, v, 2) plane metres."""

    xy: Floats

    @property
    def vertex_count(self) -> int:
        return int(self.xy.shape[1])

    @property
    def is_convex(self) -> bool:
        return True

    def take(self, rows: NDArray[np.int64]) -> "StaticShapes":
        return StaticShapes(self.xy[rows])

    def positions(self, t: Floats) -> Floats:
        return self.xy

    def velocities(self, t: Floats) -> Floats:
        return np.zeros_like(self.xy)

    def bend(self, t0: Floats, t1: Floats) -> Floats:
        return np.zeros(len(self.xy))


@dataclass(frozen=True, slots=True)
class RhumbShapes:
    """Havens on one rhumb leg each.

    start_x : (n,) plane metres of the leg's start, seam shift included
    start_mu, delta_mu : (n,) rectifying latitude of the leg's start and its change over the leg, radians
    rate_x : (n,) plane metres of x per unit of psi-weighted progress: x(t) = start_x + rate_x * progress * stretch
    into_leg_s : (n,) seconds of the leg gone at t = 0
    leg_s : (n,) seconds the leg takes
    east, north : (n,) components of the heading
    forward, starboard : (n, v) haven vertices, radians of rectifying latitude (metres over rectifying_m)
    """

    earth: Earth
    start_x: Floats
    start_mu: Floats
    delta_mu: Floats
    rate_x: Floats
    into_leg_s: Floats
    leg_s: Floats
    east: Floats
    north: Floats
    forward: Floats
    starboard: Floats

    @property
    def vertex_count(self) -> int:
        return int(self.forward.shape[1])

    @property
    def is_convex(self) -> bool:
        # The image of a straight side with a vertex on it may bend inwards by a trace.
        return False

    def take(self, rows: NDArray[np.int64]) -> Self:
        return type(self)(
            self.earth,
            self.start_x[rows],
            self.start_mu[rows],
            self.delta_mu[rows],
            self.rate_x[rows],
            self.into_leg_s[rows],
            self.leg_s[rows],
            self.east[rows],
            self.north[rows],
            self.forward[rows],
            self.starboard[rows],
        )

    def reference(self, t: Floats) -> tuple[Floats, Floats]:
        """Return plane x (metres) and rectifying latitude (radians) of the reference points at times t, (n,) each."""
        progress = (self.into_leg_s + t) / self.leg_s
        mu = self.start_mu + progress * self.delta_mu
        return self.start_x + self.rate_x * progress * self.earth.stretch(self.start_mu, mu), mu

    def positions(self, t: Floats) -> Floats:
        earth = self.earth
        x, mu = self.reference(t)
        mu0, mu1, mu2 = self._steps(mu)
        xy = np.empty((*mu2.shape, 2))
        ahead = self.forward * self.east[:, None] * earth.stretch(mu0, mu1)
        across = self.starboard * self.north[:, None] * earth.stretch(mu1, mu2)
        xy[..., 0] = x[:, None] + earth.radius_m * (ahead + across)
        xy[..., 1] = earth.radius_m * earth.isometric(mu2)
        return xy

    def velocities(self, t: Floats) -> Floats:
        earth = self.earth
        rate = (self.delta_mu / self.leg_s)[:, None]
        mu = self.start_mu + (self.into_leg_s + t) / self.leg_s * self.delta_mu
        mu0, mu1, mu2 = self._steps(mu)
        v = np.empty((*mu2.shape, 2))
        ahead = self.forward * self.east[:, None] * earth.slope_change(mu0, mu1)
        across = self.starboard * self.north[:, None] * earth.slope_change(mu1, mu2)
        reference = self.rate_x / self.leg_s * earth.slope(mu)
        v[..., 0] = reference[:, None] + earth.radius_m * rate * (ahead + across)
        v[..., 1] = earth.radius_m * rate * earth.slope(mu2)
        return v

    def bend(self, t0: Floats, t1: Floats) -> Floats:
        """Return bounds on the second derivative of every vertex (see `Shapes`).

        With mu linear in time at rate w, y = a psi(mu) has y'' = a w^2 sec tan, the reference point
        x'' = rate_x w sec tan / leg_s, and a step's x'' = a w^2 step (sec)'' with (sec)'' = sec (1 + 2 tan^2): all
        increase with latitude, so the highest one reached bounds them.
        """
        w = np.abs(self.delta_mu) / self.leg_s
        highest = self.highest_latitude(t0, t1)
        secant, tangent = 1.0 / np.cos(highest), np.tan(highest)
        radius = self.earth.radius_m
        step = np.abs(self.forward * self.east[:, None]) + np.abs(self.starboard * self.north[:, None])
        y = radius * w**2 * secant * tangent
        x = np.abs(self.rate_x) * w / self.leg_s * secant * tangent
        x = x + radius * w**2 * step.max(axis=1) * secant * (1.0 + 2.0 * tangent**2)
        return np.asarray(ELLIPSOID_SLACK * np.hypot(x, y))

    def highest_latitude(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) the highest absolute latitude (rectifying, radians) of any vertex or step during [t0, t1]."""
        highest = np.zeros(len(self.start_mu))
        # Latitudes are linear in time, so that each is furthest from the equator at one end.
        for t in (t0, t1):
            for mu in self._steps(self.start_mu + (self.into_leg_s + t) / self.leg_s * self.delta_mu):
                highest = np.maximum(highest, np.abs(mu).max(axis=1))
        return highest

    def reach(self) -> Floats:
        """Return (n,) how far in rectifying latitude any vertex lies from the reference point, radians."""
        first = self.forward * self.north[:, None]
        second = first - self.starboard * self.east[:, None]
        return np.abs(second).max(axis=1)

    def offset_bend(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) bounds on how the vertices' offsets from the reference point bend during [t0, t1].

        That is, on their second derivative with respect to psi of the reference point, plane metres.

        With d/dpsi = cos(mu) d/dmu, c the largest cos(mu) and M the highest latitude reached by a vertex:
        x offset = a step sec: second derivative at most a step (c^2 sec M (1 + 2 tan^2 M) + c sec M tan M);
        y offset = a (psi(mu + d) - psi(mu)): at most a c sin d sec^2 M.
        """
        ends = [self.start_mu + (self.into_leg_s + t) / self.leg_s * self.delta_mu for t in (t0, t1)]
        crosses = ends[0] * ends[1] <= 0.0
        lowest = np.where(crosses, 0.0, np.minimum(np.abs(ends[0]), np.abs(ends[1])))
        highest = self.highest_latitude(t0, t1)
        secant, tangent, cosine = 1.0 / np.cos(highest), np.tan(highest), np.cos(lowest)
        step = np.abs(self.forward * self.east[:, None]) + np.abs(self.starboard * self.north[:, None])
        x = step.max(axis=1) * (cosine**2 * secant * (1.0 + 2.0 * tangent**2) + cosine * secant * tangent)
        y = cosine * np.sin(self.reach()) * secant**2
        return np.asarray(ELLIPSOID_SLACK * self.earth.radius_m * np.hypot(x, y))

    def _steps(self, mu: Floats) -> tuple[Floats, Floats, Floats]:
        """Return rectifying latitudes (n, v) of the reference point, after the first and after the second step."""
        mu0 = np.broadcast_to(mu[:, None], self.forward.shape)
        mu1 = mu0 + self.forward * self.north[:, None]
        return mu0, mu1, mu1 - self.starboard * self.east[:, None]


def vertex_slots(pieces: Pieces) -> NDArray[np.int64]:
    """Return (n,) in how many vertices each piece's shape is held: pieces of equal slots can share an array.

    Points and lines are held as they are, polygons in the next power of two. So what is computed of a piece does not
    depend on the company it is in.
    """
    return _slots(np.diff(pieces.shape_offset))


def _slots(count: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.where(count <= 2, count, 2 ** np.ceil(np.log2(np.maximum(count, 1))).astype(np.int64))


def shape_vertices(pieces: Pieces, rows: NDArray[np.int64]) -> Floats:
    """Return the shapes of some pieces of equal slots, (n, v, 2); shorter ones repeat their last vertex."""
    first = pieces.shape_offset[rows]
    count = pieces.shape_offset[rows + 1] - first
    slots = int(_slots(count).max(initial=1))
    index = first[:, None] + np.minimum(np.arange(slots), count[:, None] - 1)
    return pieces.shape_xy[index]


def static_shapes(earth: Earth, pieces: Pieces, rows: NDArray[np.int64]) -> StaticShapes:
    """Return the polygons of some area pieces."""
    xy = shape_vertices(pieces, rows)
    xy[..., 0] += (2.0 * np.pi * earth.radius_m * pieces.turn[rows])[:, None]
    return StaticShapes(xy)


def rhumb_shapes(earth: Earth, pieces: Pieces, rows: NDArray[np.int64], zero_us: NDArray[np.int64]) -> RhumbShapes:
    """Return the havens of some track pieces; row i counts its time from instant zero_us[i]."""
    start, end = pieces.leg_start_deg[rows], pieces.leg_end_deg[rows]
    mu = earth.rectifying(np.radians(start[:, 1]))
    delta_mu = earth.rectifying(np.radians(end[:, 1])) - mu
    delta_lon = np.radians(end[:, 0] - start[:, 0])
    east, north = direction_of(pieces.bearing_deg[rows])
    outline = shape_vertices(pieces, rows) / earth.rectifying_m
    leg_start = pieces.leg_start_us[rows]
    return RhumbShapes(
        earth=earth,
        start_x=earth.radius_m * (np.radians(start[:, 0]) + 2.0 * np.pi * pieces.turn[rows]),
        start_mu=mu,
        delta_mu=delta_mu,
        rate_x=earth.radius_m * delta_lon / earth.stretch(mu, mu + delta_mu),
        into_leg_s=(zero_us - leg_start) / 1e6,
        leg_s=(pieces.leg_end_us[rows] - leg_start) / 1e6,
        east=east,
        north=north,
        forward=outline[..., 1],
        starboard=outline[..., 0],
    )


def shapes_of(earth: Earth, pieces: Pieces, rows: NDArray[np.int64], zero_us: NDArray[np.int64]) -> Shapes:
    """Return the shapes of pieces that are all of one kind; row i counts its time from instant zero_us[i]."""
    if len(rows) and pieces.kind[rows[0]] == Kind.TRACK:
        return rhumb_shapes(earth, pieces, rows, zero_us)
    return static_shapes(earth, pieces, rows)


def padding_m(earth: Earth, highest_psi: Floats, tolerance_m: float, separation_m: float) -> Floats:
    """Return (n,) how far hulls are padded, plane metres.

    That is half of what may lie between two polygons that count as meeting, at the largest scale the piece reaches.
    The scale is convex along a meridian, so half of the way at either piece's largest scale covers the way between
    them; a rhumb line is longer than the geodesic by less than (distance * tan(latitude) / radius)^2.
    """
    wanted = 0.5 * (tolerance_m + separation_m)
    excess = 1.0 + (2.0 * wanted * np.sinh(np.abs(highest_psi)) / earth.rectifying_m) ** 2
    return np.asarray(wanted * excess * earth.plane_scale(np.abs(highest_psi)) + ROUNDING_ALLOWANCE_M)
