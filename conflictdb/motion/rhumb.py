"""Havens that ride on rhumb lines, in the Mercator plane.

A haven rides a rhumb line at constant speed. Each of its vertices is found from the reference point by two rhumb steps:
forward along the heading, then to starboard across it (rhumb steps do not commute). With S1 and S2 the divided
differences (psi2 - psi1) / (mu2 - mu1) of the two steps, a vertex f forward and s to starboard of a heading (e, n) has
the offset a (f S1 (e, n) + s S2 (n, -e)) from the reference point. No bearing needs a case of its own, and no digits
cancel.

S1 and S2 depend on time only through the latitude mu of the reference point. They are power series in the haven's size,
whose coefficients are one number per haven. Havens that are large against their distance to the pole take the closed
form instead. A haven may change along its leg: then f and s are themselves linear in time (`Growth`).

Reference: Bienkowski, Sidoti, Pattipati, "Interference Identification for Time-Varying Polyhedra", IEEE Access 2021,
section III (constraints on the haven). Deviation: the haven's image in the Mercator plane is not taken as rigid.
"""

from dataclasses import dataclass, fields, replace
from typing import Final, Self

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.pieces import Pieces
from conflictdb.arrays.ragged import ragged_rows
from conflictdb.earth.geodesy import Earth, Floats, direction_of
from conflictdb.motion.contract import Rows, shape_vertices
from conflictdb.results import Kind

# The bounds on curvature below are written for the sphere. On WGS84 d chi/d mu differs from 1 by at most n = 0.0017
# and its derivatives by at most 4 n relative to tan: (1 + n)^3 (1 + 4 n) (1 + 8 n) < 1.03; rounded up.
ELLIPSOID_SLACK: Final = 1.05
# Power series of psi about the middle of a slice: its terms k, and the largest q it is used for, q the way from the
# middle to a vertex over the distance to the pole. The remainder a q^(k + 1) / (k + 1) is below 1e-10 m then. Havens
# with a larger q take the closed form.
SLICE_TERMS: Final = 12
SLICE_REACH: Final = 0.06
# The same of the series about the reference point, for the size of the haven.
HAVEN_TERMS: Final = ((6, 0.005), (SLICE_TERMS, SLICE_REACH))
# In `shape_variant`: beyond all numbers of series and dents.
CHANGES: Final = 8
# A corner is convex in the plane if it turns by so many times the angle that its sides curve by.
CORNER_SLACK: Final = 4.0


