"""Objects written in other formats: what is read again is the same, and volumes contain moving havens."""

import json
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from draws import draws
from oracle import haven_at
from route_files import rtz, s421, waypoint

from conflictdb import Area, InvalidInput, Scene, Track, read, solve, write_scene_file
from conflictdb.earth import geodesy
from conflictdb.earth.registry import Setup
from conflictdb.formats import FileHints, object_lines, write_lines
from conflictdb.model.plans import Motion
from conflictdb.model.rules import Rule

HOLE = [(4.6, 57.2), (4.7, 57.2), (4.7, 57.3)]
SQUARE = shapely.MultiPolygon([shapely.Polygon([(4, 57), (5, 57), (5, 58), (4, 57)], [HOLE])])
# Its sides are rhumb lines, and straight in longitude and latitude.
BOX = shapely.MultiPolygon([shapely.box(4, 57, 5, 58)])
HOUR = 3_600_000_000
BEGIN = 1_772_344_800_000_000


def written(path: Path, areas: list[Area], tracks: list[Track], scene: Scene | None = None) -> Path:
    write_lines(path, object_lines(path, scene or Scene("s"), areas, tracks))
    return path


def random_rtz(rng: np.random.Generator) -> str:
    """Return a route with all that is read: legs of both kinds, limits, radii, windows, stays, one or two schedules."""
    count = int(rng.integers(2, 7))
    lon, lat = rng.uniform(-180, 180), rng.uniform(-60, 60)
    points, calls, hours = "", [], 0.0
    if rng.random() < 0.3:
        leg = '<leg portsideXTD="0.3" starboardXTD="0" geometryType="Orthodrome"/>'
        points = f'<defaultWaypoint radius="0.2">{leg}</defaultWaypoint>'
    for number in range(1, count + 1):
        leg = f'geometryType="{rng.choice(["Loxodrome", "Orthodrome"])}"'
        if rng.random() < 0.5:
            leg += f' portsideXTD="{rng.uniform(0.01, 2):.3f}" starboardXTD="{rng.uniform(0.01, 2):.3f}"'
        more = {"radius": f"{rng.uniform(0, 1):.2f}"} if rng.random() < 0.4 else {}
        points += waypoint(number, float((lon + 180) % 360 - 180), float(lat), leg, **more)
        time = f"2026-03-{1 + int(hours // 24):02d}T{int(hours % 24):02d}:{int(hours * 60 % 60):02d}:07Z"
        if number == 1:
            calls.append(f'"{number}" etd="{time}"')
        elif rng.random() < 0.3:
            calls.append(f'"{number}" speed="{rng.uniform(5, 20):.2f}"')
        else:
            calls.append(f'"{number}" eta="{time}"' + (' stay="PT45M"' if rng.random() < 0.4 else ""))
        for window in ('etdWindowBefore="PT20M"', 'etaWindowAfter="PT1H5M"', 'speedWindow="0.5"'):
            calls[-1] += f" {window}" if rng.random() < 0.2 else ""
        lon, lat = lon + rng.uniform(-3, 3), lat + rng.uniform(-2, 2)
        hours += rng.uniform(30, 60)
    cut = int(rng.integers(0, len(calls) + 1))
    parts = "".join(
        f"<{part}>{''.join(f'<scheduleElement waypointId={one}/>' for one in some)}</{part}>"
        for part, some in (("manual", calls[:cut]), ("calculated", calls[cut:]))
    )
    return rtz(points, f'<schedule id="1">{parts}</schedule>', str(rng.choice(["1.0", "1.1", "1.2"])))


def assert_same(one: Track, other: Track) -> None:
    assert (one.key, one.name, one.properties) == (other.key, other.name, other.properties)
    assert np.array_equal(one.positions_deg, other.positions_deg) or np.allclose(
        one.positions_deg, other.positions_deg, rtol=0, atol=1e-12
    )
    assert one.times_us.tolist() == other.times_us.tolist()
    assert np.array_equal(one.outline_m, other.outline_m)
    assert one.tolerances == other.tolerances
    for name in ("floor_m", "ceiling_m", "grow_mps"):
        assert getattr(one, name) == getattr(other, name)
    for name in ("outlines_m", "floors_m", "ceilings_m"):
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None and b is None) or np.array_equal(a, b)


