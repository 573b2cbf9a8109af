"""Least delays of a program: by components, with pairs that enter when a plan breaks them, within a time limit."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from conflictdb.memory.by_parts import PartialProgram
from conflictdb.memory.greedy import greedy, is_plan
from conflictdb.memory.program import Pair, Program, is_free
from conflictdb.memory.settle import settle
from conflictdb.memory.turns import MOST_TRACKS, Turns, bound_of

_Ints = NDArray[np.int64]

# A component has at least this share of the time that is left.
_LEAST_SHARE = 0.25
# A pair enters the program if a solver's numbers break it by more than this, microseconds: more than they are exact to.
_SLACK_US = 2.0
# Sets of tracks that pass one place in turn: how many at least are bounded together, and for how long each, seconds.
_LEAST_CLIQUE = 4
_OF_CLIQUE_S = 0.5
# Bound and objective are equal if they differ by less, seconds: solvers keep their rows to a tolerance.
EQUAL_S = 1e-3


@dataclass(frozen=True, slots=True)
class Solution:
    """Delays of n tracks, which keep each of them free of all that is not left together with it.

    left : the tracks that keep the delay 0 although they meet something: as few as were found
    objective_s : of these delays
    bound_s : no plan that leaves so few tracks has a lower objective
    is_least : whether no plan leaves fewer, and none of those has a lower objective than this by a millisecond
    """

    delays: _Ints
    left: frozenset[int]
    objective_s: float
    bound_s: float
    is_least: bool


def least(program: Program, order: Sequence[int], goal: str, limit_s: float) -> Solution:
    """Return the best delays that are found within a time limit, never worse than by turns.

    order : all tracks, first come first served
    goal : ``total``, the sum of weighted delays, or ``largest`` of them
    """
    ends = time.monotonic() + limit_s
    rank = {track: place for place, track in enumerate(order)}
    delays, left = np.zeros(len(program), np.int64), set()
    objectives, bounds, is_least = [0.0], [0.0], True
    parts = program.components()
    work = [float(len(rows)) ** 2 for rows in parts]
    for k, rows in enumerate(parts):
        part = program.part(rows)
        turns = sorted(range(len(rows)), key=lambda k: rank[int(rows[k])])
        now = time.monotonic()
        # Most of the time left is for the components that follow, which are larger.
        share = max(_LEAST_SHARE, work[k] / sum(work[k:]))
        found = _of_component(part, turns, goal, now + share * (ends - now))
        delays[rows] = found.delays
        left |= {int(rows[k]) for k in found.left}
        objectives.append(found.objective_s)
        bounds.append(found.bound_s)
        is_least &= found.is_least
    together = sum if goal == "total" else max
    objective_s, bound_s = float(together(objectives)), float(together(bounds))
    if goal == "largest":
        # A component that is not proven does not matter below the largest.
        is_least = is_least or (not left and objective_s - bound_s <= EQUAL_S)
    return Solution(delays, frozenset(left), objective_s, bound_s, is_least)


def _of_component(program: Program, turns: Sequence[int], goal: str, ends: float) -> Solution:
    delays, left = greedy(program, turns)
    best = (len(left), program.cost(delays, goal), delays, left)
    if best[:2] == (0, 0.0):
        return Solution(delays, left, 0.0, 0.0, True)

    def keep(trial: _Ints | None, left: frozenset[int]) -> None:
        """Keep a plan that is better than the best."""
        nonlocal best
        if trial is not None and is_plan(program, trial, left):
            best = min(best, (len(left), program.cost(trial, goal), trial, left), key=lambda one: one[:2])

    cuts, bound = [], 0.0
    for tracks in _cliques(program):
        turn = Turns.of(program, np.array(tracks, np.int64))
        if turn is not None:
            is_all = len(tracks) == len(program)
            until = ends if is_all else min(ends, time.monotonic() + _OF_CLIQUE_S)
            least_s, order = bound_of(turn, goal, best[1] if is_all and not best[0] else np.inf, until)
            cuts.append((tuple(tracks), least_s))
            bound = max(bound, least_s)
            if is_all and order is not None:
                keep(settle(program, turn.delays_of(order), frozenset()), frozenset())
    if best[0] == 0 and best[1] - bound <= EQUAL_S:
        return Solution(best[2], best[3], best[1], min(bound, best[1]), True)
    # Leaving one track costs more than all delays of a plan.
    spans = program.weight * np.maximum(-program.low, program.high) / 1e6
    dear = float(spans.sum() if goal == "total" else spans.max()) + 1.0
    parts = PartialProgram(program, goal, dear, cuts)
    active = set(program.broken(np.zeros(len(program), np.int64))) | set(_touching(program, best[2]))
    while True:
        relaxed = parts.solve(active, ends)
        bound = max(bound, relaxed.bound)
        if relaxed.delays is None:
            break
        keep(settle(program, relaxed.delays, relaxed.left), relaxed.left)
        new = set(program.broken(relaxed.delays, _SLACK_US)) - active
        new = {(i, j) for i, j in new if not (i in relaxed.left and j in relaxed.left)}
        if not new or time.monotonic() >= ends:
            break
        active |= new
    count, objective, delays, left = best
    bound -= dear * count
    # A bound below zero: fewer tracks may be left.
    is_fewest = bound >= -EQUAL_S
    bound = min(max(bound, 0.0), objective) if is_fewest else 0.0
    return Solution(delays, left, objective, bound, is_fewest and objective - bound <= EQUAL_S)


def _cliques(program: Program) -> list[list[int]]:
    """Return sets of tracks that must pass in turn, two by two, as far as two such sets share at most one track."""
    neighbours: dict[int, set[int]] = {}
    for (i, j), spans in program.pair.items():
        if not is_free(spans, 0):
            neighbours.setdefault(i, set()).add(j)
            neighbours.setdefault(j, set()).add(i)
    taken: set[Pair] = set()
    found = []
    for start in sorted(neighbours, key=lambda i: -len(neighbours[i])):
        clique = [start]
        for other in sorted(neighbours[start], key=lambda i: -len(neighbours[i])):
            if all(other in neighbours[one] and (min(one, other), max(one, other)) not in taken for one in clique):
                clique.append(other)
        if len(clique) >= _LEAST_CLIQUE:
            taken |= {(min(i, j), max(i, j)) for i in clique for j in clique if i != j}
            found.append(sorted(clique)[:MOST_TRACKS])
    return found


def _touching(program: Program, delays: _Ints) -> list[tuple[int, int]]:
    """Return the pairs that a plan keeps just free of each other: those that decide it."""
    found = []
    for (i, j), spans in program.pair.items():
        difference = delays[i] - delays[j]
        if bool(((difference == spans.high + 1) | (difference == spans.low - 1)).any()):
            found.append((i, j))
    return found
