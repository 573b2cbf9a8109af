"""Files as attackers write them: bounded time and memory, and one message."""

import gzip
import json
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from plan_files import LONGEST_S, area, hostile_refusal, refusal, write

from conflictdb import formats
from conflictdb.errors import InvalidInput
from conflictdb.formats import discs
from conflictdb.formats.positions import read_positions

EMPTY = '{"type": "FeatureCollection", "features": []'
AREA = {"type": "Polygon", "coordinates": [[[4, 57], [5, 57], [5, 58], [4, 57]]]}
LINE = {"type": "LineString", "coordinates": [[4, 57], [5, 58]]}


def feature(properties: str = "{}", key: str = '"A"', geometry: object = AREA) -> str:
    one = f'{{"type": "Feature", "id": {key}, "geometry": {json.dumps(geometry)}, "properties": {properties}}}'
    return f'{{"type": "FeatureCollection", "features": [{one}]}}'


def crs(name: str) -> str:
    return f'"crs": {{"properties": {{"name": "{name}"}}}}'


def placed(name: str) -> str:
    return f'{{"type": "Feature", "id": "{name}", {crs(name)}, "geometry": {json.dumps(AREA)}, "properties": null}}'


def nested(depth: int) -> str:
    return "[" * depth + "]" * depth


# Functions make the longest texts when a test needs them.
TEXTS: dict[str, tuple[str | Callable[[], str], str]] = {
    "deep": (f'{EMPTY}, "x": {nested(1_000_000)}}}', "nested too deeply"),
    "deep where a message would show it": (feature(f'{{"floor_m": {nested(900)}}}'), "floor_m|nested too deeply"),
    "deep property": (feature(f'{{"x": {nested(200)}}}'), "nested more than 100 deep"),
    "deep and long names": (
        feature('{"' + '": {"'.join(["n" * 100_000] * 120) + '": 0' + "}" * 120),
        "nested more than 100 deep",
    ),
    "a whole number of many digits": (f'{EMPTY}, "x": {"1" * 100_000}}}', "thousands of digits"),
    "a number beyond a double": (feature(f'{{"x": {"1" * 400}}}'), "x: is too large a number"),
    "1e999": (feature('{"x": 1e999}'), "x: must be a finite number"),
    "1e999 for a height": (feature('{"floor_m": 1e999}'), "floor_m: must be a finite number"),
    "a long instant": (feature(f'{{"start": "{"2" * 3_000_000}"}}'), "start: must be a date and time"),
    "a long id": (feature(key=f'"{"k" * 1_000_000}"'), "id: must be at most 1000 bytes"),
    "a million members, one twice": (
        lambda: f'{EMPTY}, "x": {{{",".join(f"{chr(34)}{i}{chr(34)}:0" for i in range(300_000))}, "299999": 1}}}}',
        "299999: appears twice",
    ),
    "a long member twice": (f'{EMPTY}, "{"n" * 100_000}": 1, "{"n" * 100_000}": 1}}', "appears twice"),
    "NUL": (feature(key=r'"A\u0000"'), "U[+]0000"),
    "half of a surrogate pair": (feature(key=r'"A\ud800"'), "surrogate"),
    "mistakes without end": (f"{EMPTY[:-1]}{','.join('0' * 200_000)}]}}", "more than 100,000 mistakes"),
    "heights without end": (
        feature(f'{{"floor_m": [{",".join(["true"] * 200_000)}]}}', geometry=LINE),
        "more than 100,000 mistakes",
    ),
    "names that look like ours without end": (
        lambda: feature("{" + ",".join(f'"floor{"_" * (i % 150)}{"-" * (i // 150)}": 1' for i in range(10_000)) + "}"),
        "did you mean floor_m",
    ),
    "reference systems without end": (
        lambda: f"{EMPTY[:-1]}{','.join(placed(f'x{i}') for i in range(2_000))}]}}",
        "x0",
    ),
    "a reference system of many letters": (f"{EMPTY}, {crs('COMPOUNDCRS[' * 200_000)}}}", "crs: has 2,400,000 char"),
    "NUL in a reference system": (f"{EMPTY}, {crs('EPSG:25832' + chr(92) + 'u0000')}}}", "crs: must not contain"),
    "a surrogate in a reference system": (f"{EMPTY}, {crs('EPSG' + chr(92) + 'ud800')}}}", "crs: .* surrogate"),
    "a reference system in a file": (f"{EMPTY}, {crs('+init=/dev/zero:x')}}}", "crs: refers to a file or an address"),
    "a reference system at an address": (
        f"{EMPTY}, {crs('+nadgrids=@https://127.0.0.1/x')}}}",
        "crs: refers to a file",
    ),
    "a terminal's commands": (feature('{"floor_m": "x"}', key=r'"\u001b]0;owned\u0007"'), "floor_m: must be a number"),
}


@pytest.mark.parametrize("name", list(TEXTS))
def test_hostile_json_is_refused_at_once(tmp_path: Path, name: str) -> None:
    text, rule = TEXTS[name]
    path = tmp_path / "plan.geojson"
    path.write_text(text if isinstance(text, str) else text())
    assert re.search(rule, hostile_refusal(path))


@pytest.mark.parametrize(("encoding", "rule"), [("utf-16", "UTF-16"), ("utf-16-be", "JSON|UTF"), ("utf-32", "UTF-16")])
def test_other_encodings_are_named(tmp_path: Path, encoding: str, rule: str) -> None:
    path = tmp_path / "plan.geojson"
    path.write_bytes(feature().encode(encoding))
    assert re.search(rule, hostile_refusal(path))


