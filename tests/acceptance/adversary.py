"""Looks for disagreements with the oracle, for as long as it is given.

    python tests/acceptance/adversary.py --minutes 60 --seed 7 [--method exact] [--keep DIRECTORY]
    python tests/acceptance/adversary.py --replay DIRECTORY/7-1234.geojson

Throws random scenes of every workload, wild ones among them, on both earths, with several tolerances and separations.
Then it takes pairs of each scene and climbs to the hardest answers. It changes waypoints, times, havens and areas so
that the pair passes nearer, or its contact becomes shorter, until the number of contacts changes. Then it bisects this
change down to rounding, where a pair only grazes or two contacts merge. Around that point it changes everything by a
trace, and lets spans end within microseconds of a contact. Every candidate is compared with the oracle. Each
disagreement is written to a scene file and printed with the command that shows it again; exits 1 if there is any.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support"), str(Path(__file__).resolve().parents[2])]

import numpy as np
import oracle
import shapely
from layouts import WORKLOADS
from mixed_scenes import plain_scene
from mpmath import mp, mpf
from precise import refine, separation
from scene_file import write_scene
from verdicts import Comparison, Pair, Reported, care_of, compared, solved
from wild import throw_wild

from conflictdb import formats
from conflictdb.errors import InvalidInput
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, EarthModel, Scene, Track

OBJECTS: Final = 3  # areas, and as many tracks, of a random scene
MUTATIONS: Final = 12  # that may not change the number of contacts
HALVINGS: Final = 48  # of the way to where it changes: down to rounding
NEARBY: Final = 6  # candidates around that place
START_M: Final = 5000.0  # climb from pairs that pass within this distance
# Tolerance, required separation; metres.
LIMITS: Final = ((0.0, 0.0), (1.0, 0.0), (0.01, 0.0), (50.0, 0.0), (0.0, 500.0), (1.0, 5000.0))

Answer = dict[Pair, Reported]
Solver = Callable[[Scene, Sequence[Area], Sequence[Track]], Answer]
Thing = Area | Track


@dataclass
class Search:
    """Counts of a search, and the disagreements it found."""

    solver: Solver
    keep: Path
    name: str
    candidates: int = 0
    total: Comparison = field(default_factory=Comparison)
    nearest_m: float = np.inf
    shortest_s: float = np.inf
    found: list[str] = field(default_factory=list)
    tells: bool = False  # each at once

    def examine(self, scene: Scene, things: Sequence[Thing], care_m: float = 0.0) -> dict[Pair, oracle.Meeting]:
        """Compare the product with the oracle, record differences, and return the truth."""
        areas, tracks = apart(things)
        truth = oracle.meetings(scene, areas, tracks, max(care_m, care_of(scene, areas, tracks)))
        result = compared(scene, areas, tracks, self.solver(scene, areas, tracks), truth)
        self.candidates += 1
        self.total.add(result)
        for meeting in truth.values():
            if meeting.least_m > scene.separation_m:
                self.nearest_m = min(self.nearest_m, meeting.least_m - scene.separation_m)
            self.shortest_s = min(self.shortest_s, *(e - s for s, e in meeting.intervals), np.inf)
        wrong = result.wrong + ["unresolved"] * bool(result.unresolved and scene.tolerance_m > 0.0)
        if wrong:
            path = write_scene(self.keep / f"{self.name}-{self.candidates}.geojson", scene, areas, tracks)
            lines = [*wrong, f"python tests/acceptance/adversary.py --replay {path}"]
            self.found.append("\n    ".join(lines))
            if self.tells:
                sys.stdout.write(self.found[-1] + "\n")
                sys.stdout.flush()
        return truth


def apart(things: Sequence[Thing]) -> tuple[list[Area], list[Track]]:
    return [t for t in things if isinstance(t, Area)], [t for t in things if isinstance(t, Track)]


def in_fifty_digits(scene: Scene, things: Sequence[Thing], truth: dict[Pair, oracle.Meeting]) -> Iterator[str]:
    """Yield disagreements of the oracle with 50 digits: whether the oracle is wrong."""
    if len(things) != 2 or scene.separation_m > 0.0 or not any(isinstance(thing, Track) for thing in things):
        return
    known = {thing.key: thing for thing in things}
    for (a, b), meeting in truth.items():
        with mp.workdps(50):
            if meeting.touches:
                try:
                    ends = refine(scene, known[a], known[b], meeting, within_s=1e-4)
                except AssertionError as error:
                    yield f"in 50 digits: {error}"
                else:
                    yield f"in 50 digits: {[tuple(mp.nstr(end, 20) for end in interval) for interval in ends]}"
            elif meeting.least_m < 1.0:
                plane_m = separation(scene, known[a], known[b], mpf(meeting.at_s), meeting.epoch_us)
                yield f"in 50 digits: {mp.nstr(plane_m, 12)} m apart in the plane at {meeting.at_s} s"


def search(
    seed: int,
    keep: Path,
    method: Method = Method.EXACT,
    solver: Solver = solved,
    *,
    seconds: float,
    candidates: int,
    tells: bool = False,
) -> Search:
    """Look for disagreements until the time or the number of candidates is used up."""
    rng = np.random.default_rng(seed)
    run = Search(solver, keep, str(seed), tells=tells)
    until = time.monotonic() + seconds

    def goes_on() -> bool:
        return time.monotonic() < until and run.candidates < candidates

    while goes_on():
        scene, things = random_scene(rng, method)
        truth = run.examine(scene, things, START_M)
        pairs = [pair for pair, meeting in truth.items() if meeting.least_m < START_M + scene.separation_m]
        known = {thing.key: thing for thing in things}
        for k in rng.permutation(len(pairs))[:2]:
            pair = [known[key] for key in pairs[k]]
            climb(run, rng, scene, pair, goes_on)
    return run


def random_scene(rng: np.random.Generator, method: Method) -> tuple[Scene, list[Thing]]:
    """A scene of any workload."""
    seed = int(rng.integers(10**9))
    tolerance_m, separation_m = LIMITS[rng.integers(len(LIMITS))]
    workload = [*WORKLOADS, None][rng.integers(len(WORKLOADS) + 1)]
    if workload is None:
        scene, areas, tracks = throw_wild(seed, OBJECTS)
    else:
        earth = list(EarthModel)[rng.integers(2)]
        small = 0.01 if workload.window < 0.1 else 1.0
        scene, areas, tracks = plain_scene(workload, seed, OBJECTS, OBJECTS, earth, tolerance_m, separation_m * small)
    return replace(scene, method=method), [*areas, *tracks]


def climb(run: Search, rng: np.random.Generator, scene: Scene, pair: list[Thing], goes_on: Callable[[], bool]) -> None:
    """Change an object of a pair until the number of contacts changes; locate the change, and look around it."""

    def look(candidate: list[Thing], care_m: float) -> oracle.Meeting | None:
        if not goes_on():
            return None
        try:
            (meeting,) = run.examine(scene, candidate, care_m).values()
        except InvalidInput:  # the change made the input invalid
            return None
        return meeting

    meeting = look(pair, START_M)
    for _ in range(MUTATIONS):
        candidate = mutated(rng, pair, 10.0 ** rng.uniform(-3.0, 0.0))
        other = meeting and candidate and look(candidate, START_M)
        if not meeting or not other:
            continue
        if len(other.intervals) != len(meeting.intervals):
            pair = halved(look, pair, candidate, len(meeting.intervals))
            break
        if score(scene, other) < score(scene, meeting):
            pair, meeting = candidate, other
    for share in 10.0 ** rng.uniform(-12.0, -5.0, NEARBY):
        look(mutated(rng, pair, share) or pair, 0.0)
    meeting = look(pair, 0.0)
    for k, one in enumerate(pair):
        if isinstance(one, Area) and meeting:
            for cut in cut_short(rng, one, meeting):
                look([*pair[:k], cut, *pair[k + 1 :]], 0.0)


def halved(
    look: Callable[[list[Thing], float], oracle.Meeting | None], one: list[Thing], two: list[Thing], contacts: int
) -> list[Thing]:
    """Where on the way between two versions of a pair the number of its contacts changes."""
    for _ in range(HALVINGS):
        middle = between(one, two)
        meeting = look(middle, 0.0)
        if meeting is None:
            break
        one, two = (middle, two) if len(meeting.intervals) == contacts else (one, middle)
    return one


def score(scene: Scene, meeting: oracle.Meeting) -> float:
    """Distance from the edge of contact: metres for a pair that misses, seconds for a pair that meets."""
    return max((end - start for start, end in meeting.intervals), default=meeting.least_m - scene.separation_m)


def cut_short(rng: np.random.Generator, one: Area, meeting: oracle.Meeting) -> Iterator[Area]:
    """The area with a span that begins or ends within microseconds of a contact's end."""
    for interval in meeting.intervals_us[:2]:
        for end in interval:
            if np.isfinite(end):
                at = int(end) + int(rng.integers(-2, 3))
                yield replace(one, start_us=None, end_us=at)
                yield replace(one, start_us=at, end_us=None)


