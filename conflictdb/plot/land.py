"""Read coastlines and places of Natural Earth, for figures and as GeoJSON for the page.

map/vendor/land-50m.json.gz and land-10m.json.gz are TopoJSON
(https://github.com/topojson/topojson-specification): rings of arcs, which are integer differences on a grid.
"""

import gzip
import json
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

Box = tuple[float, float, float, float]  # west, south, east, north: degrees

WORLD: Final[Box] = (-180.0, -90.0, 180.0, 90.0)
COARSE: Final = "50m"
FINE: Final = "10m"
# Decimals of degrees: 10 m.
_DIGITS: Final = 4


# Antarctica reaches the pole; ring points nearer to it than this come from cutting the file.
_POLE_DEG: Final = 90.0
_CUT_DEG: Final = 89.9
_TURN_DEG: Final = 360.0


@dataclass(frozen=True, slots=True)
class Land:
    """All land between the longitudes -180 and 180: polygons, and coastlines without the cuts."""

    polygons: NDArray[Any]
    coasts: NDArray[Any]


@cache
def land(detail: str) -> Land:
    """Return all land in one of two details, COARSE or FINE."""
    text = (files("conflictdb") / "map" / "vendor" / f"land-{detail}.json.gz").read_bytes()
    topology, arcs = _topology(gzip.decompress(text).decode())
    scale, shift = np.array(topology["transform"]["scale"]), np.array(topology["transform"]["translate"])
    arcs = [np.cumsum(arc, axis=0) * scale + shift for arc in arcs]

    def ring(numbers: list[int]) -> NDArray[np.float64]:
        # ~n is arc n backward. Each begins at the end of the one before. Longitudes continue beyond 180.
        parts = [arcs[n] if n >= 0 else arcs[~n][::-1] for n in numbers]
        places = np.concatenate([parts[0], *(part[1:] for part in parts[1:])])
        if np.abs(np.diff(places[:, 0])).max() > _TURN_DEG / 2:
            places[:, 0] = np.unwrap(places[:, 0], period=_TURN_DEG)
        return places

    (collection,) = topology["objects"].values()
    polygons, coasts = [], []
    for one in collection["geometries"]:
        for numbers in [one["arcs"]] if one["type"] == "Polygon" else one["arcs"]:
            shell, *holes = (known for known in map(ring, numbers) if known[:, 1].max() > -_CUT_DEG)
            coasts += [shell, *holes]
            polygons.append(shapely.Polygon(_closed(shell), [_beside(hole, shell) for hole in holes]))
    return Land(_cut(polygons), _cut([shapely.LineString(coast) for coast in coasts]))


def _topology(text: str) -> tuple[Any, list[NDArray[Any]]]:
    """Parse TopoJSON without its arcs, and these as arrays (n, 2)."""
    first = text.rindex('"arcs":[[[') + len('"arcs":')
    end = text.index("]]]", first) + len("]]]")
    arcs = text[first:end]
    counts = [arc.count("],[") + 1 for arc in arcs.split("]],[[")]
    points = np.fromstring(arcs.replace("[", "").replace("]", ""), np.int64, sep=",").reshape(-1, 2)
    return json.loads(f"{text[:first]}[]{text[end:]}"), np.split(points, np.cumsum(counts)[:-1])


@cache
def places() -> list[dict[str, Any]]:
    """Return countries and towns: name, kind, longitude, latitude, and the zoom from which maps show them."""
    text = (files("conflictdb") / "map" / "vendor" / "places.json").read_text(encoding="utf-8")
    return [dict(zip(("name", "kind", "lon", "lat", "zoom"), row, strict=True)) for row in json.loads(text)]


def _closed(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Close a ring around the south pole along the pole; return other rings unchanged."""
    (first, _), (last, _) = ring[0], ring[-1]
    if abs(last - first) < _TURN_DEG / 2:
        return ring
    return np.vstack([ring, [[last, -_POLE_DEG], [first, -_POLE_DEG]]])


def _beside(hole: NDArray[np.float64], shell: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a hole shifted by full turns to its shell."""
    west, east = shell[:, 0].min(), shell[:, 0].max()
    turn = np.round((0.5 * (west + east) - hole[:, 0].mean()) / _TURN_DEG) * _TURN_DEG
    return hole + np.array([turn, 0.0])


def _cut(shapes: list[Any]) -> NDArray[Any]:
    """Cut shapes, polygons or lines, to the longitudes -180 to 180."""
    parts = np.array(shapes, dtype=object)
    west, _, east, _ = shapely.bounds(parts).T
    is_within = (west >= -180.0) & (east <= 180.0)
    turned = [
        shapely.clip_by_rect(
            shapely.transform(parts[~is_within], lambda places, by=by: places + np.array([by, 0.0])), *WORLD
        )
        for by in (-_TURN_DEG, 0.0, _TURN_DEG)
    ]
    return _alike(np.concatenate([parts[is_within], *turned]), shapes[0])


@lru_cache(maxsize=8)  # the whole world takes 0.3 s and 2 MB
def geojson(detail: str, box: Box, but: Box | None = None) -> str:
    """Return the land in a box, without another box, as GeoJSON rounded to 10 m.

    It has two features: the polygons (`kind` is land) and the lines of their coasts (coast).
    """
    whole = land(detail)
    features = [
        {"type": "Feature", "properties": {"kind": kind}, "geometry": shapely.geometry.mapping(_rounded(shape))}
        for kind, shape in (
            ("land", shapely.MultiPolygon(list(_part(whole.polygons, box, but)))),
            ("coast", shapely.MultiLineString(list(_part(whole.coasts, box, but)))),
        )
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}, separators=(",", ":"))


def polygons(detail: str, box: Box) -> NDArray[Any]:
    """Return the land in a box, as polygons in degrees."""
    return _part(land(detail).polygons, box, None)


def _part(shapes: NDArray[Any], box: Box, but: Box | None) -> NDArray[Any]:
    """Return the parts of polygons or lines in a box, without another box."""
    first = shapes[0]
    if box != WORLD:
        shapes = shapely.clip_by_rect(shapes[shapely.intersects(shapely.box(*box), shapely.envelope(shapes))], *box)
    if but is not None:
        is_near = shapely.intersects(shapely.box(*but), shapely.envelope(shapes))
        near = shapely.make_valid(shapes[is_near])
        shapes = np.concatenate([shapes[~is_near], shapely.difference(near, shapely.box(*but))])
    return _alike(shapes, first)


def _alike(shapes: NDArray[Any], one: Any) -> NDArray[Any]:
    """Return the non-empty parts of shapes that have the type of a sample."""
    parts = shapely.get_parts(shapes)
    return parts[(shapely.get_type_id(parts) == shapely.get_type_id(one)) & ~shapely.is_empty(parts)]


def _rounded(shape: Any) -> Any:
    return shapely.transform(shape, lambda places: np.round(places, _DIGITS))
