"""Throws hostile objects at scenes, through SQL and through files, and asks whether anything stops a scene.

    python tests/acceptance/fuzz_objects.py --objects 10000 --seed 7 [--keep DIRECTORY]
    python tests/acceptance/fuzz_objects.py --replay DIRECTORY/7-12.pickle

Every scene gets some random objects (`support/hostile_objects.py`), each put by SQL or loaded from a file, which may
refuse it. Then it gets a witness, an area that all of them meet, and a pair with a known conflict. Then it is detected.
Errors are: a detection that fails; a file refused with another error than InvalidInput; an accepted object without a
row with the witness (a silent miss); a known pair with another conflict than without the random objects; a list, an
export or a query function that fails. Each error is printed with the objects that reproduce it; exits 1 if there is
any.
"""

import argparse
import os
import pickle
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

if __name__ == "__main__":
    sys.path[:0] = [str(Path(__file__).resolve().parents[1] / "support"), str(Path(__file__).resolve().parents[2])]

import numpy as np
import psycopg
from hostile_objects import Hostile, put, scene_file, throw

import conflictdb
from conflictdb.errors import InvalidInput
from conflictdb.model.methods import Method
from conflictdb.model.plans import Motion, Scene
from conflictdb.model.results import Conflict, Verdict
from conflictdb.store import set_scene

PER_SCENE: Final = 24
TOLERANCES_M: Final = (0.0, 1e-9, 1.0, 1.0, 1.0, 1000.0)
SEPARATIONS_M: Final = (0.0, 0.0, 0.0, 1.0, 5000.0)
METHODS: Final = (*[Method.EXACT] * 7, Method.NLP, Method.SCREEN)
CENTRES: Final = ((0.0, 0.0), (5.0, 25.0), (-179.0, -20.0), (0.0, 90.0), (10.0, 60.0))
WITNESS, AREA, TRACK = "witness", "canary area", "canary track"
WITNESS_DEG: Final = 59.9  # from the centre of a scene of great circles
NEAR_DEG: Final = 59.0
T0_S: Final = 1.7e9
LONGEST_S: Final = 300.0  # for a scene, on a machine that has much else to do


@dataclass
class Tally:
    """Results of a run.

    outcomes : of objects: accepted or refused, by SQL or file; refusals of SQL by their SQLSTATE
    verdicts : of pairs with the witness
    wrong : errors, each with a command to reproduce it
    """

    keep: Path
    name: str
    objects: int = 0
    scenes: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    verdicts: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    slowest_s: float = 0.0
    tells: bool = False

    def note(self, what: str, scene: Scene, things: Sequence[Hostile], by_file: Sequence[bool]) -> None:
        path = self.keep / f"{self.name}-{self.scenes}-{len(self.wrong)}.pickle"
        path.write_bytes(pickle.dumps((scene, list(things), list(by_file))))
        self.wrong.append(f"{what}\n    python tests/acceptance/fuzz_objects.py --replay {path}")
        if self.tells:
            sys.stdout.write(self.wrong[-1] + "\n")
            sys.stdout.flush()


def fuzz(dsn: str, seed: int, objects: int, keep: Path, *, tells: bool = False) -> Tally:
    """Throw `objects` objects."""
    rng = np.random.default_rng(seed)
    tally = Tally(keep, str(seed), tells=tells)
    while tally.objects < objects:
        scene = random_scene(rng, f"fuzz {tally.scenes}")
        things = [throw(rng, str(k)) for k in range(min(PER_SCENE, objects - tally.objects))]
        examine(dsn, tally, scene, things, (rng.random(len(things)) < 0.4).tolist())
        tally.objects += len(things)
        tally.scenes += 1
        if tells and tally.scenes % 20 == 0:
            sys.stdout.write(f"{tally.objects} objects, slowest scene {tally.slowest_s:.1f} s\n")
            sys.stdout.flush()
    return tally


def random_scene(rng: np.random.Generator, name: str) -> Scene:
    circles = rng.random() < 0.4
    return Scene(
        name,
        motion=Motion.GREAT_CIRCLE if circles else Motion.RHUMB,
        method=METHODS[rng.integers(len(METHODS))],
        tolerance_m=TOLERANCES_M[rng.integers(len(TOLERANCES_M))],
        separation_m=SEPARATIONS_M[rng.integers(len(SEPARATIONS_M))],
        nearest_m=float(rng.choice([0.0, 0.0, 1e4])),
        centre=CENTRES[rng.integers(len(CENTRES))] if circles else None,
    )


