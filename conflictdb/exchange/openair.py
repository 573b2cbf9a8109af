"""Read airspaces of OpenAir, as gliding, paragliding and UAS programs write them.

The records of WinPilot, of Naviter (versions 1 and 2, with the times AA) and of openAIP (AI, AY, AF, AG, TP). Each
shape of an airspace becomes an area; a polygon contains its arcs and circles, see `arcs` and `discs`. Sides are
shortest lines. A record of a shape that is not read refuses its airspace, others are remarked by their names.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.earth.shortest_lines import NoShortestLineError, length_and_azimuth
from conflictdb.errors import InvalidInput
from conflictdb.exchange.arcs import Arc, joined, outward
from conflictdb.formats.areas_of_files import Active, Gathered, Volume, Zone, along_shortest_lines
from conflictdb.formats.contents import Contents, Remark, Skipped, row_id
from conflictdb.formats.discs import MAX_RADIUS_M
from conflictdb.formats.file_heights import height_m
from conflictdb.formats.instants import parse_end, parse_instant
from conflictdb.formats.standards import Standard
from conflictdb.model.plans import METRES_PER_NMI, POLE_RULE

Floats = NDArray[np.float64]

STANDARD: Final = Standard(
    "OpenAir",
    read={"AA": "times", "AL AH": "heights", "DA DB DC DP V": "shapes"},
    unread={"*AActiv *ATimes *AExSAT *AExSUN *AExHOL *ASeeNOTAM": "times in comments", "AU AM": "any other record"},
    aside={"AT SP SB TB": "drawing", "AC AY AN AI AF AR AG AX TP": "no quantities"},
)
# Airspaces begin with their class; then come a name, heights, or points. Only the last of several classes is tried:
# else a text of classes alone would take time with the square of its length.
_SIGN: Final = re.compile(
    r"^AC[ \t]+\S.*$(?:\s*^(?:\*.*|(?!AC[ \t]+\S)[A-Z]{2}[ \t].*)$)*?\s*^(?:AN|AH|AL|DP|DC|V)[ \t]", re.MULTILINE
)
_LINE_END: Final = re.compile(r"\r\n|\r|\n")
_RECORD: Final = re.compile(r"([A-Z]{1,2})(?:[ \t]+(.*))?", re.ASCII | re.IGNORECASE)
# Comments of some programs that say when an airspace is active: *AActiv, *ATimes, *AExSAT, *ASeeNOTAM.
_COMMENT: Final = re.compile(r"\*(A(?:Activ|Times|Ex[A-Z]{3}|SeeNOTAM))\b", re.ASCII | re.IGNORECASE)
_ANGLE: Final = r"(\d{1,3}(?:\.\d{1,12})?)(?::(\d{1,2}(?:\.\d{1,12})?)(?::(\d{1,3}(?:\.\d{1,12})?))?)?"
_PLACE: Final = re.compile(rf"\s*{_ANGLE}\s?([NS])[\s,]?\s?{_ANGLE}\s?([EW])\s*", re.ASCII | re.IGNORECASE)
_NUMBER: Final = re.compile(r"\s*[-+]?\d{1,12}(?:\.\d{1,12})?\s*", re.ASCII)
_VARIABLE: Final = re.compile(r"([A-Z])\s?=\s?(.*)", re.ASCII | re.IGNORECASE)
_HEIGHT: Final = re.compile(
    r"(?:(FL)\s?)?(\d{1,6}(?:\.\d{1,6})?)\s?(FT|FEET|F|M|METERS|METRES)?\s?(?:A?(MSL)|AGL|ASFC|SFC|GND|STD|ALT)?",
    re.ASCII,
)
_UNITS: Final = {"M": "m", "METERS": "m", "METRES": "m"}
_NO_LIMIT: Final = {
    True: frozenset({"GND", "SFC", "AGL"}),
    False: frozenset({"UNL", "UNLIM", "UNLIMITED", "UNLTD", "FL999", "FL 999"}),
}
_NONE: Final = "NONE"
# Where a line of text is drawn, and the pens of maps.
_DRAWN: Final = frozenset({"AT", "SP", "SB", "TB"})
# Terrain: a name follows, and points that are no airspace.
_TERRAIN: Final = frozenset({"TO", "TC"})
_PROPERTIES: Final = {
    "AC": "airspace_class",
    "AY": "airspace_type",
    "AF": "frequency",
    "AR": "frequency",
    "AG": "station",
    "AX": "transponder",
    "TP": "transponder",
}
_ONCE: Final = frozenset({"AC", "AY", "AN", "AI", "AH", "AL"})
_NO_TYPE: Final = frozenset({"NONE", "UNC", "UNCLASSIFIED"})
_LIMIT_MINUTES: Final = 60.0
_CORNERS: Final = 3
# Crossings of an outline with itself: what it encloses takes time and memory for each, up to the square of its points.
_MOST_CROSSINGS: Final = 10_000
_SIDES_AT_ONCE: Final = 256


@dataclass(slots=True)
class _OpenAirspace:
    """The records of an airspace, each with its line."""

    line: int
    records: list[tuple[int, str, str]] = field(default_factory=list)

    def all(self, *names: str) -> list[tuple[int, str]]:
        """Return lines and values of the records of some names."""
        return [(line, value) for line, name, value in self.records if name in names]

    def value(self, name: str) -> str | None:
        """Return the value of a record, None if it is missing or empty."""
        return next((value for _, value in self.all(name) if value), None)


def is_openair(text: str) -> bool:
    """Return whether a text has an airspace of OpenAir."""
    return _SIGN.search(text) is not None


def read_openair(text: str, source: str, *, stem: str, skip_invalid: bool) -> Contents:
    """Return the areas of airspaces; raises InvalidInput with all errors."""
    found = Gathered(source)
    skipped: list[Skipped] = []
    others: Counter[str] = Counter()
    airspaces = list(_airspaces(text, others))
    if not airspaces:
        raise InvalidInput("file", "", "holds no airspace of OpenAir: each begins with its class, such as AC R")
    keys = _keys(airspaces, stem)
    always: list[str] = []
    crossing: list[str] = []
    for key, airspace in zip(keys, airspaces, strict=True):
        who = f"zone {key!r}"
        with found.refusals:
            active = _active(who, airspace)
            if active is None:
                skipped.append(Skipped(source, who, "is never active: AA NONE", (), is_whole=False))
                continue
            zone, is_crossing = _zone(who, key, airspace, active, found, others)
            found.add_zone(f"AC in line {airspace.line}", zone)
            always += [] if active else [key]
            crossing += [key] if is_crossing else []
    contents = found.contents(skip_invalid=skip_invalid)
    contents.skipped.extend(skipped)
    contents.derived = [key for key, airspace in zip(keys, airspaces, strict=True) if airspace.value("AI") is None]
    contents.remarks = list(_remarks(source, others, always, crossing))
    return contents


def _remarks(source: str, others: Counter[str], always: Sequence[str], crossing: Sequence[str]) -> Iterator[Remark]:
    for keys, text in (
        (always, "without times (AA) are active at all times"),
        (crossing, "whose outlines cross themselves are all that these enclose"),
    ):
        if keys:
            yield Remark(source, "file", f"{len(keys):,} airspaces {text}, such as {keys[0]!r:.60}")
    if others:
        named = ", ".join(f"{name} ({count:,})" for name, count in sorted(others.items())[:20])
        yield Remark(source, "file", f"records that are not read: {named}")


def _airspaces(text: str, others: Counter[str]) -> Iterator[_OpenAirspace]:
    """Yield the airspaces of a text; counts records that are not read."""
    airspace: _OpenAirspace | None = None
    for line, given in enumerate(_LINE_END.split(text), 1):
        if (comment := _COMMENT.match(given.lstrip())) is not None:
            others[f"*{comment[1]}"] += 1
        content = given.partition("*")[0].strip()
        if not content:
            continue
        record = _RECORD.fullmatch(content)
        name, value = (record[1].upper(), (record[2] or "").strip()) if record else ("", content)
        if name == "AC":
            if airspace is not None:
                yield airspace
            airspace = _OpenAirspace(line)
        elif name in _TERRAIN:
            if airspace is not None:
                yield airspace
            airspace = None
            others[name] += 1
        if name in _DRAWN or name in _TERRAIN:
            continue
        if airspace is not None:
            airspace.records.append((line, name, value))
        else:
            others[name or "lines that are no records"] += 1
    if airspace is not None:
        yield airspace


def _keys(airspaces: Sequence[_OpenAirspace], stem: str) -> list[str]:
    """Return the ids of airspaces: AI, or a name that no other one has, or their numbers."""
    named = [one.value("AI") or one.value("AN") for one in airspaces]
    given = Counter(named)
    return [
        name if name is not None and given[name] == 1 else one.value("AI") or row_id(stem, number)
        for number, (one, name) in enumerate(zip(airspaces, named, strict=True), 1)
    ]


def _zone(
    who: str, key: str, airspace: _OpenAirspace, active: Sequence[Active], found: Gathered, others: Counter[str]
) -> tuple[Zone, bool]:
    """Return the zone of an airspace, and whether an outline crosses itself; counts records that are not read."""
    for name in _ONCE:
        if len(given := airspace.all(name)) > 1:
            raise InvalidInput(who, f"{name} in line {given[1][0]}", "is given twice; an airspace begins with AC")
    floor_m, ceiling_m = (_height(who, airspace, name) for name in ("AL", "AH"))
    shapes = list(_shapes(who, airspace, found))
    volumes = [Volume(_enclosed(who, shape), floor_m, ceiling_m) for shape in shapes]
    if not volumes:
        raise InvalidInput(who, f"AC in line {airspace.line}", "has no shape: DP, DA, DB and DC are read")
    known = {*_PROPERTIES, *_ONCE, "AA", "DP", "DA", "DB", "DC", "V"}
    others.update(name for _, name, _ in airspace.records if name not in known)
    properties = {_PROPERTIES[name]: value for _, name, value in airspace.records if name in _PROPERTIES and value}
    kinds = [value for name in ("AY", "AC") if (value := airspace.value(name)) is not None]
    kind = next((one.upper() for one in kinds if one.upper() not in _NO_TYPE), kinds[0] if kinds else None)
    zone = Zone(key, volumes, airspace.value("AN"), active, properties, kind)
    return zone, any(volume.footprint is not shape for volume, shape in zip(volumes, shapes, strict=True))


def _active(who: str, airspace: _OpenAirspace) -> list[Active] | None:
    """Return when an airspace is active, an empty list for always, None for never."""
    times = [(line, value.partition(";")[0].strip()) for line, value in airspace.all("AA")]
    never = [line for line, value in times if all(one.strip().upper() == _NONE for one in value.split("/"))]
    if never and len(times) > 1:
        rule = "is NONE, and other times are given: leave it out, or the others"
        raise InvalidInput(who, f"AA in line {never[0]}", rule)
    if never:
        return None
    return [_span(who, f"AA in line {line}", value) for line, value in times]


def _span(who: str, where: str, value: str) -> Active:
    """Return a span such as 2026-06-01T10:00Z/2026-06-01T12:00Z or NONE/2026-06-01T12:00Z; times are UTC."""
    start, slash, end = (one.strip() for one in value.partition("/"))
    if not slash:
        rule = "must be two times in ISO 8601, or NONE, such as 2026-06-01T10:00Z/2026-06-01T12:00Z"
        raise InvalidInput(who, where, f"{rule}; got {value!r:.60}")
    try:
        return Active(
            None if start.upper() == _NONE else parse_instant(start, naive_is_utc=True),
            None if end.upper() == _NONE else parse_end(end, naive_is_utc=True),
        )
    except ValueError as error:
        raise InvalidInput(who, where, str(error)) from None


def _height(who: str, airspace: _OpenAirspace, name: str) -> float | None:
    """Return a limit in metres above the scene's vertical datum, None if it is unbounded. Feet are the default unit."""
    for line, value in airspace.all(name):
        where, is_floor = f"{name} in line {line}", name == "AL"
        text = " ".join(value.upper().split())
        if text in _NO_LIMIT[is_floor]:
            return None
        given = _HEIGHT.fullmatch(text)
        if given is None or (given[1] and given[3]):
            rule = "must be such as GND, 2500ft AMSL, 1000ft AGL, FL95 or UNL"
            raise InvalidInput(who, where, f"{rule}; got {value!r:.40}")
        reference = next((one for one in ("AGL", "SFC", "GND", "STD") if text.endswith(one)), "AMSL")
        unit = "FL" if given[1] else _UNITS.get(given[3] or "FT", "ft")
        return height_m(who, where, float(given[2]), unit, reference, is_floor=is_floor)
    return None


