"""A question that nobody has knows every feature of plans, though its file names none: support/made_up_question.py."""

from pathlib import Path

import made_up_question
import numpy as np
import pytest
import shapely
from case import Case, Finding, idle_schedules, only_of, same, scene_of
from path_table import SEEDS, Table
from spellings import blocks, columns_named

from conflictdb.core.near import Memory, Question
from conflictdb.core.world import World, occupy
from conflictdb.model.plans import Area, Scene
from conflictdb.model.settings import SETTINGS


def surroundings(case: Case) -> Finding:
    """Compare the surroundings of the plan of a scene with the rows of `solve`."""
    key = case.mixed.plan_key
    with idle_schedules():
        found = made_up_question.surroundings(case.mixed.areas, case.mixed.tracks, case.scene, key)
    around = {key}.union(*case.rows_of_plan)
    return same(only_of(case.rows, around), found, is_exact=case.has_fixed_plane)


def test_a_made_up_question_knows_every_feature(tmp_path: Path) -> None:
    table, paths = Table(), {"surroundings": surroundings}
    for seed in SEEDS:
        table.put(Case(scene_of(seed), tmp_path), paths, 1)
        if not table.empty(paths):
            break
    assert not table.problems, "\n".join(table.problems[:20])
    assert not table.empty(paths)


def test_its_file_names_no_feature() -> None:
    """Its file contains the name of no column of plans and of no setting."""
    for _, _, code in blocks(Path(made_up_question.__file__)):
        assert columns_named(code, in_python=True) == ()
        assert not [one.name for one in SETTINGS if one.name in code and one.name not in ("name", "method")]


@pytest.mark.parametrize("any_height", [False, True])
def test_pairs_of_some_pieces_need_not_share_heights(any_height: bool) -> None:
    square = shapely.box(9.0, 57.0, 9.2, 57.2)
    areas = [Area("high", square, floor_m=100.0), Area("low", square, ceiling_m=50.0)]
    occupied = occupy(World.of(Scene("s"), areas, []), areas, [])
    question = Question(np.array([1]), any_height=any_height)
    found = [(a, b) for chunk in Memory(occupied.pieces).pairs(question) for a, b in zip(chunk.a, chunk.b, strict=True)]
    assert found == ([(0, 1)] if any_height else [])
