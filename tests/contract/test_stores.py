"""Every store: it reads back rows to the bit, changes nothing else, and writes all rows or none."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Final

import numpy as np
import pytest
import shapely
from stores import STORES, Answer, Member, Store

from conflictdb.arrays.answers import Conflicts
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, Scene, Track, rectangle_outline_m
from conflictdb.model.results import Certainty, Conflict, Kind, Position, Verdict

SCENE: Final = Scene("s", nearest_m=1e5)
T0: Final = datetime(2026, 3, 1, 9, 10, 11, 123_457, tzinfo=UTC)
FIRST: Final = datetime(1, 1, 1, tzinfo=UTC)
LAST: Final = datetime(9999, 12, 31, 23, 59, 59, 999_999, tzinfo=UTC)
MICROSECOND: Final = timedelta(microseconds=1)
EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)

SIDE: Final = rectangle_outline_m(100, 100, 100, 100)
TIMES_US: Final = np.array([(T0 - EPOCH) // MICROSECOND, (T0 - EPOCH) // MICROSECOND + 3_600_000_000])


def area(key: str, floor_m: float | None = None) -> Area:
    return Area(key, shapely.MultiPolygon([shapely.box(0, 50, 1, 51)]), floor_m=floor_m)


AREAS: Final = [area("Ä"), area("B"), area("a")]
TRACKS: Final = [Track(key, np.array([[0.0, 50.5], [2.0, 50.5]]), TIMES_US, SIDE) for key in ("T", "U", "b")]


def row(a: str, b: str, verdict: Verdict, **more: object) -> Conflict:
    kinds = {one.key: Kind.AREA for one in AREAS} | {one.key: Kind.TRACK for one in TRACKS}
    plain = Conflict(
        scene="s",
        a_key=a,
        a_kind=kinds[a],
        b_key=b,
        b_kind=kinds[b],
        verdict=verdict,
        periods=(),
        time_error_s=0.0,
        method=SCENE.method,
    )
    return replace(plain, **more)  # type: ignore[arg-type]


def closest(at: datetime | None, metres: float, a: Position, b: Position) -> dict[str, object]:
    places = {"closest_a_deg": a, "closest_b_deg": b}
    return {"closest_at": at, "closest_m": metres, "closest_error_m": metres / 3.0, **places}


# Areas first, then by bytes of keys; each verdict, bounded or not, with and without all that may be absent.
ROWS: Final = [
    row("B", "a", Verdict.CONFLICT, periods=((None, None),), **closest(None, 0.0, (0.5, 50.5), (0.5, 50.5))),
    row("B", "Ä", Verdict.UNRESOLVED, periods=((None, FIRST), (LAST, None)), time_error_s=1e-300),
    row(
        "B",
        "T",
        Verdict.CONFLICT,
        periods=((T0, T0 + MICROSECOND), (T0 + 3 * MICROSECOND, T0 + 4 * MICROSECOND), (LAST, LAST)),
        time_error_s=1.0 / 3.0,
        first_contact_deg=(0.1, 50.0 + 1e-14),
        certainty=Certainty.MUST,
        **closest(T0, 0.0, (0.1, 50.0 + 1e-14), (1.0 / 3.0, 50.0)),
    ),
    row(
        "a",
        "T",
        Verdict.GRAZING,
        periods=((FIRST, LAST),),
        first_contact_deg=(-180.0, -90.0),
        lacking_s=1.0 / 3.0,
        certainty=Certainty.MAY,
    ),
    row("Ä", "T", Verdict.UNRESOLVED, periods=((FIRST, None),), time_error_s=1e9),
    row("B", "U", Verdict.NEAR, **closest(None, 5e-324, (0.0, 0.0), (-0.5, 90.0))),
    row("T", "U", Verdict.NEAR, **closest(LAST, 12_345.678_9, (179.5, 1e-9), (-179.5, -1e-9))),
    row("U", "b", Verdict.GRAZING, periods=((T0, T0),), **closest(FIRST, 1e-3, (1.0, 2.0), (3.0, 4.0))),
]


def answer(rows: Sequence[Conflict], *, swapped: bool = False) -> Answer:
    """Return rows as arrays; which member of a pair comes first is free."""
    if swapped:
        rows = [
            replace(
                one,
                a_key=one.b_key,
                a_kind=one.b_kind,
                b_key=one.a_key,
                b_kind=one.a_kind,
                closest_a_deg=one.closest_b_deg,
                closest_b_deg=one.closest_a_deg,
            )
            for one in reversed(rows)
        ]

    def numbered(members: dict[str, Member]) -> Conflicts:
        a, b = [members[one.a_key] for one in rows], [members[one.b_key] for one in rows]
        periods = [(us(start, MINUS_INFINITY_US), us(end, INFINITY_US)) for one in rows for start, end in one.periods]
        return Conflicts(
            a_kind=np.array([one.kind for one in a], np.int8),
            a_id=np.array([one.number for one in a], np.int64),
            a_version=np.array([one.version for one in a], np.int64),
            b_kind=np.array([one.kind for one in b], np.int8),
            b_id=np.array([one.number for one in b], np.int64),
            b_version=np.array([one.version for one in b], np.int64),
            period_us=np.array(periods, np.int64).reshape(-1, 2),
            period_offset=np.cumsum([0, *(len(one.periods) for one in rows)]).astype(np.int64),
            verdict=np.array([one.verdict.code for one in rows], np.int8),
            first_contact_deg=places([one.first_contact_deg for one in rows]),
            time_error_s=np.array([one.time_error_s for one in rows], np.float64),
            closest_us=np.array([us(one.closest_at, MINUS_INFINITY_US) for one in rows], np.int64),
            closest_m=np.array([one.closest_m for one in rows], np.float64),  # NaN for None
            closest_error_m=np.array([one.closest_error_m for one in rows], np.float64),
            closest_a_deg=places([one.closest_a_deg for one in rows]),
            closest_b_deg=places([one.closest_b_deg for one in rows]),
            lacking_s=np.array([one.lacking_s for one in rows], np.float64),
            certainty=np.array([-1 if one.certainty is None else one.certainty.code for one in rows], np.int8),
        )

    return numbered


def us(instant: datetime | None, absent: int) -> int:
    return absent if instant is None else (instant - EPOCH) // MICROSECOND


def places(given: Sequence[Position | None]) -> np.ndarray:
    return np.array([one or (np.nan, np.nan) for one in given], np.float64).reshape(-1, 2)


def by_pair(rows: Sequence[Conflict]) -> dict[tuple[str, str], Conflict]:
    """Rows by their keys, each pair once."""
    found = {(one.a_key, one.b_key): one for one in rows}
    assert len(found) == len(rows)
    return found


def by_keys(rows: Sequence[Conflict]) -> dict[tuple[str, str], Conflict]:
    """The rows by pair, without run and time of detection."""
    who = {"is_current": None, "scene_is_current": None, "run_id": None, "found_at": None, "conflict_id": None}
    return by_pair([replace(one, **who, changed_at=None) for one in rows])


@pytest.fixture(params=STORES.values(), ids=list(STORES))
def store(request: pytest.FixtureRequest, dsn: str) -> Iterator[Store]:
    """Return a store with all objects and all rows, given with the other member first: order of rows is the store's."""
    with request.param(dsn, SCENE) as opened:
        opened.put(AREAS, TRACKS)
        assert opened.write(answer(ROWS, swapped=True)) == (6, 0, 0)
        yield opened


