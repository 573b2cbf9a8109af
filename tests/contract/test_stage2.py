"""Both ways of stage 2 keep the same pairs: in the database, where few pieces are involved, and at the client."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import psycopg
import pytest
import scenes
import shapely
from commands import STRAIT
from layouts import WORKLOADS
from mixed_scenes import plain_scene
from piecework import load, refresh
from sources import few_changes

from conflictdb import store
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.memory_budget import DEFAULT_MEMORY
from conflictdb.core.near import Chunk, Question
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.stage2_intersection import intersections
from conflictdb.earth.registry import Setup
from conflictdb.formats.scene_file import read_scene
from conflictdb.jobs.detect import detect
from conflictdb.jobs.sources import MOST_COMPARED, StoredWithPlan
from conflictdb.model.plans import Area, Scene, Track

Conn = psycopg.Connection[Any]
Objects = tuple[Scene, Sequence[Area], Sequence[Track]]
Named = set[frozenset[tuple[int, ...]]]

ALWAYS: Final = 10**9  # stage 2 runs in the database up to this number of pairs of pieces
NEVER: Final = -1


def _known() -> list[Objects]:
    return [(one.scene, one.areas, one.tracks) for one in scenes.known_scenes()]


def _random() -> list[Objects]:
    found = []
    for k, workload in enumerate(WORKLOADS):
        scene, areas, tracks = plain_scene(workload, 31 + k, 6, 6)
        settings = {"separation_m": 500.0 * (k % 2), "time_separation_s": 1800.0 * (k % 3)}
        found.append((replace(scene, name=f"random {k}", tolerance_m=0.0, **settings), areas, tracks))
    return found


def _shipped() -> list[Objects]:
    contents = read_scene(STRAIT.read_text(), "strait")
    return [(contents.scene, contents.areas, contents.tracks)]


def named(pieces: Pieces, a: np.ndarray, b: np.ndarray) -> Named:
    """Pairs by kind, object, part and turn, which do not change when pieces are stored again."""
    columns = np.stack([pieces.kind, pieces.object_id, pieces.part, pieces.turn]).T.tolist()
    found = {frozenset((tuple(columns[i]), tuple(columns[j]))) for i, j in zip(a, b, strict=True)}
    assert len(found) == len(a)
    return found


def after_stage2(chunks: list[Chunk]) -> Named:
    """Pairs that the stages after it receive."""
    left: Named = set()
    for chunk in chunks:
        pairs = intersections(*chunk[:3], regions=False)
        left |= named(chunk.pieces, pairs.a, pairs.b)
    return left


@pytest.mark.parametrize("thrown", [_known, _random, _shipped])
def test_the_database_and_the_client_keep_the_same_pairs(conn: Conn, thrown: Callable[[], list[Objects]]) -> None:
    """And count the same pairs before."""
    left = 0
    for scene, areas, tracks in thrown():
        load(conn, scene, list(areas), list(tracks))
        conn.commit()
        at_client = list(few_changes(conn, scene.name, NEVER).chunks())
        conn.rollback()
        (stored,) = few_changes(conn, scene.name, ALWAYS).chunks()
        conn.rollback()
        expected = after_stage2(at_client)
        assert all(one.candidate_pairs is None for one in at_client)
        assert stored.candidate_pairs == sum(len(one.a) for one in at_client), scene.name
        assert named(stored.pieces, stored.a, stored.b) == expected, scene.name
        assert after_stage2([stored]) == expected, scene.name
        left += len(expected)
    assert left > 10


def test_the_database_runs_it_up_to_so_many_pairs_of_pieces(conn: Conn) -> None:
    """Else the client does."""
    across = scenes.track("A", [(0, 0), (2, 1), (4, 0)], [0, 7200, 14400], 500, 500, 200, 200)
    along = scenes.track("B", [(0, 1), (2, 0), (4, 1)], [0, 7200, 14400], 500, 500, 200, 200)
    load(conn, Scene("s"), [], [across, along])
    conn.commit()
    for most, is_here in ((MOST_COMPARED, True), (1, False)):
        (chunk,) = few_changes(conn, "s", most).chunks()
        conn.rollback()
        assert (chunk.candidate_pairs is not None) == is_here


def test_a_plan_that_is_not_stored_meets_the_same_pairs_both_ways(conn: Conn) -> None:
    """For each object of a random scene as a plan, in place of the stored one."""
    left = 0
    for scene, areas, tracks in _random():
        scene_id = load(conn, scene, list(areas), list(tracks))
        conn.commit()
        refresh(conn, scene_id)
        store.begin_snapshot(conn)
        settings = store.read_settings(conn, scene_id)
        for plan in [*areas, *tracks]:
            is_area = isinstance(plan, Area)
            given = AreaBatch.of([plan] if is_area else []), TrackBatch.of([] if is_area else [plan])
            pieces = pieces_of(Setup.of(settings), *given)
            stored, at_client = (
                list(source.pairs(Question.of(settings)))
                for source in (
                    StoredWithPlan(conn, scene_id, plan, plan.key, pieces, DEFAULT_MEMORY, most)
                    for most in (ALWAYS, NEVER)
                )
            )
            assert after_stage2(stored) == after_stage2(at_client), (scene.name, plan.key)
            assert sum(len(one.a) for one in stored) == len(after_stage2(stored))
            left += len(after_stage2(stored))
        conn.rollback()
    assert left > 10


def test_gaps_within_rounding_are_no_gaps_in_the_database(conn: Conn) -> None:
    """Nothing is lost that the client would keep: its rounding error is far below a micrometre."""
    ask = """SELECT conflictdb_internal._hulls_meet(ST_MakeEnvelope(0, 0, 1, 1), ST_MakeEnvelope(1 + %(gap)s, 0, 2, 1)),
                    conflictdb_internal._boxes_meet(
                        ST_MakeEnvelope(0, 0, 1, 1), ST_MakeEnvelope(1 + %(gap)s, 0, 2, 1))"""
    for gap, answer in ((0.0, (True, True)), (1e-9, (True, False)), (5e-7, (True, False)), (1e-5, (False, False))):
        assert conn.execute(ask, {"gap": gap}).fetchone() == answer


def test_candidates_lists_a_pair_whose_hulls_share_no_point_but_nearly(conn: Conn) -> None:
    """Without a region: the box of an index is rounded outward, so that both reach stage 2."""
    areas = [Area(key, shapely.MultiPolygon([shapely.box(west, 0, west + 1, 1)])) for key, west in (("A", 0), ("B", 1))]
    scene_id = load(conn, Scene("s", tolerance_m=0.0), areas, [])
    conn.commit()
    refresh(conn, scene_id)
    for shift, found in ((5e-7, 1), (10.0, 0)):
        conn.execute(
            """UPDATE conflictdb.piece p SET hull = ST_Translate(
                   p.hull, (SELECT ST_XMax(o.hull) FROM conflictdb.piece o WHERE o.piece_id <> p.piece_id)
                           - ST_XMin(p.hull) + %s, 0)
               WHERE p.object_id = (SELECT area_id FROM conflictdb.area WHERE key = 'B')""",
            [shift],
        )
        rows = conn.execute("SELECT region FROM conflictdb.candidates('s')").fetchall()
        assert rows == [(None,)] * found


def test_a_run_counts_what_explain_counts(conn: Conn) -> None:
    """For two objects, after a change of either."""
    across = scenes.track("A", [(0, 0), (2, 1), (4, 0)], [0, 7200, 14400], 500, 500, 200, 200)
    along = scenes.track("B", [(0, 1), (2, 0), (4, 1)], [0, 7200, 14400], 500, 500, 200, 200)
    load(conn, Scene("s"), [], [across, along])
    conn.commit()
    for _ in range(2):
        run = detect(conn, "s", jobs=1)
        ((facts,),) = conn.execute("SELECT conflictdb.explain_conflict('s', 'A', 'B')").fetchall()
        stages = facts["stages"]
        assert (run.candidate_pairs, run.intersecting_pairs) == (stages[0]["left"], stages[1]["left"])
        assert run.candidate_pairs > run.intersecting_pairs > 0
        conn.execute("UPDATE conflictdb.track SET grow_mps = grow_mps + 0.01 WHERE key = 'A'")
        conn.commit()
