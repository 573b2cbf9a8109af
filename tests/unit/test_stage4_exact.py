"""The kernel held to the search, which shares none of its shortcuts, and to answers known by hand."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import scenes
import shapely
from workloads import EQUATOR, HARBOUR, HIGH_LATITUDE, LONG_LEGS, PAPER, throw

from conflictdb import kernel
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.earth.geodesy import Floats
from conflictdb.kernel import Outcome, Solution, Work
from conflictdb.model import Area, EarthModel, Scene, Track
from conflictdb.motion.registry import plane_of
from conflictdb.pieces.covers import pieces_of
from conflictdb.pieces.cutting import area_pieces
from conflictdb.stage1_broad_phase import candidates
from conflictdb.stage2_intersection import intersections
from conflictdb.stage4.constants import TOUCH_M
from conflictdb.stage4.contacts import CONFLICT, GRAZING, UNRESOLVED, contacts
from conflictdb.stage4.distance import clearance_m
from conflictdb.stage4.encounters import Encounters, group_by_shape
from conflictdb.stage4.exact import Meetings
from conflictdb.stage4.search import search

DEGREE = scenes.parallel_m(EarthModel.SPHERE, 0.0)


@dataclass(frozen=True)
class Group:
    """Pairs whose shapes share arrays, timed from the start of their shared spans."""

    scene: Scene
    meetings: Meetings

    @property
    def pairs(self) -> Encounters:
        return self.meetings.encounters(self.scene.separation_m)

    @property
    def span_s(self) -> Floats:
        return self.meetings.high_s

    def solved(self, margin_m: float, work: Work | None = None) -> Solution:
        return self.meetings.contacts(self.scene.separation_m, margin_m, work or Work())


def groups(scene: Scene, areas: list[Area], tracks: list[Track]) -> list[Group]:
    """All pairs with a track that pass stages 1 and 2."""
    plane = plane_of(scene)
    pieces = pieces_of(scene, plane, AreaBatch.of(areas), TrackBatch.of(tracks))
    pairs = intersections(pieces, *candidates(pieces), regions=False)
    pairs = pairs.take(np.flatnonzero((pieces.kind[pairs.a] == 1) | (pieces.kind[pairs.b] == 1)))
    start, end = pieces.shared_span(pairs.a, pairs.b)
    seconds, prepared = (end - start) / 1e6, kernel.Scene(plane.kernel_plane, pieces)
    return [
        Group(scene, Meetings.of(plane, pieces, prepared, pairs, rows, np.zeros(len(rows)), seconds[rows]))
        for rows in group_by_shape(plane, pieces, pairs, np.arange(len(pairs)))
    ]


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize(
    ("workload", "tolerance_m", "separation_m"),
    [
        (PAPER, 0.0, 0.0),
        (HIGH_LATITUDE, 1.0, 0.0),
        (LONG_LEGS, 20.0, 0.0),
        (EQUATOR, 0.0, 0.0),
        (HARBOUR, 0.0, 0.0),
        (PAPER, 0.0, 3000.0),
        (HIGH_LATITUDE, 1.0, 1000.0),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_what_is_settled_is_what_the_search_finds(
    workload: object, tolerance_m: float, separation_m: float, earth: EarthModel
) -> None:
    """Clear is clear, one contact is one contact, and its ends agree within both bounds; hardly anything is left."""
    scene, areas, tracks = throw(workload, 4, 12, 12, earth, tolerance_m, separation_m)
    total = left = solved = 0
    for group in groups(scene, areas, tracks):
        n = len(group.pairs)
        solution = group.solved(max(tolerance_m, TOUCH_M))
        found = search(group.pairs, tolerance_m, np.zeros(n), group.span_s, np.full(n, np.inf), None)
        for row in range(n):
            mine = np.flatnonzero(found.pair == row)
            if solution.ended(Outcome.SEPARATED)[row]:
                assert not len(mine)
            if solution.ended(Outcome.CONTACT)[row]:
                assert found.verdict[mine].tolist() == [CONFLICT]
                allowed = solution.error_s[row] + found.error_s[mine[0]] + 1e-7
                assert solution.start_s[row] == pytest.approx(found.start_s[mine[0]], abs=allowed)
                assert solution.end_s[row] == pytest.approx(found.end_s[mine[0]], abs=allowed)
        total += n
        left += int(solution.ended(Outcome.UNDECIDED).sum())
        solved += int(solution.ended(Outcome.CONTACT).sum())
    assert solved >= 5
    assert left <= 0.1 * total


@pytest.mark.parametrize("workload", [PAPER, HIGH_LATITUDE, LONG_LEGS], ids=lambda w: w.name)
def test_bounds_at_tolerance_0_are_below_a_microsecond_where_polygons_meet_at_a_speed(workload: object) -> None:
    scene, areas, tracks = throw(workload, 7, 25, 25, EarthModel.WGS84, 0.0)
    solved = 0
    for group in groups(scene, areas, tracks):
        solution = group.solved(TOUCH_M)
        solved += int(solution.ended(Outcome.CONTACT).sum())
        rows = np.flatnonzero(solution.ended(Outcome.CONTACT) & (solution.error_s > 1e-6))
        if rows.size:
            # By how much the gap changes in the second before and after either end.
            some = group.pairs.take(rows)
            every = np.arange(len(rows))
            slow = np.zeros(len(rows), np.bool_)
            for end in (solution.start_s[rows], solution.end_s[rows]):
                slow |= np.abs(clearance_m(some, every, end + 1.0) - clearance_m(some, every, end - 1.0)) < 1.5
            assert slow.all()
    assert solved >= 50


def test_uniform_motion_takes_the_closed_form() -> None:
    """A haven along the equator, through a box: answers by hand, without one evaluation of the true motion."""
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0)
    box = scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 4000.0, 2000.0, 500.0, 500.0)
    work = Work()
    for group in groups(scene, [box], [track]):
        group.solved(TOUCH_M, work)
    assert work.closed_forms >= 1
    assert work.windows == work.evaluations == 0
    pieces = pieces_of(scene, plane_of(scene), AreaBatch.of([box]), TrackBatch.of([track]))
    pairs = intersections(pieces, *candidates(pieces), regions=False)
    start, end = pieces.shared_span(pairs.a, pairs.b)
    found, _ = contacts(scene, plane_of(scene), pieces, pairs, np.zeros(len(pairs)), (end - start) / 1e6)
    seconds = (start[found.pair] - scenes.T0_US) / 1e6
    assert (seconds + found.start_s).min() == pytest.approx((0.5 - 4000 / DEGREE) * 3600, abs=1e-6)
    assert (seconds + found.end_s).max() == pytest.approx((0.6 + 2000 / DEGREE) * 3600, abs=1e-6)
    assert found.error_s.max() < 1e-6


def test_a_window_of_one_instant_is_looked_at() -> None:
    """In the middle of a contact: it is one, and as short."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    box = scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 4000.0, 2000.0, 500.0, 500.0)
    pieces = pieces_of(scene, plane_of(scene), AreaBatch.of([box]), TrackBatch.of([track]))
    pairs = intersections(pieces, *candidates(pieces), regions=False)
    start, end = pieces.shared_span(pairs.a, pairs.b)
    at_us = scenes.T0_US + int(0.55 * 3600e6)
    row = np.flatnonzero((start <= at_us) & (at_us <= end))[:1]
    at_s = (at_us - start[row]) / 1e6
    found, _ = contacts(scene, plane_of(scene), pieces, pairs.take(row), at_s, at_s)
    assert found.verdict.tolist() == [CONFLICT]
    assert found.start_s == found.end_s == at_s


