"""Departures that are in conflict, by hand: the same way, a crossing, areas, several objects, horizons, and input."""

import json
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
import shapely
from made_scenes import Kind, box
from shifting import meets_when_shifted

from conflictdb import Area, Delays, EarthModel, InvalidInput, Scene, Track, delays, rectangle_outline_m, solve
from conflictdb.core.delays import Differences, Spans
from conflictdb.model.inputs import EPOCH, MICROSECOND, certain
from conflictdb.model.plans import Intervals
from conflictdb.model.results import Closed

RADIUS_M = 6371008.771415
T0_US = 1_780_000_000_000_000
SPEED_MPS = 8.0
SCENE = Scene("by hand", earth=EarthModel.SPHERE, tolerance_m=0.0)


def track(key: str, start: tuple[float, float], end: tuple[float, float], departs_s: float, *sizes_m: float) -> Track:
    """A track on the equator or a meridian, at 8 m/s."""
    lasts_s = RADIUS_M * np.radians(np.hypot(end[0] - start[0], end[1] - start[1])) / SPEED_MPS
    times = [T0_US + round(1e6 * departs_s), T0_US + round(1e6 * (departs_s + lasts_s))]
    return Track(key, [start, end], times, rectangle_outline_m(*sizes_m))


EAST = track("east", (0.0, 0.0), (1.0, 0.0), 0.0, 1000.0, 500.0, 100.0, 100.0)
NORTH = track("north", (0.5, -0.5), (0.5, 0.5), 0.0, 300.0, 200.0, 50.0, 50.0)


def area(key: str, start_s: float | None = None, end_s: float | None = None, lon: float = 0.5) -> Area:
    """An area on the equator, there during [start_s, end_s)."""
    start, end = (None if s is None else T0_US + round(1e6 * s) for s in (start_s, end_s))
    return Area(key, shapely.box(lon - 0.1, -0.1, lon + 0.1, 0.1), None, start, end)


def ends_of(found: Delays) -> list[tuple[float, float]]:
    return [(one.from_s, one.to_s) for one in found.forbidden]


def near(low_s: float, high_s: float, error_s: float = 3e-6) -> list[tuple[object, object]]:
    """One interval with these ends, to the microseconds that ends are rounded by."""
    return [(pytest.approx(low_s, abs=error_s), pytest.approx(high_s, abs=error_s))]


def one_of(*objects: Track | Area, key: str = "east", within_s: float = 7200.0, scene: Scene = SCENE) -> Delays:
    tracks, areas = ([one for one in objects if isinstance(one, kind)] for kind in (Track, Area))
    [found] = delays(tracks, areas, scene, key, within_s)
    return found


def test_two_on_the_same_way_and_at_the_same_speed() -> None:
    """Their contact set is a band along the diagonal: both ends are borders of it."""
    later = replace(EAST, key="later", times_us=EAST.times_us + 3_600_000_000)
    found = one_of(EAST, later)
    assert ends_of(found) == near(3600 - 1500 / SPEED_MPS, 3600 + 1500 / SPEED_MPS)
    assert found.forbidden[0].is_proven
    assert found.forbidden[0].by == ("later",)
    assert max(found.forbidden[0].from_error_s, found.forbidden[0].to_error_s) <= 5e-6
    assert (found.least_later_s, found.least_earlier_s, found.blocked_by) == (0.0, 0.0, ())
    assert found.clear_by_s == pytest.approx(3600 - 1500 / SPEED_MPS, abs=3e-6)


def test_a_crossing_mirrors() -> None:
    found, mirrored = (one_of(EAST, NORTH, key=key) for key in ("east", "north"))
    by_hand = -(500 + 50 + 300 + 100) / SPEED_MPS, (1000 + 50 + 200 + 100) / SPEED_MPS
    assert ends_of(found) == near(*by_hand)
    assert ends_of(mirrored) == [(-found.forbidden[0].to_s, -found.forbidden[0].from_s)]
    assert found.least_later_s == round(found.forbidden[0].to_s + 1e-6, 6)
    assert found.least_earlier_s == round(1e-6 - found.forbidden[0].from_s, 6)
    assert found.clear_by_s == 0.0


