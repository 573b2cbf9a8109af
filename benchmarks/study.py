"""The paper's study again, and the trade of speed against accuracy: the time of a detection, in all and by stage.

    ./run python benchmarks/study.py [--objects 100 ... 800] [--seeds 10] [--methods exact nlp screen] [--dsn DSN]
        [--document docs/explanation/performance.md] [--folder docs/explanation/performance] [--redraw]

Bienkowski, Sidoti, Pattipati, "Interference Identification for Time-Varying Polyhedra", IEEE Access 2021, figures 6 to
12: total time against objects and against conflicts, the time of each stage against its input, and stage 4 for pairs
that meet and for false alarms. Random scenes of its workload (made_scenes.py): areas alone, areas and tracks, tracks
alone; WGS84, tolerance 1 m, in the database, every row new. Several scenes of each size, as in figure 6: their median,
and the least and the most of total time and of conflicts. Seconds are processor seconds of client and server
(measured.py); one column is by the clock.

The trade is a whole detection by `screen` and by `nlp` against one by `exact`, and the share of the pairs that `screen`
reports and `exact` proves apart. Nothing but the default installation is needed.

The last two columns are stage 4 alone, on the scene's pairs of pieces in memory: processor time per pair that meets,
and per pair that does not. Stage 3 of `exact` is the closed form, which decides few pairs.
"""

import argparse
import statistics
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from curves import BLUE, GREEN, ORANGE, Curve, Panel, figure
from made_scenes import Kind, box
from measured import STAGES, WARM, Detection, detect, fresh_database, load, medians, read_csv, versions, write_csv
from tables import markdown, show

import conflictdb
from conflictdb import Area, Method, Scene, Track, kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import PairRows, Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.published.stage3_projection import windows
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.core.stage2_intersection import intersections
from conflictdb.core.stage4.contact_search import contacts
from conflictdb.earth.registry import Setup
from conflictdb.model.results import Kind as ObjectKind

METHODS: Final = (Method.EXACT, Method.NLP, Method.SCREEN)
# Pairs of each sort whose stage 4 is timed by itself; a program takes milliseconds.
ASKED: Final = {Method.EXACT: 20_000, Method.NLP: 40}


@dataclass(frozen=True)
class Stage4:
    """Microseconds of stage 4 per pair of pieces that meets, and per pair that does not; None without pairs."""

    met_us: float | None
    apart_us: float | None


def measure(
    db: conflictdb.Database, kind: Kind, objects: int, seed: int, method: Method, seeds: int
) -> tuple[Detection, Stage4]:
    """Return the measurements of one scene."""
    scene, areas, tracks = box(kind, objects, seed)
    scene = replace(scene, name=f"{kind} {objects} {seed} {method}", method=method)
    load(db, scene, [(areas, tracks)])
    found = detect(db, scene.name)
    is_solved = tracks and seed < seeds and method is not Method.SCREEN
    return found, stage4(scene, areas, tracks) if is_solved else Stage4(None, None)


def stage4(scene: Scene, areas: list[Area], tracks: list[Track]) -> Stage4:
    """Return the times of stage 4 for pairs that meet and for false alarms of the stages before."""
    setup = Setup.of(scene)
    pieces = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of(tracks))
    pairs = intersections(pieces, *candidates(pieces), regions=scene.method is Method.NLP)
    moves = (pieces.kind[pairs.a] == ObjectKind.TRACK.code) | (pieces.kind[pairs.b] == ObjectKind.TRACK.code)
    pairs = pairs.take(PairRows(np.flatnonzero(moves)))
    prepared = kernel.KernelScene(setup.plane.kernel_plane, pieces, pairs.a, pairs.b)
    if scene.method is Method.NLP:
        first, last = windows(setup, prepared, pairs)
    else:
        start, end = pieces.shared_span(pairs.a, pairs.b)
        first, last = np.zeros(len(pairs)), (end - start) / 1e6
    exact = replace(scene, method=Method.EXACT)
    found, _ = contacts(setup.under(exact), prepared, pairs, first, last)
    meets = np.zeros(len(pairs), np.bool_)
    meets[found.pair] = True
    possible = first <= last
    return Stage4(
        *(
            _pair_us(setup, pieces, pairs, (first, last), PairRows(np.flatnonzero(of & possible)))
            for of in (meets, ~meets)
        )
    )


