"""Detection in the database, where it differs from the stages in memory: the store's own answers."""

import numpy as np
import psycopg
import pytest
import shapely
from scenes import T0_US

from conflictdb import Area, Scene, Track, Verdict, rectangle_outline_m, solve, store
from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces import covers
from conflictdb.core.pieces.cutting import track_pieces
from conflictdb.earth.registry import Setup
from conflictdb.jobs.detect import detect


def spiked_area() -> Area:
    """Return a round area with 2,000 spikes: all of its convex parts are thinner than a metre."""
    angle = np.linspace(0.0, 2.0 * np.pi, 4001)[:-1]
    radius = np.where(np.arange(4000) % 2, 0.00100, 0.00101)
    ring = np.stack([4.0 + radius * np.cos(angle), 57.0 + radius * np.sin(angle)], axis=1)
    return Area("A", shapely.MultiPolygon([shapely.Polygon(ring)]))


def test_shallow_in_thin_parts_is_deep_in_the_whole(conn: psycopg.Connection) -> None:
    """A point that crosses an area cut into thin parts is in conflict, not grazing; in memory and in the database."""
    path = np.array([[3.99, 57.0], [4.01, 57.0001]])
    track = Track("T", path, np.array([T0_US, T0_US + 600_000_000]), rectangle_outline_m(0.0, 0.0, 0.0, 0.0))
    scene = Scene("thin")
    (one,) = solve([track], [spiked_area()], scene)
    store.replace_scene(conn, scene, [spiked_area()], [track], merge=False)
    conn.commit()
    detect(conn, "thin", jobs=1)
    (found,) = store.conflicts(conn, "thin")
    assert one.verdict == found.verdict == Verdict.CONFLICT
    assert one.periods == found.periods


def test_touching_areas_graze(conn: psycopg.Connection) -> None:
    """Areas that share an edge are grazing; whether they are cut into parts or not."""
    ell = shapely.Polygon([(5, 57), (6, 57), (6, 57.5), (5.5, 57.5), (5.5, 58), (5, 58)])
    areas = [
        Area("L", shapely.MultiPolygon([ell])),
        Area("R", shapely.MultiPolygon([shapely.box(6, 57, 7, 58)])),
        Area("U", shapely.MultiPolygon([shapely.box(5.5, 57.5, 6, 58)])),
    ]
    store.replace_scene(conn, Scene("edges"), areas, [], merge=False)
    conn.commit()
    detect(conn, "edges", jobs=1)
    assert [(c.a_key, c.b_key, c.verdict) for c in store.conflicts(conn, "edges")] == [
        ("L", "R", Verdict.GRAZING),
        ("L", "U", Verdict.GRAZING),
        ("R", "U", Verdict.GRAZING),
    ]


def test_an_object_that_could_not_be_cut_is_mended_by_its_change(
    conn: psycopg.Connection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its cover goes with it: the next detection gives the answer of a scene without that past."""
    areas = [
        Area("A", shapely.MultiPolygon([shapely.box(4.0, 57.0, 5.0, 58.0)])),
        Area("far", shapely.MultiPolygon([shapely.box(40.0, 7.0, 41.0, 8.0)])),
    ]
    times = np.array([T0_US, T0_US + 600_000_000])
    first, second = (
        Track("T", np.array([[3.9, lat], [4.1, lat]]), times, rectangle_outline_m(1.0, 1.0, 1.0, 1.0))
        for lat in (57.5, 57.6)
    )
    scene = Scene("covered")

    def fails(setup: Setup, tracks: TrackBatch) -> Pieces:
        if len(tracks):
            raise FloatingPointError("planted")
        return track_pieces(setup, tracks)

    with monkeypatch.context() as planted:
        planted.setattr(covers, "track_pieces", fails)
        store.replace_scene(conn, scene, areas, [first], merge=False)
        conn.commit()
        detect(conn, "covered", jobs=1)
    covered = [(c.a_key, c.b_key, c.verdict) for c in store.conflicts(conn, "covered")]
    assert covered == [("A", "T", Verdict.UNRESOLVED), ("far", "T", Verdict.UNRESOLVED)]
    store.replace_scene(conn, scene, [], [second], merge=True)
    conn.commit()
    run = detect(conn, "covered", jobs=1)
    assert (run.changed, run.closed, run.unresolved) == (1, 1, 0)
    (one,), (found,) = solve([second], areas, scene), store.conflicts(conn, "covered")
    assert one.verdict == found.verdict == Verdict.CONFLICT
    assert one.periods == found.periods
