"""Values that look like times are recognised in the forms that people write."""

import json
from pathlib import Path

import pytest

from conflictdb import read
from conflictdb.formats.time_columns import is_time_like


@pytest.mark.parametrize(
    "text", ["2026-06-01", "2026/06/01 08:00", "01/06/2026", "1.6.2026", "01-06-2026 08:00:00", "01/06/2026T08:00"]
)
def test_dates_look_like_times(text: str) -> None:
    assert is_time_like("note", text)


@pytest.mark.parametrize("text", ["", "12", "1/2", "01/06/26", "7 of 12/06/2026", "10.0.0.2026.1", "2026"])
def test_other_texts_do_not(text: str) -> None:
    assert not is_time_like("note", text)


def test_nested_times_and_limits_of_heights_are_remarked(tmp_path: Path) -> None:
    """A feed with the words of ED-269 among its properties was active for ever, at all heights, without a word."""
    zone = {
        "applicability": [{"startDateTime": "2026-06-01T08:00:00Z", "endDateTime": "2026-06-01T18:00:00Z"}],
        "geometry": [{"lowerLimit": 0, "upperLimit": 120, "uomDimensions": "M"}],
        "dataSource": {"creationDateTime": "2026-06-01T08:00:00Z"},
        "storeys": 7,
    }
    (tmp_path / "zones.geojson").write_text(json.dumps(collection(zone)))
    texts = [one.text for one in read(tmp_path / "zones.geojson").remarks]
    named = "applicability.startDateTime, applicability.endDateTime look like times and are not read"
    assert any(text.startswith(f"1 area without start or end: {named}") for text in texts)
    named = "geometry.lowerLimit, geometry.upperLimit look like heights and are not read"
    assert any(text.startswith(f"1 area without floor and ceiling: {named}") for text in texts)
    bounded = {**zone, "floor_m": 0.0, "start": "2026-06-01T08:00:00Z", "end": "2026-06-02T08:00:00Z"}
    (tmp_path / "zones.geojson").write_text(json.dumps(collection(bounded)))
    assert not any("are not read" in one.text for one in read(tmp_path / "zones.geojson").remarks)


def collection(properties: dict[str, object]) -> dict[str, object]:
    ring = [[9, 57], [9.01, 57], [9.01, 57.01], [9, 57]]
    shape = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "id": "Z", "geometry": shape, "properties": properties}
    return {"type": "FeatureCollection", "features": [feature]}