def _pair_us(setup: Setup, pieces: Pieces, pairs: Pairs, window: tuple[Floats, Floats], rows: PairRows) -> float | None:
    rows = PairRows(np.random.default_rng(0).permutation(rows)[: ASKED[setup.scene.method]])
    if not len(rows):
        return None
    some = pairs.take(rows)
    began = time.process_time()
    contacts(
        setup,
        kernel.KernelScene(setup.plane.kernel_plane, pieces, some.a, some.b),
        some,
        window[0][rows],
        window[1][rows],
    )
    return 1e6 * (time.process_time() - began) / len(rows)


def study(dsn: str, sizes: list[int], seeds: int, methods: list[Method]) -> list[dict[str, object]]:
    """Return a row of medians for each method, kind and size."""
    rows: list[dict[str, object]] = []
    with conflictdb.connect(dsn) as db:
        for method in methods:
            detect(db, WARM, method=method)
            for kind in Kind:
                for objects in sizes:
                    found = [measure(db, kind, objects, seed, method, seeds) for seed in range(seeds)]
                    row = {"method": method.value, "kind": kind.value, "objects": objects, "scenes": seeds}
                    row |= asdict(medians([one for one, _ in found]))
                    row |= spread([one for one, _ in found])
                    for name in ("met_us", "apart_us"):
                        known = [value for _, pair in found if (value := getattr(pair, name)) is not None]
                        row[name] = statistics.median(known) if known else None
                    rows.append(row)
                    print(
                        f"{method:>6} {kind:>7} {objects:>5}: {row['conflicts']:>7} conflicts, {row['total_s']:.3f} s"
                    )
    return [row | traded(row, rows) for row in rows]


def traded(row: dict[str, object], rows: list[dict[str, object]]) -> dict[str, object]:
    """Return the seconds of a row against those of `exact`, and the share of its pairs that `exact` does not report."""
    for other in rows:
        if other["method"] == Method.EXACT.value and all(other[name] == row[name] for name in ("kind", "objects")):
            ratio = row["cpu_s"] / other["cpu_s"] if row["cpu_s"] and other["cpu_s"] else None
            never = 1.0 - other["conflicts"] / row["conflicts"] if row["conflicts"] else 0.0
            return {"of_exact": ratio, "never_meet": max(never, 0.0)}
    return {"of_exact": None, "never_meet": None}


def spread(found: list[Detection]) -> dict[str, object]:
    """Return the least and the most of the conflicts and the processor seconds of scenes of one size; None: unknown."""
    row: dict[str, object] = {}
    for name in ("conflicts", "cpu_s"):
        known = [value for one in found if (value := getattr(one, name)) is not None]
        row[f"{name}_least"], row[f"{name}_most"] = (min(known), max(known)) if known else (None, None)
    return row


