"""Compare plans with many others in memory, one question at a time (`Index`): no database, the answer of `solve`.

Boxes are kept in trees of the kernel, each at least twice as large as the next (the logarithmic method: J. L. Bentley,
J. B. Saxe, J. Algorithms 1 (1980), doi:10.1016/0196-6774(80)90015-2). A plan that is put makes a small tree; trees that
come too close in size are merged. A tree never changes, so questions need no lock.
"""

import threading
from collections.abc import Iterable, Mapping, Sequence
from copy import copy, deepcopy
from dataclasses import dataclass, field, fields, replace
from itertools import compress
from operator import attrgetter
from typing import Any, Final, NamedTuple, Self, TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.objects import TrackBatch
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.conflicts_between import conflicts_of
from conflictdb.core.members import Member, Members, Plan, by_kind
from conflictdb.core.near import Question, Together
from conflictdb.core.stage1_broad_phase import rows_of
from conflictdb.core.world import World, has_schedules, horizon, hull, touched
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.kernel.boxes import BoxTree, HeldBoxes
from conflictdb.memory.questions import Objects, scene_of
from conflictdb.model import inputs
from conflictdb.model.limits import Limits
from conflictdb.model.plans import Area, Scene, Track
from conflictdb.model.recurring_plans import Window
from conflictdb.model.results import Conflict, Results
from conflictdb.model.rules import check_word

_NO_TRACKS: Final = TrackBatch.of([])
# Fewer plans than this that are put together wait until others were put, or a question is asked.
_FEW: Final = 32
# Plans that wait at most: cutting takes memory for all of them at once.
_WAITING: Final = 128
# The fields of plans that count.
_AREA_FIELDS, _TRACK_FIELDS = (
    attrgetter(*(one.name for one in fields(kind) if one.name != "properties")) for kind in (Area, Track)
)


