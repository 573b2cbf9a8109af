"""The command line gives the answer of `solve`: ten scenes are detected and listed, and their plans are probed."""

import json
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import pytest
from case import Case, Rows
from commands import Outcome, Run
from mixed_scenes import mixed_scene
from scene_features import Feature

from conflictdb.formats import write_scene_file
from conflictdb.model.results import Verdict

SCENES: Final = {
    0: {Feature.ACTIVATIONS, Feature.SEPARATION},
    1: {Feature.DEPARTURES, Feature.OWNERS},
    2: {Feature.CROSS_TRACK, Feature.DEPARTURE_WINDOW},
    3: {Feature.SPEED_WINDOW, Feature.ARRIVAL_WINDOW, Feature.TURN_RADIUS},
    4: {Feature.CLIMBS, Feature.VERTICAL_SEPARATION},
    5: {Feature.LEG_HEIGHTS, Feature.CLOSED, Feature.ANTIMERIDIAN},
    6: {Feature.CLASSES, Feature.ALLOWED, Feature.CLASS_VERTICAL},
    7: {Feature.TIME_SEPARATION, Feature.CLASS_TIME, Feature.ZERO},
    8: {Feature.GROWTH, Feature.OUTLINES, Feature.GREAT_CIRCLE},
    9: {Feature.HIGH_LATITUDE, Feature.UNBOUNDED, Feature.SPHERE},
}


def expected(rows: Rows) -> dict[tuple[str, str], tuple[str, list[list[str | None]]]]:
    return {
        pair: (
            str(row.verdict),
            [[None if end is None else end.isoformat() for end in period] for period in row.periods],
        )
        for pair, row in rows.items()
        if row.verdict is not Verdict.NEAR
    }


def found(listed: list[dict[str, Any]]) -> dict[tuple[str, str], tuple[str, list[list[str | None]]]]:
    return {
        (row["a_key"], row["b_key"]): (
            row["verdict"],
            [
                [None if end is None else datetime.fromisoformat(end).isoformat() for end in ends]
                for ends in row["periods"]
            ],
        )
        for row in listed
    }


def done(outcome: Outcome) -> Outcome:
    assert outcome.code == 0, outcome.err
    return outcome


@pytest.mark.parametrize("seed", SCENES)
def test_scenes_are_detected_and_probed(run: Run, tmp_path: Path, seed: int) -> None:
    mixed = mixed_scene(seed, SCENES[seed])
    case = Case(mixed, tmp_path)
    whole, plan = tmp_path / "whole.geojson", tmp_path / "plan.geojson"
    write_scene_file(mixed.objects, whole, mixed.scene)
    write_scene_file([mixed.plan], plan, mixed.scene)
    done(run("detect", whole, "--scene", "s"))
    listed = done(run("conflicts", "--scene", "s", "--format", "json"))
    assert found(json.loads(listed.out)) == expected(case.rows)
    probed = done(run("probe", plan, "--scene", "s", "--format", "json"))
    assert found(json.loads(probed.out)) == expected(case.rows_of_plan)
