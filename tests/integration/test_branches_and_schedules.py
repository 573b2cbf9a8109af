"""Objects with a schedule are put, edited, removed and merged in branches, whose answers are those of `solve`."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

import conflictdb
from conflictdb import store
from conflictdb.client.database import Database
from conflictdb.client.stored_scene import StoredScene
from conflictdb.model.plans import Area, Scene, Track

HOUR_US = 3_600_000_000
DAY_US = 24 * HOUR_US
NOW_US = int(np.datetime64("now", "us").astype(int))
NOON_US = NOW_US // DAY_US * DAY_US + 12 * HOUR_US
SHIP = conflictdb.rectangle_outline_m(50.0, 50.0, 50.0, 50.0)
SETTINGS = Scene("s", horizon_days=5.0)
AT_NOON = {"periods": [["11:00", "13:00"]]}
AT_NIGHT = {"periods": [["23:00", "01:00"]]}
DAILY = {"rrule": f"DTSTART:{np.datetime64(NOON_US, 'us').item():%Y%m%dT%H%M%SZ}\nRRULE:FREQ=DAILY", "duration": "PT1H"}


def area(key: str, schedule: Any = None, west: float = 4.0, **more: Any) -> Area:
    return Area(key, shapely.box(west, 57.0, west + 0.2, 57.1), schedule=schedule, **more)


def voyage(key: str, start_us: int = NOON_US, schedule: Any = None, west: float = 3.9, **more: Any) -> Track:
    times = [start_us, start_us + HOUR_US]
    return Track(key, [(west, 57.05), (west + 0.4, 57.05)], times, SHIP, schedule=schedule, **more)


LATER = voyage("later", NOON_US + 40 * DAY_US)
MUCH_LATER = voyage("much later", NOON_US + 90 * DAY_US)


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with conflictdb.connect(dsn) as db:
        yield db


def stored(db: Database, objects: list[Area | Track]) -> StoredScene:
    scene = db.scene("s")
    scene.put(objects, SETTINGS)
    scene.detect()
    return scene


def said(found: Any) -> dict[tuple[str, str], Any]:
    return {(one.a_key, one.b_key): (str(one.verdict), one.periods) for one in found}


def solved(*objects: Area | Track) -> dict[tuple[str, str], Any]:
    areas = [one for one in objects if isinstance(one, Area)]
    return said(conflictdb.solve([one for one in objects if isinstance(one, Track)], areas, SETTINGS))


@pytest.mark.parametrize(("has_schedules", "full"), [(False, True), (True, False)])
def test_a_branch_answers_as_solve_does(db: Database, has_schedules: bool, full: bool) -> None:
    """Schedules are put, edited and removed in a branch of a scene with or without schedules, which is then merged."""
    daily = area("daily", AT_NOON if has_schedules else None, west=5.0)
    kept, ferry = voyage("kept"), voyage("ferry", west=4.9)
    scene = stored(db, [area("A"), daily, kept, ferry])
    branch = scene.branch("branch")
    now: dict[str, Area | Track] = {one.key: one for one in (area("A"), daily, kept, ferry)}
    edits: list[list[Area | Track | str]] = [
        [area("A", AT_NIGHT)],
        [area("A", AT_NOON), voyage("shuttle", schedule=DAILY, west=4.95)],
        [LATER],
        [replace(daily, schedule=AT_NIGHT)],
        ["shuttle", area("new", AT_NOON)],
        ["daily", "later"],
        [voyage("ferry", schedule=DAILY, west=4.9), replace(daily, schedule=AT_NOON)],
    ]
    seen = set()
    for edit in edits:
        for one in edit:
            if isinstance(one, str):
                branch.delete_objects(one)
                del now[one]
            else:
                branch.put(one)
                now[one.key] = one
        branch.detect(full=full)
        wanted = solved(*now.values())
        # Periods of two schedules end where they are expanded: no sooner than in `solve`.
        found = said(branch.conflicts())
        assert found.keys() == wanted.keys()
        for pair, (verdict, periods) in wanted.items():
            assert found[pair][0] == verdict
            assert found[pair][1][: len(periods)] == periods
        seen |= wanted.keys()
        assert branch.state().is_current
    assert {("A", "kept"), ("A", "later"), ("daily", "shuttle"), ("daily", "ferry"), ("new", "kept")} <= seen
    assert {(one.change, one.key) for one in branch.diff().objects} == {
        ("changed", "A"), ("added", "new"), ("changed", "ferry"),
        *([] if has_schedules else [("changed", "daily")]),
    }  # fmt: skip
    of_branch = said(branch.conflicts())
    branch.merge()
    scene.detect(full=full)
    assert said(scene.conflicts()).keys() == of_branch.keys()
    _, areas, tracks = store.read_scene(db.connection, "s")
    assert {one.key: one.schedule for one in [*areas, *tracks]} == {key: one.schedule for key, one in now.items()}


def test_later_voyages_of_the_parent_meet_schedules_of_the_branch(db: Database) -> None:
    """The parent has no schedule, so only its branch expands, as far as the parent's voyages reach."""
    scene = stored(db, [voyage("soon")])
    branch = scene.branch("branch")
    branch.put(area("A", AT_NOON))
    branch.detect()
    assert said(branch.conflicts()) == solved(area("A", AT_NOON), voyage("soon"))
    for one in (LATER, MUCH_LATER):
        scene.put(one)
        if one is MUCH_LATER:
            scene.detect()
        branch.detect()
        assert ("A", one.key) in said(branch.conflicts())
    assert said(branch.conflicts()) == solved(area("A", AT_NOON), voyage("soon"), LATER, MUCH_LATER)
    assert scene.state().is_current
    assert scene.detect().conflicts == len(solved(voyage("soon"), LATER, MUCH_LATER))