def test_an_area_with_times_forbids_what_reaches_it_while_it_is_there() -> None:
    first_s = (RADIUS_M * np.radians(0.4) - 1000) / SPEED_MPS
    last_s = (RADIUS_M * np.radians(0.6) + 500) / SPEED_MPS
    found = one_of(EAST, area("closed", 20_000, 21_000), within_s=40_000.0)
    assert ends_of(found) == near(20_000 - last_s, 21_000 - first_s)
    assert found.forbidden[0].is_proven
    before, after = one_of(EAST, area("closed", None, 1000)), one_of(EAST, area("closed", 9000, None))
    assert ends_of(before) == near(-7200.0, 1000 - first_s)
    assert ends_of(after) == near(9000 - last_s, 7200.0)
    assert ends_of(one_of(EAST, area("closed", 4000, None))) == near(4000 - last_s, 7200.0)
    assert one_of(EAST, area("closed", 4000, None)).least_later_s is None
    assert (after.forbidden[0].to_error_s, after.least_later_s) == (0.0, 0.0)


def test_a_permanent_area_is_something_that_no_delay_clears() -> None:
    found = one_of(EAST, NORTH, area("for ever"))
    assert ends_of(found) == [(-7200.0, 7200.0)]
    assert found.forbidden[0].is_proven
    assert found.forbidden[0].by == ("for ever", "north")
    assert (found.least_later_s, found.least_earlier_s, found.blocked_by) == (None, None, ("for ever",))
    assert one_of(EAST, area("aside", lon=3.0)).forbidden == ()
    assert one_of(EAST, area("aside", lon=3.0)).clear_by_s is None


def test_the_least_delay_clears_all_conflicts_and_a_little_less_does_not() -> None:
    """Through `solve`; forbidden intervals of several objects that overlap are one."""
    second = replace(NORTH, key="second", times_us=NORTH.times_us + 200_000_000)
    found = one_of(EAST, NORTH, second)
    [forbidden] = found.forbidden
    assert forbidden.by == ("north", "second")
    for least_s, sign, error_s in (
        (found.least_later_s, 1, forbidden.to_error_s),
        (found.least_earlier_s, -1, forbidden.from_error_s),
    ):
        assert least_s is not None
        for shift_s, meets in ((least_s, False), (least_s - error_s - 1e-5, True)):
            moved = replace(EAST, times_us=EAST.times_us + sign * round(1e6 * shift_s))
            assert any("east" in (one.a_key, one.b_key) for one in solve([moved, NORTH, second], [], SCENE)) == meets


def test_heights_that_do_not_overlap_forbid_nothing() -> None:
    assert one_of(replace(EAST, floor_m=100.0), replace(NORTH, ceiling_m=100.0)).forbidden == ()


def test_a_separation_and_a_tolerance_widen_what_is_forbidden() -> None:
    narrow, wide, wider = (
        one_of(EAST, NORTH, scene=replace(SCENE, separation_m=separation_m, tolerance_m=tolerance_m)).forbidden[0]
        for separation_m, tolerance_m in ((0.0, 0.0), (500.0, 0.0), (500.0, 100.0))
    )
    assert wider.from_s < wide.from_s < narrow.from_s < narrow.to_s < wide.to_s < wider.to_s


