"""Files of positions: unusable rows are left out by name, other files are refused."""

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conflictdb import formats
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import rectangle_outline_m

HEADER = "id,time,lon,lat,length_m,width_m"


def read(tmp_path: Path, *lines: str, name: str = "fixes.csv", max_speed_kn: float | None = None) -> formats.Contents:
    (tmp_path / name).write_text("\n".join(lines) + "\n")
    return formats.read(tmp_path / name, max_speed_kn=max_speed_kn)


def fix(key: str, minute: int, lon: float, size: str = "100,20") -> str:
    return f"{key},2026-03-01T00:{minute:02}:00Z,{lon},57,{size}"


def reasons(contents: formats.Contents) -> dict[tuple[str, str], tuple[tuple[int, ...], bool]]:
    return {(s.key, s.reason): (s.lines, s.is_whole) for s in contents.skipped}


def test_rows_become_tracks_with_a_centred_haven(tmp_path: Path) -> None:
    contents = read(tmp_path, HEADER, fix("a", 0, 4.0), fix("b", 0, 5.0), fix("b", 1, 5.01), fix("a", 1, 4.01))
    assert contents.skipped == []
    assert [track.key for track in contents.tracks] == ["a", "b"]
    assert contents.tracks[0].positions_deg.tolist() == [[4.0, 57.0], [4.01, 57.0]]
    assert contents.tracks[0].outline_m.tolist() == [[10, 50], [10, -50], [-10, -50], [-10, 50]]


def test_rows_may_come_in_any_order(tmp_path: Path) -> None:
    (track,) = read(tmp_path, HEADER, fix("a", 2, 4.02), fix("a", 0, 4.0), fix("a", 1, 4.01)).tracks
    assert track.positions_deg[:, 0].tolist() == [4.0, 4.01, 4.02]


def test_without_size_columns_objects_are_points(tmp_path: Path) -> None:
    rows = ("id,time,lon,lat", "a,2026-03-01T00:00:00Z,4,57", "a,2026-03-01T01:00:00Z,4.1,57")
    assert read(tmp_path, *rows).tracks[0].outline_m.tolist() == [[0.0, 0.0]]


def test_ais_names_utc_times_and_constant_columns(tmp_path: Path) -> None:
    rows = (
        "datetime,mmsi,lon,lat,SOG,shiptype,length,name,width",
        "2026-03-01 00:00:00,7,4,57,10,Cargo,90,Vessel,12",
        "2026-03-01 00:10:00,7,4.01,57,11,Cargo,,Vessel,14",
    )
    (tmp_path / "ais.csv.gz").write_bytes(gzip.compress("\n".join(rows).encode()))
    (track,) = formats.read(tmp_path / "ais.csv.gz").tracks
    assert (track.key, track.name, track.properties) == ("7", "Vessel", {"shiptype": "Cargo"})
    assert np.ptp(track.outline_m, axis=0).tolist() == [14, 90]


def test_own_sides_and_heights(tmp_path: Path) -> None:
    rows = (
        "id;time;lon;lat;fore_m;aft_m;port_m;starboard_m;floor_m;ceiling_m",
        "a;2026-03-01T00:00:00Z;4;57;9;8;7;6;100;200",
        "a;2026-03-01T00:10:00Z;4;57;9;8;7;6;50;150",
    )
    (track,) = read(tmp_path, *rows).tracks
    assert track.outline_m.tolist() == [[6, 9], [6, -8], [-7, -8], [-7, 9]]
    assert (track.floor_m, track.ceiling_m) == (50, 200)


def test_a_row_without_a_height_leaves_its_track_unbounded(tmp_path: Path) -> None:
    rows = ["id,time,lat,lon,length,width,floor_m,ceiling_m"]
    for key, heights in (("A", ("100,200", ",")), ("B", ("100,200", "50,")), ("C", (",", ",")), ("D", ("1,2", "3,4"))):
        rows += [f"{key},2026-03-01T0{hour}:00Z,57,9,9,4,{one}" for hour, one in enumerate(heights)]
    rows.append("D,,57,9,9,4,,")  # without a time, so of no place
    contents = read(tmp_path, *rows)
    bands = {track.key: (track.floor_m, track.ceiling_m) for track in contents.tracks}
    assert bands == {"A": (None, None), "B": (50.0, None), "C": (None, None), "D": (1.0, 4.0)}
    assert [remark.text for remark in contents.remarks] == [
        "has rows without floor_m of 1 tracks, whose floor is then unbounded: 'A'",
        "has rows without ceiling_m of 2 tracks, whose ceiling is then unbounded: 'A', 'B'",
    ]


