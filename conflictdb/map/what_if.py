"""Pack the pieces of a scene for the page, whose kernel computes what objects pass, and what moved plans would meet."""

import struct
from collections.abc import Container, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
import psycopg
from numpy.typing import NDArray

from conflictdb.core.object_pairs import object_numbers
from conflictdb.core.pieces.covers import COVER
from conflictdb.core.pieces.cutting import planar
from conflictdb.core.separations import Separations
from conflictdb.core.whole_areas import areas_of
from conflictdb.core.world import Reach
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.formats.scene_file import feature_of
from conflictdb.jobs.plans_near import read_departing, read_near
from conflictdb.map.content import to_json
from conflictdb.map.editing import digest
from conflictdb.memory.questions import numbered
from conflictdb.model.margin import Margin
from conflictdb.model.methods import METHODS, Solver
from conflictdb.model.plans import MAX_DISTANCE_M, Area, Scene, Track
from conflictdb.model.tolerances import windows_later

_LENGTH: Final = struct.Struct("<I")
# Arrays begin at multiples of this, as typed arrays must.
_ALIGNED: Final = 8
# The page moves departures by a day at most, and looks this much further for its longest margin, seconds.
LONGEST_S: Final = 86_400 + 1_800
# The largest margin of the page, metres: five nautical miles.
_MOST_MARGIN_M: Final = 9_260.0
# The page computes with doubles: instants this far from the first one and beyond count as unbounded, microseconds.
_UNBOUNDED_US: Final = 2**52
_INSTANTS: Final = ("start_us", "end_us", "leg_start_us", "leg_end_us")


def packed_departing(
    conn: psycopg.Connection[Any], scene: str, key: str, within_s: float, margin_m: float = 0.0
) -> bytes:
    """Pack the pieces of a track, and of what it may meet at any height, departing at most `within_s` earlier or later.

    margin_m : also what it may meet with this margin

    Raises InvalidInput if the scene or the track does not exist.
    """
    settings, areas, tracks = read_departing(conn, scene, key, within_s, margin_m, at_any_height=True)
    if all(track.key != key for track in tracks):
        raise InvalidInput(f"scene {scene!r}", "track", f"{key!r} is not known")
    return packed(settings, areas, tracks, {key}, margin_m)


def packed_near(conn: psycopg.Connection[Any], scene: str, key: str, within_m: float) -> bytes:
    """Pack the pieces of an object, and of what comes within `within_m` of it at its times and heights.

    Raises InvalidInput if the scene or the object does not exist.
    """
    settings, areas, tracks = read_near(conn, scene, key, within_m)
    if key not in {*(area.key for area in areas), *(track.key for track in tracks)}:
        raise InvalidInput(f"scene {scene!r}", "object", f"{key!r} is not known")
    return packed(settings, areas, tracks, ())


def packed_whole(scene: Scene, areas: list[Area], tracks: list[Track]) -> bytes:
    """Pack all pieces of a scene, for each margin of the page that its separations leave room for."""
    return packed(
        scene, areas, tracks, margin_m=max(0.0, min(_MOST_MARGIN_M, MAX_DISTANCE_M - scene.largest_separation_m))
    )


