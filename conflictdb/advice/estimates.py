"""The statistics of advice: how wrong one answer is against another, what a sample says of a whole scene, in words.

Arrays and numbers in, numbers and a sentence out; what is sampled, and how, is in `advise`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
import scipy.special  # scipy.optimize of stage 4 has loaded it already
from numpy.typing import NDArray

from conflictdb.arrays.answers import Conflicts
from conflictdb.earth.geodesy import Floats
from conflictdb.methods import Method
from conflictdb.model import EarthModel
from conflictdb.results import Verdict

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
# How often the intervals that are told hold what the whole scene has, and the standard errors that this is of a mean.
CONFIDENCE: Final = 0.95
_ERRORS: Final = 1.959964


@dataclass(frozen=True, slots=True)
class Setting:
    """A choice of method, earth and tolerance (metres); the rest stays as the scene has it."""

    method: Method
    earth: EarthModel
    tolerance_m: float


@dataclass(frozen=True, slots=True)
class Count:
    """A number in the whole scene, estimated, and its 95 % interval; all three are one where everything was counted."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Share:
    """How many of the sampled pairs that could be so are so, and the 95 % interval of their share in the whole scene.

    Where nothing could be so the interval is everything; where all of the scene was counted it is the share itself.
    """

    count: int
    of: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """Share on the sample; NaN where nothing could be so."""
        return self.count / self.of if self.of else math.nan

    @classmethod
    def certain(cls, count: int, of: int) -> "Share":
        """Return a share that no sample can change."""
        return cls(count, of, *([count / of] * 2 if of else [0.0, 1.0]))


@dataclass(frozen=True, slots=True)
class Sampling:
    """How pairs of objects were drawn.

    fraction : of all such pairs of the scene that were drawn: 1 is all of them
    effect : pairs that tell as much as one alone, where pairs of a random part of the objects share some (1 or more)
    """

    fraction: float
    effect: float

    @property
    def narrowing(self) -> float:
        """By how much intervals are narrower than those of a sample of a scene without end."""
        return math.sqrt(max(1.0 - self.fraction, 0.0))

    def share(self, count: int, of: int) -> Share:
        """Return the share of `count` pairs among `of` drawn ones.

        The exact interval of a binomial share (Clopper and Pearson 1934) for as many pairs as count for one each (Korn
        and Graubard 1998), narrowed by what was drawn of all: it holds the truth in at least 95 % of all samples, also
        where none or all of the pairs are so.
        """
        if of == 0 or self.fraction >= 1.0:
            return Share.certain(count, of)
        value, some, others = count / of, count / self.effect, (of - count) / self.effect
        tail = 0.5 * (1.0 - CONFIDENCE)
        low = float(scipy.special.betaincinv(some, others + 1.0, tail)) if some else 0.0
        high = float(scipy.special.betaincinv(some + 1.0, others, 1.0 - tail)) if others else 1.0
        return Share(count, of, value - self.narrowing * (value - low), value + self.narrowing * (high - value))


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
class Errors:
    """How an answer on the sampled pairs of objects differs from the true one (`exact` at tolerance 0).

    reported : pairs of objects that the answer reports
    false_pairs : of these, pairs that do not meet
    meeting_pairs : pairs that meet
    missed_pairs : of these, pairs that are not reported: 0 but for another earth
    unresolved : reported pairs that it does not decide
    slack_median_s, slack_p95_s, slack_worst_s : how much too early pairs that meet start, or too late they end, over
        both ends of each, seconds; NaN where none meets
    short_worst_s : how much too late one starts or too early it ends, seconds: 0 but for another earth
    time_error_s : widest bound that the answer itself states, seconds
    """

    reported: int
    false_pairs: int
    meeting_pairs: int
    missed_pairs: int
    unresolved: int
    slack_median_s: float
    slack_p95_s: float
    slack_worst_s: float
    short_worst_s: float
    time_error_s: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """What one setting would cost for the whole scene, and how wrong it is on the sample.

    sampled_pairs : pairs of objects that it was tried on
    candidate_pairs, intersecting_pairs, solved_pairs : pairs of pieces after stages 1 and 2, and given to stage 4
    conflicts : pairs of objects that would be reported
    false_share, unresolved_share : of the pairs that it reports, those that do not meet, and those it does not decide
    missed_share : of the pairs that meet, those that it does not report
    """

    setting: Setting
    sampled_pairs: int
    candidate_pairs: Count
    intersecting_pairs: Count
    solved_pairs: Count
    conflicts: Count
    cost: Cost
    wrong: Errors
    false_share: Share
    unresolved_share: Share
    missed_share: Share


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
            conflicts.verdict[rows] == Verdict.UNRESOLVED.code,
            conflicts.time_error_s[rows],
        )

    def take(self, rows: NDArray[np.int64]) -> "Answer":
        """Return what it says of some of its pairs."""
        return Answer(*(getattr(self, column.name)[rows] for column in fields(self)))

    def among(self, pair: NDArray[np.int64]) -> "Answer":
        """Return what it says of these pairs only."""
        return self.take(np.flatnonzero(np.isin(self.pair, pair)))