@pytest.mark.parametrize(
    ("header", "column"),
    [
        ("id,time,lat,latitude,lon", "latitude: gives the same as the column lat"),
        ("id,time,LAT,lat,lon", "lat: gives the same as the column LAT"),
        ("mmsi,time,lat,lon,length,length_m", "length_m: gives the same as the column length"),
    ],
)
def test_two_columns_for_one_value_are_refused(header: str, column: str, tmp_path: Path) -> None:
    row = ",".join(["1", "2026-03-01T06:00Z", *["9"] * (header.count(",") - 1)])
    with pytest.raises(InvalidInput, match=f"column {column}"):
        read(tmp_path, header, row)
    assert read(tmp_path, f"{header.replace('latitude', 'x').replace('LAT', 'x').replace('length_m', 'x')}", row)


def test_rows_at_a_taken_time_are_left_out(tmp_path: Path) -> None:
    contents = read(
        tmp_path, HEADER, fix("a", 0, 4.0), fix("a", 0, 4.0), fix("a", 0, 4.001), fix("a", 1, 4.01), fix("a", 0, 4.0)
    )
    assert reasons(contents) == {
        ("a", "the same fix as an earlier row"): ((3, 6), False),
        ("a", "at another place at the same time as an earlier row"): ((4,), False),
    }
    assert contents.tracks[0].positions_deg[:, 0].tolist() == [4.0, 4.01]


@pytest.mark.parametrize("wrong", [0, 2, 4])
def test_a_fix_that_cannot_be_reached_is_left_out(tmp_path: Path, wrong: int) -> None:
    rows = [fix("a", minute, 9.0 if minute == wrong else 4.0 + 0.001 * minute) for minute in range(5)]
    contents = read(tmp_path, HEADER, *rows, max_speed_kn=50)
    assert reasons(contents) == {("a", "not reached from the fixes around it at 50 kn"): ((wrong + 2,), False)}
    assert len(contents.tracks[0].times_us) == 4


def test_a_jump_costs_only_the_fixes_that_are_too_near_in_time(tmp_path: Path) -> None:
    rows = [fix("a", minute, 4.0 if minute < 20 else 4.05) for minute in range(40)]  # 3.0 km: 2 minutes at 50 kn
    contents = read(tmp_path, HEADER, *rows, max_speed_kn=50)
    assert [len(skipped.lines) for skipped in contents.skipped] == [1]
    assert len(contents.tracks[0].times_us) == 39


def test_speed_limits_by_default(tmp_path: Path) -> None:
    rows = [fix("a", 0, 4.0), fix("a", 1, 4.2)]  # 400 kn
    assert read(tmp_path, HEADER, *rows).skipped == []
    assert read(tmp_path, HEADER.replace("id", "mmsi", 1), *rows).tracks == []


def test_objects_without_size_or_with_a_single_fix_are_left_out(tmp_path: Path) -> None:
    contents = read(
        tmp_path, HEADER, fix("a", 0, 4.0, ","), fix("a", 1, 4.0, "NA,20"), fix("b", 0, 4.0), fix("c", 0, 4.0, ",")
    )
    assert contents.tracks == []
    assert reasons(contents) == {
        ("a", "no length_m"): ((2, 3), True),
        ("b", "a single fix: no movement to follow"): ((4,), True),
        ("c", "no length_m and width_m"): ((5,), True),
    }


def test_size_zero_is_not_available_in_ais_but_a_point_otherwise(tmp_path: Path) -> None:
    rows = (fix("a", 0, 4.0, "0,0"), fix("a", 1, 4.0, "0,0"))
    assert len(read(tmp_path, HEADER, *rows).tracks) == 1
    assert read(tmp_path, HEADER.replace("_m", ""), *rows).tracks == []


def test_rows_without_identity_time_or_position_are_left_out(tmp_path: Path) -> None:
    lines = (
        HEADER,
        ",2026-03-01T00:00:00Z,4,57,1,1",
        "a,,4,57,1,1",
        "a,2026-03-01T00:00:00Z,181,91,1,1",
        fix("a", 1, 4.0),
    )
    assert reasons(read(tmp_path, *lines)) == {
        ("(rows without id)", "no id"): ((2,), True),
        ("a", "no time"): ((3,), True),
        ("a", "no position"): ((4,), True),
        ("a", "a single fix: no movement to follow"): ((5,), True),
    }


