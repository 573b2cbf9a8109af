"""Plans by turns: each track in an order takes the least delay that is free of all before it."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from conflictdb.core.delays import Spans
from conflictdb.memory.program import Program, both, gaps, is_free, mirrored, moved, nearest_to_zero

_Ints = NDArray[np.int64]


def greedy(program: Program, order: Sequence[int]) -> tuple[_Ints, frozenset[int]]:
    """Return delays (n,), and the tracks that are left as planned because nothing is free for them.

    A track that is left has the delay 0 and is in the way of all others. So the turns begin anew with it in place,
    until each track of the order has a delay or is left.

    order : the tracks, first come first served
    """
    neighbours: list[list[tuple[int, Spans]]] = [[] for _ in range(len(program))]
    for (i, j), spans in program.pair.items():
        neighbours[i].append((j, spans))
        neighbours[j].append((i, mirrored(spans)))
    left: frozenset[int] = frozenset()
    while True:
        delays: dict[int, int] = dict.fromkeys(left, 0)
        unplaced = set()
        for i in order:
            if i in left:
                continue
            taken = [moved(spans, delays[j]) for j, spans in neighbours[i] if j in delays]
            forbidden = both(program.single[i], *taken)
            chosen = nearest_to_zero(gaps(forbidden, int(program.low[i]), int(program.high[i])))
            if chosen is None:
                unplaced.add(i)
            else:
                delays[i] = chosen
        if not unplaced:
            return np.array([delays[i] for i in range(len(program))], np.int64), left
        left |= unplaced


def is_plan(program: Program, delays: _Ints, left: frozenset[int]) -> bool:
    """Return whether delays are allowed, and each track meets nothing that is not left together with it."""
    within = (program.low <= delays) & (delays <= program.high)
    if not within.all() or any(delays[i] != 0 for i in left):
        return False
    single = all(is_free(program.single[i], int(delays[i])) for i in range(len(program)) if i not in left)
    return single and all(i in left and j in left for i, j in program.broken(delays))
