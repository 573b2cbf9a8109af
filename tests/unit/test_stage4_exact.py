"""The kernel's shortcuts compared with its search, which shares none of them, and with answers known by hand."""

import signal
import sys
from dataclasses import dataclass

import numpy as np
import pytest
import scenes
import shapely
from layouts import EQUATOR, HARBOUR, HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE
from mixed_scenes import plain_scene
from staged import Staged

from conflictdb import kernel
from conflictdb.arrays.answers import Contacts
from conflictdb.core.stage4.contact_search import CONFLICT, GRAZING, UNRESOLVED, contacts
from conflictdb.kernel import Questions, Work
from conflictdb.kernel.meeting import distances
from conflictdb.model.plans import Area, EarthModel, Scene, Track

DEGREE = scenes.parallel_m(EarthModel.SPHERE, 0.0)


@dataclass(frozen=True)
class Batch:
    """All pairs with a track that pass stages 1 and 2, timed from the start of their shared spans."""

    scene: Scene
    prepared: kernel.KernelScene
    questions: Questions

    @classmethod
    def of(cls, scene: Scene, areas: list[Area], tracks: list[Track]) -> "Batch":
        staged = Staged.of(scene, areas, tracks)
        pieces, pairs = staged.pieces, staged.pairs
        start, span = staged.spans()
        every = Questions(pairs.a, pairs.b, start, np.zeros(len(pairs)), span, np.full(len(pairs), np.inf))
        moving = np.flatnonzero((pieces.kind[pairs.a] == 1) | (pieces.kind[pairs.b] == 1))
        return cls(scene, staged.prepared, every.take(moving))

    def solved(self, work: Work | None = None) -> Contacts:
        scene = self.scene
        return kernel.contacts(self.prepared, self.questions, scene.separation_m, scene.tolerance_m, work or Work())

    def searched(self, work: Work) -> Contacts:
        """The same without a shortcut: a `guess` function that returns no guesses makes the kernel search all pairs."""
        scene = self.scene
        asked = (scene.separation_m, scene.tolerance_m, work)
        return kernel.contacts(self.prepared, self.questions, *asked, guess=lambda *_: float("nan"))

    def clearance_m(self, pair: np.ndarray, at_s: np.ndarray) -> np.ndarray:
        some = self.questions.take(pair)
        return distances(self.prepared, some.a, some.b, some.zero_us, at_s) - self.scene.separation_m


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize(
    ("workload", "tolerance_m", "separation_m"),
    [
        (LOW_LATITUDE, 0.0, 0.0),
        (HIGH_LATITUDE, 1.0, 0.0),
        (LONG_LEGS, 20.0, 0.0),
        (EQUATOR, 0.0, 0.0),
        (EQUATOR, 1000.0, 0.0),
        (LOW_LATITUDE, 1000.0, 0.0),
        (HARBOUR, 0.0, 0.0),
        (HARBOUR, 30.0, 0.0),
        (LOW_LATITUDE, 0.0, 3000.0),
        (LOW_LATITUDE, 1000.0, 3000.0),
        (HIGH_LATITUDE, 1.0, 1000.0),
        (HIGH_LATITUDE, 0.0, 300.0),
    ],
    ids=lambda value: getattr(value, "name", value),
)
def test_what_is_certain_is_what_the_search_finds(
    workload: object, tolerance_m: float, separation_m: float, earth: EarthModel
) -> None:
    """The same contacts with the same verdicts, ends that agree within both bounds; hardly any pair is searched."""
    batch = Batch.of(*plain_scene(workload, 4, 12, 12, earth, tolerance_m, separation_m))
    work, all_work = Work(), Work()
    certain, found = batch.solved(work), batch.searched(all_work)
    for name in ("pair", "verdict", "touches"):
        assert getattr(certain, name).tolist() == getattr(found, name).tolist()
    allowed = certain.error_s + found.error_s + 1e-7
    assert (np.abs(certain.start_s - found.start_s) <= allowed).all()
    assert (np.abs(certain.end_s - found.end_s) <= allowed).all()
    assert all_work.searched_pairs == len(batch.questions)
    assert work.searched_pairs <= 0.1 * len(batch.questions)
    assert (certain.verdict == CONFLICT).sum() >= 5


