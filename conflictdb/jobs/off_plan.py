"""What tracks that are off their plans may meet: discs around their last positions, that grow until the next ones.

The discs are compared with the plans near them, each as late as its track is known to be, and with the discs of other
tracks that are off.
"""

from collections.abc import Callable, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from typing import Any, Final

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from conflictdb import store
from conflictdb.arrays.object_numbers import kinds_and_ids, numbers_of
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.delays import Differences, differences_of
from conflictdb.core.keeping import STANDS_MPS
from conflictdb.core.members import Members
from conflictdb.core.near import Memory
from conflictdb.core.world import World
from conflictdb.earth.geodesy import MEAN_RADIUS_M, great_circle_distance
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.jobs.members_near import members
from conflictdb.model.plans import MAX_GROWTH_MPS, Scene, Track
from conflictdb.model.results import Kind

_Ints = NDArray[np.int64]
_Floats = NDArray[np.float64]
_CORNERS: Final = 16
# Distances on the sphere differ by less from those on the ellipsoid.
_SPHERE: Final = 1.01
# Tracks whose neighbours are looked up at once: their pairs fit into memory.
_AT_ONCE: Final = 1_000


def around(
    conn: psycopg.Connection[Any], scene_id: int, settings: Scene, off: AbstractSet[str], now_us: int
) -> tuple[Members, list[store.Following], list[str]]:
    """Return what tracks that are off may meet until they are silent, by keys of a scene; their states are stored.

    Returns discs and plans, the pairs of these that may meet, and the keys of tracks without a disc: it would leave the
    plane, or their plans stand still. The verdict of each pair is may, and its first track is late by nothing.
    """
    strays = store.straying(conn, scene_id)
    until_us = now_us + round(1e6 * store.silent_after_s(conn))
    is_off = {one.key for one in strays if one.is_off}
    mine = [one for one in strays if one.is_off and one.key in off]
    beside = [one for one in strays if one.is_off and one.key not in off]
    beside = [beside[k] for k in _within_reach(settings, mine, beside, until_us)]
    world = World(Setup.of(settings))
    # No disc contains the places of a track whose plan stands still, or whose speed is unknown.
    stopped = [one.key for one in mine if one.fastest_mps <= STANDS_MPS]
    discs, lost = _placed(world, [one for one in (*mine, *beside) if one.fastest_mps > STANDS_MPS], until_us)
    # A lateness beyond is an alarm of its own.
    most_us = round(1e6 * settings.delays_within_s)
    late_us = {
        one.key: (max(one.low_us, -most_us), min(one.high_us, most_us))
        for one in strays
        if one.low_us is not None and one.high_us is not None and one.low_us <= most_us and one.high_us >= -most_us
    }
    horizon_us = max((abs(by_us) for ends in late_us.values() for by_us in ends), default=0)
    # Few are late: only their plans are sought over longer times.
    planned = _near(conn, scene_id, world, discs, 0, lambda key: key not in is_off and key not in late_us)
    late = _near(conn, scene_id, world, discs, horizon_us, late_us.__contains__) if late_us else Members.none()
    plans = _joined([discs, planned, late])
    pieces, of = replace(plans.pieces, object_id=plans.of), plans.of
    first_plan, first_late = len(discs.each), len(discs.each) + len(planned.each)
    asked = np.array([k for k, one in enumerate(discs.each) if one.key in off], np.int64)
    tracks = numbers_of(np.full(len(asked), Kind.TRACK.code), asked)
    found = [
        differences_of(world.setup, Memory(pieces.take(np.flatnonzero(some))), tracks, within_us, waits=None)
        for some, within_us in ((of < first_late, 0), ((of < first_plan) | (of >= first_late), horizon_us))
    ]
    low_us, high_us = np.array([late_us.get(one.key, (0, 0)) for one in plans.each], np.int64).reshape(-1, 2).T
    pairs = _following(plans, Differences.concatenate(found), low_us, high_us)
    return plans, pairs, stopped + [key for key in lost if key in off]


def _near(
    conn: psycopg.Connection[Any],
    scene_id: int,
    world: World,
    discs: Members,
    within_us: int,
    is_asked: Callable[[str], bool],
) -> Members:
    """Return the plans with some keys that may be near discs if they are up to `within_us` late or early."""
    pieces = discs.pieces
    if not len(pieces):
        return Members.none()
    within_us += world.setup.scene.longest_time_us
    pieces = pieces.longer(within_us, within_us)
    span = int(pieces.start_us.min()), int(pieces.end_us.max()) + 1
    near = store.objects_near(conn, scene_id, world.setup.scene, pieces, span)
    return members(conn, scene_id, world, span, sorted(one for one in near if is_asked(one.key)))


def _joined(parts: Sequence[Members]) -> Members:
    starts = np.cumsum([0, *(len(one.each) for one in parts)]).tolist()
    of = np.concatenate([one.of + start for one, start in zip(parts, starts, strict=False)])
    return Members(Pieces.concatenate([one.pieces for one in parts]), of, [plan for one in parts for plan in one.each])


