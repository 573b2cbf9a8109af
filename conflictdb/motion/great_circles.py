"""Havens that ride on great circles of the sphere, as a gnomonic plane shows them.

A haven rides a great circle at constant speed. Each of its vertices is found from the reference point by two great
circle steps: forward along the leg, then to starboard across it. In space such a vertex runs on a small circle,

    V(theta) = cos(theta) P + sin(theta) Q + S,     theta linear in time, P, Q and S constant,

and its image is (x, y) = R (E.V, N.V) / (C.V), with C the centre of the plane and E and N its east and north: two
trigonometric functions per haven, and one division per vertex. All vectors are held in the frame (E, N, C).

A haven may change along its leg: then the steps f forward and s to starboard are linear in time too (`CircleGrowth`),

    V = cos(s) e + sin(s) S,     e = cos(theta + f) A + sin(theta + f) B,

A and B the start and the heading of the leg. With a the rate of theta + f, s' that of s and d the way along the leg,
V' = a cos(s) d + s' (cos(s) S - sin(s) e) and V'' = -(a^2 + s'^2) V + a^2 sin(s) S - 2 a s' sin(s) d.
"""

from dataclasses import dataclass, fields
from typing import Any, Final, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from conflictdb.earth.geodesy import MEAN_RADIUS_M, Floats, direction_of, great_circle_step
from conflictdb.model import MAX_FROM_CENTRE_DEG
from conflictdb.motion.contract import Rows

# Cosine of the largest angle from the centre. The angle is a little larger than allowed, so that rounding refuses no
# place that is exactly at the limit.
LEAST_UP: Final = float(np.cos(np.radians(MAX_FROM_CENTRE_DEG + 1e-9)))
# How far ahead or across a haven that changes may reach, radians. A vertex further ahead could be more than a quarter
# turn from the centre, although the leg is not: then the bounds below would not hold.
MAX_CHANGING_REACH: Final = float(np.radians(90.0 - MAX_FROM_CENTRE_DEG))


