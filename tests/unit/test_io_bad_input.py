"""Every kind of bad input is refused with one error that names file, object, field and rule; nothing is half-loaded.

Values that every way in can carry are in tests/integration/test_refusals.py.
"""

import copy
import gzip
import json
from pathlib import Path
from typing import Any

import pytest
from plan_files import HAVEN, area, refusal, track

from conflictdb.errors import InvalidInput

NAN, INFINITY = float("nan"), float("inf")


HOUR = [f"2026-03-01T0{hour}:00:00Z" for hour in range(10)]


def scene_document() -> dict[str, Any]:
    closed = area("A1", [[4, 57], [5, 57], [5, 58], [4, 57]], start=HOUR[6], end="2026-03-01T18:00:00Z", **HEIGHTS)
    moving = track("T1", ([3, 56], [4, 57], [5, 57]), times=HOUR[5:8])
    return {"type": "FeatureCollection", "scene": {"name": "s"}, "features": [closed, moving]}


HEIGHTS = {"floor_m": -9, "ceiling_m": 0}
SPEED = {"times": None, "start": "2026-03-01T05:00:00Z"}
BOX = [[0, 0], [4, 0], [4, 4], [0, 4]]
NO_SIDES = dict.fromkeys(HAVEN)
SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]


def polygon(*rings: Any) -> dict[str, Any]:
    return {"geometry": {"type": "Polygon", "coordinates": list(rings)}}


def line(*positions: Any) -> dict[str, Any]:
    return {"geometry": {"type": "LineString", "coordinates": list(positions)}}


AREA = [
    # changes of the properties or the geometry; the field (@ is geometry.coordinates); a part of the rule
    ({"geometry": None}, "geometry", "there is none"),
    ({"geometry": 5}, "geometry", "must be a Polygon"),
    ({"geometry": {"type": "Point", "coordinates": [1, 2]}}, "geometry", "got 'Point', which needs radius_m"),
    ({"geometry": {"type": "Point", "coordinates": [1]}, "radius_m": 5}, "@", "must be a position"),
    ({"geometry": {"type": "Point", "coordinates": [1, 2]}, "radius_m": 0}, "radius_m", "more than 0"),
    ({"geometry": {"type": "Point", "coordinates": [1, 2]}, "radius_m": "9"}, "radius_m", "must be a number"),
    ({"geometry": {"type": "Point", "coordinates": [1, 2]}, "radius_m": 6e6}, "radius_m", "at most 5,000,000"),
    ({"geometry": {"type": "Point", "coordinates": [1, 88.5]}, "radius_m": 1e5}, "radius_m", "beyond 89 degrees"),
    ({"radius_m": 5}, "radius_m", "has a meaning for a Point only"),
    ({"geometry": {"type": "GeometryCollection", "geometries": []}}, "geometry", "got 'GeometryCollection'"),
    ({"geometry": {"type": "Polygon"}}, "@", "must be a list of rings"),
    (polygon(), "@", "must not be empty"),
    (polygon([]), "@[0]", "must not be empty"),
    ({"geometry": {"type": "MultiPolygon", "coordinates": []}}, "@", "must not be empty"),
    ({"geometry": {"type": "MultiPolygon", "coordinates": [SQUARE]}}, "@[0][0][0]", "must be a position"),
    (polygon(SQUARE[:4]), "@[0]", "must be closed"),
    (polygon(SQUARE[:2]), "@[0]", "at least four positions"),
    (polygon([[57, 104], [58, 104], [58, 105], [57, 104]]), "geometry", "longitude first"),
    (polygon([[0, 0], [1, NAN], [1, 1], [0, 0]]), "@[0][1][1]", "finite"),
    (polygon([[0, 0], [1, 0], [INFINITY, 1], [0, 0]]), "@[0][2][0]", "finite"),
    (polygon([[0, 0], [1, "0"], [1, 1], [0, 0]]), "@[0][1][1]", "must be a number"),
    (polygon([[0, 0], [1, True], [1, 1], [0, 0]]), "@[0][1][1]", "must be a number"),
    (polygon([[0, 0], [1, None], [1, 1], [0, 0]]), "@[0][1][1]", "must be a number"),
    (polygon([[0, 0], [1], [1, 1], [0, 0]]), "@[0][1]", "must be a position"),
    (polygon([[0, 0], [1, 0, 0, 0], [1, 1], [0, 0]]), "@[0][1]", "must be a position"),
    (polygon([[0, 0], [1, 0, NAN], [1, 1], [0, 0]]), "@[0][1][2]", "finite"),
    (polygon([[0, 0], [10**400, 0], [1, 1], [0, 0]]), "@[0][1][0]", "too large"),
    ({"geometry": {**polygon(SQUARE)["geometry"], "crs": {"properties": {"name": "EPSG:99999"}}}}, "crs", "EPSG:99999"),
    ({"end": HOUR[6]}, "end", "later than start"),
    ({"end": HOUR[5]}, "end", "later than start"),
    ({"end": "2026-03-01T18:00:00"}, "end", "offset"),
    ({"end": "2026-03-01"}, "end", "offset"),
    ({"end": "tomorrow"}, "end", "ISO 8601"),
    ({"end": "2026-02-30T00:00:00Z"}, "end", "ISO 8601"),
    ({"end": 1772344800}, "end", "as a string"),
    ({"floor_m": NAN}, "floor_m", "finite"),
    ({"ceiling_m": -10}, "ceiling_m", "above floor_m"),
    ({"ceiling_m": "0"}, "ceiling_m", "must be a number"),
    ({"ceiling_m": True}, "ceiling_m", "must be a number"),
    ({"name": 7}, "name", "must be a string"),
    ({"name": ["a"]}, "name", "must be a string"),
    ({"name": "a\0b"}, "name", "U+0000"),
    ({"name": "\ud800"}, "name", "surrogate"),
    ({"kind": "track"}, "kind", "is 'track', but the geometry is a Polygon"),
    ({"kind": "zone"}, "kind", "must be 'area' or 'track'"),
    ({"kind": 1}, "kind", "must be a string"),
    ({"note": {"deep": [1, NAN]}}, "note.deep[1]", "finite"),
    ({"note": "\0"}, "note", "U+0000"),
]

