"""Write areas and moving havens as operational intents of ASTM F3548-21: volumes that contain them.

A moving haven becomes volumes one after the other in time: the hulls of its pieces. Edges are shortest lines: shapes
are wider by 2 metres, and the rhumb lines between their vertices are so short that shortest lines deviate from them by
at most half a metre.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.objects import TrackBatch
from conflictdb.core.pieces.cutting import planar, track_pieces
from conflictdb.core.world import World
from conflictdb.earth.geodesy import WGS84_RADIUS_M, earth_of, rhumb_distance, shorter_way_deg
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.exchange.operational_intents import EXTENSION
from conflictdb.formats.file_heights import refuse_flight_levels
from conflictdb.formats.file_objects import columns_aside
from conflictdb.formats.instants import format_instant
from conflictdb.formats.json_text import dumped
from conflictdb.formats.single_activations import spans_of, voyages_of
from conflictdb.model.plans import Area, Motion, Scene, Track, VerticalDatum
from conflictdb.model.tolerances import PER_LEG

Floats = NDArray[np.float64]

# The geoid lies between 107 m below and 86 m above the ellipsoid (EGM96, EGM2008), rounded outward.
_GEOID_BELOW_M: Final = 108.0
_GEOID_ABOVE_M: Final = 87.0
# Heights that the standard allows.
_LEAST_M, _MOST_M = -8_000.0, 100_000.0
_DEVIATION_M: Final = 0.5
_WIDER_M: Final = 2.0
# Nearer to a pole the plane of rhumb lines stretches too much.
_HIGHEST_DEG: Final = 85.0
# Least length of the way in a volume, in havens; and about the number of volumes of a track.
_HAVENS: Final = 4.0
_LEAST_STEP_M: Final = 500.0
_MOST_STEPS: Final = 200
_LEVEL: Final = 1e-9  # change of the isometric latitude of a parallel


def f3548_lines(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track]) -> Iterator[str]:
    """Yield the lines of a list of operational intents; raises InvalidInput for an area without a start or an end."""
    setup = World.around(scene, areas, tracks).setup
    yield "["
    separator = "\n"
    items: list[Area | Track] = [*areas, *tracks]
    for one in items:
        volumes = _of_area(setup, one) if isinstance(one, Area) else _of_track(setup, one)
        details = {"volumes": list(volumes), "off_nominal_volumes": [], "priority": 0}
        reference = {"id": one.key, **_extension(one)}
        yield f"{separator}{dumped({'reference': reference, 'details': details})}"
        separator = ",\n"
    yield " ]\n"


def _of_area(setup: Setup, area: Area) -> Iterator[Mapping[str, Any]]:
    who = f"area {area.key!r}"
    spans = [(start, end) for start, end in spans_of(area) if start is not None and end is not None]
    if len(spans) < len(spans_of(area)):
        raise InvalidInput(who, "start", "and end must be given: an operational intent has both")
    flat = planar(setup.plane, np.array([area.footprint], dtype=object))[0]
    for part in shapely.get_parts(flat):
        ring = shapely.Polygon(part.exterior)  # a volume has no holes
        for span in spans:
            yield _volume(who, setup, ring, span, (area.floor_m, area.ceiling_m))


def _extension(item: Area | Track) -> dict[str, Any]:
    """Return what the standard has no member for, as a member of the reference."""
    found = {**columns_aside(item), "properties": dict(item.properties)}
    given = {name: one for name, one in found.items() if one}
    return {EXTENSION: given} if given else {}


def _of_track(setup: Setup, track: Track) -> Iterator[Mapping[str, Any]]:
    return chain.from_iterable(_of_voyage(setup, one) for one in voyages_of(track))


def _of_voyage(setup: Setup, track: Track) -> Iterator[Mapping[str, Any]]:
    who = f"track {track.key!r}"
    pieces = track_pieces(setup, TrackBatch.of([in_steps(setup.scene, track)]))
    for i in np.flatnonzero(pieces.turn == 0).tolist():
        hull = pieces.hull_xy[pieces.hull_offset[i] : pieces.hull_offset[i + 1]]
        if not len(hull) or not np.isfinite(hull).all():
            raise InvalidInput(who, "geometry", "has a haven too wide to be cut into volumes")
        heights = (float(pieces.floor_m[i]), float(pieces.ceiling_m[i]))
        bounded = tuple(one if np.isfinite(one) else None for one in heights)
        shape = shapely.MultiPoint(hull).convex_hull
        yield _volume(who, setup, shape, (int(pieces.start_us[i]), int(pieces.end_us[i])), (bounded[0], bounded[1]))


def in_steps(scene: Scene, track: Track) -> Track:
    """Return the same movement with more waypoints, so that each volume is a few havens long; some 200 in all.

    Tracks whose haven or heights change from leg to leg, and great circles, stay as they are: their volumes are longer.
    """
    per_leg = (track.outlines_m, track.floors_m, track.ceilings_m)
    if scene.motion == Motion.GREAT_CIRCLE or any(one is not None for one in per_leg):
        return track
    earth = earth_of(scene.earth)
    lon, lat = track.positions_deg.T
    lon = lon[0] + np.concatenate([[0.0], np.cumsum(shorter_way_deg(np.diff(lon)))])
    lengths_m = rhumb_distance(earth, lon[:-1], lat[:-1], lon[1:], lat[1:])
    haven_m = 2.0 * float(np.hypot(*track.outline_m.T).max())
    step_m = max(_HAVENS * haven_m, _LEAST_STEP_M, float(lengths_m.sum()) / _MOST_STEPS)
    mu = earth.rectifying(np.radians(lat))
    ends = earth.isometric(mu)
    counts = np.minimum(np.maximum(np.ceil(lengths_m / step_m), 1.0).astype(np.int64), np.diff(track.times_us))
    limits = track.tolerances or {}
    radii_m = np.broadcast_to(limits.get("turn_radius_m", 0.0), (len(lat) - 2,)) if len(lat) > 2 else np.zeros(0)
    if radii_m.any():
        bearings = np.arctan2(np.radians(np.diff(lon)), np.diff(ends))
        counts = np.minimum(counts, _undivided(lengths_m, bearings, radii_m))
    leg = np.repeat(np.arange(len(counts)), counts)
    first = np.cumsum(counts) - counts
    share = (np.arange(len(leg)) - np.repeat(first, counts)) / counts[leg]
    between = mu[leg] + share * np.diff(mu)[leg]
    psi = earth.isometric(between)
    rise = np.diff(ends)[leg]
    # Along a parallel the longitude changes evenly.
    east = np.where(np.abs(rise) > _LEVEL, (psi - ends[leg]) / np.where(rise == 0.0, 1.0, rise), share)
    places = np.stack([lon[leg] + east * np.diff(lon)[leg], np.degrees(earth.latitude(psi))], axis=1)
    places[share == 0.0] = np.stack([lon, lat], axis=1)[:-1]
    times_us = track.times_us[leg] + np.rint(share * np.diff(track.times_us)[leg]).astype(np.int64)
    turns_m = np.zeros(max(len(leg) - 1, 0))
    turns_m[first[1:] - 1] = radii_m
    return replace(
        track,
        positions_deg=np.concatenate([places, [[lon[-1], lat[-1]]]]),
        times_us=np.append(times_us, track.times_us[-1]),
        tolerances=_in_legs(limits, leg, turns_m) or None,
        max_speed_kn=np.inf,
    )


def _undivided(lengths_m: Floats, bearings: Floats, radii_m: Floats) -> NDArray[np.int64]:
    """Return into how many parts a leg may be cut so that the arcs at its ends stay within the first and the last.

    bearings : (n,) radians; radii_m : (n - 1,) of the arcs between legs
    """
    turns = np.abs(np.remainder(np.diff(bearings) + np.pi, 2.0 * np.pi) - np.pi)
    # As the ribbons have them, a little longer.
    arcs_m = 1.01 * np.minimum(
        radii_m * np.tan(0.5 * np.minimum(turns, 3.0)), 0.5 * np.minimum(lengths_m[:-1], lengths_m[1:])
    )
    longest_m = np.maximum(np.append(0.0, arcs_m), np.append(arcs_m, 0.0))
    parts = np.divide(lengths_m, 2.0 * longest_m, out=np.full(len(lengths_m), np.inf), where=longest_m > 0.0)
    return np.asarray(np.clip(np.floor(parts), 1.0, float(2**40)).astype(np.int64))


def _in_legs(limits: Mapping[str, Any], leg: NDArray[np.int64], turns_m: Floats) -> dict[str, Any]:
    """Return tolerances for more legs, each a part of a leg of the plan.

    leg : (n,) the leg of the plan that each belongs to
    turns_m : (n - 1,) radii of turns
    """
    found = dict(limits)
    for name in PER_LEG:
        if isinstance(limits.get(name), Sequence):
            found[name] = [limits[name][k] for k in leg.tolist()]
    if "turn_radius_m" in found:
        found["turn_radius_m"] = turns_m.tolist()
    return found


def _volume(
    who: str,
    setup: Setup,
    flat: shapely.Geometry,
    span_us: tuple[int, int],
    heights_m: tuple[float | None, float | None],
) -> Mapping[str, Any]:
    """Return a volume that contains a shape of the plane."""
    lat = np.abs(setup.plane.from_plane(*shapely.get_coordinates(flat).T)[1]).max()
    if lat > _HIGHEST_DEG:
        raise InvalidInput(who, "geometry", f"reaches beyond {_HIGHEST_DEG:g} degrees of latitude")
    # A plane of rhumb lines stretches by the secant of the latitude; one of great circles by at most 4.
    stretch = max(4.0, 1.1 / float(np.cos(np.radians(lat))))
    most_m = np.sqrt(8.0 * _DEVIATION_M * 0.99 * WGS84_RADIUS_M / np.tan(np.radians(max(lat + 0.5, 1.0))))
    wide = flat.buffer(_WIDER_M * stretch, quad_segs=2).segmentize(float(most_m))
    lon, lat_deg = setup.plane.from_plane(*shapely.get_coordinates(wide.exterior)[:-1].T)
    lon = np.remainder(lon + 180.0, 360.0) - 180.0
    floor_m, ceiling_m = heights_m
    if floor_m is not None or ceiling_m is not None:
        refuse_flight_levels(setup.scene, "ASTM F3548")
    is_above_sea = setup.scene.vertical_datum is VerticalDatum.MSL
    below_m, above_m = (_GEOID_BELOW_M, _GEOID_ABOVE_M) if is_above_sea else (0.0, 0.0)
    lower = _LEAST_M if floor_m is None else max(_LEAST_M, floor_m - below_m)
    upper = _MOST_M if ceiling_m is None else min(_MOST_M, ceiling_m + above_m)
    vertices = [{"lng": x, "lat": y} for x, y in zip(lon.tolist(), lat_deg.tolist(), strict=True)]
    return {
        "volume": {
            "outline_polygon": {"vertices": vertices},
            "altitude_lower": {"value": lower, "reference": "W84", "units": "M"},
            "altitude_upper": {"value": upper, "reference": "W84", "units": "M"},
        },
        "time_start": {"value": format_instant(span_us[0]), "format": "RFC3339"},
        "time_end": {"value": format_instant(span_us[1]), "format": "RFC3339"},
    }