class Index:
    """Plans in memory that others are compared with; safe to use from several threads.

    The answer is that of `solve` on the same plans. Plans of one owner are never compared with each other.

    scene : the settings; a centre that great circles need follows from the first plans if it is not given
    max_vertices : most points of an area, also those that close its rings, or waypoints of a track; None: 1,000,000
    max_days_ahead : days from now until which a plan must end; None: no limit, plans without times are accepted
    """

    def __init__(
        self, scene: Scene | None = None, *, max_vertices: int | None = None, max_days_ahead: float | None = None
    ) -> None:
        scene = scene_of("Index", scene)
        if max_vertices is not None:
            inputs.count("Index", "max_vertices", max_vertices, 1)
        if max_days_ahead is not None:
            inputs.days("Index", "max_days_ahead", max_days_ahead)
        self._limits = Limits(max_vertices, max_vertices, max_days_ahead)
        self._scene = scene
        self._lock = threading.Lock()
        # Owners by name, and the owner of each key: plans that are their own owners have no name.
        self._owners: dict[str, _Owner] = {}
        self._owner_of: dict[str, _Owner] = {}
        self._state = _State()
        # Plans of the newest state that are in no tree yet, by key: many are cut at once.
        self._waiting: dict[str, _NewPlan] = {}
        # When plans without a schedule may touch anything, and over which time schedules are expanded.
        self._touched: Window | None = None
        self._window: Window | None = None
        # Pieces with which the last probe of plans beyond that time was compared.
        self._extra: _Extra | None = None
        self._cut = _LastCut()

    @property
    def scene(self) -> Scene:
        """The settings, with the centre once there is one."""
        return self._scene

    def __len__(self) -> int:
        """Return the number of plans."""
        return len(self._owner_of)

    def put(self, plans: Plan | Sequence[Plan], owner: str | None = None, *, replace: Sequence[str] = ()) -> None:
        """Add the plans of an owner, in place of those it had.

        Parameters
        ----------
        plans : Area or Track, or a sequence of them
        owner : str, optional
            By default each plan is its own owner, named by its key.
        replace : sequence of str
            Keys of plans without an owner that plans of the same key may replace.

        Raises InvalidInput, and changes nothing, for plans that do not fit the scene's plane or the limits, and for
        keys that occur twice, belong to another owner, or are of a plan that `replace` does not name.
        """
        given = listed("put", plans)
        check_word("put", "owner", owner)
        replaceable = inputs.keys("put", "replace", replace)
        self._limits.check(given)
        mine = self._cut.known(self._scene, given)
        with self._lock:
            world = self._put_world(given, is_known=mine is not None)
        if world is not None and len(given) < _FEW and not has_schedules(given):
            world.fit(*by_kind(given))
        elif world is not None:
            mine = self._cut.of(world, given)
        # Plans that are their own owners may state another, as in a scene.
        if owner is None:
            new = owners = [_Owner(one.owner, [one.key], is_plan=True) for one in given]
        else:
            new = [_Owner(owner, [one.key for one in given])]
            owners = new * len(given)
        with self._lock:
            before = None if owner is None else self._owners.get(owner)
            former = [] if before is None else [before]
            for one, of in zip(given, owners, strict=True):
                known = self._owner_of.get(one.key)
                if known is None or known is before:
                    continue
                if not known.is_plan or known.stated not in (None, of.stated):
                    rule = f"belongs to owner {known.stated!r}; got owner {of.stated!r}: keys must be unique"
                    raise InvalidInput(f"plan {one.key!r}", "key", rule)
                if one.key not in replaceable:
                    rule = "belongs to a plan of the index: name it in replace to put the plan in its place"
                    raise InvalidInput(f"plan {one.key!r}", "key", rule)
                former.append(known)
            number = self._state.number + 1
            self._forget(former, number)
            self._remember(new)
            if mine is None:
                self._state = self._state.without_dead(number, self._live())
                for one, of in zip(given, owners, strict=True):
                    self._waiting[one.key] = _NewPlan(one, of, _copied(one))
                if len(self._waiting) >= _WAITING:
                    self._cut_waiting()
            else:
                added = _Put.of(mine.members, given, owners)
                self._state = self._state.with_plans(added, number, self._live(), mine.boxes)

    def remove(self, owner: str) -> bool:
        """Remove the plans of an owner, by default of the plan with that key; return whether there were any."""
        if not isinstance(owner, str):
            raise InvalidInput("remove", "owner", f"must be a text; got {owner!r:.60}")
        with self._lock:
            known = [self._owners[owner]] if owner in self._owners else []
            if (own := self._owner_of.get(owner)) is not None and own.is_plan:
                known.append(own)
            if not known:
                return False
            number = self._state.number + 1
            self._forget(known, number)
            self._state = self._state.without_dead(number, self._live())
        return True

    def probe(self, plans: Plan | Sequence[Plan], owner: str | None = None) -> Results[Conflict]:
        """Return the conflicts that plans have with those of other owners, without adding them.

        The plans replace all plans of their owner, and plans of the same keys whoever owns them: `put` may refuse what
        `probe` finds free. If the scene has `nearest_m`, near pairs are returned too. Rows are as those of `solve`.

        owner : by default each plan is its own owner: they are compared with each other, too
        """
        given = listed("probe", plans)
        check_word("probe", "owner", owner)
        self._limits.check(given)
        with self._lock:
            world, state, is_within = self._probe_world(given)
        extra = _Extra() if is_within else self._reaching(state, world.window)
        scene = world.setup.scene
        mine = self._cut.of(world, given)
        keys = {one.key for one in given}
        question, met = Question.of(scene), Together(mine.members)
        within_us = question.within_us
        if owner is None:
            met.add_among(question)
        plans_of = {one.key: one for one in given}
        for tree, put in (*state.levels, *extra.levels):
            first, second = tree.pairs_of(mine.boxes, within_us)
            if not len(second):
                continue
            of = put.object_of[second].tolist()
            seen = {
                k: one
                for k, one, its in ((k, put.plans[k], put.owners[k]) for k in set(of))
                if state.shows(its)
                and its not in extra.instead
                and one.key not in keys
                and (owner is None or its.name != owner)
            }
            plans_of |= {one.key: one for one in seen.values()}
            rows = np.array([i for i, k in enumerate(of) if k in seen], np.int64)
            met.add(put.pieces, put.object_of, put.member, first[rows], second[rows])
        conflicts = conflicts_of(world.setup, met)
        if conflicts:
            shown: list[Plan] = [one for kind in world.expanded(*by_kind([*plans_of.values()])) for one in kind]
            origin = Objects(scene, {one.key: one for one in shown})
            conflicts = [conflict.found_by(origin) for conflict in conflicts]
        return Results(conflicts, Conflict)

    def _put_world(self, plans: Sequence[Plan], *, is_known: bool) -> World | None:
        """Return the world of plans that are put, None if they are known to fit; needs the lock.

        Schedules are expanded as far as the horizon, over all voyages of the index, and over what the plans touch. If
        that is more than before, those of the index are expanded again. Raises InvalidInput, and changes nothing.
        """
        areas, tracks = by_kind(plans)
        span = touched(tracks, self._scene)
        window = self._window
        if window is not None or has_schedules(plans):
            window = horizon(self._scene, self._touched, span, known=window)
        world = None if is_known else World.of(self._scene, areas, tracks, known=window)
        self._expand_again(window)
        self._touched = hull(self._touched, span)
        if world is not None:
            self._scene = world.setup.scene
        return world

    def _probe_world(self, plans: Sequence[Plan]) -> tuple[World, "_State", bool]:
        """Return the world of plans that are compared, the state, and whether its schedules reach as far.

        Needs the lock.
        """
        self._cut_waiting()
        window = self._window
        if window is not None:
            self._expand_again(horizon(self._scene, self._touched, known=window))
            window = self._window
        areas, tracks = by_kind(plans)
        if window is not None or has_schedules(plans):
            window = horizon(self._scene, self._touched, touched(plans, self._scene), known=window)
        world = World.of(self._scene, areas, tracks, known=window)
        return world, self._state, self._window in (None, window)

    def _reaching(self, state: "_State", window: Window | None) -> "_Extra":
        """Return the plans with schedules of a state, expanded over a window; raises InvalidInput."""
        known = self._extra
        if known is None or known.number != state.number or hull(known.window, window) != known.window:
            known = _Extra.of(self._scene, state, window)
            self._extra = known
        return known

    def _expand_again(self, window: Window | None) -> None:
        """Expand the schedules of all plans over a window, and cut these anew; needs the lock."""
        if window == self._window:
            return
        extra = _Extra.of(self._scene, self._state, window)
        if extra.instead:
            number = self._state.number + 1
            self._forget([*extra.instead], number)
            self._remember(extra.instead.values())
            for _, added in extra.levels:
                self._state = self._state.with_plans(added, number, self._live())
        self._window = window

    def _live(self) -> int:
        """Return the number of plans in trees."""
        return len(self) - len(self._waiting)

    def _cut_waiting(self) -> None:
        """Put the plans that are in no tree into one; needs the lock."""
        waiting, self._waiting = [*self._waiting.values()], {}
        if waiting:
            plans, owners, copies = (list(each) for each in zip(*waiting, strict=True))
            added = _Put.of(Members.of_plans(World(Setup.of(self._scene)), copies), plans, owners)
            self._state = self._state.with_plans(added, self._state.number, len(self))

    def _remember(self, owners: "Iterable[_Owner]") -> None:
        """Set the owners of names and keys."""
        for owner in owners:
            if owner.name is not None:
                self._owners[owner.name] = owner
            self._owner_of |= dict.fromkeys(owner.keys, owner)

    def _forget(self, owners: "list[_Owner]", number: int) -> None:
        """Hide the plans of owners from the state of a number on."""
        for owner in owners:
            owner.ended = number
            if owner.name is not None:
                del self._owners[owner.name]
            for key in owner.keys:
                del self._owner_of[key]
                self._waiting.pop(key, None)


