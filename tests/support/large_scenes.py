"""Scenes of hundreds to thousands of objects, for the page: a sea, and a harbour full of drones."""

from typing import Final

import numpy as np
import shapely

from conflictdb.model.plans import Area, Track, rectangle_outline_m

HOUR_US: Final = 3_600_000_000
T0_US: Final = 1_780_272_000_000_000  # 2026-06-01 00:00 UTC


def many(count: int) -> tuple[list[Area], list[Track]]:
    """`count` objects all over the North Sea, half of them areas."""
    rng = np.random.default_rng(20)
    middles = rng.uniform((-2, 52), (10, 62), (count, 2))
    corners = np.array([(-1, -1), (1, -1), (1.2, 0.3), (0.5, 1), (-1, 0.6)])
    areas = [
        Area(f"A{n}", shapely.MultiPolygon([shapely.Polygon(at + corners * rng.uniform(0.01, 0.04))]))
        for n, at in enumerate(middles[: count // 2])
    ]
    outline = rectangle_outline_m(300, 100, 50, 80)
    tracks = []
    for n, at in enumerate(middles[count // 2 :]):
        hours = rng.uniform(0, 12) + np.array([0.0, 2.0, 4.0, 6.0])
        path = at + np.cumsum(rng.uniform(-0.1, 0.1, (4, 2)), axis=0)
        tracks.append(Track(f"T{n}", path, T0_US + (hours * HOUR_US).astype(np.int64), outline))
    return areas, tracks


def drones(count: int) -> list[Track]:
    """`count` drones that cross a harbour of 2 by 2 kilometres, again and again."""
    rng = np.random.default_rng(3)
    outline = rectangle_outline_m(15, 15, 15, 15)
    return [
        Track(
            f"DRONE-{n:03}",
            rng.uniform((10.70, 59.89), (10.74, 59.91), (8, 2)),
            T0_US + ((rng.uniform(0, 60) + 60 * np.arange(8)) * 1e6).astype(np.int64),
            outline,
            floor_m=float(floor := rng.choice([30, 50, 70, 90, 110])),
            ceiling_m=float(floor + 15),
            max_speed_kn=1000.0,
        )
        for n in range(count)
    ]