TRACK = [
    ({"name": ["a"]}, "name", "must be a string"),
    ({"class": ["ferry"]}, "class", "must be a non-empty string"),
    ({"owner": [1, 2]}, "owner", "must be a non-empty string"),
    (line(), "@", "must not be empty"),
    (line([3, 56], [4, NAN], [5, 57]), "@[1][1]", "finite"),
    (line([3, 56], [4, 57]), "times", "2 waypoints, 3 times"),
    ({"geometry": {"type": "MultiPoint", "coordinates": [SQUARE]}}, "geometry", "got 'MultiPoint'"),
    ({"times": [HOUR[5], "2026-03-01T06:00:00", HOUR[7]]}, "times[1]", "offset"),
    ({"times": [HOUR[5], None, HOUR[7]]}, "times[1]", "as a string"),
    ({"times": HOUR[5]}, "times", "must be a list"),
    ({"times": []}, "times", "3 waypoints, 0 times"),
    ({"times": None}, "times", "is missing"),
    ({"start": HOUR[5]}, "start", "together with times"),
    ({"speed_kn": 5}, "speed_kn", "together with times"),
    ({**SPEED}, "speed_kn", "is missing"),
    ({"times": None, "speed_kn": 5}, "start", "is missing"),
    ({**SPEED, "speed_kn": 5, "speed_mps": 5}, "speed_mps", "together with speed_kn"),
    ({**SPEED, "speed_kn": 0}, "speed_kn", "greater than 0"),
    ({**SPEED, "speed_kn": -3}, "speed_kn", "greater than 0"),
    ({**SPEED, "speed_mps": [5, 0]}, "speed_mps[1]", "greater than 0"),
    ({**SPEED, "speed_kn": [5, 5, 5]}, "speed_kn", "2 legs, 3 speeds"),
    ({**SPEED, "speed_kn": "fast"}, "speed_kn", "must be a number"),
    ({**SPEED, "speed_kn": NAN}, "speed_kn", "finite"),
    ({**SPEED, "speed_kn": 1e300}, "speed_kn", "less than a microsecond"),
    ({**SPEED, "speed_kn": 1e-300}, "speed_kn", "so slow"),
    ({**SPEED, "speed_kn": 5, **line([3, 56], [3, 56])}, "speed_kn", "same place"),
    ({**SPEED, "speed_kn": 5, **line([3, 56], [3, 89.5])}, "geometry", "89 degrees"),
    ({**SPEED, "start": "9999-12-31T00:00:00Z", "speed_kn": 0.5}, "times", "years 1 to 9999"),
    ({**NO_SIDES}, "fore_m", "needs its haven"),
    ({"fore_m": -1}, "fore_m", "must not be negative"),
    ({"fore_m": None}, "fore_m", "is missing"),
    ({"fore_m": "1"}, "fore_m", "must be a number"),
    ({"fore_m": INFINITY}, "fore_m", "finite"),
    ({"fore_nmi": 1}, "fore_nmi", "together with fore_m"),
    ({"fore_m": None, "fore_nmi": -1}, "fore_nmi", "must not be negative"),
    ({"outline_m": [[0, 0]]}, "fore_m", "together with outline_m"),
    ({**NO_SIDES, "outline_m": []}, "outline_m", "must be a ring"),
    ({**NO_SIDES, "outline_m": 5}, "outline_m", "must be a list"),
    ({**NO_SIDES, "outline_m": [[0, 0, 0]]}, "outline_m", "must be a list"),
    ({**NO_SIDES, "outline_m": [[0, 0], [0, NAN], [1, 0]]}, "outline_m[1][1]", "finite"),
    ({"grow_mps": -1}, "grow_mps", "takes outlines_m"),
    ({"grow_mps": "fast"}, "grow_mps", "must be a number"),
    ({"grow_mps": NAN}, "grow_mps", "finite"),
    ({**NO_SIDES, "outline_m": [[0, 0], [900, 0], [900, 1]], "grow_mps": 1}, "outline_m", "sharper than 1 degree"),
    ({"outlines_m": [[[0, 0]]] * 3}, "fore_m", "together with outlines_m"),
    ({**NO_SIDES, "outlines_m": [[[0, 0]]] * 3, "outline_m": [[0, 0]]}, "outline_m", "together with outlines_m"),
    ({**NO_SIDES, "outlines_m": [[[0, 0]]] * 3, "grow_mps": 1}, "grow_mps", "together with outlines_m"),
    ({**NO_SIDES, "outlines_m": [[[0, 0]]] * 2}, "outlines_m", "3 waypoints, 2 outlines"),
    ({**NO_SIDES, "outlines_m": []}, "outlines_m", "one per waypoint"),
    ({**NO_SIDES, "outlines_m": [[0, 0]] * 3}, "outlines_m[0]", "must be a list"),
    ({**NO_SIDES, "outlines_m": [[], [], []]}, "outlines_m[0]", "must be a ring"),
    ({**NO_SIDES, "outlines_m": [[[0, 0]], [[0, 0], [1, 1]], [[0, 0]]]}, "outlines_m[1]", "as many vertices"),
    ({**NO_SIDES, "outlines_m": [[[0, 0]], [[0, "x"]], [[0, 0]]]}, "outlines_m[1][0][1]", "must be a number"),
    ({**NO_SIDES, "outlines_m": [BOX, BOX, [[0, 0], [4, 0], [1, 1], [0, 4]]]}, "outlines_m[2]", "convex ring"),
    ({**NO_SIDES, "outlines_m": [BOX, BOX, BOX[::-1]]}, "outlines_m[2]", "does not stay convex"),
    ({"kind": "area"}, "kind", "is 'area', but the geometry is a LineString"),
]


