"""The error and cost of settings as numbers with intervals, and in words."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import scipy.special  # scipy.optimize of stage 4 has loaded it already

from conflictdb.model.methods import Method

# A longer detection is too slow to wait for: recommend a first look with a method that takes less than half.
PATIENCE_S: Final = 60.0
CONFIDENCE: Final = 0.95  # of the intervals
# (upper bound of seconds, unit, its seconds)
_UNITS: Final = (
    (0.9995e-3, "us", 1e-6),
    (0.9995, "ms", 1e-3),
    (120.0, "s", 1.0),
    (7200.0, "min", 60.0),
    (172_800.0, "h", 3600.0),
    (math.inf, "d", 86_400.0),
)


@dataclass(frozen=True, slots=True)
class Trial:
    """A method and a tolerance (metres); all else is as in the scene."""

    method: Method
    tolerance_m: float


@dataclass(frozen=True, slots=True)
class Proportion:
    """The number of sampled pairs with a property, and the 95 % interval of their share among all pairs of the scene.

    Without sampled pairs (`of` is 0) the interval is [0, 1]; if all pairs were sampled it is the share itself.
    """

    count: int
    of: int
    low: float
    high: float

    @classmethod
    def sampled(cls, count: int, of: int, fraction: float) -> "Proportion":
        """Return the share of `count` pairs among `of`, drawn without repetition; `fraction` of all pairs are drawn.

        The exact interval of a binomial share (Clopper and Pearson 1934) with finite population correction. It contains
        the truth in at least 95 % of all samples, also if none or all of the pairs have the property.
        """
        if of == 0:
            return cls(count, of, 0.0, 1.0)
        value, others, tail = count / of, of - count, 0.5 * (1.0 - CONFIDENCE)
        low = float(scipy.special.betaincinv(count, others + 1.0, tail)) if count else 0.0
        high = float(scipy.special.betaincinv(count + 1.0, others, 1.0 - tail)) if others else 1.0
        narrowing = math.sqrt(max(1.0 - fraction, 0.0))
        return cls(count, of, value - narrowing * (value - low), value + narrowing * (high - value))

    def __str__(self) -> str:
        """Return the interval in percent; the share itself if it is certain."""
        if not self.of:
            return "-"
        if self.low == self.high:
            return {0.0: "none", 1.0: "all"}.get(self.low, f"{_percent(self.low)} %")
        if self.low == 0.0:
            return f"at most {_percent(self.high)} %"
        return (
            f"{_percent(self.low)}-{_percent(self.high)} %" if self.high < 1.0 else f"at least {_percent(self.low)} %"
        )


@dataclass(frozen=True, slots=True)
class Count:
    """An estimated number in the whole scene and its 95 % interval; all three are equal if all was counted."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimated cost of one setting for the whole scene, and its error on the sample.

    seconds : processor time of a full detection that changes every row
    database_s : the part of `seconds` that the database takes: by rule of thumb, not measured
    candidate_pairs, intersecting_pairs : pairs of pieces after stages 1 and 2
    conflicts : pairs of objects that would be reported
    false_share, unresolved_share : shares of the reported pairs that do not meet, and that it does not decide
    too_long_median_s, too_long_worst_s : how much too early periods start, or too late they end, over both ends of each
        pair that meets, seconds; NaN if none meets
    time_error_s : widest error bound in the answer, seconds
    """

    setting: Trial
    seconds: float
    database_s: float
    candidate_pairs: float
    intersecting_pairs: float
    conflicts: Count
    false_share: Proportion
    unresolved_share: Proportion
    too_long_median_s: float
    too_long_worst_s: float
    time_error_s: float


def recommendation(estimates: Sequence[Estimate], method: Method, tolerance_m: float) -> str:
    """Return one or two sentences of advice for a scene with these settings."""
    at = {one.setting: one for one in estimates}
    exact, screen = (at[Trial(one, tolerance_m)] for one in (Method.EXACT, Method.SCREEN))
    if exact.seconds > max(PATIENCE_S, 2.0 * screen.seconds):
        advice = "look with screen whether there is trouble, and use exact for what goes into an order"
    else:
        advice = "stay with exact" if method == Method.EXACT else "use exact"
    text = (
        f"exact costs {duration(exact.seconds)} for this scene; screen costs {duration(screen.seconds)}, "
        f"{screen.false_share} of its pairs never meet, and its periods are up to "
        f"{duration(screen.too_long_worst_s)} too long: {advice}."
    )
    finer = [one for one in estimates if one.setting.method == Method.EXACT and one.setting.tolerance_m < tolerance_m]
    # The largest of the smaller tolerances that does best.
    best = min([exact, *finer], key=lambda one: (one.false_share.count, -one.setting.tolerance_m))
    if best is not exact:
        text += (
            f" Of the pairs that exact reports at {tolerance_m:g} m {exact.false_share} come close and do not meet; "
            f"at {best.setting.tolerance_m:g} m {best.false_share} would, for {duration(best.seconds)}."
        )
    return text


def _percent(share: float) -> str:
    """Return percent to two digits, never rounded to 0 or 100."""
    return f"{100.0 * share:.2g}" if share < 0.995 else f"{min(100.0 * share, 99.99):.4g}"


def duration(seconds: float) -> str:
    """Return a duration to two or three digits in a suitable unit; a dash for NaN."""
    if not math.isfinite(seconds):
        return "-" if math.isnan(seconds) else "unbounded"
    if seconds < 0.5e-6:
        return "0"
    unit, in_s = next((unit, in_s) for below, unit, in_s in _UNITS if seconds < below)
    value = seconds / in_s
    return f"{value:.0f} {unit}" if value >= 9.95 else f"{value:.1f} {unit}"
