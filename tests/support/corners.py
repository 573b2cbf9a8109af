"""Random scenes about one corner of a route: long thin havens that turn there, and traffic aimed at where they lie.

Waiting at a corner, such a haven lies across one way and clear of another, so that its heading decides what it meets.
"""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import shapely
from scenes import T0_US

from conflictdb import Area, EarthModel, Motion, Rule, Scene, Track, rectangle_outline_m
from conflictdb.earth.geodesy import earth_of, rhumb_direct
from conflictdb.model.plans import Intervals

KEY: Final = "waits"
_HOUR_US: Final = 3_600_000_000


def corner(seed: int) -> tuple[Scene, list[Area], list[Track], int]:
    """Return a scene with a track `KEY` that turns by 60 to 120 degrees, and the number of a waypoint there."""
    rng = np.random.default_rng([42, seed])
    is_circle = bool(rng.random() < 0.3)
    place = np.array([rng.choice([rng.uniform(-170, 170), 180.0, -179.999]), rng.uniform(-60, 70)])
    settings: dict[str, Any] = {
        "motion": Motion.GREAT_CIRCLE if is_circle else Motion.RHUMB,
        "earth": EarthModel.SPHERE if is_circle or rng.random() < 0.5 else EarthModel.WGS84,
        "centre": (float((place[0] + 180.0) % 360.0 - 180.0), float(place[1])) if is_circle else None,
        "tolerance_m": float(rng.choice([0.0, 1.0])),
        "separation_m": float(rng.choice([0.0, 0.0, 0.0, 100.0])),
        "time_separation_s": float(rng.choice([0.0, 0.0, 0.0, 60.0])),
        "vertical_separation_m": float(rng.choice([0.0, 0.0, 30.0])),
        "intervals": Intervals.CLOSED if rng.random() < 0.3 else Intervals.HALF_OPEN,
    }
    if rng.random() < 0.3:
        settings["rules"] = [
            Rule("ship", "ship", separation_m=float(rng.choice([0.0, 50.0])), time_s=float(rng.choice([0.0, 20.0]))),
            Rule("ship", "boat", allowed=True),
        ]
    scene = Scene(f"corner {seed}", **settings)
    heading = float(rng.uniform(0, 360))
    length_m = float(rng.uniform(300, 3000))
    track, waypoint = _turning(rng, scene, place, heading, length_m)
    leaves = _next_heading(track, waypoint, heading)
    others = []
    for n in range(2):
        # A place beside the corner, on the old heading or the new one, ahead or astern.
        along = float(rng.choice([heading, leaves])) + float(rng.choice([0.0, 180.0]))
        aim = _from(scene, place, along, float(rng.uniform(0.2, 1.15)) * length_m)
        course, reach_m = float(rng.uniform(0, 360)), float(rng.uniform(2000, 8000))
        ends = [_from(scene, aim, course + 180.0, reach_m), _from(scene, aim, course, reach_m)]
        at_us = int(track.times_us[waypoint - 1] + rng.uniform(0.0, 0.9) * _HOUR_US)
        half_us = round(1e6 * reach_m / rng.uniform(4, 15))
        one = Track(
            f"by {n}",
            ends,
            [at_us - half_us, at_us + half_us],
            rectangle_outline_m(*rng.uniform(5, 60, 4)),
            **_one_of(rng, {"owner": ["line", None, None]}),
            object_class=rng.choice(["ship", "boat", None]),
        )
        others.append(replace(one, **_band(rng)))
    areas = []
    for n in range(int(rng.integers(2))):
        x, y = _from(scene, place, float(rng.uniform(0, 360)), float(rng.uniform(0.3, 1.2)) * length_m)
        half = float(rng.uniform(1e-4, 1e-3))
        start_us = int(track.times_us[waypoint - 1] + rng.uniform(-1, 1) * _HOUR_US)
        footprint = shapely.box(x - half, y - half, x + half, y + half)
        areas.append(
            Area(f"area {n}", footprint, None, start_us, start_us + int(rng.uniform(0.1, 1) * _HOUR_US), **_band(rng))
        )
    return scene, areas, [track, *others], waypoint


def _turning(
    rng: np.random.Generator, scene: Scene, place: np.ndarray, heading: float, length_m: float
) -> tuple[Track, int]:
    """A track with a corner at a place, perhaps after legs that stand still there, and a waypoint there."""
    before, stands, after = int(rng.integers(0, 3)), int(rng.choice([0, 0, 1, 3])), int(rng.integers(1, 3))
    positions, back = [place], place
    for _ in range(before):
        back = _from(scene, back, heading + 180.0 + float(rng.uniform(-5, 5)), float(rng.uniform(3000, 9000)))
        positions.insert(0, back)
    positions += [place] * stands
    turn = float(rng.choice([-1.0, 1.0]) * rng.uniform(60, 120))
    for _ in range(after):
        positions.append(_from(scene, positions[-1], heading + turn, float(rng.uniform(3000, 9000))))
        turn += float(rng.uniform(-60, 60))
    n = len(positions)
    times_us = T0_US + np.cumsum(np.append(0, rng.integers(600_000_000, 1_500_000_000, n - 1)))
    outline = rectangle_outline_m(length_m, length_m * rng.uniform(0, 0.5), *rng.uniform(5, 60, 2))
    more: dict[str, Any] = {}
    kind = rng.integers(4)
    if kind == 1:
        more["grow_mps"] = float(rng.uniform(0.01, 0.1))
    elif kind == 2:
        more["outlines_m"] = np.stack([outline * scale for scale in rng.uniform(0.2, 1.2, n)])
        outline = more["outlines_m"][0]
    heights = rng.integers(4)
    if heights == 1:
        more |= {"floor_m": 100.0, "ceiling_m": 200.0}
    elif heights > 1:  # one per leg, or one per waypoint
        floors = rng.uniform(0, 300, n - 1 if heights == 2 else n)
        more |= {"floors_m": floors, "ceilings_m": floors + rng.uniform(10, 100, len(floors))}
    more |= _one_of(rng, {"owner": ["line", None, None], "object_class": ["ship", None]})
    track = Track(KEY, positions, times_us, outline, max_speed_kn=np.inf, **more)
    return track, before + 1 + int(rng.integers(0, stands + 1))


def _next_heading(track: Track, waypoint: int, heading: float) -> float:
    """Roughly the heading of the next leg that moves."""
    for start, end in zip(track.positions_deg[waypoint - 1 : -1], track.positions_deg[waypoint:], strict=True):
        east, north = (end - start) * (np.cos(np.radians(start[1])), 1.0)
        if east or north:
            return float(np.degrees(np.arctan2((east + 180.0) % 360.0 - 180.0, north)))
    return heading


def _from(scene: Scene, start: np.ndarray, bearing_deg: float, distance_m: float) -> np.ndarray:
    lon, lat = rhumb_direct(earth_of(scene.earth), start[0], start[1], bearing_deg, np.array([distance_m]))
    return np.array([float(lon[0]), float(lat[0])])


def _one_of(rng: np.random.Generator, choices: dict[str, list[Any]]) -> dict[str, Any]:
    return {name: values[int(rng.integers(len(values)))] for name, values in choices.items()}


def _band(rng: np.random.Generator) -> dict[str, Any]:
    if rng.random() < 0.5:
        return {}
    floor = float(rng.uniform(0, 300))
    return {"floor_m": floor, "ceiling_m": floor + float(rng.uniform(50, 200))}
