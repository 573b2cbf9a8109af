"""A day of flights over Switzerland against the official drone zones, with heights and time limits (real_runs.py).

Zones: FOCA (ED-318 test data). Flights: OpenSky, 2018-08-01. Choices, all on the safe side. Heights above ground count
from sea level up to the given height above the highest ground (4,634 m). A flight is one track for each stretch within
a height band of 500 m, 50 m added for the altimeter. The flights are moved to 2025-01-15, inside the zones' dates. Each
aircraft carries a rectangle 1,000 m ahead, 500 m behind and 500 m to either side.
"""

import gzip
import json
import tempfile
import zipfile
from collections import Counter, defaultdict
from datetime import date, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from data import real_input

import conflictdb
from conflictdb import Area, InvalidInput, Scene, Track, rectangle_outline_m
from conflictdb.formats import scene_text

HIGHEST_GROUND_M = 4_634.0
UNLIMITED_M = 99_999
METRES_PER_FOOT = 0.3048
BAND_M = 500.0
ALTIMETER_M = 50.0
LONGEST_GAP_S = 600
FASTEST_MPS = 400.0
MOVED_US = (date(2025, 1, 15) - date(2018, 8, 1)).days * 86_400_000_000
OUTLINE_M = rectangle_outline_m(1_000.0, 500.0, 500.0, 500.0)


def zones(left_out: Counter[str]) -> list[Area]:
    """Return the zones as areas; those that no rule of geometry lets pass are counted by name."""
    with zipfile.ZipFile(real_input("zones-switzerland", "SwissGeozones_ED318_Testdaten.zip")) as packed:
        features = json.loads(packed.read(packed.namelist()[0]))["features"]
    found = []
    for feature in features:
        properties, layer = feature["properties"], feature["geometry"]["layer"]
        polygon = shapely.geometry.shape(feature["geometry"])
        start, end = limits(properties.get("limitedApplicability") or [])
        floor_m = float(layer["lower"]) if layer["lowerReference"] == "AMSL" else None
        ceiling_m = None
        if layer["upper"] != UNLIMITED_M:
            ceiling_m = layer["upper"] + (HIGHEST_GROUND_M if layer["upperReference"] == "AGL" else 0.0)
        try:
            found.append(
                Area(
                    key=f"{properties['identifier']}-{len(found)}",
                    footprint=shapely.MultiPolygon([polygon]),
                    name=properties["name"][0]["text"],
                    start_us=start,
                    end_us=end,
                    floor_m=floor_m,
                    ceiling_m=ceiling_m,
                )
            )
        except InvalidInput as refused:
            left_out[f"{properties['identifier']}: {refused.rule}"] += 1
    return found


def limits(periods: list[dict[str, str]]) -> tuple[int | None, int | None]:
    """Return the first start and the last end of dated limits, microseconds; daily schedules count as always."""
    dated = [p for p in periods if "startDateTime" in p and "endDateTime" in p]
    if not dated or len(dated) < len(periods):
        return None, None
    starts, ends = ([datetime.fromisoformat(p[name]) for p in dated] for name in ("startDateTime", "endDateTime"))
    return int(min(starts).timestamp()) * 1_000_000, int(max(ends).timestamp()) * 1_000_000


def flights(most: int | None, left_out: Counter[str]) -> tuple[list[Track], int]:
    """Return the flights as tracks, one for each stretch within a height band, and the number of flights."""
    with gzip.open(real_input("flights-switzerland", "switzerland.json.gz")) as packed:
        fixes = json.load(packed)
    by_aircraft = defaultdict(list)
    for fix in fixes:
        if any(fix[name] is None for name in ("altitude", "latitude", "longitude")):
            left_out["fix without position or altitude"] += 1
            continue
        by_aircraft[fix["icao24"], fix["callsign"]].append(fix)
    tracks: list[Track] = []
    count = 0
    for (icao24, callsign), own in sorted(by_aircraft.items()):
        if most is not None and count >= most:
            break
        count += 1
        for number, stretch in enumerate(stretches(own, left_out)):
            height_m = np.array([fix["altitude"] * METRES_PER_FOOT for fix in stretch])
            tracks.append(
                Track(
                    key=f"{callsign}-{icao24}-{number}",
                    positions_deg=np.array([(fix["longitude"], fix["latitude"]) for fix in stretch]),
                    times_us=np.array([fix["timestamp"] * 1000 + MOVED_US for fix in stretch]),
                    outline_m=OUTLINE_M,
                    name=callsign,
                    floor_m=float(height_m.min() - ALTIMETER_M),
                    ceiling_m=float(height_m.max() + ALTIMETER_M),
                )
            )
    return tracks, count


def stretches(fixes: list[dict[str, float]], left_out: Counter[str]) -> list[list[dict[str, float]]]:
    """Return runs of fixes within a height band; a run starts at the fix where the one before ends."""
    fixes = sorted(fixes, key=lambda fix: fix["timestamp"])
    kept = fixes[:1]
    for fix in fixes[1:]:
        gone = (fix["timestamp"] - kept[-1]["timestamp"]) / 1000.0
        if gone <= 0.0:
            left_out["fix at the time of the fix before"] += 1
        elif distance_m(kept[-1], fix) > FASTEST_MPS * gone:
            left_out["fix faster than 400 m/s from the fix before"] += 1
        else:
            kept.append(fix)
    found: list[list[dict[str, float]]] = [kept[:1]]
    for before, fix in pairwise(kept):
        heights = [f["altitude"] * METRES_PER_FOOT for f in (*found[-1], fix)]
        if fix["timestamp"] - before["timestamp"] > LONGEST_GAP_S * 1000:
            found.append([fix])
        elif max(heights) - min(heights) > BAND_M and len(found[-1]) > 1:
            found.append([before, fix])
        else:
            found[-1].append(fix)
    return [run for run in found if len(run) > 1]


def distance_m(one: dict[str, float], other: dict[str, float]) -> float:
    """Return a rough distance of two fixes, metres."""
    north = (other["latitude"] - one["latitude"]) * 111_000.0
    east = (other["longitude"] - one["longitude"]) * 111_000.0 * np.cos(np.radians(one["latitude"]))
    return float(np.hypot(north, east))


def load_day(db: conflictdb.Database, scene: str, most: int | None) -> str:
    """Load the day as a scene, with a limited number of flights; return in a line its content and its omissions."""
    left_out: Counter[str] = Counter()
    areas = zones(left_out)
    tracks, count = flights(most, left_out)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "swiss-day.geojson")
        path.write_text("".join(scene_text(Scene(scene), areas, tracks)))
        db.load(path, replace=True)
    vertices = sum(shapely.get_num_coordinates(area.footprint) for area in areas)
    fixes = sum(len(track.times_us) for track in tracks)
    skipped = "; ".join(f"{what} ({times})" for what, times in left_out.most_common())
    return (
        f"{len(areas):,} zones ({vertices:,} vertices); {count:,} flights as {len(tracks):,} tracks ({fixes:,} "
        f"waypoints); left out: {skipped}"
    )