def mutated(rng: np.random.Generator, pair: list[Thing], share: float) -> list[Thing] | None:
    """The pair with one object changed by a share of its size or time; None if that is refused."""
    try:
        which = int(rng.integers(2))
        new = _mutated(rng, pair[which], share)
    except InvalidInput:
        return None
    return [new, pair[1]] if which == 0 else [pair[0], new]


def _mutated(rng: np.random.Generator, one: Thing, share: float) -> Thing:
    if isinstance(one, Area):
        xy = shapely.get_coordinates(one.footprint)
        size = np.ptp(xy, axis=0)
        by = rng.normal(size=2) * share * size
        new: Thing = replace(one, footprint=shapely.transform(one.footprint, lambda c: c + by))
    else:
        kind = rng.choice(["all", "waypoint", "time", "outline"])
        size = np.ptp(one.positions_deg, axis=0) + 1e-9
        size[0] = min(size[0], 360.0 - size[0]) if size[0] > 180.0 else size[0]
        if kind == "all":
            new = replace(one, positions_deg=one.positions_deg + rng.normal(size=2) * share * size)
        elif kind == "waypoint":
            positions = one.positions_deg.copy()
            positions[rng.integers(len(positions))] += rng.normal(size=2) * share * size
            new = replace(one, positions_deg=positions)
        elif kind == "time":
            times = one.times_us.copy()
            times[rng.integers(len(times))] += int(rng.normal() * share * (times[-1] - times[0])) + int(
                rng.integers(-1, 2)
            )
            new = replace(one, times_us=times)
        else:
            new = replace(one, outline_m=one.outline_m * (1.0 + rng.normal(size=2) * share))
    return new