@draws("seeds", 40, 200)
def test_routes_of_rtz_and_s421_come_back_without_loss(seeds: int, tmp_path: Path) -> None:
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        if seed % 5:
            path = tmp_path / "in.rtz"
            path.write_text(random_rtz(rng))
        else:
            path = tmp_path / "in.s421"
            path.write_text(s421(kind=str(rng.integers(1, 3)), limit=f"{rng.uniform(1, 9999):.1f}"))
        (first,) = read(path).tracks
        (again,) = read(written(tmp_path / "out.rtz", [], [first])).tracks
        assert_same(first, again)


def test_any_track_comes_back_from_rtz(tmp_path: Path) -> None:
    """With a haven that changes, heights of legs, an odd name, stays, and times to the microsecond."""
    outlines = [[(50, 100), (50, -100), (-50, -100), (-50, 100)], [(90, 40), (90, -70), (-90, -70), (-90, 40)]]
    tracks = [
        Track(
            "A & <B>",
            [(4, 57), (5, 57)],
            [BEGIN, BEGIN + HOUR],
            outlines[0],
            "é",
            outlines_m=outlines,
            properties={"x": [1]},
        ),
        Track(
            "T",
            [(4, 57), (4, 57), (5, 57), (5, 57)],
            [BEGIN, BEGIN + 1, BEGIN + HOUR, BEGIN + 2 * HOUR],
            [(0, 0)],
            floor_m=-5,
        ),
        Track(
            "H",
            [(179, 5), (181, 5), (181, 5)],
            [BEGIN, BEGIN + 9 * HOUR, BEGIN + 10 * HOUR],
            [(1, 0), (-1, 0)],
            floors_m=[-9, -5],
            ceilings_m=[0, np.inf],
        ),
        Track("G", [(4, 57), (5, 57)], [BEGIN, BEGIN + HOUR], outlines[0], grow_mps=0.25),
    ]
    for track in tracks:
        (again,) = read(written(tmp_path / "out.rtz", [], [track])).tracks
        assert_same(track, again)
    with pytest.raises(InvalidInput, match="RTZ: holds one track; here are 2 tracks and 0 areas"):
        written(tmp_path / "two.rtz", [], tracks[:2])


def test_tracks_of_great_circles_come_back_from_rtz(tmp_path: Path) -> None:
    """Their legs were followed with rhumb lines: members by leg or waypoint were refused, tracks near a pole too."""
    ends = np.array([(170.0, 60.0), (-150.0, 70.0), (-150.0, 70.0), (30.0, 80.0)])
    times = [BEGIN, BEGIN + 90 * HOUR, BEGIN + 92 * HOUR, BEGIN + 200 * HOUR]
    outlines = np.array([[(5, 5), (-5, 5), (0, -5)]] * 4) * np.arange(1, 5)[:, None, None]
    scene, course = Scene("s", motion=Motion.GREAT_CIRCLE), (ends, times, [(5, 5), (-5, 5), (0, -5)])
    tracks = [
        Track("plain", *course),
        Track("limits", *course, tolerances={"xtd_port_m": [100.0, 0.0, 300.0], "turn_radius_m": [0.0, 0.0]}),
        Track("outlines", ends, times, outlines[0], outlines_m=outlines),
        Track("legs", *course, floors_m=[0, 5, 10], ceilings_m=[20, 25, 30, 35]),
        Track("high", [(0, 89.5), (120, 90)], times[:2], [(0, 0)], floor_m=0.0),
    ]
    for track in tracks:
        (again,) = read(written(tmp_path / "out.rtz", [], [track], scene)).tracks
        assert again.legs is Motion.GREAT_CIRCLE
        moved = again.positions_deg - track.positions_deg
        assert np.array_equal(moved, 360.0 * np.round(moved / 360.0))
        assert_same(replace(track, positions_deg=again.positions_deg), again)
        with pytest.raises(InvalidInput, match="legs: are great circles, and the scene follows rhumb lines"):
            solve([again], [], Scene("s"))
    (meridian,) = read(
        written(tmp_path / "m.rtz", [], [Track("M", [(4, 57), (4, 58)], times[:2], [(0, 0)])], scene)
    ).tracks
    assert meridian.legs is None


def test_a_route_of_great_circles_arrives_by_its_speed(tmp_path: Path) -> None:
    """An ECDIS gave it a speed for its time of arrival."""
    track = Track("T", [(4, 57), (60, 57)], [BEGIN, BEGIN + 200 * HOUR], [(0, 0)])
    path = written(tmp_path / "out.rtz", [], [track], Scene("s", motion=Motion.GREAT_CIRCLE))
    text = path.read_text()
    path.write_text(re.sub(r'(waypointId="2") eta="[^"]*"', r'\1 speed="10"', text))
    (again,) = read(path).tracks
    length_m = geodesy.great_circle_distance(4, 57, 60, 57)
    assert (again.times_us[1] - BEGIN) / 1e6 == pytest.approx(length_m / (10 * 1852 / 3600), rel=1e-9)


