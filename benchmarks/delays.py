"""Forbidden departures of all tracks of a scene: their cost compared with `solve`, and the errors of their ends.

    ./.venv/bin/python benchmarks/delays.py [--sea 50000] [--within-s 7200]

Processor seconds of one thread, `solve` and `delays` one after the other. `pairs`: pairs of pieces whose differences of
departure the kernel computed. `kernel`: its seconds, and microseconds a pair. `a track`: milliseconds of all stages
after cutting, divided by the tracks. Errors are of the ends of pairs, after their times are halved where needed, and
before they are rounded to microseconds. `inside`: share of these pairs of pieces (or of halves) in contact at some
difference that have an inner interval.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from layouts import GROWING, GROWING_CIRCLES, OCEAN, Workload
from made_scenes import SEA, Kind, box, sea
from mixed_scenes import plain_scene

from conflictdb import Area, Scene, Track, solve
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core import delays
from conflictdb.core.forbidden import delays_of_each
from conflictdb.core.near import Memory
from conflictdb.core.object_pairs import object_numbers
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.earth.registry import Setup, centred
from conflictdb.kernel.differences import DifferenceState
from conflictdb.model.results import Kind as ObjectKind

NMI: Final = 1852.0
T0_US: Final = 1_780_000_000_000_000
ROW: Final = "{:<36} {:>7} {:>8} {:>9} {:>8} {:>6} {:>8} {:>8} {:>8} {:>8} {:>8} {:>9}"
HEADER: Final = (
    "scene",
    "tracks",
    "solve s",
    "pairs",
    "kernel s",
    "us",
    "a track",
    "median",
    "90 %",
    "99 %",
    "worst",
    "inside",
)

Made = tuple[Scene, list[Area], list[Track]]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sea", type=int, default=50_000, help="objects of the sea")
    parser.add_argument("--within-s", type=float, default=7200.0, help="the horizon")
    args = parser.parse_args()
    print(ROW.format(*HEADER))
    for name, make in (*_scenes(args.sea), *_ends()):
        print(_row(name, make(), args.within_s), flush=True)


def _scenes(objects: int) -> Iterator[tuple[str, Callable[[], Made]]]:
    for count in (800, 5000):
        for kind in (Kind.MIXED, Kind.TRACKS):
            yield f"box, {count} {kind.value}", lambda count=count, kind=kind: _made(box(kind, count, 0))
    yield f"sea, {objects:,}", lambda: _sea(objects)


def _ends() -> Iterator[tuple[str, Callable[[], Made]]]:
    part = replace(SEA, window=0.12 * 2000**0.5)
    for separation_m, tolerance_m in ((0.0, 0.0), (0.0, 1.0), (500.0, 1.0), (NMI, 1.0)):
        how = {"separation_m": separation_m, "tolerance_m": tolerance_m}
        yield f"sea, {_named(**how)}", lambda how=how: plain_scene(part, 0, 1000, 1000, **how)
    yield "300 aircraft, points, 5 nmi", _aircraft
    workloads: tuple[Workload, ...] = (replace(OCEAN, around_haven=(20.0, 40.0)), GROWING, GROWING_CIRCLES)
    for separation_m, tolerance_m in ((0.0, 0.0), (0.0, 1.0), (5.0 * NMI, 1.0)):
        how = {"separation_m": separation_m, "tolerance_m": tolerance_m}
        yield f"box, {_named(**how)}", lambda how=how: _with(box(Kind.MIXED, 800, 0), **how)
        for workload in workloads:
            yield (
                f"{workload.name}, {_named(**how)}",
                lambda workload=workload, how=how: plain_scene(workload, 0, 40, 60, **how),
            )


def _named(separation_m: float, tolerance_m: float) -> str:
    return f"{separation_m:g} m, tolerance {tolerance_m:g} m"


def _made(made: tuple[Scene, Sequence[Area], Sequence[Track]]) -> Made:
    scene, areas, tracks = made
    return scene, list(areas), list(tracks)


def _with(made: tuple[Scene, Sequence[Area], Sequence[Track]], **settings: float) -> Made:
    scene, areas, tracks = _made(made)
    return replace(scene, **settings), areas, tracks


def _sea(objects: int) -> Made:
    areas: list[Area] = []
    tracks: list[Track] = []
    for some_areas, some_tracks in sea(objects, 0):
        areas += some_areas
        tracks += some_tracks
    return Scene("sea"), areas, tracks


def _aircraft() -> Made:
    """300 points on straight legs of 100 to 400 nmi, at 300 to 500 knots, within an hour."""
    rng, tracks = np.random.default_rng(0), []
    for number in range(300):
        lon, lat = rng.uniform(0.0, 9.0), 50.0 + rng.uniform(0.0, 6.0)
        bearing, length_deg = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(100.0, 400.0) / 60.0
        start_us = T0_US + int(rng.uniform(0.0, 3.6e9))
        end = lon + length_deg * np.sin(bearing) / np.cos(np.radians(lat)), lat + length_deg * np.cos(bearing)
        lasts_us = int(3.6e9 * 60.0 * length_deg / rng.uniform(300.0, 500.0))
        tracks.append(Track(f"{number}", [(lon, lat), end], [start_us, start_us + lasts_us], [(0.0, 0.0)]))
    return Scene("aircraft", separation_m=5.0 * NMI), [], tracks


@dataclass
class Kernel:
    """The kernel's differences in parts, with the seconds and the pairs of all calls, and the intervals."""

    call: Callable[..., Any]
    seconds: float = 0.0
    pairs: int = 0
    found: list[Any] = field(default_factory=list)

    def __call__(self, scene: Any, shifts: Any, *arguments: Any) -> Any:
        """Call the kernel."""
        began = time.process_time()
        rows, parts, found = self.call(scene, shifts, *arguments)
        self.seconds += time.process_time() - began
        self.pairs += len(shifts)
        self.found.append(found)
        return rows, parts, found


