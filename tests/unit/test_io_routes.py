"""Routes in RTZ, S-421 and GPX: what each field becomes, and one message a mistake.

The files are made here, after the public schemas. `docs/how-to/plan-with-routes-of-an-ecdis.md` says which public files
were read, with what result.
"""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from route_files import THREE, rtz, s421, waypoint

from conflictdb import Area, InvalidInput, Scene, Track, read, solve
from conflictdb.formats import FileHints
from conflictdb.formats.objects_writing import object_lines

GEOD = pyproj.Geod(ellps="WGS84")
NMI = 1852.0
STARTED = FileHints(departure=datetime(2026, 3, 1, 6, tzinfo=UTC), speed_kn=12.0)


def manual(*elements: str, part: str = "manual") -> str:
    each = "".join(f"<scheduleElement waypointId={one}/>" for one in elements)
    return f'<schedule id="s{len(elements)}"><{part}>{each}</{part}></schedule>'


def track(tmp_path: Path, text: str, hints: FileHints | None = None, **more: Any) -> Track:
    path = tmp_path / "plan.rtz"
    path.write_text(text)
    (found,) = read(path, hints=hints, **more).tracks
    return found


def at(found: Track, i: int) -> np.datetime64:
    return np.datetime64(int(found.times_us[i]), "us").astype("datetime64[s]")


@pytest.mark.parametrize("version", ["1.0", "1.1", "1.2"])
def test_a_route_becomes_a_track(version: str, tmp_path: Path) -> None:
    schedule = manual('"1" etd="2026-03-01T06:00:00Z"', '"2" speed="12"', '"3" eta="2026-03-01T14:00:00Z"')
    if version == "1.0":  # whose schema misspells it
        schedule = schedule.replace("scheduleElement", "sheduleElement")
    found = track(tmp_path, rtz(schedules=schedule, version=version))
    assert (found.key, found.name, found.properties) == ("R", "R", {"vesselMMSI": "265425000"})
    assert found.positions_deg.tolist() == [[4.0, 57.0], [5.0, 57.0], [5.0, 58.0]]
    assert at(found, 0) == np.datetime64("2026-03-01T06:00:00")
    assert at(found, 2) == np.datetime64("2026-03-01T14:00:00")
    leg_h = np.pi / 180.0 * 6378137.0 / np.sqrt(1.0 - 0.00669438 * np.sin(np.radians(57)) ** 2) * np.cos(np.radians(57))
    assert (found.times_us[1] - found.times_us[0]) / 3.6e9 == pytest.approx(leg_h / (12 * NMI), rel=1e-6)
    assert not found.outline_m.any()


def test_reference_routes_of_the_norwegian_coast_have_a_namespace_of_their_own(tmp_path: Path) -> None:
    text = rtz(version="1.0").replace("http://www.cirm.org/RTZ/1/0", "https://cirm.org/rtz-xml-schemas")
    assert len(track(tmp_path, text, STARTED).positions_deg) == 3


def test_a_stay_is_two_waypoints(tmp_path: Path) -> None:
    schedule = manual(
        '"1" etd="2026-03-01T06:00:00Z"',
        '"2" eta="2026-03-01T09:00:00Z" stay="PT1H30M"',
        '"3" eta="2026-03-01T15:00:00Z" etd="2026-03-01T16:00:00Z"',
    )
    found = track(tmp_path, rtz(schedules=schedule))
    assert found.positions_deg[:, 0].tolist() == [4, 5, 5, 5, 5]
    hours = (found.times_us - found.times_us[0]) / 3.6e9
    assert hours.tolist() == [0, 3, 4.5, 9, 10]


def test_the_manual_and_the_calculated_schedule_are_joined(tmp_path: Path) -> None:
    one = manual('"1" etd="2026-03-01T06:00:00Z"', '"3" eta="2026-03-01T14:00:00Z"').replace("</schedule>", "")
    two = manual('"2" eta="2026-03-01T09:00:00Z"', '"3" eta="2026-03-01T14:00:00.4Z"', part="calculated")
    found = track(tmp_path, rtz(schedules=one + two.split(">", 1)[1]))
    assert at(found, 1) == np.datetime64("2026-03-01T09:00:00")


