"""One table defines each method; an unknown method, or one without stage 4, runs no solver silently."""

import inspect
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scenes
import shapely

from conflictdb import kernel
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.cutting import area_pieces, track_pieces
from conflictdb.core.stage4.contact_search import contacts
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.model.methods import METHODS, Method, MethodSpec, Solver
from conflictdb.model.plans import EarthModel, Scene
from conflictdb.model.results import Verdict

ROOT = Path(__file__).resolve().parents[2]


def test_every_method_has_its_row() -> None:
    assert set(METHODS) == set(Method)
    for spec in METHODS.values():
        assert spec.solver is not None or not spec.needs_regions


@pytest.mark.parametrize("method", Method)
def test_what_a_method_says_promises_and_costs_is_told_alike_everywhere(method: Method) -> None:
    """In the table of docs/explanation/accuracy.md, in the enum, and in the comment of the catalog."""
    spec = METHODS[method]
    default = " (default)" if method is Scene("s").method else ""
    last = 2 if spec.solver is None else 4
    row = f"| `{method}`{default} | stage {last} | {spec.says} | {spec.promises} | {spec.costs} |"
    assert row in (ROOT / "docs" / "explanation" / "accuracy.md").read_text().splitlines()
    assert f'{method.name} = "{method}"  # {spec.says}\n' in inspect.getsource(Method)
    comments = (ROOT / "sql" / "65_scenes.sql").read_text().replace("'\n'", "")
    assert f"{method} ({spec.says})" in comments


def test_a_removed_method_is_refused_with_the_one_to_use() -> None:
    with pytest.raises(
        InvalidInput, match="must be one of screen, exact, nlp; got 'window', which was removed: use exact"
    ):
        Scene("s", method="window")  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["guess", "EXACT", "", None, 3])
def test_an_unknown_method_is_refused(method: object) -> None:
    with pytest.raises(InvalidInput, match="must be one of screen, exact, nlp"):
        Scene("s", method=method)  # type: ignore[arg-type]


def test_a_method_that_stops_before_stage_4_is_not_solved_by_another() -> None:
    scene = Scene("s", earth=EarthModel.SPHERE, method=Method.SCREEN)
    still = area_pieces(Setup.of(scene), AreaBatch.of([scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))]))
    moving = track_pieces(Setup.of(scene), TrackBatch.of([scenes.track("T", [(0, 0), (1, 0)], [0, 3600])]))
    pieces = Pieces.concatenate([still, moving])
    first, second = np.zeros(1, np.int64), np.full(1, len(still))
    pair = Pairs(first, second, np.empty((0, 2)), np.zeros(2, np.int64))
    prepared = kernel.KernelScene(Setup.of(scene).plane.kernel_plane, pieces)
    with pytest.raises(ValueError, match="method screen stops before stage 4"):
        contacts(Setup.of(scene), prepared, pair, np.zeros(1), np.full(1, 3600.0))
    contacts(Setup.of(replace(scene, method=Method.EXACT)), prepared, pair, np.zeros(1), np.full(1, 3600.0))


def test_a_solver_is_not_guessed() -> None:
    """A row must also state the method's promises and costs."""
    with pytest.raises(TypeError):
        MethodSpec(solver=Solver.CERTIFIED)  # type: ignore[call-arg]


def test_codes_of_verdicts_do_not_follow_the_order_of_their_names() -> None:
    assert {verdict.value: verdict.code for verdict in Verdict} == {
        "conflict": 0,
        "grazing": 1,
        "unresolved": 2,
        "near": 3,
    }
    assert [Verdict.of_code(verdict.code) for verdict in Verdict] == list(Verdict)
