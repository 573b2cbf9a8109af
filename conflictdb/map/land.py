"""Coastlines of Natural Earth, as GeoJSON.

vendor/land-50m.json.gz and land-10m.json.gz are TopoJSON (https://github.com/topojson/topojson-specification): rings
are made of arcs, of whole numbers that are differences, on a grid.
"""

import gzip
import json
from functools import cache
from importlib.resources import files
from typing import Any, Final

import numpy as np
import shapely

Box = tuple[float, float, float, float]  # west, south, east, north: degrees

WORLD: Final[Box] = (-180.0, -90.0, 180.0, 90.0)
COARSE: Final = "50m"
FINE: Final = "10m"
# Digits of degrees: 10 m.
_DIGITS: Final = 4


@cache
def land(detail: str) -> shapely.MultiPolygon:
    """Return all land in one of two details, COARSE or FINE."""
    text = (files("conflictdb") / "map" / "vendor" / f"land-{detail}.json.gz").read_bytes()
    topology = json.loads(gzip.decompress(text))
    scale, shift = np.array(topology["transform"]["scale"]), np.array(topology["transform"]["translate"])
    arcs = [np.cumsum(np.array(arc), axis=0) * scale + shift for arc in topology["arcs"]]

    def ring(numbers: list[int]) -> Any:
        # ~n is arc n backward. Each begins where the one before it ends.
        parts = [arcs[n] if n >= 0 else arcs[~n][::-1] for n in numbers]
        return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])

    (collection,) = topology["objects"].values()
    polygons = [
        shapely.Polygon(ring(rings[0]), [ring(hole) for hole in rings[1:]])
        for one in collection["geometries"]
        for rings in ([one["arcs"]] if one["type"] == "Polygon" else one["arcs"])
    ]
    return shapely.MultiPolygon(polygons)


def geojson(detail: str, box: Box, but: Box | None = None) -> str:
    """Return the land in a box, but not in another one, as a GeoJSON geometry: within 10 m of what it is made from."""
    shape = land(detail)
    if box != WORLD:
        parts = np.array(shape.geoms)
        near = parts[shapely.intersects(shapely.box(*box), shapely.envelope(parts))]
        shape = shapely.clip_by_rect(shapely.MultiPolygon(list(near)), *box)
    if but is not None:
        parts = np.array(shapely.get_parts(shape))
        near = shapely.intersects(shapely.box(*but), shapely.envelope(parts))
        cut = shapely.difference(shapely.make_valid(parts[near]), shapely.box(*but))
        polygons = [one for one in shapely.get_parts([*parts[~near], *cut]) if one.geom_type == "Polygon"]
        shape = shapely.MultiPolygon(polygons)
    rounded = shapely.transform(shape, lambda places: np.round(places, _DIGITS))
    return json.dumps(shapely.geometry.mapping(rounded), separators=(",", ":"))
