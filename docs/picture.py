"""Draws the shipped scene at one instant, with the times of its conflicts below: docs/strait.svg; a pair of it; delays.

    ./run python docs/picture.py

Everything in it is the program's own answer: `conflictdb.read` gives the objects, `conflictdb.solve` the conflicts, and
where a pair is in conflict at that instant is what its two polygons share. A test says when the file is out of date.
"""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from importlib.resources import files
from math import cos, radians
from pathlib import Path
from typing import Final

import numpy as np
import shapely

from conflictdb import Conflict, EarthModel, Track, delays, plot_coordination, plot_delays, read, solve
from conflictdb.earth.geodesy import earth_of, rhumb_direct, rhumb_inverse
from conflictdb.plot.figures import save

PICTURE: Final = Path(__file__).resolve().parent / "strait.svg"
PAIR: Final = PICTURE.with_name("pair.svg")
DEPARTURES: Final = PICTURE.with_name("departures.svg")
COORDINATION: Final = PICTURE.with_name("coordination.svg")
AT: Final = datetime(2026, 6, 1, 9, 10, tzinfo=UTC)
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)

# The map: what it shows, and where it lies in the picture. A degree of longitude is this much shorter at its latitude.
WIDTH: Final = 720
WEST, EAST, SOUTH, NORTH = 8.2, 9.8, 57.7, 58.19
MAP_LEFT, MAP_TOP, MAP_WIDTH = 16.0, 16.0, WIDTH - 32.0
SCALE: Final = MAP_WIDTH / (EAST - WEST)
STRETCH: Final = 1.0 / cos(radians((SOUTH + NORTH) / 2.0))
MAP_HEIGHT: Final = round((NORTH - SOUTH) * SCALE * STRETCH)

# The timeline: hours it shows, and where they lie.
FIRST, LAST = AT.replace(hour=7, minute=0), AT.replace(hour=12, minute=30)
BAR_LEFT, BAR_RIGHT = 152.0, 556.0
ROWS_TOP: Final = MAP_TOP + MAP_HEIGHT + 46.0
ROW: Final = 21.0

# Where names stand: longitude, latitude, which end of the text; and of what else a line leads to, a place of it.
NAMES: Final[dict[str, tuple[float, float, str]]] = {
    "FIRING": (9.475, 57.768, "end"),
    "DIVING": (8.925, 58.03, "start"),
    "CABLE": (8.225, 57.964, "start"),
    "FERRY": (9.2, 57.94, "start"),
    "TOW": (8.505, 57.921, "end"),
    "SUB-1": (8.595, 58.083, "end"),
    "SUB-2": (9.145, 57.826, "start"),
}
LEADERS: Final = {"DIVING": (8.95, 57.952), "FERRY": (8.975, 57.893)}

STYLE: Final = """\
  .paper { fill: #fbfaf7 } .sea { fill: #f1f3f3 } .line { stroke: #dcdfdf; stroke-width: 1 }
  text { font-family: -apple-system, "Segoe UI", "Helvetica Neue", Arial, sans-serif; font-size: 12px; fill: #3b424c }
  .soft { fill: #6b7480 } .now { font-weight: 600 } .name { font-weight: 600; letter-spacing: .04em; font-size: 11px }
  .halo { paint-order: stroke; stroke: #f1f3f3; stroke-width: 3px; stroke-linejoin: round }
  .area { fill: #7d8a99; fill-opacity: .13; stroke: #7d8a99; stroke-width: 1 }
  .way { fill: none; stroke: #7d8a99; stroke-width: 1; stroke-dasharray: 2 3 }
  .haven { fill: #33475b; fill-opacity: .22 }
  .conflict { fill: #d9480f; fill-opacity: .72 } .bar { fill: #d9480f; fill-opacity: .38 } .bar.on { fill-opacity: 1 }
  .edge { fill: none; stroke: #33475b; stroke-width: 1.25; stroke-linejoin: round } .leader { stroke: #33475b }
  .cursor { stroke: #3b424c; stroke-width: 1.25 }
  @media (prefers-color-scheme: dark) {
    .paper { fill: #0f1419 } .sea { fill: #161d24 } .line { stroke: #28323b } text { fill: #cfd6dd }
    .soft { fill: #8b97a3 } .halo { stroke: #161d24 } .area { fill: #8fa1b3; stroke: #6f8091 } .way { stroke: #6f8091 }
    .haven { fill: #b8c9d9 } .edge, .leader { stroke: #b8c9d9 } .conflict, .bar { fill: #ff7d45 }
    .cursor { stroke: #cfd6dd }
  }"""


