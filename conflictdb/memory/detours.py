"""Another way for one track: one or two waypoints more on a leg, so that it meets nothing."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from conflictdb.arrays import Floats
from conflictdb.core.world import Reach
from conflictdb.earth.geodesy import earth_of, great_circle_distance, rhumb_direct, rhumb_distance, rhumb_inverse
from conflictdb.errors import InvalidInput
from conflictdb.memory import questions
from conflictdb.memory.index import Index
from conflictdb.model import inputs
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, Motion, Scene, Track
from conflictdb.model.proposals import Detour, NewWaypoints

# Ways that are tried on each leg: where on it the waypoints are, and how far aside, by the limit.
_PLACES: Final = ((0.5,), (0.25,), (0.75,), (0.1, 0.9), (0.25, 0.75), (0.02, 0.98))
_ASIDE: Final = tuple(sign * k / 12.0 for k in range(1, 13) for sign in (-1, 1))
# How many times the best ways come nearer to the leg by halves.
_HALVINGS: Final = 6


def detours(
    tracks: Iterable[Track],
    areas: Iterable[Area],
    scene: Scene | None = None,
    *,
    key: str,
    most_m: float = 20_000.0,
    later_s: float = 7200.0,
) -> list[Detour]:
    """Return ways on which a track meets nothing, shortest first: one or two waypoints more on one of its legs.

    A detection of the changed plan and of everything else as planned finds no conflict on any of them. The track keeps
    its departure and the speed of each leg, and arrives later. Ways are tried at some places of each leg: others may be
    shorter, and an empty list does not prove that there is none. The method is `exact`.

    Raises the errors of `solve`, and InvalidInput for an unknown track and for limits that are none.

    Parameters
    ----------
    key : str
        The track.
    most_m : float
        The farthest that a new waypoint lies aside of its leg, metres.
    later_s : float
        The latest that the track may arrive, seconds later than planned.
    """
    most_m = inputs.reach_m("detours", "most_m", most_m)
    later_s = inputs.seconds("detours", "later_s", later_s)
    world, known, areas = questions.world_of("detours", tracks, areas, scene, Reach(later_us=round(1e6 * later_s)))
    scene = replace(world.setup.scene, method=Method.EXACT, nearest_m=0.0)
    planned = {track.key: track for track in known}
    if key not in planned:
        problem = "is an area" if key in {area.key for area in areas} else "is not known"
        raise InvalidInput(f"scene {scene.name!r}", "track", f"{key!r} {problem}")
    track = planned.pop(key)
    for name, value in (track.tolerances or {}).items():
        if isinstance(value, list) and name != "departure_window":
            rule = "is given by leg, or for the planned arrival: ask about a copy without it"
            raise InvalidInput(f"track {key!r}", name, rule)
    index = Index(scene)
    others: list[Area | Track] = [*areas, *planned.values()]
    if others:
        index.put(others)
    # A voyage ends before the next one departs.
    _, [whole] = world.expanded([], [track])
    waits_us = np.diff(np.array(whole.departures_us or (), np.int64)) - int(track.times_us[-1] - track.times_us[0])
    later_s = min([later_s, *(waits_us / 1e6).tolist()])
    # Longer than every key, so that no plan has the key of a way.
    prefix = max([track.key, *planned, *(area.key for area in areas)], key=len) + "#"
    return ways_of(index, prefix, scene, track, most_m, later_s)


def ways_of(index: Index, prefix: str, scene: Scene, track: Track, most_m: float, later_s: float) -> list[Detour]:
    """Return ways on which a track meets nothing of an index, shortest first.

    prefix : longer than every key of the index
    """
    found: list[Detour] = []
    for leg in range(len(track.positions_deg) - 1):
        for places in _PLACES:
            ways = [(aside, _way(scene, track, leg, places, aside * most_m)) for aside in _ASIDE]
            free = _free(
                index, prefix, [(aside, way) for aside, way in ways if way is not None and way.later_s <= later_s]
            )
            for sign in (-1.0, 1.0):
                sides = sorted((abs(aside), way) for aside, way in free if aside * sign > 0.0)
                if sides:
                    found.append(_nearer(index, prefix, scene, track, leg, places, sign * most_m, *sides[0]))
    return sorted(found, key=lambda way: (way.longer_m, way.leg))


def _nearer(
    index: Index,
    prefix: str,
    scene: Scene,
    track: Track,
    leg: int,
    places: tuple[float, ...],
    most_m: float,
    aside: float,
    best: Detour,
) -> Detour:
    """Return the way that is nearest to the leg, between the nearest free one and the next that was tried."""
    low, high = max(aside - 1.0 / 12.0, 0.0), aside
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        way = _way(scene, track, leg, places, middle * most_m)
        if way is not None and _free(index, prefix, [(middle, way)]):
            high, best = middle, way
        else:
            low = middle
    return best


def _free(index: Index, prefix: str, ways: list[tuple[float, Detour]]) -> list[tuple[float, Detour]]:
    """Return the ways that meet nothing; they are not compared with each other."""
    if not ways:
        return []
    keys = [f"{prefix}{k}" for k in range(len(ways))]
    plans = [replace(way.track, key=key, max_speed_kn=np.inf) for key, (_, way) in zip(keys, ways, strict=True)]
    taken = {key for one in index.probe(plans, owner=prefix) for key in (one.a_key, one.b_key)}
    return [one for key, one in zip(keys, ways, strict=True) if key not in taken]


def _way(scene: Scene, track: Track, leg: int, places: tuple[float, ...], aside_m: float) -> Detour | None:
    """Return a track with waypoints aside of a leg, to starboard; None where it stands still or is near a pole."""
    earth = earth_of(scene.earth)
    start, end = track.positions_deg[leg], track.positions_deg[leg + 1]
    length_m, bearing = rhumb_inverse(earth, *start, *end)
    if not length_m > 0.0:
        return None
    # The longitudes of a track need not be within a turn.
    lon, lat = rhumb_direct(earth, start[0], start[1], bearing, np.array(places) * length_m)
    lon, lat = rhumb_direct(earth, lon, lat, bearing + np.sign(aside_m) * 90.0, abs(aside_m))
    if not (np.abs(lat) < 88.0).all() or np.abs(lon).max() > 360.0:
        return None
    try:
        return _over(scene, track, leg, places, np.stack([lon, lat], axis=1))
    except InvalidInput:
        if track.departures_us is None:
            raise
        return None  # it would be under way when the next voyage departs


def rerouted(scene: Scene, track: Track, way: NewWaypoints) -> Track:
    """Return a track with new waypoints; nothing of it changes from leg to leg (`is_by_legs`)."""
    return _over(scene, track, way.leg - 1, (), np.array(way.waypoints_deg)).track


def _over(scene: Scene, track: Track, leg: int, places: Sequence[float], waypoints_deg: Floats) -> Detour:
    """Return a track with more waypoints on a leg; places: the shares of the leg that lie before them."""
    earth = earth_of(scene.earth)
    start, end = track.positions_deg[leg], track.positions_deg[leg + 1]
    way = np.concatenate([[start], waypoints_deg, [end]])
    distance = great_circle_distance if scene.motion is Motion.GREAT_CIRCLE else partial(rhumb_distance, earth)
    parts_m = distance(way[:-1, 0], way[:-1, 1], way[1:, 0], way[1:, 1])
    planned_m = float(distance(*start, *end))
    lasts_us = int(track.times_us[leg + 1] - track.times_us[leg])
    more_us = np.rint(lasts_us * np.cumsum(parts_m) / planned_m).astype(np.int64)
    times_us = np.concatenate(
        [
            track.times_us[: leg + 1],
            track.times_us[leg] + more_us[:-1],
            track.times_us[leg + 1 :] + (more_us[-1] - lasts_us),
        ]
    )
    share = np.array(places)[:, None, None]
    outlines = track.outlines_m
    if outlines is not None:
        between = outlines[leg] + share * (outlines[leg + 1] - outlines[leg])
        outlines = np.concatenate([outlines[: leg + 1], between, outlines[leg + 1 :]])
    times: Any = inputs.all_certain(times_us)
    changed = replace(
        track,
        positions_deg=np.concatenate([track.positions_deg[: leg + 1], way[1:-1], track.positions_deg[leg + 1 :]]),
        times_us=times,
        outlines_m=outlines,
        floors_m=_heights(track, track.floors_m, leg, places),
        ceilings_m=_heights(track, track.ceilings_m, leg, places),
        max_speed_kn=np.inf,
    )
    places_deg = tuple((float(x), float(y)) for x, y in way[1:-1])
    return Detour(
        track.key, leg + 1, places_deg, float(parts_m.sum()) - planned_m, int(more_us[-1] - lasts_us) / 1e6, changed
    )


def _heights(track: Track, heights_m: Floats | None, leg: int, places: Sequence[float]) -> Floats | None:
    """Return heights per leg, or per waypoint, with those of the new waypoints."""
    if heights_m is None:
        return None
    if len(heights_m) == len(track.positions_deg) - 1:
        return np.insert(heights_m, leg, [heights_m[leg]] * len(places))
    first, last = heights_m[leg], heights_m[leg + 1]
    # Unbounded at a waypoint means unbounded on both of its legs.
    between = (
        first + np.array(places) * (last - first)
        if np.isfinite([first, last]).all()
        else ([first if np.isinf(first) else last] * len(places))
    )
    return np.insert(heights_m, leg + 1, between)
