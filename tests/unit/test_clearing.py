"""Clearing in memory: programs against every choice of delays, rings through one point, scenes, input and output."""

import os
import subprocess
import sys
import warnings
from dataclasses import replace
from itertools import combinations, permutations

import numpy as np
import pytest
import shapely
from layouts import LOW_LATITUDE
from mixed_scenes import plain_scene

from conflictdb import (
    Area,
    EarthModel,
    InvalidInput,
    Rule,
    Scene,
    Side,
    Track,
    detours,
    rectangle_outline_m,
    resolve,
    solve,
)
from conflictdb.core.delays import Spans
from conflictdb.memory.greedy import greedy, is_plan
from conflictdb.memory.least import least
from conflictdb.memory.program import NOTHING, Program, chain_of
from conflictdb.memory.resolve import at_speed, moved, place
from conflictdb.memory.rounding import rounded_delays
from conflictdb.memory.turns import Turns, bound_of
from conflictdb.memory.yielding import levels_of
from conflictdb.model.clock import Clock
from conflictdb.model.recurring_plans import later

SECOND = 1_000_000
T0_US = 1_780_000_000_000_000
FEVER = 1e9


def spans_of(rng: np.random.Generator, most: int, count: int) -> Spans:
    """Forbidden intervals of which only the microseconds next to whole seconds are free."""
    if not count:
        return NOTHING
    low = rng.integers(-most, most, count)
    high = low + rng.integers(0, max(most // 2, 1), count)
    return Spans.union(low * SECOND - SECOND + 1, high * SECOND + SECOND - 1)


def random_program(seed: int) -> Program:
    """A program of 2 to 5 tracks whose least delays are whole seconds, often with conflicts as planned."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    most = int(rng.integers(3, 9))
    low = np.full(n, -int(rng.integers(0, 3)) if rng.random() < 0.4 else 0)
    pair = {}
    for i, j in combinations(range(n), 2):
        if rng.random() < 0.7:
            pair[i, j] = spans_of(rng, most, int(rng.integers(1, 3)))
    single = [spans_of(rng, most, int(rng.integers(0, 3))) for _ in range(n)]
    weight = rng.integers(1, 4, n).astype(float) if rng.random() < 0.5 else np.ones(n)
    return Program(low * SECOND, np.full(n, most) * SECOND, weight, single, pair)


def best_of_all(program: Program, goal: str) -> tuple[int, float]:
    """The fewest tracks left and the least objective, by trying every whole second of every track."""
    n, low, high = len(program), program.low // SECOND, program.high // SECOND
    axes = np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)), indexing="ij")
    delays = np.stack([axis.ravel() for axis in axes], axis=1)

    def met(spans: Spans, values: np.ndarray) -> np.ndarray:
        inside = (spans.low[:, None] <= values * SECOND) & (values * SECOND <= spans.high[:, None])
        return inside.any(axis=0)

    wrong = np.stack([met(program.single[i], delays[:, i]) for i in range(n)], axis=1)
    crossed = {(i, j): met(spans, delays[:, i] - delays[:, j]) for (i, j), spans in program.pair.items()}
    for count in range(n + 1):
        best = np.inf
        for out in combinations(range(n), count):
            fine = (delays[:, list(out)] == 0).all(axis=1)
            fine &= ~np.delete(wrong, list(out), axis=1).any(axis=1)
            for (i, j), meets in crossed.items():
                if not (i in out and j in out):
                    fine &= ~meets
            if fine.any():
                each = program.weight * np.abs(delays[fine])
                best = min(best, float((each.sum(axis=1) if goal == "total" else each.max(axis=1)).min()))
        if best < np.inf:
            return count, best
    raise AssertionError("all tracks may be left")


def agrees(seed: int, goal: str) -> None:
    program = random_program(seed)
    if goal == "largest":
        # With delays both ways, or weights, the least largest of them need not be whole seconds.
        program = replace(program, weight=np.ones(len(program)), low=np.zeros(len(program), np.int64))
    count, objective = best_of_all(program, goal)
    order = list(range(len(program)))
    found = place(program, order, np.zeros(len(program), np.int64), goal, 60.0)
    assert is_plan(program, found.delays, found.left)
    assert (len(found.left), pytest.approx(objective, abs=2e-3)) == (count, found.objective_s), seed
    assert found.bound_s <= objective + 2e-3
    assert found.is_least, seed
    by_turns, left = greedy(program, order)
    assert (len(found.left), found.objective_s) <= (len(left), program.cost(by_turns, goal)) or len(found.left) < len(
        left
    )


@pytest.mark.parametrize("goal", ["total", "largest"])
def test_program_equals_all_choices(goal: str) -> None:
    """As few tracks are left, and delays are as small, as trying every delay of every track finds."""
    for seed in range(60):
        agrees(seed, goal)


@pytest.mark.slow
@pytest.mark.parametrize("goal", ["total", "largest"])
def test_thousand_programs_equal_all_choices(goal: str) -> None:
    """The same for a thousand programs."""
    for seed in range(1000):
        agrees(seed, goal)


def test_levels_are_placed_in_turn() -> None:
    """A track of a higher level moves only where nothing else clears it."""
    span = Spans(np.array([-5 * SECOND]), np.array([5 * SECOND]))
    program = Program(np.zeros(2, np.int64), np.full(2, 60 * SECOND), np.ones(2), [NOTHING] * 2, {(0, 1): span})
    for level, later_one in (([0, 1], 0), ([1, 0], 1)):
        found = place(program, [0, 1], np.array(level), "total", 1.0)
        assert found.delays[later_one] == 5 * SECOND + 1
        assert found.delays[1 - later_one] == 0
        assert found.is_least


def test_levels_without_room_begin_anew() -> None:
    """What is left of a lower level is in the way of higher ones, so that no conflict is new."""
    program = Program(
        np.zeros(2, np.int64),
        np.full(2, 60 * SECOND),
        np.ones(2),
        [Spans(np.array([0]), np.array([9 * SECOND])), Spans(np.array([-1]), np.array([70 * SECOND]))],
        {(0, 1): Spans(np.array([8 * SECOND]), np.array([20 * SECOND]))},
    )
    found = place(program, [0, 1], np.array([1, 0]), "total", 1.0)
    assert found.left == {1}
    assert found.delays.tolist() == [20 * SECOND + 1, 0]


def test_bound_of_turns_equals_all_orders() -> None:
    """The bound of tracks that pass in turn is the least objective of all their orders."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 7))
        lag = rng.integers(1, 100 * SECOND, (n, n)) * ~np.eye(n, dtype=bool)
        turns = Turns(rng.integers(0, 50 * SECOND, n), lag, rng.integers(1, 4, n).astype(float))
        for goal in ("total", "largest"):
            costs = []
            for order in permutations(range(n)):
                delays, at = turns.least.astype(float), -np.inf
                for place_, track in enumerate(order):
                    at = max(at, delays[track])
                    delays[track] = at
                    later_ = list(order[place_ + 1 :])
                    delays[later_] = np.maximum(delays[later_], at + lag[track, later_])
                each = turns.weight * delays / 1e6
                costs.append(each.sum() if goal == "total" else each.max())
            bound, _ = bound_of(turns, goal, np.inf, FEVER)
            assert bound == pytest.approx(min(costs), abs=1e-5), seed


def ring(n: int, spread_s: float = 0.0) -> tuple[list[Track], Scene]:
    """Aircraft that all fly through one point at one time, 5 nmi apart if they are not to conflict."""
    rng, tracks = np.random.default_rng(1), []
    for k in range(n):
        angle, radius = 2.0 * np.pi * k / n, 100.0 / 60.0
        east, north = radius * np.sin(angle) / np.cos(np.radians(52.0)), radius * np.cos(angle)
        start = T0_US + int(rng.uniform(0.0, spread_s) * SECOND)
        lasts = int(200.0 / 450.0 * 3600.0) * SECOND
        path = [(4.0 + east, 52.0 + north), (4.0 - east, 52.0 - north)]
        tracks.append(Track(f"AC{k:02d}", path, [start, start + lasts], [(0.0, 0.0)]))
    return tracks, Scene("ring", separation_m=5.0 * 1852.0)


@pytest.mark.parametrize("n", [9, 10])
def test_ring_is_proven(n: int) -> None:
    """Aircraft through one point: least delays with their proof, where the program alone finds only a gap."""
    tracks, scene = ring(n)
    found = resolve(tracks, [], scene, within_s=3600.0)
    assert found.is_least
    assert found.left == ()
    assert found.objective_s == pytest.approx({9: 1846.736, 10: 8838.724}[n], abs=0.01)


def test_time_limit_leaves_a_plan_with_its_bound() -> None:
    """Without time there is the plan by turns, and a bound below it."""
    tracks, scene = ring(12)
    found = resolve(tracks, [], scene, within_s=3600.0, limit_s=0.0)
    assert not found.is_least
    assert 0.0 <= found.bound_s < found.objective_s
    assert found.left == ()


def scene_of(seed: int) -> tuple[Scene, list[Area], list[Track]]:
    workload = replace(LOW_LATITUDE, window=1.5, around_haven=(8.0, 20.0), around_area=(5.0, 15.0))
    return plain_scene(workload, seed, 4, 14)


def check(seed: int, **more: object) -> None:
    scene, areas, tracks = scene_of(seed)
    before = {(one.a_key, one.b_key) for one in solve(tracks, areas, scene)}
    found = resolve(tracks, areas, scene, limit_s=5.0, **more)
    moves = {one.key: one for one in found.moves}
    changed = [
        track
        if track.key not in moves
        else at_speed(track, moves[track.key].speed)
        if moves[track.key].speed != 1.0
        else later(track, round(moves[track.key].delay_s * 1e6))
        for track in tracks
    ]
    after = {(one.a_key, one.b_key) for one in solve(changed, areas, scene)}
    assert after <= before
    for move in found.moves:
        assert set(move.clears) == {
            key for pair in before - after if move.key in pair for key in pair if key != move.key
        }
        assert move.text()
    left = {one.key for one in found.left}
    assert left == {key for pair in after for key in pair if key.startswith("T")}
    assert all(one.blocked_by for one in found.left)
    assert found.bound_s <= found.objective_s


def test_rules_and_owners_are_cleared_as_they_are_detected() -> None:
    """More is cleared for pairs that a rule keeps further apart, nothing for those that it allows or of one owner."""
    scene, areas, tracks = scene_of(3)
    tracks = [
        replace(one, object_class=("ferry", "tug", None)[i % 3], owner="us" if i % 4 == 0 else None)
        for i, one in enumerate(tracks)
    ]
    rules = [Rule("ferry", "tug", 15_000.0), Rule("tug", "track", allowed=True), Rule("ferry", "area", time_s=600.0)]
    ruled = replace(scene, rules=rules)
    plain, found = (resolve(tracks, areas, one, within_s=4 * 3600.0) for one in (scene, ruled))
    assert found.moves
    assert {one.key for one in found.moves} != {one.key for one in plain.moves}
    moves = {one.key: one for one in found.moves}
    changed = [later(one, round(moves[one.key].delay_s * 1e6)) if one.key in moves else one for one in tracks]
    left = {one.key for one in found.left}
    assert all({one.a_key, one.b_key} & left for one in solve(changed, areas, ruled))
    assert {key for one in found.moves for key in one.clears} <= {
        key for one in solve(tracks, areas, ruled) for key in (one.a_key, one.b_key)
    }


def test_scenes_are_cleared() -> None:
    """A proposal clears what it says, makes no new conflict, and names what is left."""
    for seed in range(12):
        check(seed, within_s=6 * 3600.0)
    for seed in range(12, 16):
        check(seed, goal="largest", now=T0_US - 10**14, slowest=0.5, fastest=1.5)


@pytest.mark.slow
def test_thousand_scenes_are_cleared() -> None:
    """The same for a thousand scenes."""
    for seed in range(1000):
        check(seed, within_s=6 * 3600.0, slowest=0.7 if seed % 3 == 0 else 1.0, now=T0_US if seed % 2 else None)


RADIUS_M = 6371008.771415
SCENE = Scene("by hand", earth=EarthModel.SPHERE)


def voyage(key: str, start: tuple[float, float], end: tuple[float, float]) -> Track:
    lasts_s = RADIUS_M * np.radians(np.hypot(end[0] - start[0], end[1] - start[1])) / 8.0
    times = [T0_US, T0_US + round(1e6 * lasts_s)]
    return Track(key, [start, end], times, rectangle_outline_m(300.0, 200.0, 50.0, 50.0))


FERRY = voyage("FERRY", (0.0, 0.0), (1.0, 0.0))
TOW = voyage("TOW", (0.5, -0.5), (0.5, 0.5))


def test_move_is_explained() -> None:
    """A move says how much later the track is, how it passes the other, and what it clears."""
    found = resolve([FERRY, TOW], [], SCENE, keep=["TOW"])
    [move] = found.moves
    assert move.key == "FERRY"
    assert move.clears == ("TOW",)
    assert move.text() == (
        "FERRY departs 2026-05-28 20:27:55.176779 UTC (1 min 16 s later): passes astern of TOW by 1.0 m; "
        "clears 1 conflict, makes none"
    )
    assert [one.side for one in move.passes] == [Side.ASTERN]
    assert found.objective_s == found.bound_s == move.delay_s
    assert found.as_json()["moves"][0]["text"] == move.text()


def test_a_rounded_move_names_what_keeps_it_from_a_smaller_delay() -> None:
    """A ferry that clears a tow would meet an area then, and comes after it."""
    tow = replace(TOW, outline_m=rectangle_outline_m(1500, 1500, 500, 500))
    area = Area("A", shapely.box(0.2, -0.1, 0.21, 0.1), None, T0_US + 3010 * SECOND, T0_US + 4000 * SECOND)
    for round_s in (0.0, 600.0):
        found = resolve([FERRY, tow], [area], SCENE, keys=["FERRY"], round_s=round_s)
        [move] = found.moves
        assert move.clears == ("TOW",)
        assert [(one.key, one.side) for one in move.passes] == [("A", Side.AFTER), ("TOW", Side.ASTERN)]


def test_margins_and_clock_times_are_kept() -> None:
    """Of random scenes: after the moves a detection with the margin finds nothing; departures are whole minutes."""
    moves = 0
    for seed in range(8):
        scene, areas, tracks = plain_scene(LOW_LATITUDE, seed, 3, 9)
        asked = {"within_s": 6 * 3600.0, "margin_s": 300.0, "margin_m": 926.0, "round_s": 60.0}
        movable = [area.key for area in areas]
        found = resolve(tracks, areas, scene, movable=movable, **asked)  # type: ignore[arg-type]
        of_key = {move.key: move for move in found.moves}
        now = [later(one, round(1e6 * of_key[one.key].delay_s)) if one.key in of_key else one for one in tracks]
        there = [later(one, round(1e6 * of_key[one.key].delay_s)) if one.key in of_key else one for one in areas]
        wider = replace(scene, separation_m=scene.separation_m + 926.0, time_separation_s=300.0)
        left = {one.key for one in found.left}
        for one in solve(now, there, wider):
            assert {one.a_key, one.b_key} <= left, (seed, one)
        for move in found.moves:
            assert move.departs_at is not None
            assert (move.departs_at.second, move.departs_at.microsecond) == (0, 0)
            assert move.is_area == (move.key in movable)
        moves += len(found.moves)
        assert (found.margin_s, found.margin_m) == (300.0, 926.0)
    assert moves > 10


def test_what_is_rounded_is_checked_with_the_others() -> None:
    """Two ships behind each other take other minutes; a gap without a whole minute takes a second of it."""
    clock = Clock(step_us=60 * SECOND)
    apart = Spans(np.array([-90 * SECOND]), np.array([90 * SECOND]))
    single = [Spans(np.array([-10 * SECOND]), np.array([low * SECOND])) for low in (25, 116)]
    high = np.array([FEVER, FEVER]).astype(np.int64)
    program = Program(np.zeros(2, np.int64), high, np.ones(2), single, {(0, 1): apart})
    delays = np.array([25 * SECOND + 1, 116 * SECOND + 1])
    found = rounded_delays(program, delays, [0, 0], clock)
    assert found.tolist() == [60 * SECOND, 180 * SECOND]
    narrow = [Spans(np.array([0, 40 * SECOND]), np.array([25 * SECOND, 300 * SECOND])), NOTHING]
    program = Program(np.zeros(2, np.int64), np.full(2, 200 * SECOND), np.ones(2), narrow, {})
    found = rounded_delays(program, np.array([25 * SECOND + 1, 0]), [0, 0], clock)
    assert found.tolist() == [26 * SECOND, 0]
    assert rounded_delays(program, np.array([25 * SECOND + 1, 0]), [0, 0], Clock(step_us=0))[0] == 25 * SECOND + 1


def test_an_area_moves_only_if_it_is_movable() -> None:
    area = Area("A", shapely.box(0.4, -0.1, 0.6, 0.1), None, T0_US, T0_US + 3600 * 24 * SECOND)
    alone = resolve([FERRY], [area], SCENE, keep=["FERRY"], within_s=200_000.0)
    assert alone.moves == ()
    found = resolve([FERRY], [area], SCENE, keep=["FERRY"], movable=["A"], within_s=200_000.0, round_s=60.0)
    [move] = found.moves
    assert move.text().startswith("A is active from 2026-05-28 22:47 UTC (2 h 20 min 20 s later)")
    assert "comes after FERRY; clears 1 conflict" in move.text()
    for movable, says in (("A", "must be a list"), (["FERRY"], "is a track"), (["B"], "is not known")):
        with pytest.raises(InvalidInput, match=says):
            resolve([FERRY], [area], SCENE, movable=movable)
    weekly = Area("W", area.footprint, schedule={"periods": [["00:00", "24:00"]]})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = resolve([FERRY], [weekly], SCENE, keep=["FERRY"], movable=["W"])
    assert "area 'W' stays as planned: its times follow a schedule" in found.notes


def test_a_track_that_leaves_after_another_arrived_does_not_pass_astern_of_it() -> None:
    """Two ferries from one berth, the second with a longer time of departure forbidden than the first is under way."""
    again = replace(FERRY, key="AGAIN", times_us=FERRY.times_us + SECOND)
    scene = replace(SCENE, time_separation_s=15_000.0)
    [move] = resolve([FERRY, again], [], scene, keep=["FERRY"], within_s=86_400.0).moves
    assert [one.side for one in move.passes] == [Side.AFTER]
    assert "comes after FERRY" in move.text()


def test_plans_that_have_not_begun_may_be_earlier() -> None:
    """A track passes ahead if that is less of a change; one that has begun stays."""
    slow = replace(FERRY, times_us=FERRY.times_us - 40 * SECOND)
    [move] = resolve([slow, TOW], [], SCENE, keys=["FERRY"], now=T0_US - 3600 * SECOND).moves
    assert move.delay_s < 0.0
    assert move.passes[0].side is Side.AHEAD
    begun = resolve([slow, TOW], [], SCENE, keys=["FERRY"], now=T0_US + SECOND)
    assert begun.moves == ()
    assert {one.key for one in begun.left} == {"FERRY", "TOW"}


def test_permanent_area_blocks() -> None:
    """A track across a permanent area is left, and the answer names the area."""
    area = Area("A", shapely.box(0.4, -0.1, 0.45, 0.1))
    found = resolve([FERRY, TOW], [area], SCENE)
    assert [(one.key, one.blocked_by) for one in found.left] == [("FERRY", ("A",))]
    assert [move.key for move in found.moves] == ["TOW"]


def test_speed_clears_what_no_delay_does() -> None:
    """A track that may not be later goes at another speed."""
    found = resolve([FERRY, TOW], [], SCENE, keys=["FERRY"], within_s=1.0, slowest=0.5, fastest=1.5)
    [move] = found.moves
    assert move.delay_s == 0.0
    assert move.speed != 1.0
    assert found.left == ()
    assert "of its speed" in move.text()


def test_detour_clears_what_nothing_else_does() -> None:
    """A track across a permanent area goes around it, within the limits, and makes no conflict with others."""
    area = Area("A", shapely.box(0.4, -0.02, 0.45, 0.02))
    found = resolve([FERRY, TOW], [area], SCENE, aside_m=8000.0)
    moves = {one.key: one for one in found.moves}
    assert found.left == ()
    way = moves["FERRY"].detour
    assert way is not None
    assert way.later_s <= 7200.0
    assert moves["FERRY"].clears == ("A", "TOW")
    assert moves["FERRY"].passes[0].side is Side.CLEAR
    assert moves["FERRY"].text().startswith("FERRY via 00°0")
    assert "keeps clear of A, keeps clear of TOW by " in moves["FERRY"].text()
    changed = [moved(SCENE, one, moves[one.key]) if one.key in moves else one for one in (FERRY, TOW)]
    assert solve(changed, [area], SCENE) == []
    assert changed[0].times_us[0] == FERRY.times_us[0]
    changing = replace(FERRY, floors_m=[0.0], ceilings_m=[10.0])
    for track, given in (
        (FERRY, {"aside_m": 0.0}),
        (FERRY, {"aside_m": 100.0}),
        (FERRY, {"aside_m": 8000.0, "within_s": 1.0}),
        (FERRY, {"aside_m": 8000.0, "now": T0_US + SECOND}),
        (changing, {"aside_m": 8000.0}),
    ):
        found = resolve([track, TOW], [area], SCENE, **given)
        assert "FERRY" in {one.key for one in found.left}
        assert [one.split(":")[0] for one in found.notes] == ["track 'FERRY' gets no new waypoints"] * (
            track is changing
        )


def test_detour_across_the_date_line() -> None:
    """A track near the date line, and 80 N, gets waypoints on both sides of it; the text has their usual longitudes."""
    for lat in (0.0, 80.0):
        track = voyage("FERRY", (179.6, lat), (180.6, lat))
        area = Area("A", shapely.box(180.0 - 360.0, lat - 0.02, 180.05 - 360.0, lat + 0.02))
        [move] = resolve([track], [area], SCENE, aside_m=8000.0).moves
        assert move.detour is not None
        assert all(abs(lon - 180.0) < 1.0 for lon, _ in move.detour.waypoints_deg)
        assert solve([moved(SCENE, track, move)], [area], SCENE) == []
    one = replace(move, detour=replace(move.detour, waypoints_deg=((181.0, -2.0),)))
    assert "via 02°00.000'S 179°00.000'W on leg 1" in one.text()


def test_weights_decide_who_moves() -> None:
    """The cheaper of two tracks is later."""
    for dear, cheap in (("FERRY", "TOW"), ("TOW", "FERRY")):
        [move] = resolve([FERRY, TOW], [], SCENE, weights={dear: 9.0}).moves
        assert move.key == cheap


@pytest.mark.parametrize(
    ("a_class", "b_class", "yields", "moves"),
    [
        ("ferry", "tow", "a", "FERRY"),
        ("tow", "ferry", "a", "TOW"),
        ("ferry", "tow", "b", "TOW"),
        ("ferry", None, "b", "TOW"),
        ("track", "tow", "a", "FERRY"),
        ("area", "ferry", "b", None),
    ],
)
def test_yielding_track_moves(a_class: str, b_class: str | None, yields: str, moves: str | None) -> None:
    """The track that a rule names moves, whichever is cheaper."""
    plans = [replace(FERRY, object_class="ferry"), replace(TOW, object_class="tow")]
    scene = replace(SCENE, rules=[Rule(a_class, b_class, yields=yields)])
    found = {resolve(plans, [], scene, weights={key: 9.0}).moves[0].key for key in ("FERRY", "TOW")}
    assert found == ({moves} if moves else {"FERRY", "TOW"})


def test_area_that_yields_is_named() -> None:
    """An area that a rule lets yield does not move, and the answer says so; other rules say nothing."""
    ferry, area = replace(FERRY, object_class="ferry"), Area("A", shapely.box(0.4, -0.1, 0.45, 0.1))
    for a_class, b_class, yields, is_said in (
        ("area", "ferry", "a", True),
        (None, "ferry", "a", True),
        ("ferry", "area", "b", True),
        ("area", "ferry", "b", False),
        ("area", "tow", "a", False),
    ):
        found = resolve([ferry, TOW], [area], replace(SCENE, rules=[Rule(a_class, b_class, yields=yields)]))
        said = "area 'A' yields to 'FERRY' by a rule, but areas do not move"
        assert found.notes == ((said,) if is_said else ())
        assert found.as_json()["notes"] == found.notes
    assert (
        resolve([ferry], [area], replace(SCENE, rules=[Rule("area", "ferry", yields="a")]), keep=["FERRY"]).notes == ()
    )


@pytest.mark.parametrize("goal", ["total", "largest"])
def test_weights_at_their_limits_are_proven(goal: str) -> None:
    """Weights as far apart as allowed still have a proof."""
    found = resolve([FERRY, TOW], [], SCENE, weights={"FERRY": 1e6, "TOW": 1e-6}, goal=goal)
    assert [one.key for one in found.moves] == ["TOW"]
    assert found.is_least


def test_levels_and_kept_tracks_come_before_rules() -> None:
    """A caller's level, a kept track, and a track that no delay clears let the other one move."""
    plans = [replace(FERRY, object_class="ferry"), replace(TOW, object_class="tow")]
    scene = replace(SCENE, rules=[Rule("ferry", "tow", yields="a")])
    blocks = Area("A", shapely.box(0.4, -0.1, 0.45, 0.1))
    assert [one.key for one in resolve(plans, [], scene, levels={"FERRY": 1}).moves] == ["TOW"]
    assert [one.key for one in resolve(plans, [], scene, keep=["FERRY"]).moves] == ["TOW"]
    assert [one.key for one in resolve(plans, [blocks], scene).moves] == ["TOW"]


def test_circles_of_yielding_tracks_share_a_level() -> None:
    """A yields to B, B to C, C to A and to D, who is above them; E yields to nobody."""
    spans = Spans(np.array([-1]), np.array([1]))
    program = Program(
        np.zeros(5, np.int64),
        np.ones(5, np.int64),
        np.ones(5),
        [NOTHING] * 5,
        dict.fromkeys([(0, 1), (1, 2), (0, 2), (2, 3), (0, 4)], spans),
    )
    rules = [Rule(a, b, yields="a") for a, b in ("ab", "bc", "ca", "cd")]
    level = levels_of(program, np.zeros(5, np.int64), list("abcde"), ["track"] * 5, rules).tolist()
    assert level[0] == level[1] == level[2] < level[3] == level[4]
    assert levels_of(program, np.array([10**6, 0, -(10**6), 0, 0]), list("abcde"), ["track"] * 5, []).tolist() == [
        2,
        1,
        0,
        1,
        1,
    ]


@pytest.mark.parametrize(
    ("given", "part"),
    [
        ({"keys": ["X"]}, "'X' is not known"),
        ({"keys": ["A"]}, "'A' is an area, and moves only if it is movable"),
        ({"keys": "FERRY"}, "must be a list of keys; got the text 'FERRY'"),
        ({"keep": ["X"]}, "'X' is not known"),
        ({"within_s": -1.0}, "within_s"),
        ({"within_s": float("nan")}, "within_s"),
        ({"within_s": 1e8}, "within_s"),
        ({"limit_s": float("inf")}, "limit_s"),
        ({"goal": "least"}, "must be one of total, largest"),
        ({"weights": {"FERRY": 0.0}}, "must be a number from 1e-06 to 1e"),
        ({"weights": {"FERRY": 1e300}}, "must be a number from 1e-06 to 1e"),
        ({"weights": {"FERRY": float("nan")}}, "must be a number from 1e-06 to 1e"),
        ({"levels": {"FERRY": 0.5}}, "must be a whole number"),
        ({"levels": {"FERRY": 2**70}}, "must be a whole number"),
        ({"slowest": 1.5}, "must be factors"),
        ({"aside_m": -1.0}, "aside_m"),
        ({"aside_m": float("nan")}, "aside_m"),
    ],
)
def test_wrong_input_is_refused(given: dict[str, object], part: str) -> None:
    """Unknown keys and limits that are none are refused by name."""
    with pytest.raises(InvalidInput, match=part):
        resolve([FERRY, TOW], [Area("A", shapely.box(5.0, 5.0, 6.0, 6.0))], SCENE, **given)


def test_nothing_to_do() -> None:
    """Scenes without objects or conflicts have an empty proposal that is the least."""
    for tracks in ([], [FERRY]):
        found = resolve(tracks, [], SCENE)
        assert (found.moves, found.left, found.objective_s, found.is_least) == ((), (), 0.0, True)


def test_chain_of_intervals() -> None:
    """Few intervals cover a span, or none if they leave a gap."""
    assert chain_of([0, 3, 2], [4, 9, 3], 0, 9) == [0, 1]
    assert chain_of([0, 6], [4, 9], 0, 9) == []
    assert chain_of([], [], 0, 9) == []


def test_solver_is_quiet() -> None:
    """Nothing that the solver prints is seen, also what C buffers."""
    code = (
        "import ctypes\n"
        "from conflictdb.memory import mixed_integer as m\n"
        "with m._quiet():\n    ctypes.CDLL(None).puts(b'noise')\n"
        "print('answer')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ, check=True)
    assert (done.stdout, done.stderr) == ("answer\n", "")


def test_least_shares_its_time() -> None:
    """Each component is solved, also after one that used its share."""
    span = Spans(np.array([-5 * SECOND]), np.array([5 * SECOND]))
    pair = {(2 * k, 2 * k + 1): span for k in range(20)}
    program = Program(np.zeros(40, np.int64), np.full(40, 60 * SECOND), np.ones(40), [NOTHING] * 40, pair)
    found = least(program, range(40), "total", 20.0)
    assert found.is_least
    assert found.objective_s == pytest.approx(100.00002)


def test_detours_meet_nothing() -> None:
    """Each way around a permanent area, checked by a detection; the shortest is about as short as can be."""
    area = Area("0", shapely.box(0.4, -0.02, 0.45, 0.02))
    found = detours([FERRY], [area], SCENE, key="FERRY", most_m=8000.0)
    assert found
    assert [one.longer_m for one in found] == sorted(one.longer_m for one in found)
    for one in found:
        assert solve([one.track], [area], SCENE) == []
        assert one.track.times_us[0] == FERRY.times_us[0]
        assert one.later_s == pytest.approx(one.longer_m / 8.0, rel=0.01)
    # Around the corner: at least the two sides of a triangle 2.2 km high.
    assert 0.0 < found[0].longer_m < 300.0
    with_tow = detours([FERRY, TOW], [area], SCENE, key="FERRY", most_m=8000.0)
    for one in with_tow:
        assert solve([one.track, TOW], [area], SCENE) == []


def test_detours_keep_what_changes_on_the_way() -> None:
    """Heights per leg and per waypoint, and outlines per waypoint, are those of the leg at the new waypoints."""
    outlines = np.stack([FERRY.outline_m, 2.0 * FERRY.outline_m])
    for heights in ([0.0], [0.0, 100.0]):
        track = replace(FERRY, floors_m=heights, ceilings_m=[one + 50.0 for one in heights], outlines_m=outlines)
        area = Area("A", shapely.box(0.4, -0.02, 0.45, 0.02), ceiling_m=1000.0)
        found = detours([track], [area], SCENE, key="FERRY", most_m=10_000.0)
        assert found
        assert all(solve([one.track], [area], SCENE) == [] for one in found)
    assert found[0].track.floors_m is not None
    assert (np.diff(found[0].track.floors_m) > 0.0).all()


def test_detours_refuse() -> None:
    area = Area("A", shapely.box(0.4, -3.0, 0.45, 3.0))
    assert detours([FERRY], [area], SCENE, key="FERRY") == []
    assert detours([FERRY], [Area("A", shapely.box(0.4, -0.02, 0.45, 0.02))], SCENE, key="FERRY", later_s=0.0) == []
    for key, part in (("A", "is an area"), ("X", "is not known")):
        with pytest.raises(InvalidInput, match=part):
            detours([FERRY], [area], SCENE, key=key)
