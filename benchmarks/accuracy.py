"""Speed against accuracy: the cost and the error of each method and tolerance, compared with brute force.

    ./.venv/bin/python benchmarks/accuracy.py [--document docs/explanation/accuracy.md] [--figure FILE.svg]

Workloads at low and at high latitudes and of long legs (tests/support/layouts.py), on the sphere and on WGS84, by
every method at tolerances of 1000, 10, 1 and 0 m. On the sphere also the paper's formulas of stage 3 as printed
(benchmarks/published.py), on whole legs as in the paper.

Cost: processor time of stages 3 and 4, up to the row per pair of objects, divided by the pairs of pieces with a track
that stages 1 and 2 leave at that tolerance. The divisor is the same for every method, so costs compare. All scenes of a
workload are solved together, as one large scene would be. The methods take turns; the result is the median of the
turns. A method that takes milliseconds per pair has one turn, on the scenes compared with brute force: its cost per
pair does not depend on their number. Read the ratios, not the microseconds.

Error: in the first scenes (--true), every pair of objects with a track is compared with tests/support/oracle.py, which
has no tolerance. An end is the first or the last contact of a pair that meets. *Unsafe* is the contact time before the
reported start or after the reported end. *Slack* is the reported time before the first or after the last contact. A
pair is false if it is reported as a conflict and never meets, or as grazing and stays further apart than the tolerance;
`screen` reports its pairs as unresolved.

Brute force takes minutes: --truth FILE stores its answers and reads them next time. --results FILE stores the numbers;
--redraw reads them from there and measures nothing. The figure needs matplotlib (CONTRIBUTING.md).
"""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from statistics import median
from typing import Final

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
import oracle
from layouts import HIGH_LATITUDE, LONG_LEGS, LOW_LATITUDE, Workload
from mixed_scenes import plain_scene
from numpy.typing import NDArray
from published import published_windows, whole_legs
from tables import markdown, show
from verdicts import ROUNDING_S, TOUCH_M, Reported, compare

from conflictdb import Area, Scene, Track, Verdict
from conflictdb.arrays.answers import Conflicts
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.run import run_stages
from conflictdb.core.stage1_broad_phase import candidates
from conflictdb.core.stage2_intersection import intersections
from conflictdb.earth.geodesy import earth_of
from conflictdb.earth.registry import Setup
from conflictdb.model.methods import Method
from conflictdb.model.plans import EarthModel

WORKLOADS: Final = (LOW_LATITUDE, HIGH_LATITUDE, LONG_LEGS)
TOLERANCES_M: Final = (1000.0, 10.0, 1.0, 0.0)
PUBLISHED: Final = "published"
UNBOUNDED: Final = (Method.SCREEN, PUBLISHED)  # state no bound on times
# Slower methods, seconds per pair, are timed once, and only on the scenes compared with brute force.
QUICK_S: Final = 2e-3
# Brute force resolves least separations up to this, plane metres: the largest tolerance at the largest scale.
CARE_M: Final = 15.0 * max(TOLERANCES_M)

Pair = tuple[str, str]
Answer = dict[Pair, Reported]

REFERENCE: Final = Method.EXACT.value
UNITS: Final = ((3600.0, "h"), (60.0, "min"), (1.0, "s"), (1e-3, "ms"))
HEADS: Final = (
    "method",
    "tolerance, m",
    f"cost, us a pair: {' / '.join(EarthModel)}",
    f"against `{REFERENCE}` at 0 m",
    "missed",
    "reported, do not meet",
    "false",
    "unresolved",
    "unsafe, worst",
    "slack: 95 % / worst",
    "widest bound",
)


@dataclass(frozen=True)
class Row:
    """Cost and error of one method at one tolerance.

    pair_us : microseconds of processor time of stages 3 and 4 per pair of pieces that stages 1 and 2 leave
    pieces : number of these pairs
    pairs, meet : pairs of objects compared with brute force; pairs of these that meet
    missed : pairs that meet and are not reported
    apart : pairs that are reported and do not meet
    false : pairs reported as a conflict or grazing that are neither
    unresolved : pairs reported as unresolved
    wrong : disagreements with the method's guarantee (see tests/support/verdicts.py); 0 for all but `published`
    unsafe_s, slack_s : 95 % and worst over the ends of all pairs that meet and are reported, seconds
    end_s : the larger of the two
    bound_s : the widest bound reported with a conflict, seconds
    """

    workload: str
    earth: str
    method: str
    tolerance_m: float | None
    pair_us: float
    pieces: int
    pairs: int
    meet: int
    missed: int
    apart: int
    false: int
    unresolved: int
    wrong: int
    unsafe_s: tuple[float, float]
    slack_s: tuple[float, float]
    end_s: tuple[float, float]
    bound_s: float


