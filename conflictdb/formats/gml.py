"""Read geometries of GML 3.2 as AIXM and S-100 use it: points, curves of lines and arcs, and surfaces.

Geodesics are followed within half a metre. Arcs that bulge outward are contained by the polygon, which exceeds their
radius by at most a thousandth; arcs that bulge inward are replaced by chords, which lie outside the area.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.earth.geodesy import shorter_way_deg
from conflictdb.errors import InvalidInput
from conflictdb.formats.areas_of_files import Gathered, along_shortest_lines
from conflictdb.formats.discs import MAX_RADIUS_M, places_at
from conflictdb.formats.values_of_xml import number_of
from conflictdb.formats.xml_text import Element
from conflictdb.model.plans import METRES_PER_NMI, EarthModel

Floats = NDArray[np.float64]

# As EPSG:4326, urn:ogc:def:crs:EPSG::4326, http://www.opengis.net/def/crs/EPSG/0/4326, and of older files.
_LATITUDE_FIRST: Final = re.compile(
    r"(?:.*[:/])?EPSG[:/](?:[\d.]*[:/])?(?:4326|4979)|.*epsg\.xml#4326", re.IGNORECASE | re.ASCII
)
_LONGITUDE_FIRST: Final = re.compile(r"(?:.*[:/])?CRS:?84h?", re.IGNORECASE)
_LONGEST_SYSTEM: Final = 200
_METRES: Final = {"m": 1.0, "km": 1000.0, "nm": METRES_PER_NMI, "[nmi_i]": METRES_PER_NMI, "ft": 0.3048, "mi": 1609.344}
_LINES: Final = ("LineStringSegment", "LineString", "LinearRing")
_GEODESICS: Final = ("GeodesicString", "Geodesic")
# Corners of a full circle: half a thousandth of the radius, and no more than so many metres apart.
_LEAST_CORNERS: Final = 128
_MOST_APART_M: Final = 5_000.0
# Ends of parts of a curve that are no further apart are one position; further, there is a gap.
_SAME_DEG: Final = 2e-5
_GAP_DEG: Final = 2e-3


@dataclass(frozen=True, slots=True)
class _Arc:
    """An arc around a centre, from one azimuth to another, degrees clockwise from north."""

    lon_deg: float
    lat_deg: float
    radius_m: float
    start_deg: float
    end_deg: float

    def positions(self, *, is_outward: bool) -> Floats:
        """Return positions (n, 2); those of an arc that bulges outward lie on its tangents, others on it."""
        turn = self.end_deg - self.start_deg
        corners = max(_LEAST_CORNERS, int(np.ceil(2.0 * np.pi * self.radius_m / _MOST_APART_M)))
        count = max(2, int(np.ceil(abs(turn) / 360.0 * corners)))
        step = turn / count
        azimuth: Floats = self.start_deg + step * np.arange(count + 1, dtype=np.float64)
        radius = self.radius_m
        if is_outward:
            azimuth = np.concatenate([azimuth[:1], azimuth[:-1] + 0.5 * step, azimuth[-1:]])
            radius /= float(np.cos(np.radians(0.5 * abs(step))))
        line = self._at(azimuth, radius)
        line[[0, -1]] = self._at(azimuth[[0, -1]], self.radius_m)
        return line

    def _at(self, azimuth_deg: Floats, radius_m: float) -> Floats:
        azimuth = np.radians(azimuth_deg)
        return np.stack(places_at(self.lon_deg, self.lat_deg, radius_m, azimuth, EarthModel.WGS84), axis=1)


class Geometries:
    """A reader of the geometries of one object.

    who : the object, as the user knows it
    points : of the file, by their ids, to which geometries may refer
    latitude_first : order of coordinates where no reference system is named
    """

    def __init__(
        self, who: str, found: Gathered, points: Mapping[str, Element], *, latitude_first: bool | None = None
    ) -> None:
        self.who = who
        self.found = found
        self.points = points
        self.latitude_first = latitude_first

    def refusal(self, element: Element, rule: str) -> InvalidInput:
        """Return the error of a geometry."""
        return InvalidInput(self.who, f"{element.name} in line {element.line}", rule)

    def surfaces(self, element: Element) -> shapely.MultiPolygon:
        """Return the polygons of a Surface, Polygon or MultiSurface; raises InvalidInput."""
        polygons: list[shapely.Polygon] = []
        for patch, order in self._patches(element, self._order(element, self.latitude_first)):
            exterior = patch.child("exterior")
            if exterior is None:
                raise self.refusal(patch, "has no exterior")
            circle = self._circle(exterior, order)
            holes = [self._ring(hole, order, is_hole=True) for hole in patch.each("interior")]
            if circle is not None:
                polygons += [shapely.Polygon(one.exterior, holes) for one in circle.geoms]
            else:
                polygons.append(shapely.Polygon(self._ring(exterior, order), holes))
        if not polygons:
            raise self.refusal(element, "holds no polygon that is read here")
        return shapely.MultiPolygon(polygons)

    def point(self, element: Element) -> tuple[float, float]:
        """Return longitude and latitude of a Point; raises InvalidInput."""
        positions = self._positions(element, self._order(element, self.latitude_first))
        return float(positions[0, 0]), float(positions[0, 1])

    def curve(self, element: Element) -> Floats:
        """Return the positions (n, 2) of a Curve or LineString; raises InvalidInput."""
        return self._joined(element, list(self._parts(element, self._order(element, self.latitude_first))), {})

    def _patches(self, element: Element, order: bool | None) -> Iterator[tuple[Element, bool | None]]:
        order = self._order(element, order)
        if element.name in ("PolygonPatch", "Polygon"):
            yield element, order
            return
        for child in element.children:
            if child.attributes.get("href") is not None and not child.children:
                raise self.refusal(child, f"is elsewhere, in {child.attributes['href']:.80}")
            yield from self._patches(child, order)

    def _order(self, element: Element, inherited: bool | None) -> bool | None:
        """Return whether latitude comes first in a geometry."""
        name = element.get("srsName")
        if name is None:
            return inherited
        if len(name) <= _LONGEST_SYSTEM and _LATITUDE_FIRST.fullmatch(name):
            return True
        if len(name) <= _LONGEST_SYSTEM and _LONGITUDE_FIRST.fullmatch(name):
            return False
        raise self.refusal(element, f"has the reference system {name:.60}; read are EPSG:4326 and CRS84")

    def _positions(self, element: Element, order: bool | None) -> Floats:
        """Return the positions (n, 2) that an element's children of type pos and posList give."""
        numbers: list[float] = []
        for child in element.children:
            if child.name in ("pos", "posList"):
                order = self._order(child, self._order(element, order))
                width = child.get("srsDimension") or element.get("srsDimension") or "2"
                if width not in ("2", "3"):
                    raise self.refusal(child, f"must have 2 or 3 dimensions; got {width:.20}")
                values = [number_of(self.who, f"{child.name} in line {child.line}", one) for one in child.text.split()]
                if len(values) % int(width):
                    raise self.refusal(child, f"must be positions of {width} numbers each; got {len(values)} numbers")
                numbers += [one for i, one in enumerate(values) if i % int(width) < 2]
            elif child.name in ("pointProperty", "pointRep", "Point"):
                href = child.attributes.get("href", "").removeprefix("#")
                place = self._positions(self.points.get(href, child), order)
                numbers += (place[:, ::-1] if order else place).ravel().tolist()
        if not numbers:
            raise self.refusal(element, "has no positions: pos and posList are read")
        if order is None:
            raise self.refusal(element, "names no reference system, so the order of its coordinates is unknown")
        positions = np.array(numbers, np.float64).reshape(-1, 2)
        return positions[:, ::-1] if order else positions

    def _circle(self, ring: Element, order: bool | None) -> shapely.MultiPolygon | None:
        """Return a polygon around the circle that is all of a ring, None if the ring is another one."""
        parts = list(self._parts(ring, order))
        if len(parts) != 1 or not isinstance(parts[0], _Arc) or abs(parts[0].end_deg - parts[0].start_deg) != 360.0:
            return None
        arc = parts[0]
        return self.found.circle(self.who, arc.lon_deg, arc.lat_deg, arc.radius_m)

    def _ring(self, ring: Element, order: bool | None, *, is_hole: bool = False) -> Floats:
        """Return the closed positions (n, 2) of an exterior or interior."""
        parts = list(self._parts(ring, order))
        outline = self._joined(ring, parts, {})
        east, north = np.diff(outline[:, 0]), outline[:-1, 1] + outline[1:, 1]
        is_clockwise = float((east * north).sum()) > 0.0
        ways = {
            i: (part.end_deg > part.start_deg) == (is_clockwise != is_hole)
            for i, part in enumerate(parts)
            if isinstance(part, _Arc)
        }
        outline = self._joined(ring, parts, ways)
        if np.abs(outline[0] - outline[-1]).max() > _GAP_DEG:
            raise self.refusal(ring, "must be closed: its last position must equal its first")
        outline[-1] = outline[0]
        if len(outline) < 4:
            raise self.refusal(ring, f"needs at least three positions; got {len(outline) - 1}")
        return outline

    def _parts(self, element: Element, order: bool | None) -> Iterator["Floats | _Arc"]:
        """Yield the lines and arcs of a curve, in their order."""
        order = self._order(element, order)
        if element.name in _LINES:
            yield self._positions(element, order)
        elif element.name in _GEODESICS:
            yield along_shortest_lines(self.who, element.name, self._positions(element, order))
        elif element.name in ("ArcByCenterPoint", "CircleByCenterPoint"):
            yield self._arc(element, order)
        elif element.name in ("Arc", "ArcString", "Circle", "ArcByBulge", "BSpline", "Clothoid", "OrientableCurve"):
            raise self.refusal(element, "is a curve that is not read here")
        else:
            for child in element.children:
                if child.attributes.get("href") is not None and not child.children:
                    raise self.refusal(child, f"is elsewhere, in {child.attributes['href']:.80}")
                yield from self._parts(child, order)

    def _arc(self, element: Element, order: bool | None) -> _Arc:
        centre = self._positions(element, order)[0]
        radius = element.child("radius")
        unit = None if radius is None else radius.get("uom")
        if radius is None or unit is None or unit.lower() not in _METRES:
            raise self.refusal(element, f"needs a radius with a unit of {', '.join(_METRES)}; got {unit!r:.20}")
        radius_m = number_of(self.who, f"radius in line {radius.line}", radius.text) * _METRES[unit.lower()]
        if not 0.0 < radius_m <= MAX_RADIUS_M:
            raise self.refusal(radius, f"must be above 0 and at most {MAX_RADIUS_M:,.0f} metres; got {radius_m:g}")
        if element.name == "CircleByCenterPoint":
            return _Arc(float(centre[0]), float(centre[1]), radius_m, 0.0, 360.0)
        angles = [self._angle(element, name) for name in ("startAngle", "endAngle")]
        if order is False:  # from east, counterclockwise, where longitude comes first
            angles = [90.0 - angle for angle in angles]
        if not 0.0 < abs(angles[1] - angles[0]) <= 360.0:
            raise self.refusal(element, "must span more than 0 and at most 360 degrees")
        return _Arc(float(centre[0]), float(centre[1]), radius_m, *angles)

    def _angle(self, element: Element, name: str) -> float:
        angle = element.child(name)
        if angle is None or (angle.get("uom") or "deg") not in ("deg", "°"):
            raise self.refusal(element, f"needs {name} in degrees")
        return number_of(self.who, f"{name} in line {angle.line}", angle.text)

    def _joined(self, element: Element, parts: "list[Floats | _Arc]", ways: dict[int, bool]) -> Floats:
        """Return the positions (n, 2) of a curve of parts, each beginning where the one before ends.

        ways : whether arcs bulge outward, by their place
        """
        lines: list[Floats] = []
        for i, part in enumerate(parts):
            line = part.positions(is_outward=ways.get(i, False)) if isinstance(part, _Arc) else part
            if lines:
                apart = float(np.abs(lines[-1][-1] - line[0]).max())
                if apart > _GAP_DEG:
                    raise self.refusal(element, f"has a gap of {apart:g} degrees between two parts of its curve")
                if apart <= _SAME_DEG:
                    line = line[1:]
            lines.append(line)
        if not lines or not sum(map(len, lines)):
            raise self.refusal(element, "has no positions")
        line = np.concatenate(lines)
        turns = np.diff(line[:, 0])
        if np.abs(turns).max(initial=0.0) > 180.0:  # over the antimeridian
            line[1:, 0] = line[0, 0] + np.cumsum(shorter_way_deg(turns))
        return line
