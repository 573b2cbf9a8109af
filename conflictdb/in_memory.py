"""The stages on objects in memory: no database, the same answer."""

from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import TypeVar

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.errors import InvalidInput
from conflictdb.inputs import EPOCH, MICROSECOND
from conflictdb.methods import METHODS
from conflictdb.model import FOR_EVER_US, SINCE_EVER_US, Area, Scene, Track
from conflictdb.motion.registry import centred, plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.pieces.cutting import check_plane
from conflictdb.pipeline.run import run_stages
from conflictdb.results import Conflict, Kind, Position, Verdict

Object = TypeVar("Object", Area, Track)


def solve(tracks: Iterable[Track], areas: Iterable[Area], scene: Scene | None = None) -> list[Conflict]:
    """Return the pairs of tracks and areas that interfere, without a database.

    With the scene's `nearest_m` also those that come near; they have the verdict near and no periods.
    `Conflict.approach` is how close a pair comes.
    The same stages 3 and 4 that a detection in the database runs, and the same answer. Raises InvalidInput for objects
    that the scene's plane cannot hold, for keys that occur twice, and for anything else than tracks and areas.
    """
    tracks, areas = _each("tracks", tracks, Track), _each("areas", areas, Area)
    if not isinstance(scene, Scene | None):
        raise InvalidInput("solve", "scene", f"must be a Scene, or absent; got {scene!r:.60}")
    scene = scene or Scene("in memory")
    seen: set[str] = set()
    for key in [area.key for area in areas] + [track.key for track in tracks]:
        if key in seen:
            raise InvalidInput(f"object {key!r}", "key", "occurs more than once: keys must be unique")
        seen.add(key)
    scene = centred(scene, areas, tracks)
    plane = plane_of(scene)
    check_plane(plane, areas, tracks)
    # Numbered by key, as in the database: the answer does not depend on the order of the objects.
    areas = sorted(areas, key=lambda area: area.key.encode())
    tracks = sorted(tracks, key=lambda track: track.key.encode())
    batch = AreaBatch.of(areas)
    pieces = pieces_of(scene, plane, batch, TrackBatch.of(tracks))
    found, _ = run_stages(
        scene,
        plane,
        pieces,
        pairs_in_memory(pieces, regions=METHODS[scene.method].projects_regions),
        lambda numbers: batch.footprint[numbers],
    )
    objects: dict[int, Sequence[Area] | Sequence[Track]] = {Kind.AREA.code: areas, Kind.TRACK.code: tracks}
    answer = []
    for k in range(len(found)):
        pair = [
            (Kind.of_code(int(kind[k])), objects[int(kind[k])][int(number[k])].key)
            for kind, number in ((found.a_kind, found.a_id), (found.b_kind, found.b_id))
        ]
        (a_kind, a_key), (b_kind, b_key) = sorted(pair, key=lambda member: (member[0].code, member[1].encode()))
        ends_deg = [found.closest_a_deg[k], found.closest_b_deg[k]]
        if (a_kind, a_key) != pair[0]:
            ends_deg.reverse()
        periods = found.period_us[found.period_offset[k] : found.period_offset[k + 1]].tolist()
        answer.append(
            Conflict(
                scene=scene.name,
                a_key=a_key,
                a_kind=a_kind,
                b_key=b_key,
                b_kind=b_kind,
                verdict=Verdict.of_code(int(found.verdict[k])),
                periods=tuple((_instant(start), _instant(end)) for start, end in periods),
                time_error_s=float(found.time_error_s[k]),
                method=scene.method,
                first_contact_deg=_position(found.first_contact_deg[k]),
                closest_at=_instant(int(found.closest_us[k])),
                closest_m=_number(found.closest_m[k]),
                closest_error_m=_number(found.closest_error_m[k]),
                closest_a_deg=_position(ends_deg[0]),
                closest_b_deg=_position(ends_deg[1]),
            )
        )
    return sorted(answer, key=lambda one: (one.a_kind.code, one.a_key.encode(), one.b_key.encode()))


def _each(name: str, given: Iterable[Object], kind: type[Object]) -> list[Object]:
    """Return objects of one kind; raises InvalidInput for others."""
    what = f"must be {name}, in a list or the like"
    if isinstance(given, Area | Track) or not isinstance(given, Iterable):
        raise InvalidInput("solve", name, f"{what}; got {type(given).__name__}")
    found = list(given)
    for i, one in enumerate(found):
        if not isinstance(one, kind):
            swapped = ": solve(tracks, areas), are they swapped?" if isinstance(one, Area | Track) else ""
            raise InvalidInput("solve", f"{name}[{i}]", f"{what}; got {type(one).__name__}{swapped}")
    return found


def _instant(us: int) -> datetime | None:
    return None if us in (SINCE_EVER_US, FOR_EVER_US) else EPOCH + us * MICROSECOND


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _position(position_deg: NDArray[np.float64]) -> Position | None:
    lon, lat = position_deg.tolist()
    return None if np.isnan(lon) else (lon, lat)


def pairs_in_memory(pieces: Pieces, *, regions: bool) -> Pairs:
    """Return the pairs of stages 1 and 2, found with an index in memory by the same predicates as in the database."""
    return intersections(pieces, *candidates(pieces), regions=regions)


def candidates(pieces: Pieces) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows (a, b) of the pairs of pieces whose boxes meet in space, time and height: stage 1 in memory.

    By the same predicates as in the database, ordered, each pair once.
    """
    hulls = hulls_of(pieces)
    a, b = shapely.STRtree(hulls).query(hulls)
    earlier = (pieces.kind[a] < pieces.kind[b]) | (
        (pieces.kind[a] == pieces.kind[b]) & (pieces.object_id[a] < pieces.object_id[b])
    )
    keep = earlier & ((pieces.turn[a] == 0) | (pieces.turn[b] == 0))
    keep &= (pieces.floor_m[a] < pieces.ceiling_m[b]) & (pieces.floor_m[b] < pieces.ceiling_m[a])
    a, b = a[keep], b[keep]
    start, end = np.maximum(pieces.start_us[a], pieces.start_us[b]), np.minimum(pieces.end_us[a], pieces.end_us[b])
    last = np.ones(len(a), np.bool_)
    for member in (a, b):
        last &= (pieces.end_us[member] > end) | pieces.end_inclusive[member]
    keep = (start < end) | ((start == end) & last)
    a, b = a[keep], b[keep]
    order = np.lexsort((b, a))
    return a[order], b[order]


def intersections(pieces: Pieces, a: NDArray[np.int64], b: NDArray[np.int64], *, regions: bool) -> Pairs:
    """Return the candidates (a, b) whose hulls meet, and where if `regions`: stage 2 in memory."""
    hulls = hulls_of(pieces)
    met = shapely.intersects(hulls[a], hulls[b])
    a, b = a[met], b[met]
    moving = (pieces.kind[a] == Kind.TRACK.code) | (pieces.kind[b] == Kind.TRACK.code)
    region = np.full(len(a), None, dtype=object)
    if regions:
        region[moving] = shapely.intersection(hulls[a[moving]], hulls[b[moving]])
    xy, owner = shapely.get_coordinates(region, return_index=True)
    return Pairs(a, b, xy, np.searchsorted(owner, np.arange(len(a) + 1)).astype(np.int64))


def hulls_of(pieces: Pieces) -> NDArray[np.object_]:
    """Return the hulls of pieces, polygons of the plane."""
    owner = np.repeat(np.arange(len(pieces)), np.diff(pieces.hull_offset))
    return np.asarray(shapely.polygons(shapely.linearrings(pieces.hull_xy, indices=owner)))
