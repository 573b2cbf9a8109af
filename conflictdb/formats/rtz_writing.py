"""Write a track as a route of an ECDIS: RTZ 1.2.

Legs are loxodromes, or orthodromes in scenes of great circles. What RTZ has no room for (the haven, heights,
properties) is in an extension, as in scene files; `rtz` reads it back. Cross-track limits are the sides of the haven,
rounded up.
"""

import math
import re
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from conflictdb.errors import InvalidInput
from conflictdb.formats.file_objects import datum_of, track_properties
from conflictdb.formats.instants import format_instant
from conflictdb.formats.json_text import dumped
from conflictdb.formats.xml_text import writable, written
from conflictdb.model.plans import METRES_PER_NMI, Area, Motion, Scene, Track, is_by_legs

EXTENSION: Final = {"manufacturer": "conflictdb", "name": "track", "version": "1.0"}
# Members of an extension that the route itself has.
_OF_ROUTE: Final = ("kind", "times", "name")
_STEP_NMI: Final = 1e-4
# Signs that names of files do not have on every system; characters of a name.
_NO_NAME: Final = re.compile(r"[^\w .-]|^[. ]|[. ]$")
# Names of devices on Windows, with any ending.
_DEVICE: Final = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)\s*(\.|$)", re.IGNORECASE)
_LONGEST_STEM: Final = 60


def rtz_lines(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    """Yield the lines of a file of one track; raises InvalidInput for other objects."""
    if areas or len(tracks) != 1:
        rule = f"holds one track; here are {len(tracks)} tracks and {len(areas)} areas: name the key of one"
        rule += ", or write a folder by --format rtz"
        raise InvalidInput("RTZ", "", rule)
    (track,) = tracks
    kind = "Orthodrome" if scene.motion == Motion.GREAT_CIRCLE else "Loxodrome"
    is_steady = not is_by_legs(track)
    name = writable(f"track {track.key!r}", "id", track.key)
    yield '<?xml version="1.0" encoding="UTF-8"?>\n'
    yield '<route xmlns="http://www.cirm.org/RTZ/1/2" version="1.2">\n'
    yield written("routeInfo", {"routeName": name}) + "\n<waypoints>\n"
    yield written("defaultWaypoint", None, written("leg", {**_limits(track), "geometryType": kind})) + "\n"
    calls: list[str] = []
    times = track.times_us.tolist()
    i = 0
    while i < len(times):
        lon, lat = track.positions_deg[i].tolist()
        number = len(calls) + 1
        place = {"lat": repr(lat), "lon": repr(lon if abs(lon) <= 180.0 else math.remainder(lon, 360.0))}
        yield written("waypoint", {"id": number}, written("position", place)) + "\n"
        # A route has two waypoints at least, also of a track that only stays.
        stays = is_steady and i + 1 < len(times) and len(times) > 2
        stays = stays and bool(np.all(track.positions_deg[i] == track.positions_deg[i + 1]))
        eta = format_instant(times[i]) if i or stays else None
        etd = format_instant(times[i + 1] if stays else times[i]) if stays or not i else None
        calls.append(written("scheduleElement", {"waypointId": number, "eta": eta, "etd": etd}))
        i += 1 + stays
    yield "</waypoints>\n"
    schedule = written("schedule", {"id": 1}, written("manual", None, *calls))
    yield written("schedules", None, schedule) + "\n"
    members = {member: one for member, one in track_properties(track).items() if member not in _OF_ROUTE}
    members["name"] = track.name
    extension = {
        **EXTENSION,
        **datum_of(scene, track),
        "track": writable(f"track {name!r}", "properties", dumped(members)),
    }
    yield written("extensions", None, written("extension", extension)) + "\n"
    yield "</route>\n"


def file_names(tracks: Sequence[Track]) -> list[str]:
    """Return the name of a file for each track, made from its key, each once, also where case does not count."""
    found: list[str] = []
    taken: set[str] = set()
    for track in tracks:
        stem = _NO_NAME.sub("_", track.key)[:_LONGEST_STEM] or "_"
        stem = f"_{stem}" if _DEVICE.match(stem) else stem
        name, n = f"{stem}.rtz", 2
        while name.casefold() in taken:
            name, n = f"{stem}-{n}.rtz", n + 1
        taken.add(name.casefold())
        found.append(name)
    return found


def _limits(track: Track) -> dict[str, str]:
    """Return the cross-track limits of a track: how far its haven reaches to port and starboard, nautical miles."""
    outlines = track.outline_m if track.outlines_m is None else track.outlines_m.reshape(-1, 2)
    grown_m = track.grow_mps * float(track.times_us[-1] - track.times_us[0]) / 1e6
    limits = {side: np.max((track.tolerances or {}).get(f"xtd_{side}_m", 0.0)) for side in ("port", "starboard")}
    sides = {
        "portside": (-outlines[:, 0].min(), limits["port"]),
        "starboard": (outlines[:, 0].max(), limits["starboard"]),
    }
    reach = {name: max(0.0, float(side)) + float(limit) + grown_m for name, (side, limit) in sides.items()}
    return {
        f"{name}XTD": f"{math.ceil(one / METRES_PER_NMI / _STEP_NMI) * _STEP_NMI:.4f}" for name, one in reach.items()
    }
