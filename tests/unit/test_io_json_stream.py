"""JSON that is read some elements at a time is read as the whole text would be: the same values, the same errors."""

import json
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from peaks import PRINT_PEAK

from conflictdb.errors import InvalidInput
from conflictdb.formats import json_stream, scene_file
from conflictdb.formats.json_stream import NoObjectError, members
from conflictdb.formats.json_text import parse
from conflictdb.formats.reading import read, read_parts

FILE = """{ "type": "FeatureCollection", "n\\u00e9": [1, {"a": -0.5e3}],
  "features": [ {"id": "A\\"]}", "x": [1.25, true, null]},
    {"id": "B", "y": NaN}, 12345 , "ü" ],
  "scene": {"name": "s"} }
"""
LETTERS = '{}[]",:\\ \n01.eE-+tfnuNaI\x01ü'


def whole(text: str) -> Any:
    try:
        return parse(text)
    except InvalidInput as refused:
        return str(refused)


def pieces(text: str, size: int) -> Iterator[str]:
    return (text[i : i + size] for i in range(0, len(text), size))


def streamed(text: str, size: int, at_once: int) -> Any:
    """The value of a text that arrives in pieces, or the refusal."""
    document: dict[str, Any] = {}
    try:
        for name, value, is_part in members(
            iter([text[i : i + size] for i in range(0, len(text), size)]), at_once, 1e9
        ):
            document[name] = document.get(name, []) + value if is_part else value
    except InvalidInput as refused:
        return str(refused)
    return document


@given(st.integers(0, 2**32), st.integers(1, 60), st.integers(1, 3))
@example(0, 1, 1)
def test_any_text_is_read_as_the_whole_would_be(seed: int, size: int, at_once: int) -> None:
    """Also its errors, with line and column: a character is replaced, added or removed, or the end is."""
    rng = random.Random(seed)  # noqa: S311
    text = FILE
    for _ in range(seed % 3):
        i = rng.randrange(len(text))
        text = text[:i] + rng.choice([rng.choice(LETTERS), rng.choice(LETTERS) + text[i], ""]) + text[i + 1 :]
    text = text[: rng.choice([len(text), rng.randrange(len(text) + 1)])]
    wanted = whole(text)
    if isinstance(wanted, dict | str) and text.lstrip().startswith("{"):
        assert repr(streamed(text, size, at_once)) == repr(wanted), text
    else:
        with pytest.raises(NoObjectError):
            streamed(text, size, at_once)


@pytest.mark.parametrize(
    "text", ['{"features": [[' + "[" * 3_000, '{"features": [' + "1" * 5_000 + "]}", '{"a": 1, "b": {"c": 1, "c": 1}}']
)
def test_hostile_texts_are_refused_alike(text: str) -> None:
    assert streamed(text, 100, 1) == whole(text)


def test_what_is_kept_is_bounded() -> None:
    """An element, the other members together, and a part: whatever the limit on the file is."""
    for document in ({"features": [["x" * 3_000]]}, {"a": "x" * 600, "b": "y" * 600}):
        with pytest.raises(InvalidInput, match=r"holds more than 0\.001 MB: split it"):
            list(members(pieces(json.dumps(document), 100), 10, 1_000.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(json_stream, "_PART", 100)
        text = json.dumps({"features": ["x" * 60] * 10})
        assert [len(value) for _, value, _ in members(iter([text]), 10, 1e9)] == [2] * 5


def feature(key: str, lon: float) -> dict[str, Any]:
    ring = [[lon, 54.0], [lon + 0.001, 54.0], [lon, 54.001], [lon, 54.0]]
    return {"type": "Feature", "id": key, "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}


@pytest.fixture
def by_twos(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_file, "_AT_ONCE", 2)


MEMBERS = {"scene": {"name": "s", "tolerance_m": 5.0}, "crs": None, "foreign": ["floor_ft"], "trs": None}


@pytest.mark.usefixtures("by_twos")
@pytest.mark.parametrize(
    "late", [{}, MEMBERS, {"scenes": 1}, {"type": "FeatureCollection"}, {"foreign": 3}, {"trs": 1}]
)
def test_members_after_the_features_count(tmp_path: Path, late: dict[str, Any]) -> None:
    """They may say how features are read; the mistakes are those of a file that says it first."""
    features = [feature(f"A{i}", 9.0 + 0.01 * i) for i in range(5)]
    features[3]["properties"]["floor_ft"] = 7
    head = {} if "type" in late else {"type": "FeatureCollection"}
    found = []
    for k, document in enumerate([{**head, **late, "features": features}, {**head, "features": features, **late}]):
        path = tmp_path / str(k) / "sea.json"
        path.parent.mkdir()
        path.write_text(json.dumps(document))
        try:
            contents = read(path)
        except InvalidInput as refused:
            found.append(str(refused).replace(str(path), ""))
        else:
            found.append(f"{contents.scene} {[one.key for one in contents.areas]}")
    assert found[0] == found[1]


@pytest.mark.usefixtures("by_twos")
def test_parts_have_all_mistakes_of_the_whole(tmp_path: Path) -> None:
    """Of objects, of ids that occur twice in a part or in several, of speeds, and of members after the features."""
    track = {"type": "Feature", "id": "T", "geometry": {"type": "LineString", "coordinates": [[9, 54], [10, 54]]}}
    fast = {**track, "properties": {"times": ["2026-01-01T00:00:00Z", "2026-01-01T00:00:01Z"], "outline_m": [[0, 0]]}}
    lon = [9.0, 9.1, 9.2, 999.0]
    features = [feature("A", lon[0]), feature("A", lon[1]), fast, feature("B", lon[3]), feature("A", lon[2]), 7]
    path = tmp_path / "sea.json"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, "scene": {"nam": 1}}))
    with pytest.raises(InvalidInput) as whole_file:
        read(path)
    late = None
    while True:
        with read_parts(path, late=late) as parts:
            try:
                for _ in parts.each:
                    pass
            except scene_file.LateMembersError as found:
                late = found.members
            else:
                break
    said = [sorted(str(one) for one in error) for error in (whole_file.value, parts.refusals.found)]
    assert [one.replace(f"{path}: ", "") for one in said[0]] == said[1]
    assert len(said[1]) == 6


MEASURED = f"""
import sys
from conflictdb.formats.reading import read_parts
with read_parts(sys.argv[1]) as parts:
    print(sum(len(areas) for areas, _ in parts.each))
{PRINT_PEAK}"""


def test_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    """Five times as many objects add less than a tenth of the memory of keeping all in memory."""
    peaks = []
    for count in (4_000, 20_000):
        path = tmp_path / "sea.geojson"
        with path.open("w") as file:
            file.write('{"type": "FeatureCollection", "scene": {"name": "s"}, "features": [')
            file.write(",\n".join(json.dumps(feature(f"A{i}", 9.0 + 1e-5 * i)) for i in range(count)) + "]}")
        done = subprocess.run([sys.executable, "-c", MEASURED, str(path)], capture_output=True, text=True, check=True)
        objects, peak = map(int, done.stdout.split())
        assert objects == count
        peaks.append(peak)
    assert peaks[1] - peaks[0] < 16_000 * 6_000 / 10