class Frame(Protocol):
    """East and north of the centre of a plane, and the centre: what vectors (3, ...) are held in."""

    def vectors(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> Floats:
        """Return unit vectors towards points."""

    def compass(self, lon_deg: ArrayLike, lat_deg: ArrayLike) -> tuple[Floats, Floats]:
        """Return the unit vectors that point east and north at points."""


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
    def between(cls, frame: Frame, start_deg: Floats, end_deg: Floats) -> Self:
        """Return the legs between points, (n, 2) degrees each.

        Start and heading are orthogonal to the last digit: the heading comes from differences, not from the ends.
        """
        to_east, to_north, cosine = great_circle_step(*start_deg.T, *end_deg.T)
        sine = np.hypot(to_east, to_north)
        east, north = frame.compass(start_deg[:, 0], start_deg[:, 1])
        moves = sine > 0.0
        heading = (to_east * east + to_north * north) / np.where(moves, sine, 1.0)
        return cls(frame.vectors(start_deg[:, 0], start_deg[:, 1]), heading, np.arctan2(sine, cosine))

    @property
    def moves(self) -> NDArray[np.bool_]:
        """Which legs (n,) move; the ends of the others are one place, or opposite ones."""
        return np.asarray((self.heading != 0.0).any(axis=0))

    def headed(self, frame: Frame, start_deg: Floats, bearing_deg: Floats) -> Self:
        """Return the legs with these headings (n,), degrees, where they do not move."""
        east, north = frame.compass(start_deg[:, 0], start_deg[:, 1])
        to_east, to_north = direction_of(bearing_deg)
        still = ~self.moves
        return type(self)(
            self.start,
            np.where(still, to_east * east + to_north * north, self.heading),
            np.where(still, 0.0, self.angle),
        )


@dataclass(frozen=True, slots=True)
class CircleGrowth:
    """How havens change on their legs.

    ahead, across : (v, n) change of the vertices, radians per second
    starboard : (3, n) to starboard of the leg; east and north from the origin
    """

    ahead: Floats
    across: Floats
    starboard: Floats

    def take(self, rows: Rows) -> Self:
        """Return the changes of some rows."""
        return type(self)(self.ahead[:, rows], self.across[:, rows], self.starboard[:, rows])


@dataclass(frozen=True, slots=True)
class GreatCircleShapes:
    """Havens on one great circle leg each (see `motion.Shapes`).

    p, q, s : (3, v, n) each vertex is at cos(theta) p + sin(theta) q + s; rows: east and north from the origin, and up;
        as it is at t = 0 where havens change
    centre : (3, n) up of the leg's start and of its heading, and up of starboard
    ahead, across : (v, n) haven vertices at t = 0, radians
    rate : (n,) theta per second; gone : (n,) theta at t = 0
    reference_p, reference_q : (3, n) the same as p and q for the reference point
    is_convex : whether the vertices are known to be in convex position
    growth : how the havens change on the leg; None where none does
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
    growth: CircleGrowth | None = None

    @property
    def vertex_count(self) -> int:
        """Vertices per polygon."""
        return int(self.p.shape[1])

    def take(self, rows: Rows) -> Self:
        """Return the shapes of some rows."""
        arrays: dict[str, Any] = {
            column.name: getattr(self, column.name)[..., rows]
            for column in fields(self)
            if column.name not in ("is_convex", "growth")
        }
        growth = None if self.growth is None else self.growth.take(rows)
        return type(self)(is_convex=self.is_convex, growth=growth, **arrays)

    def positions(self, t: Floats) -> Floats:
        """Return the vertices at times t (n,), (2, v, n) plane metres from the rows' origins."""
        v = self._vectors(t)
        return np.asarray(MEAN_RADIUS_M * v[:2] / v[2])

    def velocities(self, t: Floats) -> Floats:
        """Return the vertices' velocities at times t (n,), (2, v, n) plane metres per second."""
        theta, v = self.gone + self.rate * t, self._vectors(t)
        if self.growth is None:
            w = np.cos(theta) * self.q - np.sin(theta) * self.p
            return np.asarray(MEAN_RADIUS_M * self.rate * (w[:2] - v[:2] / v[2] * w[2]) / v[2])
        ahead, across = self._body(t)
        e, along = _turned(self.reference_p, self.reference_q, theta + ahead)
        w = (self.rate + self.growth.ahead) * np.cos(across) * along
        w += self.growth.across * (np.cos(across) * self.growth.starboard[:, None] - np.sin(across) * e)
        return np.asarray(MEAN_RADIUS_M * (w[:2] - v[:2] / v[2] * w[2]) / v[2])

    def max_acceleration(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) bounds on the second derivative of every vertex during [t0, t1], plane metres per s^2.

        With J the derivative of the projection, of norm R sec(c)^2 at the angle c from the centre, and J(V) = 0,
        x'' = J(V'') - 2 (C.V') / (C.V) x', |C.V'| <= |V'| sin c and |V'|^2 = a^2 cos(s)^2 + s'^2 (see the module; of S
        only cos(s) counts): so |x''| is at most R sec(c)^2 times
        a^2 |sin s| cos s + 2 |a s' sin s| + 2 (a^2 cos(s)^2 + s'^2) tan c, which increases with c.
        """
        up = self._up(t0, t1)
        secant = 1.0 / up
        tangent = np.sqrt(np.maximum(secant**2 - 1.0, 0.0))
        if self.growth is None:
            cosine = np.cos(self.across)
            most = secant**2 * cosine * (np.abs(np.sin(self.across)) + 2.0 * cosine * tangent)
            return np.asarray(MEAN_RADIUS_M * self.rate**2 * most.max(axis=0))
        _, sine, cosine = self._extent(t0, t1)
        a, s = np.abs(self.rate + self.growth.ahead), np.abs(self.growth.across)
        most = a**2 * sine * cosine + 2.0 * a * s * sine + 2.0 * ((a * cosine) ** 2 + s**2) * tangent
        return np.asarray(MEAN_RADIUS_M * (secant**2 * most).max(axis=0))

    def velocity(self, t: Floats) -> Floats:
        """Return the velocities of the reference points at times t (n,), (2, n) plane metres per second."""
        theta = self.gone + self.rate * t
        cosine, sine = np.cos(theta), np.sin(theta)
        v = cosine * self.reference_p + sine * self.reference_q
        w = cosine * self.reference_q - sine * self.reference_p
        return np.asarray(MEAN_RADIUS_M * self.rate * (w[:2] - v[:2] / v[2] * w[2]) / v[2])

    def velocity_spread(self, t0: Floats, t1: Floats) -> Floats:
        """Return how far the velocities differ in the middle, and by how much they can change until the ends."""
        middle = 0.5 * (t0 + t1)
        away = self.velocities(middle) - self.velocity(middle)[:, None, :]
        return np.asarray(np.hypot(away[0], away[1]).max(axis=0) + 0.5 * (t1 - t0) * self.max_acceleration(t0, t1))

    def reference(self, t: Floats) -> Floats:
        """Return the reference points at times t (n,), (2, n) plane metres from the rows' origins."""
        theta = self.gone + self.rate * t
        v = np.cos(theta) * self.reference_p + np.sin(theta) * self.reference_q
        return np.asarray(MEAN_RADIUS_M * v[:2] / v[2])

    def chord_deviation(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) how far a vertex may leave the segment between its places at t0 and t1, plane metres.

        And how far its offset from the reference point may leave the segment between its offsets.

        With phi the angle from the leg's point K nearest to the centre, the reference point is linear in u = tan(phi):
        K = cos of that point's angle from the centre, sigma = C.S. A vertex f ahead and s across has
        x_uu = cos(phi)^4 (sin s J(S) + 2 (K cos s sin f - sigma sin s sin phi) / (C.V cos phi) x_phi).
        """
        up = self._up(t0, t1)
        phi0, phi1 = self._phi(t0, t1)
        nearest = np.hypot(self.centre[0], self.centre[1])
        least = np.where(phi0 * phi1 <= 0.0, 0.0, np.minimum(np.abs(phi0), np.abs(phi1)))
        cosine, sine = np.cos(least), np.sin(np.maximum(np.abs(phi0), np.abs(phi1)))
        sine_ahead, sine_across, cosine_across = self._extent(t0, t1)
        turning = nearest * sine_ahead + np.abs(self.centre[2]) * sine_across * sine
        most = (sine_across * cosine**4 + 2.0 * turning * cosine**3 / up) * cosine_across / up**2
        way = np.sin(phi1 - phi0) / (np.cos(phi0) * np.cos(phi1))
        if self.growth is not None:
            return self._growing_chord_deviation(self.growth, t0, t1, most)
        return np.asarray(MEAN_RADIUS_M * most.max(axis=0) * way**2 / 8.0)

    def _growing_chord_deviation(self, growth: CircleGrowth, t0: Floats, t1: Floats, most: Floats) -> Floats:
        """Return `chord_deviation` of havens that change; most : (v, n) bounds on x_uu of what does not.

        In time, an offset o leaves its own chord by at most |o''| h^2 / 8. With subscripts the partial derivatives of
        x(phi, f, s), of which x_f = x_phi, phi' = w and u' = w sec(phi)^2, and X the reference point, linear in u,
        o'' = x_uu u'^2 + 2 w^2 tan(phi) (x_phi - X_phi) + 2 w (x_ff f' + x_fs s') + x_ff f'^2 + 2 x_fs f' s' +
        x_ss s'^2,
        where x_phi - X_phi is at most |f| max |x_ff| + |s| max |x_fs| on the way from X to x. As in `max_acceleration`,
        over R sec(c)^2, |x_ff| <= |sin s| + 2 tan c, |x_fs| <= |sin s| + 2 tan c and |x_ss| <= 2 tan c. The chord is
        off by `share_deviation` of the change of the offset.
        """
        h, (phi0, phi1) = t1 - t0, self._phi(t0, t1)
        furthest = np.maximum(np.abs(phi0), np.abs(phi1))
        secant, tangent = 1.0 / np.cos(furthest), np.tan(furthest)
        _, sine, _ = self._extent(t0, t1)
        bodies = self._body(t0), self._body(t1)
        ahead, across = (np.maximum(np.abs(x), np.abs(y)) for x, y in zip(*bodies, strict=True))
        # On the way from the reference point to the vertex, as in `least_up`.
        up = np.minimum(self._up(t0, t1), self._reference_up(t0, t1)) - _sag(ahead, across, sine)
        scale = 1.0 / up**2
        outward = 2.0 * np.sqrt(np.maximum(scale - 1.0, 0.0))
        mixed, ss = scale * (sine + outward), scale * outward
        f, s = np.abs(growth.ahead), np.abs(growth.across)
        second = most * (self.rate * secant**2) ** 2 + 2.0 * self.rate**2 * tangent * (ahead + across) * mixed
        second += (2.0 * self.rate * (f + s) + f**2 + 2.0 * f * s) * mixed + s**2 * ss
        offset0, offset1 = (self.positions(t) - self.reference(t)[:, None, :] for t in (t0, t1))
        change = np.hypot(*(offset1 - offset0)).max(axis=0)
        return np.asarray(MEAN_RADIUS_M * second.max(axis=0) * h**2 / 8.0 + self.share_deviation(t0, t1) * change)

    def share_deviation(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) by how much the reference point's share of its way may differ from the share of the time.

        With u = tan(phi) (see `chord_deviation`) by at most max |u_tt| h^2 / (8 |u1 - u0|), u_tt = 2 w^2 sec(phi)^2
        tan(phi).
        """
        phi0, phi1 = self._phi(t0, t1)
        furthest = np.maximum(np.abs(phi0), np.abs(phi1))
        way = np.abs(np.tan(phi1) - np.tan(phi0))
        turn = self.rate * (t1 - t0)
        late = 2.0 * (turn / np.cos(furthest)) ** 2 * np.tan(furthest) / np.where(way > 0.0, way, np.inf) / 8.0
        return np.asarray(np.minimum(late, 1.0))

    def largest_scale(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) the largest scale that any vertex reaches during [t0, t1]."""
        return np.asarray(1.0 / self._up(t0, t1).min(axis=0) ** 2)

    def time_fraction(self, t0: Floats, t1: Floats, plane_fraction: Floats) -> Floats:
        """Return (n,) the fraction of the time from t0 to t1 gone at a fraction of the way in the plane."""
        theta0, theta1 = self.gone + self.rate * t0, self.gone + self.rate * t1
        up0, up1 = (np.cos(theta) * self.centre[0] + np.sin(theta) * self.centre[1] for theta in (theta0, theta1))
        turn = theta1 - theta0
        gone = np.arctan2(
            plane_fraction * up0 * np.sin(turn), (1.0 - plane_fraction) * up1 + plane_fraction * up0 * np.cos(turn)
        )
        return np.clip(np.where(turn > 0.0, gone / np.where(turn > 0.0, turn, 1.0), plane_fraction), 0.0, 1.0)

    def least_up(self, t0: Floats, t1: Floats) -> Floats:
        """Return (v, n) what C.V of each vertex is at least during [t0, t1].

        It is a cosine, least at one of the ends. Of havens that change, (C.V)'' = -a^2 cos(s) C.e - s'^2 C.V -
        2 a s' sin(s) C.d, of which only what is positive lets C.V sag below its chord. C.e is not negative within
        MAX_CHANGING_REACH; the second term counts as if C.V could be -1.
        """
        least = np.minimum(self._vectors(t0)[2], self._vectors(t1)[2])
        if self.growth is not None:
            h, (_, sine, _) = t1 - t0, self._extent(t0, t1)
            least = least - _sag((self.rate + self.growth.ahead) * h, self.growth.across * h, sine)
        return np.asarray(least)

    def _up(self, t0: Floats, t1: Floats) -> Floats:
        """Return `least_up`; it is known to be enough of havens that a scene holds."""
        up = self.least_up(t0, t1)
        return up if self.growth is None else np.maximum(up, LEAST_UP)

    def _reference_up(self, t0: Floats, t1: Floats) -> Floats:
        thetas = (self.gone + self.rate * t for t in (t0, t1))
        return np.minimum(*(np.cos(theta) * self.centre[0] + np.sin(theta) * self.centre[1] for theta in thetas))

    def _phi(self, t0: Floats, t1: Floats) -> tuple[Floats, Floats]:
        """Return (n,) the angles at t0 and t1 from the leg's point nearest to the centre.

        Both are within a quarter turn. With C the reference point's angle from the centre and K that of the nearest
        point, cos(phi) = cos(C) / cos(K), which is positive as legs stay within 60 degrees of the centre; and a leg is
        shorter than half a turn.
        """
        at_nearest = np.arctan2(self.centre[1], self.centre[0])
        return self.gone + self.rate * t0 - at_nearest, self.gone + self.rate * t1 - at_nearest

    def _body(self, t: Floats) -> tuple[Floats, Floats]:
        """Return how far ahead and across the vertices (v, n) are at times t, radians."""
        if self.growth is None:
            return self.ahead, self.across
        return self.ahead + self.growth.ahead * t, self.across + self.growth.across * t

    def _extent(self, t0: Floats, t1: Floats) -> tuple[Floats, Floats, Floats]:
        """Return (v, n) the largest |sin(ahead)|, |sin(across)| and cos(across) during [t0, t1]."""
        (ahead0, across0), (ahead1, across1) = self._body(t0), self._body(t1)
        ahead, across = (np.maximum(np.abs(x), np.abs(y)) for x, y in ((ahead0, ahead1), (across0, across1)))
        least = np.where(across0 * across1 <= 0.0, 0.0, np.minimum(np.abs(across0), np.abs(across1)))
        return np.sin(ahead), np.sin(across), np.cos(least)

    def _vectors(self, t: Floats) -> Floats:
        """Return (3, v, n) the vertices at times t; east and north from the origin."""
        theta = self.gone + self.rate * t
        if self.growth is None:
            return np.asarray(np.cos(theta) * self.p + np.sin(theta) * self.q + self.s)
        ahead, across = self._body(t)
        e, _ = _turned(self.reference_p, self.reference_q, theta + ahead)
        return np.asarray(np.cos(across) * e + np.sin(across) * self.growth.starboard[:, None])


def great_circle_shapes(
    legs: GreatCircles,
    outline_m: Floats,
    into_leg_s: Floats,
    leg_s: Floats,
    origin: Floats,
    *,
    is_convex: bool = False,
    change_m: Floats | None = None,
) -> GreatCircleShapes:
    """Return havens on legs.

    outline_m : (2, v, n) starboard and forward metres
    into_leg_s, leg_s : (n,) seconds of the leg gone at t = 0, and that it takes
    origin : (2, n) plane metres that positions count from
    change_m : (2, v, n) by how much the outline differs at the end of the leg; None where none does
    """
    start, heading = _from_origin(legs.start, origin), _from_origin(legs.heading, origin)
    starboard = np.cross(legs.heading, legs.start, axis=0)
    to_starboard = _from_origin(starboard, origin)
    growth = None
    if change_m is not None:
        change = change_m / MEAN_RADIUS_M / leg_s
        growth = CircleGrowth(ahead=change[1], across=change[0], starboard=to_starboard)
        outline_m = outline_m + change_m * (into_leg_s / leg_s)
    across, ahead = outline_m / MEAN_RADIUS_M
    cosine = np.cos(across)
    forward, upward = (cosine * np.sin(ahead))[None], (cosine * np.cos(ahead))[None]
    rate = legs.angle / leg_s
    return GreatCircleShapes(
        p=upward * start[:, None] + forward * heading[:, None],
        q=upward * heading[:, None] - forward * start[:, None],
        s=np.sin(across) * to_starboard[:, None],
        centre=np.stack([legs.start[2], legs.heading[2], starboard[2]]),
        ahead=ahead,
        across=across,
        rate=rate,
        gone=rate * into_leg_s,
        reference_p=start,
        reference_q=heading,
        is_convex=is_convex,
        growth=growth,
    )


def _sag(turn: Floats, across: Floats, sine: Floats) -> Floats:
    """Return how far C.V may sag below its chord on a way that turns V by these angles (see `least_up`).

    sine : the largest |sin(s)| on the way
    """
    return np.asarray((2.0 * np.abs(turn * across) * sine + across**2) / 8.0)


def _turned(p: Floats, q: Floats, angle: Floats) -> tuple[Floats, Floats]:
    """Return (3, v, n) the vectors at angles (v, n) from p towards q, (3, n) both, and the way along there."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return cosine * p[:, None] + sine * q[:, None], cosine * q[:, None] - sine * p[:, None]


def _from_origin(vector: Floats, origin: Floats) -> Floats:
    """Return vectors (3, n) with east and north counted from an origin (2, n) of the plane, metres."""
    return np.concatenate([vector[:2] - origin / MEAN_RADIUS_M * vector[2], vector[2:]])