def test_a_track_that_only_stays_comes_back_from_rtz(tmp_path: Path) -> None:
    track = Track("S", [(4, 57), (4, 57)], [BEGIN, BEGIN + HOUR], [(5, 5), (-5, 5), (0, -5)])
    (again,) = read(written(tmp_path / "out.rtz", [], [track])).tracks
    assert_same(track, again)


@pytest.mark.parametrize("name", ["out.kml", "out.rtz"])
@pytest.mark.parametrize("character", ["\x01", "\x0b", "\ufffe"])
def test_characters_that_xml_cannot_hold_are_refused(name: str, character: str, tmp_path: Path) -> None:
    track = Track(f"A{character}", [(4, 57), (5, 57)], [BEGIN, BEGIN + HOUR], [(0, 0)])
    with pytest.raises(InvalidInput, match=r"id: holds .*, a character that XML cannot hold: remove it, then export"):
        written(tmp_path / name, [], [track])


def test_areas_come_back_from_ed318(tmp_path: Path) -> None:
    areas = [
        Area("A1", SQUARE, "Zone", BEGIN, BEGIN + HOUR, 10.0, 500.0, {"type": "CONDITIONAL", "reason": ["NATURE"]}),
        Area("A2", shapely.union(SQUARE, shapely.box(8, 50, 9, 51))),
    ]
    again = read(written(tmp_path / "out.ed318.json", areas, [])).areas
    for one, other in zip(areas, again, strict=True):
        assert (one.key, one.name, one.start_us, one.end_us) == (other.key, other.name, other.start_us, other.end_us)
        assert (one.floor_m, one.ceiling_m) == (other.floor_m, other.ceiling_m)
        assert shapely.equals(one.footprint, other.footprint)
        assert one.properties.items() <= other.properties.items()
    with pytest.raises(InvalidInput, match="area 'TOO LONG': id: is longer than the 7 characters"):
        written(tmp_path / "long.ed318.json", [Area("TOO LONG", SQUARE)], [])
    with pytest.raises(InvalidInput, match="ED-318: holds areas only; here are 1 tracks, such as 'T'"):
        written(tmp_path / "t.ed318.json", [], [Track("T", [(4, 57), (5, 57)], [BEGIN, BEGIN + HOUR], [(0, 0)])])


def in_mercator(places_deg: Any) -> Any:
    return np.column_stack(Setup.of(Scene("s")).plane.to_plane(*places_deg.T))


def test_areas_and_tracks_come_back_from_kml(tmp_path: Path) -> None:
    pytest.importorskip("pyogrio")
    area = Area("A1", SQUARE, "Zone", BEGIN, BEGIN + HOUR, 10.0, 500.0)
    track = Track("T1", [(4, 57), (5, 57)], [BEGIN, BEGIN + HOUR], [(0, 0)])
    found = read(written(tmp_path / "out.kml", [area], [track]))
    (again,), (moved,) = found.areas, found.tracks
    assert (again.key, again.start_us, again.end_us) == ("A1", BEGIN, BEGIN + HOUR)
    # Its slanting side has more vertices, whose coordinates are rounded, on the same rhumb line.
    flat = [shapely.transform(one.footprint, in_mercator) for one in (again, area)]
    assert shapely.hausdorff_distance(*flat) < 1e-6
    assert (moved.key, moved.times_us.tolist()) == ("T1", track.times_us.tolist())
    assert moved.positions_deg.tolist() == track.positions_deg.tolist()


