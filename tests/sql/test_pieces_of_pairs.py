"""Pairs of the database through stage 2: the candidates whose hulls share a point; pieces come back to the bit."""

from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from layouts import LOW_LATITUDE, SEAM, Workload
from mixed_scenes import plain_scene
from piecework import load, refresh, stored_pieces

from conflictdb import store
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.near import Question
from conflictdb.core.stage1_broad_phase import candidates, hulls_of
from conflictdb.core.stage2_intersection import intersections
from conflictdb.jobs.sources import Stored
from conflictdb.model.plans import Area, EarthModel, Scene

Conn = psycopg.Connection[Any]
PLAIN = Scene("plain", earth=EarthModel.SPHERE, tolerance_m=0.0)


def intersecting(conn: Conn, scene_id: int, *, regions: bool = True) -> tuple[Pieces, Pairs]:
    store.begin_snapshot(conn)
    ((pieces, a, b, *_),) = Stored(conn, scene_id).pairs(Question())
    return pieces, intersections(pieces, a, b, regions=regions)


def names(pieces: Pieces) -> list[tuple[int, ...]]:
    columns = (pieces.kind, pieces.object_id, pieces.part, pieces.turn)
    return [tuple(map(int, row)) for row in zip(*columns, strict=True)]


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM], ids=lambda w: w.name)
def test_pairs_are_those_whose_hulls_share_a_point(conn: Conn, workload: Any) -> None:
    scene_id = load(conn, *plain_scene(workload, 11, 20, 20))
    made = refresh(conn, scene_id)
    pieces, pairs = intersecting(conn, scene_id)
    hull = dict(zip(names(made), hulls_of(made), strict=True))
    both_names = ([names(made)[i] for i in pair] for pair in np.stack(candidates(made)).T)
    wanted = {frozenset((a, b)) for a, b in both_names if hull[a].intersects(hull[b])}
    ids = names(pieces)
    found = [frozenset((ids[a], ids[b])) for a, b in zip(pairs.a, pairs.b, strict=True)]
    assert set(found) == wanted
    assert len(found) == len(wanted)

    for i, (a, b) in enumerate(zip(pairs.a, pairs.b, strict=True)):
        region = pairs.region_xy[pairs.region_offset[i] : pairs.region_offset[i + 1]]
        if pieces.kind[a] == pieces.kind[b] == 0:
            assert len(region) == 0
        else:
            both = hull[ids[a]].intersection(hull[ids[b]])
            np.testing.assert_allclose(shapely.bounds(shapely.multipoints(region)), both.bounds, rtol=0, atol=1e-6)


def test_without_regions_none_is_computed(conn: Conn) -> None:
    scene_id = load(conn, *plain_scene(LOW_LATITUDE, 12, 10, 10))
    refresh(conn, scene_id)
    _, with_regions = intersecting(conn, scene_id)
    conn.rollback()
    _, pairs = intersecting(conn, scene_id, regions=False)
    assert pairs.a.tolist() == with_regions.a.tolist()
    assert pairs.region_xy.shape == (0, 2)
    assert pairs.region_offset.tolist() == [0] * (len(pairs) + 1)


@pytest.mark.parametrize("workload", [SEAM, replace(SEAM, changing_share=0.7)], ids=["steady", "growing"])
def test_pieces_come_back_as_they_were_stored(conn: Conn, workload: Workload) -> None:
    scene, areas, tracks = plain_scene(workload, 13, 15, 15)
    areas[0] = replace(areas[0], start_us=None, end_us=5, floor_m=-3.0)
    areas[1] = replace(areas[1], start_us=None, end_us=None, ceiling_m=1e9)
    tracks[0] = replace(tracks[0], outline_m=np.array([[0.0, 0.0]]), grow_mps=0.0, outlines_m=None)
    tracks[1] = replace(tracks[1], outline_m=np.array([[0.0, 0.0], [5.0, 9000.0]]), grow_mps=0.0, outlines_m=None)
    if workload.changing_share:  # a triangle that is a line at one end, and a line that is a point there
        later = len(tracks[2].times_us) - 1
        rings = np.array([[(0.0, 0.0), (9.0, 0.0), (9.0, 0.0)]] + [[(0.0, 0.0), (9e3, 0.0), (9e3, 5e3)]] * later)
        tracks[2] = replace(tracks[2], outline_m=rings[0], outlines_m=rings, grow_mps=0.0)
        lines = np.array([[(0.0, 5.0), (0.0, 5.0)]] + [[(0.0, 5.0), (9e3, 5.0)]] * (len(tracks[3].times_us) - 1))
        tracks[3] = replace(tracks[3], outline_m=lines[0], outlines_m=lines, grow_mps=0.0)
    scene_id = load(conn, scene, areas, tracks)
    made = refresh(conn, scene_id)
    assert (made.turn != 0).any()
    found, _ = intersecting(conn, scene_id)

    identity = ("kind", "object_id", "part", "turn")
    row = {key: i for i, key in enumerate(zip(*(getattr(made, name).tolist() for name in identity), strict=True))}
    order = np.array([row[key] for key in zip(*(getattr(found, name).tolist() for name in identity), strict=True)])
    wanted = made.take(order)
    for name in ("version", "start_us", "end_us", "end_inclusive", "floor_m", "ceiling_m"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)
    assert made.changes == found.changes == bool(workload.changing_share)
    for name in ("hull_xy", "hull_offset", "shape_xy", "shape_to_xy", "shape_offset"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)
    for name in ("leg_start_us", "leg_end_us", "leg_start_deg", "leg_end_deg", "bearing_deg"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name), err_msg=name)


def test_order_follows_the_content_not_the_order_of_loading(conn: Conn) -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 14, 15, 15)
    answers = []
    for name, sequence in (("forth", slice(None)), ("back", slice(None, None, -1))):
        scene_id = load(conn, replace(scene, name=name), areas[sequence], tracks[sequence])
        refresh(conn, scene_id)
        pieces, pairs = intersecting(conn, scene_id)
        conn.rollback()
        assert (np.diff(pairs.a) >= 0).all()
        assert (pairs.a < pairs.b).all()
        answers.append((pieces.kind, pieces.part, pieces.turn, pieces.shape_xy, pairs.a, pairs.b, pairs.region_xy))
    for one, other in zip(*answers, strict=True):
        np.testing.assert_array_equal(one, other)


def test_touching_counts_and_the_smallest_gap_does_not(conn: Conn) -> None:
    def square(west: float, south: float) -> shapely.MultiPolygon:
        return shapely.MultiPolygon([shapely.box(west, south, west + 1, south + 1)])

    areas = [
        Area("middle", square(10, 0)),
        Area("edge", square(11, 0)),
        Area("corner", square(11, 1)),
        Area("gap", square(9 - 1e-6, 0)),  # 11 cm
    ]
    scene_id = load(conn, PLAIN, areas, [])
    refresh(conn, scene_id)
    pieces, pairs = intersecting(conn, scene_id)
    key = {p.piece_id: p.key for p in stored_pieces(conn, scene_id)}
    names = [key[int(i)] for i in pieces.piece_id]
    found = {(names[a], names[b]) for a, b in zip(pairs.a, pairs.b, strict=True)}
    assert found == {("edge", "middle"), ("corner", "middle"), ("corner", "edge")}


def test_nothing_meets_nothing(conn: Conn) -> None:
    scene_id = load(conn, PLAIN, [], [])
    refresh(conn, scene_id)
    store.begin_snapshot(conn)
    assert not list(Stored(conn, scene_id).pairs(Question()))
