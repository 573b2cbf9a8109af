"""Differences of departure, by the kernel: bits, larger reach, invalid pieces and times, and polygons of many sides."""

from dataclasses import replace

import numpy as np
import pytest
from layouts import GROWING, GROWING_CIRCLES, HARBOUR, HIGH_LATITUDE, LOW_LATITUDE, OCEAN, Workload
from mixed_scenes import plain_scene

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.earth.registry import Setup
from conflictdb.kernel import KernelPlane, KernelScene, Work
from conflictdb.kernel.differences import DifferenceState, Shifts, differences

WORKLOADS = [HIGH_LATITUDE, GROWING, OCEAN, GROWING_CIRCLES, HARBOUR]


def batch(workload: Workload) -> tuple[KernelPlane, Pieces, tuple[np.ndarray, np.ndarray]]:
    """A plane, pieces, and pairs of them that might meet."""
    scene, areas, tracks = plain_scene(workload, 1, 10, 10)
    setup = Setup.of(scene)
    pieces = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of(tracks))
    a, b = candidates(pieces)
    moving = (pieces.kind[a] == 1) | (pieces.kind[b] == 1)
    return setup.plane.kernel_plane, pieces, (a[moving], b[moving])


def shifts_of(pieces: Pieces, a: np.ndarray, b: np.ndarray) -> Shifts:
    """Pairs with the whole time of each piece; areas have none."""
    zero, end_s = [], []
    for members in (a, b):
        moves = pieces.kind[members] == 1
        zero.append(np.where(moves, pieces.start_us[members], 0))
        end_s.append(np.where(moves, pieces.end_us[members], 0) / 1e6 - zero[-1] / 1e6)
    nothing = np.zeros(len(a))
    every = np.full(len(a), np.inf)
    return Shifts(a, b, zero[0], zero[1], nothing, end_s[0], nothing, end_s[1], -every, every)


@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
@pytest.mark.parametrize("reach_m", [0.0, 1.0, 2000.0])
def test_any_number_of_threads_and_any_order_give_the_same_bits(workload: Workload, reach_m: float) -> None:
    plane, pieces, pairs = batch(workload)
    shifts, scene = shifts_of(pieces, *pairs), KernelScene(plane, pieces)
    order = np.random.default_rng(0).permutation(len(shifts))
    works = [Work(), Work(), Work()]
    one, two = (differences(scene, shifts, reach_m, works[n - 1], n) for n in (1, 2))
    mixed = np.empty_like(one)
    mixed[order] = differences(scene, shifts.take(order), reach_m, works[2])
    for name in ("outer_low", "inner_low", "inner_high", "outer_high", "state"):
        assert one[name].tobytes() == two[name].tobytes() == mixed[name].tobytes()
    assert works[0] == works[1] == works[2]
    assert set(one["state"].tolist()) <= {DifferenceState.NONE, DifferenceState.INNER}
    assert DifferenceState.INNER in one["state"]


def test_a_pair_takes_few_looks() -> None:
    """Contact is looked for where vertices pass: wherever else it is looked for, a tenth more looks are needed."""
    looks = pairs_n = 0
    for workload in WORKLOADS:
        plane, pieces, pairs = batch(workload)
        shifts, scene = shifts_of(pieces, *pairs), KernelScene(plane, pieces)
        for reach_m in (0.0, 500.0):
            differences(scene, shifts, reach_m, work := Work())
            looks += work.windows
            pairs_n += len(shifts)
    assert looks <= 3.3 * pairs_n  # 1,790 of 552 pairs


@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
def test_a_larger_reach_gives_larger_intervals(workload: Workload) -> None:
    """Proven contact at a smaller reach lies within the outer interval of a larger one."""
    plane, pieces, pairs = batch(workload)
    shifts, scene = shifts_of(pieces, *pairs), KernelScene(plane, pieces)
    small, large = (differences(scene, shifts, reach_m, Work()) for reach_m in (1.0, 2000.0))
    known = small["state"] == DifferenceState.INNER
    assert (small["inner_low"] >= large["outer_low"])[known].all()
    assert (small["inner_high"] <= large["outer_high"])[known].all()
    assert (large["outer_low"] < small["outer_low"])[known].any()


