"""Write areas and tracks as KML 2.2: polygons, and gx:Tracks of reference points.

Members that KML has no room for are ExtendedData, named as in scene files. KML draws sides straight in longitude and
latitude: long sides have vertices along the lines of the scene.
"""

from collections.abc import Iterator, Sequence
from itertools import chain, count
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.formats.file_objects import area_properties, datum_of, track_properties
from conflictdb.formats.instants import format_instant
from conflictdb.formats.json_text import dumped
from conflictdb.formats.rings import along_lines
from conflictdb.formats.single_activations import spans_of, voyages_of
from conflictdb.formats.xml_text import writable, written
from conflictdb.model.plans import Area, Scene, Track

# An owner has at most 200 bytes.
_LONGEST_START: Final = 180
# Members that the placemarks show.
_TIMES: Final = frozenset({"kind", "start", "end", "times", "spans", "schedule", "departures"})


def kml_lines(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    """Yield the lines of a file of objects."""
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield '<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>\n'
    yield written("name", text=writable("scene", "name", scene.name)) + "\n"
    owners = _Owners([*areas, *tracks])
    from conflictdb.core.world import World  # needs the kernel

    setup = World.around(scene, areas, tracks).setup
    for area in areas:
        spans = spans_of(area)
        owner = owners.of_parts(area, len(spans))
        for number, span in enumerate(spans, 1):
            key = area.key if len(spans) == 1 else f"{area.key}/{number}"
            members = area_properties(area) | datum_of(scene, area) | owner
            yield _placemark(key, members, _span(span), _polygons(along_lines(setup, area.footprint))) + "\n"
    for track in tracks:
        voyages = list(voyages_of(track))
        owner = owners.of_parts(track, len(voyages))
        for number, voyage in enumerate(voyages, 1):
            key = track.key if len(voyages) == 1 else f"{track.key}/{number}"
            whens = (written("when", text=format_instant(int(time))) for time in voyage.times_us)
            coords = (written("gx:coord", text=f"{lon!r} {lat!r} 0") for lon, lat in voyage.positions_deg.tolist())
            shape = written("gx:Track", None, *whens, *coords)
            members = track_properties(voyage) | datum_of(scene, track) | owner
            yield _placemark(key, members, "", shape) + "\n"
    yield "</Document></kml>\n"


class _Owners:
    """Owners of the parts of objects, which are not compared with each other."""

    def __init__(self, objects: Sequence[Area | Track]) -> None:
        self._used = {one.owner for one in objects}

    def of_parts(self, item: Area | Track, parts: int) -> dict[str, str]:
        """Return the member `owner` of the parts of an object; none if it has an owner, or is written as one part."""
        if parts == 1 or item.owner is not None:
            return {}
        start = item.key.encode()[:_LONGEST_START].decode(errors="ignore")
        names = chain([start], (f"{start}/{number}" for number in count(1)))
        owner = next(name for name in names if name not in self._used)
        self._used.add(owner)
        return {"owner": owner}


def _placemark(key: str, members: dict[str, Any], span: str, shape: str) -> str:
    data = {"id": key} | {name: one for name, one in members.items() if name not in _TIMES}
    # Without a schema: OGR reads either Data or SchemaData of a placemark.
    values = (
        written(
            "Data",
            {"name": writable(f"object {key!r}", "properties", name)},
            written("value", text=writable(f"object {key!r}", name, one if isinstance(one, str) else dumped(one))),
        )
        for name, one in data.items()
    )
    return written("Placemark", None, written("name", text=key), span, written("ExtendedData", None, *values), shape)


def _span(span_us: tuple[int | None, int | None]) -> str:
    ends = zip(("begin", "end"), span_us, strict=True)
    inside = [written(name, text=format_instant(one)) for name, one in ends if one is not None]
    return written("TimeSpan", None, *inside) if inside else ""


def _polygons(footprint: shapely.MultiPolygon) -> str:
    polygons = [
        written(
            "Polygon",
            None,
            written("outerBoundaryIs", None, _ring(shapely.get_coordinates(part.exterior))),
            *(written("innerBoundaryIs", None, _ring(shapely.get_coordinates(ring))) for ring in part.interiors),
        )
        for part in footprint.geoms
    ]
    return polygons[0] if len(polygons) == 1 else written("MultiGeometry", None, *polygons)


def _ring(positions_deg: NDArray[np.float64]) -> str:
    text = " ".join(f"{lon!r},{lat!r}" for lon, lat in positions_deg.tolist())
    return written("LinearRing", None, written("coordinates", text=text))
