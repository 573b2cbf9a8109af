"""The notebook of the AIS hour runs as it is, on a few ships in the columns of the Danish files."""

import csv
import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).parents[2] / "docs" / "tutorial" / "ais-hour.ipynb"
COLUMNS = [
    *("# Timestamp", "Type of mobile", "MMSI", "Latitude", "Longitude", "Navigational status", "ROT", "SOG", "COG"),
    *("Heading", "IMO", "Callsign", "Name", "Ship type", "Cargo type", "Width", "Length"),
    *("Type of position fixing device", "Draught", "Destination", "ETA", "Data source type", "A", "B", "C", "D"),
]
START = datetime(2026, 6, 1, 8, 50)  # ten minutes before the hour of the notebook


def written(path: Path) -> Path:
    """A file of two ships that pass at 200 m, one far away, one outside of the box, and a base station."""
    ships = [
        ("Class A", "219000001", "ANNA", 57.80, 9.0, 0.005),
        ("Class A", "219000002", "BERTA", 57.802, 9.4, -0.005),
        ("Class A", "219000003", "CLARA", 58.2, 9.0, 0.005),
        ("Class A", "219000004", "DORA", 55.0, 9.0, 0.005),
        ("Base Station", "2190005", "", 57.80, 9.2, 0.0),
    ]
    size = {"Width": "20", "Length": "100", "A": "50", "B": "50", "C": "10", "D": "10"}
    with path.open("w", newline="") as file:
        rows = csv.DictWriter(file, COLUMNS, restval="")
        rows.writeheader()
        for minute in range(90):
            for mobile, mmsi, name, lat, lon, speed in ships:
                at = (START + timedelta(minutes=minute)).strftime("%d/%m/%Y %H:%M:%S")
                place = {"Latitude": f"{lat:.6f}", "Longitude": f"{lon + speed * minute:.6f}"}
                rows.writerow(
                    {"# Timestamp": at, "Type of mobile": mobile, "MMSI": mmsi, "Name": name, **place, **size}
                )
    return path


def test_the_notebook_of_the_ais_hour_runs(
    dsn: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pandas")
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("AIS_FILE", str(written(tmp_path / "aisdk.csv")))
    monkeypatch.setenv("CONFLICTDB_DSN", dsn)
    cells = [cell for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    names: dict[str, Any] = {}
    with pytest.warns(UserWarning, match="read as day/month/year"):
        exec("\n".join("".join(cell["source"]) for cell in cells), names)  # noqa: S102  our own notebook
    said = capsys.readouterr().out
    assert "3 ships" in said
    assert "pairs closer than 500 m: 1, found in" in said
    assert [(one.a_name, one.b_name) for one in names["found"]] == [("ANNA", "BERTA")]
    assert 150.0 < names["found"][0].closest_m < 250.0
    assert names["figure"] is not None
    assert "ANNA" in (tmp_path / "ais-hour.html").read_text()
