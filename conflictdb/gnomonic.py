"""Great circles on the sphere, in the gnomonic plane about a centre, where they are straight.

A haven rides a great circle at constant speed. Each of its vertices is found from the reference point by two great
circle steps: forward along the leg, then to starboard across it. In space such a vertex runs on a small circle,

    V(theta) = cos(theta) P + sin(theta) Q + S,     theta linear in time, P, Q and S constant,

and its image is (x, y) = R (E.V, N.V) / (C.V), with C the centre and E and N its east and north: two trigonometric
functions per haven, and one division per vertex. All vectors are held in the frame (E, N, C).

The scale (plane metres per metre) at an angle c from the centre is sec(c)^2 outward and sec(c) across; it is convex
along every great circle, which is why what bounds it at the ends of a way bounds it in between.

Reference: J. P. Snyder, "Map Projections: A Working Manual", USGS Professional Paper 1395 (1987), section 22.
"""

from dataclasses import dataclass, fields
from typing import Any, Final, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb.arcs import least_chord
from conflictdb.batches import Pieces, ragged_rows
from conflictdb.geodesy import MEAN_RADIUS_M, Floats, direction_of, great_circle_step, shorter_way_deg
from conflictdb.model import MAX_FROM_CENTRE_DEG, Kind
from conflictdb.motion import shape_vertices, vertex_slots

# A distance is taken from plane coordinates up to 1.1e7 m, rounded by 2e-9 m each: this much less is never too much.
_DISTANCE_ROUNDING_M: Final = 1e-8
# Sine of the least turn of a corner, so that rounding of its coordinates does not make it turn inwards.
_LEAST_TURN: Final = 1e-8
# Cosine of the largest angle from the centre; rounding must not refuse what is exactly there.
_LEAST_UP: Final = float(np.cos(np.radians(MAX_FROM_CENTRE_DEG + 1e-9)))


