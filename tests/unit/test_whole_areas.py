"""Depth in a whole area, where every part of it is too narrow for a conflict beyond the tolerance."""

from dataclasses import replace

import numpy as np
import pytest
import scenes
import shapely

from conflictdb import kernel
from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.model import EarthModel, Scene
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.pipeline.whole_areas import _cores, _may_be_deep, _meet, _near_border, _polygons, deep_in_whole_areas
from conflictdb.stage4.contacts import GRAZING

# Two strips of 56 m each, with the equator as their seam.
SOUTH, NORTH = shapely.box(0.0, -0.0005, 0.1, 0.0), shapely.box(0.0, 0.0, 0.1, 0.0005)


@pytest.mark.parametrize(
    ("lat", "tolerance_m", "is_deep"), [(0.0, 50.0, True), (0.0, 60.0, False), (0.0002, 50.0, False)]
)
def test_a_point_along_the_seam_of_two_strips(lat: float, tolerance_m: float, is_deep: bool) -> None:
    """It enters at one end of both, leaves at the other, and is deep in the whole only in between."""
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=tolerance_m)
    plane = plane_of(scene)
    areas = [scenes.area(key, part) for key, part in (("S", SOUTH), ("N", NORTH))]
    track = scenes.track("T", [(-0.05, lat), (0.15, lat)], [0, 3600], 0.0, 0.0, 0.0, 0.0)
    pieces = pieces_of(scene, plane, AreaBatch.of(areas), TrackBatch.of([track]))
    moves = pieces.kind == 1
    # The strips as parts of one area; the whole leg in place of its slices.
    pieces = replace(
        pieces,
        object_id=np.zeros(len(pieces), np.int64),
        start_us=np.where(moves, pieces.leg_start_us, pieces.start_us),
        end_us=np.where(moves, pieces.leg_end_us, pieces.end_us),
    )
    parts, first = np.flatnonzero(~moves), np.flatnonzero(moves)[[0, 0]]
    pairs = Pairs(parts, first, np.empty((0, 2)), np.zeros(3, np.int64))
    both = np.full(2, 900.0), np.full(2, 2700.0), np.zeros(2), np.full(2, GRAZING, np.int8), np.ones(2, np.bool_)
    contacts = Contacts(np.arange(2), *both)
    whole = np.array([shapely.union(SOUTH, NORTH)])
    prepared = kernel.Scene(plane.kernel_plane, pieces)
    mine = [np.arange(2)]
    found = deep_in_whole_areas(scene, plane, prepared, pairs, contacts, mine, lambda numbers: whole[numbers])
    assert found.tolist() == [is_deep]


@pytest.mark.parametrize("away", [-1.0, 0.0, 1.0])
def test_what_is_deep_is_never_ruled_out_before_it_is_looked_at(away: float) -> None:
    """Random areas with dents, and triangles about them, a turn apart or not; of what is not deep most is."""
    rng, n = np.random.default_rng(5), 600
    plane = plane_of(Scene("s"))
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, (n, 9)), axis=1)
    stars = rng.uniform(200.0, 1500.0, (n, 9, 1)) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    wholes = shapely.make_valid(shapely.polygons(stars))
    margin = rng.uniform(50.0, 500.0, n)
    xy = rng.uniform(-1500.0, 1500.0, (2, 1, n)) + rng.uniform(-300.0, 300.0, (2, 3, n))
    xy[0] += away * plane.turn_m
    deep = _meet(_cores(wholes, margin), plane, _polygons(xy))
    likely = _may_be_deep(plane, wholes, margin, np.arange(n), xy)
    assert 20 < deep.sum() <= likely.sum() < 0.5 * n
    assert not (deep & ~likely).any()
    near = _near_border(wholes, margin, xy)
    assert not (deep & near).any()
    assert near[likely & ~deep].any() == (away == 0.0)
    # What is of no numbers may be anywhere.
    assert not _near_border(wholes[:1], margin[:1], np.full((2, 3, 1), np.nan)).any()
    assert _may_be_deep(plane, wholes[:1], np.zeros(1), np.zeros(1, np.int64), np.full((2, 3, 1), np.nan)).all()