@pytest.mark.parametrize("size", ["100,20", ","])
def test_an_object_without_any_position_is_left_out_once(tmp_path: Path, size: str) -> None:
    """AIS encodes "not available" as latitude 91 and longitude 181; such an object is not a refused plan."""
    lost = f"b,2026-03-01T00:00:00Z,181,91,{size}"
    contents = read(tmp_path, HEADER, fix("a", 0, 4.0), fix("a", 1, 4.01), lost)
    assert reasons(contents) == {("b", "no position"): ((4,), True)}
    assert not contents.skipped[0].is_refused


@pytest.mark.parametrize(
    ("lines", "key", "field", "rule"),
    [
        (["id,time,lon", "a,b,c"], "file", "column lat", "is missing"),
        ([], "file", "column id", "is missing"),
        ([HEADER, "a,2026-03-01T00:00:00Z,4"], "file", "line 2", "has 3 cells, but there are 6 columns"),
        ([HEADER, "a,2026-03-01T00:00:00,4,57,1,1"], "track 'a'", "line 2, time", "offset"),
        ([HEADER, "a,yesterday,4,57,1,1"], "track 'a'", "line 2, time", "ISO 8601"),
        ([HEADER, "a,2026-03-01T00:00:00Z,x,57,1,1"], "track 'a'", "line 2, lon", "finite number"),
        ([HEADER, "a,2026-03-01T00:00:00Z,inf,57,1,1"], "track 'a'", "line 2, lon", "finite number"),
        ([HEADER, "a,2026-03-01T00:00:00Z,57,104,1,1"], "track 'a'", "line 2, lat", "latitude"),
        ([HEADER, "a,2026-03-01T00:00:00Z,500,4,1,1"], "track 'a'", "line 2, lon", "longitude"),
        ([HEADER, "a,2026-03-01T00:00:00Z,4,57,-1,1"], "track 'a'", "line 2, length_m", "negative"),
        ([HEADER, 'a,"2026'], "file", "line 2", "is not CSV"),
    ],
)
def test_what_is_no_position_file_is_refused(tmp_path: Path, lines: list[str], key: str, field: str, rule: str) -> None:
    with pytest.raises(InvalidInput, match=rule) as caught:
        read(tmp_path, *lines)
    assert (caught.value.key, caught.value.field) == (key, field)
    assert caught.value.source == str(tmp_path / "fixes.csv")


def ais(tmp_path: Path, *sizes: str, header: str = "A,B,C,D", **hints: Any) -> formats.Contents:
    rows = [f"MMSI,BaseDateTime,LAT,LON,{header}"]
    for i, size in enumerate(sizes, 1):
        rows += [f"{219000000 + i},2026-06-01T1{hour}:30:00,57.1,9.{hour},{size}" for hour in (0, 1)]
    (tmp_path / "ais.csv").write_text("\n".join(rows))
    return formats.read(tmp_path / "ais.csv", hints=formats.FileHints(**hints))


@pytest.mark.parametrize(
    ("size", "sides", "filled"),
    [
        ("60,40,10,9", (60, 40, 10, 9), (60, 40, 10, 9)),
        ("0,100,10,9", (0, 100, 10, 9), (0, 100, 10, 9)),  # the position is that of the bow
        ("0,100,0,20", (100, 100, 20, 20), (100, 100, 20, 20)),  # of a place on board that is not known
        ("0,0,0,0", None, (1, 2, 3, 4)),
        ("0,100,0,0", (100, 100, 0, 0), (100, 100, 3, 4)),
        ("60,40,0,0", (60, 40, 0, 0), (60, 40, 3, 4)),
        ("0,0,10,9", (0, 0, 10, 9), (1, 2, 10, 9)),
        (",,,", None, (1, 2, 3, 4)),
        ("60,,10,9", None, (60, 2, 10, 9)),
        ("0,100,,", None, (100, 100, 3, 4)),
    ],
)
def test_ais_sizes_with_zeros_and_empty_cells(
    size: str, sides: tuple[float, ...] | None, filled: tuple[float, ...], tmp_path: Path
) -> None:
    """Four zeros are no size; A = C = 0 is one whose reference point is not known. A haven fills in what is missing."""
    contents = ais(tmp_path, size, "60,40,10,9")
    outlines = {track.key: track.outline_m.tolist() for track in contents.tracks}
    assert outlines.get("219000001") == (None if sides is None else rectangle_outline_m(*sides).tolist())
    texts = [one.text for one in contents.remarks]
    if sides is None:
        assert texts == ["1 of 2 objects have no size and are left out, such as '219000001': --haven gives them one"]
    elif 0 in (sides[0] + sides[1], sides[2] + sides[3]):
        assert "1 of 2 objects have a length and no width, or the reverse" in texts[0]
    else:
        assert texts == []
    (first, _) = ais(tmp_path, size, "60,40,10,9", haven_m=(1, 2, 3, 4)).tracks
    assert first.outline_m.tolist() == rectangle_outline_m(*filled).tolist()