def _shapes(who: str, airspace: _OpenAirspace, found: Gathered) -> Iterator[shapely.MultiPolygon]:
    """Yield a polygon for each circle of an airspace, and one for all its points and arcs."""
    parts: list[list[tuple[float, float]] | Arc] = []
    first = 0
    centre: tuple[float, float] | None = None
    is_clockwise = True
    for line, name, value in airspace.records:
        where = f"{name} in line {line}"
        if name in ("DP", "DA", "DB"):
            first = first or line
        if name == "V":
            given = _VARIABLE.fullmatch(value)
            letter = None if given is None else given[1].upper()
            if given is not None and letter == "X":
                (centre,) = _places(who, where, given[2], 1)
            elif given is not None and letter == "D" and given[2].strip() in ("+", "-"):
                is_clockwise = given[2].strip() == "+"
            elif letter not in ("Z", "T"):  # of the map, and of a text
                rule = "must be X= with a centre, or D=+ or D=- with the direction of arcs"
                raise InvalidInput(who, where, f"{rule}; got {value!r:.40}")
        elif name == "DP":
            places = _places(who, where, value, 1)
            if parts and isinstance(parts[-1], list):
                parts[-1] += places
            else:
                parts.append(places)
        elif name == "DB":
            parts.append(_arc_between(who, where, _centre(who, where, centre), value, is_clockwise))
        elif name == "DA":
            parts.append(_arc(who, where, _centre(who, where, centre), value, is_clockwise))
        elif name == "DC":
            lon, lat = _centre(who, where, centre)
            yield found.circle(who, lon, lat, _numbers(who, where, value, 1)[0] * METRES_PER_NMI, where)
        elif not name or name[0] == "D":
            rule = "is no record of OpenAir" if not name else "is a shape that is not read: DP, DA, DB and DC are"
            raise InvalidInput(who, where if name else f"line {line}", f"{rule}; got {value!r:.40}")
    for part in parts:
        if isinstance(part, Arc):
            found.corners.add(who, part.count)
    if parts:
        lines = [part if isinstance(part, Arc) else np.array(part) for part in parts]
        yield _polygon(who, f"shape in line {first}", lines)


