"""The table of paths: each way of asking with each feature of plans, compared with `solve`.

A cell counts the scenes with a feature that a path was compared in, the comparisons, those that differ, and the scenes
that it refused by a row of `conflictdb.model.path_limits`. A cell without any is empty, unless NOT_APPLICABLE gives a
reason.
"""

import time
import traceback
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import psycopg
from case import Case, Finding, NotApplicable
from database_paths import DATABASE_PATHS
from file_paths import FILE_PATHS
from memory_paths import MEMORY_PATHS
from page_paths import PAGE_PATHS
from scene_features import FEATURES, Feature

from conflictdb import ConflictDBError
from conflictdb.model.path_limits import PATH_LIMITS, PathLimit

Path = Callable[[Any], Finding]

IN_MEMORY: Final[Mapping[str, Path]] = {
    **MEMORY_PATHS,
    **PAGE_PATHS,
    **{name: FILE_PATHS[name] for name in ("scene file", "GeoParquet")},
}
IN_DATABASE: Final[Mapping[str, Path]] = {
    name: path for name, path in {**DATABASE_PATHS, **FILE_PATHS}.items() if name not in IN_MEMORY
}
PATHS: Final[Mapping[str, Path]] = {**IN_MEMORY, **IN_DATABASE}
# Paths that use one stored scene are tested together.
GROUPS_IN_DATABASE: Final[Mapping[str, tuple[str, ...]]] = {
    "probes": ("detect, full", "probe", "probe, several plans", "probe by a worker", "request_probe", "explain"),
    "changes": ("detect, few changes", "detect, two transactions", "detect, stepwise"),
    "admissions": ("put_area, put_track", "attached tables", "probe, undetected objects", "admit", "admit in SQL"),
    "delays": ("delays of a stored scene", "delays of a stored area", "request_delays", "speeds of a stored scene"),
    "proposals": ("branch, edit, merge", "stored delays", "resolve a stored scene"),
    "files": tuple(name for name in IN_DATABASE if name in FILE_PATHS),
}

# A path is put to the scenes of these seeds until each cell has a comparison. The first seven scenes together have
# every feature, with few areas and waypoints; others follow where a path has nothing to compare in one of them.
_FIRST: Final = (3, 9, 36, 49, 62, 91, 97)
SEEDS: Final = (*_FIRST, *(seed for seed in range(4 * len(FEATURES)) if seed not in _FIRST))
# Seeds of slow paths, whose scenes have what the path needs, such as ways, and take least time: together every feature.
SEEDS_OF: Final[Mapping[str, tuple[int, ...]]] = {
    "delays": (1, 3, 5, 7, 8, 14, 21, 22, 25, 29, 36, 40),
    "delays of an area": (1, 3, 5, 25, 27, 36, 37, 38, 40, 50, 60),
    "detours": (7, 25, 36, 39, 47, 51, 85, 89, 94),
    "resolve with ways": (8, 14, 19, 25, 28, 29, 30, 36, 38, 40, 41, 44, 46),
}


def seeds_of(path: str) -> Sequence[int]:
    """Return the seeds of the scenes that a path is put to."""
    return SEEDS_OF.get(path, SEEDS)


# Why a path has nothing to compare with a feature.
NOT_APPLICABLE: Final[Mapping[tuple[str, Feature], str]] = {
    ("F3548", Feature.UNBOUNDED): "an operational intent has a start and an end",
}


@dataclass
class Cell:
    """The counts of a path and a feature."""

    scenes: int = 0
    comparisons: int = 0
    failures: int = 0
    refusals: int = 0


@dataclass
class Table:
    """Counts of all cells, problems with the command that repeats them, and processor time by path, seconds."""

    cells: dict[tuple[str, Feature], Cell] = field(default_factory=dict)
    totals: dict[str, Cell] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    used: set[PathLimit] = field(default_factory=set)
    took_s: dict[str, float] = field(default_factory=dict)

    def cell(self, path: str, feature: Feature) -> Cell:
        return self.cells.setdefault((path, feature), Cell())

    def total(self, path: str) -> Cell:
        """Return the counts of a path in all scenes."""
        return self.totals.setdefault(path, Cell())

    def wants(self, path: str, features: Collection[Feature], least: int) -> bool:
        """Return whether a scene with some features adds to a cell with fewer comparisons than `least`."""
        limited = {limit.feature for limit in PATH_LIMITS if limit.path == path}
        if limited & set(features):
            return any(self.cell(path, feature).refusals < least and feature in limited for feature in features)
        return any(self.cell(path, feature).comparisons < least for feature in features)

    def put(self, case: Case, paths: Mapping[str, Path], least: int | None = None) -> None:
        """Put a scene to paths; with `least`, only to those that need it."""
        for name, path in paths.items():
            if least is None or self.wants(name, case.mixed.features, least):
                began_s = time.process_time()
                self._put(case, name, path)
                self.took_s[name] = self.took_s.get(name, 0.0) + time.process_time() - began_s

    def _put(self, case: Case, name: str, path: Path) -> None:
        features = case.mixed.features
        again = f"seed {case.mixed.seed}, {name!r}: ./run python tests/paths/table.py --seeds {case.mixed.seed} "
        again += f"--paths {name!r} ({', '.join(sorted(features))})"
        try:
            finding = path(case)
        except NotApplicable:
            return
        except (ConflictDBError, psycopg.Error) as error:
            limits = [limit for limit in PATH_LIMITS if limit.path == name and limit.feature in features]
            fitting = [limit for limit in limits if limit.sentence in str(error)]
            if not fitting:
                self._fail(name, features, f"{again}\n  refuses: {error}")
            else:
                self.total(name).refusals += 1
            for limit in fitting:
                self.used.add(limit)
                self.cell(name, Feature(limit.feature)).refusals += 1
            return
        except Exception:  # the other paths are compared, too
            self._fail(name, features, f"{again}\n  {traceback.format_exc()}")
            return
        for cell in (self.total(name), *(self.cell(name, feature) for feature in features)):
            cell.scenes += 1
            cell.comparisons += finding.compared
            cell.failures += len(finding.problems)
        self.problems += [f"{again}\n  {problem}" for problem in finding.problems]

    def _fail(self, name: str, features: Iterable[Feature], problem: str) -> None:
        self.problems.append(problem)
        for cell in (self.total(name), *(self.cell(name, feature) for feature in features)):
            cell.failures += 1

    def empty(self, paths: Iterable[str]) -> list[str]:
        """Return the cells without a comparison, a refusal or a reason, and reasons of cells with comparisons."""
        limits = {(limit.path, limit.feature) for limit in PATH_LIMITS}
        found = []
        for path in paths:
            for feature in FEATURES:
                cell = self.cell(path, feature)
                is_compared, has_reason = cell.comparisons > 0, (path, feature) in NOT_APPLICABLE
                if is_compared and has_reason:
                    found.append(f"{path}, {feature}: is said to be not applicable, but was compared")
                if not is_compared and not has_reason and not ((path, feature) in limits and cell.refusals):
                    found.append(f"{path}, {feature}: is empty")
        return found

    def unused(self, paths: Collection[str]) -> list[PathLimit]:
        """Return rows of path limits by which nothing was refused."""
        return [limit for limit in PATH_LIMITS if limit.path in paths and limit not in self.used]
