"""A stored object whose schedule is not understood is unresolved; every question about its scene is answered."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from commands import runner

import conflictdb
from conflictdb.client.database import Database
from conflictdb.client.stored_scene import StoredScene
from conflictdb.errors import UnknownScheduleWarning
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Verdict

HOUR_US = 3_600_000_000
START_US = int(np.datetime64("2026-06-01T06:00", "us").astype(int))
SHIP = conflictdb.rectangle_outline_m(50.0, 50.0, 50.0, 50.0)
SETTINGS = Scene("plans")
# The second one is understood, but its voyages overlap.
UNKNOWN = ('{"notam": "WHENEVER"}', '{"rrule": "DTSTART:20260601T063000Z\\nRRULE:FREQ=HOURLY", "duration": "PT1M"}')


def voyage(key: str, lat: float, west: float = 0.1, hours: int = 1, **more: Any) -> Track:
    times = [START_US, START_US + hours * HOUR_US]
    return Track(key, [(west, lat), (west + 0.3, lat)], times, SHIP, **more)


def box(key: str, west: float, south: float, **more: Any) -> Area:
    return Area(key, shapely.box(west, south, west + 0.1, south + 0.1), **more)


PLANS = (
    box("A", 0.2, 0.0),
    box("B", 0.2, 0.5),
    box("far", 20.0, 20.0),
    voyage("T", 0.05),
    voyage("U", 0.55),
    voyage("W", 0.8),
    voyage("X", 0.8, hours=2),
)


@pytest.fixture
def db(dsn: str) -> Iterator[Database]:
    with conflictdb.connect(dsn) as db:
        yield db


def spoil(db: Database, kind: str, key: str, schedule: str) -> None:
    """Write a schedule past all checks, as a trigger of a user's table does."""
    with db.connection.transaction():
        db.connection.execute(f"UPDATE conflictdb.{kind} SET schedule = %s WHERE key = %s".encode(), [schedule, key])


@pytest.fixture(params=[("area", "B", UNKNOWN[0]), ("track", "X", UNKNOWN[0]), ("track", "X", UNKNOWN[1])])
def spoilt(db: Database, request: pytest.FixtureRequest) -> tuple[StoredScene, str]:
    """A scene with such an object, and its key; it is detected."""
    return spoilt_scene(db, *request.param)


def spoilt_scene(db: Database, kind: str, key: str, schedule: str) -> tuple[StoredScene, str]:
    scene = db.scene("plans")
    scene.put(PLANS, SETTINGS)
    spoil(db, kind, key, schedule)
    scene.detect()
    return scene, key


def test_questions_are_answered_and_name_it(spoilt: tuple[StoredScene, str]) -> None:
    scene, key = spoilt
    known = [one for one in PLANS if one.key != key]
    areas, tracks = ([one for one in known if isinstance(one, kind)] for kind in (Area, Track))
    pairs = {(one.a_key, one.b_key): one.verdict for one in scene.conflicts()}
    unresolved = {pair for pair, verdict in pairs.items() if verdict is Verdict.UNRESOLVED}
    assert {("B", "U")} == unresolved if key == "B" else ("W", "X") in unresolved
    with pytest.warns(UnknownScheduleWarning, match=f"'{key}': schedule is not understood"):
        found = {one.key: one for one in scene.delays()}
    for one in conflictdb.delays(tracks, areas, SETTINGS):
        if one.key not in {two for pair in unresolved for two in pair}:
            assert found[one.key] == one
    blocked = "U" if key == "B" else "W"
    assert found[blocked].blocked_by == (key,)
    assert found[blocked].least_later_s is None
    with pytest.warns(UnknownScheduleWarning, match=f"'{key}'"):
        # Another speed is that of one voyage.
        assert {one.key for one in scene.speeds()} == found.keys() - {key}
    with pytest.warns(UnknownScheduleWarning, match=f"'{key}'"):
        scene.resolve(within_s=3 * 3600.0)
    pairs_before = pairs
    scene.detect(full=True)
    assert {(one.a_key, one.b_key): one.verdict for one in scene.conflicts()} == pairs_before


COMMANDS = (
    ("delays",),
    ("speeds",),
    ("resolve",),
    ("advise",),
    ("report", "{}/report.pdf"),
    ("plot", "{}/plot.png"),
    ("map", "--html", "{}/map.html"),
    ("export", "{}/plans.geojson"),
)


def test_commands_go_on_and_name_it_once(
    db: Database, dsn: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, key = spoilt_scene(db, "track", "X", UNKNOWN[0])
    for name, *words in COMMANDS:
        done = runner(dsn, capsys)(name, *(one.format(tmp_path) for one in words), "--scene", "plans")
        assert done.code in (0, 1), (name, done.err)
        assert done.err.count(f"'{key}': schedule is not understood") == (name != "export"), (name, done.err)


def test_objects_of_a_caller_are_still_refused() -> None:
    """In memory, where nothing else is known of them."""
    late = replace(PLANS[4], schedule={"rrule": "DTSTART:20260601T063000Z\nRRULE:FREQ=HOURLY", "duration": "PT1M"})
    longer = replace(late, times_us=late.times_us * [1, 1] + [0, HOUR_US])
    with pytest.raises(conflictdb.InvalidInput, match="before the voyage before it has ended"):
        conflictdb.solve([longer], PLANS[:3], SETTINGS)
