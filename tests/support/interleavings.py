"""A model of the transactions of conflictdb, and an exhaustive search of their interleavings.

Modelled: marks, the lock of a scene, detections in one and in two transactions, admissions in sessions and in workers,
branches, merges, crashes. Two objects conflict if they are at the same place. Each step of an actor is one statement;
PostgreSQL contributes snapshots, row locks, and serialization failures.

Sources: sql/14_marks.sql, sql/18_locking.sql, sql/22_few_changes.sql, `_write_run` in sql/60_write_back.sql,
sql/73_branches.sql, sql/86_admission_steps.sql; conflictdb/jobs/detect.py, conflictdb/jobs/admission.py.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, TypeAlias

# Rows of all tables; the first members of a row are its table and scene.
#   object SCENE KEY PLACE VERSION | mark SCENE KEY NAME COVERED | piece SCENE KEY PLACE | conflict SCENE KEY KEY
#   edit SCENE KEY VERSION-OF-PARENT | lock SCENE COUNT | admission SCENE COUNT | admitted SCENE KEY PLACE
#   merged SCENE KEY VERSION-OF-PARENT VERSION-REPLACED
Row: TypeAlias = tuple[Any, ...]
Rows: TypeAlias = frozenset[Row]

SCENE, BRANCH = "scene", "branch"


@dataclass(frozen=True, slots=True)
class Session:
    """One actor: its next step, and its open transaction.

    snapshot : the rows that a repeatable read sees; None: each statement sees the committed rows
    locks : rows locked until the transaction ends
    memory : of the program, kept between transactions
    crashes : how often it may still end in the middle of a transaction
    """

    step: int = 0
    snapshot: Rows | None = None
    removed: Rows = frozenset()
    added: Rows = frozenset()
    locks: frozenset[Row] = frozenset()
    memory: Row = ()
    crashes: int = 1

    def sees(self, committed: Rows) -> Rows:
        return (committed if self.snapshot is None else self.snapshot) - self.removed | self.added

    def writes(self, removed: Rows, added: Rows) -> "Session":
        """Remove and add rows; a row that this transaction added is not removed from the committed ones."""
        return replace(
            self,
            removed=self.removed | (removed - self.added),
            added=(self.added - removed) | added,
            step=self.step + 1,
        )

    def ended(self, step: int, memory: Row = ()) -> "Session":
        return Session(step=step, memory=memory, crashes=self.crashes)

    def crashed(self) -> "Session":
        return Session(crashes=self.crashes - 1)


@dataclass(frozen=True, slots=True)
class Faults:
    """Deviations from the product; the search must find each."""

    deletes_unseen_marks: bool = False
    admits_without_lock: bool = False
    admits_on_old_snapshot: bool = False
    parent_marks_no_branch: bool = False
    branch_ignores_waiting_parent: bool = False
    merge_checks_before_locks: bool = False
    detects_without_lock: bool = False


# Returns the committed rows and the session after each outcome of a step; none: it must wait.
Step: TypeAlias = Callable[[Rows, Session, frozenset[Row]], Iterator[tuple[Rows, Session]]]
Actor: TypeAlias = Sequence[Step]


def of(rows: Rows, table: str, scene: str) -> list[Row]:
    return [row for row in rows if row[0] == table and row[1] == scene]


def places(rows: Rows, table: str, scene: str) -> dict[str, int]:
    """Return the places of objects or pieces; of a branch, with those of its parent that it has not edited."""
    found = {row[2]: row[3] for row in of(rows, table, scene)}
    if scene == BRANCH:
        edited = {row[2] for row in of(rows, "edit", BRANCH)}
        found |= {row[2]: row[3] for row in of(rows, table, SCENE) if row[2] not in edited}
    return found


def meeting(at: dict[str, int], members: set[str]) -> set[tuple[str, str]]:
    """Return the pairs at the same place that contain a member."""
    return {(a, b) for a, b in combinations(sorted(at), 2) if at[a] == at[b] and members & {a, b}}


def own_keys(rows: Rows, scene: str) -> set[str]:
    return {row[2] for row in of(rows, "object", scene)}


def is_current(rows: Rows, scene: str) -> bool:
    """Whether conflictdb says so (_is_current)."""
    return not of(rows, "mark", scene) and (scene == SCENE or not of(rows, "mark", SCENE))


def untruth(rows: Rows) -> str:
    """Return which promise the committed rows break; empty: none."""
    for scene in (SCENE, BRANCH):
        if is_current(rows, scene):
            if places(rows, "piece", scene) != places(rows, "object", scene):
                return f"{scene} is current, and its pieces are not those of its objects"
            true = meeting(places(rows, "object", scene), own_keys(rows, scene))
            if {row[2:4] for row in of(rows, "conflict", scene)} != true:
                return f"{scene} is current, and its conflicts are not those of its objects"
    taken = [row[3] for row in of(rows, "admitted", SCENE)]
    if len(set(taken)) < len(taken):
        return "two plans that conflict were both admitted"
    if any(row[3] != row[4] for row in of(rows, "merged", BRANCH)):
        return "a merge overwrote an edit that it had not seen"
    return ""


def _commit(rows: Rows, me: Session, _: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
    yield rows - me.removed | me.added, me.ended(me.step + 1, me.memory)


def _commit_and_start_over(rows: Rows, me: Session, _: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
    yield rows - me.removed | me.added, me.ended(0)


def _put(scene: str, key: str, place: int | None, name: str) -> Step:
    """Put or remove an object by a statement; a branch notes which object of its parent it replaces."""

    def put(rows: Rows, me: Session, locked: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        lock = ("object", scene, key)
        if lock in locked:
            return
        sees = me.sees(rows)
        former = frozenset(row for row in of(sees, "object", scene) if row[2] == key)
        added: set[Row] = {("mark", scene, key, name, False)}
        if place is not None:
            added.add(("object", scene, key, place, name))
        if scene == BRANCH and not any(row[2] == key for row in of(sees, "edit", BRANCH)):
            version = next((row[4] for row in of(sees, "object", SCENE) if row[2] == key), None)
            added.add(("edit", BRANCH, key, version))
        yield rows, replace(me.writes(former, frozenset(added)), locks=me.locks | {lock})

    return put


def editor(name: str, *transactions: Sequence[tuple[str, str, int | None]]) -> Actor:
    """Return an actor that puts and removes objects in transactions of one or more statements."""
    steps: list[Step] = []
    for edits in transactions:
        steps += [_put(*edit, f"{name}{len(steps)}.{nr}") for nr, edit in enumerate(edits)]
        steps.append(_commit)
    return steps


def _begin(scene: str) -> Step:
    """Begin a transaction; the first one waits for marks."""

    def begin(rows: Rows, me: Session, _: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        if me.step or of(rows, "mark", scene):
            yield rows, replace(me, snapshot=rows, step=me.step + 1)

    return begin


def _took(rows: Rows, me: Session, locked: frozenset[Row], scene: str, faults: Faults) -> int | None:
    """Return the count of a scene's lock after this transaction took it; None: it cannot take the lock.

    Another transaction has the lock, took it since this one's snapshot, or removes or removed the scene. In the product
    a row lock does this: after a change since the snapshot, taking it is a serialization failure.
    """
    if ("row of scene", scene) in locked or not of(rows, "lock", scene):
        return None
    (lock,) = of(me.sees(rows), "lock", scene)
    if faults.detects_without_lock:
        return lock[2] + 1
    return None if ("lock", scene) in locked or lock not in rows else lock[2] + 1


def _counted(me: Session, scene: str, count: int) -> Session:
    lock = ("lock", scene)
    return replace(
        me,
        removed=me.removed | {(*lock, count - 1)},
        added=me.added | {(*lock, count)},
        locks=me.locks | {lock, ("row of scene", scene)},
    )


def _with_pieces(rows: Rows, me: Session, scene: str) -> Session:
    """Cover all marks that a detection sees, and make the pieces of the marked objects again."""
    sees = me.sees(rows)
    marks = frozenset(of(sees, "mark", scene))
    keys = {row[2] for row in marks}
    at = {row[2]: row[3] for row in of(sees, "object", scene)}
    stale = frozenset(row for row in of(sees, "piece", scene) if row[2] in keys)
    made = {("piece", scene, key, at[key]) for key in keys & at.keys()}
    covered = {(*row[:4], True) for row in marks}
    return me.writes((stale | marks) - frozenset(made | covered), frozenset(made | covered))


def _with_conflicts(rows: Rows, me: Session, scene: str, faults: Faults) -> Session:
    """Replace the conflicts of the objects with covered marks, and delete these marks (_write_run)."""
    sees = me.sees(rows)
    covered = frozenset(row for row in of(sees, "mark", scene) if row[4])
    keys = {row[2] for row in covered}
    stale = frozenset(row for row in of(sees, "conflict", scene) if keys & set(row[2:4]))
    own = keys & own_keys(sees, scene)
    found = {("conflict", scene, *pair) for pair in meeting(places(sees, "piece", scene), own)}
    gone = covered | (stale - found)
    if faults.deletes_unseen_marks:
        gone |= frozenset(of(rows, "mark", scene))
    # A detection of the parent marks its branch; one of the branch does if it sees that the parent waits.
    if scene == SCENE:
        marks_branch = not faults.parent_marks_no_branch
    else:
        marks_branch = bool(of(sees, "mark", SCENE)) and not faults.branch_ignores_waiting_parent
    if marks_branch:
        (lock,) = of(sees, "lock", scene)
        found |= {("mark", BRANCH, key, f"detection of {scene} {lock[2]}", False) for key in own_keys(sees, BRANCH)}
    return me.writes(gone, frozenset(found))


def detector(scene: str, faults: Faults, *, two: bool = False, crashes: bool = False) -> Actor:
    """Return an actor that detects whenever a scene has marks, in one transaction or two, and perhaps ends between."""

    def write(rows: Rows, me: Session, mine: Session) -> Iterator[tuple[Rows, Session]]:
        yield rows, replace(_with_conflicts(rows, mine, scene, faults), step=me.step + 1)
        if crashes and me.crashes:
            yield rows, me.crashed()

    def few(rows: Rows, me: Session, locked: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        count = _took(rows, me, locked, scene, faults)
        if count is None:
            yield rows, me.ended(0)
        else:
            yield from write(rows, me, _with_pieces(rows, _counted(me, scene, count), scene))

    def first(rows: Rows, me: Session, locked: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        count = _took(rows, me, locked, scene, faults)
        if count is None:
            yield rows, me.ended(0)
        else:
            yield rows, replace(_with_pieces(rows, _counted(me, scene, count), scene), memory=(count,))

    def second(rows: Rows, me: Session, locked: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        count = _took(rows, me, locked, scene, faults)
        if count is not None:
            mine = _counted(me, scene, count)
            yield from write(rows, me, mine if count == me.memory[0] + 1 else _with_pieces(rows, mine, scene))
        elif not of(rows, "lock", scene):
            yield rows, me.ended(0)
        elif not {("lock", scene), ("row of scene", scene)} & locked:
            yield rows, me.ended(me.step - 1, me.memory)  # a serialization failure: begin again

    if not two:
        return [_begin(scene), few, _commit_and_start_over]
    return [_begin(scene), first, _commit, _begin(scene), second, _commit_and_start_over]


def admission(key: str, place: int, faults: Faults, *, by_worker: bool) -> Actor:
    """Return an actor that admits a plan: in a session each statement sees what is committed, a worker has a snapshot.

    Another plan at the same place is near.
    """

    def begin(rows: Rows, me: Session, _: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        yield rows, replace(me, snapshot=rows if by_worker else None, step=me.step + 1)

    def lock(rows: Rows, me: Session, locked: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        name = ("admission", SCENE)
        if faults.admits_without_lock:
            yield rows, replace(me, step=me.step + 1)
            return
        if name in locked:
            return
        (row,) = of(rows, *name)
        if by_worker and row not in me.sees(rows) and not faults.admits_on_old_snapshot:
            yield rows, me.ended(0)
            return
        yield rows, replace(me.writes(frozenset({row}), frozenset({(*name, row[2] + 1)})), locks=me.locks | {name})

    def read(rows: Rows, me: Session, _: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        near = [row for row in of(me.sees(rows), "object", SCENE) if row[3] == place]
        yield rows, me.ended(len(steps)) if near else replace(me, step=me.step + 1)

    def put(rows: Rows, me: Session, locked: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        for after, one in _put(SCENE, key, place, f"admitted {key}")(rows, me, locked):
            yield after, replace(one, added=one.added | {("admitted", SCENE, key, place)})

    steps: Actor = [begin, lock, read, put, _commit]
    return steps


def merge(key: str, faults: Faults) -> Actor:
    """Return an actor that merges a branch that has edited a key, and removes the branch."""

    def edit(rows: Rows) -> Row | None:
        return next((row for row in of(rows, "edit", BRANCH) if row[2] == key), None)

    def version(rows: Rows) -> Row | None:
        return next((row for row in of(rows, "object", SCENE) if row[2] == key), None)

    def check_early(rows: Rows, me: Session, _: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        found, now = edit(rows), version(rows)
        if found is None or now is None:
            return
        yield rows, replace(me, step=me.step + 1, memory=(now[4] == found[3],))

    def take(rows: Rows, me: Session, locked: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        locks = {("row of scene", BRANCH), *(("object", scene, key) for scene in (BRANCH, SCENE))}
        if not locks & locked:
            yield rows, replace(me, locks=me.locks | locks, step=me.step + 1)

    def put(rows: Rows, me: Session, _: frozenset[Row]) -> Iterator[tuple[Rows, Session]]:
        found, now = edit(rows), version(rows)
        mine = next((row for row in of(rows, "object", BRANCH) if row[2] == key), None)
        is_same = found is not None and now is not None and now[4] == found[3]
        if mine is None or not (me.memory[0] if faults.merge_checks_before_locks else is_same):
            yield rows, me.ended(len(steps))
        elif found is not None and now is not None:
            gone = {row for row in rows if row[1] == BRANCH} | {now}
            made = {("object", SCENE, key, mine[3], "merged"), ("mark", SCENE, key, "merged", False)}
            yield rows, me.writes(frozenset(gone), frozenset(made | {("merged", BRANCH, key, found[3], now[4])}))

    steps: Actor = [check_early, take, put, _commit]
    return steps


def start(at: dict[str, int]) -> Rows:
    """Return a scene with objects, detected, and a branch without edits."""
    rows: set[Row] = {("lock", SCENE, 0), ("lock", BRANCH, 0), ("admission", SCENE, 0)}
    for key, place in at.items():
        rows |= {("object", SCENE, key, place, "first"), ("piece", SCENE, key, place)}
    return frozenset(rows | {("conflict", SCENE, *pair) for pair in meeting(at, set(at))})


@dataclass(frozen=True, slots=True)
class Search:
    """Result of a search: how many states there are, and the first broken promise with the steps that lead to it."""

    states: int
    untruth: str = ""
    way: tuple[int, ...] = ()


def search(begin: Rows, actors: Sequence[Actor], most: int | None = None) -> Search:
    """Visit every state that the actors can reach, or the nearest ones, and return the first that breaks a promise.

    A state in which no actor can go on must have a current scene and branch: nothing waits for ever.
    """
    State: TypeAlias = tuple[Rows, tuple[Session, ...]]
    first: State = (begin, tuple(Session() for _ in actors))
    known: dict[State, tuple[State, int] | None] = {first: None}
    waiting = [first]

    def way(state: State) -> tuple[int, ...]:
        steps = []
        while (former := known[state]) is not None:
            state, actor = former
            steps.append(actor)
        return tuple(reversed(steps))

    for state in waiting:  # grows
        rows, sessions = state
        goes_on = False
        for nr, (actor, me) in enumerate(zip(actors, sessions, strict=True)):
            if me.step >= len(actor):
                continue
            locked = frozenset().union(*(other.locks for i, other in enumerate(sessions) if i != nr))
            for after, session in actor[me.step](rows, me, locked):
                goes_on = True
                new = (after, (*sessions[:nr], session, *sessions[nr + 1 :]))
                if new in known:
                    continue
                known[new] = (state, nr)
                waiting.append(new)
                if after is not rows and (broken := untruth(after)):
                    return Search(len(known), broken, way(new))
        if not goes_on and not (is_current(rows, SCENE) and is_current(rows, BRANCH)):
            return Search(len(known), "something waits for ever", way(state))
        if most is not None and len(known) >= most:
            break
    return Search(len(known))