def packed(
    scene: Scene,
    areas: list[Area],
    tracks: list[Track],
    moved: Container[str] | None = None,
    margin_m: float = 0.0,
) -> bytes:
    """Pack all pieces of some objects: length of a JSON head (little-endian), head, arrays.

    The head has what the kernel takes, `settings` (required separations), `of_types` (the number of the settings of two
    types of objects; -1: not compared), `turn_m` (around the earth in the plane; 0: no seam), `objects` (keys, in the
    order of a detection), `base_us` (the instant that others count from, as text), `refusal` (why moved plans are not
    shown, or null), `plans` (features of the tracks that may be moved, by key), `digests` of those (for
    `editing.PlanMove`), and `arrays`: name, type of typed arrays, place in the packed bytes, and number of elements of
    each array. Heights are given for all pieces under the first settings, then under the next.

    moved : keys of the tracks that may be moved; None: all
    margin_m : the pieces are cut for margins of up to this, which `settings` do not have
    """
    cut_for = Margin(0, margin_m).added_to(scene)
    setup, pieces, keys, _, _ = numbered("what if", tracks, areas, cut_for, Reach.either(1_000_000 * LONGEST_S))
    number = object_numbers(pieces)
    pieces = pieces.take(np.lexsort((-pieces.turn, pieces.part, number)))
    separations = Separations.of(scene)
    by_settings = [separations.of_settings(one, pieces) for one in separations.settings]
    objects, which = np.unique(object_numbers(pieces), return_inverse=True)
    base_us = min((int(track.times_us[0]) for track in tracks), default=0)
    arrays: dict[str, NDArray[Any]] = {
        "plane": np.frombuffer(bytes(setup.plane.kernel_plane), np.uint8),
        "object": which.astype("<i4"),
        "numbers": pieces.numbers.astype("<i8").ravel(),
        "is_cover": (pieces.part == COVER).astype(np.uint8),
        "end_inclusive": pieces.end_inclusive.astype(np.uint8),
        "type": separations.types(pieces.kind, pieces.class_number).astype("<i4"),
        "floor_m": np.concatenate([one.floor_m for one in by_settings]).astype("<f8"),
        "ceiling_m": np.concatenate([one.ceiling_m for one in by_settings]).astype("<f8"),
        "moves": pieces.kind,
        "turn": pieces.turn.astype("<i2"),
        **{name: _since(getattr(pieces, name), base_us) for name in _INSTANTS},
        "leg_start_deg": pieces.leg_start_deg.astype("<f8").ravel(),
        "leg_end_deg": pieces.leg_end_deg.astype("<f8").ravel(),
        "bearing_deg": pieces.bearing_deg.astype("<f8"),
        "shape_offset": pieces.shape_offset.astype("<i8"),
        "shape": pieces.shape_xy.astype("<f8").ravel(),
    }
    if pieces.changes:
        arrays["shape_to"] = pieces.shape_to_xy.astype("<f8").ravel()
    arrays |= _wholes(setup, areas, keys, objects, which, pieces.turn)
    if pieces.climbs().any():
        arrays["climb_m"] = np.concatenate([one.climb_m for one in by_settings]).astype("<f8").ravel()
    head = {
        "refusal": _refusal(scene),
        "base_us": str(base_us),
        "settings": [
            {
                "separation_m": one.separation_m,
                "tolerance_m": one.tolerance_m,
                "within_us": one.time_separation_us,
            }
            for one in separations.settings
        ],
        "of_types": separations.of_types.tolist(),
        "has_margins": bool(separations.vertical_m.any()),
        "intervals": str(setup.scene.intervals),
        "margin_m": margin_m,
        "reach_m": max(one.reach_m for one in separations.settings),
        "turn_m": setup.plane.turn_m,
        "objects": [keys[one] for one in objects.tolist()],
        "plans": {track.key: feature_of(_in_utc(track)) for track in tracks if moved is None or track.key in moved},
        "digests": {track.key: digest(track) for track in tracks if moved is not None and track.key in moved},
    }
    return _with_head(head, arrays)


def _wholes(
    setup: Setup,
    areas: list[Area],
    keys: Mapping[int, str],
    objects: NDArray[np.int64],
    which: NDArray[np.int64],
    turn: NDArray[np.int16],
) -> dict[str, NDArray[Any]]:
    """Return the areas of several convex parts: as KernelAreas, and the number of the object (m,) of each.

    objects : numbers of objects
    which, turn : (n,) place of the object of each piece in `objects`, and its copy across the antimeridian
    """
    footprints = {area.key: area.footprint for area in areas}
    parts = np.bincount(which[turn == 0], minlength=len(objects))
    several = [n for n in np.flatnonzero(parts > 1).tolist() if keys[int(objects[n])] in footprints]
    if not several:
        return {}
    shapes = np.array([footprints[keys[int(objects[n])]] for n in several], dtype=object)
    wholes = areas_of(setup, planar(setup.plane, shapes))
    return {
        "whole_object": np.array(several, "<i4"),
        "whole_ring": wholes.ring_xy.astype("<f8").ravel(),
        "whole_ring_offset": wholes.ring_offset.astype("<i8"),
        "whole_area_offset": wholes.area_offset.astype("<i8"),
        "whole_margin": wholes.margin.astype("<f8"),
    }


def _in_utc(track: Track) -> Track:
    """Return a track whose windows are written as the page reads them."""
    if track.tolerances is None:
        return track
    return replace(track, tolerances=windows_later(track.tolerances, 0), max_speed_kn=np.inf)


def _refusal(scene: Scene) -> str | None:
    """Return what the page does not compute in a scene; None if it computes all."""
    if METHODS[scene.method].solver is not Solver.CERTIFIED:
        return f"the method of the scene is {scene.method}"
    return None


def _since(at_us: NDArray[np.int64], base_us: int) -> NDArray[np.int64]:
    """Return instants (n,) as microseconds since another one; those far away are unbounded."""
    clipped = np.clip(at_us, base_us - _UNBOUNDED_US, base_us + _UNBOUNDED_US)
    return (clipped - base_us).astype("<i8")


def _with_head(head: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> bytes:
    placed, parts, at = [], [], 0
    for name, values in arrays.items():
        data = np.ascontiguousarray(values).tobytes()
        placed.append([name, values.dtype.str.lstrip("<|"), at, len(values)])
        padding = -len(data) % _ALIGNED
        parts += [data, bytes(padding)]
        at += len(data) + padding
    text = to_json({**head, "arrays": placed})
    text += b" " * (-(_LENGTH.size + len(text)) % _ALIGNED)
    return b"".join([_LENGTH.pack(len(text)), text, *parts])
