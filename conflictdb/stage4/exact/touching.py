"""Stage 4, exact: when polygons touch, each pair modelled only as far as it is needed. See `stage4.exact.solver`."""

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.constants import TOUCH_M
from conflictdb.stage4.distance import edge_gaps, gap_along, separation, separation_and_axis
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.exact.windows import Block, Window
from conflictdb.stage4.proofs import clear_window
from conflictdb.stage4.roots import roots


class Touching(Block):
    """Pairs of polygons that conflict where they touch."""

    def settle(self) -> None:
        """Settle what can be settled, by the closed form where the motion is uniform and rigid."""
        pairs, h = self.pairs, self.high - self.low
        uneven = pairs.a.velocity_spread(self.low, self.high) + pairs.b.velocity_spread(self.low, self.high)
        departure = 0.5 * uneven * h
        # No more than rounding: a wider one would widen every end, by what it takes the pair to close it.
        closed = (departure <= TOUCH_M) & (h > 0.0)
        rows = np.flatnonzero(closed)
        if rows.size:
            self._closed_form(rows, departure[rows])
        rows = np.flatnonzero(~closed & (h > 0.0))
        if rows.size:
            some, low, high = pairs.take(rows), self.low[rows], self.high[rows]
            self._windows(rows, some.a.max_acceleration(low, high) + some.b.max_acceleration(low, high))

    def _closed_form(self, rows: NDArray[np.int64], departure: Floats) -> None:
        """Settle pairs in uniform and rigid motion but for a departure, plane metres."""
        pairs = self.pairs if len(rows) == len(self.low) else self.pairs.take(rows)
        low, high = self.low[rows], self.high[rows]
        middle = 0.5 * (low + high)
        a, b = pairs.a.positions(middle), pairs.b.positions(middle)
        scale = pairs.scale(a, b)[0]
        slack = departure + TOUCH_M * scale
        velocity = pairs.b.velocity(middle) - pairs.a.velocity(middle)
        clear, solved, start, end, error = closed_form(
            edge_gaps(pairs, a, b), velocity, low - middle, high - middle, slack, self.margin_m * scale
        )
        self.work.closed_forms += len(rows)
        self._keep(rows, clear, solved, middle + start, middle + end, error)

    def _wanted_m(self, pairs: Encounters, largest: Floats) -> Floats:
        return (self.margin_m + TOUCH_M) * largest

    def _depth(self, pairs: Encounters, t: Floats, smallest: Floats) -> Floats:
        self.work.evaluations += len(t)
        return separation(pairs, pairs.a.positions(t), pairs.b.positions(t))

    def _solve(self, window: Window) -> None:
        n = len(window.rows)
        pairs, limit, inside, _ = window.sides()
        depth, touch = np.tile(window.depth, 2), np.tile(window.largest, 2) * TOUCH_M
        at_limit = pairs.a.positions(limit), pairs.b.positions(limit)
        gap = separation(pairs, *at_limit)
        self.work.evaluations += 2 * n
        # In contact since before the window, or until after it: only where the window is all there is.
        whole = np.concatenate([window.start <= self.low[window.rows], window.end >= self.high[window.rows]])
        whole &= gap < -touch
        outer, inner, sure = limit.copy(), limit.copy(), whole.copy()
        active = np.flatnonzero(~whole & (gap > touch))
        if active.size:
            some, every = pairs.take(active), np.arange(len(active))

            def measure(rows: NDArray[np.int64], t: Floats) -> Floats:
                return self._depth(some if np.array_equal(rows, every) else some.take(rows), t, t)

            found = roots(measure, limit[active], gap[active], inside[active], depth[active], touch[active])
            outer[active], inner[active] = found.outer, found.inner
            # Apart from the limit to the outer end: the chord along the axis there, less how far vertices leave theirs.
            axis = separation_and_axis(some, some.a.positions(found.outer), some.b.positions(found.outer))[1]
            first, last = np.minimum(limit[active], found.outer), np.maximum(limit[active], found.outer)
            bend = some.a.max_acceleration(first, last) + some.b.max_acceleration(first, last)
            along = gap_along(axis, *(polygon[:, :, active] for polygon in at_limit))
            clear = (along - touch[active] >= 0.5 * bend * (last - first) ** 2) | (first == last)
            sure[active] = found.is_found & clear
        sure &= self._holds(pairs, inner, inside, depth, touch, touch)
        enough = window.depth < -(self.margin_m + TOUCH_M) * window.largest
        error = np.maximum(np.abs(inner - outer)[:n], np.abs(inner - outer)[n:])
        solved = sure[:n] & sure[n:] & enough
        self._keep(window.rows, np.zeros(n, np.bool_), solved, outer[:n], outer[n:], error)


