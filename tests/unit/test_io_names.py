"""An unknown member is refused if it looks like a known one; others are kept as properties."""

import json
from pathlib import Path
from typing import Any

import pytest
import shapely
from plan_files import HAVEN, SQUARE, TIMES, area, read, refusal, track, write

from conflictdb import formats
from conflictdb.cli.load_report import remark_read
from conflictdb.errors import MOST_TOLD, InvalidInput
from conflictdb.formats.contents import Remark, Skipped
from conflictdb.formats.instants import parse_instant
from conflictdb.formats.scene_file import read_scene, scene_text
from conflictdb.model.plans import Area, Scene, Track


def mistakes(tmp_path: Path, *features: dict[str, Any], **members: Any) -> list[tuple[str, str, str]]:
    return [(one.key, one.field, one.rule) for one in refusal(write(tmp_path, *features, **members))]


@pytest.mark.parametrize(
    ("feature", "name", "value", "meant"),
    [
        (track, "grow_mp", 0.5, "grow_mps"),
        (track, "grow", 0.5, "grow_mps"),
        (track, "growth_kn", "0.5 kn", "grow_mps"),
        (track, "GROW_MPS", 0.5, "grow_mps"),
        (track, "outlines", [[[0, 0]]], "outlines_m"),
        (track, "floor_ft", 1000, "floor_m"),
        (track, "CeilingFL", "195", "ceiling_m"),
        (area, "begin", TIMES[0], "start"),
        (area, "START", TIMES[0], "start"),
        (area, "strat", TIMES[0], "start"),
        (area, "startTime", TIMES[0], "start"),
        (area, "end_utc", TIMES[1], "end"),
        (area, "until", TIMES[1], "end"),
        (area, "floor", 5, "floor_m"),
        (area, "Floor (ft)", "1200", "floor_m"),
        (area, "cieling_m", 5, "ceiling_m"),
    ],
)
def test_a_member_that_looks_like_a_known_one_is_refused(
    tmp_path: Path, feature: Any, name: str, value: Any, meant: str
) -> None:
    ((key, field, rule),) = mistakes(tmp_path, feature(**{name: value}))
    assert (key[-3:], field) in {("'A'", name), ("'T'", name)}
    assert f"did you mean {meant}?" in rule
    # Named as foreign it stays a property; null says nothing, and cannot be lost.
    (item,) = [*(kept := read(tmp_path, feature(**{name: value}), foreign=[name])).areas, *kept.tracks]
    assert item.properties == {name: value}
    assert read(tmp_path, feature(**{name: None})).remarks == []


@pytest.mark.parametrize(
    ("feature", "name", "value"),
    [
        (area, "remark", "until further notice"),
        (area, "colour", "red"),
        (area, "color", 7),
        (area, "status", 3),
        (area, "port", "Bergen"),
        (area, "port", 3),
        (area, "starboard", True),
        (area, "start_port", "Bergen"),
        (area, "stat", "closed"),
        (area, "state", "2 of 3 closed"),  # two letters from start: difflib rates it like strat, which is refused
        (area, "trend", 5),
        (area, "NAME", "x"),
        (area, "motion", "slow"),
        (area, "centre", [1, 2]),
        (track, "port", "Bergen"),
        (track, "speed", 12.5),  # the times say how fast
        (track, "course", 270),
        (track, "draught_m", 7),
        (track, "time_zone", "UTC+1"),
    ],
)
def test_other_members_are_kept(tmp_path: Path, feature: Any, name: str, value: Any) -> None:
    (item,) = [*(contents := read(tmp_path, feature(**{name: value}))).areas, *contents.tracks]
    assert item.properties == {name: value}
    assert ["look like heights" in one.text for one in contents.remarks] == [True] * (name == "draught_m")


def test_the_same_in_another_unit_beside_the_known_one_is_kept(tmp_path: Path) -> None:
    assert read(tmp_path, area(floor_m=304.8, floor_ft=1000)).areas[0].properties == {"floor_ft": 1000}


