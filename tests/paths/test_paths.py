"""Every path gives the answer of `solve`, with every feature of plans, or refuses by a row of `path_limits`."""

import csv
import secrets
import sys
from collections.abc import Mapping
from pathlib import Path as Folder
from typing import Any, Final

import psycopg
import pytest
from case import Case, scene_of
from database_paths import StoredCase
from mixed_scenes import mixed_scene
from path_table import GROUPS_IN_DATABASE, IN_DATABASE, IN_MEMORY, NOT_APPLICABLE, PATHS, SEEDS, Path, Table, seeds_of
from scene_features import FEATURES, Feature

from conflictdb import connect
from conflictdb.model.path_limits import PATH_LIMITS

# Each cell has this many comparisons at least.
LEAST: Final = 1
# No path may refuse these features.
NEVER_REFUSED: Final = (
    *("schedules of areas", "schedules of tracks", "departures", "heights", "heights of legs", "climbs", "owners"),
    *("separation by class", "allowed pairs", "vertical separation by class", "separation", "vertical separation"),
    *("separation in time", "separation in time by class"),
)


def assert_whole(table: Table, paths: Mapping[str, Path]) -> None:
    assert not table.problems, "\n".join(table.problems[:20])
    assert not table.empty(paths)
    assert not table.unused(paths)


@pytest.mark.parametrize("name", IN_MEMORY)
def test_paths_in_memory(tmp_path: Folder, name: str) -> None:
    table, paths = Table(), {name: IN_MEMORY[name]}
    for seed in seeds_of(name):
        table.put(Case(scene_of(seed), tmp_path), paths, LEAST)
        if not table.empty(paths):
            break
    assert_whole(table, paths)


@pytest.mark.parametrize("group", GROUPS_IN_DATABASE)
def test_paths_in_a_database(conn: psycopg.Connection[Any], dsn: str, tmp_path: Folder, group: str) -> None:
    table, paths = Table(), {name: IN_DATABASE[name] for name in GROUPS_IN_DATABASE[group]}
    for seed in SEEDS:
        put_stored(table, seed, conn, dsn, tmp_path, paths, LEAST)
        if not table.empty(paths):
            break
    assert_whole(table, paths)


def put_stored(
    table: Table,
    seed: int,
    conn: psycopg.Connection[Any],
    dsn: str,
    folder: Folder,
    paths: Mapping[str, Path],
    least: int | None,
) -> None:
    """Put a scene to paths of a database, and remove it."""
    mixed = scene_of(seed)
    if least is not None and not any(table.wants(name, mixed.features, least) for name in paths):
        return
    with connect(conn) as db:
        case = StoredCase(mixed, folder, db=db, dsn=dsn)
        table.put(case, paths, least)
        case.remove()


def test_each_path_of_a_database_is_in_a_group() -> None:
    assert sorted(name for names in GROUPS_IN_DATABASE.values() for name in names) == sorted(IN_DATABASE)


def test_limits_are_few_and_of_known_cells() -> None:
    assert len(PATH_LIMITS) <= 25
    assert len({(limit.path, limit.feature) for limit in PATH_LIMITS}) == len(PATH_LIMITS)
    for limit in PATH_LIMITS:
        assert limit.path in PATHS, limit
        assert limit.feature in FEATURES, limit
        assert limit.feature not in NEVER_REFUSED, limit
        assert (limit.path, limit.feature) not in NOT_APPLICABLE
    assert all(path in PATHS and reason for (path, _), reason in NOT_APPLICABLE.items())


def test_recorded_counts_have_every_cell_and_no_failure() -> None:
    """Otherwise: ./run python tests/paths/table.py --write."""
    with Folder(__file__).with_name("table.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    cells = {(row["path"], row["feature"]): row for row in rows if row["feature"] in list(FEATURES)}
    assert cells.keys() == {(path, feature) for path in PATHS for feature in FEATURES}
    limits = {(limit.path, limit.feature) for limit in PATH_LIMITS}
    for (path, feature), row in cells.items():
        assert row["failures"] == "0"
        assert row["reason"] == NOT_APPLICABLE.get((path, Feature(feature)), "")
        assert int(row["comparisons"]) or row["reason"] or ((path, feature) in limits and int(row["refusals"]))


@pytest.mark.slow
@pytest.mark.parametrize("number", range(100))
def test_free_seeds(conn: psycopg.Connection[Any], dsn: str, tmp_path: Folder, number: int) -> None:
    """A seed that no other run has; it is printed, and each problem has the command that repeats it."""
    table, seed = Table(), len(FEATURES) * secrets.randbelow(2**26) + number
    sys.stdout.write(f"seed {seed}: {', '.join(sorted(mixed_scene(seed).features))}\n")
    table.put(Case(scene_of(seed), tmp_path), IN_MEMORY)
    put_stored(table, seed, conn, dsn, tmp_path, IN_DATABASE, None)
    assert not table.problems, "\n".join(table.problems)
