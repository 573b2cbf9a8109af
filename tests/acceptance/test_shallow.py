"""Shallow contacts: polygons that overlap by centimetres to metres while they glide past each other.

Ends are as accurate as rounding allows, and the bound says so: the rounding error of positions divided by the pair's
closing speed there. A pair of depth d and relative acceleration k closes at sqrt(2 d k).
"""

import numpy as np
import oracle
import pytest
import shapely
from layouts import HARBOUR, HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE, METRES_PER_DEGREE, Workload
from mixed_scenes import plain_scene
from mpmath import mp, mpf
from precise import separation
from test_grazing import edge_of_contact, moved
from verdicts import CERTIFIED, Reported, compare, solved

from conflictdb.core.stage4.constants import TOUCH_M
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, EarthModel, Scene, Track, rectangle_outline_m

RESOLUTION_S = 1e-6
# A bound is at most this many times the rounding error of positions divided by the closing speed.
BOUND_TOUCHES = 10.0
PROBE_S = 0.01  # seconds before and after a contact at which the pair's distance shows how fast it closes
DEEPEST_M = (0.01, 10.0)

NMI = 1852.0
AREA = Area(
    "A",
    shapely.MultiPolygon(
        [
            shapely.Polygon(
                [
                    (179.6102133180436, 80.03960779470506),
                    (177.47845782644106, 80.1331676392761),
                    (179.9070582555958, 80.14671431755023),
                ]
            )
        ]
    ),
    start_us=1783215802119944,
    end_us=1783240458104308,
)
TRACK = Track(
    "T",
    np.array(
        [
            (178.06524336418323, 79.84656411217553),
            (-167.59682445285898, 81.45763866761438),
            (178.24304319809846, 82.49677284040301),
        ]
    ),
    np.array([1783213077955450, 1783243884507178, 1783269135814502]),
    rectangle_outline_m(
        1.361073410344995 * NMI, 0.3658990699657303 * NMI, 0.29231089789399617 * NMI, 4.407595023369367 * NMI
    ),
)
# In 50 digits: 1783216447.043012857 and 1783216759.329799652 s, 1.5 m deep at most.
CONTACT_US = (1783216447043012.857, 1783216759329799.652)


@pytest.mark.parametrize("method", CERTIFIED)
@pytest.mark.parametrize("tolerance_m", [0.0, 1.0, 10.0])
def test_corner_that_grazes_a_side_is_timed_to_the_microsecond(tolerance_m: float, method: Method) -> None:
    (found,) = solved(Scene("s", tolerance_m=tolerance_m, method=method), [AREA], [TRACK]).values()
    (period,) = found.periods_us
    assert period == (np.floor(CONTACT_US[0]), np.ceil(CONTACT_US[1]))
    assert found.time_error_s <= RESOLUTION_S


def true_ends_s(scene: Scene, track: Track, about_us: int, half_s: float, within_s: float) -> tuple[float, float]:
    """The ends of the contact of AREA and a track about an instant, seconds from it, in 30 digits, to 1e-7 s.

    By secants through two instants outside: the distance is convex. They stop on the other side, or halves take over.
    half_s : how far from the instant the ends are reported
    within_s : how far from these they are at most
    """

    def apart_m(instant: mpf) -> mpf:
        return separation(scene, AREA, track, instant, about_us)

    def end(side: int) -> float:
        within = mpf(10) ** -7
        inner, outer, farther = (side * (mpf(half_s) + k * mpf(within_s)) for k in (-1, 1, 2))
        gap, farther_gap = apart_m(outer), apart_m(farther)
        assert farther_gap > gap > 0 == apart_m(inner)
        while abs(outer - inner) > within:
            trial = outer - gap * (farther - outer) / (farther_gap - gap) - side * within / 2
            if not min(inner, outer) < trial < max(inner, outer):
                trial = (inner + outer) / 2
            if (trial_gap := apart_m(trial)) == 0:
                inner = trial
            else:
                outer, gap, farther, farther_gap = trial, trial_gap, outer, gap
        return float(inner)

    with mp.workdps(30):
        return end(-1), end(1)


def test_glancing_contacts_of_less_than_a_micrometre_follow_the_law() -> None:
    """The gap is k t^2 / 2 less the depth d; ends are reported at 3 r and certain at -r (accuracy.md)."""
    scene, last_touch_deg, deep_m, length_s = Scene("s", tolerance_m=0.0), -8.9557429916e-6, (2e-7, 1e-6, 4e-6), []
    for depth in deep_m:
        track = moved(TRACK, last_touch_deg + depth / METRES_PER_DEGREE)
        (found,) = solved(scene, [AREA], [track]).values()
        ((start_us, end_us),) = found.periods_us
        assert start_us is not None
        assert end_us is not None
        middle, half_s = (start_us + end_us) // 2, (end_us - start_us) / 2e6
        start_s, end_s = true_ends_s(scene, track, middle, half_s, found.time_error_s + 2.0 * RESOLUTION_S)
        off_s = max(start_s + half_s, half_s - end_s)
        assert -RESOLUTION_S <= off_s <= found.time_error_s + RESOLUTION_S
        length_s.append(end_s - start_s)
        # T^2 = 8 d / k: the growth of T gives k, and k gives the depth.
        if len(length_s) > 1:
            by_k = (length_s[-1] ** 2 - length_s[0] ** 2) / (depth - deep_m[0])
            share = TOUCH_M / (length_s[-1] ** 2 / by_k)
            law_s = 0.5 * length_s[-1] * (np.sqrt(1.0 + 3.0 * share) - np.sqrt(1.0 - share))
            assert 0.5 * law_s < found.time_error_s < 2.0 * law_s


