"""Stage 4, exact: when polygons are closer than a distance on the earth. See `stage4.exact.solver`.

The plane decides most: what is further apart than the distance at the largest scale reached is clear, what is nearer
than at the smallest is in conflict. In the zone between, the distance on the earth is brought to what is wanted, and
the zone holds no other change where the polygons close in beyond doubt: every two points that could be the nearest ones
approach each other.
"""

import numpy as np
from numpy.typing import NDArray

from conflictdb.earth.geodesy import Floats
from conflictdb.stage4.constants import TOUCH_M
from conflictdb.stage4.distance import nearest, plane_distance
from conflictdb.stage4.encounters import Encounters
from conflictdb.stage4.exact.windows import Block, Window
from conflictdb.stage4.roots import roots

# The zone is left where the polygons are nearer than at the smallest scale by this share of the distance wanted.
_INTO_SHARE = 1e-3


class Separated(Block):
    """Pairs of polygons that conflict where they are closer than the separation."""

    # The scale varies less in a short window, so that the zone in doubt is narrower.
    least_windows = 3

    def settle(self) -> None:
        """Settle what can be settled."""
        rows = np.flatnonzero(self.high > self.low)
        if rows.size:
            pairs = self.pairs.take(rows)
            low, high = self.low[rows], self.high[rows]
            self._windows(rows, pairs.a.max_acceleration(low, high) + pairs.b.max_acceleration(low, high))

    def _wanted_m(self, pairs: Encounters, largest: Floats) -> Floats:
        return pairs.plane.span_m(pairs.separation_m + self.margin_m, largest) + TOUCH_M * largest

    def _depth(self, pairs: Encounters, t: Floats, smallest: Floats) -> Floats:
        self.work.evaluations += len(t)
        distance, _ = plane_distance(pairs, pairs.a.positions(t), pairs.b.positions(t))
        return distance - pairs.separation_m * smallest

    def _excess_m(self, pairs: Encounters, t: Floats) -> Floats:
        self.work.evaluations += len(t)
        return nearest(pairs, pairs.a.positions(t), pairs.b.positions(t)).clearance_m

    def _solve(self, window: Window) -> None:
        n = len(window.rows)
        pairs, limit, inside, inward = window.sides()
        depth = np.tile(window.depth, 2)
        largest, smallest = np.tile(window.largest, 2), np.tile(window.smallest, 2)
        touch = largest * TOUCH_M
        at_limit = self._depth(pairs, limit, smallest)
        whole = np.concatenate([window.start <= self.low[window.rows], window.end >= self.high[window.rows]])
        whole &= at_limit < -touch
        outer, inner, zone_end, sure = limit.copy(), limit.copy(), limit.copy(), whole.copy()
        active = np.flatnonzero(~whole & (at_limit > touch))
        if active.size:
            some, low = pairs.take(active), smallest[active]
            found, end = self._zone(some, limit[active], at_limit[active], inside[active], depth[active], low)
            zone_end[active] = end
            closing = self._closes_in(some, limit[active], end, inward[active], largest[active], low)
            gap, within = self._excess_m(some, limit[active]), self._excess_m(some, end)
            doubt = np.full(len(active), pairs.certainty_margin_m)
            good = np.flatnonzero(found & closing & (gap > doubt) & (within < -doubt))

            def measure(rows: NDArray[np.int64], t: Floats) -> Floats:
                return self._excess_m(some.take(good[rows]), t)

            if good.size:
                root = roots(measure, limit[active][good], gap[good], zone_end[active][good], within[good], doubt[good])
                outer[active[good]], inner[active[good]] = root.outer, root.inner
                sure[active[good]] = root.is_found
        sure &= self._holds(pairs, zone_end, inside, depth, touch, smallest)
        enough = window.depth < -(self.margin_m + TOUCH_M) * window.largest
        error = np.maximum(np.abs(inner - outer)[:n], np.abs(inner - outer)[n:])
        solved = sure[:n] & sure[n:] & enough
        self._keep(window.rows, np.zeros(n, np.bool_), solved, outer[:n], outer[n:], error)

    def _zone(
        self, pairs: Encounters, limit: Floats, gap: Floats, inside: Floats, depth: Floats, smallest: Floats
    ) -> tuple[NDArray[np.bool_], Floats]:
        """Return whether, and an instant when, pairs are just nearer than the separation at the smallest scale."""
        into = _INTO_SHARE * pairs.separation_m * smallest

        def measure(rows: NDArray[np.int64], t: Floats) -> Floats:
            return self._depth(pairs.take(rows), t, smallest[rows]) + into[rows]

        found = roots(measure, limit, gap + into, inside, np.minimum(depth + into, -1e-9), 0.5 * into)
        return found.is_found & (depth + into < 0.0), found.inner

    def _closes_in(
        self, pairs: Encounters, limit: Floats, end: Floats, inward: Floats, largest: Floats, smallest: Floats
    ) -> NDArray[np.bool_]:
        """Return whether the distance on the earth changes one way only between a limit and the end of the zone.

        Let p and q be nearest on the earth at some instant of the zone. They are no further apart than what is nearest
        in the plane then, and so in the plane at most `ratio` times the least distance at the end: their direction is
        within acos(1 / ratio) of its axis n, and that in which their distance shrinks within the plane's slant of it.
        With the sum s of both they close in at
        |n.V| cos s - |V across| sin s or more, V the velocity that both polygons' vertices depart from by at most K,
        less K for each and less what the scale changes on the way.
        """
        first, last = np.minimum(limit, end), np.maximum(limit, end)
        length, middle = last - first, 0.5 * (first + last)
        velocities = [shape.velocity(middle) for shape in (pairs.a, pairs.b)]
        velocity = velocities[1] - velocities[0]
        uneven = pairs.a.velocity_spread(first, last) + pairs.b.velocity_spread(first, last)
        at_end, axis = plane_distance(pairs, pairs.a.positions(end), pairs.b.positions(end))
        at_limit, _ = plane_distance(pairs, pairs.a.positions(limit), pairs.b.positions(limit))
        closing = -inward * (axis[0] * velocity[0] + axis[1] * velocity[1])
        across = np.abs(axis[0] * velocity[1] - axis[1] * velocity[0])
        speed = np.maximum(*(np.hypot(v[0], v[1]) for v in velocities)) + uneven
        with np.errstate(divide="ignore", invalid="ignore"):
            furthest_m = (np.maximum(at_limit, at_end) + 2.0 * uneven * length) / smallest
            ratio = pairs.plane.span_m(furthest_m, largest) / at_end
            turned = np.hypot(velocity[0], velocity[1]) * uneven * length / at_end
            aside = np.arccos(np.minimum(1.0 / ratio, 1.0)) + pairs.plane.gradient_angle(furthest_m, largest)
            least = closing * np.cos(aside) - across * np.sin(aside)
        drift = 2.0 * pairs.plane.distortion_rate(furthest_m, largest, speed)
        return np.asarray((at_end > 0.0) & (aside < 0.5 * np.pi) & (least > uneven + drift + turned))