def main() -> None:
    """Write the pictures."""
    PICTURE.write_text(picture())
    scene, areas, tracks, _ = read(files("conflictdb") / "scenes" / "strait.geojson")
    ferry = next(one for one in solve(tracks, areas, scene) if (one.a_key, one.b_key) == ("FERRY", "TOW"))
    save(ferry.plot(), PAIR)
    of_key = {track.key: track for track in tracks}
    save(plot_delays(delays(tracks, areas, scene)), DEPARTURES)
    save(plot_coordination(scene, of_key["FERRY"], of_key["TOW"]), COORDINATION)


def picture() -> str:
    """Return the picture as SVG."""
    scene, areas, tracks, _ = read(files("conflictdb") / "scenes" / "strait.geojson")
    found = sorted(solve(tracks, areas, scene), key=lambda one: one.periods[0])
    shapes = {
        area.key: shapely.MultiPolygon(area.footprint)
        for area in areas
        if is_on(instant(area.start_us), instant(area.end_us))
    }
    shapes |= {track.key: haven for track in tracks if (haven := haven_at(track, AT))}
    now = [one for one in found if any(is_on(*period) for period in one.periods)]
    shared = shapely.normalize(shapely.union_all([shapes[one.a_key] & shapes[one.b_key] for one in now]))
    height = round(ROWS_TOP + ROW * len(found) + 34.0)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}">',
            "<title>A strait at 09:10, and when its plans are in conflict</title>",
            f"<style>\n{STYLE}\n</style>",
            f'<rect class="paper" width="{WIDTH}" height="{height}" rx="8"/>',
            '<clipPath id="map"><rect ' + rectangle(MAP_LEFT, MAP_TOP, MAP_WIDTH, MAP_HEIGHT) + ' rx="4"/></clipPath>',
            '<g clip-path="url(#map)">',
            '<rect class="sea" ' + rectangle(MAP_LEFT, MAP_TOP, MAP_WIDTH, MAP_HEIGHT) + "/>",
            *graticule(),
            *(f'<path class="area" d="{outline(shapes[area.key])}"/>' for area in areas if area.key in shapes),
            *(f'<path class="way" d="{way(track)}"/>' for track in tracks if track.key in shapes),
            *(f'<path class="haven" d="{outline(shapes[track.key])}"/>' for track in tracks if track.key in shapes),
            f'<path class="conflict" d="{outline(shared)}"/>',
            *(f'<path class="edge" d="{outline(shapes[track.key])}"/>' for track in tracks if track.key in shapes),
            *(line for key in NAMES for line in name(key)),
            text(MAP_LEFT + 12, MAP_TOP + 24, f"{AT:%-d %B %Y, %H:%M} UTC", "now halo"),
            *kilometres(),
            "</g>",
            *timeline(found, now),
            "</svg>\n",
        ]
    )


def instant(us: int | None) -> datetime | None:
    """Return the instant of microseconds since 1970; None is unbounded."""
    return None if us is None else EPOCH + timedelta(microseconds=us)


def is_on(start: datetime | None, end: datetime | None) -> bool:
    """Return whether a span holds the instant of the picture."""
    return (start is None or start <= AT) and (end is None or end >= AT)


def haven_at(track: Track, at: datetime) -> shapely.Polygon | None:
    """Return where the haven of a track is, longitude and latitude in degrees; None if it is not under way."""
    at_us = (at - EPOCH) // timedelta(microseconds=1)
    leg = int(np.searchsorted(track.times_us, at_us, side="right")) - 1
    if not 0 <= leg < len(track.times_us) - 1:
        return None
    earth = earth_of(EarthModel.WGS84)
    start, end = track.positions_deg[leg : leg + 2]
    length_m, bearing_deg = rhumb_inverse(earth, *start, *end)
    share = (at_us - track.times_us[leg]) / (track.times_us[leg + 1] - track.times_us[leg])
    place = rhumb_direct(earth, *start, bearing_deg, share * length_m)
    starboard, forward = track.outline_m.T
    ahead = rhumb_direct(earth, *place, bearing_deg, forward)
    return shapely.Polygon(np.column_stack(rhumb_direct(earth, *ahead, bearing_deg + 90.0, starboard)))


def xy(lon_deg: float, lat_deg: float) -> str:
    """Return where a place is in the picture."""
    return f"{MAP_LEFT + (lon_deg - WEST) * SCALE:.1f} {MAP_TOP + (NORTH - lat_deg) * SCALE * STRETCH:.1f}"


