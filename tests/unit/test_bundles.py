"""Bundles contain every piece once, of one object each and near each other; their pairs are those of the pieces."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from layouts import HARBOUR, LONG_LEGS, LOW_LATITUDE, SEAM, Workload
from mixed_scenes import plain_scene

from conflictdb import Area, Scene, Track, rectangle_outline_m
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Bundles, Pieces
from conflictdb.core.object_pairs import object_numbers
from conflictdb.core.pieces.bundling import bundles_of
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.earth.registry import Setup
from conflictdb.kernel.boxes import boxes_of
from conflictdb.kernel.bundles import bundled_pairs

OUTLINE_M = rectangle_outline_m(50.0, 50.0, 10.0, 10.0)
MINUTE_US = 60_000_000


def made(scene: Scene, areas: list[Area], tracks: list[Track]) -> Pieces:
    return pieces_of(Setup.of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))


def names(pieces: Pieces) -> list[tuple[int, ...]]:
    columns = (pieces.kind, pieces.object_id, pieces.part, pieces.turn)
    return [tuple(map(int, row)) for row in zip(*columns, strict=True)]


def anchored(key: str, legs: int, **changes: object) -> Track:
    """A ship that swings around 40 m to and fro, a leg a minute."""
    at = np.array([[0.0, 0.0004 * (i % 2)] for i in range(legs + 1)])
    return Track(key, at, np.arange(legs + 1) * MINUTE_US, OUTLINE_M, **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, HARBOUR, LONG_LEGS], ids=lambda w: w.name)
def test_bundles_hold_every_piece_and_meet_where_pieces_do(workload: Workload) -> None:
    scene, areas, tracks = plain_scene(workload, 4, 25, 25)
    pieces = made(scene, areas, tracks)
    bundles = bundles_of(pieces)
    assert sorted(names(bundles.pieces)) == sorted(names(pieces))
    assert (np.diff(bundles.offset) > 0).all()
    first = np.repeat(bundles.offset[:-1], np.diff(bundles.offset))
    held = bundles.pieces
    for column in (object_numbers(held), held.turn, held.floor_m, held.ceiling_m):
        assert (column == column[first]).all()
    of_each = names(held)
    wanted = {frozenset((names(pieces)[a], names(pieces)[b])) for a, b in np.stack(candidates(pieces)).T}
    number = object_numbers(held)[bundles.offset[:-1]]
    a, b = np.nonzero(number[:, None] < number[None, :])
    turned = held.turn[bundles.offset[:-1]] != 0
    a, b = a[~(turned[a] & turned[b])], b[~(turned[a] & turned[b])]
    found = [frozenset((of_each[i], of_each[j])) for i, j in zip(*bundled_pairs(bundles, a, b), strict=True)]
    assert len(found) == len(set(found))
    # Heights are compared where bundles are.
    assert wanted <= set(found)
    if not any(area.floor_m or area.ceiling_m for area in areas):
        assert wanted == set(found)


@pytest.mark.parametrize("room", [1, 3, 2**24])
def test_pairs_of_bundles_need_no_more_room_than_they_take(room: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two areas of 200,000 parts each; two pairs of parts meet. All pairs would be 320 GB."""
    monkeypatch.setattr("conflictdb.kernel.bundles._FIRST_ROOM", room)
    places = ((0.0, 1.0, 1.1), (3.0, 1.0, 1.1))
    areas = [
        Area(f"A{i}", shapely.MultiPolygon([shapely.box(x, 0.0, x + 0.05, 0.05) for x in xs]))
        for i, xs in enumerate(places)
    ]
    pieces, count = made(Scene("s"), areas, []), 200_000
    whole = Bundles(
        pieces.take(np.repeat(np.arange(6), [count, 1, 1, count, 1, 1])), np.array([0, count + 2, 2 * count + 4])
    )
    a, b = bundled_pairs(whole, np.array([0]), np.array([1]))
    met = [(count, 2 * count + 2), (count + 1, 2 * count + 3)]
    assert list(zip(a.tolist(), b.tolist(), strict=True)) == met


def test_a_ship_at_anchor_is_one_bundle_for_an_hour() -> None:
    bundles = bundles_of(made(Scene("s"), [], [anchored("ship", 60)]))
    assert len(bundles) == 1
    assert (np.diff(bundles.pieces.start_us) > 0).all()