def test_limits_and_turns_are_tolerances_of_the_track(tmp_path: Path) -> None:
    """Limits of the default waypoint hold for legs that give none; the haven is the vessel's."""
    default = '<defaultWaypoint radius="0.5"><leg portsideXTD="0.1" starboardXTD="0.2"/></defaultWaypoint>'
    points = default + waypoint(1, 4, 57) + waypoint(2, 5, 57, 'portsideXTD="0.5"') + waypoint(3, 5, 58)
    hints = FileHints(departure=STARTED.departure, speed_kn=12.0, haven_m=(100, 50, 10, 20))
    found = track(tmp_path, rtz(points), hints)
    assert found.outline_m.max(axis=0).tolist() == [20, 100]
    assert found.outline_m.min(axis=0).tolist() == [-10, -50]
    assert found.tolerances is not None
    assert found.tolerances["xtd_port_m"] == pytest.approx([0.5 * NMI, 0.1 * NMI])
    assert found.tolerances["xtd_starboard_m"] == pytest.approx([0.2 * NMI, 0.2 * NMI])
    assert found.tolerances["turn_radius_m"] == [0.5 * NMI]


def test_windows_and_stays_are_tolerances_of_the_track(tmp_path: Path) -> None:
    """The largest windows count for the whole plan; a stay has the limits of the wider leg around it, and no turn."""
    points = (
        waypoint(1, 4, 57) + waypoint(2, 5, 57, 'portsideXTD="0.5" starboardXTD="0"', radius=1) + waypoint(3, 5, 58)
    )
    schedule = manual(
        '"1" etd="2026-03-01T06:00:00Z" etdWindowBefore="PT5M"',
        '"2" eta="2026-03-01T09:00:00Z" stay="PT1H" etaWindowAfter="PT20M"',
        '"3" eta="2026-03-01T15:00:00Z" speedWindow="1"',
    )
    found = track(tmp_path, rtz(points, schedule))
    assert found.tolerances is not None
    assert found.tolerances["xtd_port_m"] == pytest.approx([0.5 * NMI, 0.5 * NMI, 0.0])
    assert found.tolerances["departure_window"] == ["2026-03-01T05:55:00Z", "2026-03-01T06:20:00Z"]
    assert found.tolerances["arrival_window"] == ["2026-03-01T14:55:00Z", "2026-03-01T15:20:00Z"]
    assert "turn_radius_m" not in found.tolerances
    speeds = np.array([found.tolerances["min_speed_kn"], found.tolerances["max_speed_kn"]])
    assert speeds[1, 2] - speeds[0, 2] == pytest.approx(2.0)
    assert speeds[0, 0] == pytest.approx(speeds[1, 0])


