"""With a separation, objects that touch are closest at their first touch, which the search for contacts finds."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from layouts import GROWING, HARBOUR, LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene
from staged import Staged

from conflictdb.arrays.answers import Conflicts
from conflictdb.core import closest_approaches
from conflictdb.model.results import Kind

# Instants are microseconds, rounded by one search to the nearest and by the other down; contacts err by less.
SAME_US = 2


@pytest.mark.parametrize("workload", [LOW_LATITUDE, HARBOUR, SEAM, GROWING, OCEAN], ids=lambda one: one.name)
def test_the_first_touch_is_that_of_the_search_for_the_least_distance(
    workload: Workload, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    approaches = closest_approaches.approaches

    def counted(prepared: Any, a: Any, *rest: Any) -> Any:
        asked.append(len(a))
        return approaches(prepared, a, *rest)

    def found(seed: int) -> Conflicts:
        """Return the conflicts of a scene that is crowded enough to meet."""
        scene, areas, tracks = plain_scene(
            workload if workload is HARBOUR else replace(workload, window=1.5), seed, 10, 12
        )
        return Staged.of(replace(scene, separation_m=500.0), areas, tracks, regions=False).run(jobs=1)[0]

    touched = 0
    for seed in range(4):
        quick = found(seed)
        with monkeypatch.context() as patch:
            patch.setattr(closest_approaches, "_with_touches", lambda p, m, conflicts, rows, *rest: (conflicts, rows))
            patch.setattr(closest_approaches, "approaches", counted)
            slow = found(seed)
        assert np.array_equal(quick.closest_m == 0.0, slow.closest_m == 0.0)
        assert np.nanmax(np.abs(quick.closest_m - slow.closest_m), initial=0.0) <= 1e-9
        assert np.abs(quick.closest_us - slow.closest_us).max(initial=0) <= SAME_US
        moves = (quick.a_kind == Kind.TRACK.code) | (quick.b_kind == Kind.TRACK.code)
        touches = (quick.closest_m == 0.0) & moves
        touched += int(touches.sum())
        assert np.array_equal(quick.closest_a_deg[touches], quick.closest_b_deg[touches])
    assert touched > 10
    with monkeypatch.context() as patch:
        whole = sum(asked)
        asked.clear()
        patch.setattr(closest_approaches, "approaches", counted)
        for seed in range(4):
            found(seed)
    assert sum(asked) <= whole - touched, "pairs that touch need no search for the least distance"