@dataclass(frozen=True)
class Scenes:
    """Scenes of one workload and earth, solved as one; object i of scene k has number k * objects + i of its kind."""

    scene: Scene
    thrown: list[tuple[list[Area], list[Track]]]

    @classmethod
    def of(cls, workload: Workload, earth: EarthModel, scenes: int, objects: int) -> "Scenes":
        """Return random scenes, each of as many areas as tracks."""
        found = [plain_scene(workload, seed, objects, objects, earth) for seed in range(scenes)]
        return cls(replace(found[0][0], tolerance_m=0.0), [(areas, tracks) for _, areas, tracks in found])

    @cached_property
    def _footprints(self) -> NDArray[np.object_]:
        return AreaBatch.of([area for areas, _ in self.thrown for area in areas]).footprint

    def batch(self, tolerance_m: float) -> tuple[Pieces, Pairs]:
        """Return all pieces, and the pairs of them with a track that stages 1 and 2 leave, within each scene."""
        scene = replace(self.scene, tolerance_m=tolerance_m)
        pieces, pairs, row, first = [], [], 0, 0
        for areas, tracks in self.thrown:
            own = pieces_of(Setup.of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
            met = intersections(own, *candidates(own), regions=True)
            met = met.take(np.flatnonzero(own.kind[met.a] | own.kind[met.b]))
            pairs.append(replace(met, a=met.a + row, b=met.b + row))
            pieces.append(replace(own, object_id=own.object_id + first))
            row, first = row + len(own), first + len(areas)
        ends = np.cumsum([0, *(len(some.region_xy) for some in pairs)])
        offset = [np.zeros(1, np.int64), *(p.region_offset[1:] + end for p, end in zip(pairs, ends, strict=False))]
        return Pieces.concatenate(pieces), Pairs(
            np.concatenate([p.a for p in pairs]),
            np.concatenate([p.b for p in pairs]),
            np.concatenate([p.region_xy for p in pairs]),
            np.concatenate(offset),
        )

    def footprints(self, numbers: NDArray[np.int64]) -> NDArray[np.object_]:
        """Return the footprints of some areas by number."""
        return self._footprints[numbers]

    def truth(self, count: int) -> dict[Pair, oracle.Meeting]:
        """Return the brute-force answer for every pair with a track in the first scenes."""
        found = {}
        for k, (areas, tracks) in enumerate(self.thrown[:count]):
            first = k * len(areas)
            for j, track in enumerate(tracks):
                for i, area in enumerate(areas):
                    found[f"A{first + i}", f"T{first + j}"] = oracle.meeting(self.scene, area, track, CARE_M)
                for i, other in enumerate(tracks[:j]):
                    found[f"T{first + i}", f"T{first + j}"] = oracle.meeting(self.scene, other, track, CARE_M)
        return found


def named(one: tuple[int, int], other: tuple[int, int]) -> Pair:
    """Return the names of a pair of (kind, number), the area or else the smaller number first."""
    (kind, number), (other_kind, other_number) = sorted((one, other))
    return f"{'AT'[kind]}{number}", f"{'AT'[other_kind]}{other_number}"


def by_name(found: Conflicts) -> Answer:
    """Return an answer as `verdicts.compare` reads it."""
    answer = {}
    for k in range(len(found)):
        pair = named((found.a_kind[k], found.a_id[k]), (found.b_kind[k], found.b_id[k]))
        periods = found.period_us[found.period_offset[k] : found.period_offset[k + 1]].tolist()
        periods_us = tuple((start, end) for start, end in periods)
        answer[pair] = Reported(Verdict.of_code(int(found.verdict[k])), periods_us, float(found.time_error_s[k]))
    return answer


def published_answer(scenes: Scenes) -> tuple[Answer, float]:
    """Return the answer of the formulas as printed, and the seconds it took."""
    with whole_legs():
        pieces, pairs = scenes.batch(0.0)
    started = time.process_time()
    first, last = published_windows(earth_of(scenes.scene.earth), pieces, pairs, mended=False)
    seconds = time.process_time() - started
    zero, _ = pieces.shared_span(pairs.a, pairs.b)
    answer: Answer = {}
    for k in np.flatnonzero(first <= last).tolist():
        a, b = pairs.a[k], pairs.b[k]
        pair = named((pieces.kind[a], pieces.object_id[a]), (pieces.kind[b], pieces.object_id[b]))
        start, end = int(zero[k] + first[k] * 1e6), int(zero[k] + last[k] * 1e6)
        known = answer[pair].periods_us[0] if pair in answer else (start, end)
        answer[pair] = Reported(Verdict.CONFLICT, ((min(start, known[0]), max(end, known[1])),), 0.0)
    return answer, seconds


def rows_of(
    workload: Workload, scenes: Scenes, truth: dict[Pair, oracle.Meeting], true_count: int, turns: int
) -> list[Row]:
    """Return the rows of one workload and earth; slow methods are timed once, on the scenes of brute force."""
    few = replace(scenes, thrown=scenes.thrown[:true_count])
    rows: list[Row] = []
    for tolerance_m in TOLERANCES_M:
        scene = replace(scenes.scene, tolerance_m=tolerance_m)
        batches = few.batch(tolerance_m), scenes.batch(tolerance_m)
        answers, seconds = {}, {}
        for method in Method:
            answers[method], spent = timed(replace(scene, method=method), batches[0], scenes)
            seconds[method] = [spent]
        quick = [method for method in Method if seconds[method][0] < QUICK_S * len(batches[0][1])]
        for turn in range(turns):
            for method in quick:
                spent = timed(replace(scene, method=method), batches[1], scenes)[1]
                seconds[method] = [*(seconds[method] if turn else []), spent]
        for method in Method:
            pieces = len(batches[method in quick][1])
            rows.append(row_of(workload, scene, method, truth, by_name(answers[method]), seconds[method], pieces))
    if scenes.scene.earth is EarthModel.SPHERE:
        published = [published_answer(scenes)[1] for _ in range(turns)]
        answer = published_answer(few)[0]
        rows.append(row_of(workload, scenes.scene, None, truth, answer, published, len(batches[1][1])))
    return rows


def timed(scene: Scene, batch: tuple[Pieces, Pairs], scenes: Scenes) -> tuple[Conflicts, float]:
    """Return the answer of stages 3 and 4, and the seconds of processor time they took."""
    started = time.process_time()
    found, _ = run_stages(Setup.of(scene), *batch, scenes.footprints)
    return found, time.process_time() - started


def row_of(
    workload: Workload,
    scene: Scene,
    method: Method | None,
    truth: dict[Pair, oracle.Meeting],
    answer: Answer,
    seconds: Sequence[float],
    pieces: int,
) -> Row:
    """Return a row: the measured cost, and the answer compared with the truth."""
    unsafe: list[float] = []
    slack: list[float] = []
    apart = false = missed = 0
    for pair, meeting in truth.items():
        reported = answer.get(pair)
        if not meeting.touches:
            apart += reported is not None
            allowed_m = {Verdict.CONFLICT: 0.0, Verdict.GRAZING: scene.tolerance_m, Verdict.UNRESOLVED: np.inf}
            false += reported is not None and meeting.least_m > allowed_m[reported.verdict] + TOUCH_M
        elif reported is None:
            # An instant at the very end of a span may be there or not.
            missed += max(end - start for start, end in meeting.intervals) > ROUNDING_S
        else:
            reported_us, true_us = (
                np.asarray(spans, np.float64) for spans in (reported.periods_us, meeting.intervals_us)
            )
            for before in ((reported_us[0, 0] - true_us[0, 0]) / 1e6, (true_us[-1, 1] - reported_us[-1, 1]) / 1e6):
                unsafe.append(max(before, 0.0))
                slack.append(max(-before, 0.0))
    conflicts = [reported.time_error_s for reported in answer.values() if reported.verdict is Verdict.CONFLICT]
    return Row(
        workload=workload.name,
        earth=scene.earth.value,
        method=method.value if method else PUBLISHED,
        tolerance_m=scene.tolerance_m if method else None,
        pair_us=1e6 * median(seconds) / pieces,
        pieces=pieces,
        pairs=len(truth),
        meet=sum(meeting.touches for meeting in truth.values()),
        missed=int(missed),
        apart=apart,
        false=int(false),
        unresolved=sum(reported.verdict is Verdict.UNRESOLVED for reported in answer.values()),
        wrong=len(compare(scene, truth, answer).wrong),
        unsafe_s=spread(unsafe),
        slack_s=spread(slack),
        end_s=spread(np.maximum(unsafe, slack)),
        bound_s=max(conflicts, default=0.0),
    )


def spread(values: Sequence[float] | NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % quantile and the largest; 0 of nothing."""
    return (float(np.quantile(values, 0.95, method="higher")), float(np.max(values))) if len(values) else (0.0, 0.0)


def table(rows: Sequence[Row]) -> str:
    """Return one table per workload in Markdown, both earths in one row."""
    parts = []
    for workload in dict.fromkeys(row.workload for row in rows):
        own = [row for row in rows if row.workload == workload]
        order = [*(method.value for method in Method), PUBLISHED]
        settings = sorted(dict.fromkeys((row.method, row.tolerance_m) for row in own), key=lambda s: order.index(s[0]))
        by_earth = {(row.method, row.tolerance_m, row.earth): row for row in own}
        reference = {row.earth: row.pair_us for row in own if row.method == REFERENCE and row.tolerance_m == 0.0}
        lines = []
        for method, tolerance_m in settings:
            both = [by_earth[key] for earth in EarthModel if (key := (method, tolerance_m, earth.value)) in by_earth]
            lines.append(
                [
                    f"`{method}`" if method != PUBLISHED else "as published (sphere)",
                    f"{tolerance_m:g}" if tolerance_m is not None else "",
                    " / ".join(number(row.pair_us) for row in both),
                    " / ".join(number(row.pair_us / reference[row.earth]) for row in both),
                    *(
                        f"{sum(getattr(row, name) for row in both)}"
                        for name in ("missed", "apart", "false", "unresolved")
                    ),
                    duration(max(row.unsafe_s[1] for row in both)),
                    " / ".join(duration(max(row.slack_s[k] for row in both)) for k in (0, 1)),
                    duration(max(row.bound_s for row in both)) if method not in UNBOUNDED else "",
                ]
            )
        earths = [next(row for row in own if row.earth == earth.value) for earth in EarthModel]
        pieces = " / ".join(f"{row.pieces:,}" for row in earths)
        parts.append(
            f"**{workload}**: {sum(row.pairs for row in earths):,} pairs of objects held to brute force, "
            f"{sum(row.meet for row in earths)} of them meet; cost over {pieces} pairs of pieces\n\n"
            + markdown(HEADS, lines)
        )
    return "\n\n".join(parts)


def number(value: float) -> str:
    """Return a number with two digits, three from 100 on."""
    return f"{float(f'{value:.3g}'):,.0f}" if value >= 100.0 else f"{value:.2g}"


def duration(seconds: float) -> str:
    """Return a time in words; 0 if it is below the rounding to microseconds."""
    if seconds <= ROUNDING_S:
        return "0"
    unit, name = next(((unit, name) for unit, name in UNITS if seconds >= unit), (1e-6, "us"))
    return f"{number(seconds / unit) if seconds < 9.95 * unit else f'{seconds / unit:.0f}'} {name}"


def kept_truth(path: Path | None, scenes: dict[str, Scenes], count: int) -> dict[str, dict[Pair, oracle.Meeting]]:
    """Return the brute-force answers, by workload and earth; from a file if it exists, else stored in it."""
    if path and path.exists():
        held = json.loads(path.read_text())
    else:
        held = {
            name: [(pair, asdict(meeting)) for pair, meeting in own.truth(count).items()]
            for name, own in scenes.items()
        }
        if path:
            path.write_text(json.dumps(held))
    return {
        name: {
            (pair[0], pair[1]): oracle.Meeting(**{**known, "intervals": tuple(map(tuple, known["intervals"]))})
            for pair, known in pairs
        }
        for name, pairs in held.items()
    }


def main() -> None:
    """Measure, or read stored numbers; print the table, and write the requested files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", type=int, default=10, help="areas, and as many tracks, per scene")
    parser.add_argument("--scenes", type=int, default=80, help="per workload and earth")
    parser.add_argument("--true", type=int, default=12, help="of them held to brute force")
    parser.add_argument("--turns", type=int, default=3, help="times that each method is timed")
    parser.add_argument("--truth", type=Path, help="keep the truth in this file, and read it next time")
    parser.add_argument("--results", type=Path, help="keep the numbers in this file")
    parser.add_argument("--redraw", action="store_true", help="measure nothing: take the numbers from --results")
    parser.add_argument("--document", type=Path, help="put the tables into their place in this document")
    parser.add_argument("--figure", type=Path, help="draw the figure into this file (needs matplotlib)")
    args = parser.parse_args()
    if args.figure:
        import accuracy_figure  # reports how to install a missing matplotlib before anything is measured
    if args.redraw:
        rows = [Row(**row) for row in json.loads(args.results.read_text())]
    else:
        scenes = {
            f"{workload.name}, {earth}": Scenes.of(workload, earth, args.scenes, args.objects)
            for workload in WORKLOADS
            for earth in EarthModel
        }
        truths = kept_truth(args.truth, scenes, args.true)
        rows = []
        for workload in WORKLOADS:
            for earth in EarthModel:
                name = f"{workload.name}, {earth}"
                rows += rows_of(workload, scenes[name], truths[name], args.true, args.turns)
                print(f"measured: {name}", file=sys.stderr, flush=True)
    if args.results:
        args.results.write_text(json.dumps([asdict(row) for row in rows], indent=1))
    text = table(rows)
    show(text, "accuracy", args.document)
    if args.figure:
        accuracy_figure.draw(rows, args.figure)
    wrong = [row for row in rows if row.method != PUBLISHED and row.wrong + row.missed]
    if wrong:
        sys.exit(f"guarantees broken: {wrong}")


if __name__ == "__main__":
    main()
