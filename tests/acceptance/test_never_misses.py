"""No stage may miss: random scenes of every workload, detected in the database, compared with the oracle.

Stage 3 here is that of method `nlp`; the closed form is tested with stage 4. See also test_dense, test_adversary and
test_grazing.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import oracle
import psycopg
import pytest
from layouts import WORKLOADS
from mixed_scenes import plain_scene
from staged import Staged
from verdicts import Pair, Period, Reported, by_pair, compared, microseconds, solved

from conflictdb import store
from conflictdb.core.published.stage3_projection import windows
from conflictdb.jobs.detect import detect
from conflictdb.model.methods import Method
from conflictdb.model.plans import INFINITY_US, MINUS_INFINITY_US, Area, EarthModel, Scene, Track
from conflictdb.model.results import Kind, Verdict

OBJECTS = 8  # areas, and as many tracks, per scene
WORST_S = 10.0  # bound on an end of any pair: some random pairs hardly touch
USUAL_S = 1e-6  # of half of the pairs in conflict
QUICK = [(workload.name, k, list(EarthModel)[k % 2]) for k, workload in enumerate(WORKLOADS)]
SLOW = [(workload.name, seed, earth) for workload in WORKLOADS for seed in range(100, 106) for earth in EarthModel]
CASES = [pytest.param(*case, id="-".join(map(str, case))) for case in QUICK]
CASES += [pytest.param(*case, id="-".join(map(str, case)), marks=pytest.mark.slow) for case in SLOW]

cases = pytest.mark.parametrize(("workload", "seed", "earth"), CASES)


@cache
def thrown(workload: str, seed: int, earth: EarthModel) -> tuple[Scene, list[Area], list[Track]]:
    return plain_scene(next(w for w in WORKLOADS if w.name == workload), seed, OBJECTS, OBJECTS, earth)


@cache
def truth(workload: str, seed: int, earth: EarthModel) -> dict[Pair, oracle.Meeting]:
    return oracle.meetings(*thrown(workload, seed, earth), care_m=20.0)


def detected(conn: psycopg.Connection[Any], scene: Scene) -> dict[Pair, Reported]:
    """Detect a loaded scene, and return the rows of the view, by pair."""
    detect(conn, scene.name, jobs=1)
    rows = store.conflicts(conn, scene.name)
    assert all(row.is_current for row in rows)
    return by_pair(rows)


def assert_covered(meetings: dict[Pair, oracle.Meeting], periods: dict[Pair, Iterable[Period]]) -> None:
    """Every contact lies within the periods, unbounded ones included, without any allowance but the microsecond."""
    for pair, meeting in meetings.items():
        for start_us, end_us in meeting.intervals_us:
            assert pair in periods, f"{pair} is missed: {meeting}"
            assert any(
                (low is None or low <= start_us + 1.0) and (high is None or end_us - 1.0 <= high)
                for low, high in periods[pair]
            ), f"{pair}: {start_us, end_us} is not within {periods[pair]}"


@cases
def test_stages_one_and_two_never_miss(
    conn: psycopg.Connection[Any], workload: str, seed: int, earth: EarthModel
) -> None:
    """The SQL function `candidates` returns every pair that meets, with a time span that contains its contacts."""
    scene, areas, tracks = thrown(workload, seed, earth)
    store.replace_scene(conn, replace(scene, method=Method.SCREEN), areas, tracks, merge=False)
    screened = detected(conn, scene)
    rows = conn.execute(
        "SELECT a_key, b_key, lower(span), upper(span) FROM conflictdb.candidates(%s), unnest(spans) span",
        [scene.name],
    ).fetchall()
    spans: dict[Pair, list[Period]] = {}
    for a, b, start, end in rows:
        spans.setdefault((a, b), []).append((microseconds(start), microseconds(end)))
    meetings = truth(workload, seed, earth)
    assert_covered(meetings, spans)
    assert_covered(meetings, {pair: found.periods_us for pair, found in screened.items()})


@cases
def test_stage_three_never_misses(workload: str, seed: int, earth: EarthModel) -> None:
    """The windows of the published programs contain every contact."""
    scene, areas, tracks = thrown(workload, seed, earth)
    assert_covered(truth(workload, seed, earth), projected(scene, areas, tracks))


def projected(scene: Scene, areas: list[Area], tracks: list[Track]) -> dict[Pair, list[Period]]:
    """Return the windows of stage 3, by pair of objects; those that follow each other are one."""
    staged = Staged.of(scene, areas, tracks, regions=True)
    pieces, pairs = staged.pieces, staged.pairs
    first_s, last_s = windows(staged.setup, staged.prepared, pairs)
    start_us, end_us = pieces.shared_span(pairs.a, pairs.b)
    spans: dict[Pair, list[tuple[float, float]]] = {}
    for k in np.flatnonzero(first_s <= last_s).tolist():
        members = sorted((int(pieces.kind[piece]), int(pieces.object_id[piece])) for piece in (pairs.a[k], pairs.b[k]))
        a, b = (f"{'A' if kind == Kind.AREA.code else 'T'}{number}" for kind, number in members)
        low, high = start_us[k] + 1e6 * first_s[k], min(start_us[k] + 1e6 * last_s[k], end_us[k])
        if np.isinf(last_s[k]):  # two areas
            low, high = (
                -np.inf if start_us[k] == MINUS_INFINITY_US else low,
                np.inf if end_us[k] == INFINITY_US else high,
            )
        spans.setdefault((a, b), []).append((low, high))
    return {pair: joined(found) for pair, found in spans.items()}


def joined(spans: list[tuple[float, float]]) -> list[Period]:
    """Return spans as periods, those that meet to the microsecond as one."""
    whole: list[tuple[float, float]] = []
    for low, high in sorted(spans):
        if whole and low <= whole[-1][1] + 1.0:
            whole[-1] = whole[-1][0], max(whole[-1][1], high)
        else:
            whole.append((low, high))
    return [
        (int(np.floor(low)) if np.isfinite(low) else None, int(np.ceil(high)) if np.isfinite(high) else None)
        for low, high in whole
    ]


@cases
def test_stage_four_is_right(conn: psycopg.Connection[Any], workload: str, seed: int, earth: EarthModel) -> None:
    """None missed, none false, times within the stated bound, bounds that excuse nothing; database or not."""
    scene, areas, tracks = thrown(workload, seed, earth)
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    reported = detected(conn, scene)
    result = compared(scene, areas, tracks, reported, truth(workload, seed, earth))
    assert not result.wrong
    assert result.touching > 0, "a scene that tests nothing"
    assert result.unresolved == 0
    assert result.worst_bound_s <= WORST_S
    assert np.median([one.time_error_s for one in reported.values() if one.verdict is Verdict.CONFLICT]) < USUAL_S
    assert reported == solved(scene, areas, tracks), "the database and the objects in memory give the same answer"


@pytest.mark.parametrize(("tolerance_m", "separation_m"), [(0.0, 0.0), (100.0, 0.0), (1.0, 1852.0)])
@pytest.mark.parametrize("workload", ["low latitude", "high latitude", "harbour"])
def test_tolerance_and_separation(workload: str, tolerance_m: float, separation_m: float) -> None:
    scene, areas, tracks = thrown(workload, 2, EarthModel.WGS84)
    scene = replace(scene, tolerance_m=tolerance_m, separation_m=separation_m)
    areas, tracks = areas[:4], tracks[:4]
    result = compared(scene, areas, tracks, solved(scene, areas, tracks))
    assert not result.wrong
    assert result.unresolved == 0
