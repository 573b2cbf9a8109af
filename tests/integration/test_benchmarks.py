"""Benchmarks of whole detections run, at sizes that take seconds, and report the detections' results."""

from pathlib import Path

import growth
import peers
import psycopg
import pytest
import soak
import study
import unit_costs
from made_scenes import Kind, sea
from measured import STAGES, fresh_database, load

import conflictdb
from conflictdb import Method, Scene


@pytest.fixture
def demo(dsn: str) -> str:
    """Return how to connect to a database as `fresh_database` makes it, which takes a second."""
    with conflictdb.connect(dsn) as db:
        db.load_demo()
    return dsn


def test_study_has_a_row_for_each_kind_and_method(demo: str) -> None:
    """Stages add up to the whole, and a scene without tracks has no pairs for stage 4."""
    methods = [Method.EXACT, Method.NLP]
    rows = study.study(demo, [40], 2, methods)
    assert [(row["method"], row["kind"]) for row in rows] == [(m.value, k.value) for m in methods for k in Kind]
    for row in rows:
        assert sum(row[stage] for stage in STAGES) == pytest.approx(row["cpu_s"])
        assert row["cpu_s_least"] <= row["cpu_s"] <= row["cpu_s_most"]
        assert row["conflicts_least"] <= row["conflicts"] <= row["conflicts_most"]
        assert row["candidate_pairs"] >= row["intersecting_pairs"] >= row["conflicts"]
    by_kind = {row["kind"]: row for row in rows if row["method"] == "exact"}
    assert by_kind["static"]["conflicts"] > 0
    assert by_kind["static"]["met_us"] is None
    assert by_kind["mixed"]["met_us"] > 0.0
    text = study.table(rows)
    assert text.count("\n| `exact` |") == 3
    assert text.startswith("40 objects, medians of 2 scenes:")


@pytest.mark.parametrize("series", ["sea", "box"])
def test_growth_measures_a_scene_in_a_process_of_its_own(server_dsn: str, series: str) -> None:
    """A detection of the same again counts the same pairs; the database is gone when all is measured."""
    with fresh_database(server_dsn) as dsn:
        row = growth.measure(dsn, series, 40, 1)
        with conflictdb.connect(dsn) as db:
            name = db.connection.info.dbname
            assert [one.conflicts for one in db.scenes() if one.scene.name == f"{series} 40 0"] == [row["conflicts"]]
    assert row["pieces"] >= row["objects"] == 40
    assert 20.0 < row["client_mb"] < 1000.0
    assert row["dominates"] in {stage.removesuffix("_s") for stage in STAGES}
    assert f"| 40 | {row['pieces']:,} |" in growth.table([row])
    with psycopg.connect(server_dsn) as conn:
        assert conn.execute("SELECT 1 FROM pg_database WHERE datname = %s", [name]).fetchone() is None


def test_peers_are_held_to_the_same_truth(demo: str) -> None:
    """Joins of swept hulls miss nothing and return no times; the paper's pipeline returns periods with errors."""
    rows = peers.compare(demo, Kind.MIXED, 200, 1, Path(), ["paper", "postgis"])
    by_peer = {row["peer"]: row for row in rows}
    assert len(rows) == len(by_peer) == 6
    for name in ("conflictdb", "conflictdb in memory", "its stages 1 and 2", "PostGIS, ST_Intersects"):
        assert by_peer[name]["missed"] == 0
    assert by_peer["conflictdb"]["false"] == by_peer["conflictdb in memory"]["false"] == 0
    assert by_peer["PostGIS, ST_Intersects"]["reported"] == by_peer["its stages 1 and 2"]["reported"]
    assert by_peer["PostGIS, ST_CPAWithin"]["meet"] < by_peer["conflictdb"]["meet"]  # tracks alone
    assert by_peer["the paper in Python"]["reported"] > 0.8 * by_peer["conflictdb"]["reported"]
    assert 0.0 < by_peer["the paper in Python"]["end_median_s"] < 3600.0
    assert "| mixed 200 | conflictdb |" in peers.table(rows)


def test_unit_costs_have_a_limit_each(demo: str) -> None:
    """No cost is below its limit, except costs too small to measure."""
    rows = unit_costs.measure(demo, "box", 200, 1)
    assert len({(row["unit"], row["limit"]) for row in rows}) == len(rows) == 10
    assert all(row["count"] > 0 and row["us"] > 0.0 and row["limit_us"] > 0.0 for row in rows)
    listed = next(row for row in rows if row["unit"] == "row listed")
    assert listed["us"] > listed["limit_us"]
    assert unit_costs.table(rows).count("| box 200 |") == len(rows)


def test_a_scene_that_is_edited_all_the_time_is_kept_current(demo: str) -> None:
    """Two editors and two workers at once: all becomes current, nobody fails, a detection in full finds the same."""
    with conflictdb.connect(demo) as db:
        load(db, Scene(soak.SCENE), sea(60, 1))
        found = db.scene(soak.SCENE).detect()
        soaked = soak.soak(demo, rate=20.0, editors=2, workers=2, seconds=1.5, warm_up_s=0.5)
        assert soaked.errors == []
        assert len(soaked.waited_s) > 10
        assert soaked.runs > 0
        assert [one.pending for one in db.scenes() if one.scene.name == soak.SCENE] == [0]
        assert soak.drift(db) == 0
        assert found.conflicts > 0
        with psycopg.connect(demo, autocommit=True) as conn:
            conn.execute("DELETE FROM conflictdb.conflict c WHERE c.verdict <> 'near'")
        assert soak.drift(db) > 0
