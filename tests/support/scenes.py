"""Scenes with answers that can be worked out by hand.

Everything rests on three facts. On a parallel, longitude is uniform in time and a haven's fore and aft edges lie on
meridians. On a meridian, meridian distance is uniform in time and they lie on parallels. A haven step along the
heading comes before the step across it. Random scenes are in `mixed_scenes.py`, a writer of scene files in
`scene_file.py`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from typing import Any, Final

import numpy as np
import shapely

from conflictdb.model.plans import Area, EarthModel, Motion, Scene, Track, rectangle_outline_m

T0_US: Final = int(datetime(2026, 3, 1, tzinfo=UTC).timestamp()) * 1_000_000
HOUR_S: Final = 3600.0
RADIUS_M: Final = {EarthModel.SPHERE: 6371008.771415, EarthModel.WGS84: 6378137.0}
FLATTENING: Final = {EarthModel.SPHERE: 0.0, EarthModel.WGS84: 1 / 298.257223563}

Pair = tuple[str, str]
Interval = tuple[float | None, float | None]


@dataclass(frozen=True)
class Known:
    """A scene and its answer.

    expected : for each pair that meets, its intervals, seconds after T0 (None: unbounded); all other pairs never meet
    undecided : pairs that may be reported or not: rounding or the end of a span decides an instant of touch
    grazing : the expected pairs that only touch; all others are in conflict
    """

    name: str
    scene: Scene
    areas: list[Area] = field(default_factory=list)
    tracks: list[Track] = field(default_factory=list)
    expected: dict[Pair, list[Interval]] = field(default_factory=dict)
    undecided: frozenset[Pair] = frozenset()
    grazing: frozenset[Pair] = frozenset()


@cache
def meridian_m(earth: EarthModel, lat_deg: float) -> float:
    """Metres along the meridian from the equator, by the elliptic integral in 30 digits."""
    # Benchmarks use these scenes without the developers' tools.
    from mpmath import ellipe, mp, mpf

    with mp.workdps(30):
        f, a = mpf(FLATTENING[earth]), mpf(RADIUS_M[earth])
        e2 = f * (2 - f)
        lat = mp.radians(mpf(lat_deg))
        return float(a * (ellipe(lat, e2) - e2 * mp.sin(lat) * mp.cos(lat) / mp.sqrt(1 - e2 * mp.sin(lat) ** 2)))


def parallel_m(earth: EarthModel, lat_deg: float) -> float:
    """Metres of one degree of longitude on a parallel."""
    f, a, p = FLATTENING[earth], RADIUS_M[earth], np.radians(lat_deg)
    return float(np.radians(1.0) * a * np.cos(p) / np.sqrt(1 - f * (2 - f) * np.sin(p) ** 2))


def instant_us(seconds: float) -> int:
    return T0_US + round(seconds * 1e6)


def area(
    key: str,
    shape: shapely.Polygon | shapely.MultiPolygon,
    start_s: float | None = None,
    end_s: float | None = None,
    heights: tuple[float | None, float | None] = (None, None),
) -> Area:
    """An area of one or more polygons, active from and to seconds after T0."""
    many = shape if isinstance(shape, shapely.MultiPolygon) else shapely.MultiPolygon([shape])
    span = [None if s is None else instant_us(s) for s in (start_s, end_s)]
    return Area(key, many, None, *span, *heights)


def track(
    key: str,
    waypoints: Sequence[tuple[float, float]],
    times_s: Sequence[float],
    fore: float = 5000.0,
    aft: float = 5000.0,
    port: float = 5000.0,
    starboard: float = 5000.0,
    heights: tuple[float | None, float | None] = (None, None),
) -> Track:
    """A track through (longitude, latitude) points at seconds after T0, with a rectangular haven in metres."""
    return Track(
        key,
        np.array(waypoints, dtype=np.float64),
        np.array([instant_us(s) for s in times_s], dtype=np.int64),
        rectangle_outline_m(fore, aft, port, starboard),
        None,
        *heights,
        max_speed_kn=np.inf,
    )


def box(key: str, west: float, south: float, east: float, north: float, **more: Any) -> Area:
    """An area between meridians and parallels."""
    return Area(key, shapely.MultiPolygon([shapely.box(west, south, east, north)]), **more)


def sail(key: str, *positions: tuple[float, float], start_us: int = T0_US, **more: Any) -> Track:
    """A track through (longitude, latitude) points an hour apart, with a haven of 1,000 by 400 metres."""
    times = start_us + round(1e6 * HOUR_S) * np.arange(len(positions))
    return Track(key, np.array(positions), times, rectangle_outline_m(500, 500, 200, 200), **more)


def _passing(
    earth: EarthModel, lat: float, west: float, east: float, hours: float, fore: float, aft: float
) -> Interval:
    """When a haven that covers one degree of a parallel per `hours`, eastbound from longitude 0, meets [west, east]."""
    degree = parallel_m(earth, lat)
    return (west - fore / degree) * hours * HOUR_S, (east + aft / degree) * hours * HOUR_S


def equator_crossing(earth: EarthModel) -> Known:
    """Eastbound on the equator through an area that lies on it; a second track crosses the equator northbound."""
    day = 10 * HOUR_S
    north = meridian_m(earth, 2.0) * 2 / day
    return Known(
        "equator crossing",
        Scene("equator", earth=earth),
        [area("A", shapely.box(3.0, -0.5, 4.0, 0.5)), area("B", shapely.box(-1.5, -0.25, -0.5, 0.75))],
        [
            track("E", [(0, 0), (10, 0)], [0, day], fore=9000, aft=4000),
            track("N", [(-1, -2), (-1, 2)], [0, day], fore=9000, aft=4000),
        ],
        {
            ("A", "E"): [_passing(earth, 0.0, 3.0, 4.0, 1.0, 9000, 4000)],
            ("B", "N"): [
                (
                    (meridian_m(earth, 2.0) - meridian_m(earth, 0.25) - 9000) / north,
                    (meridian_m(earth, 2.0) + meridian_m(earth, 0.75) + 4000) / north,
                )
            ],
        },
    )


def overtaking(earth: EarthModel) -> Known:
    """Two eastbound on one parallel, the faster one behind; and two on near parallels that stay clear by 50 m."""
    lat, degree = 10.0, parallel_m(earth, 10.0)
    clear = 10000.0 + 50.0
    beside = 10.0 + clear / (meridian_m(earth, 10.5) - meridian_m(earth, 9.5))
    return Known(
        "overtaking",
        Scene("overtaking", earth=earth),
        [],
        [
            track("fast", [(0, lat), (10, lat)], [0, 10 * HOUR_S], fore=9000, aft=1000),
            track("slow", [(2, lat), (7, lat)], [0, 10 * HOUR_S], fore=3000, aft=7000),
            track("wide", [(2, beside + 0.001), (7, beside + 0.001)], [0, 10 * HOUR_S], fore=3000, aft=7000),
        ],
        # Closing at half a degree an hour.
        {("fast", "slow"): [((2 - 16000 / degree) / 0.5 * HOUR_S, (2 + 4000 / degree) / 0.5 * HOUR_S)]},
    )


def head_on(earth: EarthModel) -> Known:
    """Two on one meridian towards each other, at unequal speeds, at 40 to 80 degrees north and south."""
    tracks, expected = [], {}
    for side in (1, -1):
        low, high = meridian_m(earth, 40.0), meridian_m(earth, 80.0)
        first, second = (high - low) / (100 * HOUR_S), (high - low) / (60 * HOUR_S)
        a, b = f"away{side}", f"back{side}"
        tracks.append(track(a, [(20, side * 40.0), (20, side * 80.0)], [0, 100 * HOUR_S], fore=30000, aft=2000))
        tracks.append(track(b, [(20, side * 80.0), (20, side * 40.0)], [0, 60 * HOUR_S], fore=50000, aft=1000))
        expected[a, b] = [((high - low - 80000) / (first + second), (high - low + 3000) / (first + second))]
    return Known("head-on", Scene("head-on", earth=earth), [], tracks, expected)


def meridian_entry(earth: EarthModel) -> Known:
    """In and out of areas along a meridian, northbound at 5 degrees, southbound at 84 and in the south."""
    cases = [("low", 4.0, 6.0, 4.5, 5.5), ("high", 86.0, 82.0, 83.5, 84.5), ("south", -60.0, -75.0, -71.0, -68.0)]
    areas, tracks, expected = [], [], {}
    for key, start, end, low, high in cases:
        lon = 30.0 * len(tracks)
        areas.append(area(f"A{key}", shapely.box(lon - 3.0, low, lon + 3.0, high)))
        tracks.append(track(key, [(lon, start), (lon, end)], [0, 20 * HOUR_S], fore=12345.0, aft=678.0))
        m = [meridian_m(earth, x) for x in (start, end, low, high)]
        sign = 1.0 if end > start else -1.0
        speed = abs(m[1] - m[0]) / (20 * HOUR_S)
        near, far = (m[2], m[3]) if sign > 0 else (m[3], m[2])
        expected[f"A{key}", key] = [((sign * (near - m[0]) - 12345.0) / speed, (sign * (far - m[0]) + 678.0) / speed)]
    return Known("meridian entry", Scene("meridian", earth=earth), areas, tracks, expected)


def loiter(earth: EarthModel) -> Known:
    """A haven that stops keeps its heading: before the stop, after it if it never moved, north if it never will."""
    long_nose = {"fore": 40000.0, "aft": 1000.0, "port": 1000.0, "starboard": 1000.0}
    degree = parallel_m(earth, 0.0)
    reach = 40000.0 / degree
    stop, go = 2 * HOUR_S, 5 * HOUR_S
    return Known(
        "loiter",
        Scene("loiter", earth=earth),
        [
            area("ahead", shapely.box(1.0 + reach - 0.05, -0.2, 1.6, 0.2), 3 * HOUR_S, 4 * HOUR_S),
            area("waiting", shapely.box(20.1, -0.2, 20.2, 0.2)),
            area("north", shapely.box(39.9, 0.3, 40.1, 0.4)),
            area("beside", shapely.box(40.1, -0.1, 40.2, 0.1)),
        ],
        [
            track("stops", [(0, 0), (1, 0), (1, 0), (1, -1)], [0, stop, go, 9 * HOUR_S], **long_nose),
            track("waits", [(20, 0), (20, 0), (19, 0)], [0, HOUR_S, 2 * HOUR_S], **long_nose),
            track("moored", [(40, 0), (40, 0)], [0, HOUR_S], **long_nose),
        ],
        {
            ("ahead", "stops"): [(3 * HOUR_S, 4 * HOUR_S)],  # still eastward while it stands
            ("north", "moored"): [(0.0, HOUR_S)],
        },
    )


def seam(earth: EarthModel) -> Known:
    """Across +-180 in both directions, with areas in every notation of an area across it."""
    cut = shapely.MultiPolygon([shapely.box(179.5, -1, 180, 1), shapely.box(-180, -1, -179.5, 1)])
    east = [(179, 0), (-179, 0)]
    times = [0, 2 * HOUR_S]
    fore, aft = 2000.0, 1000.0
    across = _passing(earth, 0.0, 0.5, 1.5, 1.0, fore, aft)
    back = _passing(earth, 0.0, 0.5, 1.5, 1.0, fore, aft)
    beyond = _passing(earth, 0.0, 1.1, 1.2, 1.0, fore, aft)
    beyond_back = _passing(earth, 0.0, 0.8, 0.9, 1.0, fore, aft)
    degree = parallel_m(earth, 0.0)
    meet = (2 - 2 * fore / degree) / 2 * HOUR_S, (2 + 2 * aft / degree) / 2 * HOUR_S
    keys = {"cut": across, "east": across, "west": across, "beyond": beyond, "turned": beyond}
    backs = {"cut": back, "east": back, "west": back, "beyond": beyond_back, "turned": beyond_back}
    overlaps = [("cut", "east"), ("cut", "west"), ("east", "west"), ("beyond", "turned")]
    overlaps += [(b, s) for b in ("beyond", "turned") for s in ("cut", "east", "west")]
    return Known(
        "seam",
        Scene("seam", earth=earth),
        [
            area("cut", cut),
            area("east", shapely.box(179.5, -1, 180.5, 1)),
            area("west", shapely.box(-180.5, -1, -179.5, 1)),
            area("beyond", shapely.box(-179.9, -1, -179.8, 1)),
            area("turned", shapely.box(180.1, -1, 180.2, 1)),
        ],
        [
            track("E", east, times, fore, aft, 500, 500),
            track("W", east[::-1], times, fore, aft, 500, 500),
            track("Eu", [(179, 0), (181, 0)], times, fore, aft, 500, 500, heights=(0.0, 1.0)),
        ],
        {
            **{(k, "E"): [v] for k, v in keys.items()},
            **{(k, "Eu"): [v] for k, v in keys.items()},
            **{(k, "W"): [v] for k, v in backs.items()},
            ("E", "W"): [meet],
            ("Eu", "W"): [meet],
            ("E", "Eu"): [(0.0, 2 * HOUR_S)],
            **{(min(p), max(p)): [(None, None)] for p in overlaps},
        },
    )


def on_the_seam(earth: EarthModel) -> Known:
    """Exactly on the meridian of 180 degrees, written as +180 and as -180."""
    m, speed = [meridian_m(earth, x) for x in (1.0, 2.0)], meridian_m(earth, 3.0) / (3 * HOUR_S)
    times = (m[0] - 3000) / speed, (m[1] + 3000) / speed
    sizes = {"fore": 3000.0, "aft": 3000.0, "port": 1000.0, "starboard": 1000.0}
    return Known(
        "on the seam",
        Scene("on-the-seam", earth=earth),
        [area("W", shapely.box(-180, 1, -179, 2)), area("E", shapely.box(179, 1, 180, 2))],
        [
            track("plus", [(180, 0), (180, 3)], [0, 3 * HOUR_S], **sizes),
            track("minus", [(-180, 0), (-180, 3)], [0, 3 * HOUR_S], **sizes),
        ],
        {
            **{(a, t): [times] for a in "EW" for t in ("plus", "minus")},
            ("E", "W"): [(None, None)],
            ("minus", "plus"): [(0.0, 3 * HOUR_S)],
        },
        grazing=frozenset({("E", "W")}),
    )


def touching(earth: EarthModel) -> Known:
    """Shared edges and corners touch; half a metre apart is too close to call; five metres is clear."""
    metre = 1.0 / (meridian_m(earth, 0.5) - meridian_m(earth, -0.5))
    sizes = {"fore": 3000.0, "aft": 3000.0, "port": 0.0, "starboard": 1000.0}
    times = _passing(earth, 0.0, 1.0, 2.0, 1.0, 3000, 3000)
    return Known(
        "touching",
        Scene("touching", earth=earth),
        [
            area("edge", shapely.box(1, 0, 2, 1)),  # the track's port side runs along its southern edge, on the equator
            area("close", shapely.box(1, 10 + 0.5 * metre, 2, 11)),
            area("clear", shapely.box(1, 20 + 5 * metre, 2, 21)),
            area("left", shapely.box(50, 0, 51, 1)),
            area("right", shapely.box(51, 0.5, 52, 1.5)),
            area("corner", shapely.box(52, 1.5, 53, 2.5)),
        ],
        [
            track("T0", [(0, 0), (3, 0)], [0, 3 * HOUR_S], **sizes),
            track("T10", [(0, 10), (3, 10)], [0, 3 * HOUR_S], **sizes),
            track("T20", [(0, 20), (3, 20)], [0, 3 * HOUR_S], **sizes),
        ],
        {("edge", "T0"): [times], ("left", "right"): [(None, None)], ("corner", "right"): [(None, None)]},
        frozenset({("close", "T10")}),
        frozenset({("edge", "T0"), ("left", "right"), ("corner", "right")}),
    )


def hole(earth: EarthModel) -> Known:
    """A haven inside the hole of an area is clear of it; a haven that crosses it meets the area on both sides."""
    ring = shapely.Polygon(shapely.box(2, -2, 6, 2).exterior, [shapely.box(3, -1, 5, 1).exterior])
    first = _passing(earth, 0.0, 2.0, 3.0, 1.0, 2000, 1000)
    second = _passing(earth, 0.0, 5.0, 6.0, 1.0, 2000, 1000)
    return Known(
        "hole",
        Scene("hole", earth=earth),
        [area("ring", ring)],
        [
            track("inside", [(3.5, 0.5), (4.5, -0.5), (3.5, -0.5)], [0, HOUR_S, 2 * HOUR_S], 2000, 1000, 500, 500),
            track("across", [(0, 0), (8, 0)], [0, 8 * HOUR_S], 2000, 1000, 500, 500, heights=(-10.0, -5.0)),
        ],
        {("ring", "across"): [first, second]},
    )


def twice_in_a_leg(earth: EarthModel) -> Known:
    """Through both arms of a U; and a multipolygon of three parts."""
    arms = shapely.Polygon([(2, -1), (5, -1), (5, 1), (4, 1), (4, -0.8), (3, -0.8), (3, 1), (2, 1)])
    three = shapely.MultiPolygon([shapely.box(x, -1, x + 0.5, 1) for x in (10.0, 12.0, 14.0)])
    sizes = {"fore": 2000.0, "aft": 1000.0, "port": 500.0, "starboard": 500.0}

    def through(west: float, east: float) -> Interval:
        return _passing(earth, 0.0, west, east, 1.0, 2000, 1000)

    return Known(
        "twice in a leg",
        Scene("twice", earth=earth),
        [area("U", arms), area("parts", three)],
        [track("T", [(0, 0), (20, 0)], [0, 20 * HOUR_S], **sizes)],
        {
            ("U", "T"): [through(2, 3), through(4, 5)],
            ("parts", "T"): [through(x, x + 0.5) for x in (10.0, 12.0, 14.0)],
        },
    )


def several_legs(earth: EarthModel) -> Known:
    """To and fro: three meetings on three legs, the haven's long nose turning with each; then gone."""
    fore, aft = 20000.0, 3000.0
    degree = parallel_m(earth, 0.0)
    intervals = []
    for leg in range(3):
        start_s = leg * 4 * HOUR_S
        intervals.append((start_s + (1.5 - fore / degree) * HOUR_S, start_s + (2.5 + aft / degree) * HOUR_S))
    return Known(
        "several legs",
        Scene("legs", earth=earth),
        [area("A", shapely.box(1.5, -0.5, 2.5, 0.5))],
        [track("T", [(0, 0), (4, 0), (0, 0), (4, 0), (4, 4)], [4 * i * HOUR_S for i in range(5)], fore, aft, 500, 500)],
        {("A", "T"): intervals},
    )