@dataclass(slots=True, eq=False)
class _Owner:
    """An owner as it was put once.

    stated : its name, or the owner that its plan states
    is_plan : whether a plan is its own owner
    ended : number of the state that no longer shows its plans
    """

    stated: str | None
    keys: list[str]
    is_plan: bool = False
    ended: int | None = None

    @property
    def name(self) -> str | None:
        """Its name; None: a plan is its own owner."""
        return None if self.is_plan else self.stated


class _NewPlan(NamedTuple):
    """A plan that is in no tree yet; copy : as it was when it was put."""

    plan: Plan
    owner: _Owner
    copy: Plan


class _Put(NamedTuple):
    """Some plans, their owners and their pieces; object_of : (n,) the place of each piece's plan in `plans`."""

    pieces: Pieces
    object_of: NDArray[np.int32]
    plans: list[Plan]
    owners: list[_Owner]

    @classmethod
    def of(cls, cut: Members, plans: list[Plan], owners: list[_Owner]) -> Self:
        """Return plans that were cut into pieces."""
        return cls(cut.pieces, cut.of.astype(np.int32), plans, owners)

    def member(self, k: int) -> Member:
        return Member.of(self.plans[k])

    @classmethod
    def merged(cls, puts: "Sequence[_Put]") -> "_Put":
        """Return the plans that the newest state shows."""
        parts, of = [], []
        plans: list[Plan] = []
        owners: list[_Owner] = []
        for put in puts:
            is_live = [owner.ended is None for owner in put.owners]
            pieces, object_of = put.pieces, put.object_of
            if not all(is_live):
                rows = np.flatnonzero(np.array(is_live)[object_of])
                pieces, object_of = pieces.take(rows), (np.cumsum(is_live) - 1)[object_of[rows]]
            parts.append(pieces)
            of.append(object_of + len(plans))
            plans += compress(put.plans, is_live)
            owners += compress(put.owners, is_live)
        return cls(Pieces.concatenate(parts), np.concatenate(of).astype(np.int32), plans, owners)


