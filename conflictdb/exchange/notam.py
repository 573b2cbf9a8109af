"""Read NOTAM in the format of ICAO (Annex 15, PANS-AIM): areas of airspace restrictions and warnings.

An area is the circle or polygon that item E gives by coordinates; where it gives none, or more than plain lines, the
circle of item Q, which contains the area by rule. Coordinates of item E are degrees, minutes and perhaps seconds.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import pairwise
from typing import Final

import numpy as np
import shapely

from conflictdb.errors import InvalidInput
from conflictdb.formats.areas_of_files import Active, Gathered, Volume, Zone, along_shortest_lines
from conflictdb.formats.contents import Contents, Remark, Skipped
from conflictdb.formats.file_heights import height_m
from conflictdb.formats.instants import format_instant
from conflictdb.formats.standards import Standard
from conflictdb.model.inputs import EPOCH, MICROSECOND
from conflictdb.model.plans import METRES_PER_NMI

STANDARD: Final = Standard(
    "NOTAM",
    read={"B) C)": "times", "D)": "schedule", "F) G)": "heights; else those of Q)", "Q) E)": "circle or polygon"},
)
# Subjects of item Q whose NOTAM close or endanger airspace: organisation, restrictions, warnings.
_SUBJECTS: Final = ("QA", "QR", "QW")
_KEY: Final = r"[A-Z]\d{1,6}/(?:20)?\d\d(?!\d)"
# Without its letter a NOTAM is new, if item Q follows.
_NUMBER: Final = re.compile(rf"({_KEY})\s+NOTAM(?:([NRC])\b(?:\s+({_KEY}))?|(?=\s+Q\)))", re.ASCII | re.IGNORECASE)
# As !FDC 6/1234.
_DOMESTIC: Final = re.compile(r"^[ \t(]*(!\w{2,4}[ \t]+\d{1,2}/\d{1,4})(?!\d)", re.ASCII | re.MULTILINE)
# At the start of a line, or before a FIR: "(BTN J AND Q)" in item E is none.
_ITEM_Q: Final = re.compile(r"^[ \t(]*Q\)|(?<=\s)Q\)(?=\s*[A-Z]{4}\s*/)", re.IGNORECASE | re.MULTILINE)
_ITEM: Final = re.compile(r"(?:(?<=\s)|^)([QABCDEFG])\)\s*")
_Q: Final = re.compile(
    r"([A-Z]{4})/(Q[A-Z]{4})/[A-Z ]*/[A-Z ]*/[A-Z ]*/(\d{3})/(\d{3})/(\d{4})([NS])(\d{5})([EW])(\d{3})"
)
_TIME: Final = re.compile(r"(\d{10})\s*(EST)?")
# As 5014N00836E, and as N5014E00836; degrees and minutes, and perhaps seconds.
_LATITUDE, _LONGITUDE = r"(\d{4}|\d{6}(?:\.\d{1,3})?)", r"(\d{5}|\d{7}(?:\.\d{1,3})?)"
_PLACE: Final = re.compile(
    rf"(?<![\dA-Z]){_LATITUDE}([NS])\s?{_LONGITUDE}([EW])(?![\dA-Z])"
    rf"|(?<![\dA-Z])([NS]){_LATITUDE}\s?([EW]){_LONGITUDE}(?![\d])"
)
_BROKEN: Final = re.compile(r"(?<=\d)\r?\n(?=\d)")
# How two places of a list are joined: by one sign in the whole list, AND at most before its last place.
_JOINT: Final = re.compile(r"[\s,;]*+(?:(-|TO|THEN|AND)[\s,;]*+)?")
# Three digits after a comma or dot may be thousands, unless a 0 is before it.
_NUMERAL: Final = r"(?:0[.,]\d{1,3}|\d{1,6}(?:[.,]\d{1,2})?)"
_RADIUS: Final = re.compile(
    rf"(?<![\d.,/])(?<!\d\s)(?P<before>{_NUMERAL})\s?(?P<of>NM|KM|M)\s+RADIUS\b"
    rf"|\bRADIUS(?:\s+OF)?\s+(?P<after>{_NUMERAL})\s?(?P<in>NM|KM|M)\b"
)
_ROUND: Final = re.compile(r"\b(?:RADIUS|RADII|CIRCLES)\b")
_DISTANCE: Final = re.compile(r"\d\s?(?:NM|KM)\b|\bWI(?:THIN)?\s+[\d.,]+\s?M\b")
# After a place this only says where it is, as in "22NM SOUTHEAST OF"; before a place, that the area is elsewhere.
_BEARING: Final = re.compile(r"\d\s?(?:NM|KM)\s*(?:[NSEW]{1,3}|(?:NORTH|SOUTH|EAST|WEST)\w*|FM|FROM)\b")
# The area of these is larger than its places, or lies along them.
_WIDER: Final = re.compile(
    r"\b(?:(?<!\bIN )LINES?(?! (?:JOINING|CONNECTING|LINKING)\b)|EITHER|SIDES?|BUFFERS?|CORRIDORS?|(?<!\bATS )ROUTES?"
    r"|WIDTHS?|WIDE|AXIS|CENTRELINE|CENTERLINE|TRACKS?|PLUS|EXTEND\w*|EXTENSION|AROUND|SURROUNDING"
    r"|MARGINS?|SAFETY (?:ZONE|AREA|DISTANCE))\b"
)
# After the last place, more area may follow these.
_MORE: Final = re.compile(
    r"\b(?:AND(?! (?:BELOW|ABOVE|VICE VERSA)\b)|ALSO|AS WELL|TOGETHER|INCL\w*|IN ADDITION|ADDITIONAL\w*)\b|[&+]"
)
_REMARK: Final = re.compile(r"\bRMKS?\b")
# As ED-R 116, EGD201 and LF(R)45.
_NAMED_AREA: Final = re.compile(r"\b[A-Z]{2}[-\s]?\(?(?:[RDP]|TRA|TSA)\)?[-\s]?\d+")
_CONJUNCTION: Final = re.compile(r"\b(?:AND|ALSO|AS WELL|TOGETHER|ADDITION\w*)\b|[&+]")
# A place that is written in another way.
_OTHER_PLACE: Final = re.compile(r"(?<![A-Z])[NSEW]\s?\d{4,}|(?<!\d)\d{2,12}(?:\.\d{1,12})?['\"]?\s?[NSEW](?![A-Z])|°")
_LEADS_IN: Final = re.compile(r"(?:-|\bTO|\bTHEN)[\s,;]*$")
_LEADS_ON: Final = re.compile(r"[\s,;]*(?:-|TO\b|THEN\b)[\s,;]*(?!BACK|START|ORIGIN|BEGINNING|POINT OF ORIGIN|FIRST)\w")
_CURVED: Final = re.compile(r"\b(ARC|CLOCKWISE|ANTICLOCKWISE|BORDER|BOUNDARY|COAST|ALONG|FOLLOWING|SECTOR|BTN|EXC)\b")
_HEIGHT: Final = re.compile(r"FL\s?(\d{1,3})|(\d{1,5})\s?(FT|M)\s*(AMSL|MSL|AGL|ASFC|SFC|GND)?")
# What items F and G begin with.
_LIMIT: Final = re.compile(r"\s*(?:SFC|GND|UNL|FL\s?\d|\d)")
_UNITS_M: Final = {"NM": METRES_PER_NMI, "KM": 1000.0, "M": 1.0}
_MINUTE_US: Final = 60_000_000
_WHOLE_FIR: Final = 999
_LONGEST_NAME: Final = 80


def read_notam(text: str, source: str, *, skip_invalid: bool) -> Contents:
    """Return the areas of the NOTAM of a text; raises InvalidInput with all errors."""
    found = Gathered(source)
    skipped: list[Skipped] = []
    remarks: list[Remark] = []
    every = list(_split(text, found))
    if not every and not found.refusals.found:
        raise InvalidInput("file", "", "holds no NOTAM: each begins with its number, such as A0123/26 NOTAMN")
    ended = {former: key for key, kind, former, _ in every if kind in "RC" and former}
    for number, (key, kind, former, body) in enumerate(every, 1):
        who = f"NOTAM {key!r}"
        if kind == "C":
            skipped.append(Skipped(source, who, f"cancels {former}", (), is_whole=False))
            continue
        if key in ended:
            skipped.append(Skipped(source, who, f"is replaced or cancelled by {ended[key]}", (), is_whole=False))
            continue
        with found.refusals:
            items = _items(who, body)
            q = _Q.search(items.get("Q", "").replace("\n", " "))
            if q is None:
                raise InvalidInput(who, "Q", "must be FIR/Q-code/traffic/purpose/scope/lower/upper/place and radius")
            if not q[2].startswith(_SUBJECTS):
                skipped.append(
                    Skipped(source, who, f"is no airspace restriction or warning: {q[2]}", (), is_whole=False)
                )
                continue
            zone, is_rough = _zone(who, key, items, q, found)
            found.add_zone(f"NOTAM {number}", zone)
            if is_rough:
                remarks.append(Remark(source, who, "item E describes its area otherwise: the circle of item Q is used"))
    contents = found.contents(skip_invalid=skip_invalid)
    contents.skipped.extend(skipped)
    contents.remarks = remarks
    return contents


def _split(text: str, found: Gathered) -> Iterator[tuple[str, str, str | None, str]]:
    """Yield number, kind (N, R, C), number of the NOTAM that it replaces or cancels, and text of each NOTAM.

    One that another one follows whose number is not understood is refused.
    """
    heads = sorted([*_NUMBER.finditer(text), *_DOMESTIC.finditer(text)], key=re.Match.start)
    ends = [*(_begin(text, head.start()) for head in heads), len(text)]
    with found.refusals:
        _check_items_q("file", text[: ends[0]], 0)
    for head, end in zip(heads, ends[1:], strict=True):
        with found.refusals:
            body = text[head.end() : end].strip().removesuffix(")")
            if head.re is _DOMESTIC:
                rule = "is in a domestic format, and only that of ICAO is read: write it as A0123/26 NOTAMN"
                raise InvalidInput(f"NOTAM {head[1]!r}", "", rule)
            key, former = _short(head[1]), head[3] and _short(head[3])
            _check_items_q(f"NOTAM {key!r}", body, 1)
            yield key, (head[2] or "N").upper(), former, body if "Q)" in body else body.upper()


def _begin(text: str, at: int) -> int:
    """Return where a NOTAM begins whose number is at a place: with the blanks and the bracket before it."""
    while at and text[at - 1].isspace():
        at -= 1
    return at - 1 if text.endswith("(", 0, at) else at


def _short(key: str) -> str:
    """Return the number of a NOTAM in capitals, its year in two digits."""
    series, _, year = key.upper().partition("/")
    return f"{series}/{year[-2:]}"


def _check_items_q(who: str, text: str, most: int) -> None:
    """Refuse a text with more items Q than `most`."""
    marks = list(_ITEM_Q.finditer(text))[most:]
    if marks:
        before = text[: marks[0].start()].strip()
        last = before.splitlines()[-1].strip() if before else ""
        rule = f"is not understood before an item Q: each NOTAM begins such as A0123/26 NOTAMN; got {last!r:.60}"
        raise InvalidInput(who, "number of the next NOTAM" if most else "number of a NOTAM", rule)


def _items(who: str, body: str) -> dict[str, str]:
    """Return the texts of items by their letters; raises InvalidInput for one given twice or missing."""
    marks: list[re.Match[str]] = []
    limits: dict[str, list[re.Match[str]]] = {"F": [], "G": []}
    for mark in _ITEM.finditer(body):
        in_e = bool(marks) and marks[-1][1] == "E"
        if mark[1] in limits and in_e:
            text = body[marks[-1].end() : mark.start()]
            if text.count("(") <= text.count(")"):  # else it closes a parenthesis, as in "(TWY E INTO F)"
                limits[mark[1]].append(mark)
        # Letters come in this order; a later "A)" is an enumeration in item E.
        elif not marks or "QABCDEFG".index(mark[1]) > "QABCDEFG".index(marks[-1][1]):
            marks.append(mark)
    for letter in limits:
        # The last of several, and one that a height follows before all others.
        after = [mark for mark in limits[letter] if mark.start() >= marks[-1].end()]
        marks += [mark for mark in after if _LIMIT.match(body, mark.end())][-1:] or after[-1:]
    ends = [*(mark.start() for mark in marks), len(body)]
    items = {mark[1]: body[mark.end() : end].strip() for mark, end in zip(marks, ends[1:], strict=True)}
    missing = [letter for letter in "QABCE" if not items.get(letter)]
    if missing:
        raise InvalidInput(who, missing[0], "is missing")
    return items


def _zone(who: str, key: str, items: Mapping[str, str], q: "re.Match[str]", found: Gathered) -> tuple[Zone, bool]:
    """Return the zone of a NOTAM, and whether its area is the circle of item Q though item E says more."""
    start_us, end_us = _time(who, "B", items["B"]), _time(who, "C", items["C"])
    if start_us is None:
        raise InvalidInput(who, "B", f"must be ten digits, year to minute; got {items['B']!r:.40}")
    shape, is_rough = _shape(who, items["E"], q, found)
    floor_m = _height(who, "F", items.get("F"), q[3], is_floor=True)
    ceiling_m = _height(who, "G", items.get("G"), q[4], is_floor=False)
    schedule = None
    if "D" in items:
        schedule = {"notam": " ".join(items["D"].split()), "from": format_instant(start_us)}
        if end_us is not None:
            schedule["until"] = format_instant(end_us)
    named = " ".join(items["E"].split())
    name = named if len(named) <= _LONGEST_NAME else f"{named[: _LONGEST_NAME - 1]}…"
    properties = {"fir": q[1], "q_code": q[2], "text": named}
    active = [Active(start_us, end_us, schedule)]
    return Zone(key, [Volume(shape, floor_m, ceiling_m)], name, active, properties, q[2]), is_rough


def _time(who: str, item: str, text: str) -> int | None:
    """Return the time of item B or C, None for PERM; an estimated end is an end."""
    if item == "C" and text.startswith("PERM"):
        return None
    given = _TIME.match(text)
    if given is not None:
        try:
            # As in item D, 2359 and 2400 end a day.
            ends_day = item == "C" and given[1].endswith(("2359", "2400"))
            digits = f"{given[1][:6]}2359" if ends_day else given[1]
            at_us = (datetime.strptime(digits, "%y%m%d%H%M").replace(tzinfo=UTC) - EPOCH) // MICROSECOND
            return at_us + (_MINUTE_US if ends_day else 0)
        except ValueError:
            pass
    rule = "must be ten digits, year to minute" + (", or PERM" if item == "C" else "")
    raise InvalidInput(who, item, f"{rule}; got {text!r:.40}")


def _shape(who: str, text: str, q: "re.Match[str]", found: Gathered) -> tuple[shapely.MultiPolygon, bool]:
    """Return the area of a NOTAM, and whether it is the circle of item Q though item E gives coordinates."""
    text = _BROKEN.sub("", text.upper())
    places = list(_PLACE.finditer(text))
    radius = _RADIUS.search(text)
    is_plain = bool(places) and _is_plain(text, places)
    if is_plain and radius is not None and len(places) == 1 and not _has_size(_RADIUS.sub(" ", text, count=1)):
        number, unit = radius["before"] or radius["after"], radius["of"] or radius["in"]
        lon, lat = _degrees(who, places[0])
        return found.circle(who, lon, lat, float(number.replace(",", ".")) * _UNITS_M[unit]), False
    if is_plain and len(places) >= 3 and not _has_size(text) and _is_one_list(text, places):
        ring = [_degrees(who, place) for place in places]
        ring = ring if ring[0] == ring[-1] else [*ring, ring[0]]
        line = along_shortest_lines(who, "E", np.array(ring, np.float64))
        return shapely.MultiPolygon([shapely.Polygon(line)]), False
    is_rough = bool(places) or _OTHER_PLACE.search(text) is not None
    miles = int(q[9])
    if miles in (0, _WHOLE_FIR):
        raise InvalidInput(who, "Q", f"has no circle to use (radius {q[9]}), and item E no plain circle or polygon")
    lon, lat = _minutes(who, "Q", q[7], q[8], 3), _minutes(who, "Q", q[5], q[6], 2)
    # Its centre is rounded to a minute.
    return found.circle(who, lon, lat, (miles + 1) * METRES_PER_NMI), is_rough


def _is_plain(text: str, places: Sequence["re.Match[str]"]) -> bool:
    """Return whether the area of a text is that of its places alone."""
    tail = " ".join(text[places[-1].end() :].split())
    if _CURVED.search(text) or _WIDER.search(" ".join(text.split())) or _OTHER_PLACE.search(_PLACE.sub(" ", text)):
        return False
    if _MORE.search(_REMARK.split(tail)[0]) or _NAMED_AREA.search(tail):
        return False
    named = set(_NAMED_AREA.findall(text))
    return not named or (len(named) == 1 and _CONJUNCTION.search(text) is None)


def _has_size(text: str) -> bool:
    """Return whether a text gives the size of a circle, or a distance that does not only say where its place is."""
    last = max(place.end() for place in _PLACE.finditer(text))
    rest = text[:last] + _BEARING.sub(" ", text[last:])
    return _ROUND.search(rest) is not None or _DISTANCE.search(rest) is not None


def _is_one_list(text: str, places: Sequence["re.Match[str]"]) -> bool:
    """Return whether places follow each other in one list, joined in one way, which nothing continues."""
    joints = [_JOINT.fullmatch(text[before.end() : after.start()]) for before, after in pairwise(places)]
    signs = [None if joint is None else joint[1] or "" for joint in joints]
    if None in signs or len({*signs[:-1], *(sign for sign in signs[-1:] if sign != "AND")}) > 1 or "AND" in signs[:-1]:
        return False
    first = places[0][0]
    names = [place[0] for place in places]
    if first in names[1:-1]:
        return False
    if names[-1] == first:
        return True
    return _LEADS_IN.search(text[: places[0].start()]) is None and _LEADS_ON.match(text[places[-1].end() :]) is None


def _degrees(who: str, place: "re.Match[str]") -> tuple[float, float]:
    lat, north, lon, east = place.groups()[:4] if place[1] else (place[6], place[5], place[8], place[7])
    return _minutes(who, "E", lon, east, 3), _minutes(who, "E", lat, north, 2)


def _minutes(who: str, item: str, digits: str, side: str, width: int) -> float:
    """Return degrees of DDMM or DDMMSS[.sss], south and west negative; `width` digits are whole degrees."""
    whole, minutes, seconds = int(digits[:width]), int(digits[width : width + 2]), float(digits[width + 2 :] or 0.0)
    value = whole + minutes / 60.0 + seconds / 3600.0
    if minutes >= 60 or seconds >= 60.0 or value > (90.0 if width == 2 else 180.0):
        raise InvalidInput(who, item, f"holds {digits}{side}, which is no coordinate")
    return -value if side in "SW" else value


def _height(who: str, item: str, text: str | None, of_q: str, *, is_floor: bool) -> float | None:
    """Return the height of item F or G, metres above mean sea level; without it the level of item Q."""
    if text is None:
        level = int(of_q)
        if level == (0 if is_floor else _WHOLE_FIR):
            return None
        return height_m(who, "Q", float(level), "FL", "STD", is_floor=is_floor)
    text = " ".join(text.upper().split()).rstrip(".")
    if text in (("SFC", "GND") if is_floor else ("UNL",)):
        return None
    given = _HEIGHT.fullmatch(text)
    if given is None or (given[1] is None and given[4] is None):
        rule = "must be such as SFC, FL195, 2000FT AMSL or UNL, with its reference"
        raise InvalidInput(who, item, f"{rule}; got {text!r:.40}")
    if given[1] is not None:
        return height_m(who, item, float(given[1]), "FL", "STD", is_floor=is_floor)
    reference = {"ASFC": "AGL"}.get(given[4], given[4])
    return height_m(who, item, float(given[2]), given[3], reference, is_floor=is_floor)
