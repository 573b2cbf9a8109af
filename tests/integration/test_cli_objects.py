"""`load` and `export`: all or nothing, add or replace, and a round trip through the database that is exact."""

import gzip
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import psycopg
import pytest
from commands import STRAIT, STRAIT_CAME, Run
from patience import WAIT_S

import conflictdb


def document() -> Any:
    return json.loads(STRAIT.read_text())


def scene_file(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


def keys(dsn: str) -> set[str]:
    with psycopg.connect(dsn) as conn:
        return {
            key for (key,) in conn.execute("SELECT key FROM conflictdb.area UNION SELECT key FROM conflictdb.track")
        }


def test_load_says_what_it_did(run: Run, tmp_path: Path) -> None:
    assert run("load", STRAIT).out == "strait: 11 added, 0 updated, 0 removed, 0 unchanged\n"
    assert run("load", STRAIT).out == "strait: 0 added, 0 updated, 0 removed, 11 unchanged\n"
    content = document()
    content["features"][0]["properties"]["ceiling_m"] = 2000
    del content["features"][1]
    path = scene_file(tmp_path / "strait.geojson", content)
    assert run("load", path).out == "strait: 0 added, 1 updated, 0 removed, 9 unchanged\n"
    assert run("load", path, "--replace").out == "strait: 0 added, 0 updated, 1 removed, 10 unchanged\n"


def test_loading_adds_and_updates_but_removes_nothing(run: Run, dsn: str, tmp_path: Path) -> None:
    run("load", STRAIT)
    content = document()
    content["features"] = content["features"][:1]
    content["features"][0]["id"] = "NEW"
    path = scene_file(tmp_path / "more.geojson", content)
    assert run("load", path).out == "strait: 1 added, 0 updated, 0 removed, 0 unchanged\n"
    assert len(keys(dsn)) == 12


def test_a_file_without_settings_leaves_those_of_the_scene(run: Run, tmp_path: Path) -> None:
    content = document()
    content["scene"]["tolerance_m"] = 25.0
    run("load", scene_file(tmp_path / "one.geojson", content))
    del content["scene"]
    run("load", scene_file(tmp_path / "two.geojson", content), "--scene", "strait")
    assert run("export", "--scene", "strait", "-").json["scene"]["tolerance_m"] == 25.0


def test_nothing_is_half_loaded(run: Run, dsn: str, tmp_path: Path) -> None:
    run("load", STRAIT)
    content = document()
    content["features"][0]["id"] = "CHANGED"
    content["features"][-1]["properties"]["speed_kn"] = -12
    bad = scene_file(tmp_path / "bad.geojson", content)
    good = scene_file(tmp_path / "good.geojson", {**document(), "scene": {"name": "other"}})
    for words in (("load", bad), ("load", good, bad), ("detect", bad), ("load", bad, "--replace")):
        done = run(*words)
        assert (done.code, done.out) == (4, "")
        rule = "must be greater than 0; got -12 (to stay in place, give times)"
        assert done.err == f"conflictdb: {bad}: track 'CONVOY-2': speed_kn: {rule}\n"
    assert "CHANGED" not in keys(dsn)
    assert "other" not in run("status").out


def test_what_the_plane_cannot_hold_is_refused_with_the_file(run: Run, tmp_path: Path) -> None:
    content = document()
    content["features"][0]["geometry"]["coordinates"] = [[[0, 88], [1, 88], [1, 90], [0, 88]]]
    path = scene_file(tmp_path / "polar.geojson", content)
    done = run("load", path)
    assert done.code == 4
    assert done.err.startswith(f"conflictdb: {path}: area 'FIRING': geometry: latitude beyond 89 degrees")


def test_positions_report_what_they_leave_out(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "ais.csv"
    path.write_text(
        "datetime,mmsi,lon,lat,length,width\n"
        "2026-03-01 00:00:00,1,4,57,90,12\n2026-03-01 00:10:00,1,4.01,57,90,12\n2026-03-01 00:10:00,1,4.01,57,90,12\n"
        "2026-03-01 00:00:00,2,4,57,,\n2026-03-01 00:00:00,3,4,57,90,12\n"
    )
    done = run("load", path)
    assert (done.code, done.out) == (0, "ais: 1 added, 0 updated, 0 removed, 0 unchanged\n")
    assert done.err.splitlines() == [
        f"conflictdb: {path}: left out 1 row, the same fix as an earlier row: 1 (1)",
        f"conflictdb: {path}: left out 1 row, no length_m and width_m: 2 (all)",
        f"conflictdb: {path}: left out 1 row, a single fix: no movement to follow: 3 (all)",
        f"conflictdb: {path}: file: 1 of 3 objects have no size and are left out, such as '2': --haven gives them one",
        (
            "conflictdb: ais: 1 track, 57°00'N, 004°00'E to 004°01'E, 2026-03-01 00:00 to 2026-03-01 00:10 UTC, 2 kn, "
            "no heights"
        ),
    ]


@pytest.mark.parametrize("name", ["out.geojson", "out.geojson.gz"])
def test_export_loads_as_exactly_the_same_objects(run: Run, tmp_path: Path, name: str) -> None:
    run("load", STRAIT)
    path = tmp_path / name
    assert run("export", "--scene", "strait", path).code == 0
    text = gzip.decompress(path.read_bytes()).decode() if name.endswith(".gz") else path.read_text()
    assert run("export", "--scene", "strait", "-").out == text
    assert run("load", path).out == "strait: 0 added, 0 updated, 0 removed, 11 unchanged\n"
    assert run("load", path, "--scene", "copy").out == "copy: 11 added, 0 updated, 0 removed, 0 unchanged\n"
    copied = run("export", "--scene", "copy", "-").json
    assert copied["features"] == json.loads(text)["features"]
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_export_keeps_what_is_awkward(run: Run, tmp_path: Path) -> None:
    """Point and line havens, holes, the seam, odd names, unknown properties, and the last digits of everything."""
    times = ["1900-01-01T00:00:00.000001Z", "2200-12-31T23:59:59.999999Z"]
    hole = [
        [[179.5, -1], [180.5, -1], [180.5, 1.1], [179.5, 1], [179.5, -1]],
        [[180, 0], [180, 0.3], [180.1, 0.1], [180, 0]],
    ]
    sides = dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"), 0)
    features: list[tuple[str, Any, Any]] = [
        ("π ' \" \\ \n", hole, {"name": "", "note": {"a": [1, 2.5, None, True, "x"]}}),
        ("point", [[179.9, 0.1], [-179.9, 0.30000000000000004]], {**sides, "times": times}),
        ("line", [[1, 2], [1, 2]], {"outline_m": [[1, 1.1], [0, -1e-9]], "times": times}),
        ("any", [[1, 2], [3, 4]], {"outline_m": [[5, 6], [7, 6], [6, 9.1]], "times": times}),
    ]
    kinds = ["Polygon", *["LineString"] * 3]
    geometries = [{"type": kind, "coordinates": places} for kind, (_, places, _) in zip(kinds, features, strict=True)]
    content = {
        "type": "FeatureCollection",
        "scene": {"name": "odd ☂", "tolerance_m": 0.1, "earth": "sphere"},
        "features": [
            {"type": "Feature", "id": key, "geometry": geometry, "properties": properties}
            for geometry, (key, _, properties) in zip(geometries, features, strict=True)
        ],
    }
    assert run("load", scene_file(tmp_path / "odd.geojson", content)).code == 0
    out = tmp_path / "out.geojson"
    run("export", "--scene", "odd ☂", out)
    back = json.loads(out.read_text())
    for feature, geometry, (key, _, properties) in zip(back["features"], geometries, features, strict=True):
        assert (feature["id"], feature["geometry"]) == (key, geometry)
        assert {name: feature["properties"][name] for name in properties} == properties
    assert run("load", out).out == "odd ☂: 0 added, 0 updated, 0 removed, 4 unchanged\n"


def test_export_that_fails_leaves_the_older_file(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "out.geojson"
    path.write_text("older")
    assert run("export", "--scene", "nowhere", path).code == 4
    assert path.read_text() == "older"
    run("load", STRAIT)
    done = run("export", "--scene", "strait", tmp_path / "no" / "such" / "folder.geojson")
    assert done.code == 1
    assert "folder" in done.err


def test_export_into_a_device_writes_through(run: Run, tmp_path: Path) -> None:
    run("load", STRAIT)
    fifo = tmp_path / "pipe"
    os.mkfifo(fifo)
    reader = subprocess.Popen(["cat", str(fifo)], stdout=subprocess.PIPE, text=True)
    assert run("export", "--scene", "strait", fifo).code == 0
    assert json.loads(reader.communicate(timeout=WAIT_S)[0])["scene"]["name"] == "strait"
    assert fifo.is_fifo()


def test_what_the_database_refuses_names_the_file_too(run: Run, tmp_path: Path) -> None:
    content = document()
    track = content["features"][-1]
    track["geometry"]["coordinates"] = [[8, 57], [9, 57]]
    for name in ("start", "speed_kn"):
        del track["properties"][name]
    track["properties"]["times"] = ["2900-01-01T00:00:00.000001Z", "2900-01-02T00:00:00Z"]
    path = scene_file(tmp_path / "far.geojson", content)
    done = run("load", path)
    assert done.code == 4
    assert done.err.startswith(f"conflictdb: {path}: track 'CONVOY-2': times[0]: cannot be kept to the microsecond")


def test_text_is_utf_8_whatever_the_locale(dsn: str, tmp_path: Path) -> None:
    content = document()
    content["scene"]["name"] = "détroit ☂"
    path = scene_file(tmp_path / "strait.geojson", content)
    done = subprocess.run(
        [sys.executable, "-m", "conflictdb", "--dsn", dsn, "load", str(path)],
        env={**os.environ, "PYTHONIOENCODING": "ascii"},
        capture_output=True,
        timeout=WAIT_S,
        check=True,
    )
    assert done.stdout.decode().startswith("détroit ☂: 11 added")


def test_a_scene_name_that_is_no_text_is_a_usage_error(run: Run) -> None:
    assert run("export", "--scene", "\udcff", "-").code == 2


def test_all_mistakes_of_all_files_are_told_and_nothing_is_loaded(run: Run, dsn: str, tmp_path: Path) -> None:
    content = document()
    content["features"][0]["properties"]["floor_ft"] = content["features"][0]["properties"].pop("floor_m")
    content["features"][-1]["properties"]["speed_kn"] = 120_000
    one = scene_file(tmp_path / "one.geojson", content)
    two = scene_file(tmp_path / "two.geojson", {**document(), "separation_m": 500})
    done = run("load", one, two)
    assert (done.code, done.out) == (4, "")
    lines = done.err.splitlines()
    starts = [
        f"conflictdb: {one}: area 'FIRING': floor_ft: is not known",
        f"{one}: track 'CONVOY-2': speed_kn: is 120,000 kn",
        f"{two}: file: separation_m: is a setting",
    ]
    assert [line[: len(start)] for line, start in zip(lines, starts, strict=True)] == starts
    assert keys(dsn) == set()
    assert run("load", scene_file(one, document()), "--max-speed-kn", "5").code == 4


def test_what_may_not_be_meant_is_a_remark(run: Run, dsn: str, tmp_path: Path) -> None:
    content = document()
    area = content["features"][1]["geometry"]
    area["coordinates"] = [[[lat, lon] for lon, lat in area["coordinates"][0]]]
    path = scene_file(tmp_path / "strait.geojson", content)
    done = run("load", path)
    assert done.code == 0
    assert done.err.startswith(f"conflictdb: {path}: area 'DIVING': lies ")
    assert "longitude comes first" in done.err
    with conflictdb.connect(dsn) as db, pytest.warns(UserWarning, match="area 'DIVING': lies"):
        db.load(path)


def test_a_scene_is_not_emptied_where_every_object_is_refused(run: Run, dsn: str, tmp_path: Path) -> None:
    content = document()
    path = scene_file(tmp_path / "strait.geojson", content)
    assert run("load", path).code == 0
    held = keys(dsn)
    for feature in content["features"]:
        feature["properties"]["kind"] = "zone"
    path = scene_file(tmp_path / "strait.geojson", content)
    done = run("load", path, "--skip-invalid")
    assert done.code == 4
    assert "scene 'strait': holds no area and no track: nothing is changed" in done.err
    assert "kind: must be 'area' or 'track'; got 'zone'" in done.err
    assert keys(dsn) == held


GPX = """<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"><rte><name>FERRY</name>
<rtept lat="57.1" lon="9.1"/><rtept lat="57.2" lon="9.2"/></rte></gpx>"""
EMPTY = {"type": "FeatureCollection", "features": []}


@pytest.mark.parametrize(
    ("name", "content", "rule"),
    [
        ("ferry.gpx", GPX, "which have no times"),
        ("ais.csv", "time,id,lon,lat\n", ""),
        ("one.csv", "time,id,lon,lat\n2026-03-01T00:00:00Z,F,9,57\n", "a single fix: no movement to follow"),
        ("empty.geojson", json.dumps(EMPTY), ""),
        ("settings.geojson", json.dumps({**EMPTY, "scene": {"tolerance_m": 7}}), "--replace empties the scene"),
    ],
)
def test_a_file_without_objects_is_refused_and_changes_nothing(
    run: Run, dsn: str, tmp_path: Path, name: str, content: str, rule: str
) -> None:
    run("detect", STRAIT)
    before = run("export", "--scene", "strait", "-").out
    path = tmp_path / name
    path.write_text(content)
    has_settings = name == "settings.geojson"
    commands = [("load",), ("load", "--skip-invalid"), ("detect",), ("probe",)]
    for words in commands if has_settings else [*commands, ("load", STRAIT), ("load", "--replace")]:
        done = run(*words, path, "--scene", "strait")
        assert (done.code, done.out) == (4, ""), (words, done)
        who = "scene 'strait'" if has_settings and words != ("probe",) else "file"
        assert f"{path}: {who}: holds no area and no track" in done.err
        assert rule in done.err or words == ("probe",)
    with conflictdb.connect(dsn) as db, pytest.raises(conflictdb.InvalidInput, match="holds no area and no track"):
        db.load(path, "strait")
    assert run("export", "--scene", "strait", "-").out == before


def test_settings_without_objects_empty_a_scene_only_if_it_is_replaced(run: Run, dsn: str, tmp_path: Path) -> None:
    """In a file of their own, loaded together with files of objects, they are the settings of these objects."""
    run("load", STRAIT)
    path = scene_file(tmp_path / "settings.geojson", {**EMPTY, "scene": {"name": "strait", "tolerance_m": 7}})
    objects = {name: part for name, part in document().items() if name != "scene"}
    both = run("load", path, scene_file(tmp_path / "objects.geojson", objects), "--scene", "strait")
    assert both.out == "strait: 0 added, 0 updated, 0 removed, 11 unchanged\n"
    assert run("export", "--scene", "strait", "-").json["scene"]["tolerance_m"] == 7
    assert run("load", path, "--replace").out == "strait: 0 added, 0 updated, 11 removed, 0 unchanged\n"
    assert keys(dsn) == set()
    assert "load FILE --scene strait` brings some" in run("objects", "--scene", "strait").out


def test_detect_says_what_it_loaded(run: Run, tmp_path: Path) -> None:
    content = {**document(), "features": document()["features"][:4]}
    counts = "conflictdb: strait: 11 added, 0 updated, 0 removed, 0 unchanged\n"
    assert run("detect", STRAIT).err == STRAIT_CAME + counts
    path = scene_file(tmp_path / "fewer.geojson", content)
    assert run("detect", path).err.endswith("conflictdb: strait: 0 added, 0 updated, 0 removed, 4 unchanged\n")
    counts = run("detect", path, "--replace").err.splitlines()[-1]
    assert counts == "conflictdb: strait: 0 added, 0 updated, 7 removed, 4 unchanged"
    assert run("detect", "--scene", "strait").err == ""


def test_skip_invalid_loads_the_rest_and_names_what_it_leaves_out(run: Run, dsn: str, tmp_path: Path) -> None:
    content = document()
    content["features"][0]["geometry"]["coordinates"] = [[[9, 57], [10, 58], [10, 57], [9, 58], [9, 57]]]
    for feature in content["features"][1:3]:
        feature["geometry"]["coordinates"] = [[[0, 88], [1, 88], [1, 90], [0, 88]]]  # off the plane
    path = scene_file(tmp_path / "strait.geojson", content)
    assert run("load", path).code == 4
    done = run("load", path, "--skip-invalid")
    assert (done.code, done.out) == (6, "strait: 8 added, 0 updated, 0 removed, 0 unchanged, 3 LEFT OUT\n")
    areas = ("FIRING", "DIVING", "CABLE")
    assert [line.split(": ")[2] for line in done.err.splitlines()[:-1]] == [f"left out area {key!r}" for key in areas]
    assert keys(dsn).isdisjoint(areas)
    assert run("detect", path, "--skip-invalid", "--no-region").code == 6
    assert run("detect", path, "--skip-invalid", "--fail-on-conflict").code == 10
    assert run("detect", "--scene", "strait", "--skip-invalid").code == 2
    with conflictdb.connect(dsn) as db, pytest.warns(UserWarning, match="left out area"):
        assert db.load(path, skip_invalid=True).name == "strait"


def test_files_of_others_are_loaded_with_hints(run: Run, tmp_path: Path) -> None:
    """Options supply members that are missing in the file: names, time zone, haven."""
    rows = "ship,when,lon,lat\nTUG,01/06/2026 11:00:00,9.0,57.7\nTUG,01/06/2026 13:00:00,9.4,57.9\n"
    (tmp_path / "tug.csv").write_text(rows)
    hints = ("--map", "id=ship, time=when", "--time-zone", "Europe/Copenhagen", "--haven", "500,200,100,150")
    assert run("load", tmp_path / "tug.csv", "--scene", "s").code == 4
    done = run("load", tmp_path / "tug.csv", "--scene", "s", *hints)
    assert done.out == "s: 1 added, 0 updated, 0 removed, 0 unchanged\n"
    assert "all are points" not in done.err
    (row,) = run("objects", "--scene", "s", "--format", "json").json
    assert (row["key"], row["start_at"]) == ("TUG", "2026-06-01T09:00:00.000000Z")
    feature = run("export", "--scene", "s", "-").json["features"][0]
    assert feature["properties"]["fore_m"] == 500.0
    unzoned = run("load", tmp_path / "tug.csv", *hints[:2], *hints[4:])
    assert unzoned.code == 4
    assert unzoned.err.startswith("conflictdb: times lack an offset: --time-zone ZONE says where they are local")
    misspelt = run("load", tmp_path / "tug.csv", "--scene", "s", "--map", "id=ship,tiem=when")
    assert (misspelt.code, "tiem: is not a field; did you mean time?" in misspelt.err) == (4, True)
    for wrong in (("--map", "id"), ("--time-zone", "Mars"), ("--haven", "1,2")):
        assert run("load", tmp_path / "tug.csv", *wrong).code == 2
    assert run("detect", "--scene", "s", "--haven", "1,2,3,4").code == 2


def test_export_writes_the_format_of_the_name(run: Run, tmp_path: Path) -> None:
    """One route of a scene as RTZ, and all of it as KML; wrong keys and objects are refused, and leave no file."""
    run("detect", STRAIT)
    assert run("export", "--scene", "strait", tmp_path / "ferry.rtz", "FERRY").code == 0
    (track,) = conflictdb.read(tmp_path / "ferry.rtz").tracks
    assert track.key == "FERRY"
    assert run("export", "--scene", "strait", tmp_path / "all.kml").code == 0
    assert "<gx:Track>" in (tmp_path / "all.kml").read_text()
    for name, keys, rule in (
        ("all.rtz", (), "RTZ: holds one track"),
        ("one.rtz", ("FERY",), "scene 'strait': keys: has no object 'FERY'"),
        ("zones.ed318.json", (), "ED-318: holds areas only"),
    ):
        done = run("export", "--scene", "strait", tmp_path / name, *keys)
        assert (done.code, rule in done.err) == (4, True), done.err
        assert not (tmp_path / name).exists()
    assert run("export", "--scene", "strait", "-", "FERRY").code == 2
