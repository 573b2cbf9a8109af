"""Stage 4, exact: when polygons touch, each pair modelled only as far as it is needed. See `stage4_exact`."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.geodesy import Floats
from conflictdb.proofs import clear_window
from conflictdb.separation import TOUCH_M, Encounters, edge_gaps, gap_along, separation, separation_and_axis
from conflictdb.stage4_windows import Block, Window, roots

# Share of the tolerance that the departure from uniform and rigid motion may have in the closed form.
CLOSED_FORM_SHARE: Final = 0.01


class Touching(Block):
    """Pairs of polygons that conflict where they touch."""

    def settle(self) -> None:
        """Settle what can be settled, by the closed form where the motion is uniform and rigid."""
        pairs, h = self.pairs, self.high - self.low
        uneven = pairs.a.uneven(self.low, self.high) + pairs.b.uneven(self.low, self.high)
        departure = 0.5 * uneven * h
        # Scales are at least 1, so that metres of the plane are fewer on the earth.
        allowed = CLOSED_FORM_SHARE * (self.margin_m - TOUCH_M) + TOUCH_M
        closed = (departure <= allowed) & (h > 0.0)
        rows = np.flatnonzero(closed)
        if rows.size:
            self._closed_form(rows, departure[rows])
        rows = np.flatnonzero(~closed & (h > 0.0))
        if rows.size:
            some, low, high = pairs.take(rows), self.low[rows], self.high[rows]
            self._windows(rows, some.a.bend(low, high) + some.b.bend(low, high))

    def _closed_form(self, rows: NDArray[np.int64], departure: Floats) -> None:
        """Settle pairs in uniform and rigid motion but for a departure, plane metres."""
        pairs = self.pairs if len(rows) == len(self.low) else self.pairs.take(rows)
        low, high = self.low[rows], self.high[rows]
        middle = 0.5 * (low + high)
        a, b = pairs.a.positions(middle), pairs.b.positions(middle)
        scale = pairs.scale(a, b)[0]
        velocity = pairs.b.velocity(middle) - pairs.a.velocity(middle)
        slack = departure + TOUCH_M * scale
        apart = slack + self.margin_m * scale
        # Windows outside of which the pair is apart by the margin, touches at most, and inside of which it overlaps.
        ends = [[np.full(len(rows), -np.inf), np.full(len(rows), np.inf)] for _ in range(3)]
        gaps: list[tuple[Floats, Floats]] = []
        for normal, gap, real in edge_gaps(pairs, a, b):
            slope = normal[0] * velocity[0] + normal[1] * velocity[1]
            gap = np.where(real, gap, -np.inf)
            gaps.append((gap, slope))
            with np.errstate(divide="ignore", invalid="ignore"):
                inverse = -1.0 / slope
                for (first, last), more in zip(ends, (-apart, -slack, slack), strict=True):
                    # Of a slope of 0, infinities of the right signs: apart for ever, or never.
                    at = (gap + more) * inverse
                    np.fmax(
                        first,
                        np.where(slope < 0.0, at, np.where((slope == 0.0) & (gap + more > 0.0), np.inf, -np.inf)),
                        out=first,
                    )
                    np.fmin(last, np.where(slope > 0.0, at, np.inf), out=last)
        outermost, outer, inner = ([first + middle, last + middle] for first, last in ends)
        self.work.closed_forms += len(rows)
        clear = (outermost[0] > outermost[1]) | (outermost[0] > high) | (outermost[1] < low)
        start, end = np.maximum(outer[0], low), np.minimum(outer[1], high)
        sure_start, sure_end = np.maximum(inner[0], low), np.minimum(inner[1], high)
        # Deep enough in the middle of the contact, and not only from the last instant of the span on.
        deepest = np.full(len(rows), -np.inf)
        with np.errstate(invalid="ignore"):
            at = 0.5 * (sure_start + sure_end) - middle
            for gap, slope in gaps:
                deepest = np.fmax(deepest, gap + slope * at)
            # Of polygons that are points, for they have yet to grow, there is no depth.
            solved = ~clear & (sure_start < sure_end) & (deepest < -apart) & (deepest > -np.inf)
            error = np.maximum(sure_start - start, end - sure_end)
        self._keep(rows, clear, solved, start, end, error)

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
            some = pairs.take(active)

            def measure(rows: NDArray[np.int64], t: Floats) -> Floats:
                return self._depth(some if len(rows) == len(active) else some.take(rows), t, t)

            found = roots(measure, limit[active], gap[active], inside[active], depth[active], touch[active])
            outer[active], inner[active] = found.outer, found.inner
            # Apart from the limit to the outer end: the chord along the axis there, less how far vertices leave theirs.
            axis = separation_and_axis(some, some.a.positions(found.outer), some.b.positions(found.outer))[1]
            first, last = np.minimum(limit[active], found.outer), np.maximum(limit[active], found.outer)
            bend = some.a.bend(first, last) + some.b.bend(first, last)
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
    bend = pairs.a.bend(start, end) + pairs.b.bend(start, end)
    # As a gap of minus the margin, least in the plane where the scale is.
    slack = bend * (end - start) ** 2 / 8.0 + TOUCH_M * largest - margin_m * smallest
    u, v = clear_window(a0, b0, a1, b1, slack)
    middle = start + 0.5 * np.clip(u + v, 0.0, 2.0) * (end - start)
    depth = separation(pairs, pairs.a.positions(middle), pairs.b.positions(middle))
    return u > v, (u <= v) & (depth < -(margin_m + TOUCH_M) * largest)