def test_what_cannot_be_cut_forbids_every_delay_at_which_it_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cover; nothing of it is proven."""
    from conflictdb.core.pieces import covers

    def fail(*_: object) -> None:
        raise ValueError("cannot be cut")

    monkeypatch.setattr(covers, "area_pieces", fail)
    found = one_of(EAST, area("uncut", 20_000, 21_000, lon=3.0), within_s=40_000.0)
    end_s = (EAST.times_us[1] - T0_US) / 1e6
    assert ends_of(found) == near(20_000 - end_s, 21_000, 1e-5)
    assert not found.forbidden[0].is_proven
    assert found.forbidden[0].from_error_s == pytest.approx(1000 + end_s, abs=1e-5)


def test_a_track_that_cannot_be_cut_may_wait_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """So a later object forbids every later departure; an object before the planned departure forbids none."""
    from conflictdb.core.pieces import covers

    def fail(*_: object) -> None:
        raise ValueError("cannot be cut")

    monkeypatch.setattr(covers, "track_pieces", fail)
    for waits_s in (0.0, 600.0):
        uncut = waits_first(EAST, waits_s) if waits_s else EAST
        [found] = one_of(uncut, area("aside", 3000, 4000, lon=30.0), within_s=40_000.0).forbidden
        assert (found.to_s, found.is_proven) == (40_000.0, False)
        assert one_of(uncut, area("before", -9000, -8000), within_s=40_000.0).forbidden[0].to_s < 0.0


def test_the_json_has_the_documented_members() -> None:
    found = json.loads(json.dumps(one_of(EAST, NORTH).as_json()))
    assert list(found) == [
        *("key", "forbidden", "least_later_s", "least_earlier_s", "blocked_by"),
        *("waits", "has_departed", "earliest_s", "latest_s", "clear_within_m", "clear_by_m", "clear_error_m"),
        *("departs_at", "margin_s", "margin_m", "slots", "closed"),
    ]
    assert list(found["forbidden"][0]) == ["from_s", "to_s", "from_error_s", "to_error_s", "is_proven", "by"]


def test_a_horizon_of_nothing_and_one_of_years() -> None:
    found = one_of(EAST, NORTH, within_s=0.0)
    assert ends_of(found) == [(0.0, 0.0)]
    assert (found.least_later_s, found.least_earlier_s) == (None, None)
    assert ends_of(one_of(EAST, NORTH, within_s=1e9)) == ends_of(one_of(EAST, NORTH))


def test_all_tracks_are_asked_about_one_at_a_time() -> None:
    found = delays([NORTH, EAST], [area("closed", 0, 1000)], SCENE)
    assert [one.key for one in found] == ["east", "north"]
    assert found == [one_of(NORTH, EAST, area("closed", 0, 1000), key=key) for key in ("east", "north")]
    assert delays([NORTH, EAST], [area("closed", 0, 1000)], SCENE, ["north", "east", "north"]) == found
    assert delays([NORTH, EAST], [area("closed", 0, 1000)], SCENE, ["north"]) == found[1:]
    assert delays([NORTH, EAST], [], SCENE, []) == []
    assert delays([], [area("closed")], SCENE) == []
    assert delays([EAST], [])[0].forbidden == ()


def waits_first(track: Track, waits_s: float) -> Track:
    """The track, after a leg that stands still at its first waypoint."""
    positions = np.concatenate([track.positions_deg[:1], track.positions_deg])
    times_us = np.concatenate([track.times_us[:1] - round(1e6 * waits_s), track.times_us])
    return replace(track, positions_deg=positions, times_us=times_us)


def test_a_track_whose_first_leg_stands_still_waits_there() -> None:
    """So an object that passes while it waits forbids every later departure; an earlier departure does not wait."""
    waiting = waits_first(EAST, 600.0)
    by = replace(NORTH, key="by", positions_deg=NORTH.positions_deg - [0.5, 0.0])
    [plain], [found] = (one_of(track, by, within_s=20_000.0).forbidden for track in (EAST, waiting))
    assert plain.to_s < 8000.0
    assert found.to_s == 20_000.0
    assert found.from_s == pytest.approx(plain.from_s, abs=3e-6)
    assert found.is_proven
    # It passes before the track begins, after the horizon, or below it.
    gone = replace(by, times_us=by.times_us - 9_000_000_000)
    assert all(one.to_s < 0.0 for one in one_of(waiting, gone, within_s=20_000.0).forbidden)
    assert one_of(waiting, by, within_s=1000.0).forbidden == ()
    assert one_of(replace(waiting, floor_m=0.0), replace(by, ceiling_m=0.0), within_s=20_000.0).forbidden == ()


@pytest.mark.parametrize("intervals", list(Intervals))
def test_each_voyage_of_a_track_waits_at_its_first_waypoint(intervals: Intervals) -> None:
    """Also of voyages that follow each other at once, with closed intervals."""
    scene, there_s = replace(SCENE, intervals=intervals), 4000.0
    loop = [(0.0, 0.0), (0.0, 0.0), (0.1, 0.0), (0.0, 0.0)]
    departs_us = [T0_US + round(1e6 * s) for s in (0.0, 2.0 * there_s, 3.0 * there_s)]
    times_us = [T0_US + round(1e6 * s) for s in (0.0, 600.0, 2000.0, there_s)]
    ferry = Track("ferry", loop, times_us, [(0.0, 0.0)], departures_us=departs_us)
    # It passes when the second voyage could wait; the third begins as the second ends.
    for late_s in (2.0 * there_s + 2500.0, 3.0 * there_s + 3000.0):
        passes_us = T0_US + round(1e6 * late_s)
        by = Track("by", [(0.0, -0.01), (0.0, 0.01)], [passes_us, passes_us + 60_000_000], [(0.0, 0.0)])
        found = one_of(ferry, by, key="ferry", scene=scene)
        shifts_us = np.unique([round(1e6 * s) for s in range(-7200, 7201, 300)])
        for shift_us in shifts_us.tolist():
            met = bool(solve([*late_voyages(ferry, shift_us), by], [], scene))
            is_forbidden = any(one.from_s <= shift_us / 1e6 <= one.to_s for one in found.forbidden)
            assert met == is_forbidden, (late_s, shift_us)


def late_voyages(track: Track, shift_us: int) -> list[Track]:
    """Each voyage of a track that much later, as a track of one owner; it waits from its planned start on."""
    since_us = track.times_us - track.times_us[0]
    voyages = []
    for n, departs_us in enumerate(track.departures_us or ()):
        times_us, places = departs_us + shift_us + since_us, track.positions_deg
        if shift_us > 0:
            times_us, places = np.append(departs_us, times_us), np.concatenate([places[:1], places])
        voyages.append(Track(f"voyage {n}", places, times_us, track.outline_m, owner="one"))
    return voyages


def test_a_stop_across_the_antimeridian_is_a_stop() -> None:
    """-180 and 180 degrees are one place; so are all longitudes of a pole."""
    times_us = [T0_US, T0_US + 10**9, T0_US + 10**10]
    stops = Track("stops", [(180.0, 0.0), (-180.0, 0.0), (-179.0, 0.0)], times_us, [(0.0, 0.0)])
    assert one_of(stops, key="stops").waits
    by = Track("by", [(180.0, -0.1), (180.0, 0.1)], [T0_US + 2 * 10**9, T0_US + 3 * 10**9], [(0.0, 0.0)])
    [found] = one_of(stops, by, key="stops").forbidden
    assert found.to_s == 7200.0


def test_a_short_window_of_departure_is_no_stop() -> None:
    """Its derived haven begins with a part that stands still; the voyage does not."""
    tolerances = {"departure_window": [T0_US, T0_US + 4000]}
    sails = Track("sails", [(0.0, 0.0), (1.0, 0.0)], [T0_US, T0_US + 10**10], [(0.0, 0.0)], tolerances=tolerances)
    by = Track("by", [(0.0, -0.1), (0.0, 0.1)], [T0_US + 2 * 10**9, T0_US + 3 * 10**9], [(0.0, 0.0)])
    found = one_of(sails, by, key="sails")
    assert not found.waits
    assert all(each.to_s < 4000.0 for each in found.forbidden)


def test_an_area_at_the_first_waypoint_forbids_every_departure_from_when_it_is_there() -> None:
    closed = area("closed", 3000, 4000, lon=-0.095)
    [found] = one_of(waits_first(EAST, 600.0), closed, within_s=20_000.0).forbidden
    # The haven leaves the area as soon as it moves. Until then it is on its way, and waits from -600 s on.
    assert (found.to_s, found.is_proven) == (20_000.0, True)
    assert found.from_s == one_of(EAST, closed, within_s=20_000.0).forbidden[0].from_s
    assert one_of(EAST, closed, within_s=20_000.0).forbidden[0].to_s == pytest.approx(4000.0, abs=3e-6)


def test_a_haven_that_changes_its_shape_may_leave_an_area_and_meet_it_again() -> None:
    """Its port side shrinks away from the area, its bow grows towards it: two intervals, and free delays between."""
    degrees = np.degrees(1000.0 / RADIUS_M)
    wedge = shapely.Polygon([(0.0, degrees), (80 * degrees, 0.0), (120 * degrees, 0.0), (120 * degrees, degrees)])
    closed = Area("wedge", wedge, None, T0_US + 20_000_000_000, T0_US + 20_100_000_000)
    outlines_m = [[(-port, 0.0), (0.0, -50.0), (50.0, 0.0), (0.0, bow)] for port, bow in ((1100, 100), (50, 30_000))]
    track = Track(
        "east",
        [(0.0, 0.0), (60 * degrees, 0.0)],
        [T0_US, T0_US + 7_500_000_000],
        outlines_m[0],
        outlines_m=outlines_m,
    )
    first, second = one_of(track, closed, within_s=40_000.0).forbidden
    assert first.is_proven
    assert second.is_proven
    assert first.to_s < 14_000.0 < 17_000.0 < second.from_s
    shifts_us = np.array([13_000, 14_000, 17_000, 18_000]) * 1_000_000
    met = meets_when_shifted(SCENE, [closed], [track], "east", shifts_us)
    assert [bool(keys) for keys in met] == [True, False, False, True]


def at(s: float) -> np.datetime64:
    """The instant `s` seconds after east departs."""
    return np.datetime64(T0_US + round(1e6 * s), "us")


def test_nothing_departs_before_now() -> None:
    """An earlier departure is not offered if it is past; the forbidden departures stay the same."""
    [free] = delays([EAST, NORTH], [], SCENE, "east")
    least_s = free.least_earlier_s
    assert least_s is not None
    for now_s, earliest_s, offered_s in (
        (-9000.0, -7200.0, least_s),
        (-least_s, -least_s, least_s),
        (-least_s + 1e-6, -least_s + 1e-6, None),
        (0.0, 0.0, None),
    ):
        [found] = delays([EAST, NORTH], [], SCENE, "east", now=at(now_s))
        assert found == replace(free, least_earlier_s=offered_s, earliest_s=pytest.approx(earliest_s, abs=1e-7))
    assert (free.waits, free.has_departed, free.earliest_s, free.latest_s) == (False, False, -7200.0, 7200.0)


def test_what_has_departed_cannot_shift() -> None:
    """Whatever it meets as planned blocks it; without a conflict it departed well."""
    [found] = delays([EAST, NORTH], [], SCENE, "east", now=at(1e-6))
    assert (found.has_departed, found.earliest_s, found.latest_s) == (True, 0.0, 0.0)
    assert (found.least_later_s, found.least_earlier_s, found.blocked_by) == (None, None, ("north",))
    assert found.forbidden == one_of(EAST, NORTH).forbidden
    [clear] = delays([EAST], [], SCENE, "east", now=at(1.0))
    assert (clear.least_later_s, clear.least_earlier_s, clear.blocked_by) == (0.0, 0.0, ())


def test_a_track_that_stands_at_its_first_waypoint_may_still_leave() -> None:
    """Before its start it shifts as others do; it has departed once its legs that stand still are over."""
    waiting = waits_first(waits_first(EAST, 600.0), 300.0)
    for now_s, has_departed, earliest_s in (
        (-1000.0, False, -100.0),
        (-900.0, False, 0.0),
        (-800.0, False, -800.0),
        (0.0, False, 0.0),
        (1.0, True, 0.0),
    ):
        [found] = delays([waiting, NORTH], [], SCENE, "east", now=at(now_s))
        assert (found.waits, found.has_departed) == (True, has_departed)
        assert found.earliest_s == earliest_s
    stands = Track("stands", [(0.0, 0.0)] * 2, [T0_US, T0_US + 1_000_000], [(0.0, 0.0)])
    assert not delays([stands], [], SCENE, now=at(1.0))[0].has_departed
    assert delays([stands], [], SCENE, now=at(1.1))[0].has_departed


def test_an_area_that_forbids_every_departure_from_now_on_blocks() -> None:
    closed = area("closed", 0.0, None, lon=0.2)
    free = one_of(EAST, closed)
    assert (free.least_earlier_s is None, free.blocked_by) == (False, ())
    [found] = delays([EAST], [closed], SCENE, "east", now=at(-1000.0))
    assert (found.least_earlier_s, found.blocked_by) == (None, ("closed",))


def test_windows_that_no_departure_reaches_have_no_rows() -> None:
    """Before now, after all that is asked about, and of a track that has departed."""
    closed = area("closed", -90_000.0, 90_000.0)
    for given in (
        {"now": at(0.0), "start": at(-7200.0), "end": at(-3600.0)},
        {"now": at(60.0), "start": at(3600.0), "end": at(7200.0)},
    ):
        [found] = delays([EAST], [closed], SCENE, "east", **given)  # type: ignore[arg-type]
        assert (found.slots, found.closed) == ((), ())


def test_an_object_blocks_only_if_its_intervals_cover_every_possible_delay() -> None:
    """Of three: one reaches both ends and leaves a gap, one covers all in two parts, one ends before the range."""
    both, parts, early, rest = 1, 2, 3, 4
    rows = [(both, 0, 4), (both, 6, 10), (parts, -3, 5), (parts, 6, 12), (early, -9, -2), (early, 9, 20), (rest, 0, 10)]
    other, low, high = np.array(rows, np.int64).T
    found = Differences.of_intervals(other, low, high, np.zeros(len(rows), np.bool_))
    assert found.blocking(0, 10) == {parts, rest}
    assert found.blocking(7, 10) == {both, parts, rest}
    assert found.blocking(0, 11) == {parts}


@pytest.mark.parametrize("within_s", [-1.0, np.nan, np.inf, "2h"])
def test_a_horizon_that_is_none_is_refused(within_s: float) -> None:
    with pytest.raises(InvalidInput, match="within_s"):
        delays([EAST], [], SCENE, within_s=within_s)


def test_other_input_is_refused() -> None:
    with pytest.raises(InvalidInput, match="'south' is not known"):
        delays([EAST], [], SCENE, "south")
    with pytest.raises(InvalidInput, match="clear_within_m: is of tracks: 'closed' is an area"):
        delays([EAST], [area("closed")], SCENE, "closed", clear_within_m=1.0)
    with pytest.raises(InvalidInput, match="'closed' is an area, which does not depart"):
        delays([EAST], [area("closed")], SCENE, "closed", waypoint=1)
    for start, end in ((EAST.times_us[0], None), (None, EAST.times_us[0])):
        with pytest.raises(InvalidInput, match="start: needs the key of one track or area"):
            delays([EAST, NORTH], [], SCENE, start=start, end=end)
    with pytest.raises(InvalidInput, match="'south' is not known"):
        delays([EAST], [], SCENE, "south", start=EAST.times_us[0])
    with pytest.raises(InvalidInput, match="'closed': start: is for a plan with a departure of its own"):
        delays([EAST], [area("closed")], SCENE, "closed", start=EAST.times_us[0])
    for name, other, far_s in (("start", "end", 7201.0), ("end", "start", -7201.0)):
        with pytest.raises(InvalidInput, match=f"{name}: is farther from the departure than within_s: give {other}"):
            delays([EAST], [], SCENE, "east", **{name: at(far_s)})  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="start: must not be after end"):
        delays([EAST], [], SCENE, "east", start=EAST.times_us[1], end=EAST.times_us[0])
    for name in ("margin_s", "margin_m"):
        for given in (-1.0, float("nan"), float("inf"), "5m", True):
            with pytest.raises(InvalidInput, match=f"{name}: must be"):
                delays([EAST], [], SCENE, **{name: given})  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="time_separation_s: with the margin it must be"):
        delays([EAST], [], SCENE, margin_s=1e8)
    for best in (0, -1, 1.5, True):
        with pytest.raises(InvalidInput, match="best: must be"):
            delays([EAST], [], SCENE, "east", best=best)  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="are they swapped"):
        delays([area("closed")], [EAST], SCENE)  # type: ignore[list-item]
    with pytest.raises(InvalidInput, match="occurs more than once"):
        delays([EAST, EAST], [], SCENE)
    with pytest.raises(InvalidInput, match="now: must be an aware datetime"):
        delays([EAST], [], SCENE, now="noon")  # type: ignore[arg-type]
    with pytest.raises(InvalidInput, match="must be a Scene"):
        delays([EAST], [], "scene")  # type: ignore[arg-type]


def test_a_track_that_ends_before_another_begins_meets_it_if_it_is_late() -> None:
    """Candidates are looked for without regard to time."""
    later = replace(NORTH, key="later", times_us=NORTH.times_us + 40_000_000_000)
    assert solve([EAST, later], [], SCENE) == []
    found = one_of(EAST, later, within_s=50_000.0)
    middle_us = round(5e5 * (found.forbidden[0].from_s + found.forbidden[0].to_s))
    assert found.least_later_s == 0.0
    assert meets_when_shifted(SCENE, [], [EAST, later], "east", np.array([0, middle_us])) == [set(), {"later"}]


def test_intervals_of_all_tracks_are_joined_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not track by track: two unions, of outer and of inner intervals, for any number of tracks."""
    unions: list[int] = []
    union = Spans.union

    def counted(low: np.ndarray, high: np.ndarray) -> Spans:
        unions.append(len(low))
        return union(low, high)

    _, areas, tracks = box(Kind.MIXED, 60, 1)
    expected = [delays(tracks, areas, key=one.key)[0] for one in tracks]
    monkeypatch.setattr(Spans, "union", staticmethod(counted))
    monkeypatch.setattr(Differences, "blocking", lambda *_: set())
    found = delays(tracks, areas)
    assert len(unions) == 2
    assert [one.forbidden for one in found] == [one.forbidden for one in sorted(expected, key=lambda one: one.key)]
    assert any(one.forbidden for one in found)


