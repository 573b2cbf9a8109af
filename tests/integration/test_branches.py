"""Branches: scenes that store their edits only, and answer as full copies do."""

import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
from psycopg import sql
from workloads import ARCTIC, LOW_LATITUDE, Workload, throw

from conflictdb import Area, InvalidInput, Motion, Rule, Track, connect
from conflictdb.db import store
from conflictdb.session.database import Database
from conflictdb.session.stored_scene import StoredScene

WORKLOAD = replace(LOW_LATITUDE, window=1.5, around_haven=(8.0, 20.0), around_area=(5.0, 15.0))


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with connect(dsn) as database:
        yield database


def stored(db: Database, seed: int, areas: int, tracks: int, workload: Workload = WORKLOAD) -> StoredScene:
    settings, *objects = throw(workload, seed, areas, tracks)
    store.replace_scene(db.connection, settings, *objects, merge=False)
    scene = db.scene(settings.name)
    scene.detect()
    return scene


@pytest.fixture
def scene(db: Database) -> StoredScene:
    """A detected scene with conflicts."""
    return stored(db, 3, 4, 14)


def found(scene: StoredScene) -> dict[tuple[str, str], Any]:
    """Conflicts by keys, without what tells one database row from another."""
    return {
        tuple(sorted((one.a_key, one.b_key))): (one.verdict, one.periods, one.closest_m, one.first_contact)
        for one in scene.conflicts()
    }


def objects_of(scene: StoredScene) -> dict[str, str]:
    _, areas, tracks = store.read_scene(scene.connection, scene.name)
    return {one.key: repr(one) for one in (*areas, *tracks)}


def assert_same(branch: StoredScene, copy: StoredScene) -> None:
    assert objects_of(branch) == objects_of(copy)
    assert branch.objects() == copy.objects()
    assert found(branch) == found(copy)
    assert {(one.a_key, one.b_key): one.closest_m for one in branch.approaches()} == {
        (one.a_key, one.b_key): one.closest_m for one in copy.approaches()
    }


def edit(target: StoredScene, others: list[StoredScene], rng: np.random.Generator, pool: list[Area | Track]) -> None:
    """Put, change, turn into another kind or remove a random object, in the scene and in others alike."""
    keys = [one.key for one in target.objects()]
    chosen = str(rng.choice(keys)) if keys else "none"
    way = rng.integers(5)
    new = pool[int(rng.integers(len(pool)))]
    for one in [target, *others]:
        if way == 0 and len(keys) > 4:
            one.delete_objects(chosen)
        elif way == 1:
            one.put(replace(new, key=f"NEW {new.key}"))
        else:
            one.put(replace(new, key=chosen))


@pytest.mark.parametrize("workload", [WORKLOAD, ARCTIC], ids=["rhumb", "great_circle"])
def test_edited_branch_equals_copy(db: Database, workload: Workload) -> None:
    """After random edits, of the branch and of its parent, a branch answers as a full copy; so does what is merged."""
    rng = np.random.default_rng(7)
    scene = stored(db, 3, 5, 16, workload)
    _, more_areas, more_tracks = throw(workload, 4, 6, 14)
    pool = [*more_areas, *more_tracks]
    branch, copy, edited = scene.branch("branch"), scene.copy("copy"), set[str]()
    copy.detect()
    assert_same(branch, copy)
    for step in range(30):
        if step % 4 == 3:
            # The parent changes: a copy would not follow, so it is edited alike, where the branch is not.
            key = str(rng.choice([one.key for one in scene.objects()]))
            new = replace(pool[int(rng.integers(len(pool)))], key=key)
            scene.put(new)
            if key not in edited:
                copy.put(new)
        else:
            before = objects_of(branch)
            edit(branch, [copy], rng, pool)
            after = objects_of(branch)
            edited |= {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)}
        if step % 3 == 0:
            run, of_copy = branch.detect(full=step % 2 == 0), copy.detect()
            assert (run.conflicts, run.unresolved) == (of_copy.conflicts, of_copy.unresolved)
            assert_same(branch, copy)
    branch.detect(), copy.detect()
    assert_same(branch, copy)
    diff = branch.diff()
    before, after = objects_of(scene), objects_of(branch)
    assert {one.key for one in diff.objects} == {
        key for key in before.keys() | after.keys() if before.get(key) != after.get(key)
    }
    was, now = found(scene), found(branch)
    assert {tuple(sorted((one.a_key, one.b_key))) for one in diff.conflicts if one.change == "gone"} == (
        was.keys() - now.keys()
    )
    assert {tuple(sorted((one.a_key, one.b_key))) for one in diff.conflicts if one.change == "new"} == (
        now.keys() - was.keys()
    )
