"""Refuse unknown names that resemble known ones: a misspelt member would be ignored, and conflicts missed.

One rule for members of scene files, columns of positions and columns of OGR files. An unknown name resembles a known
one in three cases. It is equal apart from case, separators, the unit and words such as "time" or "height" (`START`,
`floorM`, `floor_ft`, `start_time`). It is one of `SYNONYMS` (`begin`). Or it is within edit distance 1 (letters
inserted, deleted, replaced or swapped) for names of five letters or more, 2 for nine or more (`grow_mp`). It is refused
if its value has the known member's type and the object lacks that member. All other names are kept.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final

from conflictdb.errors import InvalidInput
from conflictdb.model.settings import NUMBERS

# Words at either end of a name that only qualify it: unit, datum, kind.
_QUALIFIER: Final = re.compile(
    "m|met(re|er)s?|ft|feet|foot|fl|km|nmi?|mi|miles?|kn|kts?|knots?|mps|ms|km?ph|kmh|mph|s|per|us"
    "|a?msl|a[sg]l|wgs|time|date|datetime|timestamp|utc|at|height|altitude|alt|level"
)
SYNONYMS: Final = {
    "begin": "start",
    "begins": "start",
    "beginning": "start",
    "finish": "end",
    "ends": "end",
    "until": "end",
    "growth": "grow",
    "growing": "grow",
    "property": "properties",
    "props": "properties",
    "attributes": "properties",
}
# Settings of a scene that a feature or column must not seem to set. `motion`, `earth`, `centre` and `method` are common
# words, which objects may use freely.
SETTINGS: Final = NUMBERS
SETTING_RULE: Final = 'is a setting of the whole scene: put it into the member "scene" of a scene file'
RENAME_MEMBER: Final = 'Rename or map it, or name it in the file\'s member "foreign" if it means nothing here'
RENAME_COLUMN: Final = "Rename the column"
_INSTANTS: Final = frozenset({"start", "end", "times", "datetimes"})
# Members that take numbers, or lists of them; members that are neither instants nor numbers accept any value.
_NUMBERS: Final = re.compile(".*_(m|nmi|mps|kn|s)|lon|lat")
_WORD: Final = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
# Longest name compared, in characters: longer ones cost time and memory.
_LONGEST: Final = 200
# Squashed names shorter than these must match exactly, or within one edit.
_ONE_SLIP: Final = 5
_TWO_SLIPS: Final = 9
_TOO_MANY: Final = 3


def misnamed(
    who: str,
    values: Mapping[str, Any],
    known: tuple[str, ...],
    elsewhere: Mapping[str, str] = MappingProxyType({}),
    foreign: Collection[str] = (),
    remedy: str = RENAME_MEMBER,
) -> Iterator[InvalidInput]:
    """Yield a refusal of each member that resembles an absent known one, or that belongs elsewhere.

    values : the members
    known : known names; members with these names are not checked
    elsewhere : names with a meaning at another place, and the rule to report
    foreign : names that the file declares meaningless here
    """
    meanings = (*known, *SETTINGS)
    for name, value in values.items():
        if name in known or name in foreign or value is None:
            continue
        rule = elsewhere.get(name) or elsewhere.get(name.lower())
        if rule is not None:
            yield InvalidInput(who, name, rule)
            continue
        meant = look_alike(name, meanings)
        if meant is None or not can_be(value, meant) or _is_given(meant, values, known):
            continue
        if meant in SETTINGS:
            yield InvalidInput(who, name, f"{SETTING_RULE} ({meant})")
        else:
            yield InvalidInput(who, name, f"is not known; did you mean {meant}? {remedy}")


def look_alike(name: str, known: tuple[str, ...]) -> str | None:
    """Return the known name that an unknown one resembles, None if there is none."""
    return _look_alike(name, known) if len(name) <= _LONGEST else None


@lru_cache(maxsize=4096)
def _look_alike(name: str, known: tuple[str, ...]) -> str | None:
    squashed, stem = _squash(name), stem_of(name)
    if not stem:
        return None
    meant = SYNONYMS.get(stem)
    best, least = None, _TOO_MANY
    for other, other_squashed, other_stem in _forms(known):
        slips = 0
        if other_stem not in (stem, meant):
            slips = min(_slips(squashed, other_squashed), _slips(stem, other_stem))
        if slips < least:
            best, least = other, slips
    return best


def can_be(value: Any, meant: str) -> bool:
    """Return whether a value has the type of a known member: an instant, or a number or list of numbers."""
    if value is None or isinstance(value, bool) or value == "":
        return False
    if meant not in _INSTANTS and not _NUMBERS.fullmatch(meant):
        return True
    if isinstance(value, str):
        return re.match(r".*\d" if meant in _INSTANTS else r"\s*[+-]?\.?\d", value) is not None
    return isinstance(value, int | float | list)


def _is_given(meant: str, values: Mapping[str, Any], known: Collection[str]) -> bool:
    """Return whether the meant member is present: in any unit, or as times in place of start and speed."""
    stem = stem_of(meant)
    if stem in ("start", "speed", "times", "datetimes") and any(values.get(name) for name in ("times", "datetimes")):
        return True
    return any(values.get(name) is not None and stem_of(name) == stem for name in known)


@lru_cache(maxsize=4096)
def stem_of(name: str) -> str:
    """Return a name in lower case without unit and qualifiers: ``floor`` for `floor_m` and `FloorHeight_ft`."""
    words = [word.lower() for word in _WORD.findall(name)]
    while len(words) > 1 and _QUALIFIER.fullmatch(words[-1]):
        words.pop()
    first = 0
    while first < len(words) - 1 and _QUALIFIER.fullmatch(words[first]):
        first += 1
    return "".join(words[first:])


@lru_cache(maxsize=4096)
def _squash(name: str) -> str:
    return "".join(_WORD.findall(name)).lower()


@lru_cache(maxsize=256)
def _forms(known: tuple[str, ...]) -> list[tuple[str, str, str]]:
    """Return known names, each with its letters and its stem."""
    return [(name, _squash(name), stem_of(name)) for name in known]


@lru_cache(maxsize=4096)
def _letters(name: str) -> frozenset[str]:
    return frozenset(name)


def _slips(one: str, other: str) -> int:
    """Return the edit distance (optimal string alignment), _TOO_MANY above the limit for names of this length."""
    # An edit changes the length by at most one and the set of letters by at most two: most names differ by more.
    longer = len(one) - (length := len(other))
    if longer > 2 or longer < -2:
        return _TOO_MANY
    most = 0 if length < _ONE_SLIP else 1 if length < _TWO_SLIPS else 2
    if longer > most or -longer > most or len(_letters(one) ^ _letters(other)) > 2 * most:
        return _TOO_MANY
    before: list[int] = []
    row = list(range(len(other) + 1))
    for i, letter in enumerate(one, 1):
        before_last, before = before, row
        row = [i]
        for j, expected in enumerate(other, 1):
            cost = min(before[j] + 1, row[j - 1] + 1, before[j - 1] + (letter != expected))
            if i > 1 and j > 1 and letter == other[j - 2] and one[i - 2] == expected:
                cost = min(cost, before_last[j - 2] + 1)
            row.append(cost)
    return row[-1] if row[-1] <= most else _TOO_MANY
