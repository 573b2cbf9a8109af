"""Stage 4: when exactly do two pieces interfere.

Pairs whose shapes can share arrays are solved together. Method `exact` solves most of them with the certified solver
(`stage4.exact.solver`), and searches the rest (`stage4.search`). Method `nlp` searches all, and asks the published
programs where to look.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from conflictdb.arrays.answers import Contacts
from conflictdb.arrays.isolation import isolated
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.earth.geodesy import Floats
from conflictdb.methods import METHODS, Solver
from conflictdb.model import Scene
from conflictdb.motion.contract import Plane
from conflictdb.stage4.constants import END_RESOLUTION_S, TOUCH_M
from conflictdb.stage4.distance import clearance_m, nearest_at
from conflictdb.stage4.encounters import Encounters, group_by_shape
from conflictdb.stage4.exact.solver import Work, solve_depth, solve_exactly
from conflictdb.stage4.outcomes import Outcome, Solution
from conflictdb.stage4.search import CONFLICT, GRAZING, UNRESOLVED, Programs, nothing, search

__all__ = ["CONFLICT", "GRAZING", "UNRESOLVED", "Effort", "contacts", "meeting_points", "static_verdicts"]

Progress = Callable[[int], None]


@dataclass(slots=True)
class Effort:
    """What stage 4 did: pairs taken apart by the search, and what the exact solver and the programs did."""

    searched_pairs: int = 0
    exact: Work = field(default_factory=Work)
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
) -> tuple[Contacts, Effort]:
    """Return when the pairs interfere within their windows, and what it took.

    first_s, last_s : (n,) the windows of stage 3, seconds after the start of the pairs' shared spans; both pieces of
        a pair must not be unbounded in time together (pairs of areas are `static_verdicts`).
    progress : called with the number of pairs solved since the last call
    """
    solver = METHODS[scene.method].solver
    if solver is None:
        raise ValueError(f"method {scene.method} stops before stage 4")
    effort = Effort()
    found = [nothing()]

    def solve(rows: NDArray[np.int64]) -> Contacts:
        zero = np.maximum(pieces.start_us[pairs.a[rows]], pieces.start_us[pairs.b[rows]])
        encounters = Encounters.of(plane, scene.separation_m, pieces, pairs, rows, zero)
        end = np.minimum(pieces.end_us[pairs.a[rows]], pieces.end_us[pairs.b[rows]])
        span = (end - zero) / 1e6
        low, high = np.clip(first_s[rows], 0.0, span), np.clip(last_s[rows], 0.0, span)
        belongs = _end_belongs(pieces, pairs, rows, end)
        beyond = np.where(belongs, np.inf, span)
        return _group_contacts(scene, solver, encounters, low, high, beyond, effort)

    def leave(rows: NDArray[np.int64]) -> Contacts:
        width, verdict = last_s[rows] - first_s[rows], np.full(len(rows), UNRESOLVED, np.int8)
        touches = np.ones(len(rows), np.bool_)
        return Contacts(np.arange(len(rows)), first_s[rows], last_s[rows], width, verdict, touches)

    for group in group_by_shape(plane, pieces, pairs, np.flatnonzero(first_s <= last_s)):
        found += [one.of_pairs(rows) for rows, one in isolated(group, solve, leave, "pair of pieces")]
        if progress:
            progress(len(group))
    return Contacts.concatenate(found), effort


def _group_contacts(
    scene: Scene, solver: Solver, pairs: Encounters, low: Floats, high: Floats, beyond_s: Floats, effort: Effort
) -> Contacts:
    """Return the contacts of like pairs by the solver of the scene's method."""
    match solver:
        case Solver.PROGRAMS:
            effort.searched_pairs += len(pairs)
            return search(pairs, scene.tolerance_m, low, high, beyond_s, effort.programs)
        case Solver.CERTIFIED:
            found, rest = _exact_contacts(scene, pairs, low, high, beyond_s, effort.exact)
            effort.searched_pairs += len(rest)
            if rest.size:
                searched = search(pairs.take(rest), scene.tolerance_m, low[rest], high[rest], beyond_s[rest], None)
                found.append(searched.of_pairs(rest))
            return Contacts.concatenate(found)


def _exact_contacts(
    scene: Scene, pairs: Encounters, low: Floats, high: Floats, beyond_s: Floats, work: Work
) -> tuple[list[Contacts], NDArray[np.int64]]:
    """Return the contacts that are certain, and the rows of which nothing is."""

    def known(solution: Solution, rows: NDArray[np.int64], is_known: NDArray[np.bool_], verdict: int) -> Contacts:
        some = np.flatnonzero(is_known)
        times = solution.start_s[some], solution.end_s[some], solution.error_s[some]
        verdicts, touches = np.full(len(some), verdict, np.int8), np.ones(len(some), np.bool_)
        return Contacts(rows[some], *times, verdicts, touches)

    every = np.arange(len(pairs))
    margin_m = max(scene.tolerance_m, TOUCH_M)
    # A contact that begins where the span ends may not belong to the span: the search decides that.
    last = beyond_s - 2.0 * END_RESOLUTION_S
    solution = solve_exactly(pairs, low, high, margin_m, work)
    deep = solution.ended(Outcome.CONTACT) & (solution.start_s < last)
    found = [nothing(), known(solution, every, deep, CONFLICT)]
    rest = np.flatnonzero(~deep & ~solution.ended(Outcome.SEPARATED))
    if margin_m == TOUCH_M or not rest.size:
        return found, rest
    # The rest may be grazing. Do they touch, and how deep? If not, when are they within the tolerance?
    some = pairs.take(rest)
    solution = solve_exactly(some, low[rest], high[rest], TOUCH_M, work)
    meets = solution.ended(Outcome.CONTACT) & (solution.start_s < last[rest])
    depth = np.full(len(rest), Outcome.UNDECIDED, np.int8)
    rows = np.flatnonzero(meets)
    depth[rows] = _depth(some.take(rows), solution.start_s[rows], solution.end_s[rows], margin_m, work)
    found.append(known(solution, rest, depth == Outcome.SEPARATED, GRAZING))
    found.append(known(solution, rest, depth == Outcome.CONTACT, CONFLICT))
    rows = np.flatnonzero(solution.ended(Outcome.SEPARATED))
    wider = replace(some.take(rows), separation_m=pairs.separation_m + margin_m)
    near = solve_exactly(wider, low[rest[rows]], high[rest[rows]], TOUCH_M, work)
    close = near.ended(Outcome.CONTACT) & (near.start_s < last[rest[rows]])
    found.append(replace(known(near, rest[rows], close, GRAZING), touches=np.zeros(int(close.sum()), np.bool_)))
    done = depth != Outcome.UNDECIDED
    done[rows] = close | near.ended(Outcome.SEPARATED)
    return found, rest[~done]