def test_a_branch_expands_as_far_as_its_parent(db: Database) -> None:
    """Two schedules meet wherever both scenes expand them; a window of the parent that grows is followed."""
    at_noon, ferry = area("A", AT_NOON), voyage("ferry", schedule=DAILY)
    scene = stored(db, [area("parents", AT_NIGHT, west=20.0), ferry])
    branch = scene.branch("branch")
    branch.put(at_noon)
    branch.detect()
    few = len(said(branch.conflicts())[("A", "ferry")][1])
    assert few == len(solved(at_noon, ferry)[("A", "ferry")][1])
    far = replace(LATER, positions_deg=np.add(LATER.positions_deg, [0.0, 10.0]))
    scene.put(far)
    scene.detect()
    branch.detect()
    assert said(branch.conflicts()) == solved(at_noon, ferry, far)
    assert len(said(branch.conflicts())[("A", "ferry")][1]) > few + 30


def test_an_expansion_of_the_parent_is_no_edit_of_it(db: Database) -> None:
    """A merge takes an edited schedule over, though the parent expanded its own meanwhile."""
    scene = db.scene("s")
    scene.put([area("A", AT_NIGHT), voyage("T")], SETTINGS)
    branch = scene.branch("branch")
    branch.put(area("A", AT_NOON))
    branch.put(LATER)
    branch.detect()
    assert {("A", "T"), ("A", "later")} == said(branch.conflicts()).keys()
    branch.merge()
    scene.detect()
    assert said(scene.conflicts()) == solved(area("A", AT_NOON), voyage("T"), LATER)
    other = scene.branch("other")
    other.put(area("A", AT_NIGHT))
    scene.put(area("A", AT_NOON, floor_m=1.0))
    with pytest.raises(conflictdb.InvalidInput, match="were changed in"):
        other.merge()


def test_questions_to_branches_see_schedules(db: Database) -> None:
    """Delays, speeds and explanations of a branch read its schedules and those of its parent, however late."""
    own, inherited, ferry = area("own", AT_NOON), area("inherited", AT_NOON), voyage("T", NOON_US - 90 * 60_000_000)
    scene = stored(db, [inherited, ferry])
    branch = scene.branch("branch")
    branch.put(own)
    branch.detect()
    for within_s in (7200.0, 40 * 86400.0):
        (wanted,) = conflictdb.delays([ferry], [own, inherited], SETTINGS, key="T", within_s=within_s)
        (found,) = branch.delays("T", within_s)
        assert found == wanted
    assert branch.explain("own", "T").facts["verdict"] == "conflict"
    assert branch.speeds("T") == conflictdb.speeds([ferry], [own, inherited], SETTINGS, key="T")


def test_a_schedule_that_is_not_understood_is_unresolved_in_a_branch(db: Database) -> None:
    scene = stored(db, [voyage("T"), voyage("U", west=30.0)])
    branch = scene.branch("branch")
    branch.put(area("A", AT_NIGHT))
    with db.connection.transaction():
        db.connection.execute("UPDATE conflictdb.area SET schedule = %s", ['{"notam": "WHENEVER"}'])
    branch.detect()
    assert {pair: verdict for pair, (verdict, _) in said(branch.conflicts()).items()} == {("A", "T"): "unresolved"}