def test_a_bundle_holds_only_so_many_slices() -> None:
    assert np.diff(bundles_of(made(Scene("s"), [], [anchored("ship", 150)])).offset).tolist() == [64, 64, 22]


def test_slices_far_from_each_other_are_no_bundle() -> None:
    way = Track("fast", [(0.0, 0.0), (3.0, 3.0)], [0, 60 * MINUTE_US], OUTLINE_M)
    pieces = made(Scene("s"), [], [way])
    bundles = bundles_of(pieces)
    box = boxes_of(bundles.pieces)
    size = np.prod(box[:, 2:] - box[:, :2], axis=1)
    first = bundles.offset[:-1]
    whole = np.maximum.reduceat(box[:, 2:], first) - np.minimum.reduceat(box[:, :2], first)
    assert 1 < len(bundles) < len(pieces)
    assert (np.prod(whole, axis=1) <= 32.0 * np.minimum.reduceat(size, first) * (1.0 + 1e-12)).all()


def test_legs_of_other_heights_or_outlines_are_bundles_of_their_own() -> None:
    legs = 10
    floors = np.where(np.arange(legs) < 4, 0.0, 100.0)
    split = anchored("heights", legs, floors_m=floors, ceilings_m=floors + 50.0)
    assert np.diff(bundles_of(made(Scene("s"), [], [split])).offset).tolist() == [4, 6]
    grown = anchored("grows", legs, grow_mps=0.01)
    assert len(bundles_of(made(Scene("s"), [], [grown]))) == legs


def test_parts_along_a_diagonal_are_bundled_apart() -> None:
    """One box around a long channel would meet everything next to it."""
    steps = np.arange(40) * 0.25
    banks = [np.stack([steps, steps + 0.1 * (np.arange(40) % 2) + side], axis=1) for side in (0.0, 0.15)]
    channel = Area("channel", shapely.MultiPolygon([shapely.Polygon(np.concatenate([banks[0], banks[1][::-1]]))]))
    disc = Area("disc", shapely.MultiPolygon([shapely.Point(0.0, 0.0).buffer(1.0) - shapely.box(-0.2, 0.1, 0.2, 2.0)]))
    pieces = made(Scene("s"), [channel, disc], [])
    bundles = bundles_of(pieces)
    box = boxes_of(bundles.pieces)
    first = bundles.offset[:-1]
    whole = np.maximum.reduceat(box[:, 2:], first) - np.minimum.reduceat(box[:, :2], first)
    size, of_channel = np.prod(whole, axis=1), bundles.pieces.object_id[first] == 0
    every = box[bundles.pieces.object_id == 0]
    assert size[of_channel].sum() < 0.6 * np.prod(every[:, 2:].max(axis=0) - every[:, :2].min(axis=0))
    assert of_channel.sum() <= 16
    assert (~of_channel).sum() == 1


def test_instants_are_shared_where_both_hold_them() -> None:
    """Slices of one ship end when the next begins: both meet objects that are active for that instant alone."""
    pieces = made(Scene("s"), [], [anchored("first", 4), anchored("second", 4)])
    whole = Bundles(pieces, np.array([0, 4, 8]))
    a, b = bundled_pairs(whole, np.array([0]), np.array([1]))
    nth = sorted((int(i), int(j) - 4) for i, j in zip(a, b, strict=True))
    assert nth == [(i, j) for i in range(4) for j in range(4) if abs(i - j) <= 1]
    excluded = replace(pieces, end_inclusive=np.zeros(8, np.bool_))
    a, b = bundled_pairs(Bundles(excluded, whole.offset), np.array([0]), np.array([1]))
    assert sorted(zip(a.tolist(), (b - 4).tolist(), strict=True)) == [(i, i) for i in range(4)]


def test_nothing_is_no_bundle() -> None:
    nothing = made(Scene("s"), [], [])
    assert len(bundles_of(nothing)) == 0
    a, b = bundled_pairs(bundles_of(nothing), np.empty(0, np.int64), np.empty(0, np.int64))
    assert len(a) == len(b) == 0


def test_the_kernel_refuses_bundles_that_are_not_there() -> None:
    whole = Bundles.of_each(made(Scene("s"), [], [anchored("first", 4)]))
    with pytest.raises(ValueError, match="piece"):
        bundled_pairs(whole, np.array([0]), np.array([-1]))
