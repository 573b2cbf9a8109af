"""Ships in line that close by less than a metre a day, compared with 60 digits.

A ship follows another on the same rhumb line, a little faster. Rounding of positions shifts times by seconds to hours
there. The reported bound must still be right, and a pair that stays further apart than rounding and the tolerance is
not reported.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from mpmath import mp, mpf
from precise import separation
from scenes import T0_US
from verdicts import ROUNDING_S, TOUCH_M, Reported, solved

from conflictdb.earth.geodesy import earth_of, rhumb_direct
from conflictdb.model.plans import EarthModel, Scene, Track, rectangle_outline_m
from conflictdb.model.results import Verdict

DIGITS = 60
SLOWEST_MPS, FASTEST_MPS = 1e-10, 1e-4
PAIRS = 20  # of a test
# Pairs whose search once ran out of room or budget, which left a touch in doubt as a period before the real one.
EXHAUSTED = (595, 4376, 6203, 6404, 6936)
TOLERANCES_M = (0.0, 1e-6, 1e-3, 1.0)
FURTHEST_LAT = 78.0
# Rounding of two places in degrees, metres: a pair may start this much nearer or further than intended.
LAYOUT_M = 1e-8


@dataclass(frozen=True)
class InLine:
    """Two tracks, the second ahead; all instants in seconds after T0."""

    scene: Scene
    tracks: tuple[Track, Track]
    last_s: float

    def apart_m(self, second: mpf) -> mpf:
        """Their distance in the plane, plane metres; 0 if they touch."""
        return separation(self.scene, *self.tracks, second, T0_US)


def in_line(rng: np.random.Generator) -> InLine:
    """Some meet in the middle of the leg, some come near at its end and do not."""
    scene = Scene("s", earth=rng.choice(list(EarthModel)), tolerance_m=float(rng.choice(TOLERANCES_M)))
    earth = earth_of(scene.earth)
    while True:
        last_s = float(np.rint(3600.0 * 10.0 ** rng.uniform(-1.0, 1.3)))
        start = 10.0, rng.uniform(-FURTHEST_LAT, FURTHEST_LAT)
        bearing = rng.choice([0.0, 90.0, 180.0, 270.0, *rng.uniform(0.0, 360.0, 4)])
        length_m = 10.0 ** rng.uniform(0.0, 2.3) * last_s
        lon, lat = rhumb_direct(earth, *start, bearing, length_m)
        if abs(lat) < FURTHEST_LAT and abs(lon - start[0]) < 170.0:
            break
    half_m = 10.0 ** rng.uniform(0.0, 3.0)
    closing_m = 10.0 ** rng.uniform(np.log10(SLOWEST_MPS), np.log10(FASTEST_MPS)) * last_s
    at_end_m = -closing_m * rng.uniform(0.05, 0.95) if rng.random() < 0.6 else 10.0 ** rng.uniform(-8.0, -2.0)
    ahead_m = 2.0 * half_m + at_end_m + closing_m, 2.0 * half_m + at_end_m
    places = [start, (lon, lat)]
    behind = np.array(places, np.float64)
    before = np.array([rhumb_direct(earth, *start, bearing, m) for m in (ahead_m[0], length_m + ahead_m[1])])
    times = np.array([T0_US, T0_US + round(last_s * 1e6)])
    outline = rectangle_outline_m(half_m, half_m, half_m, half_m)
    one, two = (Track(key, way, times, outline) for key, way in (("A", behind), ("B", before)))
    return InLine(scene, (one, two), last_s)


def problems(pair: InLine, found: Reported | None) -> list[str]:
    """Errors of an answer."""
    with mp.workdps(DIGITS):
        first_m, end_m = pair.apart_m(mpf(0)), pair.apart_m(mpf(pair.last_s))
        least_m = min(first_m, end_m)
        if found is None:
            within_m = max(0.99 * pair.scene.tolerance_m, 0.0)
            return [f"missed at {mp.nstr(least_m, 5)} m"] if least_m == 0 or TOUCH_M < least_m < within_m else []
        if least_m > 0:
            scale = 1.0 / float(mp.cos(mp.radians(FURTHEST_LAT)))
            if least_m > (pair.scene.tolerance_m + TOUCH_M) * scale:
                return [f"{found.verdict} at {mp.nstr(least_m, 5)} m"]
            return ["conflict of a pair that stays apart"] * (
                found.verdict is Verdict.CONFLICT and least_m > LAYOUT_M + TOUCH_M
            )
        if len(found.periods_us) != 1:
            return [f"{len(found.periods_us)} periods instead of one"]
        ((start_us, end_us),) = found.periods_us
        assert start_us is not None
        start, allowed = mpf(start_us - T0_US) / 1_000_000, mpf(found.time_error_s + ROUNDING_S)
        wrong = []
        if end_us != pair.tracks[0].times_us[1]:
            wrong.append(f"ends at {end_us}")
        if start - ROUNDING_S > 0 and pair.apart_m(start - ROUNDING_S) == 0:
            wrong.append(f"begins before {mp.nstr(start, 12)}")
        if pair.apart_m(min(start + allowed, mpf(pair.last_s))) > 0:
            wrong.append(f"begins more than {found.time_error_s} after {mp.nstr(start, 12)}")
        return wrong


@pytest.mark.parametrize(
    "first",
    [0, *(pytest.param(first, marks=pytest.mark.slow) for first in range(PAIRS, 1000, PAIRS))],
)
def test_in_line(first: int) -> None:
    found = [problem for seed in range(first, first + PAIRS) for problem in problems_of(seed)]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("seed", EXHAUSTED)
def test_in_line_that_takes_more_room_than_one_list_has_is_one_period(seed: int) -> None:
    assert problems_of(seed) == []


def problems_of(seed: int) -> list[str]:
    """Errors of the answer to a random pair."""
    pair = in_line(np.random.default_rng(seed))
    answer = solved(pair.scene, [], pair.tracks).get(("A", "B"))
    return [f"{seed}: {problem} ({answer})" for problem in problems(pair, answer)]