def _polygon(who: str, where: str, parts: "Sequence[Floats | Arc]") -> shapely.MultiPolygon:
    def ring(ways: dict[int, bool]) -> Floats:
        line = joined(parts, ways, lambda _: None)
        return line if np.array_equal(line[0], line[-1]) else np.concatenate([line, line[:1]])

    outline = ring(outward(ring({}), parts))
    if len(outline) <= _CORNERS:
        raise InvalidInput(who, where, f"needs at least {_CORNERS} points; got {len(outline) - 1}")
    line = along_shortest_lines(who, where, outline)
    if line[0, 0] != line[-1, 0]:
        raise InvalidInput(who, where, f"must be a ring{POLE_RULE}")
    return shapely.MultiPolygon([shapely.Polygon(line)])


def _enclosed(who: str, shape: shapely.MultiPolygon) -> shapely.MultiPolygon:
    """Return all that an outline encloses if it crosses itself; else the shape."""
    if shape.is_valid:
        return shape
    _check_crossings(who, shape)
    lines = shapely.node(shapely.MultiLineString([part.exterior for part in shape.geoms]))
    enclosed = shapely.union_all(shapely.get_parts(shapely.polygonize([lines])))
    polygons = [part for part in shapely.get_parts(enclosed) if isinstance(part, shapely.Polygon)]
    return shapely.MultiPolygon(polygons) if polygons else shape  # a line, which is refused later


