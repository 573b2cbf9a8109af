"""`solve`: the stages on objects in memory; no database, the same answer."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.errors import InvalidInput
from conflictdb.inputs import EPOCH, MICROSECOND
from conflictdb.model import FOR_EVER_US, SINCE_EVER_US, Area, Scene, Track
from conflictdb.motion.registry import centred, plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.pieces.cutting import check_plane
from conflictdb.pipeline.memory import DEFAULT_MEMORY
from conflictdb.pipeline.object_pairs import chunks_of_objects, object_numbers
from conflictdb.pipeline.run import run_scene
from conflictdb.results import Conflict, Kind, Position, Verdict
from conflictdb.stage1_broad_phase import candidates

Object = TypeVar("Object", Area, Track)


def solve(tracks: Iterable[Track], areas: Iterable[Area], scene: Scene | None = None) -> list[Conflict]:
    """Return the pairs of tracks and areas that interfere, without a database.

    With the scene's `nearest_m` also those that come near; they have the verdict near and no periods.
    `Conflict.approach` is how close a pair comes. The rows are in the order of their keys, areas first.
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
        try:
            key.encode()  # as files and the database hold it, and what rows are sorted by
        except UnicodeEncodeError:
            raise InvalidInput(f"object {key!r}", "key", "contains half of a surrogate pair, no character") from None
    scene = centred(scene, areas, tracks)
    plane = plane_of(scene)
    check_plane(plane, areas, tracks)
    # Numbered by key, as in the database: the answer does not depend on the order of the objects.
    areas = sorted(areas, key=lambda area: area.key.encode())
    tracks = sorted(tracks, key=lambda track: track.key.encode())
    batch = AreaBatch.of(areas)
    pieces = pieces_of(scene, plane, batch, TrackBatch.of(tracks))
    found = run_scene(scene, plane, _InMemory(pieces, batch.footprint))
    return _told(scene, areas, tracks, Conflicts.concatenate([conflicts for conflicts, _ in found]))


class _InMemory:
    """Pieces in memory as a source of pairs; areas are numbered as their footprints (n,) are."""

    def __init__(self, pieces: Pieces, footprint: NDArray[np.object_]) -> None:
        self._pieces, self._footprint = pieces, footprint

    def candidates(self) -> Iterator[tuple[Pieces, PieceRows, PieceRows]]:
        a, b = candidates(self._pieces)
        number = object_numbers(self._pieces)
        for rows in chunks_of_objects(number[a], number[b], DEFAULT_MEMORY.pairs):
            yield self._pieces, PieceRows(a[rows]), PieceRows(b[rows])

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        return self._footprint[area_ids]


def _told(scene: Scene, areas: Sequence[Area], tracks: Sequence[Track], conflicts: Conflicts) -> list[Conflict]:
    """Return conflicts of numbered objects as users see them."""
    objects: dict[int, Sequence[Area] | Sequence[Track]] = {Kind.AREA.code: areas, Kind.TRACK.code: tracks}
    answer = []
    for k in range(len(conflicts)):
        pair = [
            (Kind.of_code(int(kind[k])), objects[int(kind[k])][int(number[k])].key)
            for kind, number in ((conflicts.a_kind, conflicts.a_id), (conflicts.b_kind, conflicts.b_id))
        ]
        (a_kind, a_key), (b_kind, b_key) = sorted(pair, key=lambda member: (member[0].code, member[1].encode()))
        ends_deg = [conflicts.closest_a_deg[k], conflicts.closest_b_deg[k]]
        if (a_kind, a_key) != pair[0]:
            ends_deg.reverse()
        periods = conflicts.period_us[conflicts.period_offset[k] : conflicts.period_offset[k + 1]].tolist()
        answer.append(
            Conflict(
                scene=scene.name,
                a_key=a_key,
                a_kind=a_kind,
                b_key=b_key,
                b_kind=b_kind,
                verdict=Verdict.of_code(int(conflicts.verdict[k])),
                periods=tuple((_instant(start), _instant(end)) for start, end in periods),
                time_error_s=float(conflicts.time_error_s[k]),
                method=scene.method,
                first_contact_deg=_position(conflicts.first_contact_deg[k]),
                closest_at=_instant(int(conflicts.closest_us[k])),
                closest_m=_number(conflicts.closest_m[k]),
                closest_error_m=_number(conflicts.closest_error_m[k]),
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
    objects = list(given)
    for i, one in enumerate(objects):
        if not isinstance(one, kind):
            swapped = ": solve(tracks, areas), are they swapped?" if isinstance(one, Area | Track) else ""
            raise InvalidInput("solve", f"{name}[{i}]", f"{what}; got {type(one).__name__}{swapped}")
    return objects


def _instant(us: int) -> datetime | None:
    return None if us in (SINCE_EVER_US, FOR_EVER_US) else EPOCH + us * MICROSECOND


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def _position(position_deg: NDArray[np.float64]) -> Position | None:
    lon, lat = position_deg.tolist()
    return None if np.isnan(lon) else (lon, lat)