def between(one: list[Thing], two: list[Thing]) -> list[Thing]:
    """The pair half way between two versions of it."""
    found: list[Thing] = []
    for a, b in zip(one, two, strict=True):
        if isinstance(a, Area) and isinstance(b, Area):
            middle = (shapely.get_coordinates(a.footprint) + shapely.get_coordinates(b.footprint)) / 2
            found.append(replace(a, footprint=shapely.set_coordinates(shapely.transform(a.footprint, np.copy), middle)))
        elif isinstance(a, Track) and isinstance(b, Track):
            means = {name: (getattr(a, name) + getattr(b, name)) / 2 for name in ("positions_deg", "outline_m")}
            found.append(replace(a, times_us=(a.times_us + b.times_us) // 2, **means))
    return found


def replay(path: Path, method: Method) -> int:
    """Compare one scene file with the oracle."""
    scene, areas, tracks, _ = formats.read(path)
    assert scene is not None
    scene = replace(scene, method=method)
    result = compared(scene, areas, tracks, solved(scene, areas, tracks))
    lines = [*result.wrong, *in_fifty_digits(scene, [*areas, *tracks], oracle.meetings(scene, areas, tracks))]
    sys.stdout.write("".join(f"{line}\n" for line in lines) + f"{result.unresolved} unresolved\n")
    return int(bool(result.wrong))


def main() -> int:
    """Search, or replay, as the command line asks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--method", type=Method, default=Scene("default").method)
    parser.add_argument("--keep", type=Path, help="directory for scene files (default: a new one)")
    parser.add_argument("--replay", type=Path, help="compare this scene file, and nothing else")
    options = parser.parse_args()
    if options.replay:
        return replay(options.replay, options.method)
    keep = options.keep or Path(tempfile.mkdtemp(prefix="adversary-"))
    keep.mkdir(parents=True, exist_ok=True)
    run = search(options.seed, keep, options.method, seconds=60.0 * options.minutes, candidates=sys.maxsize, tells=True)
    total = run.total
    sys.stdout.write(
        f"{run.candidates} candidates, {total.pairs} pairs, {total.touching} touch, {total.grazing} grazing, "
        f"{total.unresolved} unresolved; nearest miss {run.nearest_m:.2g} m, shortest contact {run.shortest_s:.2g} s; "
        f"worst end {total.worst_error_s:.2g} s off, widest bound {total.worst_bound_s:.2g} s; "
        f"{len(run.found)} disagreements\n"
    )
    return int(bool(run.found))


if __name__ == "__main__":
    sys.exit(main())