def test_a_pair_and_its_mirror_image_agree() -> None:
    """The differences of (b, a) are those of (a, b) with the other sign, to the errors of both."""
    plane, pieces, (a, b) = batch(GROWING)
    both = (pieces.kind[a] == 1) & (pieces.kind[b] == 1)
    a, b, scene = a[both], b[both], KernelScene(plane, pieces)
    one, other = (differences(scene, shifts_of(pieces, *pair), 100.0, Work()) for pair in ((a, b), (b, a)))
    assert both.any()
    known = (one["state"] == DifferenceState.INNER) & (other["state"] == DifferenceState.INNER)
    assert known.any()
    assert (one["inner_high"] <= -other["outer_low"])[known].all()
    assert (one["inner_low"] >= -other["outer_high"])[known].all()
    assert (other["inner_high"] <= -one["outer_low"])[known].all()


@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
@pytest.mark.parametrize("reach_m", [0.0, 500.0])
def test_a_weight_stretches_the_times_of_one_piece(workload: Workload, reach_m: float) -> None:
    """The weight 1 is none; with another one, contacts are the same, and the ends of proven intervals are contacts."""
    plane, pieces, pairs = batch(workload)
    shifts, scene = shifts_of(pieces, *pairs), KernelScene(plane, pieces)
    plain = differences(scene, shifts, reach_m, Work())
    one = differences(scene, replace(shifts, weight=np.ones(len(shifts))), reach_m, Work())
    assert plain.tobytes() == one.tobytes()
    weight = np.random.default_rng(0).uniform(0.3, 3.0, len(shifts))
    found = differences(scene, replace(shifts, weight=weight), reach_m, Work())
    assert ((found["state"] == DifferenceState.NONE) == (plain["state"] == DifferenceState.NONE)).all()
    known = found["state"] == DifferenceState.INNER
    assert known.sum() > 5
    for end in ("low", "high"):
        value = found[f"{end}_b_s"] - weight * found[f"{end}_a_s"]
        np.testing.assert_allclose(value[known], found[f"inner_{end}"][known], rtol=0.0, atol=1e-9)
        # Contacts are so at any weight.
        other = (plain[f"{end}_b_s"] - weight * plain[f"{end}_a_s"])[known & (plain["state"] == DifferenceState.INNER)]
        inside = found[known & (plain["state"] == DifferenceState.INNER)]
        assert (inside["outer_low"] <= other).all()
        assert (other <= inside["outer_high"]).all()
    for odd in (0.0, -1.0, np.nan, np.inf):
        unknown = differences(scene, replace(shifts, weight=np.full(len(shifts), odd)), reach_m, Work())
        assert (unknown["state"] == DifferenceState.UNKNOWN).all()


def test_an_invalid_piece_or_time_leaves_everything_possible() -> None:
    plane, pieces, (a, b) = batch(HIGH_LATITUDE)
    spoilt = int(a[pieces.kind[a] == 1][0])
    shape = pieces.shape_xy.copy()
    shape[pieces.shape_offset[spoilt]] = np.nan
    scene = KernelScene(plane, replace(pieces, shape_xy=shape, shape_to_xy=shape))
    shifts = shifts_of(pieces, a, b)
    its_own = (a == spoilt) | (b == spoilt)
    found = differences(scene, shifts, 1.0, Work())
    assert (found["state"][its_own] == DifferenceState.UNKNOWN).all()
    assert (found["state"][~its_own] != DifferenceState.UNKNOWN).all()
    np.testing.assert_array_equal(found["outer_low"][its_own], (shifts.b_start_s - shifts.a_end_s)[its_own])
    np.testing.assert_array_equal(found["outer_high"][its_own], (shifts.b_end_s - shifts.a_start_s)[its_own])
    for start, end in ((np.nan, 1.0), (2.0, 1.0), (0.0, np.inf), (-np.inf, np.inf)):
        times = np.full(len(a), start), np.full(len(a), end)
        odd = replace(shifts, a_start_s=times[0], a_end_s=times[1])
        found = differences(KernelScene(plane, pieces), odd, 1.0, Work())
        assert (found["state"] == DifferenceState.UNKNOWN).all()
        assert (found["outer_low"] <= found["outer_high"]).all()
        assert (found["inner_low"] > found["inner_high"]).all()


@pytest.mark.parametrize("reach_m", [-1.0, np.nan, np.inf])
def test_a_reach_that_is_none_is_refused(reach_m: float) -> None:
    plane, pieces, (a, b) = batch(HIGH_LATITUDE)
    with pytest.raises(ValueError, match="separation or tolerance"):
        differences(KernelScene(plane, pieces), shifts_of(pieces, a, b), reach_m, Work())


