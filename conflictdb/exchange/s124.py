"""Read navigational warnings of S-124, in GML: the surfaces of each part of a warning become an area.

Points and lines have no size and are left out. Dates without a time are whole days in UTC.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

from conflictdb.errors import InvalidInput
from conflictdb.exchange.gml import Geometries
from conflictdb.formats.areas_of_files import Active, Gathered, Volume, Zone
from conflictdb.formats.contents import Contents, Skipped
from conflictdb.formats.standards import Standard
from conflictdb.formats.values_of_xml import time_of
from conflictdb.formats.xml_text import Element

STANDARD: Final = Standard(
    "S-124",
    read={"dateStart dateEnd date timeOfDayStart timeOfDayEnd": "times", "periodicDateRange": "refused"},
    unread={
        "cancellationDate": "when a warning ends",
        "verticalClearanceValue depthMinimum depthMaximum": "heights and depths",
        "horizontalWidth": "widths",
    },
    aside={
        "publicationTime sourceDate reportedDate": "when a warning was made",
        "boundedBy": "box of the file",
        "DataSetIdentificationInformation DatasetIdentificationInformation": "when the file was made",
    },
)
_NAMESPACE: Final = "http://www.iho.int/S124/"
# Parts of warnings, in the names of all versions, and the larger area that a warning affects.
_PARTS: Final = ("NavwarnPart", "NAVWARNPart", "S124_NavigationalWarningPart", "NavwarnAreaAffected")
_SURFACES: Final = ("Surface", "Polygon", "MultiSurface", "CompositeSurface")
_OTHERS: Final = ("Point", "MultiPoint", "Curve", "LineString", "OrientableCurve", "CompositeCurve")
_DATE: Final = re.compile(r"(\d{4})-?(\d\d)-?(\d\d)")
_CLOCK: Final = re.compile(r"(\d\d):?(\d\d)(?::?(\d\d(?:\.\d+)?))?(Z|[+-]\d\d:?\d\d)?")
_DAY_US: Final = 86_400_000_000
_MOST_NAMED: Final = 80


def is_s124(root: Element) -> bool:
    """Return whether an XML document is a data set of S-124."""
    return root.name.lower() == "dataset" and root.namespace.startswith(_NAMESPACE)


def read_s124(
    root: Element, source: str, *, stem: str, max_speed_kn: float, layers: Sequence[str], skip_invalid: bool
) -> Contents:
    """Return the areas of warnings; raises InvalidInput with all errors."""
    del max_speed_kn
    if layers:
        raise InvalidInput("file", "layer", "has no layers: files that OGR opens may have some")
    found = Gathered(source)
    others: Counter[str] = Counter()
    without: list[Skipped] = []
    warning = _warning(root)
    for number, part in enumerate(root.all(*_PARTS), 1):
        key = part.attributes.get("id") or f"{stem}/{number}"
        who = f"warning {key!r}"
        surfaces = [one for geometry in part.each("geometry") for one in _outermost(geometry, _SURFACES)]
        lines = [one for geometry in part.each("geometry") for one in _outermost(geometry, _OTHERS)]
        others.update(one.name for one in lines)
        if not surfaces:
            if not lines:
                without.append(Skipped(source, who, "has no geometry that is read: no area", (), is_whole=False))
            continue
        with found.refusals:
            read = Geometries(who, found, {}, latitude_first=True)
            volumes = [Volume(read.surfaces(one)) for one in surfaces]
            active = [_active(who, one) for one in part.each("fixedDateRange")]
            for recurring in part.each("periodicDateRange"):
                raise InvalidInput(who, f"periodicDateRange in line {recurring.line}", "is not understood")
            text = next((one.text for one in part.all("text") if one.text), None)
            properties = {**warning, **({"text": text} if text else {}), "part": part.name}
            name = None if text is None else " ".join(text.split())[:_MOST_NAMED]
            found.add_zone(f"{part.name} in line {part.line}", Zone(key, volumes, name, active, properties))
    contents = found.contents(skip_invalid=skip_invalid)
    contents.skipped.extend(without)
    contents.derived = [area.key for area in contents.areas]  # ids of XML are unique in their file
    for kind, count in others.items():
        reason = f"{count} geometries are {kind}s: no areas"
        contents.skipped.append(Skipped(source, "file", reason, (), is_whole=False))
    return contents


def _outermost(element: Element, names: Sequence[str]) -> list[Element]:
    """Return the descendants of some names that are in no other geometry."""
    found: list[Element] = []
    for child in element.children:
        if child.name in names:
            found.append(child)
        elif child.name not in (*_SURFACES, *_OTHERS):
            found += _outermost(child, names)
    return found


def _warning(root: Element) -> Mapping[str, str]:
    """Return the series, number and year of the warning of a file."""
    identifier = next(root.all("messageSeriesIdentifier"), None)
    names = ("nameOfSeries", "warningNumber", "year")
    values = {} if identifier is None else {name: identifier.value(name) for name in names}
    return {name: one for name, one in values.items() if one is not None}


def _active(who: str, dates: Element) -> Active:
    """Return the span of a range of dates; raises InvalidInput for one that is not understood."""
    start = _moment(who, dates, "Start")
    end = _moment(who, dates, "End")
    return Active(start, end)


def _moment(who: str, dates: Element, side: str) -> int | None:
    """Return an end of a range, microseconds since 1970, None if it has none; a day ends at its end."""
    date = dates.child(f"date{side}")
    clock = dates.value(f"timeOfDay{side}")
    if date is None:
        if clock is not None:
            raise InvalidInput(who, f"timeOfDay{side} in line {dates.line}", f"has no date{side}")
        return None
    text = date.text or next((one.text for one in date.children if one.name == "date"), "")
    where = f"date{side} in line {date.line}"
    given = _DATE.fullmatch(text)
    if given is None:
        raise InvalidInput(who, where, f"must be a whole date such as 2026-03-01; got {text!r:.40}")
    day = "-".join(given.groups())
    if clock is None:
        midnight = time_of(who, where, f"{day}T00:00:00Z")
        return midnight if midnight is None or side == "Start" else midnight + _DAY_US
    at = _CLOCK.fullmatch(clock)
    if at is None:
        raise InvalidInput(
            who, f"timeOfDay{side} in line {dates.line}", f"must be such as 10:00:00Z; got {clock!r:.40}"
        )
    return time_of(who, where, f"{day}T{at[1]}:{at[2]}:{at[3] or '00'}{at[4] or 'Z'}")
