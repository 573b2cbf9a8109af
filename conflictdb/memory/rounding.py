"""Round the delays of a program to clock times; each is checked with all others again."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from conflictdb.core.delays import Spans
from conflictdb.memory.program import Program, both, is_free, mirrored, moved
from conflictdb.model.clock import Clock

_Ints = NDArray[np.int64]


def rounded_delays(program: Program, delays: _Ints, departs_us: Sequence[int | None], clock: Clock) -> _Ints:
    """Return delays (n,) that are further from 0, so that departures are clock times, and still free.

    One after the other, the smallest first; a plan for which there is none within its limits takes a finer step. If
    no step has one, all stay as they are.

    departs_us : n planned departures; None: unbounded
    """
    if not clock.step_us:
        return delays
    found = delays.copy()
    beside: list[list[tuple[int, Spans]]] = [[] for _ in delays]
    for (i, j), spans in program.pair.items():
        beside[i].append((j, spans))
        beside[j].append((i, mirrored(spans)))
    each = enumerate(zip(delays.tolist(), departs_us, strict=True))
    moving = sorted((abs(us), i, start_us) for i, (us, start_us) in each if us and start_us is not None)
    decided = set(range(len(delays))) - {i for _, i, _ in moving}
    for _, i, start_us in moving:
        closed = both(program.single[i], *(moved(spans, int(found[j])) for j, spans in beside[i] if j in decided))
        values = _outward(int(delays[i]), start_us, clock, closed)
        least, most = int(program.low[i]), int(program.high[i])
        best = next((one for one in values if least <= one <= most), None)
        if best is None:
            return delays
        found[i] = best
        decided.add(i)
    return found


def _outward(delay: int, departs_us: int, clock: Clock, closed: Spans) -> Iterator[int]:
    """Yield the first free delay from one on, away from 0, of each step, last of a microsecond."""
    later = delay > 0
    for step_us in clock.steps_us():
        at = delay
        while True:
            at = clock.rounded_us(departs_us + at, step_us, up=later) - departs_us
            if is_free(closed, at):
                yield at
                break
            k = int(np.searchsorted(closed.low, at, side="right")) - 1
            at = int(closed.high[k]) + 1 if later else int(closed.low[k]) - 1