def test_columns_of_other_lengths_are_refused() -> None:
    plane, pieces, (a, b) = batch(HIGH_LATITUDE)
    shifts = replace(shifts_of(pieces, a, b), a_start_s=np.zeros(1))
    with pytest.raises(ValueError, match="one length"):
        differences(KernelScene(plane, pieces), shifts, 1.0, Work())


@pytest.mark.parametrize("reach_m", [0.0, 500.0])
@pytest.mark.parametrize("count", [300, 20_000])
def test_polygons_of_many_sides_take_bounded_work(count: int, reach_m: float) -> None:
    """Normals of few of their edges cut; axes between nearest points replace the others."""
    plane, pieces, (a, b) = batch(HIGH_LATITUDE)
    row = int(np.flatnonzero((pieces.kind[a] == 0) & (pieces.kind[b] == 1))[0])
    both = pieces.take(np.array([a[row], b[row]]))
    angle = 2.0 * np.pi * np.arange(count) / count
    middle = both.shape_xy[: both.shape_offset[1]].mean(axis=0)
    circle = middle + 1e5 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    shape = np.concatenate([circle, both.shape_xy[both.shape_offset[1] :]])
    offset = np.concatenate([[0], both.shape_offset[1:] - both.shape_offset[1] + count])
    large = replace(both, shape_xy=shape, shape_to_xy=shape, shape_offset=offset)
    one, work = np.zeros(1, np.int64), Work()
    [found] = differences(KernelScene(plane, large), shifts_of(large, one + 1, one), reach_m, work)
    assert found["state"] == DifferenceState.INNER
    assert max(found["inner_low"] - found["outer_low"], found["outer_high"] - found["inner_high"]) < 0.1
    assert work.evaluations < 8_000


@pytest.mark.parametrize("projection", ["mercator", "gnomonic"])
@pytest.mark.parametrize("reach_m", [1.0, 9260.0])
def test_ends_are_sharp_where_a_corner_passes_a_long_side_or_a_corner(reach_m: float, projection: str) -> None:
    """The half of a distance is smaller within a long side than at its ends; and contact sets are round at corners."""
    workload = LOW_LATITUDE if projection == "mercator" else replace(OCEAN, around_haven=(20.0, 40.0))
    scene, areas, tracks = plain_scene(workload, 0, 20, 30)
    setup = Setup.of(scene)
    pieces = pieces_of(setup, AreaBatch.of(areas), TrackBatch.of(tracks))
    a, b = candidates(pieces)
    moving = (pieces.kind[a] == 1) | (pieces.kind[b] == 1)
    a, b = a[moving], b[moving]
    work = Work()
    found = differences(KernelScene(setup.plane.kernel_plane, pieces), shifts_of(pieces, a, b), reach_m, work)
    inside = found[found["state"] == DifferenceState.INNER]
    errors_s = np.concatenate([inside["inner_low"] - inside["outer_low"], inside["outer_high"] - inside["inner_high"]])
    assert len(inside) > 50
    assert np.percentile(errors_s, 99) < (2e-5 if reach_m == 1.0 else 2e-2)
    assert work.windows < 12 * len(a)


@pytest.mark.parametrize("workload", WORKLOADS, ids=lambda workload: workload.name)
@pytest.mark.parametrize("reach_m", [0.0, 500.0])
def test_differences_asked_about_are_those_of_all(workload: Workload, reach_m: float) -> None:
    """Whole intervals are cut off at the least and the most; a pair without any among them has none."""
    plane, pieces, pairs = batch(workload)
    shifts, scene = shifts_of(pieces, *pairs), KernelScene(plane, pieces)
    every = differences(scene, shifts, reach_m, Work())
    met = np.flatnonzero(every["state"] == DifferenceState.INNER)
    shifts, every = shifts.take(met), every[met]
    middle = 0.5 * (every["inner_low"] + every["inner_high"])
    found = differences(scene, replace(shifts, least=middle), reach_m, Work())
    assert (found["state"] != DifferenceState.NONE).all()
    assert (found["outer_low"] >= middle - 1e-6).all()
    assert (found["outer_low"] <= middle + 1e-6).all()
    assert (found["outer_high"] >= every["inner_high"] - 1e-9).all()
    known = found["state"] == DifferenceState.INNER
    assert known.mean() > 0.9
    assert (found["inner_high"] <= every["outer_high"])[known].all()
    for gone in (
        replace(shifts, least=every["outer_high"] + 1e-3),
        replace(shifts, most=every["outer_low"] - 1e-3),
    ):
        beyond = differences(scene, gone, reach_m, Work())
        assert (beyond["state"] != DifferenceState.INNER).all()