def _check_crossings(who: str, shape: shapely.MultiPolygon) -> None:
    """Refuse an outline whose sides meet too often; stops counting there."""
    points = shapely.get_coordinates(shape)
    points = points[np.append(True, (np.diff(points, axis=0) != 0.0).any(axis=1))]
    sides = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
    tree = shapely.STRtree(sides)
    met = 0
    for first in range(0, len(sides), _SIDES_AT_ONCE):
        some = sides[first : first + _SIDES_AT_ONCE]
        # Each meets itself, and the ones before and after it.
        met += tree.query(some, predicate="intersects").shape[1] - 3 * len(some)
        if met > 2 * _MOST_CROSSINGS:
            raise InvalidInput(who, "shape", f"crosses itself more than {_MOST_CROSSINGS:,} times")


def _centre(who: str, where: str, centre: tuple[float, float] | None) -> tuple[float, float]:
    if centre is None:
        raise InvalidInput(who, where, "needs a centre before it, such as V X=48:00:00 N 011:00:00 E")
    return centre


def _places(who: str, where: str, text: str, count: int) -> list[tuple[float, float]]:
    """Return `count` places (longitude, latitude), degrees; commas may separate them."""
    found: list[tuple[float, float]] = []
    at = 0
    while (place := _PLACE.match(text, at)) is not None:
        lat, lon = (
            sum(
                float(part or 0.0) / scale for part, scale in zip(place.groups()[i : i + 3], (1, 60, 3600), strict=True)
            )
            for i in (0, 4)
        )
        if lat > 90.0 or lon > 180.0 or any(float(place[i] or 0.0) > _LIMIT_MINUTES for i in (2, 3, 6, 7)):
            break
        found.append((-lon if place[8] in "Ww" else lon, -lat if place[4] in "Ss" else lat))
        at = place.end() + text.startswith(",", place.end())
    if len(found) != count or at < len(text):
        rule = f"must be {count} place{'s' * (count > 1)} such as 48:30:15 N 011:05:00 E or 48:30.25N 011:05.0E"
        raise InvalidInput(who, where, f"{rule}; got {text!r:.60}")
    return found


