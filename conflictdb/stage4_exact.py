"""Stage 4, exact: contact times with a certificate, for many pairs at once.

Of each pair, in this order and only as far as it is needed:

1. *Closed form.* Where both polygons move uniformly and rigidly but for a trace, gaps along the normals of their edges
   are linear in time: the contact is one interval, and the trace bounds its error.
2. *Certified window.* Along a fixed direction the gap of polygons whose vertices move along their chords is concave in
   time: its chord, less the bound on how far vertices leave theirs, shows when the pair is apart for certain.
3. *Ends.* Between a window's end and an instant of overlap the signed separation is brought to zero on the true motion
   (regula falsi), and evaluated on both sides of the answer, beyond what rounding could be worth.
4. *Certificate.* That the pair is apart from the window's end to there follows again from a chord; that it overlaps
   from there on, from the convexity of the separation of rigid polygons in uniform motion.

What this does not settle (grazing, several contacts, polygons without an inside) is left to `stage4_contacts`, which
takes any pair apart by branch and bound.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.geodesy import Floats
from conflictdb.separation import TOUCH_M, Encounters, edges

# Share of the tolerance that the departure from uniform and rigid motion may have in the closed form.
CLOSED_FORM_SHARE: Final = 0.01
# Pairs evaluated together: their arrays stay in the processor's cache.
BLOCK: Final = 2048
# Rounds of window and witness; each shrinks the slack by the square of how much the window shrank.
MAX_WINDOWS: Final = 6
# Steps of regula falsi, and of widening the bracket around the answer by BRACKET_GROWTH each.
MAX_STEPS: Final = 12
MAX_BRACKETS: Final = 4
BRACKET_GROWTH: Final = 8.0
# Half width of the first bracket: so many times what the rounding of positions is worth.
BRACKET_TOUCHES: Final = 3.0
# Halvings that prove an overlap.
MAX_HALVINGS: Final = 12


@dataclass(slots=True)
class Work:
    """What was done: pairs by closed form, windows of pairs, and evaluations of the separation."""

    closed_forms: int = 0
    windows: int = 0
    evaluations: int = 0


@dataclass(frozen=True, slots=True)
class Settled:
    """What is known of n pairs.

    is_clear : (n,) bool   proven apart by more than the margin
    is_solved : (n,) bool  proven to overlap from start_s to end_s, up to error_s, by more than the margin, and to be
        apart else; what is neither is not settled
    start_s, end_s, error_s : (n,) seconds; the true interval lies within, and is shorter by error_s at most at either
        end
    """

    is_clear: NDArray[np.bool_]
    is_solved: NDArray[np.bool_]
    start_s: Floats
    end_s: Floats
    error_s: Floats


def settle_exactly(pairs: Encounters, low: Floats, high: Floats, margin_m: float, work: Work) -> Settled:
    """Return what is certain of like pairs during [low, high], seconds; margin_m >= TOUCH_M on the earth."""
    n = len(pairs)
    found = Settled(np.zeros(n, np.bool_), np.zeros(n, np.bool_), low.copy(), high.copy(), np.zeros(n))
    if pairs.separation_m > 0.0 or max(pairs.a.vertex_count, pairs.b.vertex_count) < 3:
        return found
    for first in range(0, n, BLOCK):
        rows = np.arange(first, min(first + BLOCK, n))
        block = _Block(pairs.take(rows), low[rows], high[rows], margin_m, work)
        block.settle()
        found.is_clear[rows], found.is_solved[rows] = block.is_clear, block.is_solved
        found.start_s[rows], found.end_s[rows], found.error_s[rows] = block.start, block.end, block.error
    return found


class _Block:
    """Pairs settled together; rows number them."""

    def __init__(self, pairs: Encounters, low: Floats, high: Floats, margin_m: float, work: Work) -> None:
        n = len(pairs)
        self.pairs, self.low, self.high, self.work = pairs, low, high, work
        self.margin_m = margin_m
        self.is_clear, self.is_solved = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        self.start, self.end, self.error = low.copy(), high.copy(), np.zeros(n)

    def settle(self) -> None:
        pairs, h = self.pairs, self.high - self.low
        bend = pairs.a.bend(self.low, self.high) + pairs.b.bend(self.low, self.high)
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
            self._windows(rows, bend[rows])

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
        for normal, gap, real in _edge_gaps(a, b, pairs):
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
            solved = ~clear & (sure_start < sure_end) & (deepest < -apart)
            error = np.maximum(sure_start - start, end - sure_end)
        self._keep(rows, clear, solved, start, end, error)

    def _keep(
        self,
        rows: NDArray[np.int64],
        clear: NDArray[np.bool_],
        solved: NDArray[np.bool_],
        start: Floats,
        end: Floats,
        error: Floats,
    ) -> None:
        self.is_clear[rows] = clear
        self.is_solved[rows] = solved
        some = rows[solved]
        self.start[some], self.end[some], self.error[some] = start[solved], end[solved], error[solved]

    def _windows(self, rows: NDArray[np.int64], bend: Floats) -> None:
        """Settle pairs by certified windows, an instant of overlap in them, and their ends."""
        pairs = self.pairs if len(rows) == len(self.low) else self.pairs.take(rows)
        start, end = self.low[rows], self.high[rows]
        for _ in range(MAX_WINDOWS):
            a0, b0, a1, b1 = (
                pairs.a.positions(start),
                pairs.b.positions(start),
                pairs.a.positions(end),
                pairs.b.positions(end),
            )
            h = end - start
            scale = np.maximum(pairs.scale(a0, b0)[0], pairs.scale(a1, b1)[0])
            u, v = _window(a0, b0, a1, b1, bend * h**2 / 8.0 + (self.margin_m + TOUCH_M) * scale)
            self.work.windows += len(rows)
            possible = u <= v
            self.is_clear[rows[~possible]] = True
            keep = np.flatnonzero(possible)
            if not keep.size:
                return
            pairs, rows, bend, scale = pairs.take(keep), rows[keep], bend[keep], scale[keep]
            start, end = (start + u * h)[keep], (start + v * h)[keep]
            middle = 0.5 * (start + end)
            depth = _separation(pairs, pairs.a.positions(middle), pairs.b.positions(middle))
            self.work.evaluations += len(rows)
            meets = depth < -2.0 * TOUCH_M * scale
            deep = np.flatnonzero(meets)
            if deep.size:
                enough = depth[deep] < -(self.margin_m + TOUCH_M) * scale[deep]
                self._ends(
                    pairs.take(deep), rows[deep], start[deep], middle[deep], end[deep], depth[deep], scale[deep], enough
                )
            keep = np.flatnonzero(~meets)
            if not keep.size:
                return
            pairs, rows, bend = pairs.take(keep), rows[keep], bend[keep]
            start, end = start[keep], end[keep]

    def _ends(
        self,
        pairs: Encounters,
        rows: NDArray[np.int64],
        start: Floats,
        middle: Floats,
        end: Floats,
        depth: Floats,
        scale: Floats,
        enough: NDArray[np.bool_],
    ) -> None:
        """Settle pairs that overlap in the middle of a window, and are apart outside of it."""
        n = len(rows)
        both = np.concatenate([np.arange(n), np.arange(n)])
        sides = pairs.take(both)
        limit, inside = np.concatenate([start, end]), np.concatenate([middle, middle])
        touch = np.concatenate([scale, scale]) * TOUCH_M
        inward = np.where(np.arange(2 * n) < n, 1.0, -1.0)
        at_limit = (sides.a.positions(limit), sides.b.positions(limit))
        gap = _separation(sides, *at_limit)
        self.work.evaluations += 2 * n
        # In contact since before the window, or until after it: only where the window is all there is.
        whole = np.concatenate([start <= self.low[rows], end >= self.high[rows]]) & (gap < -touch)
        outer, inner, sure = limit.copy(), limit.copy(), whole.copy()
        active = np.flatnonzero(~whole & (gap > touch))
        if active.size:
            found = self._roots(
                sides.take(active), limit[active], gap[active], inside[active], depth[both[active]], touch[active]
            )
            outer[active], inner[active], sure[active], axis = found
            # Apart from the limit to the outer end: the chord along the axis there, less how far vertices leave theirs.
            clear = np.where(inward[active] > 0.0, outer[active] - limit[active], limit[active] - outer[active])
            a, b = (polygon[:, :, active] for polygon in at_limit)
            some = sides.take(active)
            first, last = np.minimum(limit, outer)[active], np.maximum(limit, outer)[active]
            bend = some.a.bend(first, last) + some.b.bend(first, last)
            along = (axis[0] * b[0] + axis[1] * b[1]).min(axis=0) - (axis[0] * a[0] + axis[1] * a[1]).max(axis=0)
            sure[active] &= (along - touch[active] >= 0.5 * bend * clear**2) | (clear <= 0.0)
        sure &= self._overlaps(sides, inner, inside, depth[both], touch)
        solved = sure[:n] & sure[n:] & enough
        error = np.maximum(np.abs(inner - outer)[:n], np.abs(inner - outer)[n:])
        self._keep(rows, np.zeros(n, np.bool_), solved, outer[:n], outer[n:], error)

    def _roots(
        self, pairs: Encounters, outside: Floats, gap: Floats, inside: Floats, depth: Floats, touch: Floats
    ) -> tuple[Floats, Floats, NDArray[np.bool_], Floats]:
        """Return (outer, inner, found, axis): instants beyond doubt on either side of where the separation is zero.

        axis : (2, n) along which the pair is apart at `outer`
        """
        n = len(gap)
        a, fa, b, fb = outside.copy(), gap.copy(), inside.copy(), depth.copy()
        at, slope = 0.5 * (a + b), np.abs(gap - depth) / np.abs(inside - outside)
        side = np.zeros(n, np.int8)
        active = np.arange(n)
        for _ in range(MAX_STEPS):
            x0, f0, x1, f1 = a[active], fa[active], b[active], fb[active]
            x = x0 + (x1 - x0) * (f0 / (f0 - f1))
            some = pairs if len(active) == n else pairs.take(active)
            f = _separation(some, some.a.positions(x), some.b.positions(x))
            self.work.evaluations += len(active)
            at[active] = x
            with np.errstate(divide="ignore", invalid="ignore"):
                near = np.where(
                    np.abs(x - x0) < np.abs(x - x1), np.abs((f - f0) / (x - x0)), np.abs((f - f1) / (x - x1))
                )
            slope[active] = np.where(np.isfinite(near) & (near > 0.0), near, slope[active])
            outside_now = f > 0.0
            # Illinois: an end that stays twice counts half, so that the other comes over.
            again = side[active] == np.where(outside_now, 1, -1)
            a[active], b[active] = np.where(outside_now, x, x0), np.where(outside_now, x1, x)
            fa[active] = np.where(outside_now, f, np.where(again, 0.5 * f0, f0))
            fb[active] = np.where(outside_now, np.where(again, 0.5 * f1, f1), f)
            side[active] = np.where(outside_now, 1, -1)
            active = active[(np.abs(f) > touch[active]) & (np.abs(b - a)[active] > 4.0 * np.spacing(np.abs(x)))]
            if not active.size:
                break
        outward = np.sign(outside - inside)
        outer, inner, found = outside.copy(), inside.copy(), np.zeros(n, np.bool_)
        axis = np.zeros((2, n))
        half = BRACKET_TOUCHES * touch / slope + 4.0 * np.spacing(np.abs(at))
        active = np.arange(n)
        for _ in range(MAX_BRACKETS):
            some = pairs if len(active) == n else pairs.take(active)
            away = outward[active] * half[active]
            # Not beyond the limit, where it is known to be apart.
            first = at[active] + np.where(np.abs(outside - at)[active] < half[active], (outside - at)[active], away)
            second = at[active] - np.where(np.abs(inside - at)[active] < half[active], (at - inside)[active], away)
            polygons = some.a.positions(first), some.b.positions(first)
            apart, axes = _separation_and_axis(some, *polygons)
            overlap = _separation(some, some.a.positions(second), some.b.positions(second))
            self.work.evaluations += 2 * len(active)
            good = (apart > touch[active]) & (overlap < -touch[active])
            done = active[good]
            outer[done], inner[done], axis[:, done], found[done] = first[good], second[good], axes[:, good], True
            active = active[~good]
            if not active.size:
                break
            half[active] *= BRACKET_GROWTH
        return outer, inner, found, axis

    def _overlaps(self, pairs: Encounters, p: Floats, q: Floats, depth: Floats, touch: Floats) -> NDArray[np.bool_]:
        """Return whether pairs overlap all the way from p, where they do by `touch` or more, to q, by `depth` (< 0).

        With K the unevenness and L the time between, the separation at a share s of it is at most
        (1 - s) f(p) + s (f(q) + 2 K L): no more than -touch where f(p) <= -touch and f(q) <= -touch - 2 K L.
        """
        n = len(p)
        proven = np.ones(n, np.bool_)
        row, some, fp, fq = np.arange(n), pairs, -touch, depth
        for _ in range(MAX_HALVINGS):
            first, last = np.minimum(p, q), np.maximum(p, q)
            most = 2.0 * (some.a.uneven(first, last) + some.b.uneven(first, last)) * (last - first)
            limit = -touch[row] - most
            held = (fp <= limit) | (fq <= limit) | (np.maximum(fp, fq) <= -touch[row] - 0.5 * most)
            open_ = np.flatnonzero(~held & proven[row])
            if not open_.size:
                return proven
            row, p, q, fp, fq = row[open_], p[open_], q[open_], fp[open_], fq[open_]
            middle = 0.5 * (p + q)
            some = pairs.take(row)
            f = _separation(some, some.a.positions(middle), some.b.positions(middle))
            self.work.evaluations += len(row)
            np.logical_and.at(proven, row, f <= -touch[row])
            row = np.concatenate([row, row])
            some = pairs.take(row)
            p, q, fp, fq = (np.concatenate(ends) for ends in ((p, middle), (middle, q), (fp, f), (f, fq)))
        proven[row] = False
        return proven


def _edge_gaps(a: Floats, b: Floats, pairs: Encounters) -> list[tuple[Floats, Floats, NDArray[np.bool_]]]:
    """Return for each edge of both polygons its unit normal from a to b (2, n), the gap along it, and if it is real."""
    found = []
    for mine, other, convex, sign in ((a, b, pairs.a.is_convex, 1.0), (b, a, pairs.b.is_convex, -1.0)):
        count = mine.shape[1]
        for k, m in edges(count, convex=convex):
            normal = np.empty((2, mine.shape[2]))
            np.subtract(mine[1, m], mine[1, k], out=normal[0])
            np.subtract(mine[0, k], mine[0, m], out=normal[1])
            length = np.sqrt(normal[0] ** 2 + normal[1] ** 2)
            real = length > 0.0
            normal /= np.where(real, length, 1.0)
            gap = (normal[0] * other[0] + normal[1] * other[1]).min(axis=0)
            if convex and count > 2:
                gap -= normal[0] * mine[0, k] + normal[1] * mine[1, k]
            else:
                gap -= (normal[0] * mine[0] + normal[1] * mine[1]).max(axis=0)
            found.append((sign * normal, gap, real))
    return found


def _separation(pairs: Encounters, a: Floats, b: Floats) -> Floats:
    """Return (n,) the widest gap along the normals of the edges, plane metres; its sign is that of the separation."""
    widest = np.full(a.shape[2], -np.inf)
    for mine, other, convex in ((a, b, pairs.a.is_convex), (b, a, pairs.b.is_convex)):
        count = mine.shape[1]
        for k, m in edges(count, convex=convex):
            nx, ny = mine[1, m] - mine[1, k], mine[0, k] - mine[0, m]
            gap = (nx * other[0] + ny * other[1]).min(axis=0)
            if convex and count > 2:
                gap -= nx * mine[0, k] + ny * mine[1, k]
            else:
                gap -= (nx * mine[0] + ny * mine[1]).max(axis=0)
            length = nx * nx + ny * ny
            # No edge between vertices that coincide.
            gap /= np.sqrt(np.where(length > 0.0, length, np.nan))
            np.fmax(widest, gap, out=widest)
    return widest


def _separation_and_axis(pairs: Encounters, a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return the widest gap along the normals of the edges, and its axis (2, n) from a to b."""
    widest, axis = np.full(a.shape[2], -np.inf), np.zeros((2, a.shape[2]))
    for normal, gap, real in _edge_gaps(a, b, pairs):
        wider = real & (gap > widest)
        widest = np.where(wider, gap, widest)
        axis = np.where(wider, normal, axis)
    return widest, axis