def turning(earth: EarthModel) -> Known:
    """At a waypoint both orientations count: the nose is in the area until the very instant of the turn."""
    degree = parallel_m(earth, 0.0)
    into = 2000.0 / degree
    reach = 20000.0 / degree
    inside = 1.0 + reach - into
    up = meridian_m(earth, 1.0)
    return Known(
        "turning",
        Scene("turning", earth=earth),
        [
            area("before", shapely.box(inside, -0.1, inside + 1, 0.1)),
            # Only the new heading reaches it, from the instant of the turn, and the tail leaves it.
            area("after", shapely.box(0.99, 0.1, 1.01, 0.15)),
        ],
        [track("T", [(0, 0), (1, 0), (1, 1)], [0, HOUR_S, 2 * HOUR_S], 20000, 1000, 500, 500)],
        {
            ("before", "T"): [((1 - into) * HOUR_S, HOUR_S)],
            ("after", "T"): [(HOUR_S, HOUR_S + (meridian_m(earth, 0.15) + 1000) / up * HOUR_S)],
        },
    )


def heights(earth: EarthModel) -> Known:
    """Bands [floor, ceiling) that only touch are apart; a missing bound is unlimited."""
    box = shapely.box(3.0, -0.5, 4.0, 0.5)
    path, day = [(0, 0), (10, 0)], [0, 10 * HOUR_S]
    meets = [_passing(earth, 0.0, 3.0, 4.0, 1.0, 5000, 5000)]
    bands = {"deep": (-300.0, -100.0), "keel": (-100.0, 0.0), "air": (0.0, None), "any": (None, None)}
    areas = [area(f"A-{k}", box, 0, 10 * HOUR_S, heights=v) for k, v in bands.items()]
    tracks = [track(f"T-{k}", path, day, heights=v) for k, v in bands.items()]
    expected: dict[Pair, list[Interval]] = {}
    for i, one in enumerate(sorted(bands)):
        for two in sorted(bands):
            if one == two or "any" in (one, two):
                expected[f"A-{one}", f"T-{two}"] = list(meets)
        for two in sorted(bands)[i + 1 :]:
            if "any" in (one, two):
                expected[f"A-{one}", f"A-{two}"] = [(0.0, 10 * HOUR_S)]
                expected[f"T-{one}", f"T-{two}"] = [(0.0, 10 * HOUR_S)]
    return Known("heights", Scene("heights", earth=earth), areas, tracks, expected)


