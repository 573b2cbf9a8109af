"""Look into KML and KMZ for what the OGR library loses or changes in silence."""

import codecs
import re
import zipfile
import zlib
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import datetime
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from conflictdb.errors import InvalidInput
from conflictdb.formats.contents import TOO_LARGE, FileRefusals, Remark
from conflictdb.formats.file_objects import AREA_MEMBERS, DATUM, TRACK_MEMBERS
from conflictdb.formats.instants import format_instant, parse_instant
from conflictdb.formats.kml_rewriting import rewritten
from conflictdb.formats.standards import Standard, altitudes
from conflictdb.formats.xml_text import Element, parsed

STANDARD: Final = Standard(
    "KML",
    read={
        "begin end": "TimeSpan of a placemark, or of a folder or document around it",
        "when": "times of a Track; TimeStamp of an area is remarked as a property",
        "altitudeMode": "refused if heights in the data are not above the datum of the scene",
    },
    unread={"altitudeOffset": "heights"},
    aside={
        "Region LookAt Camera Style StyleMap IconStyle LineStyle": "drawing",
        "NetworkLinkControl NetworkLink Tour GroundOverlay ScreenOverlay PhotoOverlay": "drawing, and other files",
        "snippet Snippet description name": "texts",
        "SimpleData SimpleField value": "data, which are columns",
    },
)
# The reference of altitudes, by mode.
ALTITUDE_MODES: Final = {
    "absolute": "MSL",
    "relativeToGround": "the ground",
    "relativeToSeaFloor": "the sea floor",
    "clampToSeaFloor": "the sea floor",
    "clampToGround": None,  # none: they are not used
    None: None,
}
_HEIGHTS: Final = frozenset({"floor_m", "ceiling_m"})
_MEMBERS: Final = AREA_MEMBERS | TRACK_MEMBERS
_UNITS: Final = ("_m", "_nmi", "_mps", "_kn")
_WHOLE: Final = frozenset({"int", "uint", "short", "ushort"})
_NUMBERS: Final = _WHOLE | {"float", "double"}
_SHAPES: Final = ("Polygon", "LineString", "LinearRing", "Point", "Track")
_FLOAT: Final = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_POSITIONS: Final = re.compile(rf"(?:{_FLOAT},{_FLOAT}(?:,{_FLOAT})?(?:\s+|\Z))*+")
# A third number that is not 0, in coordinates and in a gx:coord.
_ALTITUDE: Final = {
    "coordinates": re.compile(r",[-+]?[\d.]+,[-+]?0{0,9}\.?0{0,9}[1-9]"),
    "coord": re.compile(r"\A\s*+\S++\s++\S++\s++[-+]?0{0,9}\.?0{0,9}[1-9]"),
}
_CORNERS: Final = 4  # of a ring, with the first one again
# The blanks of a run are tried once, from the first one.
_COMMA: Final = re.compile(r"(?<!\s)\s*,\s*|,\s*")
# OGR keeps times to the millisecond.
_KEPT_US: Final = 1000


