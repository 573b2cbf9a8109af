"""Conflicts that follow from latenesses: by lookup, and as detections of shifted copies find them."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
from commands import Run
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene
from patience import WAIT_S

from conflictdb import Area, Rule, Scene, Track, connect, solve, store
from conflictdb.jobs import detect, following
from conflictdb.jobs.looks import Looks
from conflictdb.model.plans import rectangle_outline_m
from conflictdb.model.recurring_plans import later

Conn = psycopg.Connection[Any]
BEGAN = datetime.now(UTC).replace(microsecond=0) - timedelta(minutes=30)
DEGREE_M = 111_319.5


def us(minute: float) -> int:
    return int((BEGAN + timedelta(minutes=minute)).timestamp() * 1e6)


def crossing(key: str, start_min: float, *, north: bool, side: float = 500.0) -> Track:
    """Return a track at a mile a minute through (0.5, 0): eastward, or northward."""
    ends = [(0.5, -0.5), (0.5, 0.5)] if north else [(0.0, 0.0), (1.0, 0.0)]
    return Track(key, ends, [us(start_min), us(start_min + 60)], rectangle_outline_m(side, side, side, side))


def put(conn: Conn, key: str, minute: float, lon: float, lat: float, error_m: float = 10.0) -> None:
    conn.execute(
        "INSERT INTO conflictdb.position (scene, key, instant, place, error_m) "
        "VALUES ('s', %s, %s, ST_SetSRID(ST_MakePoint(%s, %s), 4326), %s)",
        [key, BEGAN + timedelta(minutes=minute), lon, lat, error_m],
    )


def look(conn: Conn, minute: float) -> dict[tuple[str, str | None], Any]:
    conn.commit()
    Looks().look(conn, us(minute), is_silence_due=True)
    rows = conn.execute(
        "SELECT key, other_key, verdict, reason, first_contact, place, alarm_id FROM conflictdb.live_conflicts"
    ).fetchall()
    conn.commit()
    return {(row[0], row[1]): row[2:] for row in rows}


def detected(conn: Conn, plans: list[Track], **settings: Any) -> None:
    store.replace_scene(conn, Scene("s", **settings), [], plans, merge=False)
    conn.commit()
    detect.detect(conn, "s", jobs=1)


def test_a_late_ferry_meets_the_tow(conn: Conn) -> None:
    """The ferry passes the crossing 10 minutes before the tow; 10 minutes late it meets it there."""
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=3600)
    put(conn, "FERRY", 20, 20 / 60, 0)
    put(conn, "TOW", 20, 0.5, -0.5 + 10 / 60)
    assert look(conn, 20) == {}
    # 5 minutes late: slack is left.
    put(conn, "FERRY", 22, 17 / 60, 0)
    assert look(conn, 22) == {}
    (slack,) = conn.execute("SELECT slack_s FROM conflictdb.live WHERE key = 'FERRY'").fetchone() or ()
    speed_mps = DEGREE_M / 3600
    # Each haven takes as long to pass the crossing; the lateness is known to the passing of the position.
    assert slack == pytest.approx(300 - 2000 / speed_mps - 510 / speed_mps, abs=3)
    # 10 minutes late: they meet.
    put(conn, "FERRY", 28, 18 / 60, 0)
    found = look(conn, 28)
    ((pair, (verdict, reason, first, _, alarm)),) = found.items()
    assert (pair, verdict, reason) == (("FERRY", "TOW"), "must", None)
    assert abs((first - BEGAN).total_seconds() - 40 * 60) < 90
    # It stays one alarm while nothing changes.
    put(conn, "FERRY", 29, 19 / 60, 0)
    assert look(conn, 29)["FERRY", "TOW"][-1] == alarm
    # On plan again: it ends by itself.
    put(conn, "FERRY", 29.5, 29.5 / 60, 0)
    assert look(conn, 29.5) == {}


def test_alarms_need_no_closest_approach(conn: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """It took most of the time of looks at late aircraft."""
    detected(
        conn,
        [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)],
        delays_within_s=3600,
        separation_m=500,
        nearest_m=5000,
    )
    monkeypatch.delattr("conflictdb.core.run.with_closest_approaches")
    put(conn, "FERRY", 28, 18 / 60, 0)
    assert [(pair, row[0]) for pair, row in look(conn, 28).items()] == [(("FERRY", "TOW"), "must")]


def test_alarms_that_began_and_ended_are_recorded_and_pruned(conn: Conn) -> None:
    """With the pair and its verdict, in order; as long as other history."""
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=3600)
    for minute, lon in ((28, 18 / 60), (29, 19 / 60), (29.5, 29.5 / 60), (29.9, 19.9 / 60)):
        put(conn, "FERRY", minute, lon, 0)
        look(conn, minute)
    rows = conn.execute("SELECT kind, alarm_id, key, other_key, verdict FROM conflictdb.live_events ORDER BY event")
    kinds, numbers, *_ = zip(*(found := rows.fetchall()), strict=True)
    assert kinds == ("begun", "ended", "begun")
    assert numbers[0] == numbers[1] != numbers[2]
    assert {row[2:] for row in found} == {("FERRY", "TOW", "must")}
    conn.execute("SELECT conflictdb.prune_history('s', '0')")
    assert conn.execute("SELECT count(*) FROM conflictdb.live_events").fetchone() == (0,)


def test_an_alarm_of_a_pair_that_conflicts_as_planned_is_one_while_it_has_no_slack(conn: Conn) -> None:
    """The ferry is in turn late by a little, which conflicts, too, and on plan."""
    detected(
        conn, [crossing("FERRY", 0, north=False, side=4000.0), crossing("TOW", 0, north=True, side=4000.0)],
        delays_within_s=3600,
    )  # fmt: skip
    numbers = []
    for n, late_min in enumerate((0, 4, 0, 4, 0)):
        put(conn, "FERRY", 24 + n, (24 + n - late_min) / 60, 0)
        numbers.append([row[-1] for row in look(conn, 24 + n).values()])
    assert numbers[0] == []
    assert len(numbers[1]) == 1
    assert numbers[1] == numbers[2] == numbers[3] == numbers[4]


def test_a_pair_that_does_not_conflict_as_planned_is_no_must(conn: Conn) -> None:
    """The second leg begins where and when the first one ends: as planned they share no time."""
    side = rectangle_outline_m(2000, 2000, 2000, 2000)
    first = Track("FIRST", [(0.0, 0.0), (0.5, 0.0)], [us(0), us(30)], side)
    detected(conn, [first, Track("NEXT", [(0.5, 0.0), (1.0, 0.0)], [us(30), us(60)], side)], delays_within_s=3600)
    assert conn.execute("SELECT FROM conflictdb.conflicts").fetchall() == []
    put(conn, "FIRST", 20, (20 - 2.2) / 60, 0)
    assert look(conn, 20)["FIRST", "NEXT"][0] == "may"
    put(conn, "FIRST", 22, 22 / 60, 0)
    assert look(conn, 22) == {}


@pytest.mark.parametrize(("more_us", "verdict"), [(0, "may"), (1, "must")])
def test_proven_differences_are_stored_a_microsecond_longer(conn: Conn, more_us: int, verdict: str) -> None:
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=3600)
    put(conn, "FERRY", 28, 18 / 60, 0)
    look(conn, 28)
    conn.execute(
        "UPDATE conflictdb.difference d SET proven_us = int8multirange(int8range("
        "round(1e6 * l.late_from_s)::bigint - %(more)s, round(1e6 * l.late_to_s)::bigint + %(more)s, '[]')) "
        "FROM conflictdb.live_state l, conflictdb.track t "
        "WHERE l.key = 'FERRY' AND t.key = 'FERRY' AND d.track_id = t.track_id",
        {"more": more_us},
    )
    put(conn, "FERRY", 28.001, 18.001 / 60, 0)
    (found,) = look(conn, 28.001).values()
    assert found[0] == verdict


def test_a_pair_that_parts_and_meets_again_is_another_alarm(conn: Conn) -> None:
    """The ferry passes the area twice, an hour apart, and is 10 minutes late."""
    area = Area("DIVING", [(0.49, -0.01), (0.51, -0.01), (0.51, 0.01), (0.49, 0.01)])
    ferry = Track(
        "FERRY", [(0, 0), (1, 0), (0, 0)], [us(-100), us(-40), us(20)], rectangle_outline_m(500, 500, 500, 500)
    )
    store.replace_scene(conn, Scene("s", delays_within_s=7200), [area], [ferry], merge=False)
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    verdicts, numbers = [], []
    for minute, lon in ((-66, 24 / 60), (-61, 29 / 60), (-60, 30 / 60), (-55, 35 / 60), (-20, 50 / 60), (0, 30 / 60)):
        put(conn, "FERRY", minute, lon, 0)
        ((verdict, *_, number),) = look(conn, minute).values()
        verdicts.append(verdict)
        numbers.append(number)
    assert numbers[:3] == [numbers[0]] * 3
    assert numbers[3:] == [numbers[-1]] * 3
    assert numbers[0] != numbers[-1]
    assert verdicts[0] == verdicts[4] == "must"
    assert verdicts[-1] == "now"


def test_what_cannot_be_looked_up_is_may_by_name(conn: Conn) -> None:
    plans = [crossing("A", 0, north=False), crossing("B", 0, north=True), crossing("C", -60, north=False)]
    detected(conn, plans)
    put(conn, "A", 20, 10 / 60, 0)
    ((pair, found),) = look(conn, 20).items()
    assert (pair, found[:3]) == (("A", None), ("may", "the scene stores no delays: set delays_within_s", None))
    detected(conn, plans, delays_within_s=300)
    put(conn, "A", 21, 11 / 60, 0)
    assert look(conn, 21)["A", None][1] == "its lateness exceeds delays_within_s (300 s)"


def test_a_ship_off_its_plan_may_meet_what_it_can_reach(conn: Conn) -> None:
    """It is 3 nmi south of its plan, and a mile from the plan of B, which passes soon."""
    detected(conn, [crossing("A", 0, north=False), crossing("B", 0, north=True)], delays_within_s=3600)
    put(conn, "A", 25, 0.48, -0.05)
    found = look(conn, 25)
    assert found["A", "B"][:2] == ("may", "off its plan: it may be anywhere that it can reach")
    put(conn, "A", 26, 26 / 60, 0)
    assert "A" not in {key for key, other in look(conn, 26) if other is None}


@pytest.mark.parametrize("late_min", [0, 15])
def test_a_ship_off_its_plan_may_meet_one_that_is_late(conn: Conn, late_min: int) -> None:
    """B passed as planned 15 minutes ago and is out of reach; 15 minutes late it comes near in a few minutes."""
    detected(conn, [crossing("A", 0, north=False), crossing("B", -15, north=True)], delays_within_s=3600)
    put(conn, "B", 29, 0.5, -0.5 + (44 - late_min) / 60)
    put(conn, "A", 30, 0.52, 0.05)
    found = look(conn, 30)
    assert (("A", "B") in found) is (late_min == 15)
    if late_min:
        verdict, reason, first, *_ = found["A", "B"]
        assert (verdict, reason) == ("may", "off its plan: it may be anywhere that it can reach")
        assert abs((first - BEGAN).total_seconds() - 31.5 * 60) < 120


@pytest.mark.parametrize("together", [True, False])
def test_ships_off_their_plans_may_meet_each_other(conn: Conn, together: bool) -> None:
    """Not where they are planned to be, but where they are; in one look or in two."""
    detected(conn, [crossing("A", 0, north=False), crossing("C", -10, north=False)], delays_within_s=3600)
    put(conn, "A", 29, 0.3, 0.2)
    if not together:
        look(conn, 29)
    put(conn, "C", 29.5, 0.32, 0.2)
    found = look(conn, 29.6)
    assert found["A", "C"][:2] == ("may", "off its plan: it may be anywhere that it can reach")


@pytest.mark.parametrize(("above_m", "may_meet"), [(2_000.0, True), (60_000.0, False)])
def test_an_aircraft_off_its_plan_may_climb(conn: Conn, above_m: float, may_meet: bool) -> None:
    """It may climb as fast as it may move, a mile a minute, until it is silent."""
    heights = [{"floor_m": 900.0, "ceiling_m": 1_100.0}, {"floor_m": 900.0 + above_m, "ceiling_m": 1_100.0 + above_m}]
    plans = [crossing("A", 0, north=False), crossing("B", 0, north=True)]
    flights = [replace(plan, **height) for plan, height in zip(plans, heights, strict=True)]
    detected(conn, flights, delays_within_s=3600)
    put(conn, "A", 25, 0.48, -0.05)
    conn.execute("UPDATE conflictdb.position SET height_m = 1000")
    assert (("A", "B") in look(conn, 25)) is may_meet


@pytest.mark.parametrize("rule", ["allowed", None])
def test_ships_off_their_plans_are_compared_by_the_rules(conn: Conn, rule: str | None) -> None:
    """As planned: classes that may meet raise no alarm."""
    plans = [crossing("A", 0, north=False), crossing("B", -10, north=False)]
    plans = [replace(plan, object_class=name) for plan, name in zip(plans, ("ferry", "tow"), strict=True)]
    rules = () if rule is None else (Rule("ferry", "tow", allowed=True),)
    detected(conn, plans, delays_within_s=3600, rules=rules)
    put(conn, "A", 29, 0.3, 0.2)
    put(conn, "B", 29.5, 0.32, 0.2)
    assert (("A", "B") in look(conn, 29.6)) is (rule is None)


def test_a_look_has_as_many_statements_for_many_that_are_off_as_for_two(
    conn: Conn, monkeypatch: pytest.MonkeyPatch
) -> None:
    plans = [crossing(f"P{n}", n, north=False) for n in range(24)]
    detected(conn, plans, delays_within_s=3600)
    counted = []
    whole = psycopg.Cursor.execute

    def execute(self: Any, *arguments: Any, **given: Any) -> Any:
        counted[-1] += 1
        return whole(self, *arguments, **given)

    # The first two warm up what is prepared once.
    for some in (plans[:2], plans[2:4], plans[4:]):
        for track in some:
            put(conn, track.key, 30, 0.1, 0.2 + 0.01 * int(track.key[1:]))
        conn.commit()
        counted.append(0)
        with monkeypatch.context() as patched:
            patched.setattr(psycopg.Cursor, "execute", execute)
            Looks().look(conn, us(30), is_silence_due=False)
    assert counted[2] == counted[1] <= 20


def test_an_alarm_of_a_track_that_is_off_does_not_end_by_looks_at_the_other(conn: Conn) -> None:
    """A is off its plan near B; then B, which is late, reports."""
    detected(conn, [crossing("A", 0, north=False), crossing("B", 0, north=True)], delays_within_s=3600)
    put(conn, "A", 25, 0.48, -0.05)
    alarm = look(conn, 25)["A", "B"]
    put(conn, "B", 25.5, 0.5, -0.5 + 20 / 60)
    assert look(conn, 25.5)["A", "B"] == alarm
    # It ends by looks at A.
    for minute in (26, 27.5):
        put(conn, "A", minute, minute / 60, 0)
        found = look(conn, minute)
    assert found.get(("A", "B")) != alarm


def test_a_ship_that_should_lie_still_and_is_off_may_be_anywhere(conn: Conn) -> None:
    """Its plan says no speed: a disc that does not grow would contain nothing, and claim that it meets nobody."""
    moored = replace(crossing("A", 0, north=False), positions_deg=[(0.0, 0.0), (0.0, 0.0)])
    detected(conn, [moored, crossing("B", 0, north=True)], delays_within_s=3600)
    put(conn, "A", 25, 0.48, -0.05)
    assert look(conn, 25)["A", None][:2] == ("may", "off its plan: it may be anywhere that it can reach")


def test_an_alarm_of_a_ship_at_the_edge_of_its_corridor_is_one(conn: Conn) -> None:
    """A is off its plan, on it, and off again, near B: it ends when A is on its plan for a minute."""
    detected(conn, [crossing("A", 0, north=False), crossing("B", 4, north=True)], delays_within_s=3600)
    alarms = []
    for minute in (20, 23, 26):
        put(conn, "A", minute, minute / 60, -0.05)
        alarms.append(look(conn, minute)["A", "B"][-1])
        put(conn, "A", minute + 1.5, (minute + 1.5) / 60, 0)
        alarms.append(look(conn, minute + 1.5)["A", "B"][-1])
    assert len({*alarms}) == 1
    put(conn, "A", 28, 28 / 60, 0)
    assert ("A", "B") in look(conn, 28)
    put(conn, "A", 29, 29 / 60, 0)
    assert look(conn, 29) == {}
    kinds = conn.execute("SELECT kind FROM conflictdb.live_events WHERE key = 'A' ORDER BY event").fetchall()
    assert kinds == [("begun",), ("ended",)]


@pytest.mark.parametrize(("delays_within_s", "other"), [(3600, "TOW"), (0, None)])
def test_alarms_of_removed_objects_end(conn: Conn, delays_within_s: float, other: str | None) -> None:
    """Also without another position, and without an end of the contact."""
    for removed in ("FERRY", *([] if other is None else [other])):
        detected(
            conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=delays_within_s
        )
        put(conn, "FERRY", 28, 18 / 60, 0)
        assert set(look(conn, 28)) == {("FERRY", other)}
        conn.execute("SELECT conflictdb.remove_object('s', %s)", [removed])
        assert look(conn, 28.2) == {}
        conn.execute("TRUNCATE conflictdb.live_state")


def test_an_alarm_ends_when_an_area_takes_the_key_of_its_track(conn: Conn) -> None:
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)])
    put(conn, "FERRY", 28, 18 / 60, 0)
    assert set(look(conn, 28)) == {("FERRY", None)}
    conn.execute("SELECT conflictdb.remove_object('s', 'FERRY')")
    conn.execute("SELECT conflictdb.put_area('s', 'FERRY', ST_MakeEnvelope(5, 5, 6, 6, 4326))")
    assert look(conn, 28.2) == {}


def test_an_alarm_ends_when_its_contact_is_over(conn: Conn) -> None:
    """Without another position: they meet from 39 to 41 minutes."""
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=3600)
    put(conn, "FERRY", 29.5, 19.5 / 60, 0)
    conn.execute("SET conflictdb.silent_after = '1 hour'")
    assert set(look(conn, 30)) == {("FERRY", "TOW")}
    assert set(look(conn, 38)) == {("FERRY", "TOW")}
    assert look(conn, 43) == {}


def test_an_alarm_does_not_end_before_its_latest_contact(conn: Conn) -> None:
    """A haven of 20 nmi gives the lateness to 20 minutes: it is 3 to 23 minutes late."""
    area = Area("DIVING", [(0.49, -0.01), (0.51, -0.01), (0.51, 0.01), (0.49, 0.01)])
    long = Track("LONG", [(0, 0), (1, 0)], [us(0), us(60)], rectangle_outline_m(18_553, 18_553, 500, 500))
    store.replace_scene(conn, Scene("s", delays_within_s=7200), [area], [long], merge=False)
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    put(conn, "LONG", 29.5, 16.5 / 60, 0)
    conn.execute("SET conflictdb.silent_after = '1 hour'")
    look(conn, 30)
    (last,) = conn.execute("SELECT last_contact FROM conflictdb.live_conflicts").fetchone() or ()
    # On time its rear leaves the area at 40.6 minutes.
    assert abs((last - BEGAN).total_seconds() - 60 * (40.6 + 23)) < 120


def test_a_silent_track_may_still_meet_what_it_should_have_passed(conn: Conn) -> None:
    """Planned at the area at 30 minutes and silent since 20, it may have stopped, and be there only after 45."""
    area = Area("DIVING", [(0.49, -0.01), (0.51, -0.01), (0.51, 0.01), (0.49, 0.01)])
    store.replace_scene(
        conn, Scene("s", delays_within_s=7200), [area], [crossing("FERRY", 0, north=False)], merge=False
    )
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    put(conn, "FERRY", 20, 20 / 60, 0)
    assert look(conn, 20) == {}
    ((pair, (verdict, _, first, *_)),) = look(conn, 45).items()
    assert (pair, verdict) == (("FERRY", "DIVING"), "may")
    assert abs((first - BEGAN).total_seconds() - 55 * 60) < 120


def test_what_follows_from_silence_is_looked_up_once_a_minute(conn: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """A minute ahead, so that a look in between misses nothing."""
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=7200)
    put(conn, "FERRY", 20, 20 / 60, 0)
    look(conn, 20)
    followed = []

    def follow(*given: Any) -> None:
        followed.append(list(given[3]))
        following.follow(*given)

    monkeypatch.setattr("conflictdb.jobs.looks.follow", follow)
    ends: list[float] = []
    for n in range(19):
        look(conn, 31 + n / 6)
        (late_to_s,) = conn.execute("SELECT late_to_s FROM conflictdb.live").fetchone() or ()
        ends.append(late_to_s - ends[0] if ends else late_to_s)
    assert ends[1:] == [60.0] * 6 + [120.0] * 6 + [180.0] * 6
    assert followed == [["FERRY"]] * 4


@pytest.mark.parametrize("draws", [6, pytest.param(150, marks=pytest.mark.slow)])
def test_latenesses_looked_up_equal_detections_of_shifted_copies(conn: Conn, draws: int) -> None:
    """Each draw gives each of 40 tracks a lateness: 780 pairs, and those with areas. No contradiction."""
    rng = np.random.default_rng(50)
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 50, 6, 40)
    scene = Scene("s", separation_m=scene.separation_m, delays_within_s=7200, intervals=scene.intervals)
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    (scene_id,) = conn.execute("SELECT scene_id FROM conflictdb.scene WHERE name = 's'").fetchone() or ()
    conn.execute(
        "INSERT INTO conflictdb.live_state (scene_id, key, state, late_from_s, late_to_s, instant, place, error_m, "
        "as_of, version) SELECT scene_id, key, 'late', 0, 0, now(), 'SRID=4326;POINT(0 0)', 0, now(), version "
        "FROM conflictdb.track"
    )
    keys = [track.key for track in tracks]
    compared = met = 0
    for _ in range(draws):
        late_us = {key: int(by) for key, by in zip(keys, rng.integers(-3_600_000_000, 3_600_000_000, 40), strict=True)}
        conn.execute(
            "UPDATE conflictdb.live_state l SET late_from_s = u.by, late_to_s = u.by "
            "FROM unnest(%s::text[], %s::float8[]) u (key, by) WHERE l.key = u.key",
            [keys, [late_us[key] / 1e6 for key in keys]],
        )
        rows = store.following(conn, scene_id, keys)
        verdicts = {frozenset((row.key, row.other_key)): row.verdict for row in rows}
        found = solve([later(track, late_us[track.key]) for track in tracks], areas, scene)
        really = {frozenset((one.a_key, one.b_key)) for one in found if one.verdict != "near"}
        for pair in really:
            assert verdicts.get(pair) in ("may", "must"), pair
        for pair, verdict in verdicts.items():
            assert verdict != "must" or pair in really, pair
        may = sum(verdict == "may" and pair not in really for pair, verdict in verdicts.items())
        assert may <= 2  # at the very ends of intervals
        compared += 40 * 39 // 2 + 40 * len(areas)
        met += len(really)
    assert met > 10 * draws
    assert compared >= 600 * draws


def test_a_recorded_hour_is_replayed(conn: Conn, run: Run, tmp_path: Path) -> None:
    """Positions of a ferry that is 10 minutes late give one alarm, at their instants."""
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=3600)
    rows = [f"FERRY,{BEGAN + timedelta(minutes=20 + n):%Y-%m-%dT%H:%M:%SZ},{(10 + n) / 60},0" for n in range(3)]
    file = tmp_path / "positions.csv"
    file.write_text("id,time,lon,lat\n" + "\n".join([*rows, "X,2026-03-01T06:00:00Z,0,0"]) + "\n")
    said = run("worker", "--replay", str(file), "--scene", "s").out.splitlines()
    assert [line.split(" ", 1)[1] for line in said] == ["FERRY must meet TOW", "3 positions replayed, 1 alarms"]


def test_a_look_that_ends_before_its_commit_is_done_again(conn: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """No position is lost, and no alarm comes twice."""
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=3600)
    put(conn, "FERRY", 28, 18 / 60, 0)
    conn.commit()
    for name in ("put_live", "put_alarms"):
        for after in (False, True):
            whole = getattr(store, name)

            def killed(*arguments: Any, whole: Any = whole, after: bool = after) -> None:
                if after:
                    whole(*arguments)
                raise KeyboardInterrupt

            with monkeypatch.context() as patched:
                patched.setattr(store, name, killed)
                with pytest.raises(KeyboardInterrupt):
                    Looks().look(conn, us(28), is_silence_due=True)
            conn.rollback()
            assert conn.execute("SELECT count(*) FROM conflictdb.live").fetchone() == (0,)
            conn.rollback()
    (first,) = look(conn, 28).values()
    (again,) = look(conn, 28).values()
    assert (first[-1], first[0]) == (again[-1], "must")


def test_keys_too_long_for_a_notification_are_left_out(conn: Conn, dsn: str) -> None:
    """JSON writes a control character as six."""
    keys = "\x01" * 900, "\x02" * 900
    detected(conn, [crossing(keys[0], 0, north=False), crossing(keys[1], 10, north=True)], delays_within_s=3600)
    with psycopg.connect(dsn, autocommit=True) as heard:
        heard.execute("LISTEN conflictdb_alarm")
        put(conn, keys[0], 28, 18 / 60, 0)
        (pair,) = look(conn, 28)
        payloads = [json.loads(one.payload) for one in heard.notifies(timeout=WAIT_S, stop_after=1)]
    assert pair == keys
    assert [(one["kind"], one["scene"], one["keys"]) for one in payloads] == [("begun", None, None)]


def test_an_alarm_is_acknowledged_until_it_gets_worse(conn: Conn) -> None:
    """By the same call as a conflict; metrics count it."""
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=3600)
    put(conn, "FERRY", 28, 18 / 60 + 0.018, 0)  # 9 minutes late, at the edge of what meets
    assert look(conn, 28)["FERRY", "TOW"][0] == "may"
    with connect(conn) as db:
        db.scene("s").acknowledge("TOW", "FERRY", "seen", by="Ann")
    (who,) = conn.execute("SELECT acknowledged_by FROM conflictdb.live_conflicts").fetchone() or ()
    assert who.startswith("Ann (")
    assert store.counted_conflicts(conn) == {("s", "may", True): 1}
    put(conn, "FERRY", 28.5, 18.5 / 60, 0)
    assert look(conn, 28.5)["FERRY", "TOW"][0] == "must"
    assert store.counted_conflicts(conn) == {("s", "must", False): 1}
    with connect(conn) as db:
        db.scene("s").acknowledge("FERRY", "TOW", "known")
        assert db.scene("s").unacknowledge("FERRY", "TOW")
        assert not db.scene("s").unacknowledge("FERRY", "TOW")


def test_editors_acknowledge_alarms_in_their_own_name(conn: Conn) -> None:
    """Whatever they write, and now."""
    detected(conn, [crossing("FERRY", 0, north=False), crossing("TOW", 10, north=True)], delays_within_s=3600)
    put(conn, "FERRY", 28, 18 / 60, 0)
    look(conn, 28)
    conn.execute("SET ROLE conflictdb_editor")
    for by, shown in (("Chief", "conflictdb_editor"), ("Ann (conflictdb_editor)", "Ann (conflictdb_editor)")):
        found = conn.execute(
            "UPDATE conflictdb.live_conflict SET acknowledged_by = %s, acknowledged_at = '2020-01-01', "
            "acknowledged_for = 'seen' RETURNING acknowledged_by, acknowledged_at = now()", [by],
        ).fetchall()  # fmt: skip
        assert found == [(shown, True)]
    conn.execute("UPDATE conflictdb.live_conflict SET acknowledged_for = NULL")
    conn.execute("RESET ROLE")
    (row,) = conn.execute("SELECT acknowledged_by, acknowledged_at, acknowledged_for FROM conflictdb.live_conflict")
    assert row == (None, None, None)
