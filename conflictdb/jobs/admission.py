"""Admit plans to a scene of the database: put them only if they conflict with nobody."""

from collections.abc import Collection, Sequence
from contextlib import suppress
from typing import Any, Final, NamedTuple

import psycopg

from conflictdb import store
from conflictdb.core.conflicts_between import conflicts_between
from conflictdb.core.members import Member, Members, by_kind
from conflictdb.core.world import World, has_schedules
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.jobs.members_near import members, read_members_near, require_within, world_of
from conflictdb.model.plans import Area, Scene, Track, owned_by
from conflictdb.model.recurring_plans import Window
from conflictdb.model.results import Admission, Conflict, Results, Verdict

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
    given = [one if owner is None else owned_by(one, owner) for one in plans]
    store.require_writable(conn)
    early = _cut_early(conn, scene, given)
    rows = store.plan_rows(*by_kind(given))
    keys = [one.key for one in given]
    with store.admission(conn, scene, lock_timeout_s, keys, owner) as (number, stored, limits, replaced):
        limits.check(given)
        require_within(conn, number, stored, given)
        cut = early if early is not None and early.scene == stored else _cut(conn, number, stored, given)
        world, mine = cut.world, cut.members
        _check_replaced(given, replaced, owner, replace)
        others = read_members_near(conn, number, world, cut.span, mine, replaced)
        found = _conflicts(world.setup, mine, others, among=owner is None)
        known: list[Conflict] = []
        if found and replaced:
            former = members(conn, number, world, cut.span, [one._replace(is_stale=True) for one in replaced])
            known = _conflicts(world.setup, former, others, among=owner is None)
        new = [one for one in found if not _was_there(one, known)]
        is_admitted = not (new if allow_known else found)
        if is_admitted:
            put = {(Member.of(one).kind.code, one.key) for one in given}
            gone = [one.key for one in replaced if (one.kind, one.key) not in put]
            store.put_rows(conn, scene, gone, rows, [one.key for one in replaced])
    return Admission(is_admitted, Results(found, Conflict), Results(new, Conflict))


class _ToAdmit(NamedTuple):
    """Plans cut under the settings of a scene; span : the time that they touch."""

    scene: Scene
    world: World
    span: Window | None
    members: Members


def _cut(conn: psycopg.Connection[Any], number: int, scene: Scene, plans: Sequence[Area | Track]) -> _ToAdmit:
    world, span = world_of(conn, number, scene, plans)
    return _ToAdmit(scene, world, span, Members.of_plans(world, plans))


def _cut_early(conn: psycopg.Connection[Any], scene: str, plans: Sequence[Area | Track]) -> _ToAdmit | None:
    """Return plans cut under the settings of the connection's last admission, before the lock; None: not known.

    Schedules are expanded, and errors raised, under the lock.
    """
    known = store.settings_of_last_admission(conn, scene)
    if known is not None and not has_schedules(plans):
        with suppress(InvalidInput):
            return _cut(conn, *known, plans)
    return None


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