def _numbers(who: str, where: str, text: str, count: int) -> list[float]:
    """Return `count` numbers, the first a radius in nautical miles."""
    given = text.split(",")
    if len(given) != count or not all(map(_NUMBER.fullmatch, given)):
        form = "a radius" if count == 1 else "a radius and two bearings"
        raise InvalidInput(who, where, f"must be {form}, in nautical miles and degrees; got {text!r:.40}")
    radius, *others = map(float, given)
    if not 0.0 < radius * METRES_PER_NMI <= MAX_RADIUS_M:
        raise InvalidInput(who, where, f"must have a radius above 0, at most {MAX_RADIUS_M:,.0f} m; got {text!r:.40}")
    return [radius, *others]


def _arc(who: str, where: str, centre: tuple[float, float], text: str, is_clockwise: bool) -> Arc:
    radius, start, end = _numbers(who, where, text, 3)
    return Arc(*centre, radius * METRES_PER_NMI, start, _turned(start, end, is_clockwise))


def _arc_between(who: str, where: str, centre: tuple[float, float], text: str, is_clockwise: bool) -> Arc:
    ends = _places(who, where, text, 2)
    try:
        (near_m, start), (far_m, end) = (length_and_azimuth(np.array(centre), np.array(one)) for one in ends)
    except NoShortestLineError:
        near_m = far_m = 0.0
    if not 0.0 < min(near_m, far_m) <= max(near_m, far_m) <= MAX_RADIUS_M:
        rule = f"must lie away from the centre of the arc, at most {MAX_RADIUS_M:,.0f} m"
        raise InvalidInput(who, where, f"{rule}; got {text!r:.60}")
    return Arc(*centre, near_m, start, _turned(start, end, is_clockwise), far_m)


def _turned(start_deg: float, end_deg: float, is_clockwise: bool) -> float:
    """Return the bearing of the end of an arc, by whole turns after or before its start."""
    turn = (end_deg - start_deg) % 360.0 or 360.0
    return start_deg + (turn if is_clockwise else turn - 360.0 if turn < 360.0 else -360.0)