@pytest.mark.parametrize(
    ("header", "size", "sides"),
    [
        ("Length,Width", "100,0", (50, 50, 3, 4)),
        ("Length,Width", ",20", (1, 2, 10, 10)),
        ("Length,Width", ",", (1, 2, 3, 4)),
        ("length_m", "100", (50, 50, 3, 4)),
        ("A,B,C,D,Length,Width", "0,0,0,0,100,20", (50, 50, 10, 10)),
        ("A,B,C,D,Length,Width", "60,40,0,0,100,20", (60, 40, 10, 10)),
        ("A,B,C,D,Length,Width", "60,,12,8,100,20", (60, 40, 12, 8)),
    ],
)
def test_a_haven_fills_in_each_size_that_is_missing(
    header: str, size: str, sides: tuple[float, ...], tmp_path: Path
) -> None:
    """Ships with an empty cell were left out, although --haven was given; sides and lengths complete each other."""
    (track,) = ais(tmp_path, size, header=header, haven_m=(1, 2, 3, 4)).tracks
    assert track.outline_m.tolist() == rectangle_outline_m(*sides).tolist()


def test_class_and_owner_are_those_of_the_object(tmp_path: Path) -> None:
    rows = ("id,time,lon,lat,Class,owner", *(f"{key},2026-03-01T00:0{i}:00Z,4,57.{i},{rest}"
            for key, rest in (("a", "ferry,line"), ("b", ",")) for i in (0, 1)))  # fmt: skip
    a, b = read(tmp_path, *rows).tracks
    assert (a.object_class, a.owner, a.properties) == ("ferry", "line", {})
    assert (b.object_class, b.owner) == (None, None)
    with pytest.raises(InvalidInput, match="line 3, Class: must be the same in all rows"):
        read(tmp_path, rows[0], rows[1], rows[2].replace("ferry", "tug"))


@pytest.mark.parametrize("member", ["schedule", "departures", "xtd_port_m", "departure_window", "max_speed_kn"])
def test_members_of_scene_files_are_refused(tmp_path: Path, member: str) -> None:
    """They would count for nothing, and conflicts be missed."""
    rows = (f"id,time,lon,lat,{member}", *(f"a,2026-03-01T00:0{i}:00Z,4,57.{i},5" for i in (0, 1)))
    with pytest.raises(InvalidInput, match=f"column {member}: is read from scene files only"):
        read(tmp_path, *rows)


def test_two_ships_of_one_identity_are_two_tracks(tmp_path: Path) -> None:
    """Half of the fixes were left out as outliers: the ship that had fewer was missed."""
    rows = [fix("a", minute, 4.0 + 0.001 * minute if minute % 2 else 14.0 + 0.001 * minute) for minute in range(12)]
    contents = read(tmp_path, HEADER, *rows, fix("b", 0, 4.0), fix("b", 9, 4.0), max_speed_kn=50)
    assert contents.skipped == []
    assert {track.key: track.positions_deg[0, 0] for track in contents.tracks}.keys() == {"a", "a/2", "b"}
    assert sorted(len(track.times_us) for track in contents.tracks) == [2, 6, 6]
    remark = contents.remarks[0]
    assert remark.text.startswith("1 more ships than ids: fixes of one id alternate between places")
    assert remark.text.endswith("so there are two ships; the other is 'a/2'")


def test_two_ships_that_report_at_the_same_times_are_two_tracks(tmp_path: Path) -> None:
    rows = [fix("a", minute, lon + 0.001 * minute) for minute in range(6) for lon in (4.0, 14.0)]
    contents = read(tmp_path, HEADER, *rows, fix("a/2", 0, 4.0), fix("a/2", 9, 4.0), max_speed_kn=50)
    assert [(track.key, len(track.times_us)) for track in contents.tracks] == [("a", 6), ("a/3", 6), ("a/2", 2)]


@pytest.mark.parametrize("key", ["2.19E+08", "2,19e+08", "219E6"])
def test_an_identity_that_a_spreadsheet_rounded_is_refused(key: str, tmp_path: Path) -> None:
    rows = [fix(f'"{key}"', minute, 4.0) for minute in range(2)]
    with pytest.raises(InvalidInput, match=r"line 2, id: is a number in scientific notation.*two ships have one id"):
        read(tmp_path, HEADER, *rows)
