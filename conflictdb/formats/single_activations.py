"""Take the activations of areas and the voyages of tracks one by one, for formats that know no schedules."""

from collections.abc import Iterator
from dataclasses import replace

from conflictdb.errors import InvalidInput
from conflictdb.model.plans import Area, Track

_NOT_EXPANDED = "is not expanded to times, which the format needs: load the scene, and export it from the database"


def spans_of(area: Area) -> tuple[tuple[int | None, int | None], ...]:
    """Return the spans of an area; raises InvalidInput for a schedule that is not expanded."""
    if area.spans_us is not None:
        return area.spans_us
    if area.schedule is not None:
        raise InvalidInput(f"area {area.key!r}", "schedule", _NOT_EXPANDED)
    return ((area.start_us, area.end_us),)


def voyages_of(track: Track) -> Iterator[Track]:
    """Yield a track for each of its voyages, with its key; raises InvalidInput for a schedule that is not expanded."""
    if track.departures_us is None:
        if track.schedule is not None:
            raise InvalidInput(f"track {track.key!r}", "schedule", _NOT_EXPANDED)
        yield track
        return
    for departure_us in track.departures_us:
        times_us = track.times_us - int(track.times_us[0]) + departure_us
        yield replace(track, times_us=times_us, departures_us=None, schedule=None, max_speed_kn=float("inf"))
