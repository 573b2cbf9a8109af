"""Compute the statistics of advice: errors of one answer against another, estimates for the whole scene, and sentences.

The input is arrays and numbers; `advise` does the sampling.
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

# Savings count from this share of the cost, and from this time: less is within the noise of timing.
WORTH_SHARE: Final = 0.1
WORTH_S: Final = 0.5
# A longer detection is too slow to wait for: recommend a first look with a method that takes less than half.
PATIENCE_S: Final = 60.0

# Least cost of one more pair, as a share of the mean cost: less is noise of timing.
LEAST_SLOPE: Final = 0.1
# (upper bound of seconds, unit, its seconds)
_UNITS: Final = (
    (0.9995e-3, "us", 1e-6),
    (0.9995, "ms", 1e-3),
    (120.0, "s", 1.0),
    (7200.0, "min", 60.0),
    (172_800.0, "h", 3600.0),
    (math.inf, "d", 86_400.0),
)
_MORE_OR_LESS: Final = ("less", "more")
# Confidence level of the intervals, and the matching number of standard errors of a mean.
CONFIDENCE: Final = 0.95
_ERRORS: Final = 1.959964


@dataclass(frozen=True, slots=True)
class Setting:
    """A method, earth and tolerance (metres); all else is as in the scene."""

    method: Method
    earth: EarthModel
    tolerance_m: float


@dataclass(frozen=True, slots=True)
class Count:
    """An estimated number in the whole scene and its 95 % interval; all three are equal if all was counted."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Share:
    """The number of sampled pairs with a property, and the 95 % interval of their share in the whole scene.

    Without sampled pairs (`of` is 0) the interval is [0, 1]; if the whole scene was counted it is the share itself.
    """

    count: int
    of: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """Share in the sample; NaN if the sample is empty."""
        return self.count / self.of if self.of else math.nan

    @classmethod
    def certain(cls, count: int, of: int) -> "Share":
        """Return a share without sampling error."""
        return cls(count, of, *([count / of] * 2 if of else [0.0, 1.0]))


@dataclass(frozen=True, slots=True)
class Sampling:
    """The sampling of pairs of objects.

    fraction : share of the scene's pairs that were drawn; 1: all
    effect : design effect (1 or more): pairs that share objects of a random subset count as n / effect independent
        pairs
    """

    fraction: float
    effect: float

    @property
    def narrowing(self) -> float:
        """The finite population correction: factor on the width of intervals."""
        return math.sqrt(max(1.0 - self.fraction, 0.0))

    def share(self, count: int, of: int) -> Share:
        """Return the share of `count` pairs among `of` drawn ones.

        The exact interval of a binomial share (Clopper and Pearson 1934) for the effective number of pairs (Korn and
        Graubard 1998), with finite population correction. It contains the truth in at least 95 % of all samples, also
        if none or all of the pairs have the property.
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
    """Differences of an answer on the sampled pairs of objects from the reference (`exact` at tolerance 0).

    reported : pairs of objects that the answer reports
    false_pairs : of these, pairs that do not meet
    meeting_pairs : pairs that meet
    missed_pairs : of these, pairs that are not reported; 0 on the scene's own earth
    unresolved : reported pairs that it does not decide
    slack_median_s, slack_p95_s, slack_worst_s : how much too early periods start, or too late they end, over both ends
        of each meeting pair, seconds; NaN if none meets
    short_worst_s : how much too late one starts or too early it ends, seconds; 0 on the scene's own earth
    time_error_s : widest error bound in the answer, seconds
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
    """The estimated cost of one setting for the whole scene, and its error on the sample.

    sampled_pairs : pairs of objects that it was tried on
    candidate_pairs, intersecting_pairs, solved_pairs : pairs of pieces after stages 1 and 2, and given to stage 4
    conflicts : pairs of objects that would be reported
    false_share, unresolved_share : shares of the reported pairs that do not meet, and that it does not decide
    missed_share : share of the meeting pairs that it does not report
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
    """The answer of a setting: the n pairs of objects that it reports.

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
        """Return conflicts as an answer, without pairs that are only near; `pair` numbers their pairs of objects."""
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
        """Return the rows of some pairs."""
        return Answer(*(getattr(self, column.name)[rows] for column in fields(self)))

    def among(self, pair: NDArray[np.int64]) -> "Answer":
        """Return the rows of these pairs only."""
        return self.take(np.flatnonzero(np.isin(self.pair, pair)))


