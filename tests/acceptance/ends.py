"""Random pairs of which a plan begins or ends, to rounding, as their contact does; compared with ends in long double.

    python tests/acceptance/ends.py --pairs 100000 [--seed 1]

One object of each pair is moved until it touches the other at an end of a plan (of either object), or at an instant in
the middle of both; then by up to a micrometre more. So a contact begins or ends within rounding of that instant. The
true contact follows from `support/exact_ends.py`. Prints a line per kind of pair and every disagreement, and exits 1 if
there is any.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from typing import Any, Final

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support"), str(Path(__file__).resolve().parents[2])]

import numpy as np
import shapely
from exact_ends import Array, Circles, Fixed, Globe, Riders, gap, way_m

from conflictdb import Area, Conflict, Scene, Track, Verdict, solve
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import EarthModel, Intervals, Motion

T0_US: Final = 1_780_000_000_000_000
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
# Pairs of a scene do not meet: each has a time of its own.
SLOT_US: Final = 20 * 86_400_000_000
# Metres by which pairs are moved from where they touch.
ASIDE_M: Final = (0.0, 1e-9, -1e-9, 1e-8, -1e-8, 4e-8, -4e-8, 1e-7, -1e-7, 1.5e-7, -1.5e-7, 3e-7, -3e-7, 1e-6, -1e-6)
# Clearances within this of zero are within rounding.
ROUNDING_M: Final = 2e-7
# Times that are not decided are split down to this.
SHORTEST_S: Final = 1e-6
# Slower than this, m/s, pairs graze at that instant: their ends are not sharp.
SLOWEST_MPS: Final = 1e-3
# Reported ends are outward to the microsecond, and this much more or less.
OUTWARD_S: Final = 1.5e-6
INWARD_S: Final = 2e-7
ROLES: Final = ("end of a", "start of a", "end of b", "start of b", "middle")
KINDS: Final = ("area", "track", "distance")


@dataclass
class Count:
    """Counts of a check, and its worst errors: of an end beyond the bound, and of stated bounds, seconds."""

    pairs: int = 0
    skipped: int = 0
    missed: int = 0
    wrong: int = 0
    doubtful: int = 0
    unresolved: int = 0
    widest_s: dict[str, float] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)

    def add(self, other: "Count") -> None:
        for name in ("pairs", "skipped", "missed", "wrong", "doubtful", "unresolved", "problems"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        for name, widest in other.widest_s.items():
            self.widest_s[name] = max(widest, self.widest_s.get(name, 0.0))

    def __str__(self) -> str:
        widest = ", ".join(f"{name} {widest:.2g} s" for name, widest in sorted(self.widest_s.items()))
        return (
            f"{self.pairs} pairs ({self.skipped} skipped), {self.missed} missed, {self.wrong} wrong, {self.doubtful} "
            f"reported within rounding, {self.unresolved} unresolved; widest bounds: {widest}"
        )


@dataclass(frozen=True)
class Pairs:
    """n pairs of one scene: track A and another object, and the instant, seconds of A, at which they touch.

    role : (n,) of ROLES
    b_zero_s : (n,) seconds of A at which the other's leg, or its span, begins
    span_s : (n, 2) the shared span, seconds of A
    """

    scene: Scene
    kind: str
    a: Riders
    b: Riders | Fixed
    role: Array
    at_s: Array
    b_zero_s: Array
    b_last_s: Array
    span_s: Array

    def gap_m(self, at_s: Array, a: Riders | None = None, b: Riders | Fixed | None = None) -> Array:
        """Clearances (n,) at seconds of A: along axes, or of the separation; rough if these riders are."""
        a, b = a or self.a, b or self.b
        b_at_s = at_s - self.b_zero_s.astype(at_s.dtype)
        if self.kind == "distance":
            assert isinstance(b, Riders)
            return np.asarray(way_m(a.globe, a.place_deg(at_s), b.place_deg(b_at_s)) - self.scene.separation_m)
        apart = gap(a.ring(at_s), b.ring(b_at_s)) * a.globe.a
        return np.asarray(apart if isinstance(a, Circles) else apart * self.scale.astype(at_s.dtype))

    @property
    def scale(self) -> Array:
        """Metres on the earth per plane metre, where the pairs are."""
        lat = self.b.corners_deg[:, 0, 1] if isinstance(self.b, Fixed) else self.b.ends_deg[:, :, 1].mean(axis=1)
        return np.asarray(self.a.globe.metres_per_plane(np.radians(lat)), np.float64)


def _polygons(rng: np.random.Generator, n: int, size_m: Array, corners: int) -> Array:
    """Convex polygons (n, corners, 2) about the origin, counter-clockwise; rectangles if they have four corners."""
    wide, long = size_m * rng.uniform(0.2, 1.0, n), size_m
    if corners == 4:
        return np.stack(
            [np.stack([x * wide, y * long], axis=-1) for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))], axis=1
        )
    angle = (np.arange(corners) + rng.uniform(0.0, 0.7, (n, corners))) * (2.0 * np.pi / corners)
    return np.stack([wide[:, None] * np.cos(angle), long[:, None] * np.sin(angle)], axis=-1)


def _degrees(offset_m: Array, lat_deg: Array) -> Array:
    """Offsets (..., 2) to the east and north as degrees of longitude and latitude, roughly."""
    return offset_m / 111_000.0 / np.stack([np.cos(np.radians(lat_deg)), np.ones_like(lat_deg)], axis=-1)


def _courses(rng: np.random.Generator, n: int) -> Array:
    """Unit vectors (n, 2) to the east and north; many along meridians and parallels."""
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    course = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.where(
        (rng.random(n) < 0.4)[:, None], np.rint(course / np.abs(course).max(axis=1, keepdims=True) * 0.7), course
    )


def _log_uniform(rng: np.random.Generator, low: float, high: float, n: int) -> Array:
    return np.exp(rng.uniform(np.log(low), np.log(high), n))


def thrown(seed: int, n: int) -> Pairs:
    """Random pairs of one scene, moved until they touch, or nearly, at the instants of their roles."""
    rng = np.random.default_rng(seed)
    kind = KINDS[(0, 0, 1, 1, 2)[seed % 5]]
    is_circle, earth = seed // 5 % 3 == 2, list(EarthModel)[seed // 5 % 3 % 2]
    centre = (float(rng.uniform(-150, 150)), float(rng.uniform(-55, 55)))
    scene = Scene(
        "ends",
        tolerance_m=0.0 if kind == "distance" else (0.0, 1e-6, 1.0)[seed // 15 % 3],
        separation_m=float(_log_uniform(rng, 100.0, 20_000.0, 1)[0]) if kind == "distance" else 0.0,
        earth=EarthModel.SPHERE if is_circle else earth,
        motion=Motion.GREAT_CIRCLE if is_circle else Motion.RHUMB,
        centre=centre if is_circle else None,
        intervals=list(Intervals)[seed // 45 % 2],
    )
    globe, rider = Globe.of(scene.earth), Circles if is_circle else Riders
    longest_m = 3000.0 if kind != "distance" else 0.0
    havens = [
        _polygons(rng, n, _log_uniform(rng, 5.0, 3000.0, n) * (longest_m > 0), int(rng.choice([4, 5]))) for _ in "ab"
    ]
    grown = [haven * (rng.uniform(0.5, 2.0, (n, 1, 1)) if seed % 4 == 3 else 1.0) for haven in havens]
    if kind == "distance":
        havens = grown = [haven[:, :1] * 0.0 for haven in havens]
    middle = np.array(centre) if is_circle else np.zeros(2)
    start = middle + rng.uniform(-1.0, 1.0, (n, 2)) * ((15.0, 12.0) if is_circle else (165.0, 72.0))
    length_m = _log_uniform(rng, 2000.0, 150_000.0, n)
    lasts_us = np.rint(length_m / _log_uniform(rng, 1.0, 200.0, n) * 1e6).astype(np.int64)
    way = _degrees(length_m[:, None] * _courses(rng, n), start[:, 1])
    lasts_s = np.asarray(lasts_us, np.longdouble) / 1_000_000
    a = rider(
        globe,
        np.stack([start, start + way], axis=1),
        lasts_s,
        *(np.asarray(h[0], np.longdouble) for h in (havens, grown)),
    )

    role = rng.integers(len(ROLES), size=n)
    at_us = np.where(
        role == 0, lasts_us, np.where(role == 1, 0, (rng.uniform(0.2, 0.8, n) * lasts_us).astype(np.int64))
    )
    at_s = np.asarray(at_us, np.longdouble) / 1_000_000
    around_us = rng.integers(600_000_000, 7_200_000_000, (n, 2))
    before_us = np.where(role == 3, 0, around_us[:, 0])
    after_us = np.where(role == 2, 0, around_us[:, 1])
    zero_s = np.asarray(at_us - before_us, np.longdouble) / 1_000_000
    here = np.asarray(a.place_deg(at_s), np.float64)
    sizes_m = _log_uniform(rng, 20.0, 20_000.0, n)
    if kind == "area":
        corners = _degrees(_polygons(rng, n, sizes_m, int(rng.choice([4, 6]))), here[:, None, 1])
        b: Riders | Fixed = Fixed(globe, here[:, None] + corners, is_circle)
    else:
        course = _degrees(_log_uniform(rng, 1000.0, 80_000.0, n)[:, None] * _courses(rng, n), here[:, 1])
        share = (before_us / (before_us + after_us))[:, None]
        ends = np.stack([here - share * course, here + (1.0 - share) * course], axis=1)
        outlines = (np.asarray(h[1], np.longdouble) for h in (havens, grown))
        b = rider(globe, ends, np.asarray(before_us + after_us, np.longdouble) / 1_000_000, *outlines)
    last_s = zero_s + np.asarray(before_us + after_us, np.longdouble) / 1_000_000
    span_s = np.stack([np.maximum(zero_s, 0), np.minimum(last_s, lasts_s)], axis=1)
    pairs = Pairs(scene, kind, a, b, role, at_s, zero_s, last_s, span_s)
    far_m = 4.0 * (2.0 * 6000.0 + sizes_m + scene.separation_m)
    return _touching(pairs, _degrees(_courses(rng, n), here[:, 1]), far_m, rng.choice(ASIDE_M, n))


def _touching(pairs: Pairs, by_deg: Array, far_m: Array, aside_m: Array) -> Pairs:
    """The pairs with b moved along a direction (degrees a metre) until its clearance is about `aside_m`."""
    a, b, at_s = pairs.a.rough(), pairs.b.rough(), pairs.at_s.astype(np.float64)

    def rough_m(step_m: Array) -> Array:
        return pairs.gap_m(at_s, a, b.moved(step_m[:, None] * by_deg))

    low, high = np.zeros(len(at_s)), far_m.copy()
    for _ in range(30):
        step = 0.5 * (low + high)
        is_in = rough_m(step) <= 0.0
        low, high = np.where(is_in, step, low), np.where(is_in, high, step)
    slope = (rough_m(high + 0.01) - rough_m(high - 0.01)) / 0.02
    slope, found = np.where(slope > 1e-3, slope, 1.0), pairs.b.moved(high[:, None] * by_deg)
    for _ in range(2):
        off = (aside_m - pairs.gap_m(pairs.at_s, b=found)).astype(np.float64) / slope
        # A pair that does not converge stays where it is, and is skipped.
        found = found.moved(np.clip(off, -1.0, 1.0)[:, None] * by_deg)
    return replace(pairs, b=found)


@dataclass(frozen=True)
class Truth:
    """True contacts of n pairs within their spans, seconds of A.

    is_sharp_end : whether the contact is one interval, which begins or ends sharply at the instant of the pair
    must, may : whether it must be reported, or may be
    is_in : whether it is one in long double
    start_s, end_s : the contact, if it must
    depth_m : its depth, at least
    """

    is_sharp_end: Array
    must: Array
    may: Array
    is_in: Array
    start_s: Array
    end_s: Array
    depth_m: Array


def truth(pairs: Pairs) -> Truth:
    at_s = pairs.at_s
    step = np.longdouble(1e-3)
    now, before, after = pairs.gap_m(at_s), pairs.gap_m(at_s - step), pairs.gap_m(at_s + step)
    rates = (now - before) / step, (after - now) / step
    rate = (rates[0] + rates[1]) / 2
    is_sharp = (np.abs(rate) > SLOWEST_MPS) & (rates[0] * rates[1] > 0) & (np.abs(now) < 1e-5)
    rate = np.where(is_sharp, rate, 1)
    turn_s = at_s - now / rate
    # Contact lasts before that instant if the clearance grows, else after it.
    sign = np.where(rate > 0, -1, 1)
    start, end = pairs.span_s.T
    reach = np.where(sign < 0, at_s - start, end - at_s)
    has_side, has_other = reach > 0, np.where(sign < 0, end - at_s, at_s - start) > 0
    shares = np.unique(np.concatenate([4.0 ** -np.arange(1.0, 14.0), np.arange(1, 17) / 16.0]))
    a, b = pairs.a.rough(), pairs.b.rough()
    other_reach = np.where(sign < 0, end - at_s, at_s - start)
    within = [
        np.stack([pairs.gap_m((at_s + way * share * side).astype(np.float64), a, b) for share in shares])
        for way, side in ((sign, reach), (-sign, other_reach))
    ]
    offsets = shares[:, None] * reach[None, :].astype(np.float64)
    # Nearer than this the clearance is within the error of float64.
    is_near = offsets * np.abs(rate.astype(np.float64)) < 1e-5
    is_in = (within[0] <= 0.0) | is_near
    first_out = np.where(is_in.all(axis=0), len(shares), np.argmin(is_in, axis=0))
    is_one = ~(is_in & (np.arange(len(shares))[:, None] > first_out)).any(axis=0) | ~has_side
    others = (within[1] <= 1e-5) & (
        shares[:, None] * other_reach[None, :].astype(np.float64) * np.abs(rate.astype(np.float64)) > 2e-5
    )
    is_one &= ~others.any(axis=0) | ~has_other
    far_s = np.where(sign < 0, start, end)
    rows = np.flatnonzero(has_side & is_one & is_sharp & (first_out < len(shares)))
    far_s[rows], is_crossing = _crossings(pairs, rows, sign, reach, shares, first_out)
    is_one[rows] &= is_crossing
    depth_m = np.where(has_side, -np.minimum(within[0], 0.0).min(axis=0), 0.0)

    closed = pairs.scene.intervals is Intervals.CLOSED
    is_last, is_first = ~has_side & (sign > 0), ~has_side & (sign < 0)
    must = np.where(has_side, True, now < -ROUNDING_M)
    # With a separation, time is split down to a microsecond, and distances are known to the bound that is stated.
    doubt_m = np.full(len(at_s), ROUNDING_M)
    if pairs.kind == "distance":
        doubt_m += float(Setup.of(pairs.scene).plane.distance_error_m(pairs.scene.separation_m))
        doubt_m += SHORTEST_S * np.abs(rate.astype(np.float64))
    may = must | (np.abs(now) <= doubt_m)
    # Contact at an excluded instant alone is none.
    must &= ~is_last | closed | (turn_s < at_s)
    near_s = np.where(sign < 0, np.minimum(turn_s, end), np.maximum(turn_s, start))
    starts = np.where(has_side, np.where(sign < 0, far_s, near_s), np.where(is_last, turn_s, start))
    ends = np.where(has_side, np.where(sign < 0, near_s, far_s), np.where(is_first, turn_s, end))
    is_sharp_end = is_sharp & is_one & (~has_side | (np.abs(far_s - near_s) > 1e-5))
    # The search for the other end may find the one that is known.
    is_sharp_end &= ~must | (starts < ends)
    return Truth(is_sharp_end, must, may, now < 0, np.maximum(starts, start), np.minimum(ends, end), depth_m)


def _crossings(
    pairs: Pairs, rows: Array, sign: Array, reach: Array, shares: Array, first_out: Array
) -> tuple[Array, Array]:
    """Ends (k,) of contacts away from the instant of the pairs, and whether they are sharp."""
    known = np.concatenate([[0.0], shares])
    some = Pairs(
        pairs.scene,
        pairs.kind,
        pairs.a.take(rows),
        pairs.b.take(rows),
        *(getattr(pairs, name)[rows] for name in ("role", "at_s", "b_zero_s", "b_last_s", "span_s")),
    )
    way = (sign * reach)[rows]
    inner, outer = (some.at_s + way * known[first_out[rows] + k] for k in (0, 1))
    a, b = some.a.rough(), some.b.rough()
    low, high = inner.astype(np.float64), outer.astype(np.float64)
    for _ in range(30):
        middle = 0.5 * (low + high)
        is_in = some.gap_m(middle, a, b) <= 0.0
        low, high = np.where(is_in, middle, low), np.where(is_in, high, middle)
    at, step = low.astype(np.longdouble), np.longdouble(1e-3)
    rate = np.ones_like(at)
    for _ in range(3):
        now = some.gap_m(at)
        rate = (some.gap_m(at + step) - some.gap_m(at - step)) / (2 * step)
        rate = np.where(np.abs(rate) > SLOWEST_MPS, rate, SLOWEST_MPS)
        at = at - now / rate
    return at, (np.abs(some.gap_m(at)) < 1e-9) & (np.abs(rate) > SLOWEST_MPS)


def objects(pairs: Pairs) -> tuple[list[Area], list[Track]]:
    areas, tracks = [], []
    for k in range(len(pairs.role)):
        zero_us = T0_US + k * SLOT_US
        tracks.append(_track(f"A{k}", pairs.a, k, zero_us))
        first_us, last_us = (zero_us + round(float(one[k] * 1_000_000)) for one in (pairs.b_zero_s, pairs.b_last_s))
        if isinstance(pairs.b, Fixed):
            areas.append(Area(f"B{k}", shapely.Polygon(pairs.b.corners_deg[k]), None, first_us, last_us))
        else:
            tracks.append(_track(f"B{k}", pairs.b, k, first_us))
    return areas, tracks


def _track(key: str, riders: Riders, k: int, zero_us: int) -> Track:
    outline_m, to_m = (np.asarray(one[k], np.float64) for one in (riders.outline_m, riders.outline_to_m))
    times_us = [zero_us, zero_us + round(float(riders.lasts_s[k] * 1_000_000))]
    more: dict[str, Any] = {} if np.array_equal(outline_m, to_m) else {"outlines_m": np.stack([outline_m, to_m])}
    return Track(key, riders.ends_deg[k], times_us, outline_m, **more)


def check(seed: int, n: int = 200) -> Count:
    """Throw the pairs of one scene, solve them, and compare."""
    pairs = thrown(seed, n)
    areas, tracks = objects(pairs)
    rows = {int(row.a_key[1:]): row for row in solve(tracks, areas, pairs.scene)}
    return compared(pairs, truth(pairs), rows, seed)


def compared(pairs: Pairs, true: Truth, rows: dict[int, Conflict], seed: int) -> Count:
    total = Count()
    for k in range(len(pairs.role)):
        if not true.is_sharp_end[k]:
            total.skipped += 1
            continue
        total.pairs += 1
        row = rows.get(k)
        problem = _problem(pairs, true, k, row)
        if row is not None:
            name = row.verdict.value
            total.widest_s[name] = max(total.widest_s.get(name, 0.0), row.time_error_s)
            total.unresolved += row.verdict is Verdict.UNRESOLVED
            total.doubtful += not true.must[k]
        if problem:
            total.missed += row is None
            total.wrong += row is not None
            total.problems.append(f"seed {seed}, pair {k}, {pairs.kind}, {ROLES[pairs.role[k]]}: {problem}")
    return total


def _problem(pairs: Pairs, true: Truth, k: int, row: Conflict | None) -> str | None:
    """A disagreement in a sentence."""
    start_s, end_s = float(true.start_s[k]), float(true.end_s[k])
    if row is None:
        return f"missed, from {start_s} to {end_s} s" if true.must[k] else None
    is_close = row.verdict is Verdict.GRAZING and pairs.scene.tolerance_m > 0.0
    if not true.must[k]:
        may = is_close or (true.may[k] and (true.is_in[k] or row.verdict is not Verdict.CONFLICT))
        return None if may else f"{row.verdict.value}, and there is no contact"
    is_deep = true.depth_m[k] > 1.02 * pairs.scene.tolerance_m + 1e-4
    if is_deep and row.verdict is not Verdict.CONFLICT:
        return f"{row.verdict.value}, and it is {true.depth_m[k]} m deep"
    if not is_deep and is_close:
        return None
    zero_us = T0_US + k * SLOT_US
    first_s, last_s = ((_us(at) - zero_us) / 1e6 for at in (row.periods[0][0], row.periods[-1][1]))
    if first_s > start_s + INWARD_S or last_s < end_s - INWARD_S:
        return f"reported from {first_s} to {last_s} s, and contact is from {start_s} to {end_s} s"
    if max(start_s - first_s, last_s - end_s) > row.time_error_s + OUTWARD_S:
        return (
            f"reported from {first_s} to {last_s} s ± {row.time_error_s} s, and contact is from {start_s} to {end_s} s"
        )
    return None


def _us(at: datetime | None) -> int:
    assert at is not None
    return (at - EPOCH) // timedelta(microseconds=1)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare as many pairs as the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=10_000, help="in all, default 10000")
    parser.add_argument("--seed", type=int, default=1, help="of the first scene, default 1")
    options = parser.parse_args(arguments)
    every: dict[str, Count] = {kind: Count() for kind in KINDS}
    began = time.process_time()
    for seed in count(options.seed):
        one = check(seed)
        every[KINDS[(0, 0, 1, 1, 2)[seed % 5]]].add(one)
        for line in one.problems:
            sys.stdout.write(f"  {line}\n")
        sys.stdout.flush()
        if sum(total.pairs for total in every.values()) >= options.pairs:
            break
    for kind, total in every.items():
        sys.stdout.write(f"{kind}: {total}\n")
    sys.stdout.write(f"{time.process_time() - began:.0f} s\n")
    return int(any(total.problems for total in every.values()))


if __name__ == "__main__":
    sys.exit(main())
