"""Admit plans to a scene of the database: put them only if they conflict with nobody."""

from collections.abc import Collection, Sequence
from dataclasses import replace as changed
from typing import Any, Final

import psycopg

from conflictdb.db import store
from conflictdb.earth.registry import Setup, centred
from conflictdb.errors import InvalidInput
from conflictdb.in_memory.index import Member, Members, by_kind, conflicts_between
from conflictdb.model.plans import Area, Track
from conflictdb.model.results import Admission, Conflict, Kind, Results, Verdict

# From the mildest verdict to the worst.
_SEVERITY: Final = (Verdict.GRAZING, Verdict.UNRESOLVED, Verdict.CONFLICT)


def admit(
    conn: psycopg.Connection[Any],
    scene: str,
    plans: Sequence[Area | Track],
    owner: str | None,
    *,
    allow_known: bool,
    replace: Collection[str],
    lock_timeout_s: float | None,
) -> Admission:
    """Put plans unless they conflict with anybody; see `StoredScene.admit`."""
    given = [one if owner is None else changed(one, owner=owner, **_unlimited(one)) for one in plans]
    store.require_writable(conn)
    with store.admission(conn, scene, lock_timeout_s) as (number, stored, limits):
        limits.check(given)
        setup = Setup.of(centred(stored, *by_kind(given)))
        mine = Members.of_plans(setup, given)
        replaced = store.replaced_objects(conn, number, [one.key for one in given], owner)
        _check_replaced(given, replaced, owner, replace)
        others = members_near(conn, number, setup, mine, given, replaced)
        found = _conflicts(setup, mine, others, among=owner is None)
        known: list[Conflict] = []
        if found and replaced:
            former = _members(conn, number, setup, replaced)
            known = _conflicts(setup, former, others, among=owner is None)
        new = [one for one in found if not _was_there(one, known)]
        is_admitted = not (new if allow_known else found)
        if is_admitted:
            put = {(Member.of(one).kind.code, one.key) for one in given}
            gone = [one.key for one in replaced if (one.kind, one.key) not in put]
            store.put_plans(conn, scene, gone, *by_kind(given))
    return Admission(is_admitted, Results(found, Conflict), Results(new, Conflict))


def _check_replaced(
    plans: Sequence[Area | Track], stored: Sequence[store.StoredObject], owner: str | None, named: Collection[str]
) -> None:
    """Raise InvalidInput for a plan with the key of a stored object that it may not replace.

    stored : objects with the keys of the plans, and those of `owner`
    """
    owners = {one.key: one.owner for one in plans}
    for one in stored:
        if one.key not in owners:
            continue
        if one.owner is not None and owners[one.key] != one.owner:
            rule = f"belongs to owner {one.owner!r}; got owner {owners[one.key]!r}: choose another key"
        elif one.key not in named and (one.owner is None or one.owner != owner):
            rule = "belongs to an object of the scene: name it in replace to put the plan in its place"
        else:
            continue
        raise InvalidInput(f"plan {one.key!r}", "key", rule)


def _unlimited(plan: Area | Track) -> dict[str, Any]:
    """Return what keeps a track from being checked for its speed again."""
    return {} if isinstance(plan, Area) else {"max_speed_kn": float("inf")}


def members_near(
    conn: psycopg.Connection[Any],
    number: int,
    setup: Setup,
    mine: Members,
    plans: Sequence[Area | Track],
    replaced: Sequence[store.StoredObject],
) -> Members:
    """Return the objects that plans might meet, as they are stored, detected or not, but for those they replace.

    setup : with a centre, if it needs one
    mine : the plans, cut
    """
    within_us = setup.scene.longest_time_us
    near = store.objects_near(conn, number, setup.scene, mine.pieces.longer(within_us, within_us), plans)
    return _members(conn, number, setup, sorted(set(near) - set(replaced)))


def _members(
    conn: psycopg.Connection[Any], number: int, setup: Setup, objects: Sequence[store.StoredObject]
) -> Members:
    known = {(one.kind, one.id): Member(Kind.of_code(one.kind), one.key, one.name, None, one.owner) for one in objects}
    return Members.of_batches(setup, *store.read_objects(conn, number, objects), known)


def _conflicts(setup: Setup, mine: Members, others: Members, *, among: bool) -> list[Conflict]:
    found = conflicts_between(setup, mine, others, among=among)
    return [one for one in found if one.verdict is not Verdict.NEAR]


def _was_there(conflict: Conflict, known: Sequence[Conflict]) -> bool:
    """Return whether a known conflict of the same objects lasts at least as long, and is at least as severe."""
    return any(
        (one.a_key, one.b_key) == (conflict.a_key, conflict.b_key)
        and _SEVERITY.index(conflict.verdict) <= _SEVERITY.index(one.verdict)
        and all(any(_within(period, other) for other in one.periods) for period in conflict.periods)
        for one in known
    )


def _within(period: tuple[Any, Any], other: tuple[Any, Any]) -> bool:
    """Return whether a period lies within another; None: unbounded."""
    (start, end), (first, last) = period, other
    return (first is None or (start is not None and first <= start)) and (
        last is None or (end is not None and end <= last)
    )