def errors_of(found: Answer, truth: Answer) -> Errors:
    """Return the differences of `found` from `truth`, on the same pairs of objects.

    Pairs that the truth leaves unresolved are neither false nor missed, and their periods are not compared.
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
    """Return one - other, seconds; 0 where both are equal, also if unbounded."""
    return np.where(one == other, 0.0, (one.astype(np.float64) - other.astype(np.float64)) / 1e6)


def whole(of_pair: Floats, all_pairs: float, sampling: Sampling, object_error: float, typical: float) -> Count:
    """Return the total over a scene, from its value for each of some pairs of objects.

    The share of pairs with a positive value and their mean are estimated separately, and the errors of both are added
    in squares on either side (Zou and Donner 2008): a total of 0 has an interval too.

    Parameters
    ----------
    of_pair : (n,) values of the pairs drawn, 0 or more
    all_pairs : number of pairs in the scene from which they were drawn
    object_error : relative standard error of `all_pairs` (see `object_error`)
    typical : mean to assume if all values are 0
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
    """Return the relative standard error of a number of pairs counted among a subset of the objects.

    degree : (m,) number of pairs of each of the m objects in the subset, of `objects` in all

    A mean over pairs of independent objects is a U-statistic of order 2: to first order its error is twice that of the
    mean over objects (Hoeffding 1948).
    """
    m = len(degree)
    mean = float(np.mean(degree)) if m else 0.0
    if m < 2 or m >= objects or mean == 0.0:
        return 0.0
    return 2.0 * float(np.std(degree, ddof=1)) / mean / math.sqrt(m) * math.sqrt(1.0 - m / objects)


def extrapolated_s(once_s: float, copies_s: float, copies: int, pairs: int, whole_pairs: float) -> float:
    """Return the seconds that `whole_pairs` pairs take, from the times of `pairs` pairs and of `copies` copies of them.

    Fixed costs of a batch are paid once: the extra time of the copies is the cost of more pairs, within the trust in
    two timings. Without copies cost is proportional.
    """
    if pairs == 0:
        return 0.0
    mean = once_s / pairs
    slope = (copies_s - once_s) / ((copies - 1) * pairs) if copies > 1 else mean
    return once_s + min(max(slope, LEAST_SLOPE * mean), mean) * (whole_pairs - pairs)


def recommendation(estimates: Sequence[Estimate], method: Method, earth: EarthModel, tolerance_m: float) -> str:
    """Return one or two sentences of advice for a scene with these settings."""
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
    """Return a sentence if a smaller tolerance reports fewer false pairs: on the largest such that does best."""
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
    """Return the interval of a share in percent, as text; the share itself if it is certain."""
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
    """Return percent to two digits, never rounded to 0 or 100."""
    return f"{100.0 * share:.2g}" if share < 0.995 else f"{min(100.0 * share, 99.99):.4g}"


def duration(seconds: float) -> str:
    """Return a duration to two or three digits in a suitable unit; a dash for NaN."""
    if math.isnan(seconds):
        return "-"
    if math.isinf(seconds):
        return "unbounded"
    if seconds < 0.5e-6:
        return "0"
    unit, in_s = next((unit, in_s) for below, unit, in_s in _UNITS if seconds < below)
    value = seconds / in_s
    return f"{value:.0f} {unit}" if value >= 9.95 else f"{value:.1f} {unit}"
