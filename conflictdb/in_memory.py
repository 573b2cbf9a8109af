"""Run the stages on objects in memory (`solve`): no database, the same answer."""

from collections.abc import Iterable, Iterator, Mapping
from datetime import tzinfo
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pieces import PieceRows, Pieces
from conflictdb.earth.registry import centred, plane_of
from conflictdb.errors import InvalidInput
from conflictdb.formats import from_frames
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.results import Conflict, Kind, Results
from conflictdb.stages.memory import DEFAULT_MEMORY
from conflictdb.stages.object_pairs import chunks_of_objects, object_numbers
from conflictdb.stages.pieces.covers import pieces_of
from conflictdb.stages.pieces.cutting import check_plane
from conflictdb.stages.run import Funnel, run_scene
from conflictdb.stages.source import Chunk
from conflictdb.stages.stage1_broad_phase import candidates
from conflictdb.stages.to_results import to_results

if TYPE_CHECKING:
    import geopandas
    from matplotlib.figure import Figure
    from movingpandas import TrajectoryCollection

Object = TypeVar("Object", Area, Track)


def solve(
    tracks: "Iterable[Track] | geopandas.GeoDataFrame | TrajectoryCollection",
    areas: "Iterable[Area] | geopandas.GeoDataFrame",
    scene: Scene | None = None,
    *,
    haven: Mapping[str, Any] | None = None,
    time_zone: str | tzinfo | None = None,
) -> Results[Conflict]:
    """Return the pairs of tracks and areas that interfere, without a database.

    If the scene has `nearest_m`, near pairs are returned too, with verdict near and without periods.
    `Conflict.approach` is the closest approach of a pair. Rows are in the order of their keys, areas first. Stages and
    answer are those of a detection in the database. Raises InvalidInput for objects that do not fit the scene's plane,
    for duplicate keys, and for other types than tracks and areas.

    Parameters
    ----------
    tracks, areas : iterables of Track and Area, or GeoDataFrames; tracks also a TrajectoryCollection of MovingPandas
        The columns of a GeoDataFrame have the names and units of scene files; instants are datetimes with a zone.
        Without a column `id` the index is the key. It must have a reference system; systems other than longitude and
        latitude on WGS84 are transformed. The key of a trajectory is its id.
    haven : mapping, optional
        Default haven for rows of frames without size columns: ``{"fore_m": 60, "aft_m": 40, ...}``, as in scene files.
    time_zone : str or tzinfo, optional
        The zone of instants of frames without one; by default they are refused.
    """
    if not isinstance(scene, Scene | None):
        raise InvalidInput("solve", "scene", f"must be a Scene, or absent; got {scene!r:.60}")
    scene = scene or Scene("in memory")
    tracks, areas = _objects(tracks, areas, scene, haven, time_zone)
    seen: set[str] = set()
    for key in [area.key for area in areas] + [track.key for track in tracks]:
        if key in seen:
            raise InvalidInput(f"object {key!r}", "key", "occurs more than once: keys must be unique")
        seen.add(key)
        try:
            key.encode()  # as stored by files and the database, and the order of rows
        except UnicodeEncodeError:
            raise InvalidInput(f"object {key!r}", "key", "contains half of a surrogate pair, no character") from None
    scene = centred(scene, areas, tracks)
    check_plane(plane_of(scene), areas, tracks)
    # Numbered by key, as in the database: the answer does not depend on the order of the objects.
    areas = sorted(areas, key=lambda area: area.key.encode())
    tracks = sorted(tracks, key=lambda track: track.key.encode())
    keys = {(Kind.AREA.code, n): area.key for n, area in enumerate(areas)}
    keys |= {(Kind.TRACK.code, n): track.key for n, track in enumerate(tracks)}
    origin = _Objects(scene, {one.key: one for one in [*areas, *tracks]})
    rows = to_results(scene, keys, Conflicts.concatenate([conflicts for conflicts, _ in _run(scene, areas, tracks)]))
    return Results((conflict.found_by(origin) for conflict in rows), Conflict)


def counts(scene: Scene, areas: list[Area], tracks: list[Track]) -> Funnel:
    """Return what the stages count on the objects of a stored scene."""
    total = Funnel()
    for _, funnel in _run(scene, areas, tracks):
        total.add(funnel)
    return total


def _run(scene: Scene, areas: list[Area], tracks: list[Track]) -> Iterator[tuple[Conflicts, Funnel]]:
    batch, plane = AreaBatch.of(areas), plane_of(scene)
    pieces = pieces_of(scene, plane, batch, TrackBatch.of(tracks))
    return run_scene(scene, plane, _InMemory(pieces, batch.footprint))


class _Objects:
    """The input of `solve`, by key, for drawing its conflicts."""

    def __init__(self, scene: Scene, objects: Mapping[str, Area | Track]) -> None:
        self._scene, self._objects = scene, objects

    def plot_conflict(self, conflict: Conflict) -> "Figure":
        from conflictdb.drawing import figures  # not above: it brings matplotlib

        a, b = (self._objects[key] for key in (conflict.a_key, conflict.b_key))
        return figures.plot_pair(self._scene, a, b, conflict)


def _objects(
    tracks: Any, areas: Any, scene: Scene, haven: Mapping[str, Any] | None, time_zone: str | tzinfo | None
) -> tuple[list[Track], list[Area]]:
    """Return the objects, given directly or in frames; raises InvalidInput."""
    in_frames = from_frames.is_frame(tracks), from_frames.is_frame(areas)
    sizes, zone = from_frames.checked_haven(haven), from_frames.Zone(time_zone)
    if haven is not None and not in_frames[0]:
        raise InvalidInput("solve", "haven", "is for tracks of frames: a Track has an outline_m of its own")
    if time_zone is not None and not any(in_frames):
        raise InvalidInput(
            "solve", "time_zone", "is for frames: instants of a Track or an Area need a zone of their own"
        )
    return (
        from_frames.tracks_of(tracks, scene, sizes, zone) if in_frames[0] else _each("tracks", tracks, Track),
        from_frames.areas_of(areas, scene, zone) if in_frames[1] else _each("areas", areas, Area),
    )


class _InMemory:
    """Pieces in memory as a source of pairs; areas are numbered as their footprints (n,)."""

    def __init__(self, pieces: Pieces, footprint: NDArray[np.object_]) -> None:
        # Put seam copies beside their originals, as every source does: of contacts that begin together the first is
        # reported.
        order = np.lexsort((-pieces.turn, pieces.part, object_numbers(pieces)))
        self._pieces = pieces.take(order) if pieces.turn.any() else pieces
        self._footprint = footprint

    def candidates(self) -> Iterator[Chunk]:
        a, b = candidates(self._pieces)
        number = object_numbers(self._pieces)
        for rows in chunks_of_objects(number[a], number[b], DEFAULT_MEMORY.pairs):
            yield Chunk(self._pieces, PieceRows(a[rows]), PieceRows(b[rows]))

    def footprints(self, area_ids: NDArray[np.int64]) -> NDArray[np.object_]:
        return self._footprint[area_ids]


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