class _Level(NamedTuple):
    """Plans, and the boxes of their pieces in a tree."""

    tree: BoxTree
    put: _Put

    @classmethod
    def of(cls, put: _Put, boxes: HeldBoxes | None = None) -> "_Level":
        """Return plans; boxes : of their pieces, if they are known."""
        return cls(BoxTree(rows_of(put.pieces) if boxes is None else boxes), put)


@dataclass(frozen=True, slots=True)
class _State:
    """What a question sees: the plans of owners that had not ended at this state's number.

    levels : each has at least twice as many pieces as the next
    """

    number: int = 0
    levels: tuple[_Level, ...] = ()

    def shows(self, owner: _Owner) -> bool:
        return owner.ended is None or owner.ended > self.number

    def with_plans(self, put: _Put, number: int, live: int, boxes: HeldBoxes | None = None) -> "_State":
        """Return the state of a number with more plans; live : plans that it shows; boxes : as of `_Level.of`."""
        levels, size = [*self.levels], len(put.pieces)
        merged = [put]
        while levels and len(levels[-1].put.pieces) < 2 * size:
            merged.insert(0, levels.pop().put)
            size += len(merged[0].pieces)
        added = _Level.of(put, boxes) if len(merged) == 1 else _Level.of(_Put.merged(merged))
        return _State(number, (*levels, added)).without_dead(number, live)

    def without_dead(self, number: int, live: int) -> "_State":
        """Return the state of a number; levels are merged once half of their plans have ended."""
        puts = [level.put for level in self.levels]
        if 2 * live >= sum([len(put.plans) for put in puts]):
            return self if number == self.number else _State(number, self.levels)
        return _State(number, (_Level.of(_Put.merged(puts)),) if live else ())


