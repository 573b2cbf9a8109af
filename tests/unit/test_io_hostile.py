"""Files as attackers write them: bounded time and memory, and one message."""

import gzip
import json
import re
import time
from pathlib import Path

import pytest

from conflictdb import io
from conflictdb.errors import InvalidInput

EMPTY = '{"type": "FeatureCollection", "features": []'
AREA = {"type": "Polygon", "coordinates": [[[4, 57], [5, 57], [5, 58], [4, 57]]]}
LONGEST_S = 20.0  # far more than any of these takes; what is quadratic takes hours
LONGEST_MESSAGE = 2_000


def feature(properties: str = "{}", key: str = '"A"') -> str:
    one = f'{{"type": "Feature", "id": {key}, "geometry": {json.dumps(AREA)}, "properties": {properties}}}'
    return f'{{"type": "FeatureCollection", "features": [{one}]}}'


def refusal(path: Path) -> str:
    began = time.monotonic()
    with pytest.raises(InvalidInput) as caught:
        io.read(path)
    message = str(caught.value)
    assert time.monotonic() - began < LONGEST_S
    assert message.startswith(str(path))
    assert len(message) < LONGEST_MESSAGE
    assert message.isprintable()
    return message


def nested(depth: int) -> str:
    return "[" * depth + "]" * depth


TEXTS = {
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
        f'{EMPTY}, "x": {{{",".join(f"{chr(34)}{i}{chr(34)}:0" for i in range(300_000))}, "299999": 1}}}}',
        "299999: appears twice",
    ),
    "a long member twice": (f'{EMPTY}, "{"n" * 100_000}": 1, "{"n" * 100_000}": 1}}', "appears twice"),
    "NUL": (feature(key=r'"A\u0000"'), "U[+]0000"),
    "half of a surrogate pair": (feature(key=r'"A\ud800"'), "surrogate"),
    "a terminal's commands": (feature('{"floor_m": "x"}', key=r'"\u001b]0;owned\u0007"'), "floor_m: must be a number"),
}


@pytest.mark.parametrize("name", list(TEXTS))
def test_hostile_json_is_refused_at_once(tmp_path: Path, name: str) -> None:
    text, rule = TEXTS[name]
    path = tmp_path / "plan.geojson"
    path.write_text(text)
    assert re.search(rule, refusal(path))


@pytest.mark.parametrize(("encoding", "rule"), [("utf-16", "UTF-16"), ("utf-16-be", "JSON|UTF"), ("utf-32", "UTF-16")])
def test_other_encodings_are_named(tmp_path: Path, encoding: str, rule: str) -> None:
    path = tmp_path / "plan.geojson"
    path.write_bytes(feature().encode(encoding))
    assert re.search(rule, refusal(path))


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
    assert "holds more than 64 MB: split it, or allow more with --max-file-mb" in refusal(path)


def test_a_file_without_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "plan.geojson"
    path.symlink_to("/dev/zero")
    assert "holds more than 64 MB" in refusal(path)


def test_the_limit_can_be_raised(tmp_path: Path) -> None:
    path = tmp_path / "plan.geojson"
    path.write_text(feature(json.dumps({"x": "y" * 2_000})))
    with pytest.raises(InvalidInput, match=r"more than 0\.001 MB"):
        io.read(path, max_file_mb=0.001)
    assert len(io.read(path, max_file_mb=0.01).areas) == 1
