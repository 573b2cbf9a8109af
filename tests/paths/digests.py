"""Digests of the answers of all acceptance scenes, by column: a change of the code leaves them equal to the bit.

    ./run python tests/paths/digests.py              prints the scenes and columns that differ, and exits 1 if any does
    ./run python tests/paths/digests.py --solve      without a database
    ./run python tests/paths/digests.py strait       scenes whose names contain this
    ./run python tests/paths/digests.py --record     records them: in the commit that changes answers on purpose

A scene is answered by `solve` and by a stored detection. The columns are those of `model/record.py`, without numbers
and instants of a database's own; those of near pairs begin with `near.`. The last bits of numbers depend on the
processor and on libraries: elsewhere only columns without measures are compared (`MACHINE`).
"""

import argparse
import hashlib
import json
import platform
import sys
import uuid
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from datetime import datetime
from enum import Enum
from pathlib import Path
from typing import Any, Final

if __name__ == "__main__":
    _TESTS = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(_TESTS / "support"), str(_TESTS.parent), str(_TESTS.parent / "benchmarks")]

import numpy as np
import shapely
from conflict_scenes import published
from layouts import WORKLOADS
from made_scenes import Kind, box, sea
from mixed_scenes import mixed_scene, plain_scene
from scene_features import FEATURES
from scenes import known_scenes

import conflictdb
from conflictdb import formats, solve, store
from conflictdb.client.database import Database
from conflictdb.earth.registry import centred
from conflictdb.errors import IncompleteWarning
from conflictdb.model.plans import Area, EarthModel, Scene, Track
from conflictdb.model.record import APPROACH_COLUMNS, COLUMNS, Column, ColumnType
from conflictdb.model.results import Approach, Conflict, Verdict

RECORD: Final = Path(__file__).with_name("digests.json")
Scenes = Mapping[str, Callable[[], tuple[Scene, list[Area], list[Track]]]]
Digests = dict[str, str]
# What one database says of one run.
_OF_RUNS: Final = frozenset(
    {"run_id", "found_at", "conflict_id", "opened_at", "changed_at", "a_id", "a_version", "b_id", "b_version"}
)
# Columns without measures, which no rounding changes.
ANYWHERE: Final = frozenset(column.name for column in COLUMNS if column.type in (ColumnType.TEXT, ColumnType.NAME))
# Scenes that every run of the tests compares; the others are compared with `-m slow`.
FEW: Final = 13


def _machine() -> str:
    """Return what the last bits of numbers depend on: processor, libraries, and a digest of some functions."""
    x = np.linspace(-3.0, 3.0, 10_001)
    values = [
        np.sin(x),
        np.cos(x),
        np.tan(x),
        np.exp(x),
        np.arctan2(x, 1.0 - x),
        np.hypot(x, 1.3),
        np.log(np.abs(x) + 0.1),
    ]
    digest = hashlib.blake2b(b"".join(one.tobytes() for one in values), digest_size=6).hexdigest()
    libc = "-".join(platform.libc_ver())
    return f"{platform.machine()} {libc} numpy {np.__version__} GEOS {shapely.geos_version_string} {digest}"


MACHINE: Final = _machine()


def acceptance_scenes() -> Scenes:
    """Return the scenes by name: known answers, the shipped scene, workloads, mixed features, small benchmarks."""
    found: dict[str, Callable[[], tuple[Scene, list[Area], list[Track]]]] = {}
    for known in known_scenes():
        found[f"known {known.scene.name}"] = lambda known=known: (known.scene, known.areas, known.tracks)
    found["strait"] = _strait
    for k, workload in enumerate(WORKLOADS):
        for seed in (0, 1):
            earth = list(EarthModel)[(k + seed) % 2]
            found[f"workload {workload.name} {seed}"] = lambda w=workload, s=seed, e=earth: plain_scene(w, s, 10, 10, e)
    separated = WORKLOADS[0]
    found["workload separation"] = lambda: plain_scene(separated, 2, 8, 10, separation_m=926.0)
    found["workload tolerance 0"] = lambda: plain_scene(separated, 3, 8, 10, tolerance_m=0.0)
    for seed in range(2 * len(FEATURES)):
        found[f"mixed {seed}"] = lambda seed=seed: _mixed(seed)
    for kind in Kind:
        found[f"benchmark box {kind}"] = lambda kind=kind: box(kind, 60, 1)
    found["benchmark sea"] = lambda: _sea(300)
    for name, count in (("SUPER", 12), ("MATRIX", 4)):
        found[f"benchmark {name}"] = lambda name=name, count=count: _flights(name, count)
    return found


def _strait() -> tuple[Scene, list[Area], list[Track]]:
    (path,) = Path(conflictdb.__file__).parent.glob("scenes/strait.geojson")
    read = formats.read(path)
    assert read.scene is not None
    return read.scene, read.areas, read.tracks


def _mixed(seed: int) -> tuple[Scene, list[Area], list[Track]]:
    mixed = mixed_scene(seed)
    return mixed.scene, mixed.areas, mixed.tracks


def _sea(objects: int) -> tuple[Scene, list[Area], list[Track]]:
    (content,) = sea(objects, 1)
    return Scene("sea", nearest_m=1000.0), *content


def _flights(name: str, count: int) -> tuple[Scene, list[Area], list[Track]]:
    scene, tracks = published(name, count).objects()
    return scene, [], tracks


def answers(rows: Iterable[Conflict | Approach]) -> Digests:
    """Return a digest of each column of conflicts and of near pairs, and `rows`; columns without a value have none."""
    rows = sorted(rows, key=lambda one: (one.a_key, one.b_key))
    near = [one for one in rows if one.verdict is Verdict.NEAR]
    found = {"rows": f"{len(rows) - len(near)}+{len(near)}"}
    found |= _digests(COLUMNS, [one for one in rows if one.verdict is not Verdict.NEAR], "")
    return found | _digests(APPROACH_COLUMNS, near, "near.")