@dataclass(frozen=True, slots=True)
class Gnomonic:
    """The plane that touches the sphere of mean radius at a centre, degrees (see `motion.Plane`)."""

    centre_lon_deg: float
    centre_lat_deg: float

    @property
    def turn_m(self) -> float:
        """There is no seam."""
        return 0.0

    @property
    def is_conformal(self) -> bool:
        return False

    def to_plane(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return plane x and y in metres; NaN for points that are not within 90 degrees of the centre."""
        east, north, up = self.vectors(lon_deg, lat_deg)
        height = np.where(up > 0.0, up, np.nan)
        return MEAN_RADIUS_M * east / height, MEAN_RADIUS_M * north / height

    def from_plane(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[Floats, Floats]:
        """Return longitudes within half a turn of the centre's and latitudes, degrees."""
        x = np.asarray(x_m, dtype=np.float64) / MEAN_RADIUS_M
        y = np.asarray(y_m, dtype=np.float64) / MEAN_RADIUS_M
        sine, cosine = direction_of(self.centre_lat_deg)
        out, axis = cosine - y * sine, sine + y * cosine
        return self.centre_lon_deg + np.degrees(np.arctan2(x, out)), np.degrees(np.arctan2(axis, np.hypot(x, out)))

    @property
    def lines(self) -> str:
        return "great circles"

    @property
    def limit(self) -> str:
        return (
            f"reaches beyond {MAX_FROM_CENTRE_DEG:g} degrees from the scene's centre "
            f"({self.centre_lon_deg:g}, {self.centre_lat_deg:g}), where motion 'great_circle' ends: give the scene a "
            "'centre' in the middle of its objects, split it, or use motion 'rhumb'"
        )

    @property
    def haven_limit(self) -> str:
        return f"the haven {self.limit}"

    def holds(self, lon_deg: Floats, lat_deg: Floats) -> NDArray[np.bool_]:
        return np.asarray(self.vectors(lon_deg, lat_deg)[2] >= _LEAST_UP)

    def holds_havens(self, pieces: Pieces) -> NDArray[np.bool_]:
        reach = np.maximum.reduceat(np.abs(pieces.shape_xy).max(axis=1), pieces.shape_offset[:-1]) / MEAN_RADIUS_M
        held = reach <= np.radians(MAX_FROM_CENTRE_DEG)
        slots = vertex_slots(pieces)
        for count in np.unique(slots[held]):
            rows = np.flatnonzero(held & (slots == count))
            shapes = self.shapes(pieces, rows, pieces.leg_start_us[rows], np.zeros((2, len(rows))))
            leg_s = (pieces.leg_end_us[rows] - pieces.leg_start_us[rows]) / 1e6
            held[rows] = shapes.least_up(np.zeros(len(rows)), leg_s).min(axis=0) >= _LEAST_UP
        return np.asarray(held)

    def courses(self, start_deg: Floats, end_deg: Floats) -> tuple[Floats, Floats, Floats]:
        east, north, cosine = great_circle_step(*start_deg.T, *end_deg.T)
        back_east, back_north, _ = great_circle_step(*end_deg.T, *start_deg.T)
        length = MEAN_RADIUS_M * np.arctan2(np.hypot(east, north), cosine)
        still = (east == 0.0) & (north == 0.0)
        return (
            np.where(still, 0.0, length),
            np.degrees(np.arctan2(east, north)),
            np.degrees(np.arctan2(-back_east, -back_north)),
        )

    def largest_scale(self, points: Floats) -> Floats:
        """Return the scale outward from the centre, sec(c)^2, where it is largest (see `motion.Plane`)."""
        return np.asarray(1.0 + (points[0] ** 2 + points[1] ** 2).max(axis=0) / MEAN_RADIUS_M**2)

    def smallest_scale(self, points: Floats) -> Floats:
        """Return the scale across the way from the centre, sec(c), at the nearest point there may be.

        That of the box about the points, and nearer by its diagonal, for what moves between them.
        """
        low, high = points.min(axis=1), points.max(axis=1)
        nearest = np.maximum(np.maximum(low, -high), 0.0)
        distance = np.hypot(nearest[0], nearest[1]) - np.hypot(high[0] - low[0], high[1] - low[1])
        return np.sqrt(1.0 + (np.maximum(distance, 0.0) / MEAN_RADIUS_M) ** 2)

    def span_m(self, distance_m: Floats | float, scale: Floats) -> Floats:
        """Return the plane metres of the shortest way, which is straight: at most the scale at its ends all along."""
        return np.asarray(distance_m * scale)

    def drift(self, distance_m: Floats | float, scale: Floats, speed: Floats) -> Floats:
        """Return the rate, plane m/s, at which distances may change for points that keep their plane distance.

        With the metric ds^2 = |dx|^2 / A - (x.dx)^2 / (R A)^2, A = sec(c)^2, a shift of x at speed v changes ln ds by
        at most 2 |x| v / R^2; in metres of the plane at the largest scale, A.
        """
        return np.asarray(distance_m * 2.0 * np.sqrt(scale - 1.0) * scale / MEAN_RADIUS_M * speed)

    def slant(self, scale: Floats) -> Floats:
        """Return the largest angle between a step u and its gradient G u, G with the eigenvalues 1 / A and 1 / A^2."""
        return np.arctan(0.5 * (scale - 1.0) / np.sqrt(scale))

    def distance_m(self, a: Floats, b: Floats) -> Floats:
        """Return (n,) the least distance on the sphere of disjoint polygons (2, va, n) and (2, vb, n), plane metres.

        Of two arcs of great circles that do not cross, one has an end that is nearest to the other.
        """
        a, b = a / MEAN_RADIUS_M, b / MEAN_RADIUS_M
        chord = np.minimum(least_chord(a, b), least_chord(b, a))
        distance = MEAN_RADIUS_M * 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
        return np.maximum(distance - _DISTANCE_ROUNDING_M, 0.0)

    def variety(self, pieces: Pieces) -> NDArray[np.int64]:
        """Return (n,) 1 for havens that may not be convex, else 0."""
        variety = np.zeros(len(pieces), np.int64)
        rows = np.flatnonzero(pieces.kind == Kind.TRACK)
        if rows.size:
            offset, index = ragged_rows(pieces.shape_offset, rows)
            variety[rows] = _may_dent(pieces.shape_xy[index] / MEAN_RADIUS_M, offset)
        return variety

    def shapes(
        self, pieces: Pieces, rows: NDArray[np.int64], zero_us: NDArray[np.int64], origin: Floats
    ) -> "GreatCircleShapes":
        leg_start = pieces.leg_start_us[rows]
        legs = GreatCircles.between(self, pieces.leg_start_deg[rows], pieces.leg_end_deg[rows])
        return great_circle_shapes(
            legs.headed(self, pieces.leg_start_deg[rows], pieces.bearing_deg[rows]),
            shape_vertices(pieces, rows),
            (zero_us - leg_start) / 1e6,
            (pieces.leg_end_us[rows] - leg_start) / 1e6,
            origin,
            is_convex=not self.variety(pieces.take(np.unique(rows))).any(),
        )

    def vectors(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> Floats:
        """Return unit vectors (3, ...) towards points, in the frame (E, N, C) of the centre.

        Written with differences from the centre, so that a small scene has small coordinates with all their digits.
        """
        lat = np.asarray(lat_deg, dtype=np.float64)
        turn = self._turn_deg(lon_deg)
        (sine, cosine), (sine0, cosine0), (sine_turn, cosine_turn) = (
            direction_of(angle) for angle in (lat, self.centre_lat_deg, turn)
        )
        versine = 2.0 * np.sin(np.radians(0.5 * turn)) ** 2
        east = cosine * sine_turn
        north = np.sin(np.radians(lat - self.centre_lat_deg)) + sine0 * cosine * versine
        return np.stack(np.broadcast_arrays(east, north, sine0 * sine + cosine0 * cosine * cosine_turn))

    def compass(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return the unit vectors (3, ...) that point east and north at points (at a pole: on their meridian)."""
        (sine, cosine), (sine0, cosine0), (sine_turn, cosine_turn) = (
            direction_of(angle) for angle in (lat_deg, self.centre_lat_deg, self._turn_deg(lon_deg))
        )
        east = np.stack(np.broadcast_arrays(cosine_turn, sine0 * sine_turn, -cosine0 * sine_turn))
        north = np.stack(
            np.broadcast_arrays(
                -sine * sine_turn,
                sine0 * sine * cosine_turn + cosine0 * cosine,
                sine0 * cosine - cosine0 * sine * cosine_turn,
            )
        )
        return east, north

    def _turn_deg(self, lon_deg: ArrayLike) -> Floats:
        """Return longitudes east of the centre's; one meridian is one number, however it is written."""
        lon = np.asarray(lon_deg, dtype=np.float64)
        home = lon - 360.0 * np.round(lon / 360.0)  # exact
        return shorter_way_deg(np.where(home == -180.0, 180.0, home) - self.centre_lon_deg)


@dataclass(frozen=True, slots=True)
class GreatCircles:
    """n legs of great circles, the shorter way from start to end.

    start, heading : (3, n) unit vectors towards the start, and along the leg there (0 where it does not move)
    angle : (n,) length, radians
    """

    start: Floats
    heading: Floats
    angle: Floats

    @classmethod
    def between(cls, plane: Gnomonic, start_deg: Floats, end_deg: Floats) -> Self:
        """Return the legs between points, (n, 2) degrees each.

        Start and heading are orthogonal to the last digit: the heading comes from differences, not from the ends.
        """
        to_east, to_north, cosine = great_circle_step(*start_deg.T, *end_deg.T)
        sine = np.hypot(to_east, to_north)
        east, north = plane.compass(start_deg[:, 0], start_deg[:, 1])
        moves = sine > 0.0
        heading = (to_east * east + to_north * north) / np.where(moves, sine, 1.0)
        return cls(plane.vectors(start_deg[:, 0], start_deg[:, 1]), heading, np.arctan2(sine, cosine))

    @property
    def moves(self) -> NDArray[np.bool_]:
        """Which legs (n,) move; the ends of the others are one place, or opposite ones."""
        return np.asarray((self.heading != 0.0).any(axis=0))

    def headed(self, plane: Gnomonic, start_deg: Floats, bearing_deg: Floats) -> Self:
        """Return the legs with these headings (n,), degrees, where they do not move."""
        east, north = plane.compass(start_deg[:, 0], start_deg[:, 1])
        to_east, to_north = direction_of(bearing_deg)
        still = ~self.moves
        return type(self)(
            self.start,
            np.where(still, to_east * east + to_north * north, self.heading),
            np.where(still, 0.0, self.angle),
        )

    def heading_after(self) -> Floats:
        """Return the unit vectors (3, n) along the legs at their ends."""
        return np.asarray(np.cos(self.angle) * self.heading - np.sin(self.angle) * self.start)


@dataclass(frozen=True, slots=True)
class GreatCircleShapes:
    """Havens on one great circle leg each (see `motion.Shapes`).

    p, q, s : (3, v, n) each vertex is at cos(theta) p + sin(theta) q + s; rows: east and north from the origin, and up
    centre : (3, n) up of the leg's start and of its heading, and up of starboard
    ahead, across : (v, n) haven vertices, radians
    rate : (n,) theta per second; gone : (n,) theta at t = 0
    reference_p, reference_q : (3, n) the same as p and q for the reference point
    is_convex : whether the vertices are known to be in convex position
    """

    p: Floats
    q: Floats
    s: Floats
    centre: Floats
    ahead: Floats
    across: Floats
    rate: Floats
    gone: Floats
    reference_p: Floats
    reference_q: Floats
    is_convex: bool

    @property
    def vertex_count(self) -> int:
        """Vertices per polygon."""
        return int(self.p.shape[1])

    def take(self, rows: NDArray[np.int64]) -> Self:
        """Return the shapes of some rows."""
        arrays: dict[str, Any] = {
            column.name: getattr(self, column.name)[..., rows] for column in fields(self) if column.name != "is_convex"
        }
        return type(self)(is_convex=self.is_convex, **arrays)

    def positions(self, t: Floats) -> Floats:
        """Return the vertices at times t (n,), (2, v, n) plane metres from the rows' origins."""
        theta = self.gone + self.rate * t
        v = np.cos(theta) * self.p + np.sin(theta) * self.q + self.s
        return np.asarray(MEAN_RADIUS_M * v[:2] / v[2])

    def velocities(self, t: Floats) -> Floats:
        """Return the vertices' velocities at times t (n,), (2, v, n) plane metres per second."""
        theta = self.gone + self.rate * t
        cosine, sine = np.cos(theta), np.sin(theta)
        v = cosine * self.p + sine * self.q + self.s
        w = cosine * self.q - sine * self.p
        return np.asarray(MEAN_RADIUS_M * self.rate * (w[:2] - v[:2] / v[2] * w[2]) / v[2])

    def bend(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) bounds on the second derivative of every vertex during [t0, t1], plane metres per s^2.

        A vertex at the angle s from the leg has the velocity v, |v| = w cos s, and the acceleration
        w^2 (sin s S - V). With J the derivative of the projection, of norm R sec(c)^2 at the angle c from the centre,
        x'' = w^2 sin s J(S) - 2 (C.v) / (C.V) x', and |C.v| <= |v| sin c: so |x''| is at most
        R w^2 sec(c)^2 cos s (|sin s| + 2 cos s tan c), which increases with c.
        """
        up = self.least_up(t0, t1)
        secant = 1.0 / up
        tangent = np.sqrt(np.maximum(secant**2 - 1.0, 0.0))
        cosine = np.cos(self.across)
        most = secant**2 * cosine * (np.abs(np.sin(self.across)) + 2.0 * cosine * tangent)
        return np.asarray(MEAN_RADIUS_M * self.rate**2 * most.max(axis=0))

    def velocity(self, t: Floats) -> Floats:
        theta = self.gone + self.rate * t
        cosine, sine = np.cos(theta), np.sin(theta)
        v = cosine * self.reference_p + sine * self.reference_q
        w = cosine * self.reference_q - sine * self.reference_p
        return np.asarray(MEAN_RADIUS_M * self.rate * (w[:2] - v[:2] / v[2] * w[2]) / v[2])

    def uneven(self, t0: Floats, t1: Floats) -> Floats:
        """Return how far the velocities differ in the middle, and by how much they can change until the ends."""
        middle = 0.5 * (t0 + t1)
        away = self.velocities(middle) - self.velocity(middle)[:, None, :]
        return np.asarray(np.hypot(away[0], away[1]).max(axis=0) + 0.5 * (t1 - t0) * self.bend(t0, t1))

    def reference(self, t: Floats) -> Floats:
        """Return the reference points at times t (n,), (2, n) plane metres from the rows' origins."""
        theta = self.gone + self.rate * t
        v = np.cos(theta) * self.reference_p + np.sin(theta) * self.reference_q
        return np.asarray(MEAN_RADIUS_M * v[:2] / v[2])

    def departure(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) how far a vertex may leave the segment between its places at t0 and t1, plane metres.

        And how far its offset from the reference point may leave the segment between its offsets.

        With phi the angle from the leg's point K nearest to the centre, the reference point is linear in u = tan(phi):
        K = cos of that point's angle from the centre, sigma = C.S. A vertex f ahead and s across has
        x_uu = cos(phi)^4 (sin s J(S) + 2 (K cos s sin f - sigma sin s sin phi) / (C.V cos phi) x_phi).
        """
        up = self.least_up(t0, t1)
        along, across = self.centre[:2], self.centre[2]
        nearest = np.hypot(along[0], along[1])
        at_nearest = np.arctan2(along[1], along[0])
        phi0, phi1 = (self.gone + self.rate * t - at_nearest for t in (t0, t1))
        # One of the legs' turns: phi lies within a quarter turn, as the legs lie within 60 degrees of the centre.
        whole = 2.0 * np.pi * np.round(phi0 / (2.0 * np.pi))
        phi0, phi1 = phi0 - whole, phi1 - whole
        least = np.where(phi0 * phi1 <= 0.0, 0.0, np.minimum(np.abs(phi0), np.abs(phi1)))
        cosine, sine = np.cos(least), np.sin(np.maximum(np.abs(phi0), np.abs(phi1)))
        sine_across = np.abs(np.sin(self.across))
        turning = nearest * np.abs(np.sin(self.ahead)) + np.abs(across) * sine_across * sine
        most = (sine_across * cosine**4 + 2.0 * turning * cosine**3 / up) * np.cos(self.across) / up**2
        way = np.sin(phi1 - phi0) / (np.cos(phi0) * np.cos(phi1))
        return np.asarray(MEAN_RADIUS_M * most.max(axis=0) * way**2 / 8.0)

    def largest_scale(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) the largest scale that any vertex reaches during [t0, t1]."""
        return np.asarray(1.0 / self.least_up(t0, t1).min(axis=0) ** 2)

    def time_fraction(self, t0: Floats, t1: Floats, plane_fraction: Floats) -> Floats:
        theta0, theta1 = self.gone + self.rate * t0, self.gone + self.rate * t1
        up0, up1 = (np.cos(theta) * self.centre[0] + np.sin(theta) * self.centre[1] for theta in (theta0, theta1))
        turn = theta1 - theta0
        gone = np.arctan2(
            plane_fraction * up0 * np.sin(turn), (1.0 - plane_fraction) * up1 + plane_fraction * up0 * np.cos(turn)
        )
        return np.clip(np.where(turn > 0.0, gone / np.where(turn > 0.0, turn, 1.0), plane_fraction), 0.0, 1.0)

    def least_up(self, t0: Floats, t1: Floats) -> Floats:
        """Return (v, n) the least C.V of each vertex during [t0, t1]: a cosine, least at one of the ends."""
        ends = []
        for t in (t0, t1):
            theta = self.gone + self.rate * t
            ends.append(np.cos(theta) * self.p[2] + np.sin(theta) * self.q[2] + self.s[2])
        return np.asarray(np.minimum(*ends))


def great_circle_shapes(
    legs: GreatCircles, outline_m: Floats, into_leg_s: Floats, leg_s: Floats, origin: Floats, *, is_convex: bool = False
) -> GreatCircleShapes:
    """Return havens on legs.

    outline_m : (2, v, n) starboard and forward metres
    into_leg_s, leg_s : (n,) seconds of the leg gone at t = 0, and that it takes
    origin : (2, n) plane metres that positions count from
    """
    start, heading = _from_origin(legs.start, origin), _from_origin(legs.heading, origin)
    starboard = np.cross(legs.heading, legs.start, axis=0)
    across, ahead = outline_m / MEAN_RADIUS_M
    cosine = np.cos(across)
    forward, upward = (cosine * np.sin(ahead))[None], (cosine * np.cos(ahead))[None]
    rate = legs.angle / leg_s
    return GreatCircleShapes(
        p=upward * start[:, None] + forward * heading[:, None],
        q=upward * heading[:, None] - forward * start[:, None],
        s=np.sin(across) * _from_origin(starboard, origin)[:, None],
        centre=np.stack([legs.start[2], legs.heading[2], starboard[2]]),
        ahead=ahead,
        across=across,
        rate=rate,
        gone=rate * into_leg_s,
        reference_p=start,
        reference_q=heading,
        is_convex=is_convex,
    )


def _may_dent(outline: Floats, offset: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return (n,) whether a corner of an outline (in radians, concatenated) might turn inwards in the plane.

    Riding along turns a haven in space, and the plane keeps straight what is on a great circle: so a corner turns the
    same way wherever the haven is, and as it does in the plane that touches the sphere at the reference point.
    """
    after = np.arange(len(outline)) + 1
    after[offset[1:] - 1] = offset[:-1]
    ahead = outline[:, 1]
    flat = np.stack([np.tan(outline[:, 0]) / np.cos(ahead), np.tan(ahead)])
    side = flat[:, after] - flat
    length = np.hypot(side[0], side[1])
    turn = side[0] * side[1, after] - side[1] * side[0, after]
    dents = turn <= _LEAST_TURN * length * length[after]
    return np.asarray(np.logical_or.reduceat(dents, offset[:-1]) & (np.diff(offset) > 2))


def _from_origin(vector: Floats, origin: Floats) -> Floats:
    """Return vectors (3, n) with east and north counted from an origin (2, n) of the plane, metres."""
    return np.concatenate([vector[:2] - origin / MEAN_RADIUS_M * vector[2], vector[2:]])
