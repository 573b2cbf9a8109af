"""Separation rules: how far apart the objects of two classes must be, and who yields.

`rule_table.RuleTable.of` picks the most specific rule of a pair and refuses ties; in SQL `_rule_between` does
(sql/12_rules.sql).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from conflictdb.errors import InvalidInput
from conflictdb.model.settings import SETTINGS, checked

# Words for all areas and all tracks in separation rules.
KINDS: Final = ("area", "track")
# Longest class or owner, which every piece stores.
MAX_WORD_BYTES: Final = 200
# Rules of a scene; each class in them adds two rows and columns to the table of all pairs.
MAX_RULES: Final = 1_000
RANK_OF_CLASS_AND_KIND: Final = 4
# The settings that a rule replaces, by its own names.
REPLACED: Final = {
    "separation_m": "separation_m",
    "vertical_m": "vertical_separation_m",
    "time_s": "time_separation_s",
}
_SETTING: Final = {setting.name: setting for setting in SETTINGS}


@dataclass(frozen=True, slots=True)
class Rule:
    """A separation rule for the pairs of two classes, in either order.

    Of several rules for a pair the most specific applies: first those with two classes, then those with a class and
    `area` or `track`, a class and any, two kinds, a kind and any. Distances are of the pair, the same from both sides.
    Two rules of a class with `area` both apply to two areas: the larger distances and time count.

    a_class, b_class : a class; `area` or `track` for all objects of that kind; None for any object
    separation_m, vertical_m, time_s : in place of the scene's `separation_m`, `vertical_separation_m` and
        `time_separation_s`; None: as in the scene
    allowed : the pairs are not compared
    yields : `a` or `b`: which side yields; None: not said
    """

    a_class: str | None
    b_class: str | None
    separation_m: float | None = None
    vertical_m: float | None = None
    time_s: float | None = None
    allowed: bool = False
    yields: str | None = None

    def __post_init__(self) -> None:
        who = str(self)
        for field in ("a_class", "b_class"):
            value = getattr(self, field)
            if value not in KINDS:
                check_class(who, field, value)
        if self.a_class is None and self.b_class is None:
            raise InvalidInput(who, "a_class", "must name a class: the scene's settings are the rule for any with any")
        if not isinstance(self.allowed, bool):
            raise InvalidInput(who, "allowed", f"must be true or false; got {self.allowed!r:.60}")
        for name, setting in REPLACED.items():
            if getattr(self, name) is not None:
                object.__setattr__(self, name, checked(who, _SETTING[setting], getattr(self, name), name))
        if self.yields not in (None, "a", "b"):
            raise InvalidInput(who, "yields", f"must be 'a', 'b' or absent; got {self.yields!r:.60}")
        if self.yields is not None and self.a_class == self.b_class:
            raise InvalidInput(who, "yields", "needs two different sides, to say which of them yields")
        said = [name for name in (*REPLACED, "yields") if getattr(self, name) is not None]
        if self.allowed and said:
            raise InvalidInput(who, said[0], "has no meaning where pairs are allowed, and not compared: leave it out")

    def __str__(self) -> str:
        return f"rule {self.a_class or 'any'!r} with {self.b_class or 'any'!r}"

    @property
    def sides(self) -> tuple[str, str]:
        """The two sides in order, empty for any."""
        a, b = sorted((self.a_class or "", self.b_class or ""))
        return a, b

    @property
    def rank(self) -> int:
        """How specific it is: 6 for two classes, then 4, 3, 2 and 1."""
        return sum(0 if side is None else 1 if side in KINDS else 3 for side in (self.a_class, self.b_class))

    @property
    def says(self) -> tuple[Any, ...] | None:
        """What it says of all its pairs, to be compared; None if it says who yields."""
        return None if self.yields is not None else tuple(getattr(self, name) for name in (*REPLACED, "allowed"))


def listed(rules: Iterable[Rule]) -> list[Rule]:
    """Return rules in the order of their sides; raises InvalidInput for others, too many, or sides given twice."""
    if not isinstance(rules, Iterable):
        raise InvalidInput("rules", "", f"must be a list of Rule; got {rules!r:.60}")
    found = list(rules)
    check_count(len(found))
    known = set()
    for i, rule in enumerate(found):
        if not isinstance(rule, Rule):
            raise InvalidInput("rules", f"rules[{i}]", f"must be a Rule; got {rule!r:.60}")
        if rule.sides in known:
            raise InvalidInput(str(rule), "", "is given twice; a rule holds in both orders of its sides")
        known.add(rule.sides)
    return sorted(found, key=lambda rule: rule.sides)


def check_count(count: int) -> None:
    """Raise InvalidInput for more rules than a scene may have, before each is read."""
    if count > MAX_RULES:
        raise InvalidInput("rules", "", f"must be at most {MAX_RULES:,}; got {count:,}")


def rule_of(members: Any, where: str) -> Rule:
    """Return a rule from the members of a file or a row; raises InvalidInput for unknown ones."""
    known = list(Rule.__dataclass_fields__)
    if not isinstance(members, dict):
        raise InvalidInput(where, "", f"must be an object with {', '.join(known)}; got {members!r:.60}")
    for name in members:
        if name not in known:
            raise InvalidInput(where, str(name), f"is not known; known are {', '.join(known)}")
    return Rule(**{"a_class": None, "b_class": None, **members})


def members_of(rule: Rule) -> dict[str, Any]:
    """Return the members of a rule as files store them, without those that say nothing."""
    found = {name: getattr(rule, name) for name in Rule.__dataclass_fields__}
    return {name: value for name, value in found.items() if value is not None and value is not False}


def check_class(who: str, field: str, value: Any) -> None:
    """Raise InvalidInput unless a value is None or the name of a class."""
    _check(who, field, None if value is None else class_rule(value))


def check_word(who: str, field: str, value: Any) -> None:
    """Raise InvalidInput unless a value is None or may name a class or an owner."""
    _check(who, field, None if value is None else word_rule(value))


def class_rule(value: Any) -> str | None:
    """Return the rule that a value breaks as the name of a class; None: valid."""
    if word_rule(value) is None and value in KINDS:
        return f"must not be {value!r}, which separation rules use for all {value}s: choose another name"
    return word_rule(value)


def word_rule(value: Any) -> str | None:
    """Return the rule that a value breaks as the name of a class or an owner; None: valid."""
    if isinstance(value, str) and 0 < len(value.encode(errors="replace")) <= MAX_WORD_BYTES:
        has_surrogate = value.encode(errors="ignore").decode() != value
        return "contains half of a surrogate pair, no character" if has_surrogate else None
    return f"must be a text of 1 to {MAX_WORD_BYTES} bytes, or absent; got {value!r:.60}"


def _check(who: str, field: str, rule: str | None) -> None:
    if rule is not None:
        raise InvalidInput(who, field, rule)