def _digests(columns: Sequence[Column], rows: Sequence[Conflict | Approach], prefix: str) -> Digests:
    found: Digests = {}
    for column in columns:
        if column.name in _OF_RUNS:
            continue
        values = [getattr(one, column.field) for one in rows]
        if any(value is not None for value in values):
            found[f"{prefix}{column.name}"] = _digest(values)
    return found


def _digest(value: Any) -> str:
    return hashlib.blake2b(_text(value).encode(), digest_size=5).hexdigest()


def _text(value: Any) -> str:
    """Return a text of a value to the last bit."""
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, Enum):
        return str(value)
    if isinstance(value, tuple | list):
        return f"[{','.join(map(_text, value))}]"
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}{value.tobytes().hex()}"
    if isinstance(value, shapely.Geometry):
        return str(shapely.to_wkb(value, hex=True))
    return repr(value)


def in_memory(scene: Scene, areas: list[Area], tracks: list[Track]) -> Digests:
    """Return the digests of the answer of `solve`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteWarning)
        return answers(solve(tracks, areas, scene))


def stored(db: Database, scene: Scene, areas: list[Area], tracks: list[Track]) -> Digests:
    """Return the digests of the answer of a stored detection, and remove the scene."""
    store.replace_scene(db.connection, centred(scene, areas, tracks), areas, tracks, merge=False)
    kept = db.scene(scene.name)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IncompleteWarning)
            kept.detect(jobs=1)
            near = [one for one in kept.approaches() if one.verdict is Verdict.NEAR]
            return answers([*kept.conflicts(), *near])
    finally:
        kept.delete()


def inputs(scene: Scene, areas: list[Area], tracks: list[Track]) -> str:
    """Return a digest of a scene and its objects."""
    return _digest([[getattr(one, each.name) for each in fields(one)] for one in (scene, *areas, *tracks)])


def recorded() -> dict[str, Any]:
    """Return the record: `machine`, and by scene `input`, `solve`, and columns of `stored` that are others."""
    return dict(json.loads(RECORD.read_text()))


def differences(names: Iterable[str], db: Database | None) -> Iterator[str]:
    """Yield each scene and column that differs from the record; None: without a stored detection."""
    record, scenes = recorded(), acceptance_scenes()
    everywhere = record["machine"] == MACHINE
    for name in names:
        content = scenes[name]()
        entry = record["scenes"].get(name)
        if entry is None or entry["input"] != inputs(*content):
            yield f"{name}: is another scene than the recorded one: record it"
            continue
        yield from _differing(f"{name}: solve", entry["solve"], in_memory(*content), everywhere)
        if db is not None:
            yield from _differing(f"{name}: stored", _whole(entry), stored(db, *content), everywhere)


def _whole(entry: Mapping[str, Any]) -> Digests:
    both = {**entry["solve"], **entry["stored"]}
    return {name: digest for name, digest in both.items() if digest is not None}


def _differing(who: str, before: Digests, after: Digests, everywhere: bool) -> Iterator[str]:
    for name in sorted(before.keys() | after.keys()):
        if before.get(name) != after.get(name) and (everywhere or name.removeprefix("near.") in {"rows", *ANYWHERE}):
            yield f"{who}: {name} ({before.get(name)} before, {after.get(name)} now)"


def record(names: Iterable[str], db: Database) -> None:
    """Record scenes; those that are gone leave the record, and others stay."""
    scenes = acceptance_scenes()
    known = recorded()["scenes"] if RECORD.exists() else {}
    for name in names:
        content = scenes[name]()
        mine, theirs = in_memory(*content), stored(db, *content)
        other = {column: theirs.get(column) for column in mine.keys() | theirs.keys()}
        other = {column: digest for column, digest in other.items() if mine.get(column) != digest}
        known[name] = {"input": inputs(*content), "solve": mine, "stored": dict(sorted(other.items()))}
    lines = ",\n".join(f"  {json.dumps(name)}: {json.dumps(known[name])}" for name in scenes if name in known)
    RECORD.write_text(f'{{"machine": {json.dumps(MACHINE)},\n"scenes": {{\n{lines}\n}}}}\n')


def few() -> list[str]:
    """Return the names of some scenes of each kind."""
    return list(acceptance_scenes())[::FEW]


def main() -> int:
    """Compare or record the scenes that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="parts of names of scenes; none: all")
    parser.add_argument("--solve", action="store_true", help="compare the answers of solve only")
    parser.add_argument("--record", action="store_true", help="record the digests instead of comparing them")
    options = parser.parse_args()
    names = [name for name in acceptance_scenes() if not options.names or any(part in name for part in options.names)]
    if options.solve and not options.record:
        return _report(names, None)
    from databases import begin, clean_up, test_server

    from conflictdb.client.database import connect
    from conflictdb.jobs import schema

    run = uuid.uuid4().hex[:8]
    begin(run)
    try:
        with test_server(run, "main") as server:
            dsn = server.clone(server.template(schema.upgrade), f"{server.prefix}_digests")
            with connect(dsn) as db:
                if not options.record:
                    return _report(names, db)
                record(names, db)
            server.drop(f"{server.prefix}_digests")
    finally:
        clean_up(run)
    return 0


def _report(names: Sequence[str], db: Database | None) -> int:
    found = list(differences(names, db))
    for line in found:
        sys.stdout.write(f"{line}\n")
    if recorded()["machine"] != MACHINE:
        sys.stdout.write("measures are not compared: the record is of another machine\n")
    sys.stdout.write(f"{len(names)} scenes: {'equal' if not found else f'{len(found)} columns differ'}\n")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
