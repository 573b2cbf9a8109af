"""Boxes that meet are found as brute force finds them, some at a time, and few are compared in vain."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from conflictdb.kernel.boxes import BoxTree, RowBoxes, box_pairs, may_meet, near_order
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US

Pairs = set[tuple[int, int]]


def thrown(seed: int, n: int, wide: float, objects: int) -> RowBoxes:
    """Boxes in a unit square, of bounded width: some always active, some at all heights, some side by side."""
    rng = np.random.default_rng(seed)
    low = np.round(rng.random((n, 2)), 2)
    start = rng.integers(0, 50, n)
    end = start + rng.integers(0, 20, n)
    always, unbounded = rng.random(n) < 0.1, rng.random(n) < 0.5
    floor = rng.integers(0, 3, n) * 100.0
    return RowBoxes(
        boxes=np.concatenate([low, low + np.round(rng.random((n, 2)) * wide, 2)], axis=1),
        floor_m=np.where(unbounded, -np.inf, floor),
        ceiling_m=np.where(unbounded, np.inf, floor + 100.0),
        start_us=np.where(always, MINUS_INFINITY_US, start),
        end_us=np.where(always, INFINITY_US, end),
        object=rng.integers(0, objects, n),
        is_copy=rng.random(n) < 0.1,
    )


def brute_force(rows: RowBoxes) -> Pairs:
    i, j = np.nonzero(rows.object[:, None] < rows.object[None, :])
    meet = (rows.boxes[i, :2] <= rows.boxes[j, 2:]).all(axis=1) & (rows.boxes[j, :2] <= rows.boxes[i, 2:]).all(axis=1)
    meet &= (rows.start_us[i] <= rows.end_us[j]) & (rows.start_us[j] <= rows.end_us[i])
    meet &= (rows.floor_m[i] < rows.ceiling_m[j]) & (rows.floor_m[j] < rows.ceiling_m[i])
    meet &= ~(rows.is_copy[i] & rows.is_copy[j])
    return set(zip(i[meet].tolist(), j[meet].tolist(), strict=True))


def by_object(rows: RowBoxes) -> NDArray[np.int64]:
    return np.argsort(rows.object, kind="stable")


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("n", [1, 8, 9, 17, 250])
def test_boxes_that_meet_are_found_once(seed: int, n: int) -> None:
    """In any order of the rows, and whatever there is room for."""
    rows = thrown(seed, n, 0.2, max(n // 2, 1))
    order = near_order(rows)
    assert sorted(order.tolist()) == list(range(n))
    expected = brute_force(rows)
    assert n < 250 or len(expected) > 100
    for places in (order, np.arange(n)):
        some = rows.take(places)
        for at_once in (0, 1, 7, 10_000):
            chunks = [(places[a], places[b]) for a, b, _ in box_pairs(some, by_object(some), at_once)]
            found = [pair for a, b in chunks for pair in zip(a.tolist(), b.tolist(), strict=True)]
            assert len(found) == len(set(found))
            assert set(found) == expected
            # All pairs of a first object are together; of several objects there are no more than requested.
            first = [set(rows.object[a].tolist()) for a, _ in chunks]
            assert sum(map(len, first)) == len(set[int]().union(*first))
            for (a, _), objects in zip(chunks, first, strict=True):
                assert len(a) <= max(at_once, 1) or len(objects) == 1


def test_few_boxes_are_compared_in_vain() -> None:
    """For boxes side by side, and for boxes at one place in turn: all with all would be 25,000,000."""
    n = 5_000
    beside = thrown(1, n, 0.04, n)
    at = np.arange(n)
    anchored = RowBoxes(
        boxes=np.tile([0.0, 0.0, 1.0, 1.0], (n, 1)),
        floor_m=np.zeros(n),
        ceiling_m=np.ones(n),
        start_us=at % 1000 * 10,
        end_us=at % 1000 * 10 + 10,
        object=at,
        is_copy=np.zeros(n, np.bool_),
    )
    # Layers of one airspace, and seam copies of one place except for one box.
    height = np.random.default_rng(2).permutation(n) * 10.0
    layers = replace(anchored, start_us=np.zeros(n), end_us=np.ones(n), floor_m=height, ceiling_m=height + 11.0)
    copies = replace(layers, floor_m=np.zeros(n), ceiling_m=np.ones(n), is_copy=at > 0)
    for rows in (beside, anchored, layers, copies):
        rows = rows.take(near_order(rows))
        ((a, _, looked_at),) = box_pairs(rows, by_object(rows), 1_000_000)
        assert looked_at < 100 * n + 10 * len(a)
        assert len(a) >= n - 1


def test_boxes_that_are_all_one_meet_all() -> None:
    """No order separates equal boxes."""
    n = 300
    one = [np.full(n, at) for at in (0.0, 1.0, 5, 5)]
    whole = RowBoxes(np.zeros((n, 4)), *one, object=np.arange(n) % 150, is_copy=np.zeros(n, np.bool_))
    ((a, b, _),) = box_pairs(whole.take(near_order(whole)), by_object(whole), 1_000_000)
    assert len(set(zip(a.tolist(), b.tolist(), strict=True))) == len(a) == len(brute_force(whole))


def test_boxes_that_are_no_numbers_meet_nothing() -> None:
    rows = thrown(2, 40, 0.5, 40)
    rows.boxes[:20] = np.nan
    rows.boxes[20:25, 2:] = np.inf
    some = rows.take(near_order(rows))
    count = sum(len(a) for a, _, _ in box_pairs(some, by_object(some), 100))
    assert count == len(brute_force(rows)) > 0


def test_nothing_meets_nothing() -> None:
    rows = thrown(3, 0, 0.5, 1)
    assert len(near_order(rows)) == 0
    assert list(box_pairs(rows, np.empty(0, np.int64), 10)) == []


def test_the_kernel_refuses_rows_that_are_not_there() -> None:
    with pytest.raises(ValueError, match="piece"):
        list(box_pairs(thrown(4, 3, 0.5, 3), np.array([3]), 10))


@pytest.mark.parametrize("n", [0, 1, 9, 250])
def test_a_tree_finds_the_boxes_that_meet_others(n: int) -> None:
    """Whatever the objects, and however many they are."""
    rows = thrown(5, n + 60, 0.2, n + 60)
    number = np.arange(n + 60)
    ours, others = (replace(rows.take(number[part]), object=number[part]) for part in (slice(n), slice(n, None)))
    expected = {(b - n, a) for a, b in brute_force(replace(rows, object=number)) if a < n <= b}
    assert n < 250 or len(expected) > 100
    first, second = BoxTree(ours).pairs(others)
    assert len(first) == len(expected)
    assert set(zip(first.tolist(), second.tolist(), strict=True)) == expected


def test_a_tree_has_room_for_all_pairs() -> None:
    rows = replace(thrown(5, 60, 2.0, 60), is_copy=np.zeros(60, np.bool_))
    every = replace(rows, start_us=np.full(60, MINUS_INFINITY_US), end_us=np.full(60, INFINITY_US))
    first, _ = BoxTree(every).pairs(every)
    assert len(first) > 1024


@pytest.mark.parametrize("within_us", [0, 7])
def test_joins_and_trees_follow_the_rule_of_a_pair(within_us: int) -> None:
    """With owners, types that are not compared, last instants that do not belong to a row, and a time between rows."""
    n, rng = 250, np.random.default_rng(6)
    rows = replace(
        thrown(6, n, 0.3, n),
        end_inclusive=rng.random(n) < 0.5,
        numbers=rng.integers(0, 5, (n, 2)),
        type=rng.integers(0, 3, n),
    )
    compared = rng.random((3, 3)) < 0.7
    compared &= compared.T
    i, j = np.nonzero(rows.object[:, None] != rows.object[None, :])
    meet = may_meet(rows, i, j, within_us, compared)
    expected = set(zip(i[meet].tolist(), j[meet].tolist(), strict=True))
    assert 100 < len(expected) < len(brute_force(rows)) * 2
    order = near_order(rows)
    some = rows.take(order)
    joined = [(order[a], order[b]) for a, b, _ in box_pairs(some, by_object(some), 100, within_us, compared)]
    found = {pair for a, b in joined for pair in zip(a.tolist(), b.tolist(), strict=True)}
    assert found == {(a, b) for a, b in expected if rows.object[a] < rows.object[b]}
    first, second = BoxTree(rows).pairs(rows, within_us, compared)
    others = rows.object[first] != rows.object[second]
    assert set(zip(first[others].tolist(), second[others].tolist(), strict=True)) == expected
