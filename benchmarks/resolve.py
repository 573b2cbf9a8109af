"""Clear scenes by delays: the least total delay against first come, first served and random orders.

./run python benchmarks/resolve.py [sea] [box] [ring] [margin] [generator] [mvp]

sea, box : random scenes, as in made_scenes.py; the box with the havens of 60 to 120 nmi around
ring : aircraft that all fly through one point at one time, 5 nmi apart if they are not to conflict (the
    "superconflict" of BlueSky)
margin : what a margin costs: the same sea with a separation in time of 0 to 300 s
generator : the 16 kinds of Pelegrín and Cerulli (conflict_scenes.py)
mvp : scenes of BlueSky and the level kinds, against the Modified Voltage Potential
"""

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from conflict_scenes import KINDS, Flights, generated, published, voltage
from made_scenes import BOX, SEA
from mixed_scenes import plain_scene

from conflictdb import Area, Proposal, Scene, Track, solve
from conflictdb.memory import resolve as clearing
from conflictdb.memory.greedy import greedy
from conflictdb.memory.program import Program

Objects = tuple[Scene, list[Area], list[Track]]
T0_US = 1_780_000_000_000_000


def sea(areas: int, tracks: int) -> Objects:
    """Return a sea of constant density; areas without a start or end are left out, since no delay clears them."""
    workload = replace(SEA, window=0.12 * (areas + tracks) ** 0.5, start_h=(0.0, 3.0))
    scene, standing, moving = plain_scene(workload, 1, areas, tracks)
    return scene, [one for one in standing if one.start_us and one.end_us], moving


def box(tracks: int) -> Objects:
    """Return the paper's box, tracks alone."""
    return plain_scene(replace(BOX, side_haven=None, around_haven=(60.0, 120.0)), 0, 0, tracks)


def ring(count: int, spread_s: float = 0.0) -> Objects:
    """Return aircraft of 450 kn on a ring of 100 nmi, each to the other side."""
    rng, tracks = np.random.default_rng(1), []
    for k in range(count):
        angle, radius = 2.0 * np.pi * k / count, 100.0 / 60.0
        east, north = radius * np.sin(angle) / np.cos(np.radians(52.0)), radius * np.cos(angle)
        start = T0_US + int(rng.uniform(0.0, spread_s) * 1e6)
        path = [(4.0 + east, 52.0 + north), (4.0 - east, 52.0 - north)]
        tracks.append(Track(f"AC{k:03d}", path, [start, start + 1_600_000_000], [(0.0, 0.0)]))
    return Scene("ring", separation_m=5.0 * 1852.0), [], tracks


class _Seen:
    """The program of the last call, with the plans by turns that it is compared with."""

    program: Program
    order: list[int]

    def __init__(self) -> None:
        self._place = clearing.place

    def __call__(self, program: Program, order: list[int], *rest: Any) -> Any:
        self.program, self.order = program, order
        return self._place(program, order, *rest)

    def by_turns(self) -> Iterator[tuple[int, float]]:
        """Yield tracks left and total delay: in the order of departures, then in twenty random orders."""
        rng = np.random.default_rng(0)
        for order in [self.order, *(rng.permutation(self.order).tolist() for _ in range(20))]:
            delays, left = greedy(self.program, order)
            yield len(left), self.program.cost(delays, "total")