def outline(shape: shapely.Geometry) -> str:
    """Return the rings of a geometry as a path."""
    rings = [part.exterior.coords[:-1] for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)]
    return " ".join("M" + " L".join(xy(*vertex) for vertex in ring) + " Z" for ring in rings)


def way(track: Track) -> str:
    """Return the way of a track as a path."""
    return "M" + " L".join(xy(*position) for position in track.positions_deg)


def rectangle(x: float, y: float, width: float, height: float) -> str:
    """Return a rectangle's place as attributes."""
    return f'x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"'


def text(x: float, y: float, what: str, style: str = "", anchor: str = "start") -> str:
    """Return a line of text."""
    return f'<text x="{x:.1f}" y="{y:.1f}" class="{style}" text-anchor="{anchor}">{what}</text>'


def name(key: str) -> Iterator[str]:
    """Yield the name of an object on the map, and a line from it to the object where it stands aside."""
    lon, lat, anchor = NAMES[key]
    x, y = xy(lon, lat).split()
    if key in LEADERS:
        yield f'<path class="leader" d="M{xy(*LEADERS[key])} L{float(x) - 4:.1f} {float(y) - 4:.1f}"/>'
    yield text(float(x), float(y), key, "name halo", anchor)


def graticule() -> Iterator[str]:
    """Yield lines every half degree of longitude and tenth of latitude."""
    for lon in (8.5, 9.0, 9.5):
        yield f'<path class="line" d="M{xy(lon, SOUTH)} L{xy(lon, NORTH)}"/>'
    for lat in (57.8, 57.9, 58.0, 58.1):
        yield f'<path class="line" d="M{xy(WEST, lat)} L{xy(EAST, lat)}"/>'


def kilometres() -> Iterator[str]:
    """Yield a scale of ten kilometres."""
    lat = (SOUTH + NORTH) / 2.0
    east, _ = rhumb_direct(earth_of(EarthModel.WGS84), WEST, lat, 90.0, 10_000.0)
    length = (float(east) - WEST) * SCALE
    x, y = MAP_LEFT + MAP_WIDTH - 14.0 - length, MAP_TOP + MAP_HEIGHT - 14.0
    yield f'<path class="cursor" d="M{x:.1f} {y:.1f} h{length:.1f}"/>'
    yield text(x + length / 2.0, y - 6.0, "10 km", "soft", "middle")


def across(at: datetime) -> float:
    """Return where an instant is on the timeline."""
    return BAR_LEFT + (BAR_RIGHT - BAR_LEFT) * ((at - FIRST) / (LAST - FIRST))


def timeline(found: list[Conflict], now: list[Conflict]) -> Iterator[str]:
    """Yield a row for each conflict, with its periods, and the instant of the picture across all."""
    bottom = ROWS_TOP + ROW * len(found)
    for hour in range(FIRST.hour, LAST.hour + 1):
        x = across(FIRST.replace(hour=hour))
        yield f'<path class="line" d="M{x:.1f} {ROWS_TOP - 8:.1f} V{bottom:.1f}"/>'
        yield text(x, bottom + 16.0, f"{hour:02}:00", "soft", "middle")
    for row, one in enumerate(found):
        y = ROWS_TOP + ROW * row
        is_now = one in now
        yield text(MAP_LEFT, y + 11.0, f"{one.a_key} · {one.b_key}", "now" if is_now else "soft")
        for start, end in one.periods:
            x0, x1 = across(start), across(end)
            place = rectangle(x0, y + 1.5, max(x1 - x0, 2.0), 12.0)
            yield f'<rect class="bar{" on" if is_now else ""}" {place} rx="2"/>'
        # Rounded outward to the second, as tables are.
        whole = [one.first_contact, one.last_contact + timedelta(seconds=1) - timedelta(microseconds=1)]
        clock = [f"{contact:%H:%M:%S}" for contact in whole]
        yield text(WIDTH - 16.0, y + 11.0, " \N{EN DASH} ".join(clock), "now" if is_now else "soft", "end")
    x = across(AT)
    yield f'<path class="cursor" d="M{x:.1f} {ROWS_TOP - 12:.1f} V{bottom:.1f}"/>'
    yield text(MAP_LEFT, ROWS_TOP - 17.0, "in conflict", "soft")
    yield text(WIDTH - 16.0, ROWS_TOP - 17.0, "first and last contact, UTC", "soft", "end")
    yield text(x, ROWS_TOP - 17.0, f"{AT:%H:%M}", "now", "middle")


if __name__ == "__main__":
    main()