@pytest.mark.parametrize("name", ["plan.rtz", "plan.s421", "plan.gpx"])
def test_a_route_without_a_haven_is_remarked_as_a_point(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    points = '<rtept lat="57" lon="4"/><rtept lat="57" lon="5"/>'
    path.write_text({"plan.rtz": rtz(), "plan.s421": s421()}.get(name, f"<gpx><rte><name>R</name>{points}</rte></gpx>"))
    (remark,) = read(path, hints=STARTED).remarks
    assert "says nothing of sizes: " in remark.text
    contents = read(path, hints=replace(STARTED, haven_m=(100, 50, 10, 20)))
    assert contents.tracks[0].outline_m.any()
    assert contents.remarks == []


def test_a_written_haven_may_be_wider_than_limits_of_other_files(tmp_path: Path) -> None:
    """A haven that grows for days is wider than 10 nautical miles; the file was refused when it was read again."""
    grown = Track("T", [(8.0, 57.0), (9.0, 57.0)], [0, 10**12], [(0.0, 0.0)], grow_mps=0.1)
    path = tmp_path / "back.rtz"
    path.write_text("".join(object_lines(path, Scene("s"), [], [grown])))
    assert 'portsideXTD="5' in path.read_text()
    (found,) = read(path).tracks
    assert (found.grow_mps, found.tolerances) == (0.1, None)


def test_a_stay_has_no_bounds_of_speed(tmp_path: Path) -> None:
    """Its speed is 0; the file was refused for a plan that might take for ever."""
    calls = ['"1" etd="2026-03-01T06:00:00Z"', '"2" speed="12" stay="PT1H"', '"3" speed="12" speedWindow="1"']
    found = track(tmp_path, rtz(schedules=manual(*calls)))
    assert found.tolerances is not None
    assert found.tolerances["min_speed_kn"] == pytest.approx([12.0, 0.0, 11.0], abs=1e-5)
    calls[2] = calls[2].replace('Window="1"', 'Window="12.5"')
    with pytest.raises(InvalidInput, match="waypoint 3, speedWindow: is at least the planned speed"):
        track(tmp_path, rtz(schedules=manual(*calls)))


def test_a_route_with_tolerances_meets_an_area_beside_it(tmp_path: Path) -> None:
    points = waypoint(1, 4, 57) + waypoint(2, 5, 57, 'portsideXTD="1" starboardXTD="0"')
    found = track(tmp_path, rtz(points), STARTED)
    beside = Area("A", [(4.4, 57.01), (4.6, 57.01), (4.6, 57.1), (4.4, 57.1)])
    far = Area("B", [(4.4, 57.03), (4.6, 57.03), (4.6, 57.1), (4.4, 57.1)])
    assert {(one.a_key, one.b_key) for one in solve([found], [beside, far]) if one.b_key == "R"} == {("A", "R")}


def test_an_orthodrome_is_followed(tmp_path: Path) -> None:
    """The haven grows by what the line deviates, and the time is that of the whole leg."""
    points = waypoint(1, 140, 36) + waypoint(2, -137.5, 40, 'geometryType="Orthodrome"')
    found = track(tmp_path, rtz(points), STARTED)
    assert len(found.positions_deg) > 500
    assert found.positions_deg[-1].tolist() == [222.5, 40.0]
    assert found.outline_m.max() == 0.5
    azimuth, _, length_m = GEOD.inv(140, 36, -137.5, 40)
    hours = (found.times_us[-1] - found.times_us[0]) / 3.6e9
    assert hours == pytest.approx(length_m / (12 * NMI), rel=1e-5)
    for k in range(1, len(found.positions_deg), 50):
        there, _, away_m = GEOD.inv(140, 36, *found.positions_deg[k])
        assert abs(away_m * np.sin(np.radians(there - azimuth))) < 0.01


def test_a_route_without_times_needs_a_departure_and_a_speed(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match=r"route 'R': waypoint 1: has no departure time: .* --departure"):
        track(tmp_path, rtz())
    with pytest.raises(InvalidInput, match=r"waypoint 2: has neither an arrival time nor a speed: .* --speed-kn"):
        track(tmp_path, rtz(), FileHints(departure=STARTED.departure))
    assert at(track(tmp_path, rtz(), STARTED), 0) == np.datetime64("2026-03-01T06:00:00")


def test_one_of_several_schedules_is_a_layer(tmp_path: Path) -> None:
    first = manual('"1" etd="2026-03-01T06:00:00Z"', '"3" eta="2026-03-01T14:00:00Z"')
    second = manual('"1" etd="2026-03-02T06:00:00Z"', '"2" speed="9"', '"3" speed="9"')
    with pytest.raises(InvalidInput, match="schedules: has several: select one with --layer; the file has 's2', 's3'"):
        track(tmp_path, rtz(schedules=first + second))
    found = track(tmp_path, rtz(schedules=first + second), layers=["s3"])
    assert at(found, 0) == np.datetime64("2026-03-02T06:00:00")
    with pytest.raises(InvalidInput, match="layer: there is no schedule 's4'; the file has 's2', 's3'"):
        track(tmp_path, rtz(schedules=first + second), layers=["s4"])


def leg(text: str) -> str:
    return rtz(waypoint(1, 4, 57) + waypoint(2, 5, 57, text))


def calls(number: str, text: str) -> str:
    return rtz(schedules=manual('"1" etd="2026-03-01T06:00:00Z"', f'"{number}" {text}'))


def calculated(manually: str, otherwise: str) -> str:
    """Return a route whose calculated schedule has an element besides the manual one."""
    schedule = manual('"1" etd="2026-03-01T06:00:00Z"', manually, '"3" eta="2026-03-02T14:00:00Z"')
    other = f"<calculated><scheduleElement waypointId={otherwise}/></calculated>" if otherwise else ""
    return rtz(schedules=schedule.replace("</schedule>", f"{other}</schedule>"))


MISTAKES = {
    "version": (rtz(version="2.0"), r"route 'R': version: must be one of 1.0, 1.1, 1.2; got '2.0'"),
    "one waypoint": (rtz(waypoint(1, 4, 57)), "'R': waypoints: a route needs at least two waypoints; got 1"),
    "no waypoints": (rtz("").replace("waypoints", "points"), "'R': waypoints: are missing"),
    "an id twice": (rtz(waypoint(1, 4, 57) * 2), "'R': waypoint in line 1: has the id 1, as an earlier one"),
    "no id": (rtz(THREE.replace('id="2"', "")), "'R': waypoint in line 1: has no id"),
    "no position": (rtz(THREE.replace("position", "place", 1)), "'R': waypoint 1: has no position"),
    "latitude": (rtz(waypoint(1, 4, 57) + waypoint(2, 5, 89.5)), "'R': waypoint 2: must lie within"),
    "longitude": (rtz(waypoint(1, 4, 57) + waypoint(2, "E5", 57)), "waypoint 2, lon: must be a number; got 'E5'"),
    "geometry": (leg('geometryType="GreatCircle"'), "waypoint 2, geometryType: must be one of Loxodrome, Orthodrome"),
    "limit": (leg('portXTD="0.2"'), "waypoint 2, portXTD: is not known: cross-track limits are portsideXTD and"),
    "metres": (leg('portsideXTD="185.2"'), "waypoint 2, portsideXTD: is 185.2 .* probably metres, .* 0.1 nautical"),
    "metres to starboard": (leg('starboardXTD="11"'), "waypoint 2, starboardXTD: is 11 .* probably metres"),
    "one side": (
        leg('portsideXTD="0.2"'),
        "waypoint 2: has a cross-track limit to port only: give that to starboard too",
    ),
    "other side": (leg('starboardXTD="0"'), "waypoint 2: has a cross-track limit to starboard only: give that to port"),
    "negative": (leg('starboardXTD="-1"'), "waypoint 2, starboardXTD: must be a number of nautical miles, 0 or more"),
    "infinite": (leg('starboardXTD="INF"'), "waypoint 2, starboardXTD: must be a finite number"),
    "unknown waypoint": (calls("9", 'speed="5"'), "'R': scheduleElement: has the waypointId '9', which no waypoint"),
    "no speed": (calls("2", 'speed="0"'), "waypoint 2: has a speed of 0 knots"),
    "slow": (calls("2", 'speed="1e-9"'), "waypoint 2: has so low a speed"),
    "no offset": (calls("2", 'eta="2026-03-01T09:00:00"'), "waypoint 2, eta: needs an offset from UTC"),
    "a stay of ages": (
        calls("3", 'eta="2026-03-02T05:00:00Z" stay="P99999999999999D"'),
        "'R': times: must lie in the years 1 to 9999",
    ),
    "months": (calls("2", 'speed="5" stay="P1M"'), "waypoint 2, stay: must be a duration such as PT2H30M"),
    "a stay at no time": (
        rtz(schedules=manual('"1" etd="2026-03-01T06:00:00Z"', '"2" stay="PT1H"', '"3" eta="2026-03-01T14:00:00Z"')),
        "waypoint 2: has a stay, but no arrival time and no speed",
    ),
    "backwards": (calls("3", 'eta="2026-03-01T05:00:00Z"'), r"track 'R': times\[1\]: must be later|two places"),
    "too fast": (calls("3", 'eta="2026-03-01T06:00:10Z"'), r"track 'R': times\[1\]: .* beyond 2000 kn"),
    "two times": (
        rtz(
            schedules=manual('"1" etd="2026-03-01T06:00:00Z"', '"3" eta="2026-03-01T14:00:00Z"').replace(
                "</schedule>", ""
            )
            + '<calculated><scheduleElement waypointId="3" eta="2026-03-01T15:00:00Z"/></calculated></schedule>'
        ),
        "waypoint 3, eta: is given twice, 3600 s apart",
    ),
    "two speeds": (
        calculated('"2" speed="20"', '"2" speed="10"'),
        "waypoint 2, speed: is given twice, 10 and 20 knots",
    ),
    "two stays": (
        calculated('"2" speed="20" stay="PT2H"', '"2" stay="PT1H"'),
        "waypoint 2, stay: is given twice, 3600 s apart",
    ),
    "opposite": (
        rtz(waypoint(1, 0, 0) + waypoint(2, 180, 0, 'geometryType="Orthodrome"')),
        "waypoint 2: is opposite to the waypoint before it",
    ),
}


def test_speeds_that_differ_by_rounding_or_beside_a_time_are_no_contradiction(tmp_path: Path) -> None:
    rounded = track(tmp_path, calculated('"2" speed="12.35"', '"2" speed="12.3456"'))
    assert rounded.times_us[1] == track(tmp_path, calculated('"2" speed="12.3456"', "")).times_us[1]
    eta = 'eta="2026-03-01T09:00:00Z"'
    timed = track(tmp_path, calculated(f'"2" {eta} speed="20"', '"2" speed="10"'))
    assert at(timed, 1) == np.datetime64("2026-03-01T09:00:00")


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_has_one_message_that_names_it(mistake: str, tmp_path: Path) -> None:
    text, rule = MISTAKES[mistake]
    with pytest.raises(InvalidInput, match=rule) as refused:
        track(tmp_path, text, None if "schedule" in text else STARTED)
    assert str(refused.value).count("\n") == 0


def test_two_speeds_of_s421_that_contradict_are_refused(tmp_path: Path) -> None:
    text = s421().replace('xlink:href="#E2"/>', 'xlink:href="#E2"/><routeScheduleElement xlink:href="#E3"/>')
    element = '<imember><S421:routeScheduleElement gml:id="E3"><routeWaypointId>2</routeWaypointId>'
    element += "<routeScheduleElementPlanSOG>9</routeScheduleElementPlanSOG></S421:routeScheduleElement></imember>"
    (tmp_path / "plan.s421").write_text(text.replace("</S421:DataSet>", f"{element}</S421:DataSet>"))
    with pytest.raises(InvalidInput, match="waypoint 2, PlanSOG: is given twice, 9 and 12 knots"):
        read(tmp_path / "plan.s421")


def gpx(*names: str, segments: int = 1, kind: str = "trk") -> str:
    times = ("2026-03-01T06:00:00Z", "2026-03-01T07:00:00Z")
    points = "".join(f'<trkpt lat="57" lon="{i}"><time>{at}</time></trkpt>' for i, at in enumerate(times))
    inside = f"<trkseg>{points}</trkseg>" * segments
    if kind == "rte":
        inside = '<rtept lat="57" lon="4"/><rtept lat="57" lon="5"/>'
    return "".join(f"<{kind}><name>{name}</name>{inside}</{kind}>" for name in names)


@pytest.mark.parametrize(
    ("text", "keys"),
    [
        (gpx("plan.2", "A", "A"), ["plan.1", "plan.2", "plan.3"]),
        (gpx("A", segments=2) + gpx("A.1", "B"), ["A.1", "A.2", "plan.2", "B"]),
        (gpx("A", segments=1) + gpx("A.1", "9"), ["A", "A.1", "9"]),
        (gpx("plan.2.2", "") + gpx("", segments=2), ["plan.2.2", "plan.2", "plan.3.1", "plan.3.2"]),
        (gpx("plan.3.2", "") + gpx("", segments=2), ["plan.1", "plan.2", "plan.3.1", "plan.3.2"]),
        (gpx("plan.route 1", "A") + gpx("A", "B", kind="rte"), ["plan.1", "A", "B", "plan.route 1"]),
        (gpx("A", "A", "plan.route 1", kind="rte"), ["plan.route 1", "plan.route 2", "plan.route 3"]),
    ],
)
def test_ids_of_gpx_differ_from_names(text: str, keys: list[str], tmp_path: Path) -> None:
    (tmp_path / "plan.gpx").write_text(f"<gpx>{text}</gpx>")
    assert sorted(track.key for track in read(tmp_path / "plan.gpx", hints=STARTED).tracks) == sorted(keys)


@pytest.mark.parametrize("namespace", ["S421/gml/1.0", "S421/gml/cs0/1.0"])
def test_a_route_plan_of_s421_becomes_a_track(namespace: str, tmp_path: Path) -> None:
    """Latitude comes first, limits are metres, and names may begin with an upper-case letter."""
    (tmp_path / "plan.s421").write_text(s421(namespace=namespace))
    text = s421(namespace=namespace).replace("S421:route", "S421:Route")
    (tmp_path / "upper.gml").write_text(text)
    for name in ("plan.s421", "upper.gml"):
        (found,) = read(tmp_path / name).tracks
        assert (found.key, found.positions_deg[0].tolist(), found.positions_deg[-1].tolist()) == ("R", [4, 57], [9, 57])
        assert np.abs(found.outline_m).tolist() == [[0.5, 0.5]] * 4
        assert found.tolerances is not None
        assert set(found.tolerances["xtd_port_m"]) == {500.0}
        _, _, length_m = GEOD.inv(4, 57, 9, 57)
        assert (found.times_us[-1] - found.times_us[0]) / 3.6e9 == pytest.approx(length_m / (12 * NMI), rel=1e-5)


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        (s421(kind="3"), "'R': waypoint 2, routeWaypointLegGeometryType: must be loxodrome"),
        (s421(limit="12000"), "'R': waypoint 2, routeWaypointLegPortXTDL: must be metres, 0 to 10000; got 12000"),
        (s421().replace('gml:id="W2"', 'gml:id="X"'), "'R': routeWaypoint in line 1: refers to #W2, which is missing"),
        (s421().replace("57.0 9.0", "57.0"), "pos in line 1: must be positions of 2 numbers each"),
        (s421().replace("Id>2<", "Id>7<"), "has the routeWaypointId '7', which no waypoint has"),
        (
            s421(times="<routeScheduleElementETA>2026-03-01T18:00:00</routeScheduleElementETA>"),
            "waypoint 2, ETA: needs an offset",
        ),
    ],
)
def test_a_mistake_in_s421_is_named(text: str, rule: str, tmp_path: Path) -> None:
    path = tmp_path / "plan.s421"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=rule) as refused:
        read(path)
    assert str(refused.value).count("\n") == 0


