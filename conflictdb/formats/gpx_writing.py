"""Write tracks as routes of GPX 1.1, for plotters: places and times, one route for each voyage. `gpx` reads them."""

import math
from collections.abc import Iterator, Sequence

from conflictdb.formats.instants import format_instant
from conflictdb.formats.xml_text import writable, written
from conflictdb.model.plans import Area, Scene, Track, has_heights, has_size
from conflictdb.model.results import labelled


def gpx_lines(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    """Yield the lines of a file of routes; areas are left out."""
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield '<gpx version="1.1" creator="conflictdb" xmlns="http://www.topografix.com/GPX/1/1">\n'
    for track in tracks:
        who = f"track {track.key!r}"
        departs = [int(track.times_us[0])] if track.departures_us is None else list(track.departures_us)
        since_us = (track.times_us - track.times_us[0]).tolist()
        for at in departs:
            voyage = "" if track.departures_us is None else f" {format_instant(int(at))}"
            name = written("name", text=writable(who, "id", f"{track.key}{voyage}"))
            words = written("desc", text=writable(who, "name", labelled(track.key, track.name)))
            yield f"<rte>{name}{words}\n"
            for (lon, lat), us in zip(track.positions_deg.tolist(), since_us, strict=True):
                place = {"lat": repr(lat), "lon": repr(lon if abs(lon) <= 180.0 else math.remainder(lon, 360.0))}
                yield written("rtept", place, written("time", text=format_instant(int(at + us)))) + "\n"
            yield "</rte>\n"
    yield "</gpx>\n"


def has_more(track: Track) -> bool:
    """Return whether a track has more than a way and times."""
    return has_size(track) or has_heights(track) or track.tolerances is not None
