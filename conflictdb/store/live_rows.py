"""Read new positions, and store how tracks keep their plans."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final, NamedTuple

import numpy as np
import psycopg
from numpy.typing import NDArray
from psycopg.types.json import Jsonb

from conflictdb.core.keeping import Kept
from conflictdb.store import copy_binary
from conflictdb.store.connection import call, call_by_name, call_many, transaction
from conflictdb.store.parameters import Array

# Positions that one statement inserts.
_AT_ONCE: Final = 100_000


class Heard(NamedTuple):
    """A position of a track that a look reads; height_m: None where it is unknown."""

    scene_id: int
    key: str
    track_id: int
    version: int
    at_us: int
    lon: float
    lat: float
    height_m: float | None
    error_m: float


@dataclass(frozen=True, slots=True)
class LiveTrack:
    """How a track keeps its plan: a row of the view live."""

    key: str
    state: str
    late_from_s: float | None
    late_to_s: float | None
    off_m: float | None
    instant: datetime
    lon_deg: float
    lat_deg: float
    height_m: float | None
    error_m: float
    as_of: datetime
    slack_s: float | None
    first_alarm: datetime | None


@dataclass(frozen=True, slots=True)
class LiveConflict:
    """A conflict that follows if tracks keep their lateness: a row of the view live_conflicts."""

    alarm_id: int
    key: str
    other_key: str | None
    verdict: str
    reason: str | None
    first_contact: datetime | None
    last_contact: datetime | None
    lon_deg: float | None
    lat_deg: float | None
    opened_at: datetime
    as_of: datetime


class Following(NamedTuple):
    """What the latenesses of a pair come to: see `_follow` of sql/74_live_conflicts.sql; microseconds."""

    key: str
    other_key: str
    other_kind: int
    verdict: str | None
    slack_us: int
    by_us: int
    ends_us: list[int]
    low_us: int
    high_us: int
    other_low_us: int
    other_high_us: int


class Alarm(NamedTuple):
    """A conflict that follows; None: unknown. as_of_us : when a look found it last; None: this one."""

    verdict: str
    reason: str | None = None
    first_us: int | None = None
    last_us: int | None = None
    lonlat: tuple[float, float] | None = None
    as_of_us: int | None = None


class Straying(NamedTuple):
    """A track that does not keep its plan: it is off, with its last position, or has a lateness in microseconds."""

    key: str
    is_off: bool
    low_us: int | None
    high_us: int | None
    at_us: int
    lon: float
    lat: float
    height_m: float | None
    error_m: float
    fastest_mps: float
    class_: str | None
    owner: str | None


class Unheard(NamedTuple):
    """A track under way that is silent."""

    scene_id: int
    key: str
    track_id: int
    version: int


def new_positions(conn: psycopg.Connection[Any], most: int) -> list[Heard]:
    """Return positions since the last look, in the order of scenes and instants, in the open transaction.

    most : of them; if there are more, the next look reads on (`is_behind`)
    """
    return [Heard(*row) for row in call_many(conn, "_new_positions", most)]


def are_keys_stale(conn: psycopg.Connection[Any]) -> bool:
    """Return whether objects got other keys since the look of the open transaction began."""
    return bool(call(conn, "_are_keys_stale")[0])


def is_behind(conn: psycopg.Connection[Any]) -> bool:
    """Return whether positions may wait that the last look of this session did not read, in the open transaction."""
    (answer,) = call(conn, "_is_behind")
    return bool(answer)


def replanned(conn: psycopg.Connection[Any]) -> list[Heard]:
    """Return the last positions of tracks that changed since they were compared, in the open transaction."""
    return [Heard(*row) for row in call_many(conn, "_replanned")]


def unheard(conn: psycopg.Connection[Any], now_us: int, step_us: int) -> list[Unheard]:
    """Return the tracks that are silent at an instant, in the open transaction.

    step_us : those whose silence has begun no other step of this length since the last look are left out
    """
    return [Unheard(*row) for row in call_many(conn, "_unheard", now_us, step_us)]


def live_states(conn: psycopg.Connection[Any], scene_id: int, keys: Sequence[str]) -> dict[str, Kept]:
    """Return the states of some keys, as the last look found them; late_us is that of the last position."""
    found = {}
    for key, state, at_us, lon, lat, height_m, error_m, from_s, to_s, off_m in call_many(
        conn, "_live_states", scene_id, list(keys)
    ):
        seen = None if from_s is None else (round(1e6 * from_s), round(1e6 * to_s))
        found[key] = Kept(state, seen, off_m, at_us, (lon, lat), height_m, error_m, seen)
    return found


def put_live(
    conn: psycopg.Connection[Any],
    scene_id: int,
    as_of_us: int,
    states: dict[str, Kept],
    versions: Mapping[str, int],
    fastest_mps: Mapping[str, float],
) -> None:
    """Store the states of some keys at an instant, and the versions and speeds of the tracks that they are of."""
    every = list(states.values())
    late = [one.late_us or (None, None) for one in every]
    seen = [one.seen_us or (None, None) for one in every]
    call(
        conn,
        "_put_live",
        scene_id,
        as_of_us,
        list(states),
        [one.state for one in every],
        _numbers([_seconds(low) for low, _ in late]),
        _numbers([_seconds(high) for _, high in late]),
        _numbers([one.off_m for one in every]),
        [one.at_us for one in every],
        _numbers([one.lonlat[0] for one in every]),
        _numbers([one.lonlat[1] for one in every]),
        _numbers([one.height_m for one in every]),
        _numbers([one.error_m for one in every]),
        _numbers([_seconds(low) for low, _ in seen]),
        _numbers([_seconds(high) for _, high in seen]),
        [versions[key] for key in states],
        _numbers([fastest_mps[key] for key in states]),
    )


def insert_positions(
    conn: psycopg.Connection[Any],
    scene: str,
    keys: Sequence[str],
    at_us: NDArray[np.int64],
    lonlat: NDArray[np.float64],
) -> None:
    """Insert positions (n,) of tracks of a scene, all or none, in the open transaction; raises InvalidInput."""
    # Not by COPY, which PostgreSQL refuses where scenes are protected.
    for first in range(0, len(keys), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        lon, lat = copy_binary.fixed(lonlat[some, 0], "f8"), copy_binary.fixed(lonlat[some, 1], "f8")
        call(
            conn,
            "_insert_positions",
            scene,
            list(keys[some]),
            copy_binary.array([copy_binary.fixed(at_us[some], "i8")], "bigint"),
            copy_binary.array([lon], "double precision"),
            copy_binary.array([lat], "double precision"),
        )


def unknown_tracks(conn: psycopg.Connection[Any], scene: str, keys: Sequence[str]) -> set[str]:
    """Return the keys that no track of a scene has; raises InvalidInput for an unknown scene."""
    return {key for (key,) in call_many(conn, "_unknown_tracks", scene, list(keys))}


def following(conn: psycopg.Connection[Any], scene_id: int, keys: Sequence[str]) -> list[Following]:
    """Return what the latenesses of some tracks come to, for each pair that stored differences know."""
    return [Following(*row) for row in call_many(conn, "_follow", scene_id, list(keys))]


def straying(conn: psycopg.Connection[Any], scene_id: int) -> list[Straying]:
    """Return the tracks of a scene that do not keep their plans."""
    return [Straying(*row) for row in call_many(conn, "_straying", scene_id)]


def open_alarms(conn: psycopg.Connection[Any], scene_id: int, keys: Sequence[str]) -> dict[tuple[str, str], Alarm]:
    """Return the alarms of tracks with some keys, without those whose other track is off."""
    found = {}
    for row in call_many(conn, "_open_alarms", scene_id, list(keys)):
        key, other_key, verdict, reason, first_us, last_us, lon, lat, as_of_us = row
        place = None if lon is None else (lon, lat)
        found[key, other_key] = Alarm(verdict, reason, first_us, last_us, place, as_of_us)
    return found


def end_alarms(conn: psycopg.Connection[Any], now_us: int, ends_us: int, off: str) -> None:
    """End the alarms whose contact is over for `ends_us`, and those of removed objects, in the open transaction.

    off : the reason of alarms that also end when their tracks are on their plans again for as long
    """
    call(conn, "_end_alarms", now_us, ends_us, off)


def put_alarms(
    conn: psycopg.Connection[Any],
    scene_id: int,
    as_of_us: int,
    alarms: Mapping[tuple[str, str], Alarm],
    ended: Sequence[tuple[str, str]],
    slack_s: Mapping[str, float | None],
) -> None:
    """Store alarms of a scene, end others, and store the slack that is left to tracks."""
    every = list(alarms.values())
    places = [one.lonlat or (None, None) for one in every]
    call(
        conn,
        "_put_alarms",
        scene_id,
        as_of_us,
        [key for key, _ in alarms],
        [other for _, other in alarms],
        [one.verdict for one in every],
        _texts_or_null([one.reason for one in every]),
        _integers([one.first_us for one in every]),
        _integers([one.last_us for one in every]),
        _numbers([lon for lon, _ in places]),
        _numbers([lat for _, lat in places]),
        Jsonb([list(pair) for pair in ended]),
        Jsonb(dict(slack_s)),
    )


def silent_after_s(conn: psycopg.Connection[Any]) -> float:
    """Return after how many seconds without a position a track is silent."""
    return float(call(conn, "_silent_after_s")[0])


def live_conflicts(conn: psycopg.Connection[Any], scene: str) -> list[LiveConflict]:
    """Return the conflicts that follow from the lateness of tracks of a scene, the first ones first."""
    with transaction(conn):
        return [LiveConflict(**row) for row in call_by_name(conn, "_live_conflicts", scene)]


def live(conn: psycopg.Connection[Any], scene: str) -> list[LiveTrack]:
    """Return how the tracks of a scene with positions keep their plans, those that do not first."""
    with transaction(conn):
        return [LiveTrack(**row) for row in call_by_name(conn, "_live", scene)]


def prune_positions(conn: psycopg.Connection[Any]) -> None:
    """Empty the partitions of positions that are old, in the open transaction."""
    call(conn, "_prune_positions")


def _seconds(us: int | None) -> float | None:
    return None if us is None else us / 1e6


def _texts_or_null(values: Sequence[str | None]) -> Array:
    column = copy_binary.Ragged.of([None if one is None else one.encode() for one in values])
    return copy_binary.array([column], "text")


def _integers(values: Sequence[int | None]) -> Array:
    is_null = np.array([one is None for one in values], np.bool_)
    numbers = copy_binary.fixed(np.array([one or 0 for one in values], np.int64), "i8")
    return copy_binary.array([copy_binary.nullable(numbers, is_null) if is_null.any() else numbers], "bigint")


def _numbers(values: Sequence[float | None]) -> Array:
    """Return numbers as an array of double precision, None as null."""
    is_null = np.array([one is None for one in values], np.bool_)
    numbers = copy_binary.fixed(np.array([0.0 if one is None else one for one in values]), "f8")
    return copy_binary.array([copy_binary.nullable(numbers, is_null) if is_null.any() else numbers], "double precision")