def gpx(extensions: str = "", of_point: str = "") -> str:
    return (
        '<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1" xmlns:o="http://www.opencpn.org">'
        f"<rte><name>R</name><extensions>{extensions}</extensions>"
        f'<rtept lat="57" lon="4"><extensions>{of_point}</extensions></rtept><rtept lat="57" lon="5"/></rte></gpx>'
    )


def test_a_route_of_gpx_needs_a_planned_departure(tmp_path: Path) -> None:
    path = tmp_path / "plan.gpx"
    path.write_text(gpx())
    assert [one.reason for one in read(path).skipped] == [
        "1 features are routes, which have no times: no tracks; --departure and --speed-kn give them"
    ]
    (by_option,) = read(path, hints=STARTED).tracks
    planned = "<o:planned_departure>2026-03-01T06:00:00Z</o:planned_departure><o:planned_speed>12</o:planned_speed>"
    path.write_text(gpx(planned))
    (by_file,) = read(path).tracks
    path.write_text(gpx("<o:planned_speed>12</o:planned_speed>", "<o:etd>2026-03-01T06:00:00Z</o:etd>"))
    (by_point,) = read(path).tracks
    assert by_option.times_us.tolist() == by_file.times_us.tolist() == by_point.times_us.tolist()
    for wrong, rule in (
        (gpx(planned, "<o:planned_speed>x</o:planned_speed>"), "'R': point 1, planned_speed: must be a number"),
        (gpx(planned).replace(">12<", ">fast<"), "'R': planned_speed: must be a number; got 'fast'"),
        (gpx(planned).replace("06:00:00Z", "06:00:00"), "'R': planned_departure: needs an offset"),
        (
            gpx("<o:planned_departure>2026-03-01T06:00:00Z</o:planned_departure>"),
            "'R': point 2: has neither an arrival",
        ),
    ):
        path.write_text(wrong)
        with pytest.raises(InvalidInput, match=rule):
            read(path)