def test_answers_do_not_depend_on_the_company() -> None:
    """Each pair alone, bit for bit what it is among all others."""
    scene, areas, tracks = throw(HIGH_LATITUDE, 3, 8, 8, EarthModel.WGS84, 1.0)
    for group in groups(scene, areas, tracks):
        together = group.solved(1.0)
        for row in range(len(group.pairs)):
            alone = replace(group, meetings=group.meetings.take(np.array([row]))).solved(1.0)
            for name in ("outcome", "start_s", "end_s", "error_s"):
                assert getattr(alone, name)[0] == getattr(together, name)[row]


@pytest.mark.parametrize(
    ("depth_m", "verdict"), [(500.0, CONFLICT), (99.0, GRAZING), (0.0, GRAZING), (-99.0, GRAZING), (-101.0, None)]
)
def test_depth_and_closeness_decide_at_a_tolerance(depth_m: float, verdict: int | None) -> None:
    """Past a box to the north of the equator, so deep in it, at a tolerance of 100 m."""
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=100.0)
    north = np.degrees((500.0 - depth_m) / 6371008.771415)
    box = scenes.area("A", shapely.box(0.5, north, 0.6, north + 0.1))
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 500.0, 500.0, 500.0, 500.0)
    pieces = pieces_of(scene, plane_of(scene), AreaBatch.of([box]), TrackBatch.of([track]))
    pairs = intersections(pieces, *candidates(pieces), regions=False)
    start, end = pieces.shared_span(pairs.a, pairs.b)
    found, effort = contacts(scene, plane_of(scene), pieces, pairs, np.zeros(len(pairs)), (end - start) / 1e6)
    assert set(found.verdict.tolist()) == (set() if verdict is None else {verdict})
    if depth_m in (500.0, 99.0, -101.0):
        assert effort.searched_pairs == 0
    if verdict is not None:
        assert (found.touches == (depth_m >= 0.0)).all()
    assert UNRESOLVED not in found.verdict


def test_a_pair_of_points_is_left_to_the_search() -> None:
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0)
    size = dict.fromkeys(("fore", "aft", "port", "starboard"), 0.0)
    tracks = [
        scenes.track("T", [(0, 0), (1, 0)], [0, 3600], **size),
        scenes.track("U", [(1, 0), (0, 0)], [0, 3600], **size),
    ]
    (group,) = [g for g in groups(scene, [], tracks) if len(g.pairs)][:1]
    solution = group.solved(TOUCH_M)
    assert solution.ended(Outcome.UNDECIDED).all()


def test_no_pairs_are_settled_as_none() -> None:
    """An empty batch of pairs is settled, too."""
    scene = Scene("s", tolerance_m=0.0)
    box = scenes.area("A", shapely.box(0, 0, 1, 1))
    pieces = area_pieces(scene, plane_of(scene), AreaBatch.of([box]))
    none = Pairs(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 2)), np.zeros(1, np.int64))
    found, effort = contacts(scene, plane_of(scene), pieces, none, np.empty(0), np.empty(0))
    assert len(found) == effort.searched_pairs == 0