def draw(rows: list[dict], path: Path) -> None:
    """Draw a panel for each figure of the paper, and two for the trade."""
    colours = {Kind.STATIC: BLUE, Kind.MIXED: GREEN, Kind.TRACKS: ORANGE}
    dashes = {Method.EXACT.value: "", Method.NLP.value: "2 3", Method.SCREEN.value: "7 3"}
    seconds, microseconds = "processor seconds", "microseconds"
    questions = (
        ("6: all, against objects", "objects", "cpu_s", seconds),
        ("7: all, against conflicts", "conflicts", "cpu_s", seconds),
        ("8: stage 1, broad phase", "objects", "stage1_s", seconds),
        ("9: stage 2, intersection", "candidate_pairs", "stage2_s", seconds),
        ("10: stage 3, projection", "intersecting_pairs", "stage3_s", seconds),
        ("11: stage 4, solver", "window_pairs", "stage4_s", seconds),
        ("12: a pair in stage 4 that meets", "objects", "met_us", microseconds),
        ("12: a false alarm in stage 4", "objects", "apart_us", microseconds),
        ("the trade: seconds, times exact", "objects", "of_exact", "times exact"),
        ("the trade: reported, never meet", "objects", "never_meet", "share of pairs"),
    )
    with figure(path, 4) as panels:
        for title, across, up, unit in questions:
            panel = Panel(title, across.replace("_", " "), unit)
            panels.append(panel)
            for method in dict.fromkeys(row["method"] for row in rows):
                for kind, colour in colours.items():
                    own = [row for row in rows if (row["method"], row["kind"]) == (method, kind)]
                    at = sorted((row[across], row[up]) for row in own if row[across] and row.get(up))
                    if at:
                        panel.curves.append(Curve(at, f"{kind}, {method}", colour, dashes[method]))
                    if (up, across) == ("cpu_s", "objects"):
                        ends = sorted((row[across], row["cpu_s_least"], row["cpu_s_most"]) for row in own if row[up])
                        low, high = ([(size, bound[k]) for size, *bound in ends] for k in (0, 1))
                        panel.bands.append((low, high, colour))


def table(rows: list[dict]) -> str:
    """Return the largest scenes as a table in Markdown."""
    largest = max(row["objects"] for row in rows)
    heads = (
        "method",
        "scene",
        "candidates",
        "conflicts",
        "least - most",
        "all, s",
        "processor, s",
        "least - most",
        *(name.split("_")[0] for name in STAGES),
    )
    lines = [
        [
            f"`{row['method']}`",
            row["kind"],
            f"{row['candidate_pairs']:,}",
            f"{row['conflicts']:,}",
            f"{row['conflicts_least']:,} - {row['conflicts_most']:,}",
            f"{row['total_s']:.3g}",
            "" if row["cpu_s"] is None else f"{row['cpu_s']:.3g}",
            "" if row["cpu_s"] is None else f"{row['cpu_s_least']:.3g} - {row['cpu_s_most']:.3g}",
            *(f"{row[name]:.2g}" for name in STAGES),
            *("" if row[name] is None else f"{row[name]:,.2g}" for name in ("met_us", "apart_us", "of_exact")),
            "" if row["never_meet"] is None else f"{row['never_meet']:.0%}",
        ]
        for row in rows
        if row["objects"] == largest
    ]
    scenes = max(row["scenes"] for row in rows)
    heads = (*heads, "a pair that meets, us", "a false alarm, us", "times exact", "never meet")
    return f"{largest} objects, medians of {scenes} scenes:\n\n{markdown(heads, lines)}"


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server to make a database on (default: the embedded one)")
    parser.add_argument("--objects", type=int, nargs="+", default=[100, 200, 300, 400, 500, 600, 700, 800])
    parser.add_argument("--seeds", type=int, default=10, help="scenes of each size")
    parser.add_argument("--methods", type=Method, nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--folder", type=Path, help="write study.csv and study.svg there")
    parser.add_argument("--document", type=Path, help="put the table there")
    parser.add_argument("--redraw", action="store_true", help="measure nothing: take the numbers from the folder")
    args = parser.parse_args()
    if args.redraw:
        rows, software = read_csv(args.folder / "study.csv"), None
    else:
        with fresh_database(args.dsn) as dsn:
            rows = study(dsn, args.objects, args.seeds, args.methods)
            with conflictdb.connect(dsn) as db:
                software = versions(db.connection)
    text = table(rows) + (f"\n\n{software}." if software else "")
    show(text, "study", args.document)
    if args.folder and not args.redraw:
        write_csv(args.folder / "study.csv", rows)
    if args.folder:
        draw(rows, args.folder / "study.svg")


if __name__ == "__main__":
    main()
