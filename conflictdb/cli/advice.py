"""`advise`: estimated cost and error of each setting for a scene."""

import argparse
import math
from dataclasses import asdict
from typing import Any

from conflictdb.advice.advise import Advice, Estimate
from conflictdb.advice.estimates import Count, Share, duration, percent
from conflictdb.cli.codes import DONE
from conflictdb.cli.output import data, out, progress, table
from conflictdb.cli.session import database
from conflictdb.io.json_text import dumped

_STAGES = ("pieces_s", "stage1_s", "stage2_s", "stage3_s", "stage4_s", "write_s")


def advise(args: argparse.Namespace) -> int:
    """Print the advice for a scene; changes nothing."""
    with database(args) as db:
        advice = db.scene(args.scene).advise(sample=args.sample, seed=args.seed, progress=_show)
    progress("")
    if args.format == "json":
        data([dumped(_members(advice), indent=2), "\n"], is_json=True)
    else:
        out(advice_text(advice))
    return DONE


def _show(done: int, total: int) -> None:
    progress(f"trying settings: {done} of {total}" if done < total else "")


def advice_text(advice: Advice) -> str:
    """Return the advice as tables: cost, then errors, then the recommendation."""
    scene = advice.scene
    if not advice.estimates:
        return f"{scene.name}: {advice.recommendation}"
    looked_at = f"all {advice.objects:,} objects"
    if advice.objects_looked_at < advice.objects:
        looked_at = f"{advice.objects_looked_at:,} of {advice.objects:,} objects, drawn at random"
    nlp = "" if advice.nlp_pairs == advice.sampled_pairs else f" (nlp, which is dear: on {advice.nlp_pairs} of them)"
    far = {one.setting.tolerance_m: one.sampled_pairs for one in advice.estimates}
    others = [f"{m:g} m: {n} pairs that come that near" for m, n in sorted(far.items()) if m > advice.nearby_m]
    undecided = f"; the truth leaves {advice.undecided_pairs} of them open" if advice.undecided_pairs else ""
    sample = f"sample: {advice.sampled_pairs:,} of {_count(advice.pairs)} pairs of objects that come near each other"
    return "\n".join(
        [
            f"{scene.name}: {scene.method} on {scene.earth} at {scene.tolerance_m:g} m",
            "; ".join([f"{sample}{nlp}", *others, looked_at, f"seed {advice.seed}"]),
            "",
            "Cost of a full detection, estimated: processor time of one process, and the share of each stage",
            _cost_table(advice),
            "",
            f"Wrong, on the sample, against exact at 0 m on {scene.earth}{undecided}; in brackets what share of all",
            _wrong_table(advice),
            "",
            advice.recommendation,
        ]
    )


def _cost_table(advice: Advice) -> str:
    header = ["METHOD", "EARTH", "TOLERANCE", "COST", "PIECES", "1", "2", "3", "4", "WRITE", "CONFLICTS"]
    rows = [
        [
            *_setting(advice, estimate),
            duration(estimate.cost.total_s),
            *(f"{100.0 * getattr(estimate.cost, stage) / estimate.cost.total_s:.0f} %" for stage in _STAGES),
            _count(estimate.conflicts),
        ]
        for estimate in advice.estimates
    ]
    return table(header, rows, right=header[2:])


def _wrong_table(advice: Advice) -> str:
    header = ["METHOD", "EARTH", "TOLERANCE", "REPORTED", "NEVER MEET", "MISSED", "TOO LONG: MEDIAN", "95 %", "WORST"]
    header += ["TOO SHORT", "ERROR BOUND", "UNRESOLVED"]
    rows = []
    for estimate in advice.estimates:
        wrong = estimate.wrong
        times = (wrong.slack_median_s, wrong.slack_p95_s, wrong.slack_worst_s, wrong.short_worst_s, wrong.time_error_s)
        rows.append(
            [
                *_setting(advice, estimate),
                wrong.reported,
                _share(estimate.false_share),
                _share(estimate.missed_share),
                *map(duration, times),
                _share(estimate.unresolved_share),
            ]
        )
    return table(header, rows, right=header[2:])


def _setting(advice: Advice, estimate: Estimate) -> list[object]:
    setting, scene = estimate.setting, advice.scene
    is_own = (setting.method, setting.earth, setting.tolerance_m) == (scene.method, scene.earth, scene.tolerance_m)
    return [f"{setting.method}{' *' if is_own else ''}", setting.earth, f"{setting.tolerance_m:g} m"]


def _count(count: Count) -> str:
    low, high = f"{count.low:,.0f}", f"{count.high:,.0f}"
    return f"{count.value:,.0f}" if low == high else f"{count.value:,.0f} ({low}-{high})"


def _share(share: Share) -> str:
    """Return a count, and its share of all in percent or its bound; only 0 if the share is certainly 0."""
    if share.high == 0.0:
        return "0"
    return f"{share.count} ({percent(share).replace('at most ', '≤').replace('at least ', '≥')})"


def _members(advice: Advice) -> dict[str, Any]:
    """Return the advice for JSON: the members of `Advice`, with sums; null for NaN and infinities."""
    members = _finite(asdict(advice))
    for estimate, shown in zip(advice.estimates, members["estimates"], strict=True):
        shown["cost"]["total_s"] = estimate.cost.total_s
        for name in ("false_share", "unresolved_share", "missed_share"):
            shown[name] = {"value": _finite(getattr(estimate, name).value), **shown[name]}
    return dict(members)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(member) for name, member in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(member) for member in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