def clear(name: str, objects: Objects, within_s: float, limit_s: float = 600.0, **more: Any) -> Proposal:
    """Clear a scene and print a row."""
    scene, areas, tracks = objects
    seen = _Seen()
    clearing.place = seen
    began = time.process_time()
    found = clearing.resolve(tracks, areas, scene, within_s=within_s, limit_s=limit_s, **more)
    took_s = time.process_time() - began
    clearing.place = seen._place
    moves = {move.key: move for move in found.moves}
    after = [clearing.moved(scene, one, moves[one.key]) if one.key in moves else one for one in tracks]
    before = {(one.a_key, one.b_key) for one in solve(tracks, areas, scene)}
    later = {(one.a_key, one.b_key) for one in solve(after, areas, scene)}
    by_turns = list(seen.by_turns())
    first, best = by_turns[0], min(by_turns[1:])
    cleared = 100.0 * (1.0 - len(later) / max(len(before), 1))
    gap = 100.0 * (found.objective_s - found.bound_s) / max(found.objective_s, 1e-9)
    unit = "total" if found.goal == "total" else "largest"
    largest_s = max((abs(move.delay_s) for move in found.moves), default=0.0)
    print(
        f"{name}: movable {len(seen.program)}, pairs {len(seen.program.pair)}; conflicts {len(before)}, "
        f"{cleared:.0f} % cleared, {len(later - before)} new; moved {len(found.moves)}, left {len(found.left)}; "
        f"{unit} {found.objective_s / 60.0:.2f} min, gap {gap:.2f} %{', least' if found.is_least else ''}, largest "
        f"{largest_s / 60.0:.1f} min; first come {first[1] / 60.0:.2f} min ({first[0]} unplaced), best of 20 orders "
        f"{best[1] / 60.0:.2f} ({best[0]}); {took_s:.2f} s",
        flush=True,
    )
    return found


def clear_flights(name: str, flights: Flights) -> None:
    """Clear flights by delays of up to two hours, as far as they are in conflict."""
    scene, tracks = flights.objects()
    if solve(tracks, [], scene):
        clear(name, (scene, [], tracks), 7200.0)
    else:
        print(f"{name}: no conflict")


def against_voltage() -> None:
    """Compare with MVP, which turns aircraft on the way: extra minutes until arrival."""
    scenes = {f"BlueSky {kind} {n}": published(kind, n) for kind, n in (("SUPER", 8), ("WALL", 20), ("MATRIX", 4))}
    scenes |= {f"BlueSky SUPER {n}": published("SUPER", n) for n in (12, 16)}
    scenes |= {kind: generated(kind) for kind in KINDS[:8]}
    for name, flights in scenes.items():
        clear_flights(name, flights)
        done = voltage(flights)
        print(
            f"{name} by MVP: pairs that lose separation {done['before']:.0f} before, {done['lost']:.0f} after, "
            f"{done['new']:.0f} of them new; total {done['total_min']:.2f} min, largest {done['largest_min']:.2f} min",
            flush=True,
        )


def main(which: list[str]) -> None:
    """Run what is named, or all."""
    if "sea" in which or not which:
        for areas, tracks in ((60, 150), (250, 600), (600, 1500)):
            clear(f"sea, {tracks} tracks", sea(areas, tracks), 7200.0)
            clear(f"sea, {tracks} tracks", sea(areas, tracks), 7200.0, goal="largest")
        # 174 conflicts.
        clear("sea, 500 tracks", sea(240, 500), 7200.0)
    if "box" in which or not which:
        clear("box, 400 tracks", box(400), 6 * 3600.0)
        clear("box, 800 tracks", box(800), 12 * 3600.0)
    if "ring" in which or not which:
        for count in (9, 10, 11, 12, 13, 14, 15, 21):
            clear(f"ring of {count}", ring(count), 3600.0, 600.0 if count < 20 else 60.0)
        clear("ring of 40 over an hour", ring(40, 3600.0), 3600.0)
    if "margin" in which or not which:
        scene, areas, tracks = sea(250, 600)
        for margin_s in (0.0, 30.0, 60.0, 120.0, 300.0):
            clear(
                f"sea, 600 tracks, {margin_s:.0f} s apart",
                (replace(scene, time_separation_s=margin_s), areas, tracks),
                7200.0,
            )
    if "generator" in which or not which:
        for kind in KINDS:
            clear_flights(kind, generated(kind))
    if "mvp" in which or not which:
        against_voltage()


if __name__ == "__main__":
    main(sys.argv[1:])