def _row(name: str, made: Made, within_s: float) -> str:
    scene, areas, tracks = made
    began = time.process_time()
    solve(tracks, areas, scene)
    solve_s = time.process_time() - began
    scene = centred(scene, areas, tracks)
    setup = Setup.of(scene)
    pieces = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of(tracks))
    numbers = np.unique(object_numbers(pieces)[pieces.kind == ObjectKind.TRACK.code])
    kernel, horizon_us = Kernel(delays.difference_parts), round(1e6 * within_s)
    keys = dict.fromkeys(np.unique(object_numbers(pieces)).tolist(), "")
    leeway = delays.Leeway(False, False, -horizon_us, horizon_us, 0)
    began = time.process_time()
    with patch.object(delays, "difference_parts", kernel):
        every = delays.differences_of(setup, Memory(pieces), numbers, horizon_us, waits=None)
    names, plan = [""] * len(numbers), np.searchsorted(numbers, every.track)
    delays_of_each(names, keys, every, plan, horizon_us, [leeway] * len(numbers))
    all_s = time.process_time() - began
    found = np.concatenate(kernel.found)
    inside = found[found["state"] == DifferenceState.INNER]
    errors_s = np.concatenate([inside["inner_low"] - inside["outer_low"], inside["outer_high"] - inside["inner_high"]])
    return ROW.format(
        name,
        len(tracks),
        f"{solve_s:.2f}",
        kernel.pairs,
        f"{kernel.seconds:.2f}",
        f"{1e6 * kernel.seconds / max(kernel.pairs, 1):.0f}",
        f"{1e3 * all_s / max(len(tracks), 1):.2f}",
        *(f"{error_s:.1e}" for error_s in np.percentile(errors_s, [50, 90, 99, 100])),
        f"{len(inside)}/{len(found)}",
    )


if __name__ == "__main__":
    main()