def _following(plans: Members, found: Differences, low_us: _Ints, high_us: _Ints) -> list[store.Following]:
    """Return the pairs that meet at a possible lateness of the other plan, at that nearest to the middle."""
    track, (_, other) = kinds_and_ids(found.track)[1], kinds_and_ids(found.other)
    # If the other is late by e, the track is early by e against it.
    least, most = np.maximum(found.low, -high_us[other]), np.minimum(found.high, -low_us[other])
    met = np.flatnonzero(least <= most)
    track, other, least, most = track[met], other[met], least[met], most[met]
    middle = -(low_us[other] + high_us[other]) // 2
    by = np.minimum(np.maximum(middle, least), most)
    order = np.lexsort((abs(by - middle), other, track))
    is_first = np.ones(len(order), np.bool_)
    is_first[1:] = (np.diff(track[order]) != 0) | (np.diff(other[order]) != 0)
    each = plans.each
    pairs = []
    for rows in np.split(order, np.flatnonzero(is_first)[1:]) if len(order) else []:
        k = rows[0]
        a, b = int(track[k]), int(other[k])
        ends = np.unique([least[rows], most[rows]]).tolist()
        late = (0, 0, int(low_us[b]), int(high_us[b]))
        pairs.append(store.Following(each[a].key, each[b].key, each[b].kind.code, "may", 0, int(by[k]), ends, *late))
    return pairs


def _within_reach(
    scene: Scene, mine: Sequence[store.Straying], others: Sequence[store.Straying], until_us: int
) -> list[int]:
    """Return which of some tracks that are off may meet one of others, by their places and reaches."""
    if not mine or not others:
        return []
    (lon, lat, reach_m), (other_lon, other_lat, other_reach_m) = (
        np.array(
            [
                ((one.lon + 180.0) % 360.0 - 180.0, one.lat, one.error_m + one.fastest_mps * _ages_s(one, until_us))
                for one in some
            ]
        ).T
        for some in (mine, others)
    )
    reach_m += scene.largest_separation_m + scene.reach_m
    # Each contains the places that are reached: those of two that meet have one in common.
    boxes = np.concatenate([_box(lon + turn, lat, reach_m) for turn in (-360.0, 0.0, 360.0)])
    tree, others_boxes = shapely.STRtree(boxes), _box(other_lon, other_lat, other_reach_m)
    found: list[int] = []
    for start in range(0, len(others), _AT_ONCE):
        one, near = tree.query(others_boxes[start : start + _AT_ONCE])
        one, near = one + start, near % len(mine)
        away_m = great_circle_distance(lon[near], lat[near], other_lon[one], other_lat[one])
        found += np.unique(one[away_m <= _SPHERE * (reach_m[near] + other_reach_m[one])]).tolist()
    return found


def _box(lon: _Floats, lat: _Floats, reach_m: _Floats) -> NDArray[np.object_]:
    """Return boxes (n,) in degrees that contain all places within a reach of each place, on the sphere."""
    angle = _SPHERE * reach_m / MEAN_RADIUS_M
    north, south = np.minimum(lat + np.degrees(angle), 90.0), np.maximum(lat - np.degrees(angle), -90.0)
    is_polar = (north >= 90.0) | (south <= -90.0)
    sine = np.sin(np.where(is_polar, 0.0, angle)) / np.cos(np.radians(np.where(is_polar, 0.0, lat)))
    wide = np.where(is_polar, 360.0, np.degrees(np.arcsin(np.minimum(sine, 1.0))))
    return np.asarray(shapely.box(lon - wide, south, lon + wide, north))


def _ages_s(one: store.Straying, until_us: int) -> float:
    return max(until_us - one.at_us, 0) / 1e6


def _placed(world: World, strays: Sequence[store.Straying], until_us: int) -> tuple[Members, list[str]]:
    """Return the discs that the plane contains, and the keys of all others."""
    discs: list[Track] = []
    lost: list[str] = []
    try:
        return Members.of_plans(world, [_disc(one, until_us) for one in strays]), lost
    except InvalidInput:
        for one in strays:
            try:
                Members.of_plans(world, [disc := _disc(one, until_us)])
                discs.append(disc)
            except InvalidInput:
                lost.append(one.key)
    return Members.of_plans(world, discs), lost


def _disc(one: store.Straying, until_us: int) -> Track:
    """Return the disc around the last position of a track that contains it later: a track that stands and grows.

    It also contains all heights that it can reach: no track climbs or sinks faster than it may move.
    """
    until_us = max(until_us, one.at_us + 1_000_000)
    azimuth = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    radius_m = max(one.error_m, 1.0) / np.cos(np.pi / _CORNERS)
    outline = radius_m * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    height: dict[str, Any] = {}
    if one.height_m is not None:
        reach_m = max(one.error_m, 1.0) + one.fastest_mps * _ages_s(one, until_us)
        height = {"floor_m": one.height_m - reach_m, "ceiling_m": one.height_m + reach_m}
    return Track(
        one.key,
        [(one.lon, one.lat), (one.lon, one.lat)],
        [one.at_us, until_us],
        outline,
        grow_mps=min(one.fastest_mps, MAX_GROWTH_MPS),
        object_class=one.class_,
        owner=one.owner,
        **height,
    )
