"""DNV's baseline ship encounters: every designed encounter is a conflict, when it was designed to be.

Own ship and targets sail between two waypoints at constant speed, and all start at the same instant. Hulls are
rectangles of length and width about the ship's reference point (a and b fore and aft, c and d to port and starboard).
`vectorTime` says after how many minutes own ship and target meet.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from reference import data
from scene_file import iso
from scenes import T0_US
from verdicts import Reported, by_pair, solved

from conflictdb import connect, formats
from conflictdb.model.results import Verdict

WITHIN_S = 60.0


def situations() -> list[tuple[str, Path, Path]]:
    """Number, the design and the generated situation of each encounter set."""
    found = []
    for design in sorted(data("encounters-dnv", "input").glob("baseline_situation_*.json")):
        number = design.name.split("_")[2]
        found.append((number, design, data("encounters-dnv", "generated", f"traffic_situation_{number}.json")))
    return found


def ship(key: str, described: dict[str, Any]) -> dict[str, Any]:
    """A ship as a feature of a scene file, with the speed it was given."""
    size = described["static"]["dimensions"]
    return {
        "type": "Feature",
        "id": key,
        "geometry": {
            "type": "LineString",
            "coordinates": [[w["position"]["lon"], w["position"]["lat"]] for w in described["waypoints"]],
        },
        "properties": {
            "kind": "track",
            "name": described["static"]["name"],
            "start": iso(T0_US),
            "speed_kn": described["waypoints"][0]["leg"]["sog"],
            "fore_m": size["a"],
            "aft_m": size["b"],
            "port_m": size["c"],
            "starboard_m": size["d"],
        },
    }


def write_situation(path: Path, name: str, generated: Path) -> Path:
    situation = json.loads(generated.read_text())
    ships = [ship("own", situation["ownShip"])]
    ships += [ship(f"target {i}", target) for i, target in enumerate(situation["targetShips"], 1)]
    path.write_text(json.dumps({"type": "FeatureCollection", "scene": {"name": name}, "features": ships}))
    return path


def problems(number: str, design: Path, reported: dict[tuple[str, str], Reported]) -> list[str]:
    found = []
    for i, encounter in enumerate(json.loads(design.read_text())["encounters"], 1):
        answer = reported.get(("own", f"target {i}"))
        who = f"situation {number}, target {i}, {encounter['desiredEncounterType']}"
        if answer is None or answer.verdict is not Verdict.CONFLICT:
            found.append(f"{who}: {answer and answer.verdict}")
            continue
        designed_s = 60.0 * encounter["vectorTime"]
        start, end = ((instant - T0_US) / 1e6 for instant in answer.periods_us[0] if instant is not None)
        if abs(start - designed_s) > WITHIN_S or len(answer.periods_us) > 1:
            found.append(f"{who}: in contact from {start:.1f} to {end:.1f} s, designed for {designed_s:.0f} s")
    return found


def test_every_designed_encounter_is_a_conflict_at_its_time(tmp_path: Path) -> None:
    wrong: list[str] = []
    encounters = 0
    for number, design, generated in situations():
        scene, areas, tracks, skipped = formats.read(write_situation(tmp_path / "scene.geojson", number, generated))
        assert scene is not None
        assert not areas
        assert not skipped
        encounters += len(tracks) - 1
        wrong += problems(number, design, solved(scene, areas, tracks))
    assert not wrong
    assert encounters == 69  # in 27 situations


@pytest.mark.parametrize("number", ["22", "54"])
def test_encounters_through_the_database(dsn: str, tmp_path: Path, number: str) -> None:
    _, design, generated = next(s for s in situations() if s[0] == number)
    with connect(dsn) as db:
        name = db.load(write_situation(tmp_path / "scene.geojson", number, generated)).name
        db.scene(name).detect(jobs=1)
        assert not problems(number, design, by_pair(db.scene(name).conflicts()))