@pytest.mark.parametrize(
    ("feature", "name", "value", "rule"),
    [
        (track, "separation_m", 500, 'put it into the member "scene"'),
        (area, "separation_nmi", 5, 'put it into the member "scene"'),
        (area, "tolerance", "5", 'put it into the member "scene"'),
        (area, "grow_mps", 1, "tracks only"),
        (area, "times", TIMES, "tracks only"),
        (area, "fore_m", 5, "tracks only"),
        (track, "end", TIMES[1], "areas only"),
    ],
)
def test_a_member_at_another_place_is_refused(tmp_path: Path, feature: Any, name: str, value: Any, rule: str) -> None:
    ((_, field, said),) = mistakes(tmp_path, feature(**{name: value}))
    assert field == name
    assert rule in said


@pytest.mark.parametrize(
    ("name", "value", "rule"),
    [
        ("separation_m", 500, 'put it into the member "scene"'),
        ("motion", "great_circle", 'put it into the member "scene"'),
        ("Scene", {"separation_m": 5}, "did you mean scene?"),
        ("scenes", {"separation_m": 5}, "did you mean scene?"),
        ("grow_mps", 1, "belongs into the properties"),
        ("CRS", {"properties": {"name": "EPSG:3857"}}, "did you mean crs?"),
        ("foreign", "colour", "must be a list of names"),
    ],
)
def test_members_of_the_file_are_judged_too(tmp_path: Path, name: str, value: Any, rule: str) -> None:
    ((key, field, said),) = mistakes(tmp_path, area(), **{name: value})
    assert (key, field) == ("file", name)
    assert rule in said


@pytest.mark.parametrize(
    ("where", "name", "value", "rule"),
    [
        ("feature", "end", TIMES[0], "belongs into the properties"),
        ("feature", "separation_m", 5, "is a setting"),
        ("feature", "Properties", {"end": TIMES[0]}, "did you mean properties?"),
        ("feature", "props", {"end": TIMES[0]}, "did you mean properties?"),
        ("geometry", "floor_m", 5, "belongs into the properties"),
    ],
)
def test_members_of_features_and_geometries_are_judged_too(
    tmp_path: Path, where: str, name: str, value: Any, rule: str
) -> None:
    feature = area()
    del feature["properties"]
    (feature if where == "feature" else feature["geometry"])[name] = value
    ((_, field, said),) = mistakes(tmp_path, feature)
    assert field == name
    assert rule in said


def test_members_of_a_moving_point_are_judged_too(tmp_path: Path) -> None:
    moving = {"type": "MovingPoint", "coordinates": [[4, 57], [5, 57]], "datetimes": TIMES, "Interpolation": "Stepwise"}
    feature = {"type": "Feature", "id": "M", "temporalGeometry": moving, "properties": {**HAVEN, "grow": 1}}
    found = mistakes(tmp_path, feature)
    assert [(key, field) for key, field, _ in found] == [
        ("track 'M': temporalGeometry", "Interpolation"),
        ("track 'M'", "grow"),
    ]


def test_ordinary_members_of_other_programs_are_no_mistakes(tmp_path: Path) -> None:
    others = {"name": "layer", "bbox": [4, 57, 5, 58], "xy_coordinate_resolution": 1e-7, "timeStamp": TIMES[0]}
    feature = {**area(), "bbox": [4, 57, 5, 58], "geometry_name": "geom", "links": []}
    assert len(read(tmp_path, feature, **others, numberReturned=1, links=[]).areas) == 1


def test_settings_are_suggested(tmp_path: Path) -> None:
    ((_, field, rule),) = mistakes(tmp_path, area(), scene={"seperation_m": 5})
    assert (field, rule) == ("seperation_m", "is no setting of a scene; did you mean separation_m?")


