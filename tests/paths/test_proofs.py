"""Every acceptance scene is certified, and `check_proof.py` accepts the proof, whatever else it cannot check."""

import contextlib
import io
import warnings
from collections.abc import Iterator
from pathlib import Path

import digests
import pytest

from conflictdb import certify
from conflictdb.errors import IncompleteWarning
from conflictdb.formats import check_proof

ACCEPTED = 0
SOMETHING_IS_NOT_CHECKED = 2
SCENES = digests.acceptance_scenes()
# Scenes that every run certifies; the others with `-m slow`.
_FEW = 13


def checked(path: Path) -> tuple[int, str]:
    """Return the exit status and the report of the checker."""
    with contextlib.redirect_stdout(io.StringIO()) as report:
        status = check_proof.main([str(path)])
    return status, report.getvalue()


@contextlib.contextmanager
def quietly() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteWarning)
        yield


def _marked(k: int, name: str) -> object:
    return name if k % _FEW == 0 else pytest.param(name, marks=pytest.mark.slow)


@pytest.mark.parametrize("name", [_marked(k, name) for k, name in enumerate(SCENES)])
def test_proof_of_scene(tmp_path: Path, name: str) -> None:
    """Nothing is without proof; what is not checked is only what proofs are not about."""
    scene, areas, tracks = SCENES[name]()
    with quietly():
        made = certify(tracks, areas, tmp_path / "proof", scene)
    status, report = checked(tmp_path / "proof")
    assert made, made
    assert status in (ACCEPTED, SOMETHING_IS_NOT_CHECKED), report
    lines = [line for line in report.splitlines() if line.startswith("not checked")]
    known = ("with tolerances", "separation in time", "schedules", "verdicts", "which were not cut")
    assert all(any(one in line for one in known) for line in lines), report
