"""Brute force for heights that change along legs: in exact fractions, apart from the motion."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TypeVar

import numpy as np
import oracle

from conflictdb.model.plans import Area, Scene, Track

Span = tuple[Fraction, Fraction]
Thing = TypeVar("Thing", Area, Track)


def meeting_us(scene: Scene, a: Area | Track, b: Area | Track) -> list[tuple[float, float]]:
    """When two objects are in contact while their heights overlap: intervals, microseconds since 1970."""
    met = oracle.meeting(replace(scene, vertical_separation_m=0.0), without_heights(a), without_heights(b))
    return while_heights_overlap(scene, a, b, met.intervals_us)


def while_heights_overlap(
    scene: Scene, a: Area | Track, b: Area | Track, intervals_us: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the times within intervals at which the heights of two objects overlap."""
    found = []
    for start, end in intervals_us:
        for low, high in overlaps_us(scene, a, b):
            first, last = max(start, float(low)), min(end, float(high))
            if first <= last:
                found.append((first, last))
    merged: list[tuple[float, float]] = []
    for first, last in sorted(found):
        if merged and first <= merged[-1][1] + 2.0:
            merged[-1] = merged[-1][0], max(merged[-1][1], last)
        else:
            merged.append((first, last))
    return merged


def overlaps_us(scene: Scene, a: Area | Track, b: Area | Track) -> Iterator[Span]:
    """Times at which two height bands are closer than the scene's vertical separation, as open intervals."""
    apart = Fraction(scene.vertical_separation_m)
    for start_a, end_a, floors_a, ceilings_a in _bands(a):
        for start_b, end_b, floors_b, ceilings_b in _bands(b):
            low, high = max(start_a, start_b), min(end_a, end_b)
            for (floor, s0, s1), (ceiling, t0, t1) in (
                ((floors_a, start_a, end_a), (ceilings_b, start_b, end_b)),
                ((floors_b, start_b, end_b), (ceilings_a, start_a, end_a)),
            ):
                if floor is None or ceiling is None or low >= high:
                    continue
                gaps = [_at(floor, s0, s1, at) - _at(ceiling, t0, t1, at) - apart for at in (low, high)]
                if min(gaps) >= 0:
                    high = low
                elif max(gaps) > 0:
                    crossing = low + (high - low) * gaps[0] / (gaps[0] - gaps[1])
                    low, high = (low, crossing) if gaps[0] < 0 else (crossing, high)
            if low < high:
                yield low, high


def _at(ends: tuple[Fraction, Fraction], start: Fraction, end: Fraction, at: Fraction) -> Fraction:
    return ends[0] + (ends[1] - ends[0]) * (at - start) / (end - start)


def _bands(
    one: Area | Track,
) -> Iterator[tuple[Fraction, Fraction, tuple[Fraction, Fraction] | None, tuple[Fraction, Fraction] | None]]:
    """Start and end of each leg, and its floors and ceilings at both; None where unbounded."""
    if isinstance(one, Area):
        always = [Fraction(-(10**20)) if one.start_us is None else Fraction(one.start_us)]
        always.append(Fraction(10**20) if one.end_us is None else Fraction(one.end_us))
        yield always[0], always[1], *((None if h is None else (Fraction(h),) * 2) for h in (one.floor_m, one.ceiling_m))
        return
    legs = len(one.times_us) - 1
    for k in range(legs):
        ends = []
        for whole, own in ((one.floor_m, one.floors_m), (one.ceiling_m, one.ceilings_m)):
            if own is None:
                both = [np.inf if whole is None else whole] * 2
            else:
                both = [own[k], own[k if len(own) == legs else k + 1]]
            ends.append(tuple(map(Fraction, both)) if np.isfinite(both).all() else None)
        yield Fraction(int(one.times_us[k])), Fraction(int(one.times_us[k + 1])), ends[0], ends[1]


def without_heights(one: Thing) -> Thing:
    """Return an object at all heights."""
    if isinstance(one, Area):
        return replace(one, floor_m=None, ceiling_m=None)
    return replace(one, floor_m=None, ceiling_m=None, floors_m=None, ceilings_m=None, max_speed_kn=np.inf)
