"""The page of the map computes havens itself: by a copy of the formulas, which is held against the kernel here."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from havens_of_kernel import haven_deg
from patience import WAIT_S
from workloads import GROWING, GROWING_CIRCLES, HIGH_LATITUDE, LONG_LEGS, OCEAN, SEAM, Workload, throw

import conflictdb
from conflictdb.model.plans import EarthModel, Track

PAGE: Final = Path(conflictdb.__file__).parent / "map" / "page"
# Reads [scene, track, instants] of each track, and prints the rings.
DRIVER: Final = """
import { readFileSync } from "node:fs";
import { Motion } from "./motion.mjs";
const rings = JSON.parse(readFileSync(0)).map(([scene, points, outline, grow, outlines, at]) => {
  const motion = new Motion(points, outline, grow, outlines, scene);
  return at.map((t) => motion.haven(t));
});
console.log(JSON.stringify(rings));
"""
MOST_M: Final = 1e-3
METRES_PER_DEGREE: Final = 111_200.0


def on_page(tmp_path: Path, asked: list[object]) -> list[list[list[list[float]]]]:
    for name in ("motion", "world"):
        text = (PAGE / f"{name}.js").read_text().replace('"./world.js"', '"./world.mjs"')
        (tmp_path / f"{name}.mjs").write_text(text)
    (tmp_path / "driver.mjs").write_text(DRIVER)
    command = [str(shutil.which("node")), tmp_path / "driver.mjs"]
    done = subprocess.run(command, input=json.dumps(asked), capture_output=True, text=True, timeout=WAIT_S, check=True)
    return list(json.loads(done.stdout))


def closed(ring: np.ndarray) -> list[list[float]]:
    return [*ring.tolist(), ring[0].tolist()]


def as_asked(track: Track, motion: str, earth: str, at_us: list[int]) -> list[object]:
    points = [
        {"lon": lon, "lat": lat, "t": us / 1e6}
        for (lon, lat), us in zip(track.positions_deg.tolist(), track.times_us.tolist(), strict=True)
    ]
    outlines = None if track.outlines_m is None else [closed(one) for one in track.outlines_m]
    scene = {"motion": motion, "earth": earth}
    return [scene, points, closed(track.outline_m), track.grow_mps, outlines, [us / 1e6 for us in at_us]]


@pytest.mark.skipif(not shutil.which("node"), reason="did not run: no node here")
@pytest.mark.parametrize("earth", list(EarthModel))
@pytest.mark.parametrize(
    "workload", [HIGH_LATITUDE, LONG_LEGS, SEAM, GROWING, OCEAN, GROWING_CIRCLES], ids=lambda w: w.name
)
def test_havens_of_the_page_are_those_of_the_kernel(tmp_path: Path, workload: Workload, earth: EarthModel) -> None:
    """Within a millimetre: instants are numbers of seconds there, which are rounded to a quarter of a microsecond."""
    scene, _, tracks = throw(workload, 21, 0, 12, earth)
    instants = [np.linspace(one.times_us[0], one.times_us[-1], 9, dtype=np.int64)[1:-1].tolist() for one in tracks]
    asked = [as_asked(one, scene.motion, scene.earth, at) for one, at in zip(tracks, instants, strict=True)]
    for track, at_us, rings in zip(tracks, instants, on_page(tmp_path, asked), strict=True):
        for us, ring in zip(at_us, rings, strict=True):
            there, here = haven_deg(scene, track, us), np.array(ring)
            apart = here[:, None] - there
            east = (apart[..., 0] + 180.0) % 360.0 - 180.0
            apart_m = METRES_PER_DEGREE * np.hypot(east * np.cos(np.radians(there[:, 1])), apart[..., 1])
            assert max(apart_m.min(axis=0).max(), apart_m.min(axis=1).max()) < MOST_M, (track.key, us)
