"""Rough pieces meet where the objects conflict, whatever features these have."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import psycopg
import pytest
from layouts import HIGH_LATITUDE, SEAM
from mixed_scenes import plain_scene
from piecework import load, mark_all

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "paths"))
from mixed_scenes import Feature, mixed_scene

from conflictdb import Motion, Scene
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Track

Conn = psycopg.Connection[Any]

# Conflicts of a scene, and those that rough pieces miss: with each other, with stored pieces, and as boxes.
MISSED = """
WITH scene AS (
    SELECT s.scene_id, greatest(%(reach_m)s, conflictdb_internal._wanted_m(s.scene_id)) AS reach_m,
           conflictdb_internal._longest_time_s(s.scene_id) AS within_s,
           conflictdb_internal._allowed_types(s.scene_id) AS allowed
    FROM conflictdb.scene s WHERE s.name = %(name)s
), cut AS MATERIALIZED (
    SELECT u AS piece FROM scene s JOIN conflictdb.piece p USING (scene_id)
    CROSS JOIN LATERAL conflictdb_internal._pieces_of(p) u
), uncut AS MATERIALIZED (
    SELECT u AS piece FROM scene s
    CROSS JOIN LATERAL conflictdb_internal._uncut_pieces(s.scene_id, s.reach_m, true, '(,)') u
), rough AS MATERIALIZED (
    SELECT r.rough AS piece, r.shape, r.padding_m FROM scene s
    CROSS JOIN LATERAL conflictdb_internal._rough_pieces(
        s.scene_id, s.reach_m, ARRAY(SELECT a.area_id FROM conflictdb.area a WHERE a.scene_id = s.scene_id),
        ARRAY(SELECT t.track_id FROM conflictdb.track t WHERE t.scene_id = s.scene_id)) r
), met AS (
    SELECT 'rough' AS way, r.piece AS a, o.piece AS b FROM scene s CROSS JOIN rough r JOIN rough o
        ON conflictdb_internal._pieces_may_meet(r.piece, o.piece, s.within_s, s.allowed)
           AND conflictdb_internal._hulls_meet(r.shape, o.shape, r.padding_m + o.padding_m)
    UNION ALL
    SELECT 'stored', r.piece, o.piece FROM scene s CROSS JOIN rough r JOIN cut o
        ON conflictdb_internal._pieces_may_meet(r.piece, o.piece, s.within_s, s.allowed)
           AND conflictdb_internal._hulls_meet((o.piece).hull, r.shape, r.padding_m)
    UNION ALL
    SELECT 'boxes', r.piece, o.piece FROM scene s CROSS JOIN cut r JOIN uncut o
        ON conflictdb_internal._pieces_may_meet(r.piece, o.piece, s.within_s, s.allowed)
    UNION ALL
    SELECT 'rough boxes', r.piece, o.piece FROM scene s CROSS JOIN rough r JOIN uncut o
        ON conflictdb_internal._pieces_may_meet(r.piece, o.piece, s.within_s, s.allowed)
), found AS (
    SELECT DISTINCT m.way, (m.a).object_kind AS a_kind, (m.a).object_id AS a_id, (m.b).object_kind AS b_kind,
           (m.b).object_id AS b_id FROM met m
)
SELECT c.a_key, c.b_key, c.verdict,
       ARRAY(SELECT w FROM unnest(ARRAY['rough', 'stored', 'boxes', 'rough boxes']) w
             WHERE (w, c.a_kind, c.a_id, c.b_kind, c.b_id) NOT IN (SELECT f.* FROM found f)
                OR (w, c.b_kind, c.b_id, c.a_kind, c.a_id) NOT IN (SELECT f.* FROM found f))
FROM scene s JOIN conflictdb.conflict c USING (scene_id)
"""


def conflicts_met(conn: Conn, scene: Scene, areas: list[Area], tracks: list[Track]) -> int:
    """The number of conflicts of a scene, all of which rough pieces find."""
    scene_id = load(conn, scene, areas, tracks)
    detect(conn, scene.name)
    mark_all(conn, scene_id)
    rows = conn.execute(MISSED, {"name": scene.name, "reach_m": scene.reach_m}).fetchall()
    conn.rollback()
    assert [row for row in rows if row[3]] == []
    return len(rows)


@pytest.mark.filterwarnings("ignore::conflictdb.IncompleteWarning")
@pytest.mark.parametrize("more", [set(), {Feature.GREAT_CIRCLE}, {Feature.ANTIMERIDIAN}, {Feature.HIGH_LATITUDE}])
def test_rough_pieces_find_all_conflicts(conn: Conn, more: set[Feature]) -> None:
    """Of random scenes with these features, others without tolerances, or any."""
    some = {Feature.GROWTH, Feature.OUTLINES, Feature.LEG_HEIGHTS, Feature.DEPARTURES, Feature.ACTIVATIONS}
    every = 0
    for seed in range(4):
        mixed = mixed_scene(seed, {*some, *more} if seed % 2 else more or None)
        every += conflicts_met(conn, replace(mixed.scene, name=f"s{seed}"), mixed.areas, mixed.tracks)
    assert every > 10


@pytest.mark.parametrize("workload", [HIGH_LATITUDE, SEAM], ids=lambda one: one.name)
@pytest.mark.parametrize("settings", [{}, {"separation_m": 300_000.0}, {"motion": Motion.GREAT_CIRCLE}], ids=str)
def test_rough_pieces_find_conflicts_of_wide_separations(conn: Conn, workload: Any, settings: dict[str, Any]) -> None:
    scene, areas, tracks = plain_scene(workload, 5, 12, 12)
    if "motion" in settings:
        lon, lat = areas[0].footprint.centroid.coords[0]
        settings = {**settings, "earth": "sphere", "centre": (180.0 if workload is SEAM else lon, lat)}
    assert conflicts_met(conn, replace(scene, name="s", **settings), areas, tracks) > 10