def _window(a0: Floats, b0: Floats, a1: Floats, b1: Floats, slack: Floats) -> tuple[Floats, Floats]:
    """Return (u, v): shares of the time between two instants outside of which the pairs are apart, u > v if throughout.

    a0, b0, a1, b1 : (2, v, n) vertices at both instants, plane metres
    slack : (n,) what gaps between vertices on their chords must exceed
    """
    n = a0.shape[2]
    u, v = np.zeros(n), np.ones(n)
    for mine0, mine1, other0, other1 in ((a0, a1, b0, b1), (b0, b1, a0, a1)):
        count = mine0.shape[1]
        middle = mine0 + mine1
        for k in range(count if count > 1 else 0):
            m = (k + 1) % count
            nx, ny = middle[1, m] - middle[1, k], middle[0, k] - middle[0, m]
            wanted = slack * np.sqrt(nx * nx + ny * ny)
            g0 = (nx * other0[0] + ny * other0[1]).min(axis=0)
            g0 -= (nx * mine0[0] + ny * mine0[1]).max(axis=0)
            g0 -= wanted
            g1 = (nx * other1[0] + ny * other1[1]).min(axis=0)
            g1 -= (nx * mine1[0] + ny * mine1[1]).max(axis=0)
            g1 -= wanted
            with np.errstate(divide="ignore", invalid="ignore"):
                zero = g0 / (g0 - g1)
            before, after = g0 > 0.0, g1 > 0.0
            np.maximum(u, zero, out=u, where=before & ~after)
            np.minimum(v, zero, out=v, where=after & ~before)
            u[before & after] = 2.0
    return u, v
