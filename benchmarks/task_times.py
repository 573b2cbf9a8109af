"""The commands of a planner's tasks, in this tree and in another one: processor time of the client.

    ./.venv/bin/python benchmarks/task_times.py OTHER_TREE [--rounds 3]

OTHER_TREE is a worktree of another commit, with its .venv. Tasks are those of tests/acceptance/test_planner_tasks.py
that both trees know. The trees take turns with each command, on databases of their own. Printed: the median of each
command in both trees, milliseconds of user and system time, the ratios, and the ratio of the sums.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg
from psycopg import sql
from psycopg.conninfo import make_conninfo

from conflictdb.embedded import embedded

ROOT = Path(__file__).resolve().parents[1]
TASKS = ROOT / "tests" / "acceptance" / "tasks"
LANE = "FERRY NORTH"
COMMANDS = {
    "1 a route and a firing area": (
        *("detect", TASKS / "firing.geojson", TASKS / "ferry.rtz"),
        *("--scene", "tuesday", "--haven", "150,50,20,20"),
    ),
    "the day": ("detect", TASKS / "day.geojson"),
    "2 a late ferry": ("probe", "--late", LANE, "20m", "--diff"),
    "4 a lane with a separation": ("detect", TASKS / "lane2.geojson", "--scene", "lane"),
    "5 why two plans meet": ("explain", "EK D 382", LANE),
    "6 a NOTAM": ("load", TASKS / "notam.txt", "--scene", "notam"),
    "6 its objects": ("objects", "--scene", "notam"),
    "7 acknowledge": ("acknowledge", "FERRY SOUTH", LANE, "--reason", "they see each other", "--by", "Anna"),
    "7 who acknowledged": ("conflicts", "--acknowledged", "yes"),
    "9 a calendar": ("detect", "--scene", "tuesday", "--format", "ics"),
    "10 meeting places": ("conflicts", "--format", "gpx"),
    "11 free departures": ("delays", LANE, "--within", "6h"),
    "13 what changed": ("history", "--since", "24h"),
    "14 clear the scene": ("resolve", "--within", "12h", "--limit", "10m"),
    "16 a branch": ("branch", "create", "trial"),
    "16 its differences": ("branch", "diff", "trial"),
    "16 merge it": ("branch", "merge", "trial"),
    "20 conflicts": ("conflicts",),
}
UPGRADE = "import sys; from conflictdb.jobs import schema; schema.upgrade(sys.argv[1])"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path, metavar="OTHER_TREE")
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    trees = {"other": args.other.resolve(), "this": ROOT}
    found: dict[str, dict[str, list[float]]] = {name: {tree: [] for tree in trees} for name in COMMANDS}
    for _ in range(args.rounds):
        with databases(trees) as dsns:
            for tree, path in trees.items():
                client_seconds(path, dsns[tree], "-c", UPGRADE, dsns[tree])
            for name, words in COMMANDS.items():
                for tree, path in trees.items():
                    taken = client_seconds(path, dsns[tree], "-m", "conflictdb", *map(str, words))
                    found[name][tree].append(taken)
                print(f"{name}: {found[name]}", file=sys.stderr, flush=True)
    sums = dict.fromkeys(trees, 0.0)
    for name, each in found.items():
        medians = {tree: 1e3 * statistics.median(every) for tree, every in each.items()}
        sums = {tree: sums[tree] + medians[tree] for tree in trees}
        print(f"{name:30} {medians['other']:7.0f} {medians['this']:7.0f} {medians['this'] / medians['other']:6.2f}")
    print(f"{'all':30} {sums['other']:7.0f} {sums['this']:7.0f} {sums['this'] / sums['other']:6.2f}")


@contextmanager
def databases(trees: dict[str, Path]) -> Iterator[dict[str, str]]:
    """Yield the DSN of an empty database of the embedded server for each tree; they are dropped at the end."""
    with embedded() as server, psycopg.connect(server.admin_dsn, autocommit=True) as conn:
        names = {tree: f"conflictdb_tasks_{tree}_{os.getpid()}" for tree in trees}
        try:
            for name in names.values():
                conn.execute(sql.SQL("CREATE DATABASE {}").format(sql.Identifier(name)))
            yield {tree: make_conninfo(server.admin_dsn, dbname=name) for tree, name in names.items()}
        finally:
            for name in names.values():
                conn.execute(sql.SQL("DROP DATABASE IF EXISTS {} WITH (FORCE)").format(sql.Identifier(name)))


def client_seconds(tree: Path, dsn: str, *words: str) -> float:
    """Run Python in a tree; return its processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    env = {**os.environ, "CONFLICTDB_DSN": dsn, "CONFLICTDB_SCENE": "skagerrak"}
    done = subprocess.run([tree / ".venv/bin/python", *words], cwd=tree, env=env, capture_output=True, text=True)
    # 1: a command that finds conflicts may say so.
    if done.returncode not in (0, 1) or "Traceback" in done.stderr:
        raise SystemExit(f"{tree.name}: {' '.join(words)}: {done.stderr}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
