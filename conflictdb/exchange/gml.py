"""Read geometries of GML 3.2 as AIXM and S-100 use it: points, curves of lines and arcs, and surfaces.

Geodesics are followed within half a metre. Arcs that bulge outward are contained by the polygon, which exceeds their
radius by at most a thousandth; arcs that bulge inward are replaced by chords, which lie outside the area.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.exchange.arcs import Arc, joined, outward
from conflictdb.formats.areas_of_files import Gathered, along_shortest_lines
from conflictdb.formats.discs import MAX_RADIUS_M
from conflictdb.formats.values_of_xml import number_of
from conflictdb.formats.xml_text import Element
from conflictdb.model.plans import METRES_PER_NMI, POLE_RULE

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
# Ends of parts of a curve that are further apart leave a gap.
_GAP_DEG: Final = 2e-3


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
        if len(parts) != 1 or not isinstance(parts[0], Arc) or abs(parts[0].end_deg - parts[0].start_deg) != 360.0:
            return None
        arc = parts[0]
        return self.found.circle(self.who, arc.lon_deg, arc.lat_deg, arc.radius_m)

    def _ring(self, ring: Element, order: bool | None, *, is_hole: bool = False) -> Floats:
        """Return the closed positions (n, 2) of an exterior or interior."""
        parts = list(self._parts(ring, order))
        outline = self._joined(ring, parts, outward(self._joined(ring, parts, {}), parts, is_hole=is_hole))
        if abs(abs(outline[0, 0] - outline[-1, 0]) - 360.0) <= _GAP_DEG:
            raise self.refusal(ring, f"must be a ring{POLE_RULE}")
        if np.abs(outline[0] - outline[-1]).max() > _GAP_DEG:
            raise self.refusal(ring, "must be closed: its last position must equal its first")
        outline[-1] = outline[0]
        if len(outline) < 4:
            raise self.refusal(ring, f"needs at least three positions; got {len(outline) - 1}")
        return outline

    def _parts(self, element: Element, order: bool | None) -> Iterator["Floats | Arc"]:
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

    def _arc(self, element: Element, order: bool | None) -> Arc:
        centre = self._positions(element, order)[0]
        radius = element.child("radius")
        unit = None if radius is None else radius.get("uom")
        if radius is None or unit is None or unit.lower() not in _METRES:
            raise self.refusal(element, f"needs a radius with a unit of {', '.join(_METRES)}; got {unit!r:.20}")
        radius_m = number_of(self.who, f"radius in line {radius.line}", radius.text) * _METRES[unit.lower()]
        if not 0.0 < radius_m <= MAX_RADIUS_M:
            raise self.refusal(radius, f"must be above 0 and at most {MAX_RADIUS_M:,.0f} metres; got {radius_m:g}")
        if element.name == "CircleByCenterPoint":
            return Arc(float(centre[0]), float(centre[1]), radius_m, 0.0, 360.0)
        angles = [self._angle(element, name) for name in ("startAngle", "endAngle")]
        if order is False:  # from east, counterclockwise, where longitude comes first
            angles = [90.0 - angle for angle in angles]
        if not 0.0 < abs(angles[1] - angles[0]) <= 360.0:
            raise self.refusal(element, "must span more than 0 and at most 360 degrees")
        return Arc(float(centre[0]), float(centre[1]), radius_m, *angles)

    def _angle(self, element: Element, name: str) -> float:
        angle = element.child(name)
        if angle is None or (angle.get("uom") or "deg") not in ("deg", "°"):
            raise self.refusal(element, f"needs {name} in degrees")
        return number_of(self.who, f"{name} in line {angle.line}", angle.text)

    def _joined(self, element: Element, parts: "list[Floats | Arc]", ways: dict[int, bool]) -> Floats:
        """Return the positions (n, 2) of a curve of parts, each beginning where the one before ends.

        ways : whether arcs bulge outward, by their place
        """

        def check_gap(apart_deg: float) -> None:
            if apart_deg > _GAP_DEG:
                raise self.refusal(element, f"has a gap of {apart_deg:g} degrees between two parts of its curve")

        line = joined(parts, ways, check_gap)
        if not len(line):
            raise self.refusal(element, "has no positions")
        return line
