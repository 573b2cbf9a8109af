"""Required separations of the pairs of a scene: one value made once per run, the only reader of its rules in a run.

Pairs that share required separations are solved together, with settings that have these and no rules.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.arrays import Floats
from conflictdb.arrays.column_numbers import numbers_of_words
from conflictdb.arrays.pieces import HEIGHT_ROUNDING_M, PieceRows, Pieces
from conflictdb.core.stage1_broad_phase import pairs_together
from conflictdb.model.plans import Area, Intervals, Scene, Track
from conflictdb.model.results import Kind
from conflictdb.model.rule_table import RuleTable
from conflictdb.model.rules import REPLACED

_Ints = NDArray[Any]

_MOST_ROUNDED_M: Final = 1e6
NEVER: Final = -1  # in place of settings: the pair is not compared


@dataclass(frozen=True, slots=True)
class Separations:
    """The settings of each pair of objects, by their types (`RuleTable`).

    settings : distinct, without rules
    of_types : (t, t) int64, the settings of two types; NEVER
    vertical_m : (t,) float64, the largest vertical separation that objects of a type can need
    numbers, number_type : (c,) int64, the numbers of classes that rules name, sorted, and the types of areas of each
    """

    settings: Sequence[Scene]
    of_types: NDArray[np.int64]
    vertical_m: Floats
    numbers: NDArray[np.int64]
    number_type: NDArray[np.int64]

    @classmethod
    def of(cls, scene: Scene) -> "Separations":
        """Return the separations of a scene."""
        if not scene.rules:
            height_m = np.full(2, scene.vertical_separation_m)
            return cls([scene], np.zeros((2, 2), np.int64), height_m, np.empty(0, np.int64), np.empty(0, np.int64))
        table = RuleTable.of(scene.rules)
        plain = replace(scene, rules=())
        found = {plain: 0}
        # The last one is of the pairs without a rule.
        of_rules = np.zeros(len(table.rules) + 1, np.int64)
        of_values: dict[tuple[Any, ...], int] = {}
        for i, rule in enumerate(table.rules):
            if rule.allowed:
                of_rules[i] = NEVER
                continue
            given = {name: getattr(rule, own) for own, name in REPLACED.items() if getattr(rule, own) is not None}
            values = tuple(given.items())
            if values not in of_values:
                of_values[values] = found.setdefault(replace(plain, **given), len(found))
            of_rules[i] = of_values[values]
        of_types = of_rules[table.rule]
        both = np.argwhere(table.second >= 0)
        given_two = np.column_stack((of_types[tuple(both.T)], of_rules[table.second[tuple(both.T)]]))
        distinct, place = np.unique(given_two, axis=0, return_inverse=True)
        of_two, single = np.full(len(distinct), NEVER), list(found)
        for i, pair in enumerate(distinct.tolist()):
            one = [single[k] for k in pair if k != NEVER]
            if one:
                larger = {name: max(getattr(settings, name) for settings in one) for name in REPLACED.values()}
                of_two[i] = found.setdefault(replace(plain, **larger), len(found))
        of_types[tuple(both.T)] = of_two[place.ravel()]
        numbers = numbers_of_words(table.classes)
        order = np.argsort(numbers)
        settings = list(found)
        height_m = np.array([one.vertical_separation_m for one in settings])
        vertical_m = np.where(of_types == NEVER, 0.0, height_m[of_types]).max(axis=1)
        vertical_m[(of_types == NEVER).all(axis=1)] = height_m[0]
        return cls(settings, of_types, vertical_m, numbers[order], (2 * (order + 1)).astype(np.int64))

    def of_two(self, a: Area | Track, b: Area | Track) -> Scene | None:
        """Return the settings of two objects of different owners; None if they are not compared."""
        both = a, b
        kinds = [np.array([(Kind.AREA if isinstance(one, Area) else Kind.TRACK).code], np.int8) for one in both]
        numbers = [numbers_of_words([one.object_class]) for one in both]
        found = int(self.of_pairs(kinds, numbers)[0])
        return None if found == NEVER else self.settings[found]

    def types(self, kind: _Ints, class_number: _Ints) -> NDArray[np.int64]:
        """Return the types of objects (n,), by their kinds and the numbers of their classes."""
        if not len(self.numbers):
            return kind.astype(np.int64)
        at = np.minimum(np.searchsorted(self.numbers, class_number), len(self.numbers) - 1)
        return np.asarray(np.where(self.numbers[at] == class_number, self.number_type[at], 0) + kind, np.int64)

    def of_pairs(self, kinds: Sequence[_Ints], classes: Sequence[_Ints]) -> NDArray[np.int64]:
        """Return the settings (n,) of pairs of objects of different owners, NEVER for pairs that are not compared.

        kinds, classes : (2, n) of both objects; numbers of classes, 0 without
        """
        one, other = (self.types(kind, number) for kind, number in zip(kinds, classes, strict=True))
        return self.of_types[one, other]

    def padding(self, type_: int) -> Scene:
        """Return settings whose distances are the largest that objects of a type can need."""
        able = [self.settings[i] for i in np.unique(self.of_types[type_]).tolist() if i != NEVER]
        if not able:
            return self.settings[0]
        return replace(
            self.settings[0],
            separation_m=max(one.separation_m for one in able),
            vertical_separation_m=float(self.vertical_m[type_]),
        )

    def split(self, pieces: Pieces, a: PieceRows, b: PieceRows) -> Iterator[tuple[Scene, Pieces, PieceRows, PieceRows]]:
        """Yield settings, pieces as these ask for, and the pairs of pieces that have them; at least once.

        Pairs that are not compared, and pairs further apart in time or height than their own settings ask for, are left
        out.
        """
        if (self.of_types == 0).all() and not pieces.excuses:
            yield self.settings[0], pieces, a, b
            return
        found = self._of_pieces(pieces, a, b)
        for i in np.unique(found[found >= 0]).tolist() or [0]:
            settings, rows = self.settings[i], np.flatnonzero(found == i)
            # Only the pieces of these pairs: the work of all settings together is that of one for all pairs.
            is_used = np.zeros(len(pieces), np.bool_)
            is_used[a[rows]] = is_used[b[rows]] = True
            place = np.cumsum(is_used) - 1
            one, other = PieceRows(place[a[rows]]), PieceRows(place[b[rows]])
            own = self.of_settings(settings, pieces.take(np.flatnonzero(is_used)))
            yield settings, own, *pairs_together(own, one, other, settings.time_separation_us)

    def have(self, settings: Scene) -> NDArray[np.bool_]:
        """Return (t, t) whether objects of two types have some settings."""
        return self.of_types == list(self.settings).index(settings)

    def of_settings(self, settings: Scene, pieces: Pieces) -> Pieces:
        """Return pieces whose heights are further out by half of one vertical separation, not of their largest."""
        spare_m = self.vertical_m[self.types(pieces.kind, pieces.class_number)] - settings.vertical_separation_m
        if not spare_m.any():
            return pieces
        own = with_margin(pieces, -0.5 * spare_m)
        return own if settings.intervals == Intervals.HALF_OPEN else with_closed_heights(own)

    def _of_pieces(self, pieces: Pieces, a: PieceRows, b: PieceRows) -> NDArray[np.int64]:
        columns = ((column[a], column[b]) for column in (pieces.kind, pieces.class_number))
        return self.of_pairs(*columns)


def with_margin(pieces: Pieces, margin_m: Floats | float) -> Pieces:
    """Return pieces whose heights reach `margin_m` further, a scalar or one for each piece; no band becomes empty."""
    outward_m = np.multiply.outer(margin_m, [-1.0, -1.0, 1.0, 1.0])
    floor_m, ceiling_m = _band(pieces.floor_m - margin_m, pieces.ceiling_m + margin_m)
    climb_m = pieces.climb_m + outward_m
    return replace(
        pieces, floor_m=floor_m, ceiling_m=ceiling_m, climb_m=np.hstack(_band(climb_m[:, :2], climb_m[:, 2:]))
    )


def _band(floor_m: Floats, ceiling_m: Floats) -> tuple[Floats, Floats]:
    """Return floors and ceilings rounded; a band thinner than the rounding keeps one number."""
    low_m, high_m = _to_nanometres(floor_m), _to_nanometres(ceiling_m)
    return low_m, np.maximum(high_m, np.nextafter(low_m, np.inf))


def _to_nanometres(height_m: Floats) -> Floats:
    """Return heights rounded; from _MOST_ROUNDED_M on they are too coarse."""
    return np.where(
        np.abs(height_m) < _MOST_ROUNDED_M, np.round(np.clip(height_m, -_MOST_ROUNDED_M, _MOST_ROUNDED_M), 9), height_m
    )


def with_closed_heights(pieces: Pieces) -> Pieces:
    """Return pieces with ceilings up to the next number, so that half-open bands that share a closed end overlap."""
    climb_m = pieces.climb_m.copy()
    climb_m[:, 2:] = np.nextafter(climb_m[:, 2:], np.inf)
    # Beyond the rounding of heights on the way.
    climb_m[pieces.climbs()] += HEIGHT_ROUNDING_M * np.array([-1.0, -1.0, 1.0, 1.0])
    return replace(pieces, ceiling_m=np.nextafter(pieces.ceiling_m, np.inf), climb_m=climb_m)
