"""How time and memory grow with a scene: at constant density, and at constant area.

    ./.venv/bin/python benchmarks/growth.py [--sea 500 5000 50000] [--box 500 1000] [--dsn DSN] [--jobs 2]
        [--document docs/explanation/performance.md] [--folder docs/explanation/performance] [--redraw]

*sea* has the same density at any size (made_scenes.py), so that pairs grow as objects do; *box* is the paper's, where
pairs grow as the square. Each scene is loaded and detected by two fresh processes, in a new database. It is detected
with all rows to write, then again in full with the same answer, then after each of fifteen changes of one track; the
result of these is the median. Memory is the peak of the detecting process, and of the server's processes together (PSS,
sampled; shared memory counted once).

The first seconds are by the clock, for both detections. The others are processor seconds of client and server together,
which vary less on a shared machine (measured.py). Exponents are of a power law through the two largest sizes, and
through all from 5,000 on. Scenes of up to 5,000 objects are loaded and detected three times; the results are medians.
"""

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
from made_scenes import Kind, box, sea
from measured import (
    STAGES,
    detect_alone,
    fresh_database,
    in_fresh_process,
    load,
    medians,
    read_csv,
    versions,
    write_csv,
)
from tables import markdown, show

import conflictdb
from conflictdb import Scene

SEA: Final = (500, 5_000, 50_000, 200_000, 1_000_000)
BOX: Final = (500, 1_000, 2_000, 5_000, 10_000, 20_000)
# Scenes up to this size are detected three times: their times are short compared with disturbances.
SMALL: Final = 5_000
# Larger scenes are not detected again in full: it takes as long as the first time.
LARGE: Final = 200_000
SEED: Final = 1


def load_scene(dsn: str, series: str, objects: int, name: str) -> None:
    """Make a scene and load it, on a connection of its own."""
    with conflictdb.connect(dsn) as db:
        fill(db, series, objects, name)


def fill(db: conflictdb.Database, series: str, objects: int, name: str) -> None:
    """Make a scene and load it."""
    if series == "sea":
        load(db, Scene(name), sea(objects, SEED))
    else:
        _, areas, tracks = box(Kind.MIXED, objects, SEED)
        load(db, Scene(name), [(areas, tracks)])


def measure(dsn: str, series: str, objects: int, times: int, **settings: Any) -> dict[str, Any]:
    """Return the row of one scene: medians over `repeat` loads and detections."""
    found = []
    for number in range(times):
        name = f"{series} {objects} {number}"
        in_fresh_process(load_scene, dsn, series, objects, name)
        found.append(detect_alone(dsn, name, again=objects <= LARGE, **settings))
    new, changed = medians([one.new for one in found]), medians([one.changed for one in found])
    same = medians([one.same for one in found if one.same]) if objects <= LARGE else None
    row = {"series": series, "objects": objects, "pieces": count_pieces(dsn, name), **asdict(new)}
    return row | {
        "same_total_s": same.total_s if same else None,
        "same_write_s": same.write_s if same else None,
        "same_cpu_s": same.cpu_s if same else None,
        "change_total_s": changed.total_s,
        "change_cpu_s": changed.cpu_s,
        "client_mb": max(one.client_mb for one in found),
        "server_mb": max((one.server_mb for one in found if one.server_mb is not None), default=None),
        "dominates": max(STAGES, key=lambda stage: row[stage]).removesuffix("_s"),
    }


def count_pieces(dsn: str, scene: str) -> int:
    """Return the number of pieces of a scene."""
    with conflictdb.connect(dsn) as db:
        query = "SELECT count(*) FROM conflictdb.piece JOIN conflictdb.scene USING (scene_id) WHERE scene.name = %s"
        found = db.connection.execute(query, [scene]).fetchone()
        db.connection.rollback()
    return int(found[0]) if found else 0


