"""Stage 4: when exactly do two pieces interfere.

Method `exact` asks the kernel, which decides nearly all pairs, and takes the rest apart (`stage4.search`); method `nlp`
takes every pair apart, and asks the published programs where to look.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from conflictdb import kernel
from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel.meeting import distances
from conflictdb.methods import METHODS, Solver
from conflictdb.model import Scene
from conflictdb.motion.contract import Plane
from conflictdb.stage4.constants import PAIRS_AT_ONCE, TOUCH_M
from conflictdb.stage4.encounters import group_by_shape, short_m
from conflictdb.stage4.exact import Meetings, certain_contacts
from conflictdb.stage4.search import CONFLICT, GRAZING, UNRESOLVED, Programs, nothing, search

__all__ = ["CONFLICT", "GRAZING", "UNRESOLVED", "Effort", "contacts", "static_verdicts"]

Progress = Callable[[int], None]


@dataclass(slots=True)
class Effort:
    """What stage 4 did: pairs taken apart by the search, and what the kernel and the programs did."""

    searched_pairs: int = 0
    exact: kernel.Work = field(default_factory=kernel.Work)
    programs: Programs = field(default_factory=Programs)

    def add(self, other: "Effort") -> None:
        """Count another effort in."""
        self.searched_pairs += other.searched_pairs
        for mine, theirs in ((self.exact, other.exact), (self.programs, other.programs)):
            for name, count in asdict(theirs).items():
                setattr(mine, name, getattr(mine, name) + count)

    def counts(self) -> dict[str, int]:
        """Return every count by name."""
        return {"searched_pairs": self.searched_pairs, **asdict(self.exact), **asdict(self.programs)}


def contacts(
    scene: Scene,
    plane: Plane,
    pieces: Pieces,
    pairs: Pairs,
    first_s: Floats,
    last_s: Floats,
    progress: Progress | None = None,
    *,
    threads: int = 1,
) -> tuple[Contacts, Effort]:
    """Return when the pairs interfere within their windows, and what it took.

    first_s, last_s : (n,) the windows of stage 3, seconds after the start of the pairs' shared spans; both pieces of
        a pair must not be unbounded in time together (pairs of areas are `static_verdicts`).
    progress : called with the number of pairs solved since the last call
    threads : of the kernel; the answer does not depend on it
    """
    solver = METHODS[scene.method].solver
    if solver is None:
        raise ValueError(f"method {scene.method} stops before stage 4")
    prepared = kernel.Scene(plane.kernel_plane, pieces, pairs.a, pairs.b)
    effort = Effort()
    found = [nothing()]

    def solve(rows: NDArray[np.int64]) -> Contacts:
        meetings = Meetings.of(plane, pieces, prepared, pairs, rows, first_s[rows], last_s[rows], threads)
        return _solved(scene, solver, meetings, effort)

    def leave(rows: NDArray[np.int64]) -> Contacts:
        width, verdict = last_s[rows] - first_s[rows], np.full(len(rows), UNRESOLVED, np.int8)
        touches = np.ones(len(rows), np.bool_)
        return Contacts(np.arange(len(rows)), first_s[rows], last_s[rows], width, verdict, touches)

    possible = np.flatnonzero(first_s <= last_s)
    for rows in (possible[first : first + PAIRS_AT_ONCE] for first in range(0, len(possible), PAIRS_AT_ONCE)):
        found += [one.of_pairs(some) for some, one in isolated(rows, solve, leave, "pair of pieces")]
        if progress:
            progress(len(rows))
    return Contacts.concatenate(found), effort


def _solved(scene: Scene, solver: Solver, meetings: Meetings, effort: Effort) -> Contacts:
    """Return the contacts of pairs, numbered from 0, by the solver of the scene's method."""
    found, rest = [nothing()], np.arange(len(meetings))
    if solver is Solver.CERTIFIED:
        certain, rest = certain_contacts(scene, meetings, effort.exact)
        found += certain
    effort.searched_pairs += len(rest)
    if rest.size:
        found.append(_searched(scene, solver, meetings.take(rest).with_own_pieces(), effort).of_pairs(rest))
    return Contacts.concatenate(found)


def _searched(scene: Scene, solver: Solver, meetings: Meetings, effort: Effort) -> Contacts:
    """Return the contacts of pairs taken apart by the search, those together whose shapes can share arrays."""
    programs = effort.programs if solver is Solver.PROGRAMS else None
    found = [nothing()]
    for rows in group_by_shape(meetings.plane, meetings.pieces, meetings.pairs, np.arange(len(meetings))):
        alike = meetings.take(rows)
        pairs = alike.encounters(scene.separation_m)
        contacts = search(pairs, scene.tolerance_m, alike.low_s, alike.high_s, alike.beyond_s, programs)
        found.append(contacts.of_pairs(rows))
    return Contacts.concatenate(found)


def static_verdicts(scene: Scene, plane: Plane, pieces: Pieces, pairs: Pairs) -> NDArray[np.int8]:
    """Return (n,) the verdict on pairs of areas, -1 where they are apart; no time is involved."""
    prepared = kernel.Scene(plane.kernel_plane, pieces, pairs.a, pairs.b)
    never = np.zeros(len(pairs), np.int64)
    clearance = distances(prepared, pairs.a, pairs.b, never, np.zeros(len(pairs))) - scene.separation_m
    margin = max(scene.tolerance_m, TOUCH_M)
    furthest_m = scene.separation_m + margin
    # The true distance is at most this much more than the one found.
    has_error = scene.separation_m > 0.0 and furthest_m > short_m(plane)
    error_m = float(plane.distance_error_m(furthest_m)) if has_error else 0.0
    certainty_margin_m = TOUCH_M + error_m if error_m > 0.0 else 0.0
    close = clearance + error_m <= margin
    verdicts = np.select(
        [clearance > margin, clearance < -max(margin, certainty_margin_m), close & (clearance >= -margin)],
        [-1, CONFLICT, GRAZING],
        UNRESOLVED,
    )
    return np.where(np.isnan(clearance), UNRESOLVED, verdicts).astype(np.int8)
