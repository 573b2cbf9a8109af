"""Remarks after a load compare new objects with those of the scene: a file may be wrong as a whole."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from commands import Run

Feature = dict[str, Any]


def ship(key: str, lon: float, kn: float, **more: Any) -> Feature:
    sizes = dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"), 100)
    return {
        "type": "Feature",
        "id": key,
        "geometry": {"type": "LineString", "coordinates": [[lon, 57.0], [lon, 58.0]]},
        "properties": {"start": "2026-12-01T00:00:00Z", "speed_kn": kn, **sizes, **more},
    }


def zone(key: str, lon: float, lat: float, **more: Any) -> Feature:
    ring = [[lon, lat], [lon + 0.01, lat], [lon + 0.01, lat + 0.01], [lon, lat]]
    return {"type": "Feature", "id": key, "geometry": {"type": "Polygon", "coordinates": [ring]}, "properties": more}


def written(path: Path, features: list[Feature]) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


@pytest.fixture
def fleet(run: Run, tmp_path: Path) -> str:
    """A scene of 200 ships of 10 to 14 kn, 20 submarines and 20 zones."""
    ships = [ship(f"S{n}", 8.0 + n / 100.0, 10.0 + n % 5) for n in range(200)]
    below = [ship(f"SUB{n}", 8.0 + n / 10.0, 8.0, floor_m=-200, ceiling_m=-100) for n in range(20)]
    times = {"start": "2026-12-01T00:00:00Z", "end": "2026-12-02T00:00:00Z"}
    zones = [zone(f"Z{n}", 8.0 + n / 10.0, 57.2, **times) for n in range(20)]
    loaded = run("load", written(tmp_path / "fleet.geojson", [*ships, *below, *zones]))
    assert (loaded.code, loaded.err.count("\n")) == (0, 1), loaded.err
    return "fleet"


def swapped(feature: Feature) -> Feature:
    coordinates = feature["geometry"]["coordinates"]
    is_area = feature["geometry"]["type"] == "Polygon"
    turned = [[y, x] for x, y in (coordinates[0] if is_area else coordinates)]
    feature["geometry"]["coordinates"] = [turned] if is_area else turned
    return feature


MISTAKES: list[tuple[Callable[[], list[Feature]], str]] = [
    (lambda: [swapped(ship("ODD", 9.0, 12.0))], "track 'ODD': lies 6,737 km from the objects of the scene, but among"),
    (lambda: [swapped(zone("ODD", 9.0, 57.0))], "area 'ODD': lies 6,766 km from the objects of the scene, but among"),
    (lambda: [ship("ODD", -6.0, 12.0)], "track 'ODD': lies 838 km from the objects of the scene, which lie within"),
    (lambda: [ship("ODD", 9.0, 12.0, start="2024-12-01T00:00:00Z")], "begins on 2024-12-01, and those of the scene"),
    (lambda: [zone("ODD", 9.0, 57.0, end="2024-12-01T00:00:00Z")], "ends on 2024-12-01, and those of the scene about"),
    (lambda: [ship("ODD", 9.0, 180.0)], "track 'ODD': travels at 180 kn, and those of the scene at most at 14 kn:"),
    (
        lambda: [ship("ODD", 9.0, 8.0, floor_m=100, ceiling_m=200)],
        "is 100 m above the sea at 8 kn, and some of the scene are below it:",
    ),
    (
        lambda: [ship(f"ODD{n}", 9.0, 1.943844 * (10.0 + n)) for n in range(5)],
        "file: its tracks travel at 19 to 27 kn, and those of the scene at 10 to 14 kn: is the unit right",
    ),
]


@pytest.mark.parametrize(("odd", "remark"), MISTAKES)
@pytest.mark.parametrize("files", [1, 2])
def test_a_file_that_is_wrong_as_a_whole_is_remarked(
    run: Run, fleet: str, tmp_path: Path, odd: Callable[[], list[Feature]], remark: str, files: int
) -> None:
    """A file alone is read in parts, several files are read whole."""
    right = [written(tmp_path / "right.geojson", [ship("RIGHT", 9.0, 12.0)])] * (files - 1)
    loaded = run("load", *right, written(tmp_path / "odd.geojson", odd()), "--scene", fleet)
    remarks = loaded.err.splitlines()[:-1]
    assert (loaded.code, len(remarks)) == (0, 1), loaded.err
    assert "odd.geojson: " in remarks[0]
    assert remark in remarks[0]


def test_a_mistake_is_remarked_once_and_plans_like_the_others_are_not(run: Run, fleet: str, tmp_path: Path) -> None:
    """Compared with its file, and with the scene; a jet among ships flies, and is not too fast for them."""
    more = [ship(f"MORE{n}", 9.0, 12.0) for n in range(5)]
    mixed = written(tmp_path / "mixed.geojson", [*more, ship("ODD", 9.0, 180.0)])
    loaded = run("load", mixed, "--scene", fleet)
    assert loaded.err.count("travels at 180 kn") == 1
    assert "and the others at most at 12 kn" in loaded.err
    right = written(tmp_path / "right.geojson", [*more, ship("JET", 9.0, 240.0, floor_m=3_000)])
    assert run("load", right, "--scene", fleet).err.count("\n") == 1  # what came
    branch = run("branch", "create", "trial", "--scene", fleet)
    assert branch.code == 0, branch.err
    odd = written(tmp_path / "odd.geojson", [ship("OFF", -6.0, 12.0)])
    assert "km from the objects of the scene" in run("load", odd, "--scene", "trial").err