def test_an_interrupt_while_programs_are_asked_is_neither_lost_nor_said_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may come just as the kernel calls Python: where no `try` could catch an exception of a handler."""
    batch = Batch.of(*plain_scene(HIGH_LATITUDE, 4, 30, 30, EarthModel.WGS84, 0.0))
    lost: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lost.append)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    def search_again_and_again(until_s: float) -> None:
        signal.setitimer(signal.ITIMER_REAL, until_s)
        for _ in range(500):
            batch.searched(Work())

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for k in range(30):
            with pytest.raises(KeyboardInterrupt):
                search_again_and_again(0.001 + 0.0002 * k)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert lost == []


@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS], ids=lambda w: w.name)
def test_bounds_at_tolerance_0_are_below_a_microsecond_where_polygons_meet_at_a_speed(workload: object) -> None:
    batch = Batch.of(*plain_scene(workload, 7, 25, 25, EarthModel.WGS84, 0.0))
    found = batch.solved()
    assert (found.verdict == CONFLICT).sum() >= 50
    wide = np.flatnonzero(found.error_s > 1e-6)
    if wide.size:
        # Change of the distance in the second before and after either end.
        pair, slow = found.pair[wide], np.zeros(len(wide), np.bool_)
        for end in (found.start_s[wide], found.end_s[wide]):
            slow |= np.abs(batch.clearance_m(pair, end + 1.0) - batch.clearance_m(pair, end - 1.0)) < 1.5
        assert slow.all()


@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS], ids=lambda w: w.name)
@pytest.mark.parametrize("separation_m", [0.0, 500.0])
def test_a_larger_tolerance_takes_no_more_work(workload: object, separation_m: float) -> None:
    """Counted: a coarser answer costs no more than an exact one, also where depths are just about the tolerance."""
    exact = None
    for tolerance_m in (0.0, 1.0, 100.0, 1000.0):
        work = Work()
        Batch.of(*plain_scene(workload, 11, 20, 30, EarthModel.WGS84, tolerance_m, separation_m)).solved(work)
        steps = work.windows + work.evaluations
        exact = exact or steps
        assert steps <= 1.25 * exact


def test_uniform_motion_takes_the_closed_form() -> None:
    """A haven along the equator, through a box: answers by hand, without one evaluation of the true motion."""
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0)
    box = scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 4000.0, 2000.0, 500.0, 500.0)
    work = Work()
    Batch.of(scene, [box], [track]).solved(work)
    assert work.closed_forms >= 1
    assert work.windows == work.evaluations == 0
    staged = Staged.of(scene, [box], [track])
    found, _ = staged.contacts()
    seconds = (staged.spans()[0][found.pair] - scenes.T0_US) / 1e6
    assert (seconds + found.start_s).min() == pytest.approx((0.5 - 4000 / DEGREE) * 3600, abs=1e-6)
    assert (seconds + found.end_s).max() == pytest.approx((0.6 + 2000 / DEGREE) * 3600, abs=1e-6)
    assert found.error_s.max() < 1e-6


def test_a_window_of_one_instant_is_looked_at() -> None:
    """In the middle of a contact: it is one, and as short."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    box = scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 4000.0, 2000.0, 500.0, 500.0)
    staged = Staged.of(scene, [box], [track])
    start, span_s = staged.spans()
    gone_s = (scenes.T0_US + int(0.55 * 3600e6) - start) / 1e6
    row = np.flatnonzero((gone_s >= 0.0) & (gone_s <= span_s))[:1]
    at_s = gone_s[row]
    found, _ = contacts(staged.setup, staged.prepared, staged.pairs.take(row), at_s, at_s)
    assert found.verdict.tolist() == [CONFLICT]
    assert found.start_s == found.end_s == at_s


def test_answers_do_not_depend_on_the_company() -> None:
    """Each pair alone, bit for bit as among all others."""
    batch = Batch.of(*plain_scene(HIGH_LATITUDE, 3, 8, 8, EarthModel.WGS84, 1.0))
    together = batch.solved()
    for row in range(len(batch.questions)):
        alone = Batch(batch.scene, batch.prepared, batch.questions.take(np.array([row]))).solved()
        for name in ("start_s", "end_s", "error_s", "verdict", "touches"):
            assert getattr(alone, name).tolist() == getattr(together, name)[together.pair == row].tolist()


@pytest.mark.parametrize(
    ("depth_m", "verdict"), [(500.0, CONFLICT), (99.0, GRAZING), (0.0, GRAZING), (-99.0, GRAZING), (-101.0, None)]
)
def test_depth_and_closeness_decide_at_a_tolerance(depth_m: float, verdict: int | None) -> None:
    """Past a box to the north of the equator, so deep in it, at a tolerance of 100 m."""
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=100.0)
    north = np.degrees((500.0 - depth_m) / 6371008.771415)
    box = scenes.area("A", shapely.box(0.5, north, 0.6, north + 0.1))
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], 500.0, 500.0, 500.0, 500.0)
    found, effort = Staged.of(scene, [box], [track]).contacts()
    assert set(found.verdict.tolist()) == (set() if verdict is None else {verdict})
    if depth_m in (500.0, 99.0, -101.0):
        assert effort.exact.searched_pairs == 0
    if verdict is not None:
        assert (found.touches == (depth_m >= 0.0)).all()
    assert UNRESOLVED not in found.verdict


def test_a_pair_of_points_is_left_to_the_search() -> None:
    """Head-on on the equator: they touch in the middle, for an instant."""
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0)
    size = dict.fromkeys(("fore", "aft", "port", "starboard"), 0.0)
    tracks = [
        scenes.track("T", [(0, 0), (1, 0)], [0, 3600], **size),
        scenes.track("U", [(1, 0), (0, 0)], [0, 3600], **size),
    ]
    batch, work = Batch.of(scene, [], tracks), Work()
    found = batch.solved(work)
    assert work.searched_pairs == len(batch.questions) > 0
    assert set(found.verdict.tolist()) == {GRAZING}
    seconds = (batch.questions.zero_us[found.pair] - scenes.T0_US) / 1e6
    assert (seconds + found.start_s).tolist() == pytest.approx([1800.0] * len(found), abs=1e-5)


def test_no_pairs_are_settled_as_none() -> None:
    """An empty batch of pairs is settled, too."""
    found, effort = Staged.of(Scene("s", tolerance_m=0.0), [scenes.area("A", shapely.box(0, 0, 1, 1))], []).contacts()
    assert len(found) == effort.exact.searched_pairs == 0
