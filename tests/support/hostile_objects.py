"""Random objects as an editor with bad luck or bad will might write them; nothing here keeps the rules of the model."""

import json
import math
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

Ring = list[tuple[float, float]]

NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, -0.0, 1e17)
LATITUDES = (0.0, 1e-9, 45.0, 60.0, 84.0, 88.9, 89.0, 89.0000001, 90.0, 90.0000001, -60.0, -88.9999999, -89.0, -90.0)
LONGITUDES = (0.0, 5.0, 179.9999999, 180.0, 180.0000001, -180.0, 359.0, 360.0, -359.9, 90.0)
HEIGHTS = (None, None, None, None, 0.0, -1e308, 1e308, 5e-324, math.nan, math.inf, 1000.0, 1000.0000000000001)
INSTANTS = (
    None,
    -62135596800.0,
    -1e9,
    0.0,
    1.7e9,
    1.7e9 + 1e-6,
    1.7e9 + 3600.0,
    4e9,
    253402300799.0,
    253402300800.0,
    1e15,
)
SIZES_DEG = (1e-13, 1e-9, 1e-6, 1e-3, 0.1, 1.0, 20.0, 80.0)
SIZES_M = (0.0, 1e-12, 1e-6, 1.0, 1e3, 1e5, 1e6, 9e6)


@dataclass(frozen=True)
class Hostile:
    """One object, in numbers that no rule has seen.

    polygons : rings of longitudes and latitudes, degrees; empty for a track
    path : longitude, latitude, Unix seconds of a track's waypoints
    """

    key: str
    what: str
    polygons: tuple[tuple[Ring, ...], ...] = ()
    span: tuple[float | None, float | None] = (None, None)
    path: tuple[tuple[float, float, float], ...] = ()
    outline: tuple[tuple[float, float], ...] = ()
    grow_mps: float = 0.0
    outlines: tuple[tuple[tuple[float, float], ...], ...] = ()
    floor_m: float | None = None
    ceiling_m: float | None = None

    @property
    def is_track(self) -> bool:
        return not self.polygons

    def feature(self) -> str:
        """As a feature of a scene file, with NaN and Infinity where they are."""
        heights = {"floor_m": self.floor_m, "ceiling_m": self.ceiling_m}
        if self.is_track:
            geometry: dict[str, Any] = {"type": "LineString", "coordinates": [p[:2] for p in self.path]}
            haven = {"outlines_m": self.outlines} if self.outlines else {"outline_m": self.outline}
            growth = {"grow_mps": self.grow_mps} if self.grow_mps else {}
            properties = {"times": [_iso(p[2]) for p in self.path], **haven, **growth, **heights}
        else:
            geometry = {"type": "MultiPolygon", "coordinates": self.polygons}
            properties = {"start": _iso(self.span[0]), "end": _iso(self.span[1]), **heights}
        return json.dumps({"type": "Feature", "id": self.key, "geometry": geometry, "properties": properties})


def scene_file(things: list[Hostile]) -> str:
    return f'{{"type": "FeatureCollection", "features": [{", ".join(thing.feature() for thing in things)}]}}'


def put(scene: str, thing: Hostile) -> tuple[str, list[Any]]:
    """The call that puts an object in a scene, and its arguments."""
    if not thing.is_track:
        call = "put_area(%s, %s, %s::geometry, tstzrange(to_timestamp(%s), to_timestamp(%s)), %s, %s)"
        arguments = [_multipolygon(thing.polygons, 4326), *thing.span, thing.floor_m, thing.ceiling_m]
        return f"SELECT conflictdb.{call}", [scene, thing.key, *arguments]
    call = "put_track(%s, %s, %s::geometry, %s::geometry, %s, %s, NULL, '{}', %s, %s::geometry)"
    outlines = _multipolygon([[_closed(ring)] for ring in thing.outlines], 0) if thing.outlines else None
    outline = _polygon([_closed(thing.outline)], 0) if thing.outline else None
    more = [thing.floor_m, thing.ceiling_m, thing.grow_mps, outlines]
    return f"SELECT conflictdb.{call}", [scene, thing.key, _line(thing.path), outline, *more]


