"""Read conflicts, closest approaches and runs, and whether they are complete."""

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from struct import Struct
from typing import Any, Final

import psycopg
from psycopg.types.json import Jsonb

from conflictdb.db.store.connection import call, call_by_name, call_each, transaction
from conflictdb.model.methods import Method
from conflictdb.model.results import Approach, Conflict, ConflictEvent, Kind, Listing, Period, SceneState, Verdict

# Lookup by name: calling an enum takes ten times as long, which matters in long lists.
_KINDS: Final = {kind.value: kind for kind in Kind}
_VERDICTS: Final = {verdict.value: verdict for verdict in Verdict}
_METHODS: Final = {method.value: method for method in Method}
_NUMBERS: Final = ("a_id", "a_version", "b_id", "b_version")

# A multirange is a count, then for each range its length, a byte of flags and the bounds that exist, each after its
# length; all big-endian (PostgreSQL's multirange_send and range_send).
_SERVER_EPOCH: Final = datetime(2000, 1, 1, tzinfo=UTC)  # instants count microseconds from it
_COUNT: Final = Struct(">i")
_BOUND: Final = Struct(">iq")
_ONE_BOUNDED: Final = Struct(">iiBiqiq")
_NO_START: Final = 0x08
_NO_END: Final = 0x10


@dataclass(frozen=True, slots=True)
class RunStatus:
    """A finished detection: a row of table `run`. Instants in UTC; error is None unless it failed."""

    run_id: int
    scene_id: int
    started_at: datetime
    finished_at: datetime
    method: str
    settings: dict[str, Any]
    objects: int
    candidate_pairs: int | None
    intersecting_pairs: int | None
    window_pairs: int | None
    solved_pairs: int | None
    conflicts: int | None
    unresolved: int | None
    opened: int | None
    changed: int | None
    closed: int | None
    pieces_s: float | None
    stage1_s: float | None
    stage2_s: float | None
    stage3_s: float | None
    stage4_s: float | None
    write_s: float | None
    error: str | None


@dataclass(frozen=True, slots=True)
class Selection:
    """Which conflicts of a scene to read; None: all.

    at : those at an instant
    key : those of one object
    start, end : those with a period in [start, end)
    since : those that opened or changed since then
    verdict : those with this verdict
    acknowledged : those that are acknowledged, or that are not
    keys : those among these objects
    """

    at: datetime | None = None
    key: str | None = None
    start: datetime | None = None
    end: datetime | None = None
    since: datetime | None = None
    verdict: Verdict | None = None
    acknowledged: bool | None = None
    keys: Sequence[str] | None = None


ALL: Final = Selection()


def scene_state(conn: psycopg.Connection[Any], scene: str) -> SceneState:
    """Return whether the answers for a scene are complete; InvalidInput if the scene does not exist."""
    with transaction(conn):
        objects, pending, last_run_at, last_error, is_current, remark, detected_at = call(conn, "_scene_state", scene)
    return SceneState(scene, objects, pending, _utc(last_run_at), last_error, is_current, remark, _utc(detected_at))


def wait_until_current(conn: psycopg.Connection[Any], scene: str, timeout: timedelta) -> None:
    """Wait until no change of a scene waits for detection; raises NotCurrent on timeout."""
    with transaction(conn):
        call(conn, "wait_until_current", scene, timeout)


def conflicts(
    conn: psycopg.Connection[Any],
    scene: str,
    which: Selection = ALL,
    *,
    with_region: bool = False,
) -> Listing[Conflict]:
    """Return the selected conflicts of a scene, earliest first; InvalidInput if it or an object does not exist."""
    with transaction(conn):
        # State before list: a detection that ends in between makes the list better than its state says, never worse.
        state = scene_state(conn, scene)
        return Listing(state, each_conflict(conn, scene, which, with_region=with_region), Conflict)


def approaches(conn: psycopg.Connection[Any], scene: str) -> Listing[Approach]:
    """Return the known closest approaches of a scene's pairs, earliest first; InvalidInput if it does not exist."""
    with transaction(conn):
        state = scene_state(conn, scene)
        return Listing(state, each_approach(conn, scene), Approach)


def each_conflict(
    conn: psycopg.Connection[Any],
    scene: str,
    which: Selection = ALL,
    *,
    with_region: bool = False,
) -> Generator[Conflict, None, None]:
    """Yield the result of `conflicts`, fetched as it is consumed.

    One transaction, with one cursor, is open until all are read.
    """
    among = None if which.keys is None else list(which.keys)
    verdict = None if which.verdict is None else str(which.verdict)
    asked = (which.at, with_region, among, which.key, which.start, which.end, which.since, verdict, which.acknowledged)
    with transaction(conn), closing(call_each(conn, "_conflicts", scene, *asked)) as rows:
        for row in rows:
            a_key, a_kind, b_key, b_kind, periods, verdict, region, lon_deg, lat_deg, method, time_error_s, *rest = row
            is_current, run_id, found_at, closest_at, closest_m, closest_error_m, *rest = rest
            a_lon_deg, a_lat_deg, b_lon_deg, b_lat_deg, scene_is_current, conflict_id, changed_at, *rest = rest
            acknowledged_by, acknowledged_at, acknowledged_for, acknowledged_until, a_name, b_name, *numbers = rest
            yield Conflict(
                scene=scene,
                a_key=a_key,
                a_kind=_KINDS[a_kind],
                b_key=b_key,
                b_kind=_KINDS[b_kind],
                periods=decode_periods(periods),
                verdict=_VERDICTS[verdict],
                region=region,
                first_contact_deg=None if lon_deg is None else (lon_deg, lat_deg),
                method=_METHODS[method],
                time_error_s=time_error_s,
                is_current=is_current,
                run_id=run_id,
                found_at=found_at.astimezone(UTC),
                closest_at=_utc(closest_at),
                closest_m=closest_m,
                closest_error_m=closest_error_m,
                closest_a_deg=None if a_lon_deg is None else (a_lon_deg, a_lat_deg),
                closest_b_deg=None if b_lon_deg is None else (b_lon_deg, b_lat_deg),
                scene_is_current=scene_is_current,
                conflict_id=conflict_id,
                changed_at=_utc(changed_at),
                acknowledged_by=acknowledged_by,
                acknowledged_at=_utc(acknowledged_at),
                acknowledged_for=acknowledged_for,
                acknowledged_until=_utc(acknowledged_until),
                a_name=a_name,
                b_name=b_name,
                **dict(zip(_NUMBERS, numbers, strict=True)),
            )