def depth_of(
    pairs: Encounters, start: Floats, end: Floats, margin_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether pairs are proven not to overlap by more than a margin during [start, end], and whether they do."""
    a0, b0, a1, b1 = (shape.positions(t) for t in (start, end) for shape in (pairs.a, pairs.b))
    largest, smallest = pairs.scale(a0, b0, a1, b1)
    bend = pairs.a.max_acceleration(start, end) + pairs.b.max_acceleration(start, end)
    # As a gap of minus the margin, least in the plane where the scale is.
    slack = bend * (end - start) ** 2 / 8.0 + TOUCH_M * largest - margin_m * smallest
    u, v = clear_window(a0, b0, a1, b1, slack)
    middle = start + 0.5 * np.clip(u + v, 0.0, 2.0) * (end - start)
    depth = separation(pairs, pairs.a.positions(middle), pairs.b.positions(middle))
    return u > v, (u <= v) & (depth < -(margin_m + TOUCH_M) * largest)


def closed_form(
    gaps: list[tuple[Floats, Floats, NDArray[np.bool_]]],
    velocity: Floats,
    low: Floats,
    high: Floats,
    slack: Floats,
    margin: Floats,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Floats, Floats, Floats]:
    """Return (clear, solved, start, end, error) of rigid polygons in uniform motion, seconds from where they are.

    gaps : blocks of edges with their normals, gaps, and whether they are real (see `separation.edge_gaps`)
    velocity : (2, n) of b against a; low, high : (n,) seconds; slack, margin : (n,) how uncertain gaps are, and how far
        apart a pair must be to be clear and how deep to be solved, plane metres
    """
    n = len(low)
    first, last = np.full((2, n), -np.inf), np.full((2, n), np.inf)
    apart = slack + margin
    never = np.zeros(n, np.bool_)
    at_edges: list[tuple[Floats, Floats]] = []
    for normal, gap, real in gaps:
        slope = normal[0] * velocity[0] + normal[1] * velocity[1]
        gap = np.where(real, gap, -np.inf)
        at_edges.append((gap, slope))
        nears, leaves = slope < 0.0, slope > 0.0
        still = ~(nears | leaves)
        inverse = 1.0 / np.where(still, 1.0, slope)
        zero, doubt = -gap * inverse, slack * np.abs(inverse)
        # The gap opens or closes at `zero`, give or take the doubt.
        for k, more in enumerate((-doubt, doubt)):
            np.maximum(first[k], np.where(nears, zero + more, -np.inf).max(axis=0), out=first[k])
            np.minimum(last[k], np.where(leaves, zero - more, np.inf).min(axis=0), out=last[k])
        if still.any():
            never |= (still & (gap > apart)).any(axis=0)
            last[0][(still & (gap > slack)).any(axis=0)] = -np.inf
            last[1][(still & (gap > -slack)).any(axis=0)] = -np.inf
    start, end = np.maximum(first[0], low), np.minimum(last[0], high)
    sure_start, sure_end = np.maximum(first[1], low), np.minimum(last[1], high)
    # Where they come no nearer than touching, are they further apart than the margin throughout?
    clear = never
    apart_all = np.flatnonzero((start > end) & ~never)
    if apart_all.size:
        clear[apart_all] = _stays_apart(at_edges, apart_all, low[apart_all], high[apart_all], apart[apart_all])
    # Deep enough in the middle of the contact; polygons without any edge have no depth.
    deepest = np.full(n, -np.inf)
    with np.errstate(invalid="ignore"):
        at = 0.5 * (sure_start + sure_end)
        for gap, slope in at_edges:
            np.fmax(deepest, np.fmax.reduce(gap + slope * at, axis=0), out=deepest)
        solved = ~clear & (sure_start < sure_end) & (deepest < -apart) & np.isfinite(deepest)
        return clear, solved, start, end, np.maximum(sure_start - start, end - sure_end)


def _stays_apart(
    at_edges: list[tuple[Floats, Floats]], rows: NDArray[np.int64], low: Floats, high: Floats, apart: Floats
) -> NDArray[np.bool_]:
    """Return (n,) whether some gap is wider than `apart` at every instant of [low, high]."""
    first, last = low.copy(), high.copy()
    for gap, slope in ((gap[:, rows], slope[:, rows]) for gap, slope in at_edges):
        with np.errstate(divide="ignore", invalid="ignore"):
            at = (apart - gap) / slope
        np.maximum(first, np.where(slope < 0.0, at, -np.inf).max(axis=0), out=first)
        np.minimum(last, np.where(slope > 0.0, at, np.inf).min(axis=0), out=last)
        last[((slope == 0.0) & (gap > apart)).any(axis=0)] = -np.inf
    return first > last
