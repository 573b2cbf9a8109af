"""How likely conflicts are if departures are uncertain: bounds from above and below.

A track departs X later than planned, whole plan and all. X is normal, uniform or empirical, and independent of those of
other tracks. Tracks a and b meet if and only if X_a - X_b is in their set of differences (`core.delays`), whose outer
intervals give the bound from above, and whose inner intervals that from below. A separation in time is part of them.

The work is bounded: pairs and tracks share a number of values of distributions (`_Budget`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from conflictdb.arrays import Floats
from conflictdb.core.delays import Differences, Spans, differences_of
from conflictdb.core.near import Memory
from conflictdb.earth.registry import Setup

Bounds = tuple[float, float]
# Bounds of pairs, by the numbers of a track and of an area or a later track, and of each track.
Found = tuple[dict[tuple[int, int], Bounds], dict[int, Bounds]]

# Probability left out on each side of a normal distribution, and more than probabilities are rounded by.
_TAIL: Final = 1e-12
_ROUNDING: Final = 1e-10
# Cells of a continuous distribution; the probabilities of several conflicts are bounded in each. Fewer: looser bounds.
_CELLS: Final = 4000
# Values of distributions that one call computes for all pairs, and for all tracks; and the least parts of a
# distribution, however many there are. More: tighter, slower (10 to 15 s each). A value of an empirical distribution
# takes as long as this number of other values.
MOST_VALUES = 200_000_000
_LEAST_PARTS: Final = 16
_OF_ATOMS: Final = 3
# Values of one distribution, times intervals, whose probabilities are computed at once. More: more memory.
_AT_ONCE: Final = 1_000_000
# Largest probability outside the limits of a distribution.
_MOST_OUTSIDE: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Uncertain:
    """How much later than planned a track departs, seconds.

    Equally likely `atoms`; else normal or uniform.

    low, high : it lies between these but for a probability of `tail`; of a uniform one the ends
    """

    low: float
    high: float
    tail: float = 0.0
    mean: float = 0.0
    sd: float = 0.0
    atoms: Floats | None = None

    @classmethod
    def of(cls, given: Any, least: float, most: float) -> "Uncertain":
        """Return that of a frozen `norm` or `uniform` of scipy.stats, or of numbers.

        Raises ValueError for others, and if it is likely to lie outside of least and most.
        """
        name = getattr(getattr(given, "dist", None), "name", None)
        if name == "norm":
            mean, sd = float(given.mean()), float(given.std())
            reach = -float(ndtri(_TAIL)) * sd
            found = cls(mean - reach, mean + reach, 2.0 * _TAIL, mean, sd)
        elif name == "uniform":
            low, high = given.support()
            found = cls(float(low), float(high))
        else:
            atoms = np.sort(np.atleast_1d(np.asarray(given, np.float64)), axis=None)
            found = cls(float(atoms[0]), float(atoms[-1]), atoms=atoms) if len(atoms) else cls(np.nan, np.nan)
        if not (np.isfinite([found.low, found.high]).all() and (found.atoms is not None or found.low < found.high)):
            raise ValueError("no distribution of finite numbers")
        outside = max(1.0 - float(found.within(np.array([least]), np.array([most]))[0]), 0.0)
        if outside > _MOST_OUTSIDE:
            raise ValueError("beyond the limits")
        return replace(found, low=max(found.low, least), high=min(found.high, most), tail=found.tail + outside)

    def within(self, low: Floats, high: Floats) -> Floats:
        """Return the probability of each closed interval; 0 where low > high."""
        if self.atoms is not None:
            count = np.searchsorted(self.atoms, high, side="right") - np.searchsorted(self.atoms, low, side="left")
            return np.maximum(count, 0) / len(self.atoms)
        return np.asarray(np.maximum(self._cdf(high) - self._cdf(low), 0.0))

    def _cdf(self, x: Floats) -> Floats:
        if self.sd > 0.0:
            return np.asarray(ndtr((x - self.mean) / self.sd))
        return np.clip((x - self.low) / (self.high - self.low), 0.0, 1.0)

    def integral(self, x: Floats) -> Floats:
        """Return the integral of the distribution function up to x; not of atoms."""
        if self.sd > 0.0:
            z = (x - self.mean) / self.sd
            return np.asarray(self.sd * (z * ndtr(z) + np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)))
        gone, whole = np.maximum(x - self.low, 0.0), self.high - self.low
        return np.where(gone < whole, 0.5 * gone * gone / whole, gone - 0.5 * whole)


class _Budget:
    """Values of distributions that may still be computed, shared equally by the computations to come."""

    def __init__(self, computations: int) -> None:
        self._computations, self._values = computations, MOST_VALUES

    def share(self) -> int:
        """Return the values of the next computation."""
        share = max(self._values, 0) // max(self._computations, 1)
        self._computations -= 1
        return share

    def spend(self, values: int) -> None:
        """Take computed values away."""
        self._values -= values


_PLANNED: Final = Uncertain(0.0, 0.0, atoms=np.zeros(1))


def _groups(atoms: Floats, most: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return the least and the largest value of groups (n,) of atoms, `most` or fewer, and their edges (n + 1,)."""
    count = min(most, len(atoms))
    edges = np.arange(count + 1) * len(atoms) // count
    return atoms[edges[:-1]], atoms[edges[1:] - 1], edges