def route_of_points(*points: str, creator: str = "router", route: str = "") -> str:
    each = "".join(f'<rtept lat="57" lon="{10 + 0.1 * i}">{point}</rtept>' for i, point in enumerate(points))
    return f'<gpx creator="{creator}" xmlns:opencpn="o"><rte><name>R</name>{route}{each}</rte></gpx>'


def properties(**given: str) -> str:
    text = " ".join(f'{name}="{one}"' for name, one in given.items())
    return f"<extensions><opencpn:rte_properties {text}/></extensions>"


def test_speeds_and_departures_of_legs_are_those_of_opencpn(tmp_path: Path) -> None:
    """It writes them as attributes; a speed belongs to the leg that leads to its point, and 0 is none."""
    path = tmp_path / "plan.gpx"
    route = (
        "<extensions><opencpn:planned_speed>6</opencpn:planned_speed>"
        "<opencpn:planned_departure>2026-06-01T10:00:00Z</opencpn:planned_departure></extensions>"
    )
    made = "<time>2026-05-01T00:00:00Z</time>"
    points = (properties(planned_speed="1"), properties(planned_speed="12.0"), properties(planned_speed="0"))
    path.write_text(route_of_points(*(made + one for one in points), creator="OpenCPN", route=route))
    (track,) = read(path).tracks
    fast, slow = np.diff(track.times_us)
    assert slow / fast == pytest.approx(2.0, rel=1e-9)
    points = (properties(etd="2026-06-01T10:00:00"), properties(planned_speed="12", etd="2026-06-01T12:00:00Z"), "")
    path.write_text(route_of_points(*points, creator="OpenCPN", route=route))
    (track,) = read(path).tracks
    assert track.times_us[2] - track.times_us[0] == 2 * 3_600_000_000