def refused(tmp_path: Path, document: object) -> InvalidInput:
    """Return the error of reading a document, or a text, which has a single line."""
    path = tmp_path / "scene.geojson"
    text = document if isinstance(document, str) else json.dumps(document)
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    found = refusal(path)
    assert str(found).count("\n") == 0
    return found


def changed(document: dict[str, Any], index: int, changes: dict[str, Any]) -> dict[str, Any]:
    feature = document["features"][index]
    for name, value in changes.items():
        (feature if name == "geometry" else feature["properties"])[name] = value
    return document


@pytest.mark.parametrize(
    ("index", "changes", "field", "rule"), [*((0, *case) for case in AREA), *((1, *case) for case in TRACK)]
)
def test_an_object_is_refused_with_field_and_rule(
    tmp_path: Path, index: int, changes: dict[str, Any], field: str, rule: str
) -> None:
    found = refused(tmp_path, changed(scene_document(), index, changes))
    assert found.key.endswith(("'A1'", "'T1'")[index])
    assert found.field == field.replace("@", "geometry.coordinates")
    assert rule in found.rule


@pytest.mark.parametrize(
    ("key", "rule"),
    [
        *((None, "is missing"), ("", "non-empty"), (True, "non-empty"), ([], "non-empty"), ("\0", "U+0000")),
        ("é" * 501, "at most 1000 bytes"),
    ],
)
def test_id_must_be_a_string(tmp_path: Path, key: object, rule: str) -> None:
    document = scene_document()
    document["features"][1]["id"] = key
    found = refused(tmp_path, document)
    assert (found.key, found.field) == ("features[1]", "id")
    assert rule in found.rule


def test_duplicate_id_names_both_features(tmp_path: Path) -> None:
    document = scene_document()
    document["features"].append(copy.deepcopy(document["features"][0]))
    found = refused(tmp_path, document)
    assert (found.key, found.field) == ("area 'A1'", "id")
    assert "features[0] and features[2]" in found.rule
    # An area and a track must not share an id, either.
    document["features"] = document["features"][:2]
    document["features"][1]["id"] = "A1"
    assert refused(tmp_path, document).key == "track 'A1'"


