"""Read the schedules of a scene, and store what they are expanded to."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import psycopg
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.ragged import offsets
from conflictdb.model.results import Kind
from conflictdb.store.connection import call, call_many
from conflictdb.store.copy_binary import array, half_open_multispans, instants

# Objects that are stored by one call.
_AT_ONCE = 1_000
_NO_SPANS = np.empty((0, 2), np.int64)


@dataclass(frozen=True, slots=True)
class Horizon:
    """How far the schedules of a scene are expanded.

    window : [start, end) microseconds; None: not at all
    is_waiting : whether a schedule is not expanded; None: there are no schedules
    voyages : [start, end), microseconds, of voyages that may have changed since; None: there are none
    """

    horizon_days: float
    window: tuple[int, int] | None
    is_waiting: bool | None
    voyages: tuple[int, int] | None


@dataclass(frozen=True, slots=True)
class Scheduled:
    """An object with a schedule.

    schedule : JSON, as stored
    span_us : start and end of an area, None if unbounded; the first and last time of a track
    box : box of an area, or the first waypoint of a track, degrees
    """

    kind: Kind
    object_id: int
    version: int
    key: str
    schedule: str
    span_us: tuple[int | None, int | None]
    box: shapely.Geometry


def horizon(conn: psycopg.Connection[Any], scene_id: int, *, is_asked: bool = False) -> Horizon:
    """Return how far the schedules of a scene are expanded.

    is_asked : return voyages also of a scene without schedules
    """
    days, first, until, is_waiting, starts, ends = call(conn, "_horizon", scene_id, is_asked)
    voyages = None if starts is None or ends is None else (starts, ends + 1)
    return Horizon(days, _pair(first, until), is_waiting, voyages)


def stored_window(conn: psycopg.Connection[Any], scene_id: int) -> tuple[int, int] | None:
    """Return the time [start, end) over which the schedules of a scene, or of a branch's parent, are expanded."""
    return _pair(*call(conn, "_expanded_us", scene_id))


def scheduled(
    conn: psycopg.Connection[Any],
    scene_id: int,
    *,
    only_waiting: bool,
    area_ids: list[int] | None = None,
    track_ids: list[int] | None = None,
) -> list[Scheduled]:
    """Return the objects of a scene with schedules, or those whose schedules are not expanded; ids: None: all."""
    return [
        Scheduled(
            kind=Kind.TRACK if kind else Kind.AREA,
            object_id=number,
            version=version,
            key=key,
            schedule=schedule,
            span_us=(start, end),
            box=shapely.from_wkb(box),
        )
        for kind, number, version, key, schedule, start, end, box in call_many(
            conn, "_scheduled", scene_id, only_waiting, area_ids, track_ids
        )
    ]


def store_activations(
    conn: psycopg.Connection[Any],
    scene_id: int,
    objects: Sequence[Scheduled],
    instants_us: Sequence[NDArray[np.int64]],
    errors: Sequence[str | None],
) -> None:
    """Store spans (n, 2) or departures (n,) of objects, which marks those that differ.

    errors : why the schedule of an object is not understood, or None; the object then has none of them
    """
    for first in range(0, len(objects), _AT_ONCE):
        some, of_some = objects[first : first + _AT_ONCE], instants_us[first : first + _AT_ONCE]
        is_track = [one.kind is Kind.TRACK for one in some]
        errors_of_some = list(errors[first : first + _AT_ONCE])
        spans = [_NO_SPANS if track else own.reshape(-1, 2) for own, track in zip(of_some, is_track, strict=True)]
        has_no_spans = np.array(is_track) | np.array([error is not None for error in errors_of_some])
        departures = [own if track else _NO_SPANS[:, 0] for own, track in zip(of_some, is_track, strict=True)]
        multiranges = half_open_multispans(np.concatenate(spans), offsets([len(own) for own in spans]), has_no_spans)
        call(
            conn,
            "_set_activations",
            scene_id,
            [one.kind.code for one in some],
            [one.object_id for one in some],
            [one.version for one in some],
            array([multiranges], "tstzmultirange"),
            array([instants(np.concatenate(departures))], "timestamptz"),
            [len(own) for own in departures],
            errors_of_some,
        )


def store_window(conn: psycopg.Connection[Any], scene_id: int, window: tuple[int, int] | None) -> None:
    """Store how far the schedules of a scene are expanded; None: it has none."""
    call(conn, "_set_expanded", scene_id, *(window or (None, None)))


def _pair(first_us: int | None, last_us: int | None) -> tuple[int, int] | None:
    return None if first_us is None or last_us is None else (first_us, last_us)