def test_times_of_route_points_are_those_of_the_track(tmp_path: Path) -> None:
    path = tmp_path / "plan.gpx"
    times = [f"<time>2026-06-01T1{hour}:00:00Z</time>" for hour in range(3)]
    path.write_text(route_of_points(*times))
    (track,) = read(path).tracks
    assert np.diff(track.times_us).tolist() == [3_600_000_000] * 2
    for wrong, number in ((["", *times[1:]], 1), ([times[0], "", times[2]], 2), ([times[1], times[2], times[0]], 3)):
        path.write_text(route_of_points(*wrong))
        with pytest.raises(
            InvalidInput, match=f"point {number}, time: .*the times of points are those of the route if"
        ):
            read(path)


def test_a_track_is_split_where_nothing_is_known_for_long(tmp_path: Path) -> None:
    """A fix of a wrong date made a leg of decades, and a pause of weeks a straight voyage."""
    times = ["1980-01-06T00:00:07Z", "2026-06-01T10:30:00Z", "2026-06-01T11:00:00Z"]
    times += ["2026-06-15T11:00:00Z", "2026-06-15T12:00:00Z"]
    points = "".join(f'<trkpt lat="57" lon="{10 + 0.01 * i}"><time>{at}</time></trkpt>' for i, at in enumerate(times))
    path = tmp_path / "log.gpx"
    path.write_text(f"<gpx><trk><name>L</name><trkseg>{points}</trkseg></trk></gpx>")
    contents = read(path)
    assert [(one.key, len(one.times_us)) for one in contents.tracks] == [("L", 2), ("L/2", 2)]
    assert [one.reason for one in contents.skipped] == ["a single fix, with a gap of more than the limit to the others"]
    assert "1 objects have gaps of more than 24 hours" in contents.remarks[1].text
    assert "the longest, of 46 years, is that of 'L': --max-gap takes another limit" in contents.remarks[1].text
    whole = read(path, hints=FileHints(max_gap_s=np.inf))
    assert [len(one.times_us) for one in whole.tracks] == [5]
    with pytest.raises(InvalidInput, match="max_gap_s: must be a number of seconds above 0"):
        FileHints(max_gap_s=0.0)