def test_all_mistakes_are_told_in_one_go(tmp_path: Path) -> None:
    bow = [[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]
    bad_ring = area("ring", bow, begin=TIMES[0], floor_m=5, ceiling_m=1)
    untimed = track("untimed", fore_m=-1, name=5, grow_mps="fast", times=[TIMES[1], "later"])
    backwards = track("backwards", times=TIMES[::-1], floor_m=2, ceiling_m=1)
    found = mistakes(
        tmp_path, bad_ring, area("A"), untimed, area("A"), backwards, scene={"motion": "flat"}, tolerance_m=5
    )
    assert [(key, field) for key, field, _ in found] == [
        ("file", "tolerance_m"),
        ("scene 'plan'", "motion"),
        ("area 'ring'", "begin"),
        ("track 'untimed'", "times[1]"),
        ("track 'untimed'", "fore_m"),
        ("track 'untimed'", "name"),
        ("track 'untimed'", "grow_mps"),
        ("track 'backwards'", "times[1]"),
        ("track 'backwards'", "ceiling_m"),
        ("area 'A'", "id"),
    ]


@pytest.mark.parametrize(("more", "last"), [(0, f"area 'A{MOST_TOLD - 1}': it_{'x' * MOST_TOLD}"), (5, "and 5 more")])
def test_of_many_mistakes_the_first_are_told_and_the_rest_counted(more: int, last: str) -> None:
    found = [InvalidInput(f"area 'A{i}'", f"it_{'x' * (i + 1)}", "is wrong") for i in range(MOST_TOLD + more)]
    lines = str(InvalidInput(found[0].key, found[0].field, found[0].rule, "", found[1:])).splitlines()
    assert len(lines) == MOST_TOLD + (more > 0)
    assert lines[0] == "area 'A0': it_x: is wrong"
    assert last in lines[-1]


def test_one_reason_of_many_objects_is_said_once(tmp_path: Path) -> None:
    """324 lines of a feed of zones were two reasons. Values may differ; the first object is said in full."""
    features = [area(f"A{i}", begin=TIMES[i % 2]) for i in range(25)] + [area("B", floor_m="x"), area("C", floor_m="y")]
    lines = str(refusal(path := write(tmp_path, *features))).splitlines()
    assert len(lines) == 3
    assert lines[0].startswith(f"{path}: area 'A0': begin: is not known; did you mean start?")
    assert lines[0].endswith(" (and 24 more: 'A1', 'A2', 'A3', 'A4', 'A5', …)")
    assert "area 'B': floor_m: must be a number; got 'x'" in lines[1]
    assert "area 'C': floor_m: must be a number; got 'y'" in lines[2]


def test_left_out_objects_and_remarks_of_one_reason_are_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    skipped = [
        Skipped("a.json", f"zone 'Z{i}'", f"upper: is {i} m above ground", (), is_whole=True) for i in range(300)
    ]
    remark_read(skipped, [Remark("a.txt", f"NOTAM 'A{i}'", "is a circle") for i in range(9)])
    first, second = capsys.readouterr().err.splitlines()
    assert "left out zone 'Z0': upper: is 0 m above ground (and 299 more: 'Z1', 'Z2', 'Z3', 'Z4', 'Z5', …)" in first
    assert "a.txt: NOTAM 'A0': is a circle (and 8 more: 'A1', 'A2', 'A3', 'A4', 'A5', …)" in second


def test_what_is_exported_with_suspect_properties_reads_back() -> None:
    """SQL may have put a property of any name; the file says then that it is foreign."""
    square = shapely.MultiPolygon([shapely.Polygon(SQUARE)])
    odd = Area("A", square, properties={"begin": TIMES[0], "separation_m": 5, "colour": "red"})
    text = "".join(scene_text(Scene("s"), [odd], []))
    assert json.loads(text)["foreign"] == ["begin", "separation_m"]
    assert read_scene(text, "s").areas[0].properties == odd.properties


@pytest.mark.parametrize(
    ("column", "cell", "rule"),
    [
        ("length_ft", "300", "did you mean length_m?"),
        ("Lenght", "90", "did you mean length_m?"),
        ("floor_ft", "300", "did you mean floor_m?"),
        ("fore_nmi", "1", "did you mean fore_m?"),
        ("separation_m", "500", "is a setting"),
        ("grow_mps", "1", "scene files only"),
        ("fore_m", "5", "needs the other sides"),
    ],
)
def test_columns_of_positions_are_judged_by_the_same_rule(tmp_path: Path, column: str, cell: str, rule: str) -> None:
    path = tmp_path / "fixes.csv"
    path.write_text(f"id,time,lon,lat,{column}\na,{TIMES[0]},4,57,\na,{TIMES[1]},4.1,57,{cell}\n")
    (refused,) = refusal(path)
    assert (refused.key, refused.field) == ("file", f"column {column}")
    assert rule in refused.rule


def test_other_columns_of_positions_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "fixes.csv"
    rows = [f"a,{TIMES[0]},4,57,9,3,Bergen,12", f"a,{TIMES[1]},4.1,57,9,3,Bergen,12"]
    path.write_text("\n".join(["id,time,lon,lat,length_m,width_m,port,speed_kn", *rows]) + "\n")
    assert formats.read(path).tracks[0].properties == {"port": "Bergen", "speed_kn": "12"}


def test_all_mistakes_of_a_file_of_positions_are_told(tmp_path: Path) -> None:
    path = tmp_path / "fixes.csv"
    rows = [f"a,{TIMES[0]},4,x", "a,yesterday,4,57", f"b,{TIMES[0]},4", f"b,{TIMES[0]},4,99"]
    path.write_text("\n".join(["id,time,lon,lat", *rows]) + "\n")
    assert [one.field for one in refusal(path)] == ["line 2, lat", "line 3, time", "line 4", "line 5, lat"]


def test_positions_without_sizes_are_remarked_on(tmp_path: Path) -> None:
    path = tmp_path / "fixes.csv"
    path.write_text(f"id,time,lon,lat\na,{TIMES[0]},4,57\na,{TIMES[1]},4.1,57\n")
    assert [remark.text for remark in formats.read(path).remarks] == [
        "has no columns of sizes (length_m and width_m, or fore_m, aft_m, port_m and starboard_m): all are points"
    ]


def test_a_file_without_objects_is_remarked_on(tmp_path: Path) -> None:
    assert [str(remark) for remark in read(tmp_path).remarks] == [
        f"{tmp_path / 'plan.geojson'}: file: holds no objects"
    ]


def at(key: str, lon: float, lat: float) -> dict[str, Any]:
    return area(key, [[lon + x - 4, lat + y - 57] for x, y in SQUARE])


@pytest.mark.parametrize(
    ("features", "remarks"),
    [
        ([at("A", 4, 57), at("B", 5, 58)], []),
        ([at("A", 4, 57), at("B", -70, -30)], []),
        ([at("A", 4, 57), at("B", 57, 4)], ["area 'B': lies 7,387 km from the other objects, but among them"]),
        ([at("A", 4, 57), at("B", 5, 57), at("C", 57, 5)], ["area 'C': lies 7,237 km from the other objects, but"]),
        ([at("A", 4, 57), at("B", 5, 57), at("C", 40, 57)], ["area 'C': lies 2,005 km from the other objects, which"]),
        ([at(str(i), 4 + i, 57) for i in range(30)], []),
        ([at("A", -179, 0), at("B", 179, 0), at("C", 178, 1)], []),
    ],
)
def test_an_object_far_from_all_others_is_remarked_on(
    tmp_path: Path, features: list[dict[str, Any]], remarks: list[str]
) -> None:
    said = [f"{remark.key}: {remark.text}" for remark in read(tmp_path, *features).remarks]
    assert [one[: len(begin)] for one, begin in zip(said, remarks, strict=True)] == remarks


@pytest.mark.parametrize("motion", ["rhumb", "great_circle"])
def test_a_track_that_is_too_fast_is_refused_unless_that_is_meant(tmp_path: Path, motion: str) -> None:
    fast = track("fast", times=None, start=TIMES[0], speed_kn=[120_000])
    late = track("late", times=[TIMES[0], "2026-03-01T05:00:10Z"])
    found = mistakes(tmp_path, fast, track("good"), late, scene={"motion": motion})
    assert [(key, field) for key, field, _ in found] == [("track 'fast'", "speed_kn"), ("track 'late'", "times[1]")]
    assert found[0][2].startswith("is 120,000 kn, beyond 2000 kn; if that is meant, raise --max-speed-kn")
    tracks = formats.read(tmp_path / "plan.geojson", max_speed_kn=120_000).tracks
    assert [item.key for item in tracks] == ["fast", "good", "late"]
    assert tracks[2].times_us[1] == parse_instant("2026-03-01T05:00:10Z")
    assert isinstance(tracks[0], Track)
