"""Conflicts as iCalendar (RFC 5545), for calendars: an event for each period, and for each activation of an area."""

import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from typing import Final, NamedTuple

from conflictdb.errors import printable
from conflictdb.model.results import Conflict, Verdict, labelled, position_of

_LINE_END: Final = "\r\n"
_MOST_BYTES: Final = 75  # of a line; longer ones continue on the next, after a blank
_SECOND: Final = timedelta(seconds=1)
_ESCAPED: Final = str.maketrans({"\\": "\\\\", ";": "\\;", ",": "\\,"})


class Activation(NamedTuple):
    """A time at which an area of a scene is active."""

    scene: str
    key: str
    name: str | None
    start: datetime
    end: datetime


def as_ics(
    conflicts: Iterable[Conflict],
    leave_out: Callable[[Conflict], object] = lambda _: None,
    activations: Sequence[Activation] = (),
) -> Iterator[str]:
    """Yield the lines of a calendar; `leave_out` is called with conflicts that have no start or no end.

    Periods are rounded outward to the second. An event keeps its identity from one export to the next.
    """
    yield from map(_folded, ("BEGIN:VCALENDAR", "VERSION:2.0", "PRODID:-//conflictdb//conflictdb//EN"))
    for active in activations:
        yield from map(_folded, _active_event(active))
    for one in conflicts:
        bounded = [(start, end) for start, end in one.periods if start is not None and end is not None]
        if not bounded or len(bounded) < len(one.periods):
            leave_out(one)
            continue
        for n, (start, end) in enumerate(bounded):
            yield from map(_folded, _event(one, n, start, end))
    yield _folded("END:VCALENDAR")


def _active_event(one: Activation) -> Iterator[str]:
    yield "BEGIN:VEVENT"
    identity = ("conflictdb", one.scene, one.key, "active", one.start.isoformat())
    yield f"UID:{uuid.uuid5(uuid.NAMESPACE_OID, repr(identity))}"
    yield f"DTSTAMP:{_stamp(datetime.now(UTC))}"
    yield f"DTSTART:{_stamp(one.start)}"
    yield f"DTEND:{_stamp(one.end + (_SECOND if one.end.microsecond or one.end == one.start else timedelta(0)))}"
    yield f"SUMMARY:{_text(f'{labelled(one.key, one.name)}: active')}"
    yield "CATEGORIES:active"
    yield "STATUS:CONFIRMED"
    yield f"DESCRIPTION:{_text(f'scene {one.scene}')}"
    yield "END:VEVENT"


def _event(one: Conflict, n: int, start: datetime, end: datetime) -> Iterator[str]:
    yield "BEGIN:VEVENT"
    yield f"UID:{uuid.uuid5(uuid.NAMESPACE_OID, repr(('conflictdb', one.scene, one.a_key, one.b_key, n)))}"
    yield f"DTSTAMP:{_stamp(one.changed_at or one.found_at or datetime.now(UTC))}"
    yield f"DTSTART:{_stamp(start)}"
    yield f"DTEND:{_stamp(end + (_SECOND if end.microsecond or end == start else timedelta(0)))}"
    labels = " / ".join(one.labels)
    yield f"SUMMARY:{_text(f'{labels}: {one.verdict}')}"
    yield f"CATEGORIES:{_text(str(one.verdict))}"
    yield f"STATUS:{'CONFIRMED' if one.verdict is Verdict.CONFLICT else 'TENTATIVE'}"
    if n == 0 and (place := position_of(one)) is not None:
        yield f"GEO:{place[1]:.6f};{place[0]:.6f}"
    yield f"DESCRIPTION:{_text(f'scene {one.scene}')}"
    yield "END:VEVENT"


def _stamp(moment: datetime) -> str:
    moment = moment.astimezone(UTC)
    return f"{moment.year:04d}{moment:%m%dT%H%M%SZ}"


def _text(text: str) -> str:
    return printable(text).translate(_ESCAPED)


def _folded(line: str) -> str:
    """Return a line with its end, broken between characters where it is too long."""
    parts, size = [""], 0
    for sign in line:
        width = len(sign.encode())
        if size + width > _MOST_BYTES:
            parts.append(" ")
            size = 1
        parts[-1] += sign
        size += width
    return _LINE_END.join([*parts, ""])
