"""Values of many plans or of one, and the plans that break a rule.

A rule of plans is an expression of `Many`: arrays of n plans, and arrays of all their places. `One` has the same
members for one plan, with numbers and truth values in place of arrays of one.
"""

from collections.abc import Callable
from functools import cached_property, lru_cache
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput

Offsets: TypeAlias = NDArray[np.int64]
# (n,) of n plans, or a truth value of one.
Flags: TypeAlias = Any
# (n,) of n plans, or a number of one.
Numbers: TypeAlias = Any
# Returns the field of a plan and the sentence of the rule that it breaks.
Say: TypeAlias = Callable[[int], tuple[str, str]]

_ALL: Final = slice(None)


class Many:
    """The places of n plans, such as waypoints or corners: plan i has those from offset[i] to offset[i + 1].

    count : (n,) how many each has. Values of places are (w,) or (w, k).
    """

    def __init__(self, offset: Offsets) -> None:
        self.offset = offset
        self.count = offset[1:] - offset[:-1]

    @classmethod
    def of(cls, count: NDArray[np.int64]) -> "Many":
        """Return the places of n plans; count : (n,) how many each has."""
        offset = np.zeros(len(count) + 1, np.int64)
        np.add.accumulate(count, out=offset[1:])
        return cls(offset)

    @classmethod
    def even(cls, n: int, count: int) -> "Many":
        """Return the places of n plans that have equally many."""
        return _few_even(n, count) if n * count <= _FEW else cls.of(np.full(n, count))

    @classmethod
    def each(cls, n: int) -> "Many":
        """Return one place for each of n plans."""
        return cls(np.arange(n + 1))

    def broken(self) -> "BrokenMany":
        """Return that no plan breaks a rule."""
        return BrokenMany(len(self.count))

    def places(self, row: int) -> slice:
        """Return the places of a plan."""
        return slice(int(self.offset[row]), int(self.offset[row + 1]))

    def any(self, flags: NDArray[np.bool_]) -> Flags:
        """Return whether any place of a plan has the flag: (w,), or (w, k) with one of them."""
        rows = np.zeros(len(self.count), np.bool_)
        if np.count_nonzero(flags):
            places = np.flatnonzero(flags if flags.ndim == 1 else flags.any(axis=1))
            rows[np.searchsorted(self.offset, places, side="right") - 1] = True
        return rows

    def each_next(
        self, compare: np.ufunc, values: NDArray[Any], earlier: NDArray[Any] | None = None
    ) -> NDArray[np.bool_]:
        """Return (w,) comparisons of the next value of the plan with each, or with `earlier`; false for the last."""
        found = np.zeros(len(values), np.bool_)
        compare(values[1:], (values if earlier is None else earlier)[:-1], out=found[:-1])
        # The first of a plan follows another plan.
        found[self.offset[1:][self.count > 0] - 1] = False
        return found

    @cached_property
    def _has_all(self) -> bool:
        """Whether no plan is without places."""
        return bool(np.count_nonzero(self.count) == len(self.count))

    @cached_property
    def _next(self) -> Offsets:
        following = np.arange(1, self.offset[-1] + 1)
        first, end = self.offset[:-1], self.offset[1:]
        if not self._has_all:
            first, end = first[self.count > 0], end[self.count > 0]
        following[end - 1] = first
        return following

    def following(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the next value of the same plan for each; the first for the last."""
        return values[self._next]

    def least(self, values: NDArray[Any], empty: float = 0) -> Numbers:
        """Return the least value of each plan; `empty` for one without places."""
        return self._reduced(np.minimum, values if values.ndim == 1 else np.minimum.reduce(values, axis=1), empty)

    def most(self, values: NDArray[Any], empty: float = 0) -> Numbers:
        """Return the largest value of each plan; `empty` for one without places."""
        return self._reduced(np.maximum, values if values.ndim == 1 else np.maximum.reduce(values, axis=1), empty)

    def total(self, flags: NDArray[np.bool_]) -> Numbers:
        """Return how many places of each plan have the flag."""
        return self._reduced(np.add, flags.astype(np.int64), 0)

    def _reduced(self, by: np.ufunc, values: NDArray[Any], empty: float) -> Numbers:
        if self._has_all:
            return by.reduceat(values, self.offset[:-1]) if len(self.count) else values
        is_some = self.count > 0
        found = np.full(len(is_some), empty, values.dtype)
        if len(values):
            found[is_some] = by.reduceat(values, self.offset[:-1][is_some])
        return found

    def spread(self, numbers: Numbers) -> NDArray[Any]:
        """Return the number of its plan for each place."""
        return np.repeat(numbers, self.count)

    def where(self, rows: Flags, rule: "Callable[[NDArray[Any], Rows], Flags]", values: NDArray[Any]) -> Flags:
        """Return whether plans break a rule of places: of some plans; the others do not."""
        if np.count_nonzero(rows) == len(rows):
            return rule(values, self) if len(rows) else rows
        found = np.zeros(len(rows), np.bool_)
        if np.count_nonzero(rows):
            found[rows] = rule(values[np.repeat(rows, self.count)], Many.of(self.count[rows]))
        return found


# Nobody changes places: they are computed once for plans of the same form.
_FEW: Final = 1024


@lru_cache(maxsize=64)
def _few_even(n: int, count: int) -> Many:
    return Many.of(np.full(n, count))


class One:
    """The places of one plan, all of them."""

    __slots__ = ("count",)

    def __init__(self, count: int) -> None:
        self.count = count

    @property
    def offset(self) -> Offsets:
        """(2,) place of the first, and number of places."""
        return np.array([0, self.count])

    def broken(self) -> "BrokenOne":
        """Return that the plan breaks no rule."""
        return BrokenOne()

    def places(self, row: int) -> slice:
        """Return all places."""
        return _ALL

    def any(self, flags: NDArray[np.bool_]) -> Flags:
        """Return whether any place has the flag."""
        return np.count_nonzero(flags) > 0

    def each_next(
        self, compare: np.ufunc, values: NDArray[Any], earlier: NDArray[Any] | None = None
    ) -> NDArray[np.bool_]:
        """Return comparisons of the next value with each but the last, or with `earlier`."""
        return np.asarray(compare(values[1:], (values if earlier is None else earlier)[:-1]))

    def following(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the next value for each; the first for the last."""
        return np.concatenate((values[1:], values[:1]))

    def least(self, values: NDArray[Any], empty: float = 0) -> Numbers:
        """Return the least value; `empty` without places."""
        return np.minimum.reduce(values, axis=None) if self.count else empty

    def most(self, values: NDArray[Any], empty: float = 0) -> Numbers:
        """Return the largest value; `empty` without places."""
        return np.maximum.reduce(values, axis=None) if self.count else empty

    def total(self, flags: NDArray[np.bool_]) -> Numbers:
        """Return how many places have the flag."""
        return np.count_nonzero(flags)

    def spread(self, numbers: Numbers) -> Numbers:
        """Return the number, which is that of each place."""
        return numbers

    def where(self, rows: Flags, rule: "Callable[[NDArray[Any], Rows], Flags]", values: NDArray[Any]) -> Flags:
        """Return whether the plan breaks a rule of places, if it is one of those."""
        return rule(values, self) if rows else False


class BrokenMany:
    """Which of n plans break a group of rules, and of each the first rule that it breaks.

    is_sound : (n,) whether a plan breaks none
    """

    def __init__(self, n: int) -> None:
        self.is_sound: NDArray[np.bool_] = np.ones(n, np.bool_)
        self._said: dict[int, tuple[str, str]] = {}

    def add(self, is_broken: Flags, say: Say) -> None:
        """Add a rule, which some plans (n,) break."""
        if np.count_nonzero(is_broken):
            broken = is_broken & self.is_sound
            self.is_sound &= ~broken
            for row in np.flatnonzero(broken).tolist():
                self._said[row] = say(row)

    def said(self, row: int) -> tuple[str, str]:
        """Return the field and the sentence of the rule that a plan breaks."""
        return self._said[row]

    def raise_for(self, row: int, who: str) -> None:
        """Raise the InvalidInput for a plan that breaks a rule."""
        if row in self._said:
            raise InvalidInput(who, *self._said[row])


class BrokenOne:
    """The first rule of a group that one plan breaks."""

    __slots__ = ("_said", "is_sound")

    def __init__(self) -> None:
        self.is_sound = True
        self._said: tuple[str, str] | None = None

    def add(self, is_broken: Flags, say: Say) -> None:
        """Add a rule, which the plan may break."""
        if is_broken and self.is_sound:
            self.is_sound, self._said = False, say(0)

    def said(self, _: int) -> tuple[str, str]:
        """Return the field and the sentence of the rule that the plan breaks."""
        assert self._said is not None  # noqa: S101
        return self._said

    def raise_for(self, _: int, who: str) -> None:
        """Raise the InvalidInput if the plan breaks a rule."""
        if self._said is not None:
            raise InvalidInput(who, *self._said)


Rows: TypeAlias = Many | One
Broken: TypeAlias = BrokenMany | BrokenOne


def rows_of(count: Numbers) -> Rows:
    """Return the places of n plans, or of one; count : (n,) how many each has, or how many the one has."""
    return Many.of(count) if isinstance(count, np.ndarray) else One(int(count))


def first_of(flags: NDArray[np.bool_], rows: Rows, row: int) -> int:
    """Return the number, within a plan, of its first place with the flag (w,)."""
    return int(np.flatnonzero(flags[rows.places(row)])[0])


def item(values: Numbers, row: int) -> Any:
    """Return the value of a plan."""
    return values[row] if isinstance(values, np.ndarray) else values