@pytest.fixture(scope="module")
def bomb(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A gigabyte in a megabyte."""
    path = tmp_path_factory.mktemp("bomb") / "zeros.gz"
    with gzip.open(path, "wb", compresslevel=1) as stream:
        stream.writelines(bytes(1_000_000) for _ in range(200))
    return path.read_bytes() * 5  # members of an archive follow one another


@pytest.mark.parametrize("name", ["plan.geojson.gz", "fixes.csv.gz"])
def test_an_archive_is_unpacked_no_further_than_the_limit(tmp_path: Path, bomb: bytes, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(bomb)
    assert len(bomb) < 5_000_000
    assert "holds more than 64 MB: split it, or allow more with --max-file-mb" in hostile_refusal(path)


def test_a_file_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.geojson"
    path.symlink_to("/dev/zero")
    assert "holds more than 64 MB" in hostile_refusal(path)


def test_the_limit_can_be_raised(tmp_path: Path) -> None:
    path = tmp_path / "plan.geojson"
    path.write_text(feature(json.dumps({"x": "y" * 2_000})))
    with pytest.raises(InvalidInput, match=r"more than 0\.001 MB"):
        formats.read(path, max_file_mb=0.001)
    assert len(formats.read(path, max_file_mb=0.01).areas) == 1


def test_reference_systems_of_a_file_are_counted(tmp_path: Path) -> None:
    pytest.importorskip("pyproj", reason="the extra 'ogr' is not installed")
    path = tmp_path / "plan.geojson"
    path.write_text(f"{EMPTY[:-1]}{','.join(placed(f'EPSG:{25801 + i}') for i in range(40))}]}}")
    rules = [one.rule for one in refusal(path) if one.field == "crs"]
    assert sum("is another one than 20 before it" in rule for rule in rules) == 20


def test_names_are_compared_in_no_time(tmp_path: Path) -> None:
    """Each with all names that are known; and names of millions of letters with none."""
    path = tmp_path / "plan.geojson"
    values = {**{f"c{i:07d}": 0 for i in range(60_000)}, "m_" * 1_000_000 + "x": 0}
    path.write_text(feature(json.dumps(values)))
    began = time.monotonic()
    assert len(formats.read(path).areas[0].properties) == 60_001
    assert time.monotonic() - began < LONGEST_S


def test_circles_of_a_file_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hundred bytes may be a circle of 4,096 corners."""
    place = {"type": "Point", "coordinates": [0, 0]}
    path = write(tmp_path, *(area(str(i), radius_m=5_000_000) | {"geometry": place} for i in range(100)))
    made = sum(len(one.footprint.geoms[0].exterior.coords) - 1 for one in formats.read(path).areas)
    monkeypatch.setattr(discs, "MAX_CORNERS", made // 2)
    message = hostile_refusal(path)
    assert "area '50': radius_m: is a circle too many" in message
    assert "area '49'" not in message


HEADER = "id,time,lon,lat"
HOUR = "2026-01-01T00:00:00Z"
LONG_CELL = "has a cell of more than 131,072 characters"
ROWS = {
    "500,000 columns": (f"{HEADER},{','.join(map(str, range(500_000)))}\n", "has 500,004 columns; at most 2,000"),
    "500,000 columns of one name": (f"{HEADER}{',x' * 500_000}\n", "has 500,004 columns; at most 2,000"),
    "a long name": (f"{HEADER},{'x' * 200_000}\n", f"line 1: {LONG_CELL}"),
    "a long cell": (f"{HEADER},x\na,{HOUR},1,2,{'x' * 200_000}\n", f"line 2: {LONG_CELL}"),
    "a quotation without end": (f'{HEADER}\n"{"a" * 200_000}', f"line 2: {LONG_CELL}"),
    "a header without end": ('"' + "\n" * 200_000, LONG_CELL),
    "a quotation in the header": ('"id"x,time,lon,lat\n', "line 1: is not CSV"),
    "mistakes without end": (f"{HEADER}\n" + "x\n" * 200_000, "more than 100,000 mistakes"),
    "a time of many digits": (f"{HEADER}\na,{'1' * 100_000},1,2\n", "time: must be ISO 8601"),
    "a fraction of many digits": (f"{HEADER}\na,{'1' * 20}.{'1' * 100_000},1,2\n", "time: must be ISO 8601"),
    "a place of many digits": (f"{HEADER}\na,{HOUR},{'1' * 100_000},2\n", "lon: must be a finite number"),
    "1e999999999": (f"{HEADER}\na,{HOUR},1e999999999,2\n", "lon: must be a finite number"),
    "NUL": (f"{HEADER}\na\0,{HOUR},1,2\n", "U[+]0000"),
    "two marks of byte order": (f"\ufeff\ufeff{HEADER}\na,{HOUR},1,2\n", "column id: is missing"),
    "nothing": ("", "column id: is missing"),
    "a long id": (f"{HEADER}\n{'k' * 100_000},{HOUR},1,2\n", "line 2: must be at most 1000 bytes"),
}


@pytest.mark.parametrize(
    ("ending", "name"),
    # Mistakes are counted after cells are parted: two seconds show it for both endings.
    [(ending, name) for ending in ("csv", "tsv") for name in ROWS if (ending, name) != ("tsv", "mistakes without end")],
)
def test_hostile_rows_are_refused_at_once(tmp_path: Path, ending: str, name: str) -> None:
    text, rule = ROWS[name]
    path = tmp_path / f"fixes.{ending}"
    path.write_text(text)
    assert re.search(rule, hostile_refusal(path))


def test_objects_of_a_file_are_bounded() -> None:
    """A row of nine bytes names one, which takes a kilobyte."""
    text = f"{HEADER}\n" + "".join(f"{i},,,\n" for i in range(2_000))
    with pytest.raises(InvalidInput, match="line 1002: names another object after 1,000"):
        read_positions(text, "fixes.csv", max_objects=1_000)