def test_parts_of_a_recurring_plan_have_one_owner_in_kml(tmp_path: Path) -> None:
    """They are not compared with each other, and are with all other objects."""
    pytest.importorskip("pyogrio")
    departures = [BEGIN, BEGIN + 3 * HOUR]
    track = Track(
        "T", [(4, 57), (5, 57)], [BEGIN, BEGIN + 2 * HOUR], [(5, 5), (-5, 5), (0, -5)], departures_us=departures
    )
    owned = replace(track, key="O", owner="T")
    area = Area("A", SQUARE, spans_us=[(BEGIN, BEGIN + HOUR), (BEGIN + 5 * HOUR, BEGIN + 6 * HOUR)])
    found = read(written(tmp_path / "out.kml", [area], [track, owned, replace(track, key="é" * 200)]))
    owners = {one.key: one.owner for one in [*found.areas, *found.tracks]}
    assert [owners[key] for key in ("A/1", "A/2", "T/1", "T/2", "O/1", "O/2")] == ["A", "A", "T/1", "T/1", "T", "T"]
    assert len({owner for key, owner in owners.items() if key.startswith("é")}) == 1
    apart = Scene("s", separation_m=1000.0, time_separation_s=14400.0)
    assert solve([replace(one, owner=None) for one in found.tracks[:2]], [], apart)
    assert solve(found.tracks[:2], [], apart) == []


def volumes(path: Path) -> list[tuple[int, int, Any]]:
    """Return start, end and polygon of each volume, as this package reads them."""
    found = read(path, hints=FileHints(unbounded_heights=True)).areas
    return [(area.start_us or 0, area.end_us or 0, area.footprint) for area in found]


def test_volumes_contain_an_area(tmp_path: Path) -> None:
    area = Area("A1", SQUARE, None, BEGIN, BEGIN + HOUR, 10.0, 500.0)
    path = written(tmp_path / "out.f3548.json", [area], [])
    ((start, end, footprint),) = volumes(path)
    assert (start, end) == (BEGIN, BEGIN + HOUR)
    assert footprint.contains(shapely.MultiPolygon([shapely.Polygon(SQUARE.geoms[0].exterior)]))
    assert footprint.area < 1.01 * shapely.Polygon(SQUARE.geoms[0].exterior).area
    volume = json.loads(path.read_text())[0]["details"]["volumes"][0]["volume"]
    assert (volume["altitude_lower"]["value"], volume["altitude_upper"]["value"]) == (-98.0, 587.0)
    with pytest.raises(InvalidInput, match="area 'A1': start: and end must be given"):
        written(tmp_path / "open.f3548.json", [Area("A1", SQUARE, None, BEGIN)], [])


