"""Interleavings of edits, detections, admissions, branches and merges keep the promises, by a model of them."""

from collections.abc import Sequence
from dataclasses import fields

import pytest
from interleavings import BRANCH, SCENE, Actor, Faults, admission, detector, editor, merge, search, start

BEGIN = start({"a": 0, "b": 1, "c": 2})
# A part of the states, nearest first: each takes 30 us and 2 kB.
QUICK = 8_000
FAR = 500_000


def settings(faults: Faults) -> dict[str, Sequence[Actor]]:
    """Return actors that work side by side, by what they do."""
    return {
        "edits": [
            editor("e", [(SCENE, "a", 1), (SCENE, "b", 2)]),
            editor("f", [(SCENE, "c", None)], [(SCENE, "c", 1)]),
            detector(SCENE, faults),
            detector(SCENE, faults, two=True, crashes=True),
        ],
        "admissions": [
            admission("p", 3, faults, by_worker=False),
            admission("q", 3, faults, by_worker=True),
            admission("r", 3, faults, by_worker=True),
            editor("e", [(SCENE, "a", 3)], [(SCENE, "a", 0)]),
            detector(SCENE, faults, crashes=True),
        ],
        "branch": [
            editor("e", [(BRANCH, "b", 0)], [(BRANCH, "x", 2)]),
            editor("f", [(SCENE, "c", 0)]),
            detector(SCENE, faults),
            detector(BRANCH, faults),
        ],
        "merge": [
            editor("e", [(BRANCH, "b", 0)]),
            merge("b", faults),
            editor("f", [(SCENE, "b", 2)]),
            detector(SCENE, faults),
            detector(BRANCH, faults),
        ],
    }


@pytest.mark.parametrize("name", settings(Faults()))
def test_no_interleaving_breaks_a_promise(name: str) -> None:
    found = search(BEGIN, settings(Faults())[name], QUICK)
    assert not found.untruth, found


@pytest.mark.slow
@pytest.mark.parametrize("name", settings(Faults()))
def test_no_long_interleaving_breaks_a_promise(name: str) -> None:
    found = search(BEGIN, settings(Faults())[name], FAR)
    assert not found.untruth, found


# Where the search finds each fault.
FOUND = {
    "deletes_unseen_marks": "edits",
    "detects_without_lock": "edits",
    "admits_without_lock": "admissions",
    "admits_on_old_snapshot": "admissions",
    "parent_marks_no_branch": "branch",
    "branch_ignores_waiting_parent": "branch",
    "merge_checks_before_locks": "merge",
}


@pytest.mark.parametrize("fault", [one.name for one in fields(Faults)])
def test_the_search_finds_each_fault(fault: str) -> None:
    assert search(BEGIN, settings(Faults(**{fault: True}))[FOUND[fault]], QUICK).untruth
