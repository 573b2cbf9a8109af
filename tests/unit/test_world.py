"""What a question may touch, and how far schedules are expanded for it."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import conflictdb
from conflictdb.core.world import Reach, World, occupy, touched
from conflictdb.model.activations import INFINITY_US, MINUS_INFINITY_US
from conflictdb.model.plans import Area, Scene, Track

HOUR_US = 3_600_000_000
DAY_US = 24 * HOUR_US
# Long after every horizon.
START_US = int(np.datetime64("2040-05-01T18:00", "us").astype(int))
SHIP = conflictdb.rectangle_outline_m(50.0, 50.0, 50.0, 50.0)
BOX = shapely.box(4.0, 57.0, 4.2, 57.1)


def voyage(key: str = "T", **more: Any) -> Track:
    return Track(key, [(3.9, 57.05), (4.3, 57.05)], [START_US, START_US + HOUR_US], SHIP, **more)


def on(*dates: str, key: str = "S", periods: Any = (("00:00", "24:00"),)) -> Area:
    return Area(key, BOX, schedule={"dates": list(dates), "periods": [list(one) for one in periods]})


def instants(*after_us: int) -> Any:
    return [np.datetime64(START_US + us, "us") for us in after_us]


@pytest.mark.parametrize(
    ("plan", "reach", "first_us", "last_us"),
    [
        (voyage(), Reach(), 0, HOUR_US),
        (voyage(), Reach(5, 7), -5, HOUR_US + 7),
        (voyage(), Reach(slowest=0.25), 0, 4 * HOUR_US),
        (voyage(departures_us=instants(-DAY_US, DAY_US)), Reach(slowest=0.5), -DAY_US, DAY_US + 2 * HOUR_US),
        (
            voyage(tolerances={"departure_window": ["2040-05-01T17:00Z", "2040-05-01T20:00Z"]}),
            Reach(),
            -HOUR_US,
            3 * HOUR_US,
        ),
        (voyage(tolerances={"arrival_window": ["2040-05-01T19:00Z", "2040-05-02T19:00Z"]}), Reach(), 0, 25 * HOUR_US),
        (Area("A", BOX, start_us=instants(0)[0], end_us=instants(3)[0]), Reach(1, 1), -1, 4),
        (Area("A", BOX, spans_us=[instants(0, 3), instants(9, 12)]), Reach(), 0, 12),
    ],
)
def test_what_a_plan_may_touch(plan: Area | Track, reach: Reach, first_us: int, last_us: int) -> None:
    """From the first instant to the last, and by the separation in time; rounded outward, by a hundredth at most."""
    for within_s in (0.0, 60.0):
        scene, within_us = Scene("s", time_separation_s=within_s), round(1e6 * within_s)
        found = touched([plan], scene, reach)
        assert found is not None
        assert found[0] == START_US + first_us - within_us
        assert 0 < found[1] - (START_US + last_us + within_us) <= 1 + (last_us - first_us) // 50
    by_rule = Scene("s", rules=[conflictdb.Rule("track", "area", time_s=60.0)])
    assert touched([plan], by_rule, reach) == found


def test_plans_without_a_time_touch_nothing() -> None:
    never = replace(voyage(), departures_us=())
    assert touched([never, on("2040-05-01"), Area("A", BOX, spans_us=[])], Scene("s")) is None
    assert touched([Area("A", BOX)], Scene("s", time_separation_s=9.0)) == (MINUS_INFINITY_US, INFINITY_US)
    both = touched([never, voyage(), Area("A", BOX, start_us=instants(-9)[0])], Scene("s"))
    assert both == (START_US - 9, INFINITY_US)


def test_schedules_are_expanded_as_far_as_a_question_reaches() -> None:
    """A world without voyages ends at its horizon; with one it contains all that the voyage may touch."""
    area, scene, now_us = on("2040-05-03"), Scene("s", horizon_days=1.0), START_US - 1000 * DAY_US
    alone = World.of(scene, [area], [], now_us=now_us)
    assert alone.window == (now_us // DAY_US * DAY_US, now_us // DAY_US * DAY_US + 2 * DAY_US)
    for reach, is_there in ((Reach(), False), (Reach(later_us=DAY_US), False), (Reach(later_us=2 * DAY_US), True)):
        world = World.of(scene, [area], [voyage()], reach=reach, now_us=now_us)
        occupied = occupy(world, [area], [voyage()])
        assert bool(occupied.areas[0].spans_us) == is_there
        assert (occupied.pieces.kind == 0).any() == is_there


def test_chances_look_as_far_as_departures_may_be() -> None:
    """Half of the departures meet an activation that no planned voyage can meet."""
    found = conflictdb.chances([voyage()], [on("2040-05-03")], departures={"T": [0.0, 1.8 * 86_400.0]})
    assert found.pairs[("T", "S")] == pytest.approx((0.5, 0.5))


def test_a_question_is_prepared_in_one_place() -> None:
    """No other module fixes a centre, checks a plane or decides how far schedules are expanded in memory."""
    package = Path(conflictdb.__file__).parent
    for call in ("centred(", "check_plane(", "expanded_area(", "expanded_track("):
        pattern = re.compile(rf"(?<![\w.]){re.escape(call)}")
        found = {
            file.relative_to(package).as_posix()
            for file in package.rglob("*.py")
            for line in file.read_text().splitlines()
            if pattern.search(line) and not line.startswith("def ")
        }
        assert found == {"core/world.py"}, call