def test_what_was_written_is_read(store: Store) -> None:
    found = store.read()
    assert by_keys(found) == by_pair(ROWS)
    assert all(one.is_current and one.scene_is_current for one in found)
    assert len({one.run_id for one in found}) == 1


@pytest.mark.parametrize("swapped", [False, True])
def test_the_same_answer_again_changes_nothing(store: Store, swapped: bool) -> None:
    """For either order of a pair's members and of the rows: an equal row keeps its values, and its run."""
    before = by_pair(store.read())
    store.mark_all()
    assert store.write(answer(ROWS, swapped=swapped)) == (0, 0, 0)
    assert by_pair(store.read()) == before


def test_rows_of_pairs_that_are_not_marked_stay(store: Store) -> None:
    """Only rows of B are replaced: one changes, one is gone, one is only near now, and one is no longer only near."""
    before = by_pair(store.read())
    store.put([area("B", floor_m=1.0)], [])
    assert {(one.a_key, one.b_key) for one in store.read() if not one.is_current} == {
        pair for pair in before if "B" in pair
    }
    changed = [
        replace(ROWS[1], verdict=Verdict.CONFLICT),
        replace(ROWS[2], verdict=Verdict.NEAR, periods=(), time_error_s=0.0, first_contact_deg=None, certainty=None),
        replace(ROWS[5], verdict=Verdict.GRAZING, periods=((T0, T0),), time_error_s=0.5),
    ]
    assert store.write(answer(changed)) == (1, 1, 2)
    after = by_pair(store.read())
    others = {pair: one for pair, one in before.items() if "B" not in pair}
    assert {pair: one for pair, one in after.items() if "B" not in pair} == others
    assert by_keys([one for pair, one in after.items() if "B" in pair]) == by_pair(changed)
    assert all(one.is_current and one.scene_is_current for one in after.values())
    # A changed conflict keeps the time it was found; a near pair that becomes a conflict is found now.
    run_id = max(one.run_id or 0 for one in before.values())
    assert all((after[pair].run_id or 0) > run_id for pair in after.keys() - others.keys())
    assert after["B", "Ä"].found_at == before["B", "Ä"].found_at < after["B", "U"].found_at


def test_what_is_not_found_again_is_gone(store: Store) -> None:
    store.mark_all()
    assert not any(one.is_current for one in store.read())
    assert store.write(answer([])) == (0, 0, 6)
    assert store.read() == []


def test_a_crash_leaves_the_rows_and_marks_there_were(store: Store) -> None:
    """And a later write finds them."""
    store.put([area("B", floor_m=1.0)], [])
    before = by_pair(store.read())
    store.crash(answer([]))
    assert by_pair(store.read()) == before
    kept = [one for one in ROWS if "B" in (one.a_key, one.b_key)]
    assert store.write(answer(kept)) == (0, 0, 0)
    assert by_keys(store.read()) == by_pair(ROWS)
