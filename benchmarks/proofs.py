"""Proofs of large scenes: how many, how large, and what they and their check take.

    ./.venv/bin/python benchmarks/proofs.py [--only box sea ais-hour swiss-day]

Seconds are of a processor, with one thread: of `solve`, of the proof, and of the checker, which is plain Python.
"""

import argparse
import contextlib
import io
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from data import real_input
from made_scenes import Kind, box, sea
from skagerrak_ais import FASTEST_KN
from swiss_flights import flights, zones
from tables import markdown

import conflictdb
from conflictdb import Area, Scene, Track
from conflictdb.core.world import occupy
from conflictdb.formats import check_proof
from conflictdb.memory.certifying import certified, proof_of
from conflictdb.memory.questions import solved, world_of

Objects = tuple[Scene, list[Area], list[Track]]
HEADER: Final = (
    *("scene", "objects", "pieces near", "directions", "conflicts", "without proof", "bytes a pair", "MB"),
    *("solve, s", "proof, s", "directions alone, s", "checker, s", "it says"),
)


def _sea() -> Objects:
    parts = list(sea(50_000, 1))
    return Scene("sea"), [one for areas, _ in parts for one in areas], [one for _, tracks in parts for one in tracks]


def _ais(separation_m: float) -> Objects:
    read = conflictdb.read(real_input("ais-skagerrak", "ais.csv.gz"), max_speed_kn=FASTEST_KN, skip_invalid=True)
    return Scene("ais", separation_m=separation_m), [], list(read.tracks)


def _swiss() -> Objects:
    left_out: Counter[str] = Counter()
    areas = zones(left_out)
    return Scene("swiss"), areas, flights(None, left_out)[0]


SCENES: Final[dict[str, Callable[[], Objects]]] = {
    "box": lambda: box(Kind.MIXED, 5_000, 1),
    "sea": _sea,
    "ais-hour": lambda: _ais(0.0),
    "ais-hour-500m": lambda: _ais(500.0),
    "swiss-day": _swiss,
}


def measure(name: str) -> list[Any]:
    """Return a row of the table."""
    scene, areas, tracks = SCENES[name]()
    began = time.process_time()
    world, tracks, areas = world_of("proofs", tracks, areas, scene)
    occupied = occupy(world, areas, tracks)
    rows = solved(world.setup, occupied)
    solve_s = time.process_time() - began
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "proof")
        began = time.process_time()
        lines, counts = proof_of(world, occupied, rows, 1)
        steps = 0
        with path.open("w") as stream:
            for line in lines:
                steps += len(line) if line.startswith("[") and not line.startswith('["') else 0
                stream.write(line)
        proof_s = time.process_time() - began
        found, size = certified(occupied, counts), path.stat().st_size
        began = time.process_time()
        with contextlib.redirect_stdout(io.StringIO()) as report:
            check_proof.main([str(path)])
        check_s = time.process_time() - began
    said = report.getvalue()
    print(name, said, sep="\n")
    missing = found.unproven_pairs + found.unproven_conflicts
    return [
        *(
            name,
            f"{found.objects:,}",
            f"{found.pairs:,}",
            f"{found.directions:,}",
            f"{found.conflicts:,}",
            str(missing),
        ),
        *(f"{steps / max(found.pairs, 1):.0f}", f"{size / 1e6:.1f}", f"{solve_s:.1f}", f"{proof_s:.1f}"),
        *(f"{counts.kernel_s:.2f}", f"{check_s:.0f}", said.splitlines()[-1]),
    ]


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=SCENES, default=list(SCENES))
    warnings.simplefilter("ignore", UserWarning)
    rows = [measure(name) for name in parser.parse_args().only]
    print(markdown(HEADER, rows))


if __name__ == "__main__":
    main()
