"""Proofs over intervals of time: that two polygons stay apart throughout, and that they stay in contact throughout.

Apart: the gap along a fixed direction n, min(n.b) - max(n.a), is concave in time if all vertices move straight. So over
an interval of h seconds it is at least its chord, less M h^2 / 8 where accelerations are at most M. That is a
separating axis held over time, as in continuous collision detection (Redon et al.).

In contact: the signed separation of two polygons is convex in time if they move rigidly and uniformly. So it is at most
its chord, plus K h where velocities differ by at most K (the velocity spread).

An interval for which neither is proved is halved, as interval methods do (Moore; Ratschek and Rokne; Snyder et al.),
but with bounds from derivatives (Von Herzen et al.) in the place of interval arithmetic. Short intervals are decided as
in conservative advancement (Mirtich): by the distance, and how fast it may shrink. Nothing is decided by sampling.

References: R. E. Moore, "Interval Analysis" (1966). H. Ratschek, J. Rokne, "New Computer Methods for Global
Optimization" (1988). B. Von Herzen, A. H. Barr, H. R. Zatz, "Geometric collisions for time-dependent parametric
surfaces", SIGGRAPH 1990. J. M. Snyder, A. R. Woodbury, K. Fleischer, B. Currin, A. H. Barr, "Interval methods for
multi-point collisions between time-dependent curved surfaces", SIGGRAPH 1993. B. Mirtich, "Impulse-based dynamic
simulation of rigid body systems", thesis, University of California, Berkeley (1996). S. Redon, A. Kheddar, S.
Coquillart, "Fast continuous collision detection between rigid bodies", Computer Graphics Forum 21 (2002).
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.constants import (
    MAX_INTERVALS,
    MAX_INTERVALS_PER_PAIR,
    MAX_LEVELS,
    MIN_INTERVALS_PER_PAIR,
    NEAR_M,
    SHORTEST_INTERVAL_S,
    TOUCH_M,
)
from conflictdb.stage4.distance import gap_along, nearest
from conflictdb.stage4.encounters import Encounters


class Reason(IntEnum):
    """Why an interval stays undecided."""

    CONTACT = 0  # in contact at the instant `at`
    NEAR = 1  # apart at the instant `at`, but within the margin
    BORDER = 2  # neither is shown, down to the shortest interval, or the work was used up


@dataclass(frozen=True, slots=True)
class Undecided:
    """m intervals of which a proof was not found: row (m,), start, end, at (m,) seconds, reason (m,) `Reason`."""

    row: NDArray[np.int64]
    start: Floats
    end: Floats
    at: Floats
    reason: NDArray[np.int8]


def undecided_separation(
    pairs: Encounters, rows: NDArray[np.int64], start: Floats, end: Floats, margin_m: float
) -> Undecided:
    """Return the intervals of [start, end] in which the clearance of rows is not proven to exceed the margin.

    Outside of the intervals returned, clearance > margin_m is proven. (A negative margin allows that much overlap.) An
    interval is returned whole as soon as its middle is found nearer: it may hold more than is needed, never less.
    """
    found: list[tuple[NDArray[np.int64], Floats, Floats, Floats, NDArray[np.int8]]] = []
    rows, start, end = rows.copy(), start.copy(), end.copy()

    def keep(mask: NDArray[np.bool_], at: Floats, reason: NDArray[np.int8]) -> None:
        found.append((rows[mask], start[mask], end[mask], at[mask], reason[mask]))

    most = pairs.share(MAX_INTERVALS, MIN_INTERVALS_PER_PAIR, MAX_INTERVALS_PER_PAIR)
    for _ in range(MAX_LEVELS):
        if not len(rows):
            break
        middle = 0.5 * (start + end)
        u, v, clearance = _window(pairs, rows, start, middle, end, margin_m)
        open_ = u <= v
        close = open_ & (clearance <= margin_m)
        keep(close, middle, np.where(clearance <= TOUCH_M, Reason.CONTACT, Reason.NEAR).astype(np.int8))
        short = open_ & ~close & (end - start <= SHORTEST_INTERVAL_S)
        crowded = (np.bincount(rows)[rows] > most[rows]) & open_ & ~close & ~short
        keep(short | crowded, middle, np.full(len(rows), Reason.BORDER, np.int8))
        split = open_ & ~close & ~short & ~crowded
        width = (end - start)[split]
        a, b, row = start[split] + u[split] * width, start[split] + v[split] * width, rows[split]
        c = 0.5 * (a + b)
        rows = np.concatenate([row, row])
        start, end = np.concatenate([a, c]), np.concatenate([c, b])
    else:
        keep(np.ones(len(rows), np.bool_), 0.5 * (start + end), np.full(len(rows), Reason.BORDER, np.int8))
    return _undecided(found)


def undecided_contact(pairs: Encounters, rows: NDArray[np.int64], start: Floats, end: Floats) -> Undecided:
    """Return the intervals of [start, end] in which rows are not proven to be in contact throughout.

    Those of reason NEAR are apart at the instant `at`; those of reason BORDER may only touch, or were given up.
    """
    found: list[tuple[NDArray[np.int64], Floats, Floats, Floats, NDArray[np.int8]]] = []
    most = pairs.share(MAX_INTERVALS, MIN_INTERVALS_PER_PAIR, MAX_INTERVALS_PER_PAIR)
    for _ in range(MAX_LEVELS):
        if not len(rows):
            break
        middle, h = 0.5 * (start + end), end - start
        upper = _clearance_upper_bound(pairs, rows, middle, h)
        held, apart = upper < 0.0, upper == np.inf
        short = ~held & ~apart & (h <= SHORTEST_INTERVAL_S)
        crowded = (np.bincount(rows)[rows] > most[rows]) & ~held & ~apart & ~short
        done = apart | short | crowded
        reason = np.where(apart, Reason.NEAR, Reason.BORDER).astype(np.int8)
        found.append((rows[done], start[done], end[done], middle[done], reason[done]))
        split = ~held & ~done
        row, a, b, c = rows[split], start[split], end[split], middle[split]
        rows = np.concatenate([row, row])
        start, end = np.concatenate([a, c]), np.concatenate([c, b])
    return _undecided(found)


def _clearance_upper_bound(pairs: Encounters, rows: NDArray[np.int64], middle: Floats, h: Floats) -> Floats:
    """Return (n,) upper bounds on the clearance during h seconds around instants, plane metres; inf where apart."""
    parts = []
    for batch in pairs.batches(len(rows)):
        some, t, width = pairs.take(rows[batch]), middle[batch], h[batch]
        a, b = some.a.positions(t), some.b.positions(t)
        found = nearest(some, a, b)
        acceleration = some.a.max_acceleration(t - 0.5 * width, t + 0.5 * width) + some.b.max_acceleration(
            t - 0.5 * width, t + 0.5 * width
        )
        rate = _relative_speed(some, t) + acceleration * width
        level = found.gap
        if pairs.separation_m > 0.0:
            ends = [shape.positions(at) for at in (t - 0.5 * width, t + 0.5 * width) for shape in (some.a, some.b)]
            largest = some.scale(*ends)[0]
            rate += pairs.plane.distortion_rate(some.separation_m, largest, _speed(some, t, acceleration * width))
            # The scale is at least 1: a length in plane metres is a bound on the same length in metres on the earth.
            level = found.clearance_m + pairs.distance_error_m(pairs.separation_m)
        bound = level + 0.5 * rate * width
        parts.append(np.where(found.clearance_m > TOUCH_M, np.inf, bound))
    return np.concatenate(parts)


def _undecided(found: list[tuple[NDArray[np.int64], Floats, Floats, Floats, NDArray[np.int8]]]) -> Undecided:
    if not found:
        none = np.empty(0)
        return Undecided(np.empty(0, np.int64), none, none, none, np.empty(0, np.int8))
    columns = [np.concatenate(column) for column in zip(*found, strict=True)]
    order = np.lexsort((columns[1], columns[0]))
    return Undecided(*(column[order] for column in columns))


def _window(
    pairs: Encounters, rows: NDArray[np.int64], start: Floats, middle: Floats, end: Floats, margin_m: float
) -> tuple[Floats, Floats, Floats]:
    """Return (u, v, clearance): fractions of [start, end] outside of which rows are proven clear, u > v if everywhere.

    clearance : (n,) at the middle, metres.
    """
    parts = [
        _window_batch(pairs.take(rows[batch]), start[batch], middle[batch], end[batch], margin_m)
        for batch in pairs.batches(len(rows))
    ]
    u, v, clearance = (np.concatenate(column) for column in zip(*parts, strict=True))
    return u, v, clearance


def _window_batch(
    pairs: Encounters, start: Floats, middle: Floats, end: Floats, margin_m: float
) -> tuple[Floats, Floats, Floats]:
    h = end - start
    wanted_m = pairs.separation_m + margin_m
    shapes = [(pairs.a.positions(t), pairs.b.positions(t)) for t in (start, middle, end)]
    found = [nearest(pairs, *polygons, within_m=max(wanted_m, 0.0) + NEAR_M) for polygons in shapes]
    largest, smallest = pairs.scale(*shapes[0], *shapes[1], *shapes[2])
    # A depth in plane metres is least where the scale is least, and the scale is nowhere below 1.
    wanted = pairs.plane.span_m(wanted_m, largest) if wanted_m >= 0.0 else np.full(len(h), wanted_m)
    acceleration = pairs.a.max_acceleration(start, end) + pairs.b.max_acceleration(start, end)
    away = acceleration * h**2 / 8.0 + wanted + TOUCH_M * largest
    u, v = np.zeros(len(h)), np.ones(len(h))
    for nearest_then in found:
        g0, g1 = (gap_along(nearest_then.axis.T, *shapes[k]) - away for k in (0, 2))
        with np.errstate(divide="ignore", invalid="ignore"):
            zero = g0 / (g0 - g1)
        u = np.maximum(u, np.where(g0 > 0.0, np.where(g1 > 0.0, 2.0, zero), 0.0))
        v = np.minimum(v, np.where((g1 > 0.0) & (g0 <= 0.0), zero, 1.0))
    clearance = found[1].clearance_m
    if wanted_m > 0.0:
        # At the largest scale the separation wanted is too large. So short intervals are decided by the distance in
        # metres on the earth, and how fast it can change. Polygons that overlap have the distance 0.
        distance = np.maximum(clearance + pairs.separation_m, 0.0)
        rate = _relative_speed(pairs, middle) + acceleration * h
        rate += pairs.plane.distortion_rate(distance, largest, _speed(pairs, middle, acceleration * h))
        u = np.where(clearance > margin_m + 0.5 * rate * h / smallest + TOUCH_M, 2.0, u)
    return u, v, clearance


def _relative_speed(pairs: Encounters, t: Floats) -> Floats:
    """Return (n,) the greatest speed of a vertex of b relative to one of a, plane metres per second."""
    a, b = pairs.a.velocities(t), pairs.b.velocities(t)
    low = np.maximum(b.max(axis=1) - a.min(axis=1), a.max(axis=1) - b.min(axis=1))
    return np.asarray(np.hypot(low[0], low[1]))


def _speed(pairs: Encounters, t: Floats, more: Floats) -> Floats:
    """Return (n,) the greatest speed of any vertex plus `more`, plane metres per second."""
    fastest = [np.hypot(v[0], v[1]).max(axis=0) for v in (pairs.a.velocities(t), pairs.b.velocities(t))]
    return np.asarray(np.maximum(*fastest) + more)