def examine(dsn: str, tally: Tally, scene: Scene, things: Sequence[Hostile], by_file: Sequence[bool]) -> None:
    """Put some objects in a scene, detect it, and record errors."""
    began = time.monotonic()
    with conflictdb.connect(dsn) as db:
        set_scene(db.connection, scene)
        witness, area, track = companions(scene)
        for thing in (area, track, *([witness] if witness else [])):
            refused = put_by_sql(db, scene.name, thing)
            assert refused is None, refused
        accepted = []
        for thing, is_file in zip(things, by_file, strict=True):
            refused = (put_by_file if is_file else put_by_sql)(db, scene.name, thing)
            way = "file" if is_file else "SQL"
            tally.outcomes[f"{way}: {refused or 'accepted'}"] += 1
            if refused is None:
                accepted.append(thing)
            elif refused.startswith("wrong"):
                tally.note(f"{thing.key}: {refused}", scene, [thing], [is_file])
        wrong = list(faults(db, tally, scene, accepted, witness))
        tally.slowest_s = max(tally.slowest_s, time.monotonic() - began)
        try:
            db.connection.rollback()
            db.connection.execute("DELETE FROM conflictdb.scene WHERE name = %s", [scene.name])
            db.connection.commit()
        except psycopg.Error as error:
            wrong.append(f"cannot be removed: {error}")
    if time.monotonic() - began > LONGEST_S:
        wrong.append(f"took {time.monotonic() - began:.0f} s")
    for what in wrong:
        tally.note(what, scene, things, by_file)


def faults(
    db: conflictdb.Database, tally: Tally, scene: Scene, accepted: Sequence[Hostile], witness: Hostile | None
) -> Iterator[str]:
    """Yield errors of a scene whose objects were accepted."""
    try:
        db.scene(scene.name).detect()
    except Exception as error:  # whatever it is, it stops the scene
        yield f"detection failed: {type(error).__name__}: {error}"
        return
    try:
        found = db.scene(scene.name).conflicts(with_region=True)
        db.scene(scene.name).approaches()
        db.scene(scene.name).text()
        for routine in ("candidates(%s)", "conflicts_of(%s, 'canary area')", "conflicts_at(%s, to_timestamp(1.7e9))"):
            db.connection.execute(f"SELECT count(*) FROM conflictdb.{routine}".encode(), [scene.name]).fetchall()
        db.connection.commit()
    except Exception as error:
        yield f"a list failed: {type(error).__name__}: {error}"
        db.connection.rollback()
        return
    known = {frozenset((c.a_key, c.b_key)): c for c in found}
    canary = known.get(frozenset((AREA, TRACK)))
    if canary is None or not is_right(scene, canary):
        yield f"the known conflict is {canary}"
    for thing in accepted if witness else ():
        if not is_surely_met(scene, thing):
            continue
        pair = known.get(frozenset((WITNESS, thing.key)))
        tally.verdicts[pair.verdict if pair else "none"] += 1
        if pair is None:
            yield f"{thing.key}: accepted, but there is no row with the witness"


def is_right(scene: Scene, canary: Conflict) -> bool:
    """Whether the known pair has its usual conflict: the track is within the area from the start to the end."""
    assert canary.first_contact is not None
    assert canary.last_contact is not None
    span = canary.first_contact.timestamp(), canary.last_contact.timestamp()
    is_certain = scene.method in (Method.EXACT, Method.NLP)
    return (
        abs(span[0] - T0_S) < 1e-3
        and abs(span[1] - T0_S - 3600) < 1e-3
        and (canary.verdict == Verdict.CONFLICT or not is_certain or scene.tolerance_m > 100.0)
    )


def put_by_sql(db: conflictdb.Database, scene: str, thing: Hostile) -> str | None:
    """Put an object by SQL; return how it was refused, None if it was not."""
    try:
        with db.connection.transaction():
            db.connection.execute(*put(scene, thing))
    except psycopg.Error as error:
        return f"refused, {error.sqlstate}{'' if (error.sqlstate or '').startswith('ZC') else f' {str(error)[:60]}'}"
    return None


