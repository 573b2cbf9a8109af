"""The separation rule of each pair of classes, as arrays."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from conflictdb.errors import InvalidInput
from conflictdb.model.rules import KINDS, RANK_OF_CLASS_AND_KIND, Rule, listed


@dataclass(frozen=True, slots=True)
class RuleTable:
    """The rule of each pair of types of objects.

    A type is a kind and a class that a rule names, or a kind and any other class. Type 2 i + k is of kind k and of
    class i, counted from 1 in the order of `classes`; class 0 is any other.

    rules : checked
    classes : names of classes, in order
    rule : (t, t) int16, number of the rule for two types, symmetric; -1: the scene's settings
    second : (t, t) int16, number of another rule that applies as well, -1: none; of two areas only
    """

    rules: Sequence[Rule]
    classes: Sequence[str]
    rule: NDArray[np.int16]
    second: NDArray[np.int16]

    @classmethod
    def of(cls, rules: Iterable[Rule]) -> "RuleTable":
        """Return the table of some rules; raises InvalidInput if two rules are as specific for a possible pair."""
        rules = listed(rules)
        named = {side for rule in rules for side in rule.sides if side and side not in KINDS}
        classes = sorted(named)
        place = {name: i + 1 for i, name in enumerate(classes)}
        n = 2 * (len(classes) + 1)
        # A thousand rules may name two thousand classes: small numbers, or half a gigabyte.
        chosen, rank = np.full((n, n), -1, np.int16), np.zeros((n, n), np.int8)
        rival = np.full((n, n), -1, np.int16)
        # Rules that say the same have one number; those that say who yields have one each.
        said: dict[Any, int] = {}
        says = np.array([said.setdefault(rule.says or i, len(said)) for i, rule in enumerate(rules)], np.int64)
        areas = np.arange(n) % 2 == KINDS.index("area")

        def types(side: str | None) -> NDArray[np.int64]:
            if side is None:
                return np.arange(n)
            return np.arange(KINDS.index(side), n, 2) if side in KINDS else 2 * place[side] + np.arange(2)

        for number, rule in enumerate(rules):
            # Only pairs of its two sides are read: a thousand rules have millions of pairs of types.
            a, b = types(rule.a_class), types(rule.b_class)
            block, mirrored = (a[:, None], b), (b[:, None], a)
            own_chosen, own_rank, own_rival = chosen[block], rank[block], rival[block]
            tied, better = own_rank == rule.rank, own_rank < rule.rank
            if tied.any():
                own_rival[tied & (says[own_chosen] != says[number])] = number
            own_chosen[better], own_rank[better], own_rival[better] = number, rule.rank, -1
            for of_all, own in ((chosen, own_chosen), (rank, own_rank), (rival, own_rival)):
                of_all[block], of_all[mirrored] = own, own.T
        # The classes of two rules with areas are those of tracks, usually; areas have to keep the distances of both.
        is_second = np.outer(areas, areas) & (rank == RANK_OF_CLASS_AND_KIND)
        second = np.where(is_second, rival, -1)
        ties = np.argwhere((rival >= 0) & ~is_second)
        if len(ties):
            one, other = ties[0].tolist()
            sides = [cls._word(classes, type_) for type_ in (one, other)]
            first, last = (side.split()[-1].strip("'") for side in sides)
            raise InvalidInput(
                str(rules[chosen[one, other]]),
                "",
                f"and {rules[rival[one, other]]} apply alike to a pair of {sides[0]} and {sides[1]}: "
                f"enter a rule for {first!r} with {last!r} first",
            )
        return cls(rules, classes, chosen, second)

    def does_yield(self, own_class: str | None, track_class: str | None, kind: str = "track") -> bool:
        """Return whether an object of a class and kind yields to a track; no rule says that of two alike."""
        number = int(self.rule[self._type(kind, own_class), self._type("track", track_class)])
        if number < 0 or self.rules[number].yields is None:
            return False
        rule = self.rules[number]
        straight, turned = (
            a in (None, kind, own_class) and b in (None, "track", track_class)
            for a, b in ((rule.a_class, rule.b_class), (rule.b_class, rule.a_class))
        )
        return straight != turned and rule.yields == ("a" if straight else "b")

    def _type(self, kind: str, object_class: str | None) -> int:
        number = self.classes.index(object_class) + 1 if object_class in self.classes else 0
        return 2 * number + KINDS.index(kind)

    @staticmethod
    def _word(classes: Sequence[str], type_: int) -> str:
        kind = KINDS[type_ % 2]
        return f"{kind} of class {classes[type_ // 2 - 1]!r}" if type_ > 1 else f"any {kind}"
