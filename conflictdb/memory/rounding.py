"""Round the delays of a program to clock times; all of them together are checked again."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from conflictdb.core.delays import Spans
from conflictdb.memory.program import Pair, Program, both, is_free, mirrored, moved
from conflictdb.model.clock import Clock

_Ints = NDArray[np.int64]


def rounded_delays(program: Program, delays: _Ints, departs_us: Sequence[int | None], clock: Clock) -> _Ints:
    """Return delays (n,) that are further from 0, so that departures are clock times, and still free.

    One after the other, the smallest first; a plan for which there is none within its limits takes a finer step. If
    that does not clear, all stay as they are.

    departs_us : n planned departures; None: unbounded
    """
    if not clock.step_us:
        return delays
    found = delays.copy()
    beside: list[list[tuple[int, Spans]]] = [[] for _ in delays]
    for (i, j), spans in program.pair.items():
        beside[i].append((j, spans))
        beside[j].append((i, mirrored(spans)))
    decided = delays == 0
    for i in np.argsort(np.abs(delays), kind="stable").tolist():
        start_us = departs_us[i]
        if delays[i] == 0 or start_us is None:
            decided[i] = True
            continue
        closed = both(program.single[i], *(moved(spans, int(found[j])) for j, spans in beside[i] if decided[j]))
        values = _outward(int(delays[i]), start_us, clock, closed)
        least, most = int(program.low[i]), int(program.high[i])
        best = next((one for one in values if least <= one <= most), None)
        if best is None:
            return delays
        found[i], decided[i] = best, True
    return found if _is_clear(program.pair, program.single, found, delays) else delays


def _outward(delay: int, departs_us: int, clock: Clock, closed: Spans) -> Iterator[int]:
    """Yield the first free delay from one on, away from 0, of each step, and last the exact one."""
    later = delay > 0
    for step_us in (*clock.steps_us(), 1):
        at = delay
        while True:
            at = clock.rounded_us(departs_us + at, step_us, up=later) - departs_us
            if is_free(closed, at):
                yield at
                break
            k = int(np.searchsorted(closed.low, at, side="right")) - 1
            at = int(closed.high[k]) + 1 if later else int(closed.low[k]) - 1


def _is_clear(pair: Mapping[Pair, Spans], single: Sequence[Spans], found: _Ints, delays: _Ints) -> bool:
    """Return whether no plan that moves meets anything."""
    alone = all(is_free(single[i], int(found[i])) for i in np.flatnonzero(delays).tolist())
    moves = (delays != 0).tolist()
    return alone and all(
        is_free(spans, int(found[i] - found[j])) for (i, j), spans in pair.items() if moves[i] or moves[j]
    )