def exponent(rows: Sequence[dict[str, Any]], column: str) -> float:
    """Return the power of the number of objects that a column grows with, by least squares; NaN of fewer than two."""
    known = [(row["objects"], row[column]) for row in rows if row[column]]
    if len(known) < 2:
        return math.nan
    objects, values = np.log(np.array(known, np.float64)).T
    return float(np.polyfit(objects, values, 1)[0])


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return a table in Markdown for each series, and its exponents."""
    parts = []
    for series in dict.fromkeys(row["series"] for row in rows):
        own = sorted((row for row in rows if row["series"] == series), key=lambda row: row["objects"])
        heads = (
            "objects",
            "pieces",
            "candidates",
            "conflicts",
            "all, s",
            "processor, s",
            *(stage.removesuffix("_s") for stage in STAGES),
            "again, s",
            "processor, s",
            "us an object",
            "one change, ms",
            "processor, ms",
            "client, MB",
            "server, MB",
        )
        lines = [
            [
                *(f"{row[name]:,}" for name in ("objects", "pieces", "candidate_pairs", "conflicts")),
                f"{row['total_s']:.3g}",
                "" if row["cpu_s"] is None else f"{row['cpu_s']:.3g}",
                *(
                    f"**{row[stage]:.2g}**" if stage == f"{row['dominates']}_s" else f"{row[stage]:.2g}"
                    for stage in STAGES
                ),
                "" if row["same_total_s"] is None else f"{row['same_total_s']:.3g}",
                "" if row["same_cpu_s"] is None else f"{row['same_cpu_s']:.3g}",
                f"{1e6 * (row['cpu_s'] or row['total_s']) / row['objects']:,.0f}",
                f"{1e3 * row['change_total_s']:.0f}",
                "" if row["change_cpu_s"] is None else f"{1e3 * row['change_cpu_s']:.0f}",
                f"{row['client_mb']:,.0f}",
                "" if row["server_mb"] is None else f"{row['server_mb']:,.0f}",
            ]
            for row in own
        ]
        parts.append(f"**{series}**{growth(own)}\n\n{markdown(heads, lines)}")
    return "\n\n".join(parts)


def growth(own: Sequence[dict[str, Any]]) -> str:
    """Return the exponents of a series in words; nothing of fewer than two sizes."""
    if len(own) < 2:
        return "."
    large = [row for row in own if row["objects"] >= SMALL]
    exponents = [
        f"{word} N^{exponent(own[-2:], name):.2f}" for word, name in (("time", "total_s"), ("processor", "cpu_s"))
    ]
    if len(large) > 2:
        exponents.append(f"time from {SMALL:,} on N^{exponent(large, 'total_s'):.2f}")
    return f": over the last two sizes {', '.join(exponents)}."


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw time, its stages and memory against objects, a row of panels for each series."""
    from figures import BLUE, GREEN, GREY, ORANGE, PINK, both_logarithmic, figure

    colours = dict(zip(STAGES, (ORANGE, BLUE, GREEN, GREY, PINK, "#000000"), strict=True))
    del colours["stage3_s"]  # of `exact` it is too little to show: few pairs are decided in closed form
    every = list(dict.fromkeys(row["series"] for row in rows))
    with figure(path, len(every), 3, (12.0, 3.4 * len(every))) as (drawn, panels):
        for (whole, stages, memory), series in zip(panels, every, strict=True):
            own = sorted((row for row in rows if row["series"] == series), key=lambda row: row["objects"])
            for name, label in (("cpu_s", "all rows new"), ("same_cpu_s", "the same again")):
                at = [(row["objects"], row[name]) for row in own if row[name]]
                if at:
                    whole.plot(*zip(*at, strict=True), "o-", markersize=3, label=label)
            for stage, colour in colours.items():
                at = [(row["objects"], row[stage]) for row in own if row[stage]]
                if at:
                    stages.plot(
                        *zip(*at, strict=True), "o-", color=colour, markersize=3, label=stage.removesuffix("_s")
                    )
            for name in ("client_mb", "server_mb"):
                at = [(row["objects"], row[name]) for row in own if row[name]]
                if at:
                    memory.plot(*zip(*at, strict=True), "o-", markersize=3, label=name.removesuffix("_mb"))
            both_logarithmic(whole, f"{series}: detection", "objects", "processor seconds")
            both_logarithmic(stages, f"{series}: stages, all rows new", "objects", "processor seconds")
            both_logarithmic(memory, f"{series}: most memory", "objects", "MB")
            for panel in (whole, stages, memory):
                panel.legend(fontsize=7, frameon=False)
        drawn.tight_layout()


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dsn", help="server to make databases on (default: the embedded one)")
    parser.add_argument("--sea", type=int, nargs="*", default=list(SEA), help="objects at constant density")
    parser.add_argument("--box", type=int, nargs="*", default=list(BOX), help="objects at constant area")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="write growth.csv and growth.svg there (needs matplotlib)")
    parser.add_argument("--document", type=Path, help="put the table there")
    parser.add_argument("--redraw", action="store_true", help="measure nothing: take the numbers from the folder")
    args = parser.parse_args()
    if args.folder:
        import figures  # noqa: F401  # reports how to install a missing matplotlib before anything is measured
    rows: list[dict[str, Any]] = read_csv(args.folder / "growth.csv") if args.redraw else []
    software = None
    for series, objects in [] if args.redraw else [("sea", n) for n in args.sea] + [("box", n) for n in args.box]:
        with fresh_database(args.dsn) as dsn:
            rows.append(measure(dsn, series, objects, 3 if objects <= SMALL else 1, jobs=args.jobs))
            with conflictdb.connect(dsn) as db:
                software = versions(db.connection)
        print({name: value for name, value in rows[-1].items() if value}, flush=True)
        if args.folder:  # large scenes take long: keep the results so far
            write_csv(args.folder / "growth.csv", rows)
    text = table(rows) + (f"\n\n{software}." if software else "")
    show(text, "growth", args.document)
    if args.folder:
        draw(rows, args.folder / "growth.svg")


if __name__ == "__main__":
    main()