def errors_of(found: Answer, truth: Answer) -> Errors:
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
    return Errors(
        reported=len(found.pair),
        false_pairs=int((~np.isin(found.pair, truth.pair)).sum()),
        meeting_pairs=len(meets.pair),
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


def whole(of_pair: Floats, all_pairs: float, sampling: Sampling, object_error: float, typical: float) -> Count:
    """Return the total over a scene, from its value for each of some pairs of objects.

    How many pairs have a value at all and how much it is on average are estimated apart, and the errors of both added
    in squares on either side (Zou and Donner 2008): a total of nothing has an interval too.

    Parameters
    ----------
    of_pair : (n,) values of the pairs drawn, 0 or more
    all_pairs : pairs in the scene of those from which they were drawn
    object_error : relative standard error of `all_pairs` (see `object_error`)
    typical : a value, for where all are 0
    """
    some = of_pair[of_pair > 0.0]
    share = sampling.share(len(some), len(of_pair))
    if not share.of:
        return Count(0.0, 0.0, 0.0)
    mean = float(np.mean(some)) if len(some) else typical
    spread = float(np.std(some, ddof=1)) / math.sqrt(len(some)) if len(some) > 1 else 0.0
    mean_error = _ERRORS * sampling.narrowing * math.sqrt(sampling.effect) * spread * share.value
    shared_error = math.hypot(mean_error, _ERRORS * object_error * share.value * mean)
    below = math.hypot(mean * (share.value - share.low), shared_error)
    above = math.hypot(mean * (share.high - share.value), shared_error)
    value = share.value * mean
    return Count(all_pairs * value, all_pairs * max(value - below, 0.0), all_pairs * (value + above))


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
    screen = at[Setting(Method.SCREEN, earth, tolerance_m)]
    saved_s = exact.cost.total_s - screen.cost.total_s
    least_s = max(WORTH_S, WORTH_SHARE * exact.cost.total_s)
    rough = f"screen would {_saving(saved_s, least_s)} and {_falsehood(screen)}"
    if exact.cost.total_s > PATIENCE_S and saved_s > 0.5 * exact.cost.total_s:
        advice = "look with screen whether there is trouble, and use exact for what goes into an order"
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
        f" Of the pairs that exact reports at {exact.setting.tolerance_m:g} m {percent(exact.false_share)} come "
        f"close and do not meet; at {best.setting.tolerance_m:g} m {percent(best.false_share)} would, {costs}."
    )


def _saving(seconds: float, least: float) -> str:
    if seconds < 0.0:
        return f"cost {duration(-seconds)} more"
    return f"save {'' if seconds >= least else 'only '}{duration(seconds)}"


def _falsehood(one: Estimate) -> str:
    if not one.wrong.false_pairs:
        never = f" (at most {_number(one.false_share.high)} % of all)" if one.false_share.high else ""
        return f"report no pair that never meets{never}, but periods up to {duration(one.wrong.slack_worst_s)} too long"
    return f"report pairs of which {percent(one.false_share)} never meet"


def percent(share: Share) -> str:
    """Return the interval of a share in percent, in words; the share itself where it is certain."""
    value, low, high = share.value, share.low, share.high
    if math.isnan(value):
        return "-"
    if low == high:
        return {0.0: "none", 1.0: "all"}.get(value, f"{_number(value)} %")
    if low == 0.0:
        return f"at most {_number(high)} %"
    if high == 1.0:
        return f"at least {_number(low)} %"
    return f"{_number(low)}-{_number(high)} %"


def _number(share: float) -> str:
    """Return percent to two digits, never rounded to what is certain: neither to 0 nor to 100."""
    return f"{100.0 * share:.2g}" if share < 0.995 else f"{min(100.0 * share, 99.99):.4g}"


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