def spans(earth: EarthModel) -> Known:
    """Time decides: before, after, cut short, and exactly at the end of a span, which does not belong to it."""
    box = shapely.box(3.0, -0.5, 4.0, 0.5)
    start, end = _passing(earth, 0.0, 3.0, 4.0, 1.0, 5000, 5000)
    assert start is not None
    assert end is not None
    # The arrival on a whole microsecond: move the area, not the clock.
    degree = parallel_m(earth, 0.0)
    on_time = shapely.box(3.0 + 5000 / degree, -0.5, 4.0, 0.5)
    far = shapely.box(30, 0, 31, 1)
    return Known(
        "spans",
        Scene("spans", earth=earth),
        [
            area("early", box, -HOUR_S, start - 60),
            area("late", box, end + 60, None),
            area("cut", box, start + 60, end - 60),
            area("half", box, None, start + 600),
            area("ends-as-it-comes", on_time, None, 3 * HOUR_S),
            area("p", far, 0, HOUR_S),
            area("q", far, HOUR_S, 2 * HOUR_S),
            area("r", far, 1800, None),
        ],
        [track("T", [(0, 0), (10, 0)], [0, 10 * HOUR_S])],
        {
            ("cut", "T"): [(start + 60, end - 60)],
            ("half", "T"): [(start, start + 600)],
            ("cut", "half"): [(start + 60, start + 600)],
            ("p", "r"): [(1800.0, HOUR_S)],
            ("q", "r"): [(HOUR_S, 2 * HOUR_S)],
            ("early", "half"): [(-HOUR_S, start - 60)],
            ("early", "ends-as-it-comes"): [(-HOUR_S, start - 60)],
            ("ends-as-it-comes", "half"): [(None, 3 * HOUR_S)],
        },
        frozenset({("ends-as-it-comes", "T"), ("cut", "ends-as-it-comes")}),
    )