def throw(rng: np.random.Generator, key: str) -> Hostile:
    """A random hostile object."""
    makers = [*AREAS, *TRACKS]
    maker = makers[rng.integers(len(makers))]
    floor_m, ceiling_m = (HEIGHTS[rng.integers(len(HEIGHTS))] if rng.random() < 0.1 else None for _ in range(2))
    return maker(
        rng, {"key": f"{key} {maker.__name__}", "what": maker.__name__, "floor_m": floor_m, "ceiling_m": ceiling_m}
    )


def _pick(rng: np.random.Generator, choices: Any) -> Any:
    return choices[rng.integers(len(choices))]


def _place(rng: np.random.Generator) -> np.ndarray:
    if rng.random() < 0.6:
        return np.array([rng.uniform(-30.0, 30.0), rng.uniform(-50.0, 50.0)])
    return np.array([_pick(rng, LONGITUDES), _pick(rng, LATITUDES)])


def _span(rng: np.random.Generator) -> tuple[float | None, float | None]:
    return (None, None) if rng.random() < 0.5 else (_pick(rng, INSTANTS), _pick(rng, INSTANTS))


def _area(rng: np.random.Generator, common: dict[str, Any], *parts: Any) -> Hostile:
    polygons = tuple(tuple(_closed([tuple(map(float, p)) for p in ring]) for ring in part) for part in parts)
    return Hostile(polygons=polygons, span=_span(rng), **common)


