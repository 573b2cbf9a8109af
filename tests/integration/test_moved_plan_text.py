"""What the page copies of a moved plan: SQL that moves the stored track, and a feature of a scene file."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
from page_in_node import run_page
from piecework import load

from conflictdb import store
from conflictdb.formats.scene_file import feature_of, read_scene
from conflictdb.map.editing import PlanMove, moved
from conflictdb.model.inputs import certain
from conflictdb.model.plans import Scene, Track

HOUR_US = 3_600_000_000
T0_US = 1_780_272_000_000_000
DRIVER = """
import { readFileSync } from "node:fs";
import { moved, statement } from "./moved_plan.mjs";
const [scene, feature, ...move] = JSON.parse(readFileSync(0));
console.log(JSON.stringify([statement(scene, feature, ...move), moved(feature, ...move)]));
"""


@pytest.mark.skipif(not shutil.which("node"), reason="did not run: no node here")
def test_departures_and_heights_of_legs_move_in_both_texts(conn: psycopg.Connection[Any], tmp_path: Path) -> None:
    times = np.array([T0_US, T0_US + HOUR_US, T0_US + 2 * HOUR_US])
    departs = [certain(T0_US), certain(T0_US + 5 * HOUR_US)]
    heights: dict[str, Any] = {"floors_m": [10.0, -np.inf, 20.5], "ceilings_m": [100.0, 200.0, 150.0]}
    way = [(9.0, 57.0), (10.0, 58.0), (10.5, 58.0)]
    track = Track("T", way, times, [(0.0, 0.0)], departures_us=departs, **heights)
    load(conn, Scene("s"), [], [track])
    asked = ["s", feature_of(track), 90_000_001, 12.5, [1, 9.5, 57.5]]
    sql, feature = run_page(tmp_path, DRIVER, asked)
    expected = moved(track, PlanMove("T", "", 90_000_001, 12.5, (1, 9.5, 57.5), None))
    conn.execute(sql.encode())
    conn.commit()
    _, _, [stored] = store.read_scene(conn, "s", ["T"])
    read = read_scene(json.dumps({"type": "FeatureCollection", "features": [feature]}), "other").tracks[0]
    for one in (stored, read):
        assert np.abs(one.times_us - expected.times_us).max() <= 1  # the database has seconds, as doubles
        assert one.positions_deg.tolist() == expected.positions_deg.tolist()
        assert one.departures_us == expected.departures_us
        for name in ("floors_m", "ceilings_m"):
            np.testing.assert_array_equal(getattr(one, name), getattr(expected, name))
