"""Rewrite KML where OGR would lose what it says: inherited times, ends of whole days, tracks of KML 2.3."""

import re
from collections.abc import Iterator
from contextlib import suppress
from copy import deepcopy
from datetime import date, timedelta
from typing import Final
from xml.etree import ElementTree as ET

KML: Final = "http://www.opengis.net/kml/2.2"
GX: Final = "http://www.google.com/kml/ext/2.2"
_ANY_KML: Final = re.compile(r"http://(?:www\.opengis\.net|earth\.google\.com)/kml/[\d.]+")
_USUAL: Final = re.compile(rf"""xmlns:gx\s*=\s*["']{re.escape(GX)}["']""")
# Elements of KML 2.3 that KML 2.2 has as extensions of Google.
_EXTENDED: Final = frozenset({"Track", "MultiTrack", "coord", "angles", "interpolate"})
_CONTAINERS: Final = frozenset({"Document", "Folder"})
# Children of a placemark before its time.
_BEFORE_TIME: Final = frozenset(
    {
        *("name", "visibility", "open", "author", "link", "address", "AddressDetails", "phoneNumber", "Snippet"),
        *("description", "Camera", "LookAt"),
    }
)
_DATE: Final = re.compile(r"(\d{4})(?:-(\d\d)(?:-(\d\d))?)?", re.ASCII)
# The end of a day, which OGR does not read.
_MIDNIGHT: Final = re.compile(r"(\d{4}-\d\d-\d\d)T24:00(?::00(?:\.0{1,9})?)?(|Z|[+-]\d\d:\d\d)", re.ASCII)

Node = ET.Element


def rewritten(text: str) -> str | None:
    """Return a KML document that OGR reads as it is meant, None if it reads the given one so.

    text : well-formed, without a document type
    """
    root = ET.fromstring(text)  # noqa: S314  checked by `xml_text`
    # OGR knows extensions by their usual prefix alone.
    is_other_prefix = _USUAL.search(text) is None and any(node.tag.startswith(f"{{{GX}}}") for node in root.iter())
    changes = [_in_one_namespace(root), _inherit(root, None), _whole_days(root), _without_empty_coords(root)]
    if not (is_other_prefix or any(changes)):
        return None
    ET.register_namespace("", KML)
    ET.register_namespace("gx", GX)
    return ET.tostring(root, encoding="unicode")


def _name(node: Node) -> str:
    return node.tag.rpartition("}")[2]


def _children(node: Node, *names: str) -> list[Node]:
    return [child for child in node if _name(child) in names]


def _in_one_namespace(root: Node) -> bool:
    """Give elements of other versions the namespaces of KML 2.2; returns whether a track was written as in KML 2.3."""
    is_changed = False
    for node in root.iter():
        namespace, _, name = node.tag.removeprefix("{").rpartition("}")
        if not namespace or _ANY_KML.fullmatch(namespace):
            is_changed = is_changed or name in _EXTENDED
            node.tag = f"{{{GX if name in _EXTENDED else KML}}}{name}"
    return is_changed


def _inherit(node: Node, span: Node | None) -> bool:
    """Give polygons without a time that of the folder or document around them; returns whether any got one."""
    own = _children(node, "TimeSpan", "TimeStamp")
    if own:
        span = own[0] if _name(own[0]) == "TimeSpan" else None
    is_changed = False
    for child in list(node):
        if _name(child) in _CONTAINERS:
            is_changed |= _inherit(child, span)
        elif _name(child) == "Placemark" and span is not None and _lacks_time(child):
            child.insert(sum(_name(one) in _BEFORE_TIME for one in child), deepcopy(span))
            is_changed = True
    return is_changed


def _lacks_time(placemark: Node) -> bool:
    names = {_name(one) for one in placemark.iter()}
    return "Polygon" in names and names.isdisjoint({"TimeSpan", "TimeStamp", "Track"})


def _whole_days(root: Node) -> bool:
    """Write dates, months, years and 24:00 as instants: an end contains its day; returns whether there are any."""
    is_changed = False
    for span in (node for node in root.iter() if _name(node) == "TimeSpan"):
        for end in _children(span, "begin", "end"):
            given = _DATE.fullmatch((end.text or "").strip())
            is_end = _name(end) == "end"
            if (midnight := _MIDNIGHT.fullmatch((end.text or "").strip())) is not None:
                with suppress(ValueError, OverflowError):  # refused later
                    end.text = f"{date.fromisoformat(midnight[1]) + timedelta(days=1)}T00:00:00{midnight[2]}"
                    is_changed = True
                continue
            if given is None or not (is_end or given[3] is None):
                continue
            year, month, day = (int(one) if one else None for one in given.groups())
            try:
                first = date(year or 0, month or 1, day or 1)
                if is_end:
                    first = _after(first, has_month=month is not None, has_day=day is not None)
            except (ValueError, OverflowError):
                continue  # refused later
            end.text = f"{first.isoformat()}T00:00:00"
            is_changed = True
    return is_changed


def _after(first: date, *, has_month: bool, has_day: bool) -> date:
    """Return the day after a day, a month or a year that begins on a day."""
    if has_day:
        return first + timedelta(days=1)
    if has_month:
        return date(first.year + first.month // 12, first.month % 12 + 1, 1)
    return date(first.year + 1, 1, 1)


def _without_empty_coords(root: Node) -> bool:
    """Remove fixes of tracks without a place, with their times; returns whether there are any."""
    is_changed = False
    for track in (node for node in root.iter() if _name(node) == "Track"):
        columns = [_children(track, name) for name in ("coord", "when", "angles")]
        coords = columns[0]
        for k in _empty(coords):
            for column in columns:
                if len(column) == len(coords):
                    track.remove(column[k])
            is_changed = True
    return is_changed


def _empty(coords: list[Node]) -> Iterator[int]:
    return (k for k, one in enumerate(coords) if not (one.text or "").strip())
