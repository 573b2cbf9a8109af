"""How likely conflicts are if departures, or the speed of a track, are uncertain: bounds from above and below.

A track departs X later than planned, whole plan and all. X is normal, uniform or empirical, and independent of those of
other tracks. Tracks a and b meet if and only if X_a - X_b is in their set of differences (`stages.delays`), whose outer
intervals give the bound from above and whose inner intervals that from below. If instead the speed of one track is
uncertain, and all else goes as planned, the same holds for its factor and its forbidden speeds (`stages.speeds`).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from scipy.special import ndtr, ndtri

from conflictdb.arrays import Floats
from conflictdb.stages.delays import Differences, Spans
from conflictdb.stages.speeds import UNIT

Bounds = tuple[float, float]

# Probability left out on each side of a normal distribution, and more than probabilities are rounded by.
_TAIL: Final = 1e-12
ROUNDING: Final = 1e-10
# Parts of a continuous distribution in which probabilities of several conflicts are bounded. Fewer: looser bounds.
_CELLS: Final = 4000
# Largest probability beyond the limits of a distribution.
_MOST_OUTSIDE: Final = 1e-9


@dataclass(frozen=True, slots=True)
class Uncertain:
    """How much later than planned a track departs, seconds, or its speed by the planned one.

    One of `atoms`, each as likely; else normal or uniform.

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


PLANNED: Final = Uncertain(0.0, 0.0, atoms=np.zeros(1))


def difference_within(a: Uncertain, b: Uncertain, low: Floats, high: Floats) -> Floats:
    """Return the probabilities of low <= X_a - X_b <= high, elementwise."""
    if a.atoms is not None:
        return np.asarray(b.within(a.atoms[:, None] - high, a.atoms[:, None] - low).mean(axis=0))
    if b.atoms is not None:
        return np.asarray(a.within(b.atoms[:, None] + low, b.atoms[:, None] + high).mean(axis=0))
    if b.sd > 0.0 and not a.sd > 0.0:
        return difference_within(b, a, -high, -low)
    if b.sd > 0.0:
        both = Uncertain(0.0, 0.0, mean=a.mean - b.mean, sd=float(np.hypot(a.sd, b.sd)))
        return both.within(low, high)
    ends = [(a.integral(x + b.high) - a.integral(x + b.low)) / (b.high - b.low) for x in (low, high)]
    return np.asarray(ends[1] - ends[0])


@dataclass(frozen=True, slots=True)
class Rival:
    """Another object that a track may meet: its departure, and the outer and inner differences, seconds."""

    departure: Uncertain
    outer: tuple[Floats, Floats]
    inner: tuple[Floats, Floats]


def chance_of_pair(departure: Uncertain, rival: Rival) -> Bounds:
    """Return bounds on the probability that a track meets another object."""
    least, most = (
        float(difference_within(departure, rival.departure, *spans).sum()) for spans in (rival.inner, rival.outer)
    )
    return _outward(least, most, departure.tail + rival.departure.tail)


def chance_of_any(departure: Uncertain, rivals: list[Rival], tail: float) -> Bounds:
    """Return bounds on the probability that a track meets any of some objects, and of others with a probability `tail`.

    Given the delay of the track, conflicts are independent. So the delay is divided into cells, and within each the
    probability of each conflict is bounded. It is at least the largest of the probabilities, and at most their sum.
    """
    pairs = [chance_of_pair(departure, one) for one in rivals]
    least = _of_any(departure, [(one.departure, *one.inner) for one in rivals], is_most=False)
    most = _of_any(departure, [(one.departure, *one.outer) for one in rivals], is_most=True)
    least, most = _outward(least, most, tail)
    return max([least, *(low for low, _ in pairs)]), min(most, sum(high for _, high in pairs) + tail)


def chance_at_speed(speed: Uncertain, found: Differences) -> Bounds:
    """Return bounds on the probability that a track meets some objects that go as planned, or any of them.

    found : the forbidden speeds of the track, because of these objects
    """
    spans = found.forbidden(int(np.floor(speed.low * UNIT)), int(np.ceil(speed.high * UNIT)))
    most, least = (float(speed.within(some.low / UNIT, some.high / UNIT).sum()) for some in spans)
    return _outward(least, most, speed.tail)


def either(a: Bounds, b: Bounds) -> Bounds:
    """Return bounds on the probability of one or both of two independent events."""
    least, most = (1.0 - (1.0 - a[k]) * (1.0 - b[k]) for k in (0, 1))
    return least, min(most, 1.0)


def _of_any(departure: Uncertain, rivals: list[tuple[Uncertain, Floats, Floats]], *, is_most: bool) -> float:
    # Where the track surely meets what departs at a known time: delays of the track, exact.
    known = [(b.low + low, b.low + high) for b, low, high in rivals if b.low == b.high]
    lows, highs = (np.concatenate([np.empty(0), *ends]) for ends in (zip(*known, strict=True) if known else ((), ())))
    if departure.atoms is not None:
        first = last = departure.atoms
        mass = np.full(len(first), 1.0 / len(first))
    else:
        grid = np.linspace(departure.low, departure.high, _CELLS + 1)
        edges = np.unique(np.clip(np.concatenate([grid, lows, highs]), departure.low, departure.high))
        first, last = edges[:-1], edges[1:]
        mass = departure.within(first, last)
    middle = 0.5 * (first + last)
    opened = np.searchsorted(np.sort(lows), middle, side="right")
    free = (opened == np.searchsorted(np.sort(highs), middle, side="left")).astype(np.float64)
    for b, low, high in rivals:
        if b.low == b.high:
            continue
        begin, end = (first, last) if is_most else (last, first)
        met = b.within(begin[:, None] - high, end[:, None] - low).sum(axis=1)
        free *= 1.0 - np.minimum(met, 1.0)
    return float((mass * (1.0 - free)).sum())


def _outward(least: float, most: float, tail: float) -> Bounds:
    return max(0.0, least - ROUNDING), min(1.0, most + tail + ROUNDING)


def rivals_of(found: Differences, horizon_us: int, departure_of: Callable[[int], Uncertain]) -> dict[int, Rival]:
    """Return what a track may meet, by number.

    found : the differences of this track alone
    """
    order = np.argsort(found.other, kind="stable")
    others, first = np.unique(found.other[order], return_index=True)
    rivals = {}
    for other, rows in zip(others.tolist(), np.split(order, first[1:]), strict=True):
        outer, inner = (_seconds(spans) for spans in found.take(rows).forbidden(-horizon_us, horizon_us))
        rivals[other] = Rival(departure_of(other), outer, inner)
    return rivals


def _seconds(spans: Spans) -> tuple[Floats, Floats]:
    return spans.low / 1e6, spans.high / 1e6