def _depth(pairs: Encounters, start: Floats, end: Floats, margin_m: float, work: Work) -> NDArray[np.int8]:
    """Return (n,) the outcome of asking whether pairs that meet from start to end do so deeper than a margin."""
    if pairs.separation_m > margin_m:
        deeper = replace(pairs, separation_m=pairs.separation_m - margin_m)
        return solve_exactly(deeper, start, end, TOUCH_M, work).outcome
    if pairs.separation_m == 0.0 and len(pairs):
        return solve_depth(pairs, start, end, margin_m)
    return np.full(len(pairs), Outcome.UNDECIDED, np.int8)


def static_verdicts(scene: Scene, plane: Plane, pieces: Pieces, pairs: Pairs) -> NDArray[np.int8]:
    """Return (n,) the verdict on pairs of areas, -1 where they are apart; no time is involved."""
    verdict = np.full(len(pairs), -1, np.int8)

    def judge(rows: NDArray[np.int64]) -> NDArray[np.int8]:
        encounters = Encounters.of(plane, scene.separation_m, pieces, pairs, rows, np.zeros(len(rows), np.int64))
        clearance = clearance_m(encounters, np.arange(len(rows)), np.zeros(len(rows)))
        margin = max(scene.tolerance_m, TOUCH_M)
        # The true distance is at most this much more than the one found.
        error_m = encounters.distance_error_m(scene.separation_m + margin) if scene.separation_m > 0.0 else 0.0
        certainty_margin_m = TOUCH_M + error_m if error_m > 0.0 else 0.0
        close = clearance + error_m <= margin
        verdicts = np.select(
            [clearance > margin, clearance < -max(margin, certainty_margin_m), close & (clearance >= -margin)],
            [-1, CONFLICT, GRAZING],
            UNRESOLVED,
        )
        return np.where(np.isnan(clearance), UNRESOLVED, verdicts).astype(np.int8)

    def leave(rows: NDArray[np.int64]) -> NDArray[np.int8]:
        return np.full(len(rows), UNRESOLVED, np.int8)

    for group in group_by_shape(plane, pieces, pairs, np.arange(len(pairs))):
        for rows, found in isolated(group, judge, leave, "pair of parts of areas"):
            verdict[rows] = found
    return verdict


def meeting_points(scene: Scene, plane: Plane, pieces: Pieces, pairs: Pairs, at_s: Floats) -> Floats:
    """Return (n, 2) longitude and latitude, degrees, of where each pair meets at an instant of its shared span.

    Where the polygons touch it is the point of touch, where they overlap a point of both.
    """
    places = np.full((len(pairs), 2), np.nan)

    def meet(rows: NDArray[np.int64]) -> Floats:
        zero = np.maximum(pieces.start_us[pairs.a[rows]], pieces.start_us[pairs.b[rows]])
        encounters = Encounters.of(plane, scene.separation_m, pieces, pairs, rows, zero)
        found = nearest_at(encounters, np.arange(len(rows)), at_s[rows])
        point = 0.5 * (found.point_a + found.point_b)
        overlap = np.flatnonzero(found.gap <= 0.0)
        if overlap.size:
            inside = encounters.take(overlap)
            a, b = (_hulls(shapes.positions(at_s[rows][overlap])) for shapes in (inside.a, inside.b))
            common = shapely.intersection(a, b)
            held = ~shapely.is_empty(common)
            middle = shapely.get_coordinates(shapely.centroid(common[held]))
            point[overlap[held]] = middle + inside.origin[:, held].T
        lon, lat = plane.from_plane(point[:, 0], point[:, 1])
        return np.stack([np.mod(lon + 180.0, 360.0) - 180.0, lat], axis=1)

    def nowhere(rows: NDArray[np.int64]) -> Floats:
        return np.full((len(rows), 2), np.nan)

    for group in group_by_shape(plane, pieces, pairs, np.arange(len(pairs))):
        for rows, place in isolated(group, meet, nowhere, "pair of pieces"):
            places[rows] = place
    return places


def _hulls(polygons: Floats) -> NDArray[np.object_]:
    """Return the convex hulls (n,) of vertices (2, v, n)."""
    return np.asarray(shapely.convex_hull(shapely.multipoints(np.moveaxis(polygons, 0, 2).swapaxes(0, 1))))


def _end_belongs(pieces: Pieces, pairs: Pairs, rows: NDArray[np.int64], end: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether the last instant of the shared span belongs to both pieces."""
    belongs = np.ones(len(rows), np.bool_)
    for member in (pairs.a[rows], pairs.b[rows]):
        belongs &= (pieces.end_us[member] > end) | pieces.end_inclusive[member]
    return belongs
