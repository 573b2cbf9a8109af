"""Stage 4 in several processes, here made-up ones: each pair is decided once, whatever it is decided with."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from workloads import PAPER, throw

from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.pipeline import parallel
from conflictdb.pipeline.parallel import contacts_by_jobs
from conflictdb.stage1_broad_phase import candidates
from conflictdb.stage2_intersection import intersections
from conflictdb.stage4.contacts import contacts


def test_every_pair_is_decided_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in one process, from the first pair to the last; where one process is enough there are no others."""
    scene, areas, tracks = throw(PAPER, 3, 8, 8)
    plane = plane_of(scene)
    pieces = pieces_of(scene, plane, AreaBatch.of(areas), TrackBatch.of(tracks))
    pairs = intersections(pieces, *candidates(pieces), regions=False)
    pairs = pairs.take(np.flatnonzero((pieces.kind[pairs.a] == 1) | (pieces.kind[pairs.b] == 1)))

    def windows() -> tuple[np.ndarray, np.ndarray]:
        start, end = pieces.shared_span(pairs.a, pairs.b)
        return np.zeros(len(pairs)), (end - start) / 1e6

    # Only such as meet: none may be missing.
    met, _ = contacts(scene, plane, pieces, pairs, *windows())
    pairs = pairs.take(np.unique(met.pair))
    n = len(pairs)
    expected, expected_effort = contacts(scene, plane, pieces, pairs, *windows())
    processes: list[int] = []

    def computed(work: Callable[..., Any], jobs: Iterable[tuple[Any, ...]], count: int) -> Iterator[tuple[int, Any]]:
        processes.append(count)
        yield from reversed([(number, work(*job)) for number, job in enumerate(jobs)])

    monkeypatch.setattr(parallel, "computed", computed)
    for pairs_per_job, count in ((1, 3), (7, 3), (n - 1, 2), (n, None)):
        processes.clear()
        told: list[tuple[int, int]] = []
        found, effort = contacts_by_jobs(
            scene,
            plane,
            pieces,
            pairs,
            *windows(),
            jobs=3,
            pairs_per_job=pairs_per_job,
            progress=lambda *counts: told.append(counts),  # noqa: B023
        )
        assert processes == ([] if count is None else [count])
        assert (told[0], told[-1]) == ((0, n), (n, n))
        assert effort.searched_pairs == expected_effort.searched_pairs
        for column in fields(Contacts):
            np.testing.assert_array_equal(getattr(found, column.name), getattr(expected, column.name))
