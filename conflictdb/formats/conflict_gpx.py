"""Conflicts as GPX 1.1, for plotters: a waypoint where each pair first touches."""

from collections.abc import Callable, Iterable, Iterator
from html import escape
from typing import Final

from conflictdb.errors import printable
from conflictdb.model.results import Conflict, format_moment, interval_text, position_of

_HEAD: Final = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="conflictdb" xmlns="http://www.topografix.com/GPX/1/1">
"""


def as_gpx(conflicts: Iterable[Conflict], leave_out: Callable[[Conflict], object] = lambda _: None) -> Iterator[str]:
    """Yield the lines of a GPX file; `leave_out` is called with conflicts without a position."""
    yield _HEAD
    for one in conflicts:
        place = position_of(one)
        if place is None:
            leave_out(one)
            continue
        at = format_moment(one.first_contact if one.periods else one.closest_at)
        time = f"<time>{at}</time>" if at else ""
        periods = interval_text(one.periods)
        labels = _text(" / ".join(one.labels))
        yield (
            f'  <wpt lat="{place[1]:.9f}" lon="{place[0]:.9f}">{time}<name>{labels}</name>'
            f"<desc>{_text(' '.join(filter(None, (one.scene, str(one.verdict), periods))))}</desc>"
            f"<type>{one.verdict}</type></wpt>\n"
        )
    yield "</gpx>\n"


def _text(text: str) -> str:
    """Return a text for XML, which cannot contain all characters."""
    return escape(printable(text), quote=False)
