"""Read conflicts, closest approaches and runs, and whether they are complete."""

from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import MISSING, dataclass, fields, replace
from datetime import UTC, datetime, timedelta
from struct import Struct
from typing import Any, Final, TypeVar

import psycopg
from psycopg.types.json import Jsonb
from psycopg.types.range import TimestamptzRange

from conflictdb.model.methods import Method
from conflictdb.model.results import (
    Approach,
    Certainty,
    Conflict,
    ConflictEvent,
    Kind,
    Listing,
    Period,
    SceneState,
    Verdict,
)
from conflictdb.store.connection import call, call_by_name, call_each_by_name, call_many, transaction

_Record = TypeVar("_Record", Conflict, Approach, ConflictEvent)

# How columns become fields. Lookup by name: calling an enum takes ten times as long, which matters in long lists.
_KINDS: Final = {kind.value: kind for kind in Kind}
_VERDICTS: Final = {verdict.value: verdict for verdict in Verdict}
_METHODS: Final = {method.value: method for method in Method}
_CERTAINTIES: Final[dict[str | None, Certainty | None]] = {certainty.value: certainty for certainty in Certainty}
_CERTAINTIES[None] = None
_WORDS: Final = (
    *(("a_kind", _KINDS), ("b_kind", _KINDS), ("verdict", _VERDICTS), ("method", _METHODS)),
    ("certainty", _CERTAINTIES),
)
_POINTS: Final = tuple(
    (f"{name}_lon_deg", f"{name}_lat_deg", field)
    for name, field in (
        ("first_contact", "first_contact_deg"),
        ("closest_a", "closest_a_deg"),
        ("closest_b", "closest_b_deg"),
        ("a", "closest_a_deg"),
        ("b", "closest_b_deg"),
    )
)

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
    object_class : those with an object of this class
    """

    at: datetime | None = None
    key: str | None = None
    start: datetime | None = None
    end: datetime | None = None
    since: datetime | None = None
    verdict: Verdict | None = None
    acknowledged: bool | None = None
    keys: Sequence[str] | None = None
    object_class: str | None = None

    @property
    def spans(self) -> list[TimestamptzRange]:
        """The times that the selection is about; none: all that is known."""
        found = [] if self.at is None else [TimestamptzRange(self.at, self.at, "[]")]
        return found if self.start is self.end is None else [*found, TimestamptzRange(self.start, self.end)]


ALL: Final = Selection()


def scene_state(conn: psycopg.Connection[Any], scene: str) -> SceneState:
    """Return whether the answers for a scene are complete; InvalidInput if the scene does not exist."""
    with transaction(conn):
        (state,) = call_by_name(conn, "_scene_state", scene)
    return SceneState(scene, **state)


def state_within(conn: psycopg.Connection[Any], state: SceneState, spans: Iterable[TimestamptzRange]) -> SceneState:
    """Return the state of a scene for questions about some spans.

    A span that begins or ends beyond the time for which schedules are expanded has no complete answer.
    """
    spans = list(spans)
    starts = [span.lower for span in spans if span.lower is not None]
    ends = [span.upper for span in spans if span.upper is not None]
    if not (starts or ends):
        return state
    first, last = min(starts + ends), max(starts + ends)
    with transaction(conn):
        # Objects that begin at the end of the horizon are beyond it.
        span = TimestamptzRange(first, last, "[]" if last in starts or first == last else "[)")
        (beyond,) = call(conn, "_beyond_horizon", state.scene, span)
    if beyond is None:
        return state
    remark = "; ".join(filter(None, (state.remark, beyond)))
    return replace(state, is_current=False, remark=remark, is_beyond_horizon=True, detection_helps=False)


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
        state = state_within(conn, scene_state(conn, scene), which.spans)
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
    span = which.start, which.end, which.since
    asked = which.at, with_region, among, which.key, *span, verdict, which.acknowledged, which.object_class
    with transaction(conn), closing(call_each_by_name(conn, "_conflicts", scene, *asked)) as rows:
        yield from _records(Conflict, scene, rows)


def each_approach(
    conn: psycopg.Connection[Any], scene: str, *, only_near: bool = False, keys: Sequence[str] | None = None
) -> Generator[Approach, None, None]:
    """Yield the result of `approaches`, fetched as it is consumed.

    `only_near` leaves out pairs in conflict, `keys` pairs of other objects. One transaction, with one cursor, is open
    until all are read.
    """
    among = None if keys is None else list(keys)
    with transaction(conn), closing(call_each_by_name(conn, "_approaches", scene, only_near, among)) as rows:
        yield from _records(Approach, scene, rows)


def conflicts_known_at(conn: psycopg.Connection[Any], scene: str, at: datetime) -> list[Conflict]:
    """Return the conflicts of a scene as they were known at an instant, earliest first, with the names of today.

    Raises InvalidInput if the scene does not exist, had no detection by then, or its history begins later.
    """
    with transaction(conn):
        rows = call_by_name(conn, "_conflicts_known_at", scene, at)
        known = names(conn, scene, (row[side] for row in rows for side in ("a_key", "b_key")))
    for row in rows:
        row |= {"a_name": known.get(row["a_key"]), "b_name": known.get(row["b_key"])}
    return list(_records(Conflict, scene, rows))


def names(conn: psycopg.Connection[Any], scene: str, keys: Iterable[str]) -> dict[str, str]:
    """Return the names of the objects with these keys, by key; those without a name are left out."""
    if not (some := sorted(set(keys))):
        return {}
    with transaction(conn):
        return dict(call_many(conn, "_names", scene, some))


def conflict_events(
    conn: psycopg.Connection[Any],
    scene: str,
    key: str | None,
    other_key: str | None,
    after: int,
    most: int | None,
    since: datetime | None,
) -> list[ConflictEvent]:
    """Return at most `most` events after number `after`, from `since` on, of a scene, object or pair.

    Raises InvalidInput if the scene or an object is unknown.
    """
    with transaction(conn):
        rows = call_by_name(conn, "_conflict_events", scene, key, other_key, after, most, since)
    return list(_records(ConflictEvent, scene, rows))


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
        return [RunStatus(**row) for row in call_by_name(conn, "_runs", scene, limit)]


def _records(of: type[_Record], scene: str, rows: Iterable[dict[str, Any]]) -> Iterator[_Record]:
    """Yield the rows of a scene, which have the same columns, as conflicts, approaches or events."""
    slots = {field.name: getattr(of, field.name).__set__ for field in fields(of)}
    is_first = True
    row: dict[str, Any]
    for row in rows:
        if is_first:
            is_first = False
            words = [(slots[name], name, meaning) for name, meaning in _WORDS if name in row]
            points = [(slots[field], lon, lat) for lon, lat, field in _POINTS if lon in row]
            has_periods = "periods" in row
            others = row.keys() - {name for _, name, _ in words} - {name for _, *both in points for name in both}
            plain = [(slots[name], name) for name in others - {"periods"}]
            known = {"scene", *row, *(field for lon, _, field in _POINTS if lon in row)}
            absent = [
                (slots[one.name], one.default)
                for one in fields(of)
                if one.name not in known and one.default is not MISSING
            ]
        record = of.__new__(of)
        if "scene" not in row:
            slots["scene"](record, scene)
        for put, value in absent:
            put(record, value)
        for put, name in plain:
            put(record, row[name])
        for put, name, meaning in words:
            put(record, meaning[row[name]])
        if has_periods:
            slots["periods"](record, decode_periods(row["periods"]))
        for put, lon, lat in points:
            lon_deg = row[lon]
            put(record, None if lon_deg is None else (lon_deg, row[lat]))
        yield record


def fields_of(row: dict[str, Any]) -> dict[str, Any]:
    """Return the columns of a row, which it changes, as the fields of a conflict, an approach or an event."""
    for name, meaning in _WORDS:
        if name in row:
            row[name] = meaning[row[name]]
    if "periods" in row:
        row["periods"] = decode_periods(row["periods"])
    for lon, lat, field in _POINTS:
        if lon in row:
            lon_deg, lat_deg = row.pop(lon), row.pop(lat)
            row[field] = None if lon_deg is None else (lon_deg, lat_deg)
    return row


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