def box(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    size = [_pick(rng, SIZES_DEG), _pick(rng, SIZES_DEG)]
    return _area(rng, common, [_place(rng) + np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * size])


def sliver(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    a, b = rng.uniform(-1, 1, (2, 2)) * _pick(rng, SIZES_DEG)
    width = 10.0 ** rng.uniform(-17, -6)
    return _area(rng, common, [_place(rng) + np.array([a, b, 0.5 * (a + b) + rng.uniform(-1, 1, 2) * width])])


def spike(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    size, width, length = _pick(rng, SIZES_DEG[3:]), 10.0 ** rng.uniform(-16, -6), 10.0 ** rng.uniform(-6, 2)
    sign = _pick(rng, (1, -1))  # outward or a dent
    ring = [(0, 0), (size, 0), (size, size), (0.5 * size + width, size)]
    ring += [
        (0.5 * size, size + sign * min(length, 0.99 * size if sign < 0 else 1e9)),
        (0.5 * size - width, size),
        (0, size),
    ]
    return _area(rng, common, [_place(rng) + np.array(ring)])


def scribble(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    """The result of make_valid for a random ring: parts that touch, holes, dents."""
    size = _pick(rng, SIZES_DEG[1:])
    ring = _place(rng) + rng.uniform(-1, 1, (int(rng.integers(4, 20)), 2)) * size * [1.0, rng.choice([1.0, 1e-7])]
    if rng.random() < 0.3:
        return _area(rng, common, [ring])
    made = shapely.make_valid(shapely.Polygon(np.nan_to_num(ring)))
    parts = [p for p in shapely.get_parts(made) if p.geom_type == "Polygon"] or [shapely.Polygon(ring)]
    return _area(rng, common, *([[*r.coords] for r in (p.exterior, *p.interiors)] for p in parts))


def holes(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    size, gap = _pick(rng, SIZES_DEG[2:]), 10.0 ** rng.uniform(-16, -1)
    unit = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    place = _place(rng)
    rings = [place + unit * size, place + (unit[::-1] * (1 - 2 * gap) + gap) * size]
    if rng.random() < 0.3:
        rings[1] = place + np.array([(0.5, 0), (0.9, 0.5), (0.5, 0.9), (0.1, 0.5)]) * size  # touches the ring
    return _area(rng, common, rings)


def comb(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    size, teeth = _pick(rng, SIZES_DEG[2:]), int(rng.integers(2, 60))
    x = np.repeat(np.arange(2 * teeth + 1), 2)[1:-1] / (2.0 * teeth)
    y = np.tile([0.0, 0.0, 1.0, 1.0], teeth)[: len(x)] * (1 - 10.0 ** rng.uniform(-15, -1)) + 1e-12
    ring = [*np.stack([x, y], axis=1), (1.0, -1.0), (0.0, -1.0)]
    return _area(rng, common, [_place(rng) + np.array(ring) * size])


def polar(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    low, top = rng.uniform(60, 89.9), _pick(rng, (90.0, 89.0, 88.9999, 90.0 - 1e-12))
    west = _pick(rng, (-180.0, 0.0, -360.0, 17.0))
    lon = np.linspace(west, west + _pick(rng, (360.0, 359.999999, 180.0, 1.0)), int(rng.integers(3, 40)))
    ring = np.array([*[(x, low) for x in lon], (lon[-1], top), (lon[0], top)]) * [1, _pick(rng, (1, -1))]
    return _area(rng, common, [ring])


def wide(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    """Long edges, narrow bands: rings that nearly cross where they are great circles."""
    west, width, lat = (
        rng.uniform(-300, 0),
        _pick(rng, (40.0, 80.0, 119.0, 180.0, 359.9999, 360.0)),
        rng.uniform(-80, 80),
    )
    thick = 10.0 ** rng.uniform(-10, 1)
    n = int(rng.integers(2, 6))
    upper = [(west + width * k / (n - 1), lat + thick) for k in range(n)][::-1]
    return _area(rng, common, [[(west, lat), (west + width, lat), *upper]])


def seam(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    lat, size = rng.uniform(-88, 80), _pick(rng, SIZES_DEG[1:6])
    east = _pick(rng, (180.0, 180.0 + 0.5 * size, 360.0, -180.0 + 0.5 * size, -360.0 + size))
    one = [(east - size, lat), (east, lat), (east, lat + size), (east - size, lat + size)]
    two = [(-180.0, lat), (-180.0 + size, lat), (-180.0 + size, lat + size), (-180.0, lat + size)]
    return _area(rng, common, [one], *([[two]] if rng.random() < 0.5 else []))


def broken(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    """Invalid polygons: numbers that are NaN or infinite, rings of too few points."""
    ring = [*_place(rng) + np.array([(0, 0), (1, 0), (1, 1), (0, 1)])]
    kind = rng.integers(4)
    if kind == 0:
        ring[rng.integers(4)][rng.integers(2)] = _pick(rng, NUMBERS)
    elif kind == 1:
        ring = ring[: rng.integers(0, 3)]
    elif kind == 2:
        ring = [ring[0]] * 4
    else:
        ring = [p for p in ring for _ in range(3)]
    return _area(rng, common, [ring])


def _outline(rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    kind, size = rng.integers(8), _pick(rng, SIZES_M)
    if kind == 0:
        points = [(0.0, 0.0)]
    elif kind == 1:
        points = [(0.0, size), (_pick(rng, (0.0, 1e-9, size)), -size)]
    elif kind == 2:
        points = [(size, 1e-9), (size, -1e-9), (-size, -1e-9), (-size, 1e-9)]
    elif kind == 3:  # far from its reference point
        far = _pick(rng, SIZES_M)
        points = [(far, far), (far + size, far), (far, far + size)]
    elif kind == 4:
        angle = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 40))))[:: _pick(rng, (1, -1))]
        points = list(zip((size * np.cos(angle)).tolist(), (size * np.sin(angle)).tolist(), strict=True))
    elif kind == 5:  # straight corners, vertices twice
        points = [(size, size), (size, 0.0), (size, -size), (size, -size), (-size, -size), (-size, size)]
    elif kind == 6:
        points = [(float(x), float(y)) for x, y in rng.uniform(-1, 1, (5, 2)) * size]
    else:
        points = [(size, size), (size, -size), (-size, -size), (_pick(rng, NUMBERS), size)]
    return tuple(points)


def _track(rng: np.random.Generator, common: dict[str, Any], places: Any, times: Any) -> Hostile:
    path = tuple((float(p[0]), float(p[1]), float(t)) for p, t in zip(places, times, strict=True))
    grow, outlines = 0.0, ()
    if rng.random() < 0.15:
        grow = _pick(rng, (1e-12, 0.1, 100.0, 1e6, -1.0, math.nan, math.inf))
    elif rng.random() < 0.15:
        base, end = np.array(_outline(rng)), 10.0 ** rng.uniform(-3, 3)
        turned = base[:, ::-1] if rng.random() < 0.2 else base
        with np.errstate(over="ignore"):  # numbers that are too large become infinite
            outlines = tuple(
                tuple(map(tuple, ((turned if k % 2 else base) * (end if k % 3 else 1.0)).tolist()))
                for k in range(len(path))
            )
    return Hostile(
        path=path, outline=outlines[0] if outlines else _outline(rng), grow_mps=grow, outlines=outlines, **common
    )


def _times(rng: np.random.Generator, n: int) -> np.ndarray:
    start = _pick(rng, (0.0, 1.7e9, 1.7e9, 1.7e9, -1e9, -62135596800.0, 2e11))
    step = _pick(rng, (1e-6, 1.0, 60.0, 3600.0, 3600.0, 86400.0, 3e7, 3e10))
    times = start + step * np.arange(n)
    if rng.random() < 0.1:
        times[rng.integers(n)] = _pick(rng, (math.nan, math.inf, 1e15, times[0], -1e15))
    return times


def voyage(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    n, size = int(rng.integers(1, 8)), _pick(rng, SIZES_DEG)
    places = _place(rng) + rng.uniform(-1, 1, (n, 2)) * size
    return _track(rng, common, places, _times(rng, n))


def loiter(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    place, n = _place(rng), int(rng.integers(2, 6))
    return _track(
        rng, common, place + np.repeat(rng.uniform(0, _pick(rng, SIZES_DEG), (n, 2)), 2, axis=0), _times(rng, 2 * n)
    )


def round_the_earth(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    n, step = int(rng.integers(3, 60)), _pick(rng, (90.0, 170.0, 179.9999999, 180.0, -120.0))
    lon = np.mod(np.arange(n) * step + rng.uniform(0, 360) + 180.0, 360.0) - 180.0
    lat = _pick(rng, (np.zeros(n), rng.uniform(-85, 85, n), np.linspace(-89, 89, n)))
    return _track(rng, common, np.stack([lon, lat], axis=1), _times(rng, n))


def over_the_pole(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    lat = _pick(rng, (88.0, 88.9999999, 89.0, 89.9999999, 90.0))
    lon = _pick(rng, (0.0, 10.0, 180.0, 179.9999999))
    places = [(0.0, lat), (lon, lat), (lon, _pick(rng, (80.0, 90.0, 89.0)))]
    return _track(rng, common, np.array(places) * [1, _pick(rng, (1, -1))], _times(rng, 3))


def still(rng: np.random.Generator, common: dict[str, Any]) -> Hostile:
    """A leg of almost nothing: fractions of a micrometre, or of a microsecond."""
    place = _place(rng)
    return _track(rng, common, [place, place + 10.0 ** rng.uniform(-16, -9, 2)], _times(rng, 2))


AREAS = (box, sliver, spike, scribble, holes, comb, polar, wide, seam, broken)
TRACKS = (voyage, loiter, round_the_earth, over_the_pole, still)


def _iso(seconds: float | None) -> str | None:
    if seconds is None:
        return None
    if not -62135596800.0 <= seconds < 253402300800.0:
        return str(seconds)
    moment = np.datetime64(round(seconds * 1e6), "us")
    return f"{moment}Z"


def _closed(ring: Any) -> Ring:
    points = [(float(x), float(y)) for x, y in ring]
    if len(points) < 3:
        points = [points[0], points[-1], points[-1]] if points else []
    return [*points, points[0]] if points else []


def _header(kind: int, srid: int) -> bytes:
    return struct.pack("<BII", 1, kind | 0x20000000, srid) if srid else struct.pack("<BI", 1, kind)


def _polygon(rings: Any, srid: int) -> str:
    body = b"".join(struct.pack("<I", len(ring)) + b"".join(struct.pack("<dd", *p) for p in ring) for ring in rings)
    return (_header(3, srid) + struct.pack("<I", len(rings)) + body).hex()


def _multipolygon(parts: Any, srid: int) -> str:
    return (_header(6, srid) + struct.pack("<I", len(parts))).hex() + "".join(_polygon(part, 0) for part in parts)


def _line(path: Any) -> str:
    body = b"".join(struct.pack("<ddd", *p) for p in path)
    return (_header(2 | 0x40000000, 4326) + struct.pack("<I", len(path)) + body).hex()