def identical(earth: EarthModel) -> Known:
    """The same thing twice is in conflict with itself the whole time."""
    triangle = shapely.Polygon([(-20, 30), (-19, 30.3), (-19.4, 31)])
    path, times = [(-30, 50), (-28, 52), (-28, 52), (-31, 51)], [0, 7 * HOUR_S, 8 * HOUR_S, 20 * HOUR_S]
    return Known(
        "identical",
        Scene("identical", earth=earth),
        [area("A", triangle, 0, HOUR_S), area("B", triangle, 0, HOUR_S)],
        [track("T", path, times), track("U", path, times)],
        {("A", "B"): [(0.0, HOUR_S)], ("T", "U"): [(0.0, 20 * HOUR_S)]},
    )


def growing(earth: EarthModel) -> Known:
    """Growing havens: moored ones meet a wall or each other, one moves, one stops."""
    degree, hours = parallel_m(earth, 0.0), 2 * HOUR_S
    moored = meridian_m(earth, 0.1)
    stop, wall = meridian_m(earth, 61.0), meridian_m(earth, 61.11)
    metre = 1.0 / (meridian_m(earth, 0.5) - meridian_m(earth, -0.5))
    point = dict.fromkeys(("fore", "aft", "port", "starboard"), 0.0)
    small = dict.fromkeys(("fore", "aft", "port", "starboard"), 1000.0)
    speed = degree / HOUR_S

    def grows(mps: float, item: Track) -> Track:
        return replace(item, grow_mps=mps)

    return Known(
        "growing",
        Scene("growing", earth=earth),
        [
            area("wall", shapely.box(-1, 0.1, 1, 0.5)),
            area("ahead", shapely.box(21, -1, 21.2, 1)),
            area("beyond the stop", shapely.box(39, 61.11, 41, 62)),
            area("out of reach", shapely.box(79, 4660 * metre, 81, 1)),
        ],
        [
            grows(2.0, track("point", [(0, 0), (0, 0)], [0, 2 * hours], **point)),
            grows(0.5, track("under way", [(20, 0), (22, 0)], [0, hours], fore=2000.0, aft=1000.0)),
            grows(1.0, track("stops", [(40, 60), (40, 61), (40, 61)], [0, hours, 2 * hours], **small)),
            grows(1.0, track("too slow", [(80, 0), (80, 0)], [0, HOUR_S], **small)),
            grows(1.0, track("south", [(100, 0), (100, 0)], [0, 2 * hours], **small)),
            grows(0.5, track("north", [(100, 0.1), (100, 0.1)], [0, 2 * hours], fore=0.0, aft=500.0)),
        ],
        {
            ("wall", "point"): [(moored / 2.0, 2 * hours)],
            ("ahead", "under way"): [((degree - 2000) / (speed + 0.5), (1.2 * degree + 1000) / (speed - 0.5))],
            ("beyond the stop", "stops"): [(wall - stop - 1000.0, 2 * hours)],
            ("north", "south"): [((moored - 1500.0) / 1.5, 2 * hours)],
        },
    )


