"""The page of the map computes havens by the kernel as WebAssembly, which is held against the library here."""

import base64
import shutil
from pathlib import Path
from typing import Final

import numpy as np
import pytest
from havens_of_kernel import haven_deg
from layouts import GROWING, GROWING_CIRCLES, HIGH_LATITUDE, LONG_LEGS, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene
from page_in_node import run_page

from conflictdb.arrays.objects import TrackBatch
from conflictdb.core.pieces.cutting import track_pieces
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import EarthModel, Scene, Track

# Reads [scene, track, instants] of each track, and prints rings, reference points, and headings of legs.
DRIVER: Final = """
import { readFileSync } from "node:fs";
import { Kernel } from "./kernel.mjs";
import { Ground, Motion } from "./motion.mjs";
const kernel = await Kernel.of(readFileSync("kernel.wasm"));
const found = JSON.parse(readFileSync(0)).map(([plane, points, outline, grow, outlines, at]) => {
  const ground = new Ground(kernel, new Uint8Array(Buffer.from(plane, "base64")));
  const motion = new Motion(points, outline, grow, outlines, { ground });
  return [ground.havens(at.map((t) => [motion, t])), at.map((t) => motion.place(t)), [...ground.headings(points)]];
});
console.log(JSON.stringify(found));
"""
MOST_M: Final = 1e-3
METRES_PER_DEGREE: Final = 111_200.0


def closed(ring: np.ndarray) -> list[list[float]]:
    return [*ring.tolist(), ring[0].tolist()]


def as_asked(track: Track, scene: Scene, at_us: list[int]) -> list[object]:
    points = [
        {"lon": lon, "lat": lat, "t": us / 1e6}
        for (lon, lat), us in zip(track.positions_deg.tolist(), track.times_us.tolist(), strict=True)
    ]
    outlines = None if track.outlines_m is None else [closed(one) for one in track.outlines_m]
    plane = base64.b64encode(bytes(Setup.of(scene).plane.kernel_plane)).decode()
    return [plane, points, closed(track.outline_m), track.grow_mps, outlines, [us / 1e6 for us in at_us]]


def _headings(scene: Scene, tracks: list[Track]) -> tuple[list[str], list[np.ndarray]]:
    """The keys of tracks, and the headings of their legs by their pieces."""
    found = []
    for track in tracks:
        pieces = track_pieces(Setup.of(scene), TrackBatch.of([track]))
        _, first = np.unique(pieces.leg_start_us, return_index=True)
        found.append(pieces.bearing_deg[first])
    return [track.key for track in tracks], found


@pytest.mark.skipif(not shutil.which("node"), reason="did not run: no node here")
@pytest.mark.parametrize("earth", list(EarthModel))
@pytest.mark.parametrize(
    "workload", [HIGH_LATITUDE, LONG_LEGS, SEAM, GROWING, OCEAN, GROWING_CIRCLES], ids=lambda w: w.name
)
def test_havens_of_the_page_are_those_of_the_kernel(tmp_path: Path, workload: Workload, earth: EarthModel) -> None:
    """Within a millimetre: instants are numbers of seconds there, which are rounded to a quarter of a microsecond."""
    scene, _, tracks = plain_scene(workload, 21, 0, 12, earth)
    instants = [np.linspace(one.times_us[0], one.times_us[-1], 9, dtype=np.int64)[1:-1].tolist() for one in tracks]
    asked = [as_asked(one, scene, at) for one, at in zip(tracks, instants, strict=True)]
    answers = run_page(tmp_path, DRIVER, asked)
    headings = dict(zip(*_headings(scene, tracks), strict=True))
    for track, at_us, (rings, places, bearings) in zip(tracks, instants, answers, strict=True):
        apart_deg = np.array(bearings) - headings[track.key]
        assert np.abs(apart_deg - 360.0 * np.rint(apart_deg / 360.0)).max() < 1e-9
        assert all(len(place) == 2 for place in places)
        for us, ring in zip(at_us, rings, strict=True):
            there, here = haven_deg(scene, track, us), np.array(ring)
            apart = here[:, None] - there
            east = (apart[..., 0] + 180.0) % 360.0 - 180.0
            apart_m = METRES_PER_DEGREE * np.hypot(east * np.cos(np.radians(there[:, 1])), apart[..., 1])
            assert max(apart_m.min(axis=0).max(), apart_m.min(axis=1).max()) < MOST_M, (track.key, us)
