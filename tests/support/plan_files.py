"""Scene files for tests of reading, from the words of the interface alone, and how they are refused."""

import json
import time
from pathlib import Path
from typing import Any

import pytest
from patience import WAIT_S

from conflictdb import formats
from conflictdb.errors import InvalidInput

HAVEN = {"fore_m": 5, "aft_m": 5, "port_m": 2, "starboard_m": 2}
TIMES = ["2026-03-01T05:00:00Z", "2026-03-01T06:00:00Z"]
LONGEST_S = WAIT_S  # far more than a hostile file takes; quadratic time would be hours
SQUARE = [[4, 57], [5, 57], [5, 58], [4, 58], [4, 57]]


def area(key: Any = "A", ring: Any = SQUARE, **properties: Any) -> dict[str, Any]:
    geometry = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "id": key, "geometry": geometry, "properties": properties}


def track(key: str = "T", line: Any = ([4, 57], [4.5, 57.2]), **properties: Any) -> dict[str, Any]:
    """A track with times and a haven, unless others are given."""
    geometry = {"type": "LineString", "coordinates": list(line)}
    return {"type": "Feature", "id": key, "geometry": geometry, "properties": {"times": TIMES, **HAVEN, **properties}}


def write(folder: Path, *features: dict[str, Any], file: str = "plan.geojson", **members: Any) -> Path:
    path = folder / file
    path.write_text(json.dumps({"type": "FeatureCollection", **members, "features": features}))
    return path


def read(folder: Path, *features: dict[str, Any], **members: Any) -> formats.Contents:
    return formats.read(write(folder, *features, **members))


def refusal(path: Path, **options: Any) -> InvalidInput:
    """Return the error of reading a file, which names it."""
    with pytest.raises(InvalidInput) as caught:
        formats.read(path, **options)
    assert all(one.source == str(path) for one in caught.value)
    return caught.value


def hostile_refusal(path: Path, **options: Any) -> str:
    """Return the message of a refusal: it comes soon, and fits a screen."""
    began = time.monotonic()
    message = str(refusal(path, **options))
    assert time.monotonic() - began < LONGEST_S
    assert len(message.replace(str(path), "")) < 4_000
    assert all(line.isprintable() for line in message.split("\n"))
    return message