class KmlDocument:
    """A KML file, or that inside of an archive; raises InvalidInput if OGR would not read it as it is written."""

    def __init__(self, path: Path, inside: str | None, max_file_mb: float) -> None:
        text = _text(path, inside, max_file_mb)
        self.root = parsed(text)
        # Refuses document types before; None: OGR reads the file itself.
        self.rewritten = rewritten(text)
        if self.rewritten is not None:
            self.root = parsed(self.rewritten)
        spans = list(self.root.all("TimeSpan"))
        self._check()
        self._begins, self._ends = (sorted(_finer(spans, name)) for name in ("begin", "end"))

    def _check(self) -> None:
        """Raise InvalidInput for placemarks that OGR would not read as they are written."""
        refusals = FileRefusals()
        types = {one.get("name"): one.get("type") for one in self.root.all("SimpleField")}
        for number, placemark in enumerate(self.root.all("Placemark"), 1):
            name = placemark.value("name")
            who = f"placemark {number}" if name is None else f"placemark {name!r}"
            with refusals:
                data = list(placemark.all("SimpleData", "Data"))
                _check_one_kind(who, data)
                for one in data:
                    _check_number(who, one, types.get(one.get("name")))
                _check_times(who, placemark)
                _check_shapes(who, placemark)
                _check_lines(who, placemark)
                if any((one.get("name") or "").lower() in _HEIGHTS for one in data):
                    _check_modes(who, placemark)
        refusals.raise_found()

    @contextmanager
    def for_ogr(self, path: Path) -> Iterator[Path]:
        """Yield the file that OGR is to read: the given one, or a rewritten one of its name."""
        if self.rewritten is None:
            yield path
            return
        with TemporaryDirectory(prefix="conflictdb-") as folder:
            file = Path(folder) / f"{path.stem}.kml"
            file.write_text(self.rewritten, encoding="utf-8")
            yield file

    def exact(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the columns of a feature with all digits of times, and numbers of Data, which are texts in KML."""
        found = {name: _number(name, value) for name, value in values.items()}
        if early := _near(self._begins, found["begin"]):
            found["begin"] = format_instant(early[0])
        if late := _near(self._ends, found["end"]):
            found["end"] = format_instant(late[-1])
        return found

    def remarks(self, source: str) -> Iterator[Remark]:
        """Yield remarks on what is not read, and on files to which it refers."""
        high = sum(
            any(_ALTITUDE[one.name].search(one.text) for one in placemark.all(*_ALTITUDE))
            for placemark in self.root.all("Placemark")
        )
        yield from altitudes(source, high)
        yield from STANDARD.remarks(source, STANDARD.of_xml(self.root))
        links = list(self.root.all("NetworkLink"))
        if links:
            to = next(links[0].all("href"), None)
            where = f"line {links[0].line}" if to is None else f"line {links[0].line}, to {to.text!r:.100}"
            yield Remark(source, "file", f"has {len(links)} NetworkLinks, which are not read (the first in {where})")


def _text(path: Path, inside: str | None, max_file_mb: float) -> str:
    limit = int(max_file_mb * 1e6)
    try:
        if inside is not None:
            with zipfile.ZipFile(path) as archive, archive.open(inside) as stream:
                data = stream.read(limit + 1)
        else:
            with path.open("rb") as stream:
                data = stream.read(limit + 1)
    except (OSError, zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError) as error:
        raise InvalidInput("file", "", f"cannot be read: {error}") from None
    if len(data) > limit:
        raise InvalidInput("file", "", f"holds more than {max_file_mb:g} MB{TOO_LARGE}")
    encoding = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"
    with suppress(UnicodeError):
        return data.decode(encoding)
    return data.decode("latin-1")  # OGR decodes it; here only ASCII matters


def _finer(spans: list[Element], name: str) -> Iterator[int]:
    """Yield the ends of spans that have parts of a millisecond, microseconds since 1970."""
    for span in spans:
        with suppress(ValueError):
            at_us = parse_instant(span.value(name) or "")
            if at_us % _KEPT_US:
                yield at_us


def _near(instants_us: list[int], text: str | None) -> list[int]:
    """Return the instants within a millisecond of a time."""
    if text is None or not instants_us:
        return []
    at_us = parse_instant(text)
    return instants_us[bisect_right(instants_us, at_us - _KEPT_US) : bisect_left(instants_us, at_us + _KEPT_US)]


def _number(name: str, value: Any) -> Any:
    if isinstance(value, str) and name.lower() in _MEMBERS and name.lower().endswith(_UNITS):
        with suppress(ValueError):
            return float(value)
    return value


def _check_one_kind(who: str, data: list[Element]) -> None:
    """Refuse Data that OGR does not read, because there is SchemaData."""
    if any(one.name == "SimpleData" for one in data):
        for one in data:
            name = one.get("name") or ""
            if one.name == "Data" and name.lower() in {*_MEMBERS, DATUM}:
                raise InvalidInput(who, name, "is Data beside SchemaData, and only one is read: write one kind")


def _check_number(who: str, data: Element, kind: str | None) -> None:
    name = data.get("name") or ""
    if kind in _NUMBERS and name.lower() in _MEMBERS and data.text:
        with suppress(ValueError):
            if isfinite(int(data.text) if kind in _WHOLE else float(data.text)):
                return
        raise InvalidInput(who, name, f"must be a number of the type {kind}; got {data.text!r:.40}")


def _check_times(who: str, placemark: Element) -> None:
    span = placemark.child("TimeSpan")
    for name in ("begin", "end"):
        text = None if span is None else span.value(name)
        try:
            datetime.fromisoformat((text or "2026-01-01").upper())
        except ValueError:
            rule = f"must be a date and time in ISO 8601, such as 2026-03-01T06:00:00Z; got {text!r:.60}"
            raise InvalidInput(who, name, rule) from None


def _check_shapes(who: str, placemark: Element) -> None:
    for polygon in placemark.all("Polygon"):
        outer = [ring for one in polygon.each("outerBoundaryIs") for ring in one.each("LinearRing")]
        if len(outer) > 1:
            rule = f"has {len(outer)} outer rings, and must have one: write a Polygon for each, in a MultiGeometry"
            raise InvalidInput(who, f"Polygon in line {polygon.line}", rule)
    for one in placemark.all("coordinates"):
        if _POSITIONS.fullmatch(one.text):
            continue
        for position in _COMMA.sub(",", one.text).split():
            numbers = position.split(",")
            try:
                is_sound = len(numbers) in (2, 3) and all(isfinite(float(number)) for number in numbers)
            except ValueError:
                is_sound = False
            if not is_sound:
                rule = f"must be lon,lat or lon,lat,height, with spaces between positions; got {position!r:.40}"
                raise InvalidInput(who, f"coordinates in line {one.line}", rule)


def _check_lines(who: str, placemark: Element) -> None:
    """Refuse lines and rings with too few positions, open rings, and rings outside of polygons."""
    inside = {id(ring) for polygon in placemark.all("Polygon") for ring in polygon.all("LinearRing")}
    for one in placemark.all("Track", "LineString", "LinearRing"):
        where = f"{one.name} in line {one.line}"
        if one.name == "LinearRing" and id(one) not in inside:
            rule = "is a ring outside of a Polygon: write it as a Polygon, or as a LineString"
            raise InvalidInput(who, where, rule)
        text = one.value("coordinates") or ""
        positions = [tuple(map(float, each.split(",")[:2])) for each in _COMMA.sub(",", text).split()]
        count = len(list(one.each("coord"))) if one.name == "Track" else len(positions)
        if one.name == "LinearRing" and positions and (count < _CORNERS or positions[0] != positions[-1]):
            rule = f"must have {_CORNERS} positions or more, and end where it begins"
            raise InvalidInput(who, where, f"{rule}; got {count} from {positions[0]} to {positions[-1]}")
        if count == 1:
            raise InvalidInput(who, where, "must have two positions or more; got one: leave the placemark out")


def _check_modes(who: str, placemark: Element) -> None:
    """Refuse modes of altitudes that are unknown, or that differ within an object with heights."""
    shapes = [*placemark.all(*_SHAPES)]
    rings = {id(ring) for one in shapes for ring in one.all("LinearRing")}
    modes = {one.value("altitudeMode") for one in shapes if id(one) not in rings}
    for mode in modes:
        if mode not in ALTITUDE_MODES:
            known = ", ".join(one for one in ALTITUDE_MODES if one)
            raise InvalidInput(who, "altitudeMode", f"must be one of {known}; got {mode!r:.40}")
    if len({ALTITUDE_MODES[mode] for mode in modes}) > 1:
        raise InvalidInput(who, "altitudeMode", "differs within an object that has heights: write one for each")