def outline_per_waypoint(earth: EarthModel) -> Known:
    """A haven opens ahead of itself and draws in behind; another turns from a line across to a line along."""
    hours = 2 * HOUR_S
    speed = meridian_m(earth, 1.0) / hours
    opens = track("opens", [(60, 0), (60, 1)], [0, hours], fore=1000.0, aft=1000.0)
    after = rectangle_outline_m(5000.0, 0.0, 5000.0, 5000.0)
    turns = track("turns", [(70, 0), (70, 0)], [0, hours])
    across, along = np.array([(-9000.0, 0.0), (9000.0, 0.0)]), np.array([(0.0, -9000.0), (0.0, 9000.0)])
    near = meridian_m(earth, 0.05)
    return Known(
        "outline per waypoint",
        Scene("outlines", earth=earth),
        [area("A", shapely.box(59, 0.5, 61, 0.6)), area("B", shapely.box(69, 0.05, 71, 0.6))],
        [
            replace(opens, outlines_m=np.array([opens.outline_m, after])),
            replace(turns, outline_m=across, outlines_m=np.array([across, along])),
        ],
        {
            ("A", "opens"): [
                (
                    (meridian_m(earth, 0.5) - 1000.0) / (speed + 4000.0 / hours),
                    (meridian_m(earth, 0.6) + 1000.0) / (speed + 1000.0 / hours),
                )
            ],
            ("B", "turns"): [(near / 9000.0 * hours, hours)],
        },
    )