@dataclass(frozen=True, slots=True)
class _Extra:
    """Plans with schedules of a state, expanded over another window.

    number : of the state
    levels : their boxes
    instead : by the owner in the state, the one of these plans
    """

    number: int = 0
    window: Window | None = None
    levels: tuple[_Level, ...] = ()
    instead: Mapping[_Owner, _Owner] = field(default_factory=dict)

    @classmethod
    def of(cls, scene: Scene, state: _State, window: Window | None) -> Self:
        """Return the plans of all owners in a state that have a schedule; raises InvalidInput."""
        held = (pair for _, put in state.levels for pair in zip(put.plans, put.owners, strict=True))
        shown = [(plan, owner) for plan, owner in held if state.shows(owner)]
        former = {owner for plan, owner in shown if plan.schedule is not None}
        if not former:
            return cls(state.number, window)
        instead = {owner: replace(owner, keys=[*owner.keys], ended=None) for owner in former}
        plans = [plan for plan, owner in shown if owner in former]
        owners = [instead[owner] for _, owner in shown if owner in former]
        added = _Put.of(Members.of_plans(World(Setup.of(scene), window), plans), plans, owners)
        return cls(state.number, window, (_Level.of(added),), instead)


def listed(who: str, plans: Any) -> list[Plan]:
    """Return a plan, or several, as a list; raises InvalidInput for anything else."""
    given = list(plans) if isinstance(plans, Sequence) and not isinstance(plans, str) else [plans]
    for plan in given:
        if not isinstance(plan, Area | Track):
            raise InvalidInput(who, "plan", f"must be an Area or a Track, or several; got {type(plan).__name__}")
    if not given:
        raise InvalidInput(who, "plan", "must be an Area or a Track, or several; got none")
    return given


class _Cut(NamedTuple):
    """Plans cut into pieces, and the boxes of these."""

    members: Members
    boxes: HeldBoxes


# Settings, the time over which schedules are expanded, and the contents of plans.
_Question: TypeAlias = tuple[Scene, Window | None, list[tuple[Any, ...]]]


class _LastCut(threading.local):
    """The plans that a thread asked about last, and their pieces."""

    def __init__(self) -> None:
        self._asked: _Question | None = None
        self._cut: _Cut | None = None

    def of(self, world: World, plans: Sequence[Plan]) -> _Cut:
        """Return plans cut into pieces, as `Members.of_plans` does."""
        asked = self._question(world.setup.scene, world.window, plans)
        if self._cut is not None and asked == self._asked:
            members = self._cut.members._replace(each=[Member.of(one) for one in plans])
            return self._cut._replace(members=members)
        members = Members.of_plans(world, plans, warns=True)
        self._cut, self._asked = _Cut(members, HeldBoxes.of(rows_of(members.pieces))), asked
        return self._cut

    def known(self, scene: Scene, plans: Sequence[Plan]) -> _Cut | None:
        """Return the last question's plans cut into pieces if these are the same and have no schedule, or None."""
        if self._cut is None or has_schedules(plans):
            return None
        return self._cut if self._question(scene, None, plans) == self._asked else None

    def _question(self, scene: Scene, window: Window | None, plans: Sequence[Plan]) -> _Question:
        return scene, window if has_schedules(plans) else None, [_content(one) for one in plans]


def _copied(plan: Plan) -> Plan:
    """Return a plan whose arrays and mappings nobody changes in place."""
    if isinstance(plan, Area):
        return plan
    copied = copy(plan)
    for one in fields(Track):
        value = getattr(plan, one.name)
        if type(value) not in _CONSTANT and one.name != "properties":
            object.__setattr__(copied, one.name, value.copy() if isinstance(value, np.ndarray) else deepcopy(value))
    return copied


def _content(plan: Plan) -> tuple[Any, ...]:
    """Return the fields of a plan that count, by value."""
    values = _AREA_FIELDS(plan) if isinstance(plan, Area) else _TRACK_FIELDS(plan)
    return type(plan), *(one if type(one) in _CONSTANT else _value(one) for one in values)


# Types of values that cannot change; most fields have one of them.
_CONSTANT: Final = {type(None), str, float, int, shapely.MultiPolygon}


def _value(given: Any) -> Any:
    if isinstance(given, np.ndarray):
        return given.tobytes(), given.shape
    return deepcopy(dict(given)) if isinstance(given, Mapping) else given
