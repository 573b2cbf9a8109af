"""The trade of speed against accuracy: whole first detections by method, with and without regions, in turn.

    ./run python benchmarks/trade.py [--rounds 5] [--scenes box-mixed sea] [--document docs/explanation/accuracy.md]

Random scenes of the paper's workload (made_scenes.py): its box with areas alone, tracks alone, and both, and a sea of
constant density. Each setting detects each scene anew in every round, in an order that alternates. Seconds are
processor seconds of client and server (measured.py), the median of the rounds. *times exact* is the median of the
ratios within a round, to the row `exact` with regions; `screen` never has any. *never meet* are pairs that `exact` does
not report. Needs nothing but what ./run installs.
"""

import argparse
import statistics
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from made_scenes import Kind, box, sea
from measured import STAGES, WARM, Detection, detect, fresh_database, load, versions
from tables import markdown, show

import conflictdb
from conflictdb import Area, Method, Scene, Track
from conflictdb.model.settings import Regions

Content = tuple[Scene, list[Area], list[Track]]


def at_sea(objects: int) -> Content:
    """Return a sea of constant density."""
    parts = list(sea(objects, 1))
    return Scene("sea"), [one for areas, _ in parts for one in areas], [one for _, tracks in parts for one in tracks]


SCENES: Final[dict[str, Callable[[], Content]]] = {
    "box-static": lambda: box(Kind.STATIC, 2_000, 1),
    "box-mixed": lambda: box(Kind.MIXED, 5_000, 1),
    "box-tracks": lambda: box(Kind.TRACKS, 5_000, 1),
    "sea": lambda: at_sea(10_000),
}
SETTINGS: Final = (
    (Method.EXACT, Regions.ON),
    (Method.EXACT, Regions.OFF),
    (Method.SCREEN, Regions.OFF),
)
BASE: Final = SETTINGS[0]


def measure(dsn: str, name: str, content: Content, rounds: int) -> list[list[str]]:
    """Return a row for each setting."""
    scene, areas, tracks = content
    found: dict[tuple[Method, Regions], list[Detection]] = {one: [] for one in SETTINGS}
    with conflictdb.connect(dsn) as db:
        for number in range(rounds):
            for method, regions in SETTINGS if number % 2 else SETTINGS[::-1]:
                own = replace(scene, name="trade", method=method, regions=regions)
                load(db, own, [(areas, tracks)])
                found[method, regions].append(detect(db, own.name))
                db.scene(own.name).delete()
    exact = found[BASE]
    rows = []
    for (method, regions), some in found.items():
        ratio = statistics.median(seconds(one) / seconds(other) for one, other in zip(some, exact, strict=True))
        rows.append(
            [
                name,
                f"`{method}`",
                str(regions),
                f"{some[0].conflicts:,}",
                f"{1.0 - exact[0].conflicts / max(some[0].conflicts, 1):.0%}",
                f"{statistics.median(map(seconds, some)):.3g}",
                f"{statistics.median(one.client_s for one in some):.3g}",
                f"{ratio:.2f}",
                *(f"{statistics.median(getattr(one, stage) for one in some):.2g}" for stage in STAGES),
            ]
        )
        print(*rows[-1], flush=True)
    return rows


def seconds(one: Detection) -> float:
    """Return processor seconds of client and server; by the clock where those of the server are unknown."""
    return one.total_s if one.cpu_s is None else one.cpu_s


def main() -> None:
    """Measure, print the table, and write it to the document."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server to make a database on (default: the embedded one)")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=SCENES)
    parser.add_argument("--document", type=Path, help="put the table into its place in this document")
    args = parser.parse_args()
    heads = ("scene", "method", "regions", "conflicts", "never meet", "all, s", "client, s", "times exact")
    with fresh_database(args.dsn) as dsn:
        with conflictdb.connect(dsn) as db:
            detect(db, WARM)
            software = versions(db.connection)
        rows = [row for name in args.scenes for row in measure(dsn, name, SCENES[name](), args.rounds)]
    show(f"{markdown((*heads, *(one.split('_')[0] for one in STAGES)), rows)}\n\n{software}.", "trade", args.document)


if __name__ == "__main__":
    main()
