"""Stage 4: find when two pieces interfere.

The kernel decides (kernel/narrow/search.c), but for pairs of areas, which stand still (`static_verdicts`). With method
`nlp` it searches every pair and calls the published programs for guesses.
"""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays import Floats
from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.stage4.constants import PAIRS_AT_ONCE, SHORT_M, TOUCH_M
from conflictdb.core.stage4.effort import Effort
from conflictdb.earth.registry import Setup
from conflictdb.kernel.meeting import distances
from conflictdb.model.methods import METHODS, Solver
from conflictdb.model.results import Verdict

__all__ = ["CONFLICT", "GRAZING", "UNRESOLVED", "Effort", "contacts", "static_verdicts"]

CONFLICT: Final = Verdict.CONFLICT.code
GRAZING: Final = Verdict.GRAZING.code
UNRESOLVED: Final = Verdict.UNRESOLVED.code

Progress = Callable[[int], None]


def contacts(
    setup: Setup,
    prepared: kernel.KernelScene,
    pairs: Pairs,
    first_s: Floats,
    last_s: Floats,
    progress: Progress | None = None,
    *,
    threads: int = 1,
) -> tuple[Contacts, Effort]:
    """Return the contacts of pairs within their windows, and the work done.

    A pair proven apart has none. A pair that is not decided has a contact UNRESOLVED for the time in which it may meet;
    within rounding errors it is GRAZING.

    prepared : the pieces of the pairs
    first_s, last_s : (n,) the windows of stage 3, seconds after the start of the pairs' shared spans; both pieces of
        a pair must not be unbounded in time together (pairs of areas are `static_verdicts`).
    progress : called with the number of pairs solved since the last call
    threads : of the kernel
    """
    solver = METHODS[setup.scene.method].solver
    if solver is None:
        raise ValueError(f"method {setup.scene.method} stops before stage 4")
    questions = _questions(prepared.pieces, pairs, first_s, last_s)
    effort = Effort()
    found = [Contacts.none()]
    possible = np.flatnonzero(first_s <= last_s)
    with ExitStack() as held:
        guesses = None
        if solver is Solver.PROGRAMS:
            # scipy takes half a second to import.
            from conflictdb.core.published.guesses import Guesses, reproducible

            held.enter_context(reproducible())
            guesses = Guesses(
                setup.plane, setup.scene.separation_m, prepared, pairs, questions.zero_us, effort.programs
            )
        for rows in (possible[first : first + PAIRS_AT_ONCE] for first in range(0, len(possible), PAIRS_AT_ONCE)):
            asked = questions.take(rows)
            ask = None if guesses is None else partial(guesses.extreme_contact, rows)
            done = kernel.contacts(
                prepared, asked, setup.scene.separation_m, setup.scene.tolerance_m, effort.exact, threads, ask
            )
            found.append(done.of_pairs(rows))
            if progress:
                progress(len(rows))
    return Contacts.concatenate(found), effort


def _questions(pieces: Pieces, pairs: Pairs, first_s: Floats, last_s: Floats) -> kernel.Questions:
    """Return the kernel's queries: the pairs with their windows (n,), clipped to the shared spans."""
    zero, end = pieces.shared_span(pairs.a, pairs.b)
    span = (end - zero) / 1e6
    belongs = np.ones(len(pairs), np.bool_)
    for member in (pairs.a, pairs.b):
        belongs &= (pieces.end_us[member] > end) | pieces.end_inclusive[member]
    low_s, high_s = np.clip(first_s, 0.0, span), np.clip(last_s, 0.0, span)
    return kernel.Questions(pairs.a, pairs.b, zero, low_s, high_s, np.where(belongs, np.inf, span), pairs.company)


def static_verdicts(
    setup: Setup, prepared: kernel.KernelScene, pairs: Pairs
) -> tuple[NDArray[np.int8], NDArray[np.bool_]]:
    """Return the verdicts (n,) on pairs of areas, -1 if they are apart; no time is involved.

    The second array (n,) is true if they are nearer than the separation, not only within the tolerance of it, or if
    that is unknown.
    """
    never = np.zeros(len(pairs), np.int64)
    clearance = distances(prepared, pairs.a, pairs.b, never, np.zeros(len(pairs))) - setup.scene.separation_m
    margin = max(setup.scene.tolerance_m, TOUCH_M)
    furthest_m = setup.scene.separation_m + margin
    # The true distance exceeds the computed one by at most this; in the plane it is exact.
    has_error = setup.scene.separation_m > 0.0 and furthest_m > (SHORT_M if setup.plane.is_conformal else TOUCH_M)
    error_m = float(setup.plane.distance_error_m(furthest_m)) if has_error else 0.0
    certainty_margin_m = TOUCH_M + error_m if error_m > 0.0 else 0.0
    close = clearance + error_m <= margin
    verdicts = np.full(len(pairs), UNRESOLVED, np.int8)  # also where it is NaN
    verdicts[close & (clearance >= -margin)] = GRAZING
    verdicts[clearance < -max(margin, certainty_margin_m)] = CONFLICT
    verdicts[clearance > margin] = -1
    return verdicts, ~(clearance > TOUCH_M)