def _circles(name: str, centre: tuple[float, float]) -> Scene:
    return Scene(f"circles-{name}", Motion.GREAT_CIRCLE, centre=centre)


SPHERE_M: Final = RADIUS_M[EarthModel.SPHERE]


def circles_over_the_pole() -> Known:
    """Head-on along a meridian, over the pole; corners meet at once, as both are found forward first, then across."""
    way = np.radians(60.0) * SPHERE_M  # from 60 degrees over the pole to 60 degrees
    first, second = way / (30 * HOUR_S), way / (50 * HOUR_S)
    # An edge across the meridian, half way between two corners, runs north of them.
    edge = np.degrees(np.arctan(np.tan(np.radians(80.0)) / np.cos(np.radians(10.0))))
    reached = np.radians(90.0 - 60.0 + 90.0 - edge) * SPHERE_M
    left = np.degrees(np.arctan(np.tan(np.radians(70.0)) / np.cos(np.radians(10.0))))
    return Known(
        "circles over the pole",
        _circles("pole", (100.0, 85.0)),
        [area("A", shapely.Polygon([(-170, 80), (-150, 80), (-150, 70), (-170, 70)]))],
        [
            track("over", [(20, 60), (-160, 60)], [0, 30 * HOUR_S], fore=30000, aft=2000),
            track("back", [(-160, 60), (20, 60)], [0, 50 * HOUR_S], fore=50000, aft=1000),
            track("line", [(20, 60), (-160, 60)], [100 * HOUR_S, 130 * HOUR_S], 7000, 3000, 0, 0),
        ],
        {
            ("back", "over"): [((way - 80000) / (first + second), (way + 3000) / (first + second))],
            # It widens on both sides of the meridian, so the area's own edges decide: see the oracle for these.
            ("A", "line"): [
                (
                    100 * HOUR_S + (reached - 7000) / first,
                    100 * HOUR_S + (np.radians(120.0 - left) * SPHERE_M + 3000) / first,
                )
            ],
        },
        frozenset({("A", "over"), ("A", "back")}),
    )


