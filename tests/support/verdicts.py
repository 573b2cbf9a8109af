"""Compares the product's reports with the oracle's answers, pair by pair."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from typing import Final

import numpy as np
import oracle
import pytest

from conflictdb import solve
from conflictdb.model.methods import METHODS, Method
from conflictdb.model.plans import Area, Motion, Scene, Track
from conflictdb.model.results import Conflict, Verdict

# Methods with certified answers; the reference method is slow.
CERTIFIED: Final = [
    pytest.param(method, marks=pytest.mark.slow) if method is Method.NLP else method
    for method in Method
    if METHODS[method].solver is not None
]

Pair = tuple[str, str]
Period = tuple[int | None, int | None]

ROUNDING_S: Final = 3e-6  # periods are whole microseconds rounded outward, and the oracle is good to one
# Plane coordinates are rounded to about 1e-8 m: closer than this, touching or not is not known.
TOUCH_M: Final = 2e-6
SURE_DEPTH_M: Final = 1e-3  # a deeper contact is no touch, however it is rounded
SURE_SHARE: Final = 0.99  # of the tolerance: a pair that comes so near is grazing


@dataclass(frozen=True)
class Reported:
    """One pair as the product reports it; periods in microseconds, inclusive."""

    verdict: Verdict
    periods_us: tuple[Period, ...]
    time_error_s: float


@dataclass
class Comparison:
    """Counts of a comparison, and all errors."""

    pairs: int = 0
    touching: int = 0
    reported: int = 0
    unresolved: int = 0
    grazing: int = 0
    worst_error_s: float = 0.0
    worst_bound_s: float = 0.0
    wrong: list[str] = field(default_factory=list)

    def add(self, other: "Comparison") -> None:
        """Count another comparison in."""
        for name in ("pairs", "touching", "reported", "unresolved", "grazing"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.worst_error_s = max(self.worst_error_s, other.worst_error_s)
        self.worst_bound_s = max(self.worst_bound_s, other.worst_bound_s)
        self.wrong += other.wrong


def solved(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> dict[Pair, Reported]:
    """The conflicts of `solve`, by pair."""
    return by_pair(solve(tracks, areas, scene))


def by_pair(conflicts: Iterable[Conflict]) -> dict[Pair, Reported]:
    """Conflicts of `solve` or of the database, by pair."""
    return {(one.a_key, one.b_key): Reported(one.verdict, periods_us(one), one.time_error_s) for one in conflicts}


def periods_us(conflict: Conflict) -> tuple[Period, ...]:
    """Its periods in microseconds since 1970."""
    return tuple((microseconds(start), microseconds(end)) for start, end in conflict.periods)


def microseconds(instant: datetime | None) -> int | None:
    """Microseconds since 1970 of an instant; None where unbounded."""
    return None if instant is None else (instant - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1)


def compared(
    scene: Scene,
    areas: Sequence[Area],
    tracks: Sequence[Track],
    reported: dict[Pair, Reported],
    truth: dict[Pair, oracle.Meeting] | None = None,
) -> Comparison:
    """Compare the reports of a scene with the oracle (or with its recorded answers)."""
    care_m = care_of(scene, areas, tracks)
    truth = truth or oracle.meetings(scene, areas, tracks, care_m)
    outer = None
    if scene.separation_m > 0.0:
        looser = replace(scene, separation_m=scene.separation_m + scene.tolerance_m)
        outer = oracle.meetings(looser, areas, tracks, care_m)
    found = compare(scene, truth, reported, outer)
    objects = {thing.key: thing for thing in (*areas, *tracks)}
    for pair, answer in reported.items():
        if (
            answer.verdict is Verdict.GRAZING
            and pair in truth
            and is_deep(scene, *(objects[k] for k in pair), truth[pair])
        ):
            found.wrong.append(f"{pair}: only grazing, though deeper than the tolerance")
    return found


def is_deep(scene: Scene, a: Area | Track, b: Area | Track, meeting: oracle.Meeting) -> bool:
    """Whether one polygon is seen to reach into the other deeper than the tolerance, so that they do not only graze.

    It looks at some instants only, and only at scenes of rhumb lines without a separation: other pairs may be deep,
    too.
    """
    if scene.motion is not Motion.RHUMB or scene.separation_m > 0.0:
        return False
    for start_us, end_us in meeting.intervals_us:
        if not np.isfinite([start_us, end_us]).all():
            continue
        for share in (0.5, 0.2, 0.8):
            instant_us = round(start_us + share * (end_us - start_us))
            near_lon = float(a.footprint.centroid.x if isinstance(a, Area) else a.positions_deg[0, 0])
            globe = oracle.Globe.of(scene.earth)
            ones, others = (oracle.polygons_at(scene, thing, instant_us, near_lon) for thing in (a, b))
            for one in ones:
                for other in others:
                    y = max(abs(y) for polygon in (one, other) for y in polygon.bounds[1::2])
                    lat = globe.latitude_of_isometric(np.array([y / globe.a]))
                    depth_m = 1.1 * max(scene.tolerance_m, SURE_DEPTH_M) * float((globe.a / globe.across_m(lat))[0])
                    if one.intersects(other) and one.buffer(-depth_m).intersects(other):
                        return True
    return False


def care_of(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> float:
    """Range that the oracle has to resolve, plane metres: well above the tolerance wherever objects come within it."""
    latitudes = [lat for area in areas for lat in area.footprint.bounds[1::2]]
    latitudes += [float(lat) for track in tracks for lat in track.positions_deg[:, 1]]
    scale = 3.0 / float(np.cos(np.radians(np.abs(latitudes).max(initial=0.0))))
    return max(20.0, scene.tolerance_m * scale)


def compare(
    scene: Scene,
    truth: dict[Pair, oracle.Meeting],
    reported: dict[Pair, Reported],
    outer: dict[Pair, oracle.Meeting] | None = None,
) -> Comparison:
    """Compare a complete answer with the truth: no miss, no conflict outside the tolerance, times within the bound.

    outer : the truth for a separation larger by the tolerance; limits how early and late a period may be reported
    """
    found = Comparison(pairs=len(truth), reported=len(reported))
    for pair in reported.keys() - truth.keys():
        found.wrong.append(f"{pair}: not a pair of this scene in its order")
    for pair, meeting in truth.items():
        answer = reported.get(pair)
        found.touching += meeting.touches
        if answer is None:
            if meeting.touches and not _instant_only(meeting):
                found.wrong.append(f"{pair}: missed, in contact {meeting.intervals} s after {meeting.epoch_us}")
            elif TOUCH_M < meeting.least_m - scene.separation_m < SURE_SHARE * scene.tolerance_m:
                found.wrong.append(f"{pair}: grazing missed, {meeting.least_m - scene.separation_m} m further apart")
            continue
        found.unresolved += answer.verdict is Verdict.UNRESOLVED
        found.grazing += answer.verdict is Verdict.GRAZING
        widest = (outer or truth)[pair]
        if not widest.touches:
            too_far_m = meeting.least_m - scene.separation_m
            if answer.verdict is Verdict.CONFLICT and too_far_m > TOUCH_M:
                found.wrong.append(f"{pair}: false conflict, {too_far_m} m beyond the separation")
            elif answer.verdict is Verdict.GRAZING and too_far_m > scene.tolerance_m + TOUCH_M:
                found.wrong.append(f"{pair}: false grazing, {too_far_m} m beyond the separation")
            continue
        found.wrong += [f"{pair}: {problem}" for problem in _periods(meeting, widest, answer, found)]
    return found


def _instant_only(meeting: oracle.Meeting) -> bool:
    return all(end - start < ROUNDING_S for start, end in meeting.intervals)


def _periods(meeting: oracle.Meeting, widest: oracle.Meeting, answer: Reported, found: Comparison) -> Iterable[str]:
    inf, epoch_us = float("inf"), widest.epoch_us
    periods = [
        (-inf if start is None else (start - epoch_us) / 1e6, inf if end is None else (end - epoch_us) / 1e6)
        for start, end in answer.periods_us
    ]
    if any(start > end for start, end in periods):
        yield f"period runs backwards: {periods}"
    if any(end >= start for (_, end), (start, _) in pairwise(periods)):
        yield f"periods are not increasing and disjoint: {periods}"
    allowed = answer.time_error_s + ROUNDING_S
    found.worst_bound_s = max(found.worst_bound_s, answer.time_error_s)
    for start, end in meeting.intervals:
        if not any(s - allowed <= start and end <= e + allowed for s, e in periods):
            yield f"contact {start, end} is not within {periods} up to {answer.time_error_s} s"
    if answer.verdict is not Verdict.CONFLICT:
        return
    for start, end in periods:
        if widest is not meeting:
            # An end may be anywhere between the separation and the separation plus the tolerance.
            if not any(s - allowed <= start and end <= e + allowed for s, e in widest.intervals):
                yield f"period {start, end} is not within {widest.intervals} up to {answer.time_error_s} s"
            continue
        # Every end that is reported is near a true one: a true interval begins (ends) there.
        for mine, edges in ((start, [s for s, _ in meeting.intervals]), (end, [e for _, e in meeting.intervals])):
            error = min(0.0 if mine == edge else abs(mine - edge) for edge in edges)
            found.worst_error_s = max(found.worst_error_s, error)
            if error > allowed:
                yield f"end {mine} s is {error} s off, more than {answer.time_error_s} s, from {meeting.intervals}"
