"""Changes that leave the answers to questions as they are: there and back again, another order, other times for all."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from draws import draws
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene

from conflictdb import Area, Delays, Scene, Track, connect, delays, solve, speeds, store
from conflictdb.client.database import Database
from conflictdb.client.stored_scene import StoredScene

WORKLOAD = replace(LOW_LATITUDE, window=1.5, around_haven=(8.0, 20.0), around_area=(5.0, 15.0))
Content = tuple[Scene, list[Area], list[Track]]


def content(seed: int, **more: Any) -> Content:
    return plain_scene(WORKLOAD, seed, 4, 10, **more)


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with connect(dsn) as database:
        yield database


def stored(db: Database, given: Content) -> StoredScene:
    store.replace_scene(db.connection, given[0], given[1], given[2], merge=False)
    return db.scene(given[0].name)


def state(scene: StoredScene) -> tuple[list[str], list[Any]]:
    """Return all objects, and all conflicts without what tells one run from another."""
    _, areas, tracks = store.read_scene(scene.connection, scene.name)
    found = [(one.a_key, one.b_key, one.verdict, one.periods, one.first_contact) for one in scene.conflicts()]
    return sorted(repr(one) for one in (*areas, *tracks)), found


def later(one: Any, by_us: int) -> Any:
    """Return a plan at another time."""
    if isinstance(one, Track):
        return replace(one, times_us=np.asarray(one.times_us) + by_us)
    start, end = (None if at is None else at + by_us for at in (one.start_us, one.end_us))
    return replace(one, start_us=start, end_us=end)


def test_what_is_merged_and_merged_back_leaves_nothing(db: Database) -> None:
    """Moved, removed and new plans of one branch are taken back by another: objects and conflicts are as before."""
    scene = stored(db, content(3))
    scene.detect()
    before = state(scene)
    _, areas, tracks = store.read_scene(db.connection, scene.name)
    there = scene.branch("there")
    there.put([later(tracks[0], 600_000_000), later(areas[0], -600_000_000), replace(tracks[1], key="new")])
    there.delete_objects(tracks[2].key, areas[1].key)
    there.detect()
    there.merge()
    scene.detect()
    assert state(scene) != before
    back = scene.branch("back")
    back.put([tracks[0], areas[0], tracks[2], areas[1]])
    back.delete_objects("new")
    back.merge()
    scene.detect()
    assert state(scene) == before
    scene.detect(full=True)
    assert state(scene) == before


def test_proposal_merged_and_undone_leaves_nothing(db: Database) -> None:
    """A proposal that is applied and undone leaves objects and conflicts as they were."""
    scene = stored(db, content(3))
    scene.detect()
    before = state(scene)
    proposal = scene.resolve(within_s=6 * 3600.0)
    assert proposal.proposal_id is not None
    assert db.apply_proposal(proposal.proposal_id) > 0
    scene.detect()
    assert state(scene) != before
    db.undo_proposal(proposal.proposal_id)
    scene.detect()
    assert state(scene) == before


@draws("scenes", 3, 30)
def test_admission_in_any_order(db: Database, scenes: int) -> None:
    """What is refused meets something that was admitted before; what meets nobody is admitted in every order.

    Plans put in any order have the conflicts of `solve`.
    """
    for seed in range(scenes):
        setting, areas, tracks = content(seed)
        plans: list[Area | Track] = [*areas, *tracks]
        truth = {frozenset((one.a_key, one.b_key)) for one in solve(tracks, areas, setting)}
        alone = {one.key for one in plans} - set().union(*truth)
        rng = np.random.default_rng(seed)
        for _ in range(2):
            scene = stored(db, (replace(setting, name="admitted"), [], []))
            put: set[str] = set()
            for k in rng.permutation(len(plans)).tolist():
                key = plans[k].key
                expected = {other for other in put if frozenset((key, other)) in truth}
                said = scene.admit(plans[k])
                met = {one.a_key if one.a_key != key else one.b_key for one in said.conflicts}
                assert (bool(said), met) == (not expected, expected), (seed, key)
                put |= {key} if said else set()
            assert alone <= put
            scene.detect()
            assert not scene.conflicts()
            scene.delete()
        answers = []
        for _ in range(2):
            scene = stored(db, (replace(setting, name="put"), [], []))
            for k in rng.permutation(len(plans)).tolist():
                scene.put(plans[k])
                if rng.random() < 0.3:
                    scene.detect()
            scene.detect()
            answers.append(sorted(state(scene)[1], key=repr))
            scene.delete()
        assert answers[0] == answers[1]
        assert {frozenset(one[:2]) for one in answers[0]} == truth


@draws("scenes", 6, 100)
def test_a_delay_of_all_plans_changes_no_delay_and_no_speed(scenes: int) -> None:
    """All objects are moved by whole microseconds: free and forbidden departures and speeds stay, relative to plans."""
    for seed in range(scenes):
        setting, areas, tracks = content(seed, separation_m=(0.0, 500.0)[seed % 2])
        by_us = (1, 86_400_000_000, -3_600_000_001)[seed % 3]
        moved = [later(one, by_us) for one in tracks], [later(one, by_us) for one in areas]
        found, usual = delays(*moved, setting), delays(tracks, areas, setting)
        assert [one.departs_at for one in found] != [one.departs_at for one in usual]
        assert [replace(one, departs_at=None) for one in found] == [replace(one, departs_at=None) for one in usual], (
            seed
        )
        assert speeds(*moved, setting) == speeds(tracks, areas, setting), seed


@draws("scenes", 6, 100)
def test_delays_do_not_depend_on_others(scenes: int) -> None:
    """A track with one other plan at a time: together these forbid the departures that the whole scene forbids."""
    for seed in range(scenes):
        setting, areas, tracks = content(seed)
        [whole] = delays(tracks, areas, setting, key=tracks[0].key)
        alone = []
        for other in (*areas, *tracks[1:]):
            given = ([tracks[0], other], []) if isinstance(other, Track) else ([tracks[0]], [other])
            [found] = delays(*given, setting, key=tracks[0].key)
            alone += spans(found)
        assert joined(alone) == joined(spans(whole)), seed


def spans(found: Delays) -> list[tuple[float, float]]:
    """Return the delays that are in conflict."""
    return [(one.from_s, one.to_s) for one in found.forbidden]


def joined(given: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return intervals, those that overlap or touch as one."""
    found: list[tuple[float, float]] = []
    for low, high in sorted(given):
        if found and low <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], high)
        else:
            found.append((low, high))
    return found
