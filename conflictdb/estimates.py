"""The statistics of advice: how wrong one answer is against another, what a sample says of a whole scene, in words.

Arrays and numbers in, numbers and a sentence out; what is sampled, and how, is in `advise`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb.batches import Conflicts
from conflictdb.geodesy import Floats
from conflictdb.model import EarthModel, Method, Verdict

# What is saved counts from this share of the cost, and from this time: less is within what timing itself varies by.
WORTH_SHARE: Final = 0.1
WORTH_S: Final = 0.5
# A detection that takes longer than this is not waited for at a desk: look first with what takes less than half.
PATIENCE_S: Final = 60.0

# More pairs cost at least this share of what the first ones did on average: less was chance in the timing.
LEAST_SLOPE: Final = 0.1
# (below so many seconds, the unit to tell a duration in, its seconds)
_UNITS: Final = (
    (0.9995e-3, "us", 1e-6),
    (0.9995, "ms", 1e-3),
    (120.0, "s", 1.0),
    (7200.0, "min", 60.0),
    (172_800.0, "h", 3600.0),
    (math.inf, "d", 86_400.0),
)
_MORE_OR_LESS: Final = ("less", "more")
_UNRESOLVED: Final = list(Verdict).index(Verdict.UNRESOLVED)


@dataclass(frozen=True, slots=True)
class Setting:
    """A choice of method, earth and tolerance (metres); the rest stays as the scene has it."""

    method: Method
    earth: EarthModel
    tolerance_m: float


@dataclass(frozen=True, slots=True)
class Count:
    """A number in the whole scene, estimated, and its standard error; 0 where all of the scene was counted."""

    value: float
    standard_error: float


@dataclass(frozen=True, slots=True)
class Cost:
    """Processor seconds of a full detection of the scene in one process, by stage; `write_s` is the rest."""

    pieces_s: float
    stage1_s: float
    stage2_s: float
    stage3_s: float
    stage4_s: float
    write_s: float

    @property
    def total_s(self) -> float:
        """Seconds of all stages."""
        return self.pieces_s + self.stage1_s + self.stage2_s + self.stage3_s + self.stage4_s + self.write_s


@dataclass(frozen=True, slots=True)
class Wrongness:
    """How an answer on the sampled pairs of objects differs from the true one (`exact` at tolerance 0).

    reported : pairs of objects that the answer reports
    false_pairs : of these, pairs that do not meet
    missed_pairs : pairs that meet and are not reported: 0 but for another earth
    unresolved : reported pairs that it does not decide
    slack_median_s, slack_p95_s, slack_worst_s : how much too early pairs that meet start, or too late they end, over
        both ends of each, seconds; NaN where none meets
    short_worst_s : how much too late one starts or too early it ends, seconds: 0 but for another earth
    time_error_s : widest bound that the answer itself states, seconds
    """

    reported: int
    false_pairs: int
    missed_pairs: int
    unresolved: int
    slack_median_s: float
    slack_p95_s: float
    slack_worst_s: float
    short_worst_s: float
    time_error_s: float

    @property
    def false_share(self) -> float:
        """Share of the reported pairs that do not meet; 0 where none is reported."""
        return self.false_pairs / self.reported if self.reported else 0.0


@dataclass(frozen=True, slots=True)
class Estimate:
    """What one setting would cost for the whole scene, and how wrong it is on the sample.

    sampled_pairs : pairs of objects that it was tried on
    candidate_pairs, intersecting_pairs, solved_pairs : pairs of pieces after stages 1 and 2, and given to stage 4
    conflicts : pairs of objects that would be reported
    false_share_error : standard error of `wrong.false_share`
    """

    setting: Setting
    sampled_pairs: int
    candidate_pairs: Count
    intersecting_pairs: Count
    solved_pairs: Count
    conflicts: Count
    cost: Cost
    wrong: Wrongness
    false_share_error: float


@dataclass(frozen=True, slots=True)
class Answer:
    """What a setting says of n pairs of objects that it reports.

    pair : (n,) numbers of the pairs, each once
    first_us, last_us : (n,) start of the first period and end of the last
    is_unresolved : (n,) whether it leaves open that they meet
    time_error_s : (n,) bound on the error of the ends of periods
    """

    pair: NDArray[np.int64]
    first_us: NDArray[np.int64]
    last_us: NDArray[np.int64]
    is_unresolved: NDArray[np.bool_]
    time_error_s: Floats

    @classmethod
    def of(cls, conflicts: Conflicts, pair: NDArray[np.int64]) -> "Answer":
        """Return conflicts as an answer; `pair` numbers their pairs of objects. Pairs that only come near are none."""
        first, after = conflicts.period_offset[:-1], conflicts.period_offset[1:]
        rows = np.flatnonzero(after > first)
        return cls(
            pair[rows],
            conflicts.period_us[first[rows], 0],
            conflicts.period_us[after[rows] - 1, 1],
            conflicts.verdict[rows] == _UNRESOLVED,
            conflicts.time_error_s[rows],
        )

    def take(self, rows: NDArray[np.int64]) -> "Answer":
        """Return what it says of some of its pairs."""
        return Answer(*(getattr(self, column.name)[rows] for column in fields(self)))

    def among(self, pair: NDArray[np.int64]) -> "Answer":
        """Return what it says of these pairs only."""
        return self.take(np.flatnonzero(np.isin(self.pair, pair)))


def wrongness(found: Answer, truth: Answer) -> Wrongness:
    """Return how `found` differs from `truth`, both on the same pairs of objects.

    Pairs that the truth leaves unresolved are neither false nor missed, nor do their periods count.
    """
    meets = truth.take(np.flatnonzero(~truth.is_unresolved))
    _, at, of = np.intersect1d(found.pair, meets.pair, assume_unique=True, return_indices=True)
    early = _later_s(meets.first_us[of], found.first_us[at])
    late = _later_s(found.last_us[at], meets.last_us[of])
    outward = np.concatenate([early, late])
    slack = np.maximum(outward, 0.0)
    median, most, worst = np.quantile(slack, [0.5, 0.95, 1.0]).tolist() if len(slack) else [math.nan] * 3
    return Wrongness(
        reported=len(found.pair),
        false_pairs=int((~np.isin(found.pair, truth.pair)).sum()),
        missed_pairs=int((~np.isin(meets.pair, found.pair)).sum()),
        unresolved=int(found.is_unresolved.sum()),
        slack_median_s=median,
        slack_p95_s=most,
        slack_worst_s=worst,
        short_worst_s=float(np.max(-outward, initial=0.0)),
        time_error_s=float(np.max(found.time_error_s, initial=0.0)),
    )


def _later_s(one: NDArray[np.int64], other: NDArray[np.int64]) -> Floats:
    """Return one - other, seconds; 0 where both are the same end of time, also for ever."""
    return np.where(one == other, 0.0, (one.astype(np.float64) - other.astype(np.float64)) / 1e6)


def whole(of_pair: Floats, frame: int, scale: float, object_error: float) -> Count:
    """Return the total over a scene, from its value for each of some pairs of objects.

    Parameters
    ----------
    of_pair : (n,) values of pairs drawn at random, without repetition, from `frame` pairs
    scale : how often the scene holds what the frame holds: pairs of all objects for one of the objects looked at
    object_error : relative standard error of `scale` times the frame's own total (see `object_error`)
    """
    n = len(of_pair)
    if n == 0:
        return Count(0.0, 0.0)
    total = frame * scale * float(np.mean(of_pair))
    spread = float(np.std(of_pair, ddof=1)) if n > 1 else abs(float(of_pair[0]))
    drawn = frame * scale * spread / math.sqrt(n) * math.sqrt(1.0 - n / frame)
    return Count(total, math.hypot(drawn, total * object_error))


def object_error(degree: Floats, objects: int) -> float:
    """Return the relative standard error of a number of pairs that was counted among some of the objects.

    degree : (m,) how many pairs each of the m objects looked at is part of, of `objects` in all

    A mean over pairs of independent objects is a U-statistic of order 2: to first order its error is twice that of the
    mean over objects (Hoeffding 1948).
    """
    m = len(degree)
    mean = float(np.mean(degree)) if m else 0.0
    if m < 2 or m >= objects or mean == 0.0:
        return 0.0
    return 2.0 * float(np.std(degree, ddof=1)) / mean / math.sqrt(m) * math.sqrt(1.0 - m / objects)


def share_error(share: float, n: int, sampled: int, frame: int) -> float:
    """Return the standard error of a share of n pairs, found among `sampled` pairs of `frame`."""
    return math.sqrt(share * (1.0 - share) / n * (1.0 - sampled / frame)) if n else 0.0


def extrapolated_s(once_s: float, copies_s: float, copies: int, pairs: int, whole_pairs: float) -> float:
    """Return the seconds that `whole_pairs` pairs take, from what some pairs took, and so many copies of them together.

    What a batch costs beyond its pairs is paid once: what the copies took more is the cost of more pairs, as far as two
    timings can be trusted. Without copies cost is proportional.
    """
    if pairs == 0:
        return 0.0
    mean = once_s / pairs
    slope = (copies_s - once_s) / ((copies - 1) * pairs) if copies > 1 else mean
    return once_s + min(max(slope, LEAST_SLOPE * mean), mean) * (whole_pairs - pairs)


def recommendation(estimates: Sequence[Estimate], method: Method, earth: EarthModel, tolerance_m: float) -> str:
    """Return in one or two sentences what the numbers say to somebody whose scene has these settings."""
    at = {estimate.setting: estimate for estimate in estimates}
    exact = at[Setting(Method.EXACT, earth, tolerance_m)]
    saved = {
        other: exact.cost.total_s - at[Setting(other, earth, tolerance_m)].cost.total_s
        for other in (Method.WINDOW, Method.SCREEN)
    }
    least = max(WORTH_S, WORTH_SHARE * exact.cost.total_s)
    cheaper = max(saved, key=lambda other: saved[other])
    rough = " and ".join(
        f"{other} would {_saving(saved[other], least)} and {_falsehood(at[Setting(other, earth, tolerance_m)].wrong)}"
        for other in saved
        if other == cheaper or saved[other] >= least
    )
    if exact.cost.total_s > PATIENCE_S and saved[cheaper] > 0.5 * exact.cost.total_s:
        advice = f"look with {cheaper} whether there is trouble, and use exact for what goes into an order"
    else:
        advice = "stay with exact" if method == Method.EXACT else "use exact"
    return (
        f"exact costs {duration(exact.cost.total_s)} for this scene; {rough}: {advice}.{_tolerance_advice(at, exact)}"
    )


def _tolerance_advice(at: dict[Setting, Estimate], exact: Estimate) -> str:
    """Return a sentence where a smaller tolerance reports fewer pairs that do not meet: the largest that does best."""
    smaller = [
        one
        for setting, one in at.items()
        if (setting.method, setting.earth) == (exact.setting.method, exact.setting.earth)
        and setting.tolerance_m < exact.setting.tolerance_m
        and one.wrong.false_pairs < exact.wrong.false_pairs
    ]
    if not smaller:
        return ""
    best = min(smaller, key=lambda one: (one.wrong.false_pairs, -one.setting.tolerance_m))
    more = best.cost.total_s - exact.cost.total_s
    costs = (
        "at about the same cost" if abs(more) < WORTH_S else f"for {duration(abs(more))} {_MORE_OR_LESS[more > 0.0]}"
    )
    return (
        f" Of the pairs that exact reports at {exact.setting.tolerance_m:g} m {_percent(exact.wrong.false_share)} come "
        f"close and do not meet; at {best.setting.tolerance_m:g} m {_percent(best.wrong.false_share)} would, {costs}."
    )


def _saving(seconds: float, least: float) -> str:
    if seconds < 0.0:
        return f"cost {duration(-seconds)} more"
    return f"save {'' if seconds >= least else 'only '}{duration(seconds)}"


def _falsehood(wrong: Wrongness) -> str:
    if not wrong.false_pairs:
        return f"report no pair that never meets, but periods up to {duration(wrong.slack_worst_s)} too long"
    return f"report pairs of which {_percent(wrong.false_share)} never meet"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share else "none"


def duration(seconds: float) -> str:
    """Return a duration to two or three digits in the unit that suits it; a dash where there is none."""
    if math.isnan(seconds):
        return "-"
    if math.isinf(seconds):
        return "unbounded"
    if seconds < 0.5e-6:
        return "0"
    unit, in_s = next((unit, in_s) for below, unit, in_s in _UNITS if seconds < below)
    value = seconds / in_s
    return f"{value:.0f} {unit}" if value >= 9.95 else f"{value:.1f} {unit}"