def _difference_within(a: Uncertain, b: Uncertain, low: Floats, high: Floats, groups: int, *, is_most: bool) -> Floats:
    """Return bounds of the probabilities of low <= X_a - X_b <= high, elementwise: from above, or from below.

    groups : most groups of atoms; if there are no more atoms, bounds are exact, as those of other distributions
    """
    if b.atoms is not None and (a.atoms is None or len(b.atoms) < len(a.atoms)):
        return _difference_within(b, a, -high, -low, groups, is_most=is_most)
    if a.atoms is not None:
        least, most, edges = _groups(a.atoms, groups)
        first, last = (least, most) if is_most else (most, least)
        mass = np.diff(edges) / len(a.atoms)
        found, some = np.empty(len(low)), max(_AT_ONCE // len(mass), 1)
        for begin in range(0, len(low), some):
            rows = slice(begin, begin + some)
            found[rows] = mass @ b.within(first[:, None] - high[rows], last[:, None] - low[rows])
        return found
    if b.sd > 0.0 and not a.sd > 0.0:
        return _difference_within(b, a, -high, -low, groups, is_most=is_most)
    if b.sd > 0.0:
        both = Uncertain(0.0, 0.0, mean=a.mean - b.mean, sd=float(np.hypot(a.sd, b.sd)))
        return both.within(low, high)
    ends = [(a.integral(x + b.high) - a.integral(x + b.low)) / (b.high - b.low) for x in (low, high)]
    return np.asarray(ends[1] - ends[0])


@dataclass(frozen=True, slots=True)
class _Rival:
    """Another object that a track may meet: its departure, and the outer and inner differences, seconds."""

    departure: Uncertain
    outer: tuple[Floats, Floats]
    inner: tuple[Floats, Floats]


def _atoms_of(a: Uncertain, b: Uncertain) -> int:
    """Return how many values of a distribution a probability of the difference of both takes."""
    return min((len(one.atoms) for one in (a, b) if one.atoms is not None), default=1)


def _chance_of_pair(departure: Uncertain, rival: _Rival, budget: _Budget) -> Bounds:
    """Return bounds on the probability that a track meets another object."""
    spans = len(rival.inner[0]) + len(rival.outer[0])
    if departure.atoms is not None and rival.departure.atoms is not None:
        spans *= _OF_ATOMS
    groups = min(max(budget.share() // max(spans, 1), _LEAST_PARTS), _atoms_of(departure, rival.departure))
    budget.spend(groups * spans)
    least, most = (
        float(_difference_within(departure, rival.departure, *of, groups, is_most=is_most).sum())
        for of, is_most in ((rival.inner, False), (rival.outer, True))
    )
    return _outward(least, most, departure.tail + rival.departure.tail)


def _chance_of_any(
    departure: Uncertain, rivals: list[_Rival], pairs: list[Bounds], tail: float, budget: _Budget
) -> Bounds:
    """Return bounds on the probability that a track meets any of some objects, and of others with a probability `tail`.

    pairs : the bounds of each
    """
    least = _of_any(departure, [(one.departure, *one.inner) for one in rivals], budget, is_most=False)
    most = _of_any(departure, [(one.departure, *one.outer) for one in rivals], budget, is_most=True)
    least, most = _outward(least, most, tail)
    return max([least, *(low for low, _ in pairs)]), min(most, sum(high for _, high in pairs) + tail)


def _of_any(
    departure: Uncertain, rivals: list[tuple[Uncertain, Floats, Floats]], budget: _Budget, *, is_most: bool
) -> float:
    # Where the track surely meets what departs at a known time: delays of the track, exact.
    known = [(b.low + low, b.low + high) for b, low, high in rivals if b.low == b.high]
    ends = zip(*known, strict=True) if known else ((), ())
    lows, highs = (np.sort(np.concatenate([np.empty(0), *some])) for some in ends)

    def is_free(delays_s: Floats) -> NDArray[np.bool_]:
        opened = np.searchsorted(lows, delays_s, side="right")
        return np.asarray(opened == np.searchsorted(highs, delays_s, side="left"))

    uncertain = [(b, low, high) for b, low, high in rivals if b.low != b.high]
    intervals = sum(len(low) * (1 if b.atoms is None else _OF_ATOMS) for b, low, _ in uncertain)
    most_cells = max(budget.share() // max(intervals, 1), _LEAST_PARTS)
    # Cells from first to last, the probability of all of them, and of the free delays of each.
    if departure.atoms is not None:
        first, last, edges = _groups(departure.atoms, most_cells)
        mass = np.add.reduceat(is_free(departure.atoms) / len(departure.atoms), edges[:-1])
        whole = 1.0
    else:
        grid = np.linspace(departure.low, departure.high, min(most_cells, _CELLS) + 1)
        first, last = grid[:-1], grid[1:]
        steps = np.unique(np.clip(np.concatenate([grid, lows, highs]), departure.low, departure.high))
        middle, of_step = 0.5 * (steps[:-1] + steps[1:]), departure.within(steps[:-1], steps[1:])
        cell = np.clip(np.searchsorted(grid, middle, side="right") - 1, 0, len(first) - 1)
        mass, whole = np.bincount(cell, is_free(middle) * of_step, len(first)), float(of_step.sum())
    budget.spend(len(mass) * intervals)
    begin, end = (first, last) if is_most else (last, first)
    for b, low, high in uncertain:
        some = max(_AT_ONCE // max(len(low), 1), 1)
        for at in range(0, len(mass), some):
            cells = slice(at, at + some)
            met = b.within(begin[cells, None] - high, end[cells, None] - low).sum(axis=1)
            mass[cells] *= 1.0 - np.minimum(met, 1.0)
    return whole - float(mass.sum())


def _outward(least: float, most: float, tail: float) -> Bounds:
    """Return bounds widened by rounding and by the probability outside the limits of distributions."""
    return max(0.0, least - _ROUNDING), min(1.0, most + tail + _ROUNDING)


def _rivals_of(found: Differences, horizon_us: int, departure_of: Callable[[int], Uncertain]) -> dict[int, _Rival]:
    """Return what a track may meet, by number.

    found : the differences of this track alone
    """
    order = np.argsort(found.other, kind="stable")
    others, first = np.unique(found.other[order], return_index=True)
    rivals = {}
    for other, rows in zip(others.tolist(), np.split(order, first[1:]), strict=True):
        outer, inner = (_seconds(spans) for spans in found.take(rows).forbidden(-horizon_us, horizon_us))
        rivals[other] = _Rival(departure_of(other), outer, inner)
    return rivals


def _seconds(spans: Spans) -> tuple[Floats, Floats]:
    return spans.low / 1e6, spans.high / 1e6


def chances_of(
    setup: Setup,
    placed: Memory,
    numbers: NDArray[np.int64],
    known: Mapping[int, Uncertain],
    tail: float,
) -> Found:
    """Return the chances of pairs and tracks; known: uncertain departures by number."""
    most_s = max([0.0, *(one.high for one in known.values())]) - min([0.0, *(one.low for one in known.values())])
    horizon_us = int(np.ceil(1e6 * most_s)) + 1
    movable = set(numbers.tolist())
    every = differences_of(setup, placed, numbers, horizon_us, waits=None)
    met = {
        number: _rivals_of(own, horizon_us, lambda other: known.get(other, _PLANNED))
        for number, own in every.of_each_track()
    }
    rows = [(a, b) for a, rivals in met.items() for b in rivals if b not in movable or b > a]
    budget = _Budget(len(rows))
    pairs = {(a, b): _chance_of_pair(known.get(a, _PLANNED), met[a][b], budget) for a, b in rows}
    # From below and from above.
    any_of, budget = {}, _Budget(2 * len(met))
    for a, rivals in met.items():
        bounds = [pairs[a, b] if (a, b) in pairs else pairs[b, a] for b in rivals]
        any_of[a] = _chance_of_any(known.get(a, _PLANNED), list(rivals.values()), bounds, tail, budget)
    return pairs, any_of