def each_approach(
    conn: psycopg.Connection[Any], scene: str, *, only_near: bool = False, keys: Sequence[str] | None = None
) -> Generator[Approach, None, None]:
    """Yield the result of `approaches`, fetched as it is consumed.

    `only_near` leaves out pairs in conflict, `keys` pairs of other objects. One transaction, with one cursor, is open
    until all are read.
    """
    among = None if keys is None else list(keys)
    with transaction(conn), closing(call_each(conn, "_approaches", scene, only_near, among)) as rows:
        for row in rows:
            yield Approach(
                scene=scene,
                a_key=row[0],
                a_kind=_KINDS[row[1]],
                b_key=row[2],
                b_kind=_KINDS[row[3]],
                closest_at=_utc(row[4]),
                closest_m=row[5],
                closest_error_m=row[6],
                closest_a_deg=(row[7], row[8]),
                closest_b_deg=(row[9], row[10]),
                verdict=_VERDICTS[row[11]],
                is_current=row[12],
                run_id=row[13],
                found_at=row[14].astimezone(UTC),
                scene_is_current=row[15],
                method=_METHODS[row[16]],
                time_error_s=row[17],
                a_name=row[18],
                b_name=row[19],
                **dict(zip(_NUMBERS, row[20:], strict=True)),
            )


def conflicts_known_at(conn: psycopg.Connection[Any], scene: str, at: datetime) -> list[Conflict]:
    """Return the conflicts of a scene as they were known at an instant, earliest first.

    Raises InvalidInput if the scene does not exist, had no detection by then, or its history begins later.
    """
    with transaction(conn):
        rows = call_by_name(conn, "_conflicts_known_at", scene, at)
    return [
        Conflict(
            scene=scene,
            **_typed(row, "found_at", "acknowledged_at", "acknowledged_until") | {"method": _METHODS[row["method"]]},
        )
        for row in rows
    ]


def conflict_events(
    conn: psycopg.Connection[Any], scene: str, key: str | None, other_key: str | None, after: int, most: int | None
) -> list[ConflictEvent]:
    """Return at most `most` events after number `after`, of a scene, object or pair; InvalidInput if unknown."""
    with transaction(conn):
        rows = call_by_name(conn, "_conflict_events", scene, key, other_key, after, most)
    return [ConflictEvent(scene=scene, **_typed(row, "at", "opened_at", "closed_at")) for row in rows]


def explain_conflict(conn: psycopg.Connection[Any], scene: str, a_key: str, b_key: str) -> dict[str, Any]:
    """Return why two objects are in conflict or not; InvalidInput if the scene or one of them does not exist."""
    with transaction(conn):
        (facts,) = call(conn, "explain_conflict", scene, a_key, b_key)
    return dict(facts)


def explained_text(conn: psycopg.Connection[Any], facts: dict[str, Any]) -> str:
    """Return the facts of `explain_conflict` as text."""
    with transaction(conn):
        return str(call(conn, "_explained_text", Jsonb(facts))[0])


def runs(conn: psycopg.Connection[Any], scene: str, limit: int = 1) -> list[RunStatus]:
    """Return the last runs of a scene, newest first; InvalidInput if the scene does not exist."""
    with transaction(conn):
        rows = call_by_name(conn, "_runs", scene, limit)
    instants = ("started_at", "finished_at")
    return [RunStatus(**{**row, **{name: row[name].astimezone(UTC) for name in instants}}) for row in rows]


def _typed(row: dict[str, Any], *instants: str) -> dict[str, Any]:
    """Return a row by column names, with kinds, verdict, periods and instants converted."""
    return {
        **row,
        **{name: _utc(row[name]) for name in (*instants, "closest_at")},
        "a_kind": _KINDS[row["a_kind"]],
        "b_kind": _KINDS[row["b_kind"]],
        "verdict": _VERDICTS[row["verdict"]],
        "periods": decode_periods(row["periods"]),
    }


def _utc(instant: datetime | None) -> datetime | None:
    return None if instant is None else instant.astimezone(UTC)


def decode_periods(sent: bytes) -> tuple[Period, ...]:
    """Decode the periods of a tstzmultirange in binary form (multirange_send)."""
    if len(sent) == _ONE_BOUNDED.size:  # the usual case
        *_, start, _, end = _ONE_BOUNDED.unpack(sent)
        return ((_instant(start), _instant(end)),)
    found = []
    place = _COUNT.size
    for _ in range(_COUNT.unpack_from(sent)[0]):
        flags = sent[place + _COUNT.size]
        place += _COUNT.size + 1
        ends: list[datetime | None] = []
        for is_unbounded in (flags & _NO_START, flags & _NO_END):
            ends.append(None if is_unbounded else _instant(_BOUND.unpack_from(sent, place)[1]))
            place += 0 if is_unbounded else _BOUND.size
        found.append((ends[0], ends[1]))
    return tuple(found)


def _instant(us: int) -> datetime:
    return _SERVER_EPOCH + timedelta(microseconds=us)
