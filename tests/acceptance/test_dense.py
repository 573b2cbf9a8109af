"""Random pairs of pieces of every workload, compared with a dense sampling of their motion: 0 missed, 0 false."""

from dataclasses import replace

import dense
import numpy as np
import pytest
from layouts import GROWING, GROWING_CIRCLES, HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE, OCEAN, WORKLOADS, Workload
from sampling import KINDS, placed, sampled

from conflictdb import kernel
from conflictdb.arrays.answers import Contacts
from conflictdb.earth.registry import Setup
from conflictdb.kernel.movement import Movement
from conflictdb.model.results import Kind, Verdict

SEED = 1000
QUICK = [pytest.param(w, 2, id=w.name) for w in WORKLOADS]
SLOW = [pytest.param(w, 20, id=f"{w.name}, many", marks=pytest.mark.slow) for w in WORKLOADS]


@pytest.mark.parametrize(("workload", "scenes"), QUICK + SLOW)
def test_no_sample_contradicts_an_answer(workload: Workload, scenes: int) -> None:
    """Some ten thousand pairs of each workload; `dense.py` takes ten million."""
    total = dense.Count()
    for seed in range(SEED, SEED + scenes):
        total.add(dense.check(workload, seed, 120))
    assert total.sampled.wrong == 0, total.sampled.problems
    assert min(total.pairs, total.dismissed, total.conflicts, total.sampled.overlapping) > 1000
    assert total.unresolved == 0


@pytest.mark.parametrize(
    "workload", [LOW_LATITUDE, HIGH_LATITUDE, OCEAN, GROWING, GROWING_CIRCLES], ids=lambda w: w.name
)
def test_samples_tell_what_is_wrong(workload: Workload) -> None:
    """A contact that is missing, begins late, ends early, lasts too long or is made up is seen."""
    scene, pieces, pairs, found = dense.solved(workload, SEED, 20)
    rng = np.random.default_rng(0)
    assert sampled(scene, pieces, pairs, found, rng).wrong == 0
    is_long = (found.verdict == Verdict.CONFLICT.code) & (found.end_s - found.start_s > 600.0)
    low, high = np.zeros(len(pairs)), np.subtract(*pieces.shared_span(pairs.a, pairs.b)[::-1]) / 1e6
    later = np.flatnonzero(is_long & (found.start_s > 1.0))
    sooner = np.flatnonzero(is_long & (found.end_s < high[found.pair] - 1.0))
    apart = np.setdiff1d(np.arange(len(pairs)), found.pair)
    kept = np.setdiff1d(np.arange(len(found)), np.flatnonzero(is_long)[:1])
    made_up = Contacts(
        apart[:1], low[apart[:1]], high[apart[:1]], np.zeros(1), found.verdict[is_long][:1], np.ones(1, bool)
    )
    for answer, kind in (
        (Contacts(*(getattr(found, name)[kept] for name in Contacts.__slots__)), 1),
        (_shifted(found, "start_s", later[0], 0.5), 1),
        (_shifted(found, "end_s", sooner[0], -0.5), 1),
        (_shifted(found, "start_s", later[0], -0.5), 2),
        (_shifted(found, "end_s", sooner[0], 0.5), 2),
        (Contacts.concatenate([found, made_up]), 2),
    ):
        sampled_pairs = sampled(scene, pieces, pairs, answer, rng)
        assert sampled_pairs.wrong > 0
        assert all(KINDS[kind] in line for line in sampled_pairs.problems)


def _shifted(found: Contacts, name: str, row: int, by_s: float) -> Contacts:
    values = getattr(found, name).copy()
    values[row] += by_s
    return replace(found, **{name: values})


@pytest.mark.parametrize("workload", [LONG_LEGS, HIGH_LATITUDE, OCEAN, GROWING, GROWING_CIRCLES], ids=lambda w: w.name)
@pytest.mark.parametrize("seed", [0, 1])
def test_samples_are_taken_where_pieces_are(workload: Workload, seed: int) -> None:
    """Independent formulas agree to a tenth of the distance at which samples contradict answers."""
    scene, pieces, _, _ = dense.solved(workload, seed, 20)
    plane, tracks = Setup.of(scene).plane, np.flatnonzero(pieces.kind == Kind.TRACK.code)[::5]
    zero, slots = pieces.leg_start_us[tracks], int(np.diff(pieces.shape_offset).max())
    t = (0.5 * (pieces.start_us + pieces.end_us)[tracks] - zero) / 1e6
    movement = Movement(kernel.KernelScene(plane.kernel_plane, pieces), tracks, zero, np.zeros((2, len(tracks))), slots)
    xy = movement.positions(t)
    for i, piece in enumerate(tracks):
        mine = placed(scene, pieces, int(piece), int(zero[i]), float(t[i]))
        off = np.hypot(*(mine.T - xy[:, : len(mine), i]))
        assert off.max() < 1e-4 * plane.largest_scale(xy[:, :, [i]])[0]
