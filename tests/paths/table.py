"""Print the table of paths: `./run python tests/paths/table.py [--seeds A:B] [--paths NAME ...] [--all] [--write]`.

Seeds are a number or FIRST:END, by default those of `path_table`. Each path is put to the scenes that add to its cells,
with --all to every scene. A cell has the number of comparisons, then ! with failures, or r with refusals; - is not
applicable. --write records the rows of these paths in table.csv, from which the reference is made.
"""

import argparse
import csv
import os
import sys
import tempfile
from pathlib import Path as Folder
from typing import Any

HERE = Folder(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "support")]

from case import Case, scene_of  # noqa: E402
from databases import test_server  # noqa: E402
from path_table import IN_MEMORY, NOT_APPLICABLE, PATHS, SEEDS, Table, seeds_of  # noqa: E402
from reused import ReusedDatabase  # noqa: E402
from scene_features import FEATURES  # noqa: E402
from test_paths import put_stored  # noqa: E402

from conflictdb.jobs import schema  # noqa: E402

RECORD = HERE / "table.csv"
EVERY = "every feature"
COLUMNS = ("path", "feature", "scenes", "comparisons", "failures", "refusals", "reason")


def main() -> int:
    """Print the table; return 1 if a comparison failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds")
    parser.add_argument("--paths", nargs="*", choices=PATHS, default=list(PATHS))
    parser.add_argument("--all", action="store_true", help="put every scene to every path")
    parser.add_argument("--write", action="store_true", help="record the rows in table.csv")
    args = parser.parse_args()
    seeds = None
    if args.seeds is not None:
        first, _, end = args.seeds.partition(":")
        seeds = range(int(first), int(end) if end else int(first) + 1)
    is_one = seeds is not None and len(seeds) == 1
    table = filled(seeds, args.paths, None if args.all or is_one else 1)
    sys.stdout.write("\n".join([text(table, args.paths), *table.problems, ""]))
    if args.write:
        write(table, args.paths)
    return 1 if table.problems else 0


def filled(seeds: range | None, names: list[str], least: int | None) -> Table:
    """Return the table of some seeds and paths; None: of the seeds of each path."""
    table = Table()
    wanted = {name: path for name, path in PATHS.items() if name in names}
    in_memory = {name: path for name, path in wanted.items() if name in IN_MEMORY}
    stored = {name: path for name, path in wanted.items() if name not in in_memory}
    with tempfile.TemporaryDirectory() as folder:
        for name, path in in_memory.items():
            for seed in seeds_of(name) if seeds is None else seeds:
                table.put(Case(scene_of(seed), Folder(folder)), {name: path}, least)
        if stored:
            run = f"paths{os.getpid()}"
            with test_server(run, "main") as server:
                reused = ReusedDatabase(server, server.template(schema.upgrade), f"{server.prefix}_paths")
                dsn = reused.dsn()
                with reused.session(dsn) as conn:
                    for seed in SEEDS if seeds is None else seeds:
                        put_stored(table, seed, conn, dsn, Folder(folder), stored, least)
                reused.drop()
    return table


def text(table: Table, names: list[str]) -> str:
    """Return the table as text, a column for each path."""
    lines = [f"{number:4} {name}" for number, name in enumerate(names)]
    lines.append(" " * 34 + "".join(f"{number:>6}" for number in range(len(names))))
    for feature in FEATURES:
        cells = [_cell(table, name, feature) for name in names]
        lines.append(f"{feature:34}" + "".join(f"{cell:>6}" for cell in cells))
    lines.append("processor time, s".ljust(34) + "".join(f"{table.took_s.get(name, 0.0):6.1f}" for name in names))
    lines.append(f"processor time of this process: {sum(table.took_s.values()):.0f} s")
    return "\n".join(lines)


def _cell(table: Table, name: str, feature: Any) -> str:
    cell = table.cell(name, feature)
    if cell.failures:
        return f"{cell.comparisons}!{cell.failures}"
    if cell.comparisons:
        return str(cell.comparisons)
    return f"r{cell.refusals}" if cell.refusals else "-" if (name, feature) in NOT_APPLICABLE else ""


def write(table: Table, names: list[str]) -> None:
    """Record all cells of some paths; those of other paths stay as they are."""
    with RECORD.open(newline="") as stream:
        _, *recorded = csv.reader(stream)
    rows = {name: [row for row in recorded if row[0] == name] for name in PATHS}
    for name in rows.keys() & set(names):
        counts = [(EVERY, table.total(name), "")]
        counts += [(one, table.cell(name, one), NOT_APPLICABLE.get((name, one), "")) for one in FEATURES]
        rows[name] = [
            [name, feature, *map(str, (cell.scenes, cell.comparisons, cell.failures, cell.refusals)), reason]
            for feature, cell, reason in counts
        ]
    with RECORD.open("w", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([COLUMNS, *(row for name in PATHS for row in rows[name])])


if __name__ == "__main__":
    sys.exit(main())