@pytest.mark.parametrize(
    "spans", [((0, 9000), (3000, 12_000)), ((None, 9000), (3000, 12_000)), ((0, 9000), (3000, None))]
)
def test_departures_that_several_areas_close_are_free_if_each_changes(
    spans: tuple[tuple[float | None, float | None], ...],
) -> None:
    """As another computation with the changed areas says; a millisecond less of one change is not enough."""
    areas = {key: area(key, *span, lon=lon) for key, span, lon in zip("AB", spans, (0.5, 0.6), strict=True)}
    horizon = [T0_US + round(1e6 * s) for s in (-3000.0, 20_000.0)]

    def answer(others: Iterable[Area]) -> Delays:
        start, end = map(certain, horizon)
        [found] = delays([EAST], others, SCENE, "east", start=start, end=end)
        return found

    closed = answer(areas.values()).closed
    assert closed is not None
    assert ("A", "B") in [gap.by for gap in closed]
    for gap in closed:
        assert [one.key for one in gap.opened_by] == list(gap.by), gap

        def is_free(by_ms: int, gap: Closed = gap) -> bool:
            changed = dict(areas)
            for one in gap.opened_by:
                at = one.ends_at or one.starts_at
                assert at is not None
                at_us = (at - EPOCH) // MICROSECOND + (1000 * by_ms if one.ends_at else -1000 * by_ms)
                changed[one.key] = replace(areas[one.key], **{"end_us" if one.ends_at else "start_us": at_us})
            return not any(
                one.from_s <= gap.to_s and one.to_s >= gap.from_s for one in answer(changed.values()).forbidden
            )

        assert is_free(0)
        assert not is_free(1)


def test_nothing_opens_departures_that_a_track_closes_too() -> None:
    closed = delays([EAST, NORTH], [area("A", 0, 90_000)], SCENE, "east", best=1)[0].closed
    assert closed is not None
    assert [bool(gap.opened_by) for gap in closed if gap.by == ("A", "north")] == [False]
    assert any(gap.opened_by for gap in closed if gap.by == ("A",))
