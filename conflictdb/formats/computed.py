"""Read conflicts that `conflictdb spark detect` computed, and the object states they were computed from.

A directory of Parquet files of the Arrow form FOUND, with a subdirectory STATES of the form COMPUTED.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.arrow.columns import numbers
from conflictdb.arrays.arrow.found import COMPUTED, FOUND, GEOMETRIES, kinds, to_conflicts
from conflictdb.arrays.polygons import Polygons
from conflictdb.errors import InvalidInput
from conflictdb.formats.arrow_values import check_wkb
from conflictdb.formats.parquet_process import decoded
from conflictdb.formats.scene_file import scene_of, settings_of
from conflictdb.model.plans import Scene

# Readers of the directory skip names that begin with an underscore.
STATES: Final = "_objects"
# Limit in Arrow format; conflicts are written in chunks, not kept in memory.
MAX_COMPUTED_MB: Final = 16_000.0


@dataclass(frozen=True, slots=True)
class Computed:
    """The input of computed conflicts: settings, and the states of n objects.

    pairs : number of conflicts
    kind : (n,) int8
    object_id, version, digest : (n,) int64
    key : (n,) object, texts
    """

    settings: Scene
    pairs: int
    kind: NDArray[np.int8]
    object_id: NDArray[np.int64]
    version: NDArray[np.int64]
    digest: NDArray[np.int64]
    key: NDArray[np.object_]


def settings_text(scene: Scene) -> str:
    """Return settings as the files of computed conflicts store them."""
    settings = settings_of(scene)
    del settings["name"]
    return json.dumps(settings)


def read_computed(path: Path) -> Computed:
    """Return settings and object states of the conflicts in a directory; raises InvalidInput if they are missing."""
    states = path / STATES
    if not path.exists():
        raise InvalidInput("file", "", "does not exist", str(path))
    if not states.is_dir():
        rule = (
            f"does not say which objects it was computed from (no directory {STATES} in it): give the directory that "
            "`conflictdb spark detect` wrote, of objects that `conflictdb export` did"
        )
        raise InvalidInput("file", "", rule, str(path))
    settings: set[str] = set()
    counts: set[int] = set()
    parts: list[Mapping[str, Any]] = []
    try:
        with decoded(states, MAX_COMPUTED_MB) as rows:
            for batch in rows.batches:
                columns = COMPUTED.columns(batch)
                settings |= set(columns["settings"].unique().to_pylist())
                counts |= set(columns["pairs"].unique().to_pylist())
                part = {name: numbers(columns[name]) for name in ("object_id", "version", "digest")}
                key = np.array([*columns["id"].to_pylist(), None], dtype=object)[:-1]
                parts.append({**part, "kind": kinds(columns["kind"]), "key": key})
        if len(settings) != 1 or len(counts) != 1:
            raise InvalidInput("file", "settings", "must be those of one scene")
        return Computed(
            settings=scene_of(json.loads(settings.pop()), "computed"),
            pairs=counts.pop(),
            **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]},
        )
    except InvalidInput as refused:
        raise refused.at(str(states)) from refused.__cause__
    except (ValueError, RecursionError) as error:
        raise InvalidInput("file", "settings", "must be JSON", str(states)) from error


def read_conflicts(path: Path, pairs: int) -> Iterator[tuple[Conflicts, Polygons]]:
    """Yield conflicts of numbered objects with their regions, in batches; raises InvalidInput.

    pairs : the expected number
    """
    count = 0
    try:
        with decoded(path, MAX_COMPUTED_MB) as rows:
            for batch in rows.batches:
                columns = FOUND.columns(batch, count)
                for name in GEOMETRIES:
                    check_wkb(name, columns[name], count)
                count += batch.num_rows
                yield to_conflicts(batch)
        if count != pairs:
            rule = f"holds {count:,} pairs of the {pairs:,} that were found: are all of its files there, and no others?"
            raise InvalidInput("file", "conflicts", rule)
    except InvalidInput as refused:
        raise refused.at(str(path)) from refused.__cause__
