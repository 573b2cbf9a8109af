"""Random scenes of extremes: every size, latitude, speed and shape at once. For ordinary ones see `mixed_scenes.py`."""

import numpy as np
import shapely
from layouts import changing
from scenes import T0_US

from conflictdb.core.pieces.cutting import check_plane
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import Area, EarthModel, Scene, Track, rectangle_outline_m

METRES_PER_DEGREE = 111e3
LARGEST_HAVEN_M = 4e5
LARGEST_AREA_M = 1e6
SLOWEST_S = 3e8  # ten years
# Which of longitude and latitude the next waypoint keeps.
SAME = [(False, False)] * 7 + [(True, True), (True, False), (False, True)]


def throw_wild(seed: int, objects: int = 4, changing_share: float = 0.0) -> tuple[Scene, list[Area], list[Track]]:
    """A scene of at most `objects` valid areas and as many tracks, two to thousands of kilometres across.

    changing_share : share of havens that grow, or change from waypoint to waypoint
    """
    rng = np.random.default_rng([seed, 77])
    middle = np.array([rng.uniform(-180, 180), rng.uniform(-84, 84)])
    size_m = _log_uniform(rng, 2e3, 5e6)
    # From years to a speed of 2,000 knots.
    duration_s = _log_uniform(rng, max(size_m / 1000.0, 1.0), SLOWEST_S)
    scene = Scene(
        f"wild {seed}", earth=list(EarthModel)[seed % 2], tolerance_m=float(rng.choice([0.0, 0.01, 1.0, 50.0]))
    )
    areas, tracks = [], []
    for i in range(objects):
        area = _wild_area(rng, f"A{i}", middle, size_m, duration_s)
        if area is not None and _is_held(scene, [area], []):
            areas.append(area)
        track = _wild_track(rng, f"T{i}", middle, size_m, duration_s)
        if track is not None and changing_share and rng.random() < changing_share:
            track = changing(rng, track)
        if track is not None and _is_held(scene, [], [track]):
            tracks.append(track)
    return scene, areas, tracks


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _is_held(scene: Scene, areas: list[Area], tracks: list[Track]) -> bool:
    try:
        check_plane(Setup.of(scene).plane, areas, tracks)
    except InvalidInput:
        return False
    return True


def _ring(rng: np.random.Generator, size: float) -> np.ndarray:
    angle = rng.uniform(0, 2 * np.pi, int(rng.integers(4, 9)))
    points = size * np.stack([np.cos(angle) * rng.uniform(0.01, 1), np.sin(angle)], axis=1)
    return shapely.get_coordinates(shapely.MultiPoint(points).convex_hull)[:-1]


def _wild_area(rng: np.random.Generator, key: str, middle: np.ndarray, size_m: float, duration_s: float) -> Area | None:
    wide = 1.0 / np.cos(np.radians(middle[1]))
    place = middle + rng.uniform(-0.7, 0.7, 2) * size_m / METRES_PER_DEGREE * (wide, 1.0)
    place[1] = np.clip(place[1], -80, 80)
    size = _log_uniform(rng, size_m * 1e-3, min(size_m, LARGEST_AREA_M)) / METRES_PER_DEGREE
    ring = _ring(rng, size) * (1.0 / np.cos(np.radians(place[1])), 1.0) + place
    ring[:, 1] = np.clip(ring[:, 1], -88, 88)
    ring[:, 0] -= 360.0 * np.round(ring[:, 0].mean() / 360.0)
    polygon = shapely.Polygon(ring)
    span: tuple[int | None, int | None] = (None, None)
    if rng.random() < 0.3:
        start = T0_US + int(rng.uniform(0, duration_s) * 1e6)
        span = start, start + 1 + int(rng.uniform(0, duration_s) * 1e6)
    try:
        return Area(key, shapely.MultiPolygon([polygon]), None, *span)
    except InvalidInput:
        return None


def _wild_track(
    rng: np.random.Generator, key: str, middle: np.ndarray, size_m: float, duration_s: float
) -> Track | None:
    wide = 1.0 / np.cos(np.radians(middle[1]))
    points = []
    for _ in range(int(rng.integers(2, 5))):
        point = middle + rng.uniform(-1, 1, 2) * size_m / METRES_PER_DEGREE * (wide, 1.0)
        point = np.array([(point[0] + 180.0) % 360.0 - 180.0, np.clip(point[1], -86, 86)])
        if points:  # now and then a loiter, a parallel, a meridian
            point = np.where(rng.choice(SAME), points[-1], point)
        points.append(point)
    gone_s = np.sort(rng.uniform(0, duration_s, len(points)))
    times = T0_US + (gone_s * 1e6).astype(np.int64) + np.arange(len(points))
    size = _log_uniform(rng, size_m * 1e-3, min(size_m, LARGEST_HAVEN_M))
    kind = rng.choice(["rectangle", "ring", "point", "line"], p=[0.5, 0.3, 0.1, 0.1])
    if kind == "rectangle":
        outline = rectangle_outline_m(*(size * rng.uniform(0, 1, 4)))
    elif kind == "ring":
        outline = _ring(rng, size)
    elif kind == "point":
        outline = np.zeros((1, 2))
    else:
        outline = np.array([(0.0, size), (0.0, -size * rng.uniform(0, 1))])
    try:
        return Track(key, np.array(points), times, outline, max_speed_kn=np.inf)
    except InvalidInput:
        return None