@dataclass(frozen=True, slots=True)
class Growth:
    """How havens change on their legs, all per second of the leg.

    forward, starboard : (v, n) change of the vertices, radians
    up, down, step : (n,) change of the numbers of that name in `RhumbShapes`, along their chords over the leg: the
        largest of what is linear in time is convex, so that these bound it
    fastest : (n,) the largest rate of any latitude: of the reference point, after the first and after the second step
    climb : (n,) the largest rate of a vertex's latitude against that of the reference point
    spread : (n,) the largest rate at which a vertex's two steps to the east or west grow
    """

    forward: Floats
    starboard: Floats
    up: Floats
    down: Floats
    step: Floats
    fastest: Floats
    climb: Floats
    spread: Floats

    def take(self, rows: Rows) -> Self:
        return type(self)(*(getattr(self, field.name)[..., rows] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class Middle:
    """The middle of the slice of each leg, and the power series of psi about it.

    at_s : (n,) when the reference point is there, seconds
    point : (2, n) plane metres from the row's origin
    series : (k, n) coefficients of psi(mu + d) - psi(mu) in d, d^2, ...
    """

    at_s: Floats
    point: Floats
    series: Floats


@dataclass(frozen=True, slots=True)
class RhumbShapes:
    """Havens on one rhumb leg each.

    start : (2, n) plane metres of the leg's start from the row's origin, seam shift included
    start_mu, delta_mu : (n,) rectifying latitude of the leg's start and its change over the leg, radians
    rate_x : (n,) plane metres of x per unit of progress times stretch: x(t) = start_x + rate_x * progress * stretch
    into_leg_s : (n,) seconds of the leg gone at t = 0
    leg_s : (n,) seconds the leg takes
    east, north : (n,) components of the heading
    forward, starboard : (v, n) haven vertices, radians of rectifying latitude (metres over rectifying_m); at the start
        of the leg, as up, down and step are
    up, down : (n,) the latitude of the northernmost and southernmost vertex or step, less that of the reference point
    step : (n,) the longest way that any vertex goes to the east or west by its two steps, radians
    order : terms of the power series; 0 is the closed form
    is_convex : whether the vertices are known to be in convex position
    growth : how the havens change on the leg; None where none does
    middle : what the power series are about; None for the closed form
    """

    earth: Earth
    start: Floats
    start_mu: Floats
    delta_mu: Floats
    rate_x: Floats
    into_leg_s: Floats
    leg_s: Floats
    east: Floats
    north: Floats
    forward: Floats
    starboard: Floats
    up: Floats
    down: Floats
    step: Floats
    order: int
    is_convex: bool
    growth: Growth | None = None
    middle: Middle | None = None

    @property
    def vertex_count(self) -> int:
        return int(self.forward.shape[0])

    def take(self, rows: Rows) -> Self:
        return type(self)(
            self.earth,
            self.start[:, rows],
            self.start_mu[rows],
            self.delta_mu[rows],
            self.rate_x[rows],
            self.into_leg_s[rows],
            self.leg_s[rows],
            self.east[rows],
            self.north[rows],
            self.forward[:, rows],
            self.starboard[:, rows],
            self.up[rows],
            self.down[rows],
            self.step[rows],
            self.order,
            self.is_convex,
            None if self.growth is None else self.growth.take(rows),
            None
            if self.middle is None
            else Middle(self.middle.at_s[rows], self.middle.point[:, rows], self.middle.series[:, rows]),
        )

    def counted_from(self, into_leg_s: Floats, origin: Floats) -> Self:
        """Return the same havens, timed from so many seconds into their legs and placed from origins (2, n)."""
        middle = self.middle
        if middle is not None:
            middle = replace(middle, at_s=middle.at_s - into_leg_s, point=middle.point - origin)
        return replace(self, into_leg_s=self.into_leg_s + into_leg_s, start=self.start - origin, middle=middle)

    def centred(self, at_s: Floats) -> Self:
        """Return the same havens, computed by power series about where they are at some instants (n,)."""
        mu = self.start_mu + (self.into_leg_s + at_s) / self.leg_s * self.delta_mu
        series = np.stack(self.earth.isometric_series(mu, SLICE_TERMS))
        return replace(self, middle=Middle(at_s, self.reference(at_s), series))

    def reference(self, t: Floats) -> Floats:
        return self._reference(t)[0]

    def positions(self, t: Floats) -> Floats:
        reference, mu, series = self._reference(t)
        forward, starboard = self._body(t)
        first, second = self._stretches(mu, series, forward, starboard)
        first *= self.earth.radius_m * forward
        second *= self.earth.radius_m * starboard
        found = np.empty((2, *first.shape))
        np.multiply(first, self.east, out=found[0])
        np.multiply(first, self.north, out=found[1])
        found[0] += second * self.north
        found[1] -= second * self.east
        found += reference[:, None, :]
        return found

    def velocities(self, t: Floats) -> Floats:
        """Return the vertices' velocities (see `Shapes`).

        A step f from mu0 to mu1 = mu0 + f n takes x by a e f D(mu0, mu1), D the divided difference of psi. With mu0 at
        rate r, and f itself at rate f', that changes by a e (f r D'(mu0, mu1) + f' psi'(mu1)), D' the divided
        difference of psi': what a growing step adds, it adds at its far end. The second step follows in the same way
        from mu1, which has the rate r + f' n.
        """
        earth, growth = self.earth, self.growth
        rate = self.delta_mu / self.leg_s
        mu = self.start_mu + (self.into_leg_s + t) / self.leg_s * self.delta_mu
        forward, starboard = self._body(t)
        mu0, mu1, mu2 = self._steps(mu, forward, starboard)
        ahead = forward * self.east * earth.slope_change(mu0, mu1)
        across = starboard * self.north * earth.slope_change(mu1, mu2)
        found = np.empty((2, *mu2.shape))
        found[0] = self.rate_x / self.leg_s * earth.slope(mu)
        slope2 = earth.slope(mu2)
        if growth is None:
            found[0] += earth.radius_m * rate * (ahead + across)
            found[1] = earth.radius_m * rate * slope2
            return found
        rate1 = rate + growth.forward * self.north
        ahead = rate * ahead + growth.forward * self.east * earth.slope(mu1)
        across = rate1 * across + growth.starboard * self.north * slope2
        found[0] += earth.radius_m * (ahead + across)
        found[1] = earth.radius_m * (rate1 - growth.starboard * self.east) * slope2
        return found

    def velocity(self, t: Floats) -> Floats:
        mu = self.start_mu + (self.into_leg_s + t) / self.leg_s * self.delta_mu
        return self.earth.slope(mu) / self.leg_s * np.stack([self.rate_x, self.earth.radius_m * self.delta_mu])

    def max_acceleration(self, t0: Floats, t1: Floats) -> Floats:
        """Return bounds on the second derivative of every vertex (see `Shapes`).

        All latitudes are linear in time. With w the largest rate of one, y = a psi(mu) has y'' = a mu'^2 sec tan, the
        reference point x'' = rate_x mu' sec tan / leg_s. A step f goes x = a f e D, D the mean of sec over its way:
        |D'| <= w (sec)', |D''| <= w^2 (sec)'' with (sec)' = sec tan and (sec)'' = sec (1 + 2 tan^2), and as f is linear
        (f D)'' = 2 f' D' + f D''. All increase with latitude, so the highest one reached bounds them.
        """
        own = np.abs(self.delta_mu) / self.leg_s
        w = own if self.growth is None else self.growth.fastest
        secant, tangent = _secant_tangent(self.highest_latitude(t0, t1))
        y = self.earth.radius_m * w**2 * secant * tangent
        x = np.abs(self.rate_x) * own / self.leg_s * secant * tangent
        x += self._step_acceleration(t0, t1, secant, tangent)
        return np.asarray(ELLIPSOID_SLACK * np.sqrt(x**2 + y**2))

    def velocity_spread(self, t0: Floats, t1: Floats) -> Floats:
        """Return how far any vertex's velocity is from that of the reference point in the middle (see `Shapes`).

        The offset of a vertex changes by at most a w step (sec)' in x and a w max(up, -down) (sec)' in y, where
        (sec)' = sec tan, and by a sec times what its steps and its latitude grow by themselves; the velocity of the
        reference point by half of its largest acceleration times the time.
        """
        growth = self.growth
        own = np.abs(self.delta_mu) / self.leg_s
        w = own if growth is None else growth.fastest
        secant, tangent = _secant_tangent(self.highest_latitude(t0, t1))
        up, down, step = self._extent(t0, t1)
        x, y = w * step * tangent, own * np.maximum(up, -down) * tangent
        if growth is not None:
            x, y = x + growth.spread, y + growth.climb
        spread = self.earth.radius_m * secant * np.sqrt(x**2 + y**2)
        return np.asarray(ELLIPSOID_SLACK * spread + 0.5 * self.max_acceleration(t0, t1) * (t1 - t0))

    def highest_latitude(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) the highest absolute latitude (rectifying, radians) of any vertex or step during [t0, t1]."""
        # Latitudes are linear in time, so that each is furthest from the equator at one end.
        ends = [self.start_mu + (self.into_leg_s + t) / self.leg_s * self.delta_mu for t in (t0, t1)]
        if self.growth is None:
            north, south = np.maximum(*ends) + self.up, np.minimum(*ends) + self.down
        else:
            extents = [self._extent(t, t) for t in (t0, t1)]
            north = np.maximum(*(mu + up for mu, (up, _, _) in zip(ends, extents, strict=True)))
            south = np.minimum(*(mu + down for mu, (_, down, _) in zip(ends, extents, strict=True)))
        return np.asarray(np.maximum(north, -south))

    def largest_scale(self, t0: Floats, t1: Floats) -> Floats:
        return self.earth.plane_scale(self.earth.isometric(self.highest_latitude(t0, t1)))

    def time_fraction(self, t0: Floats, t1: Floats, plane_fraction: Floats) -> Floats:
        """Return the fraction of the time from t0 to t1 gone at a fraction of the way in the plane.

        Time is linear in the rectifying latitude, and the way in the plane is linear in the isometric latitude. Their
        ratio is a divided difference, so that an east-west leg needs no case of its own.
        """
        mu0, mu1 = (self.start_mu + (self.into_leg_s + t) / self.leg_s * self.delta_mu for t in (t0, t1))
        stretch = self.earth.stretch(mu0, mu1)
        psi = self.earth.isometric(mu0) + plane_fraction * stretch * (mu1 - mu0)
        mu = self.earth.rectifying_of_isometric(psi)
        return np.clip(plane_fraction * stretch / self.earth.stretch(mu0, mu), 0.0, 1.0)

    def chord_deviation(self, t0: Floats, t1: Floats) -> Floats:
        """Return how far a vertex may leave the hull of the two ends during [t0, t1] (see `Havens`).

        The reference point runs straight. With p the psi of the reference point, a vertex's offset o(p) leaves its
        chord by at most max |o''(p)| (p1 - p0)^2 / 8: with d/dpsi = cos(mu) d/dmu, c the largest cos(mu) and M the
        highest latitude reached by a vertex, x offset = a step sec: second derivative at most a step (c^2 sec M (1 + 2
        tan^2 M) + c sec M tan M); y offset = a (psi(mu + d) - psi(mu)): at most a c sin d sec^2 M.
        """
        if self.growth is not None:
            return np.minimum(self._growing_chord_deviation(self.growth, t0, t1), self._offset_change(t0, t1))
        ends = [self.start_mu + (self.into_leg_s + t) / self.leg_s * self.delta_mu for t in (t0, t1)]
        way = self.earth.isometric(ends[1]) - self.earth.isometric(ends[0])
        crosses = ends[0] * ends[1] <= 0.0
        lowest = np.where(crosses, 0.0, np.minimum(np.abs(ends[0]), np.abs(ends[1])))
        secant, tangent = _secant_tangent(self.highest_latitude(t0, t1))
        cosine = np.cos(lowest)
        x = self.step * (cosine**2 * secant * (1.0 + 2.0 * tangent**2) + cosine * secant * tangent)
        y = cosine * np.sin(np.maximum(self.up, -self.down)) * secant**2
        bent = ELLIPSOID_SLACK * self.earth.radius_m * np.hypot(x, y) * way**2 / 8.0
        return np.minimum(bent, self._offset_change(t0, t1))

    def _offset_change(self, t0: Floats, t1: Floats) -> Floats:
        """Return (n,) bounds on how much any two offsets of a vertex during [t0, t1] differ, plane metres.

        A vertex is off the chord of its offsets by no more: what bends a lot on a leg that is too short to be cut.
        """
        secant, _ = _secant_tangent(self.highest_latitude(t0, t1))
        up, down, step = self._extent(t0, t1)
        largest = self.earth.radius_m * secant * np.hypot(step, np.maximum(up, -down))
        return np.asarray(2.0 * ELLIPSOID_SLACK * largest)

    def _growing_chord_deviation(self, growth: Growth, t0: Floats, t1: Floats) -> Floats:
        """Return `chord_deviation` of havens that change.

        In time, an offset o leaves its own chord by at most |o''| h^2 / 8. Its x is the steps of
        `max_acceleration`; its y is a (psi(mu2) - psi(mu)) with y'' = a (mu2'^2 psi''(mu2) - mu'^2 psi''(mu)), at most
        a (|mu2' - mu'| 2 w sec tan + mu'^2 d sec (1 + 2 tan^2)), d the vertex's latitude against mu. The share of its
        way that the reference point has gone differs from that of the time by at most (mu1 - mu0)^2 psi'' / (psi1 -
        psi0) / 8: that moves the chord by as much of how far the offset changes.
        """
        h, mu0, mu1 = t1 - t0, *(self.start_mu + (self.into_leg_s + t) / self.leg_s * self.delta_mu for t in (t0, t1))
        secant, tangent = _secant_tangent(self.highest_latitude(t0, t1))
        up, down, _ = self._extent(t0, t1)
        y = 2.0 * growth.climb * growth.fastest * tangent
        y += (self.delta_mu / self.leg_s) ** 2 * np.maximum(up, -down) * (1.0 + 2.0 * tangent**2)
        own = np.hypot(self._step_acceleration(t0, t1, secant, tangent), self.earth.radius_m * secant * y) * h**2 / 8.0
        furthest = np.maximum(np.abs(mu0), np.abs(mu1))
        ahead = np.abs(mu1 - mu0) * np.tan(furthest) / np.cos(furthest) / self.earth.stretch(mu0, mu1) / 8.0
        offset0, offset1 = (self.positions(t) - self.reference(t)[:, None, :] for t in (t0, t1))
        change = np.hypot(*(offset1 - offset0)).max(axis=0)
        return np.asarray(ELLIPSOID_SLACK * (own + np.minimum(ahead, 1.0) * change))

    def _step_acceleration(self, t0: Floats, t1: Floats, secant: Floats, tangent: Floats) -> Floats:
        """Return (n,) bounds on the second derivative of the steps' x, plane m/s^2 (see `max_acceleration`)."""
        own = np.abs(self.delta_mu) / self.leg_s
        w = own if self.growth is None else self.growth.fastest
        acceleration = w**2 * self._extent(t0, t1)[2] * secant * (1.0 + 2.0 * tangent**2)
        if self.growth is not None:
            acceleration += 2.0 * self.growth.spread * w * secant * tangent
        return np.asarray(self.earth.radius_m * acceleration)

    def _extent(self, t0: Floats, t1: Floats) -> tuple[Floats, Floats, Floats]:
        """Return up, down and step (see the class) over [t0, t1], (n,) each."""
        growth = self.growth
        if growth is None:
            return self.up, self.down, self.step
        first, last = self.into_leg_s + t0, self.into_leg_s + t1
        return (
            self.up + np.maximum(growth.up * first, growth.up * last),
            self.down + np.minimum(growth.down * first, growth.down * last),
            self.step + np.maximum(growth.step * first, growth.step * last),
        )

    def _body(self, t: Floats) -> tuple[Floats, Floats]:
        """Return the havens' forward and starboard steps (v, n) at times t, radians."""
        if self.growth is None:
            return self.forward, self.starboard
        into = self.into_leg_s + t
        return self.forward + self.growth.forward * into, self.starboard + self.growth.starboard * into

    def _reference(self, t: Floats) -> tuple[Floats, Floats, list[Floats]]:
        """Return the reference points (2, n), their latitudes, and the power series of psi there, if any."""
        progress = (self.into_leg_s + t) / self.leg_s
        mu = self.start_mu + progress * self.delta_mu
        found = np.empty((2, len(mu)))
        if self.middle is None:
            way, origin = progress * self.earth.stretch(self.start_mu, mu), self.start
            series: list[Floats] = []
        else:
            gone = (t - self.middle.at_s) / self.leg_s
            stretch, series = _shifted(self.middle.series, gone * self.delta_mu, self.order)
            way, origin = gone * stretch, self.middle.point
        np.multiply(self.rate_x, way, out=found[0])
        np.multiply(self.earth.radius_m * self.delta_mu, way, out=found[1])
        found += origin
        return found, mu, series

    def _stretches(self, mu: Floats, series: list[Floats], forward: Floats, starboard: Floats) -> tuple[Floats, Floats]:
        """Return the divided differences of psi over the first and the second step of each vertex, (v, n)."""
        if not series:
            mu0, mu1, mu2 = self._steps(mu, forward, starboard)
            return self.earth.stretch(mu0, mu1), self.earth.stretch(mu1, mu2)
        d1 = forward * self.north
        d2 = d1 - starboard * self.east
        # Horner's rule for the series at 0 and d1, and with its steps again for the divided difference at 0, d1, d2.
        first = np.empty_like(d1)
        first[:] = series[-1]
        second = first.copy()
        for g in series[-2::-1]:
            first *= d1
            first += g
            second *= d2
            second += first
        return first, second

    def _steps(self, mu: Floats, forward: Floats, starboard: Floats) -> tuple[Floats, Floats, Floats]:
        """Return rectifying latitudes (v, n) of the reference point, after the first and after the second step."""
        mu0 = np.broadcast_to(mu, forward.shape)
        mu1 = mu0 + forward * self.north
        return mu0, mu1, mu1 - starboard * self.east


def shape_variant(earth: Earth, pieces: Pieces) -> NDArray[np.int64]:
    """Return (n,) a number for the formula of each piece's shape: pieces in one array have the same.

    The sum of: twice the number of the haven's power series (the closed form has the last number), 1 if it may not be
    convex, CHANGES if it changes on its leg.
    """
    found = np.zeros(len(pieces), np.int64)
    rows = np.flatnonzero(pieces.kind == Kind.TRACK.code)
    if rows.size:
        ends = earth.rectifying(np.radians(np.stack([pieces.leg_start_deg[rows, 1], pieces.leg_end_deg[rows, 1]])))
        highest = np.abs(ends).max(axis=0)
        offset, index = ragged_rows(pieces.shape_offset, rows)
        outline = pieces.shape_xy[index] / earth.rectifying_m
        size = np.maximum.reduceat(np.hypot(outline[:, 0], outline[:, 1]), offset[:-1])
        outline_to = outline
        if pieces.changes:
            outline_to = pieces.shape_to_xy[index] / earth.rectifying_m
            size = np.maximum(size, np.maximum.reduceat(np.hypot(outline_to[:, 0], outline_to[:, 1]), offset[:-1]))
            differs = np.logical_or.reduceat((outline_to != outline).any(axis=1), offset[:-1])
            found[rows] = np.where(differs, CHANGES, 0)
        to_pole = 0.5 * np.pi - highest
        series = np.searchsorted([limit for _, limit in HAVEN_TERMS], size / to_pole)
        slice_us = (pieces.end_us - pieces.start_us)[rows] / (pieces.leg_end_us - pieces.leg_start_us)[rows]
        half = 0.5 * np.abs(ends[1] - ends[0]) * slice_us
        series[half + size > SLICE_REACH * to_pole] = len(HAVEN_TERMS)
        tangent = np.tan(np.minimum(highest + size, 1.57))
        found[rows] += 2 * series + _may_dent(outline, outline_to, offset, tangent)
    return found


def shapes_on_legs(earth: Earth, pieces: Pieces) -> RhumbShapes:
    """Return the havens of track pieces, counted from the start of the leg and the plane's own origin."""
    rows = np.arange(len(pieces))
    start, end = pieces.leg_start_deg, pieces.leg_end_deg
    mu = earth.rectifying(np.radians(start[:, 1]))
    delta_mu = earth.rectifying(np.radians(end[:, 1])) - mu
    delta_lon = np.radians(end[:, 0] - start[:, 0])
    outline = shape_vertices(pieces, rows) / earth.rectifying_m
    variants = shape_variant(earth, pieces)
    series, convex = int((variants % CHANGES // 2).max(initial=0)), not (variants % 2).any()
    change = None
    if (variants >= CHANGES).any():
        change = shape_vertices(pieces, rows, at_end=True) / earth.rectifying_m - outline
    lon = np.radians(start[:, 0]) + 2.0 * np.pi * pieces.turn
    shapes = rhumb_shapes(
        earth,
        np.stack([earth.radius_m * lon, earth.radius_m * earth.isometric(mu)]),
        mu,
        delta_mu,
        earth.radius_m * delta_lon / earth.stretch(mu, mu + delta_mu),
        (pieces.leg_end_us - pieces.leg_start_us) / 1e6,
        direction_of(pieces.bearing_deg),
        outline,
        HAVEN_TERMS[series][0] if series < len(HAVEN_TERMS) else 0,
        is_convex=bool(convex),
        change=change,
    )
    if not shapes.order:
        return shapes
    start_s, end_s = ((instant - pieces.leg_start_us) / 1e6 for instant in (pieces.start_us, pieces.end_us))
    return shapes.centred(0.5 * (start_s + end_s))


def rhumb_shapes(
    earth: Earth,
    start: Floats,
    start_mu: Floats,
    delta_mu: Floats,
    rate_x: Floats,
    leg_s: Floats,
    heading: tuple[Floats, Floats],
    outline: Floats,
    order: int,
    *,
    is_convex: bool,
    change: Floats | None = None,
) -> RhumbShapes:
    """Return havens on rhumb legs, timed from their start.

    heading : (east, north), outline : (2, v, n) starboard and forward, radians

    change : (2, v, n) by how much the outline differs at the end of the leg; None where none does
    """
    east, north = heading
    starboard, forward = outline
    up, down, step = _extents(outline, heading)
    growth = None
    if change is not None:
        later = _extents(outline + change, heading)
        rate = change / leg_s
        climb1 = rate[1] * north
        climb2 = climb1 - rate[0] * east
        own = delta_mu / leg_s
        growth = Growth(
            forward=rate[1],
            starboard=rate[0],
            up=(later[0] - up) / leg_s,
            down=(later[1] - down) / leg_s,
            step=(later[2] - step) / leg_s,
            fastest=np.abs(np.stack([np.broadcast_to(own, climb1.shape), own + climb1, own + climb2])).max(axis=(0, 1)),
            climb=np.abs(climb2).max(axis=0),
            spread=(np.abs(rate[1] * east) + np.abs(rate[0] * north)).max(axis=0),
        )
    return RhumbShapes(
        earth,
        start,
        start_mu,
        delta_mu,
        rate_x,
        np.zeros_like(leg_s),
        leg_s,
        east,
        north,
        forward,
        starboard,
        up,
        down,
        step,
        order,
        is_convex,
        growth,
    )


def _shifted(series: Floats, d: Floats, order: int) -> tuple[Floats, list[Floats]]:
    """Return the divided difference over d of a power series, and the first coefficients of the series about d.

    Horner's rule, again and again on its own steps (Shaw, Traub, "On the number of multiplications for the evaluation
    of a polynomial and some of its derivatives", J. ACM 21 (1974), doi:10.1145/321812.321828).
    """
    rows = list(series)
    found = []
    for lowest in (0, *range(order)):
        steps = [rows[-1]]
        for coefficient in rows[-2 : (lowest - 1 if lowest else None) : -1]:
            step = steps[-1] * d
            step += coefficient
            steps.append(step)
        rows[lowest:] = steps[::-1]
        found.append(rows[lowest])
    return found[0], found[1:]


def _extents(outline: Floats, heading: tuple[Floats, Floats]) -> tuple[Floats, Floats, Floats]:
    """Return up, down and step (see `RhumbShapes`) of outlines (2, v, n), radians."""
    east, north = heading
    starboard, forward = outline
    d1 = forward * north
    offsets = np.concatenate([np.zeros_like(d1[:1]), d1, d1 - starboard * east])
    step = (np.abs(forward * east) + np.abs(starboard * north)).max(axis=0)
    return offsets.max(axis=0), offsets.min(axis=0), step


def _may_dent(start: Floats, end: Floats, offset: NDArray[np.int64], tangent: Floats) -> NDArray[np.bool_]:
    """Return (n,) whether a corner of an outline (in radians, concatenated) might turn inwards in the plane.

    Along a side of length d the plane turns against the haven, and its scale changes, by at most d tan(latitude) each.
    A corner that turns by more than its two sides together stays convex. In an outline that changes, a side is longest
    at the start or the end, and a turn is a quadratic in time, bounded by its Bernstein coefficients.
    """
    after = np.arange(len(start)) + 1
    after[offset[1:] - 1] = offset[:-1]
    side = start[after] - start
    length = np.hypot(side[:, 0], side[:, 1])
    # Towards the corner where the next side starts.
    turn = np.abs(_cross(side, side[after]))
    if end is not start:
        last = end[after] - end
        length = np.maximum(length, np.hypot(last[:, 0], last[:, 1]))
        between = 0.5 * (_cross(side, last[after]) + _cross(last, side[after]))
        # Both turn counter-clockwise.
        least = np.minimum(np.minimum(_cross(side, side[after]), _cross(last, last[after])), between)
        changes = (last != side).any(axis=1)
        turn = np.where(changes | changes[after], least, turn)
    allowed = CORNER_SLACK * (length + length[after]) * np.repeat(tangent, np.diff(offset)) + CORNER_SLACK * 1e-9
    flat = turn <= allowed * length * length[after]
    return np.asarray(np.logical_or.reduceat(flat, offset[:-1]) & (np.diff(offset) > 3))


def _cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _secant_tangent(latitude: Floats) -> tuple[Floats, Floats]:
    tangent = np.tan(latitude)
    return np.sqrt(1.0 + tangent**2), tangent