@pytest.mark.parametrize(
    ("scene", "key", "field", "rule"),
    [
        ({"name": "s", "tolerence_m": 1}, "scene", "tolerence_m", "is no setting"),
        ({"name": ""}, "scene", "name", "non-empty"),
        ({"name": 5}, "scene", "name", "non-empty"),
        ({"name": "a\0"}, "scene", "name", "U+0000"),
        ({"name": "s", "motion": "straight"}, "scene 's'", "motion", "must be one of"),
        ({"name": "s", "motion": ["rhumb"]}, "scene 's'", "motion", "must be one of"),
        ({"name": "s", "earth": "flat"}, "scene 's'", "earth", "must be one of"),
        ({"name": "s", "method": "guess"}, "scene 's'", "method", "must be one of"),
        ({"name": "s", "method": "window"}, "scene 's'", "method", "got 'window', which was removed: use exact"),
        ({"name": "s", "tolerance_m": -1}, "scene 's'", "tolerance_m", "0 or more"),
        ({"name": "s", "tolerance_m": "1"}, "scene 's'", "tolerance_m", "number"),
        ({"name": "s", "tolerance_m": True}, "scene 's'", "tolerance_m", "number"),
        ({"name": "s", "separation_m": NAN}, "scene 's'", "separation_m", "finite"),
        ({"name": "s", "separation_m": INFINITY}, "scene 's'", "separation_m", "finite"),
        ({"name": "s", "separation_m": 20_000_001}, "scene 's'", "separation_m", "half the way around the earth"),
        ({"name": "s", "nearest_m": 1e9}, "scene 's'", "nearest_m", "half the way around the earth"),
        ([], "scene", "", "must be an object"),
        (None, "scene", "", "must be an object"),
    ],
)
def test_scene_settings_are_checked(tmp_path: Path, scene: object, key: str, field: str, rule: str) -> None:
    found = refused(tmp_path, {**scene_document(), "scene": scene})
    assert (found.key, found.field) == (key, field)
    assert rule in found.rule


@pytest.mark.parametrize(
    ("text", "field", "rule"),
    [
        ("", "line 1, column 1", "ends too early"),
        ('{"type": "FeatureCollection",\n "features": [', "line 2, column 15", "ends too early"),
        ('{"type": "FeatureCollection"\n "features": []}', "line 2, column 2", "expecting ',' delimiter"),
        ('{"type": "FeatureCollection", "type": "x", "features": []}', "type", "appears twice"),
        ("[]", "", "FeatureCollection"),
        ('{"type": "Topology"}', "type", "got 'Topology'"),
        ('{"type": "FeatureCollection"}', "features", "must be a list"),
        ('{"type": "FeatureCollection", "features": {}}', "features", "must be a list"),
        ('{"type": "FeatureCollection", "features": [5]}', "type", "must be a GeoJSON Feature"),
        ('{"type": "FeatureCollection", "features": [{"type": "Polygon"}]}', "type", "must be a GeoJSON Feature"),
        ('{"type": "FeatureCollection", "crs": null, "features": []}', "crs", "WGS84"),
        ('{"type": "FeatureCollection", "crs": {"properties": {"name": "x"}}, "features": []}', "crs", "not known"),
        ("[" * 100_000, "", "nested too deeply"),
        ('{"type": ' + "9" * 5000 + "}", "", "out of range"),
    ],
)
def test_what_is_no_scene_file_is_refused(tmp_path: Path, text: str, field: str, rule: str) -> None:
    found = refused(tmp_path, text)
    assert found.field == field
    assert rule in found.rule


def test_properties_must_be_an_object(tmp_path: Path) -> None:
    document = scene_document()
    document["features"][0]["properties"] = ["kind"]
    assert refused(tmp_path, document).field == "properties"


@pytest.mark.parametrize(
    ("data", "name", "rule"),
    [
        (b"\xff\xfe{}", "a.geojson", "UTF-8"),
        *(('"Å"'.encode("latin-1"), name, "must be UTF-8 text") for name in ("a.geojson", "a.json", "a.csv")),
        (b"not gzip", "a.geojson.gz", "cannot be read"),
        (gzip.compress(b"{}" * 1000, mtime=0)[:-9], "a.geojson.gz", "cannot be read"),
    ],
)
def test_unreadable_files_are_refused(tmp_path: Path, data: bytes, name: str, rule: str) -> None:
    (tmp_path / name).write_bytes(data)
    assert rule in refusal(tmp_path / name).rule


@pytest.mark.parametrize("name", ["a.geojson", "a.csv", "a.gpkg"])
def test_a_missing_file_and_a_directory_are_refused(tmp_path: Path, name: str) -> None:
    assert refusal(tmp_path / name).rule == "does not exist"
    (tmp_path / name).mkdir()
    assert refusal(tmp_path / name).rule.startswith("cannot be read")
