"""Plans with a schedule in an index, and in ways and moves that one finds."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

import conflictdb
from conflictdb.errors import IncompleteWarning, InvalidInput
from conflictdb.memory.index import Index
from conflictdb.model.plans import Area, Scene, Track

HOUR_US = 3_600_000_000
DAY_US = 24 * HOUR_US
START_US = int(np.datetime64("2031-05-01T18:00", "us").astype(int))
SHIP = conflictdb.rectangle_outline_m(50.0, 50.0, 50.0, 50.0)
BOX = shapely.box(4.0, 57.0, 4.2, 57.1)
EVENING = Area("S", BOX, schedule={"periods": [["19:10", "23:00"]]})
SCENE = Scene("s", horizon_days=30.0)


def voyage(key: str = "T", after_us: int = 0, **more: Any) -> Track:
    times: Any = [START_US + after_us, START_US + after_us + HOUR_US]
    return Track(key, [(3.9, 57.05), (4.3, 57.05)], times, SHIP, **more)


def said(found: Any) -> list[Any]:
    return [(c.a_key, c.b_key, str(c.verdict), c.periods) for c in found]


def test_an_index_knows_schedules_at_any_time() -> None:
    """Whatever is put first, and however far from the horizon a plan is."""
    for plan in (voyage(after_us=HOUR_US), voyage(after_us=-4000 * DAY_US + HOUR_US), voyage(after_us=9 * HOUR_US)):
        expected = said(conflictdb.solve([plan], [EVENING], SCENE))
        index = Index(SCENE)
        index.put(EVENING)
        assert said(index.probe(plan)) == expected
        index.put(plan)
        other = Index(SCENE)
        other.put(plan)
        assert said(other.probe(EVENING)) == expected
        other.put([EVENING, replace(EVENING, key="other", footprint=shapely.box(80, 0, 81, 1))], owner="o")
        found = said(other.probe(replace(plan, key="U")))
        assert [one for one in found if one[0] == "S"] == [(a, "U", *rest) for a, _, *rest in expected]
        assert len(other) == 3
        assert other.remove("o")
        assert not other.probe(replace(plan, key="U", positions_deg=[(80.0, 0.5), (81.0, 0.5)]))


def test_a_schedule_that_cannot_be_expanded_changes_nothing() -> None:
    """One whose activations are too many until a plan refuses that plan; the index stays as it was."""
    index = Index(SCENE)
    often = {"rrule": "DTSTART:20260101T000000Z\nRRULE:FREQ=HOURLY", "duration": "PT50M"}
    index.put(Area("S", BOX, schedule=often))
    with pytest.raises(InvalidInput, match="area 'S': schedule: has more than"):
        index.put(voyage(after_us=5000 * DAY_US))
    with pytest.raises(InvalidInput, match="area 'S': schedule: has more than"):
        index.probe(voyage(after_us=5000 * DAY_US))
    assert len(index) == 1
    assert [one[0] for one in said(index.probe(voyage(after_us=-1600 * DAY_US)))] == ["S"]


def test_a_probe_far_away_leaves_no_trace() -> None:
    """It is answered as by `solve`, whatever was asked before, and a plan is put as if nothing had been asked."""
    yearly = Area("Y", BOX, schedule={"rrule": "DTSTART:20260501T191000Z\nRRULE:FREQ=YEARLY", "duration": "PT9H"})
    often = {"rrule": "DTSTART:20260101T000000Z\nRRULE:FREQ=HOURLY", "duration": "PT50M"}
    far = [voyage(after_us=days * DAY_US + HOUR_US) for days in (365 * 40 + 10, 365 * 4 + 1)]
    index = Index(SCENE)
    with pytest.warns(IncompleteWarning, match="'Y': no activation"):
        index.put(yearly)
    for plan in [*far, *reversed(far)]:
        assert said(index.probe(plan)) == said(conflictdb.solve([plan], [yearly], SCENE))
    assert said(index.probe(far[0])) != []
    index.put(Area("S", BOX, schedule=often))
    with pytest.raises(InvalidInput, match="area 'S': schedule: has more than"):
        index.probe(far[0])
    expected = said(conflictdb.solve([voyage()], [yearly, Area("S", BOX, schedule=often)], SCENE))
    assert said(index.probe(voyage())) == [one for one in expected if one[1] == "T"]
    # Replaced and removed plans are not seen by a far probe either.
    assert index.remove("S")
    assert said(index.probe(far[0])) == said(conflictdb.solve([far[0]], [yearly], SCENE))
    with pytest.warns(IncompleteWarning, match="'Y': no activation"):
        index.put(replace(yearly, footprint=shapely.box(80, 0, 81, 1)), replace=["Y"])
    assert said(index.probe(far[0])) == []


def test_a_conflict_with_a_schedule_can_be_drawn() -> None:
    index = Index(SCENE)
    index.put(EVENING)
    [found] = index.probe(voyage(after_us=HOUR_US))
    assert found.plot()


def entered() -> Area:
    days = ("2031-04-30", "2031-05-01", "2031-05-02")
    spans: Any = [[np.datetime64(f"{day}T{at}", "us") for at in ("19:10", "23:00")] for day in days]
    return replace(EVENING, schedule=None, spans_us=spans)


def test_detours_and_moves_of_areas_by_schedule_are_those_of_their_times() -> None:
    plan, other = voyage(after_us=HOUR_US), voyage("far", after_us=2 * DAY_US)
    ways = [
        [(way.leg, way.waypoints_deg, way.later_s) for way in conflictdb.detours([plan, other], [one], SCENE, key="T")]
        for one in (EVENING, entered())
    ]
    assert ways[0] == ways[1] != []
    moves = [
        conflictdb.resolve([plan, other], [one], SCENE, within_s=60.0, aside_m=20_000.0).moves
        for one in (EVENING, entered())
    ]
    assert moves[0] == moves[1] != []


def test_detours_that_arrive_later_meet_what_is_active_then() -> None:
    """The voyage as planned ends before an activation beyond the horizon; a longer way would meet it."""
    plan = voyage(after_us=HOUR_US - 600_000_000)
    harbour = Area("H", shapely.box(4.28, 56.0, 4.32, 58.0), schedule={"periods": [["19:52", "23:00"]]})
    block = Area("X", shapely.box(4.05, 57.0, 4.1, 57.1))
    for way in conflictdb.detours([plan], [harbour, block], SCENE, key="T", most_m=20_000.0):
        assert not conflictdb.solve([replace(way.track, max_speed_kn=np.inf)], [harbour, block], SCENE)
        assert way.later_s < 120.0


def test_a_voyage_that_repeats_stays_and_others_move() -> None:
    """Its ways leave time until the next departure, and a proposal moves other tracks."""
    daily = {"rrule": "DTSTART:20310501T190000Z\nRRULE:FREQ=DAILY;COUNT=3", "duration": "PT1H"}
    ferry, plan = voyage("F", HOUR_US, schedule=daily), voyage("T", HOUR_US)
    found = conflictdb.resolve([ferry, plan, voyage("far", 3 * DAY_US)], [], SCENE)
    assert [move.key for move in found.moves] == ["T"]
    assert "track 'F' stays as planned: its voyages repeat" in found.notes
    shuttle = {"rrule": "DTSTART:20310501T190000Z\nRRULE:FREQ=HOURLY;INTERVAL=1;COUNT=3", "duration": "PT1H"}
    ferry = replace(ferry, schedule=shuttle, times_us=[START_US, START_US + HOUR_US - 300_000_000], max_speed_kn=np.inf)
    block = Area("X", shapely.box(4.05, 57.049, 4.1, 57.051))
    ways = conflictdb.detours([ferry, voyage("far", 3 * DAY_US)], [block], SCENE, key="F")
    assert ways
    assert all(way.later_s <= 300.0 and way.track.schedule == shuttle for way in ways)