def circles_on_the_equator() -> Known:
    """On the equator, between meridians, the answer is that of rhumb lines on the sphere."""
    known = equator_crossing(EarthModel.SPHERE)
    both = overtaking(EarthModel.SPHERE)
    degree = parallel_m(EarthModel.SPHERE, 0.0)
    return Known(
        "circles on the equator",
        _circles("equator", (5.0, 0.0)),
        known.areas[:1],
        [
            known.tracks[0],
            *(replace(t, positions_deg=t.positions_deg * [1.0, 0.0]) for t in both.tracks[:2]),
        ],
        {
            ("A", "E"): known.expected["A", "E"],
            # The same way from the same place at the same time.
            ("E", "fast"): [(0.0, 10 * HOUR_S)],
            ("E", "slow"): [((2 - 16000 / degree) / 0.5 * HOUR_S, (2 + 7000 / degree) / 0.5 * HOUR_S)],
            ("fast", "slow"): [((2 - 16000 / degree) / 0.5 * HOUR_S, (2 + 4000 / degree) / 0.5 * HOUR_S)],
            ("A", "fast"): [_passing(EarthModel.SPHERE, 0.0, 3.0, 4.0, 1.0, 9000, 1000)],
            ("A", "slow"): [((3 - 2 - 3000 / degree) * 2 * HOUR_S, (4 - 2 + 7000 / degree) * 2 * HOUR_S)],
        },
    )


