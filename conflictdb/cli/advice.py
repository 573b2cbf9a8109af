"""`advise`: estimated cost and error of each setting for a scene."""

import argparse
import math
from dataclasses import asdict
from typing import Any

from conflictdb.cli.codes import DONE
from conflictdb.cli.output import out, print_json
from conflictdb.cli.session import database
from conflictdb.cli.tables import table, wrapped
from conflictdb.client.advise import Advice
from conflictdb.client.estimates import Count, Proportion, duration


def advise(args: argparse.Namespace) -> int:
    """Print the advice for a scene; changes nothing."""
    with database(args) as db:
        advice = db.scene(args.scene).advise(sample=args.sample)
    if args.format == "json":
        print_json(_finite(asdict(advice)))
    else:
        out(advice_text(advice))
    return DONE


def advice_text(advice: Advice) -> str:
    """Return the advice as a table and the recommendation."""
    scene = advice.scene
    if not advice.estimates:
        return f"{scene.name}: {advice.recommendation}"
    undecided = f"; exact at 0 m leaves {advice.undecided_pairs} of them unresolved" if advice.undecided_pairs else ""
    sample = f"sample: {advice.sampled_pairs:,} of {advice.pairs:,} pairs of objects that come near each other"
    header = ["METHOD", "TOLERANCE", "COST", "DATABASE", "CONFLICTS", "NEVER MEET", "TOO LONG: MEDIAN", "WORST"]
    header += ["ERROR BOUND", "UNRESOLVED"]
    rows = []
    for one in advice.estimates:
        method, tolerance_m = one.setting.method, one.setting.tolerance_m
        is_own = (method, tolerance_m) == (scene.method, scene.tolerance_m)
        times = (one.too_long_median_s, one.too_long_worst_s, one.time_error_s)
        rows.append(
            [
                f"{method}{' *' if is_own else ''}",
                f"{tolerance_m:g} m",
                duration(one.seconds),
                f"{100.0 * one.database_s / one.seconds:.0f} %",
                _count(one.conflicts),
                _share(one.false_share),
                *map(duration, times),
                _share(one.unresolved_share),
            ]
        )
    return "\n".join(
        [
            f"{scene.name}: {scene.method} on {scene.earth} at {scene.tolerance_m:g} m",
            wrapped(f"{sample}{undecided}; seed {advice.seed}"),
            "",
            table(header, rows, right=header[1:], extra=["DATABASE", "TOO LONG: MEDIAN"]),
            "",
            wrapped(advice.recommendation),
        ]
    )


def _count(count: Count) -> str:
    low, high = f"{count.low:,.0f}", f"{count.high:,.0f}"
    return f"{count.value:,.0f}" if low == high else f"{count.value:,.0f} ({low}-{high})"


def _share(share: Proportion) -> str:
    """Return a count, and its share of all in percent or its bound; only 0 if the share is certainly 0."""
    if share.high == 0.0:
        return "0"
    return f"{share.count} ({share})".replace("at most ", "≤").replace("at least ", "≥")


def _finite(value: Any) -> Any:
    """Return a value for JSON: null for NaN and infinities."""
    if isinstance(value, dict):
        return {name: _finite(member) for name, member in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(member) for member in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