@pytest.mark.parametrize("seed", range(6))
def test_volumes_contain_a_moving_haven(seed: int, tmp_path: Path) -> None:
    """At random times every corner of the haven is in a volume of that time; together they cover all of the time."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 6))
    lon, lat = rng.uniform(-180, 180) if seed % 3 else 179.9, rng.uniform(-70, 70)
    positions = np.cumsum(np.vstack([[lon, lat], rng.uniform(-0.6, 0.6, (count - 1, 2))]), axis=0)
    times = BEGIN + np.cumsum(np.append(0, rng.integers(1, 5, count - 1))) * HOUR
    outline = [(800.0, 1500.0), (800.0, -2500.0), (-400.0, -2500.0), (-400.0, 1500.0)]
    grown = {"grow_mps": 0.05} if seed % 2 else {}
    scene = Scene("s")
    track = Track("T", positions, times, outline, **grown, max_speed_kn=np.inf)  # type: ignore[arg-type]
    path = written(tmp_path / "out.f3548.json", [], [track], scene)
    found = volumes(path)
    assert len(found) <= 250
    assert min(start for start, _, _ in found) == times[0]
    assert max(end for _, end, _ in found) == times[-1]
    for at in rng.integers(times[0], times[-1], 25):
        now = [shape for start, end, shape in found if start <= at <= end]
        assert now, "a gap in time"
        corners = haven_at(scene, track, int(at), int(np.searchsorted(times, at, side="right")) - 1)
        for x, y in corners:
            assert any(shape.contains(shapely.Point(x + turn, y)) for shape in now for turn in (-360.0, 0.0, 360.0)), (
                at,
                x,
                y,
            )


@pytest.mark.parametrize(
    ("limits", "meets"),
    [
        ({"xtd_port_m": 200}, True),
        ({"xtd_port_m": [100, 200], "xtd_starboard_m": [100, 0]}, True),
        ({"xtd_port_m": [200, 0], "xtd_starboard_m": [0, 200]}, False),
        ({"turn_radius_m": [400]}, False),
    ],
)
def test_volumes_have_the_limits_of_each_leg(limits: dict[str, Any], meets: bool, tmp_path: Path) -> None:
    """Limits given by leg, or by turn, were refused, as volumes divide legs. The area is to port of the second leg."""
    times = [BEGIN, BEGIN + HOUR, BEGIN + 2 * HOUR]
    outline = [(50, 50), (50, -50), (-50, -50), (-50, 50)]
    track = Track("T", [(3.9, 57.05), (4.3, 57.05), (4.3, 57.3)], times, outline, tolerances=limits)
    beside = Area("A", shapely.box(4.29, 57.15, 4.297, 57.2))
    assert bool(solve([track], [beside], Scene("s"))) == meets
    found = volumes(written(tmp_path / "out.f3548.json", [], [track]))
    assert any(shape.intersects(beside.footprint) for _, _, shape in found) == meets


def test_activations_are_written_one_by_one(tmp_path: Path) -> None:
    """Formats without schedules never get the outer bounds of several spans."""
    spans = [(BEGIN, BEGIN + HOUR), (BEGIN + 5 * HOUR, BEGIN + 6 * HOUR)]
    area = Area("A1", SQUARE, spans_us=spans, floor_m=1.0, ceiling_m=2.0)
    track = Track("T1", [(4, 57), (4.1, 57)], [BEGIN, BEGIN + HOUR], [(0, 0)], departures_us=[BEGIN, BEGIN + 9 * HOUR])
    found = volumes(written(tmp_path / "out.f3548.json", [area], []))
    assert [(start, end) for start, end, _ in found] == spans
    found = volumes(written(tmp_path / "out.f3548.json", [], [track]))
    assert {start for start, _, _ in found} >= {BEGIN, BEGIN + 9 * HOUR}
    assert not any(start < BEGIN + 5 * HOUR < end for start, end, _ in found)
    (again,) = read(written(tmp_path / "out.ed318.json", [area], [])).areas
    assert again.spans_us == area.spans_us
    text = written(tmp_path / "out.kml", [area], [track]).read_text()
    assert (text.count("<TimeSpan>"), text.count("<gx:Track>")) == (2, 2)
    (back,) = read(written(tmp_path / "out.rtz", [], [track])).tracks
    assert back.departures_us == track.departures_us
    unknown = Area("A1", SQUARE, None, BEGIN, BEGIN + HOUR, schedule={"days": ["TUE"], "periods": [["08:00", "10:00"]]})
    for name in ("out.kml", "out.f3548.json", "out.ed318.json"):
        with pytest.raises(InvalidInput, match="area 'A1': schedule: is not expanded"):
            written(tmp_path / name, [unknown], [])


def test_schedules_of_ed318_come_back(tmp_path: Path) -> None:
    daily = [{"day": ["MON", "TUE"], "startTime": "08:00:00Z", "endTime": "10:00:00Z"}]
    area = Area("A1", SQUARE, None, BEGIN, BEGIN + 1000 * HOUR, schedule={"ed318": daily})
    (again,) = read(written(tmp_path / "out.ed318.json", [area], [])).areas
    assert (again.start_us, again.end_us, again.schedule) == (area.start_us, area.end_us, area.schedule)


NAMES = ["out.kml", "out.rtz", "out.ed318.json", "out.f3548.json", "out.geojson", "out.parquet"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("object_class", ["ferry", "USPACE", None])
@pytest.mark.parametrize("owner", ["line", None])
def test_class_and_owner_come_back_from_each_format(
    name: str, object_class: str | None, owner: str | None, tmp_path: Path
) -> None:
    """ED-318 and F3548 lost both: rules of the class were not applied, and objects of one owner were compared."""
    pytest.importorskip("pyogrio" if name.endswith("kml") else "json")
    more = {"object_class": object_class, "owner": owner, "properties": {"colour": "red", "type": "CONDITIONAL"}}
    area = Area("A1", BOX, "n" * 300, BEGIN, BEGIN + HOUR, **more)  # type: ignore[arg-type]
    track = Track("T1", [(4, 57), (5, 57)], [BEGIN, BEGIN + HOUR], [(0, 0)], "m" * 300, **more)  # type: ignore[arg-type]
    areas, tracks = ([], [track]) if name.endswith("rtz") else ([area], [] if "ed318" in name else [track])
    write_scene_file([*areas, *tracks], tmp_path / name, Scene("s"))
    found = read(tmp_path / name, hints=FileHints(unbounded_heights=True))
    again = [*found.areas, *found.tracks]
    volumes_of = {"A1/1": "A1"} | {one.key: "T1" for one in again if one.key.startswith("T1/")}
    assert {volumes_of.get(one.key, one.key) for one in again} == {one.key for one in [*areas, *tracks]}
    for one in again:
        key = volumes_of.get(one.key, one.key)
        assert (one.object_class, one.name) == (object_class, {"A1": "n", "T1": "m"}[key] * 300)
        assert one.owner == (owner if owner or key == one.key else key)  # volumes of one plan are not compared
        assert one.properties["colour"] == "red"
        if name in ("out.geojson", "out.parquet"):
            assert one.properties == more["properties"]


def test_extended_properties_of_ed318_stay_the_users(tmp_path: Path) -> None:
    own = {"extendedProperties": {"mine": 1}}
    for properties, owner in ((own, "me"), (own, None), ({"extendedProperties": "text"}, "me")):
        area = Area("A1", SQUARE, owner=owner, object_class="PROHIBITED", properties=properties)
        (again,) = read(written(tmp_path / "out.ed318.json", [area], [])).areas
        assert again.properties["extendedProperties"] == properties["extendedProperties"]
        assert again.owner == owner


@pytest.mark.parametrize("name", NAMES)
def test_settings_and_schedules_that_a_format_lacks_are_said(name: str, tmp_path: Path) -> None:
    """A scene's rules and separation were lost without a word."""
    scene = Scene("s", separation_m=50.0, rules=[Rule("ferry", "area", separation_m=500.0)], horizon_days=30)
    daily = {"schedule": {"days": ["TUE"], "periods": [["08:00", "10:00"]]}}
    area = Area("A1", BOX, None, BEGIN, BEGIN + HOUR, spans_us=[(BEGIN, BEGIN + HOUR)], **daily)
    track = Track("T1", [(4, 57), (5, 57)], [BEGIN, BEGIN + HOUR], [(0, 0)])
    plans = [track] if name.endswith("rtz") else [area]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        write_scene_file(plans, tmp_path / name, scene)
    texts = [str(one.message) for one in caught]
    if name in ("out.geojson", "out.parquet"):
        assert texts == []
        return
    assert "holds no settings of a scene: separation_m, rules of 's' are not in the file" in texts[0]
    assert len(texts) == (1 if name == "out.rtz" else 2)
    if texts[1:]:
        assert "1 objects are in the file with their activations within the horizon of 30 days" in texts[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_scene_file([replace(one, schedule=None) for one in plans], tmp_path / name, Scene("s"))


@pytest.mark.parametrize("name", ["plans.kmz", "plans.CSV.gz", "plans.s421", "plans.notam"])
def test_a_format_that_is_only_read_is_not_written(tmp_path: Path, name: str) -> None:
    """It became a scene file, which does not load under that name."""
    with pytest.raises(InvalidInput, match=r"this format is read, not written: write \.rtz, \.gpx, \.kml"):
        write_scene_file([], tmp_path / name, Scene("plans"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "command"), [("a.ics", "conflicts KEY --format ics"), ("a.pdf", "report"), ("a.png", "plot")]
)
def test_a_file_that_holds_no_plans_is_not_written(tmp_path: Path, name: str, command: str) -> None:
    """It became a scene file in silence."""
    with pytest.raises(InvalidInput, match=f"holds no plans: `{command}`"):
        write_scene_file([], tmp_path / name, Scene("plans"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("datum", ["msl", "wgs84", "flight_level"])
def test_a_route_says_what_its_heights_are_above(tmp_path: Path, datum: str) -> None:
    """Heights of a scene of the ellipsoid were read into scenes of mean sea level, in silence."""
    times = np.array(["2026-06-01T08:00", "2026-06-01T09:00"], "datetime64[us]")
    outline = [(5.0, 5.0), (5.0, -5.0), (-5.0, -5.0), (-5.0, 5.0)]
    for heights in ({"floor_m": 10.0}, {"floors_m": [10.0, 20.0], "ceilings_m": [30.0, 40.0]}, {}):
        track = Track("T", [(8.0, 54.0), (8.1, 54.0)], times, outline, **heights)
        path = tmp_path / "route.rtz"
        write_scene_file([track], path, Scene("s", vertical_datum=datum))
        (again,) = read(path, hints=FileHints(vertical_datum=datum)).tracks
        assert again.properties == {}
        assert again.floor_m == track.floor_m
        np.testing.assert_array_equal(again.floors_m, track.floors_m)
        for other in {"msl", "wgs84", "flight_level"} - {datum}:
            if heights:
                with pytest.raises(InvalidInput, match=f"vertical_datum: must be '{other}'"):
                    read(path, hints=FileHints(vertical_datum=other))
            else:
                read(path, hints=FileHints(vertical_datum=other))