def circles_at_their_highest() -> Known:
    """A point from 50 north to 50 north, a quarter turn on, passes near 59 north, where no rhumb line goes.

    From the highest point of a great circle, at the latitude v, tan(turn) = tan(angle) / cos(v).
    """
    highest = np.arctan(np.tan(np.radians(50.0)) / np.cos(np.radians(45.0)))
    whole = np.arctan(np.tan(np.radians(45.0)) * np.cos(highest))
    beside = np.arctan(np.tan(np.radians(1.0)) * np.cos(highest))
    half = 20 * HOUR_S
    return Known(
        "circles at their highest",
        _circles("highest", (20.0, 30.0)),
        [area("A", shapely.box(44.0, 58.0, 46.0, 61.0)), area("B", shapely.box(44.0, 49.0, 46.0, 52.0))],
        [track("P", [(0, 50), (90, 50)], [0, 2 * half], 0, 0, 0, 0)],
        {("A", "P"): [(half * (1 - beside / whole), half * (1 + beside / whole))]},
    )


CIRCLE_MAKERS: Final = (circles_over_the_pole, circles_on_the_equator, circles_at_their_highest)

MAKERS: Final[tuple[Callable[[EarthModel], Known], ...]] = (
    equator_crossing,
    overtaking,
    head_on,
    meridian_entry,
    loiter,
    seam,
    on_the_seam,
    touching,
    hole,
    twice_in_a_leg,
    several_legs,
    turning,
    heights,
    spans,
    identical,
    growing,
    outline_per_waypoint,
)


def known_scenes() -> list[Known]:
    """Every known scene on both earths, and those of great circles."""
    return [
        replace(known, scene=replace(known.scene, name=f"{known.scene.name}-{earth}"))
        for make in MAKERS
        for earth in EarthModel
        for known in [make(earth)]
    ] + [make() for make in CIRCLE_MAKERS]