def put_by_file(db: conflictdb.Database, scene: str, thing: Hostile) -> str | None:
    """Load a file with one object; return how it was refused, None if it was not."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory, "one.geojson")
        path.write_text(scene_file([thing]))
        try:
            db.load_files([path], scene)
        except InvalidInput:
            return "refused"
        except Exception as error:
            return f"wrong, {type(error).__name__}: {error}"
    return None


def companions(scene: Scene) -> tuple[Hostile | None, Hostile, Hostile]:
    """An area that all objects meet (None where it would go round a pole), and an area and a track that meet."""
    lon, lat = scene.centre or (0.0, 0.0)
    if scene.centre is None:
        rings: Any = [[(-180.0, -89.0), (180.0, -89.0), (180.0, 89.0), (-180.0, 89.0), (-180.0, -89.0)]]
    else:
        rings = [circle(lon, lat, WITNESS_DEG)]
    witness = Hostile(WITNESS, "witness", polygons=((rings[0],),)) if abs(lat) < 30.0 else None
    near = lon + 1.0, min(lat, 80.0) - 1.0
    square = [(near[0] - 0.5, near[1] - 0.5), (near[0] + 0.5, near[1] - 0.5), (near[0] + 0.5, near[1] + 0.5)]
    square += [(near[0] - 0.5, near[1] + 0.5), square[0]]
    area = Hostile(AREA, "canary", polygons=((square,),), floor_m=1e5, ceiling_m=2e5)
    path = ((near[0] - 0.1, near[1], T0_S), (near[0] + 0.1, near[1], T0_S + 3600.0))
    outline = ((100.0, 100.0), (100.0, -100.0), (-100.0, -100.0), (-100.0, 100.0))
    return witness, area, Hostile(TRACK, "canary", path=path, outline=outline, floor_m=1e5, ceiling_m=2e5)


def circle(lon: float, lat: float, radius_deg: float) -> list[tuple[float, float]]:
    """A ring around a place on the sphere, closed; degrees."""
    bearing, r, phi = np.radians(np.arange(0.0, 360.0, 5.0)), np.radians(radius_deg), np.radians(lat)
    sine = np.clip(np.sin(phi) * np.cos(r) + np.cos(phi) * np.sin(r) * np.cos(bearing), -1, 1)
    east = np.arctan2(np.sin(bearing) * np.sin(r) * np.cos(phi), np.cos(r) - np.sin(phi) * sine)
    ring = list(zip((lon + np.degrees(east)).tolist(), np.degrees(np.arcsin(sine)).tolist(), strict=True))
    return [*ring, ring[0]]


def is_surely_met(scene: Scene, thing: Hostile) -> bool:
    """Whether an object that was accepted meets the witness without doubt."""
    if scene.centre is None:
        return True
    lon, lat = np.radians(scene.centre)
    x, y = np.radians(thing.path[0][:2] if thing.is_track else thing.polygons[0][0][0])
    away = np.arccos(np.clip(np.sin(lat) * np.sin(y) + np.cos(lat) * np.cos(y) * np.cos(x - lon), -1.0, 1.0))
    return bool(away < np.radians(NEAR_DEG))


@contextmanager
def database() -> Iterator[str]:
    """A database with the schema on an embedded server, for the time of a run."""
    from databases import begin, clean_up, test_server

    from conflictdb.jobs import schema

    run = f"fuzz{os.getpid()}"
    begin(run)
    try:
        with test_server(run, "main") as server:
            dsn = server.clone(server.template(schema.upgrade), f"{server.prefix}_fuzz")
            yield dsn
    finally:
        clean_up(run)


def main() -> int:
    """Throw objects, or throw some again, as the command line asks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=Path, help="directory for what is wrong (default: a new one)")
    parser.add_argument("--replay", type=Path, help="throw these objects, of your own, and nothing else")
    options = parser.parse_args()
    keep = options.keep or Path(tempfile.mkdtemp(prefix="fuzz-"))
    keep.mkdir(parents=True, exist_ok=True)
    with database() as dsn:
        if options.replay:
            tally = Tally(keep, "replay", tells=True)
            examine(dsn, tally, *pickle.loads(options.replay.read_bytes()))  # noqa: S301
        else:
            tally = fuzz(dsn, options.seed, options.objects, keep, tells=True)
    for title, counts in (("objects", tally.outcomes), ("with the witness", tally.verdicts)):
        for what, count in sorted(counts.items()):
            sys.stdout.write(f"{title}: {count:6} {what}\n")
    sys.stdout.write(
        f"{tally.objects} objects in {tally.scenes} scenes, the slowest took {tally.slowest_s:.1f} s; "
        f"{len(tally.wrong)} wrong\n"
    )
    return int(bool(tally.wrong))


if __name__ == "__main__":
    sys.exit(main())
