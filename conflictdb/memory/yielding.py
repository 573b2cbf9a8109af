"""Priority levels of tracks, from those that a caller gives and from separation rules that say who yields."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from conflictdb.memory.program import Program
from conflictdb.model.plans import Area, Track
from conflictdb.model.rule_table import RuleTable
from conflictdb.model.rules import Rule

_Ints = NDArray[np.int64]


def levels_of(
    program: Program, given: _Ints, classes: Sequence[str | None], kinds: Sequence[str], rules: Sequence[Rule]
) -> _Ints:
    """Return priority levels (n,) in which each plan is below the tracks that it yields to.

    Given levels come first: rules order the tracks of one level. Tracks that yield to each other in a circle share a
    level, and so do all tracks that yield to none.

    given : (n,) levels
    classes, kinds : n classes, and ``area`` or ``track``
    """
    given = np.unique(given, return_inverse=True)[1].astype(np.int64)
    edges = _yielding(program, given, classes, kinds, rules)
    if not len(edges):
        return given
    shape = (len(program), len(program))
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=shape)
    count, circle = connected_components(graph, directed=True, connection="strong")
    between = np.unique(circle[edges], axis=0)
    between = between[between[:, 0] != between[:, 1]]
    below = np.zeros(count, np.int64)
    while True:
        deeper = below.copy()
        np.maximum.at(deeper, between[:, 0], below[between[:, 1]] + 1)
        if (deeper == below).all():
            break
        below = deeper
    return given * count - below[circle]


def yielding_areas(
    pairs: Iterable[tuple[str, str]], tracks: Mapping[str, Track], areas: Mapping[str, Area], rules: Sequence[Rule]
) -> list[str]:
    """Return a sentence for each area that yields by a rule to tracks in conflict with it, by key."""
    if not any(rule.yields for rule in rules):
        return []
    table = RuleTable.of(rules)
    found: dict[str, list[str]] = {}
    for pair in pairs:
        for key, other in (pair, pair[::-1]):
            if key in areas and other in tracks:
                sides = areas[key].object_class, tracks[other].object_class
                if table.does_yield(*sides, kind="area"):
                    found.setdefault(key, []).append(other)
    names = {key: ", ".join(map(repr, sorted(others, key=str.encode))) for key, others in found.items()}
    return [
        f"area {key!r} yields to {names[key]} by a rule, but areas do not move" for key in sorted(names, key=str.encode)
    ]


def _yielding(
    program: Program, given: _Ints, classes: Sequence[str | None], kinds: Sequence[str], rules: Sequence[Rule]
) -> _Ints:
    """Return the pairs (m, 2) of plans of one level whose first yields to the second."""
    if not any(rule.yields for rule in rules):
        return np.empty((0, 2), np.int64)
    table = RuleTable.of(rules)
    known: dict[tuple[str | None, str | None, str], bool] = {}
    found = []
    for pair in program.pair:
        for i, j in (pair, pair[::-1]):
            if kinds[j] == "area":  # rules say who yields to a track
                continue
            sides = classes[i], classes[j], kinds[i]
            if sides not in known:
                known[sides] = table.does_yield(*sides)
            if known[sides] and given[i] == given[j]:
                found.append((i, j))
    return np.array(found, np.int64).reshape(-1, 2)