def closing_mps(scene: Scene, one: Area | Track, other: Track, meeting: oracle.Meeting, end_s: float) -> float:
    """Speed at which the pair parts next to an end of its contact, metres of the plane per second."""
    apart = []
    with mp.workdps(30):
        for beside in (end_s - PROBE_S, end_s + PROBE_S):
            apart.append(separation(scene, one, other, mpf(beside), meeting.epoch_us))
    return float(max(gap for gap in apart if gap < mp.inf)) / PROBE_S


def shallow_problems(scene: Scene, other: Area | Track, track: Track) -> list[str]:
    """Errors of the answer for a pair that meets once or more: wrong ends, or a bound wider than the law above."""
    mine, theirs = ([other], [track]) if isinstance(other, Area) else ([], [other, track])
    pair = (other.key, track.key)
    meeting = oracle.meeting(scene, other, track, 20.0)
    reported: dict[tuple[str, str], Reported] = solved(scene, mine, theirs)
    result = compare(scene, {pair: meeting}, reported)
    wrong = result.wrong + ["unresolved"] * result.unresolved
    if not meeting.touches or pair not in reported:
        return wrong
    highest = np.abs(track.positions_deg[:, 1]).max() + 2.0
    touch_m = TOUCH_M / np.cos(np.radians(highest))
    slowest = min(closing_mps(scene, other, track, meeting, end) for ends in meeting.intervals for end in ends)
    if slowest > 0.0:  # a span that ends in contact shows no speed
        allowed = RESOLUTION_S + BOUND_TOUCHES * touch_m / slowest
        bound = reported[pair].time_error_s
        if bound > allowed:
            wrong.append(f"the bound is {bound} s, where {allowed} s are due at {slowest} m/s")
    return wrong


# Pairs of random scenes, and the northward shift of the track at which contact ends, from `edge_of_contact`.
EDGES = [
    (LOW_LATITUDE, 3, EarthModel.SPHERE, "A2", "T0", 0.1602096934322731),
    (LONG_LEGS, 4, EarthModel.WGS84, "A0", "T2", 0.17865612203291908),
    (HARBOUR, 2, EarthModel.WGS84, "A2", "T4", 0.0013066326872655056),
    (HIGH_LATITUDE, 3, EarthModel.SPHERE, "A2", "T0", 0.0813041461542858),
]


@pytest.mark.parametrize("tolerance_m", [0.0, 1.0])
@pytest.mark.parametrize(
    ("workload", "seed", "earth", "a", "b", "edge_deg"), EDGES, ids=lambda v: getattr(v, "name", None)
)
def test_bounds_of_shallow_contacts_follow_the_speed_at_which_they_begin(
    workload: Workload, seed: int, earth: EarthModel, a: str, b: str, edge_deg: float, tolerance_m: float
) -> None:
    scene, areas, tracks = plain_scene(workload, seed, 5, 5, earth, tolerance_m)
    things: dict[str, Area | Track] = {thing.key: thing for thing in (*areas, *tracks)}
    track = things[b]
    assert isinstance(track, Track)
    for deep_m in (0.05, 0.5, 5.0):
        assert not shallow_problems(scene, things[a], moved(track, edge_deg - deep_m / METRES_PER_DEGREE))


@pytest.mark.slow
@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("workload", [LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS, HARBOUR], ids=lambda w: w.name)
@pytest.mark.parametrize("seed", range(80, 84))
def test_shallow_contacts_sweep(workload: Workload, earth: EarthModel, seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene, areas, tracks = plain_scene(workload, seed, 6, 6, earth, float(rng.choice([0.0, 1.0, 10.0])))
    things: dict[str, Area | Track] = {thing.key: thing for thing in (*areas, *tracks)}
    meetings = oracle.meetings(scene, areas, tracks, 1.0)
    pairs = [pair for pair, meeting in meetings.items() if meeting.touches and pair[1].startswith("T")]
    wrong = []
    for a, b in pairs[:3]:
        track = things[b]
        assert isinstance(track, Track)
        edge_deg = edge_of_contact(scene, things[a], track)
        if edge_deg is None:
            continue
        for deep_m in np.exp(rng.uniform(*np.log(DEEPEST_M), 4)):
            problems = shallow_problems(scene, things[a], moved(track, edge_deg - deep_m / METRES_PER_DEGREE))
            wrong += [f"{(a, b)} {deep_m} m: {problem}" for problem in problems]
    assert not wrong
