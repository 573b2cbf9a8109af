"""Compares `solve` with the oracle on scenes with features, by a plain rewriting (`tests/support/plain_scenes.py`).

    ./run python tests/paths/against_oracle.py --seeds 100:120

Prints one line per disagreement, with the seed that makes the scene again, and exits 1 if there is any. A contact that
the oracle finds must be reported, and lie within a period. A conflict must be one for a separation that is larger by
the tolerance, where the rewriting is exact. Voyages that are drawn within tolerances, and tracks that sail earlier or
later, only prove conflicts.
"""

import argparse
import sys
import warnings
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

if __name__ == "__main__":
    _TESTS = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(_TESTS / "support"), str(_TESTS.parent)]

import numpy as np
from mixed_scenes import Mixed, mixed_scene
from plain_scenes import PlainPair, Span, plain_pairs
from verdicts import ROUNDING_S, TOUCH_M, periods_us

from conflictdb import solve
from conflictdb.errors import IncompleteWarning
from conflictdb.model.results import Certainty, Conflict, Verdict

_SHORTEST_US: Final = 1e6 * ROUNDING_S


def wrong(mixed: Mixed) -> tuple[list[str], int]:
    """Return the disagreements of a scene, and the number of its pairs."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IncompleteWarning)
        found = solve(mixed.tracks, mixed.areas, mixed.scene)
    reported = {(one.a_key, one.b_key): one for one in found if one.verdict is not Verdict.NEAR}
    rng = np.random.default_rng([mixed.seed, 7])
    pairs = list(plain_pairs(mixed.scene, mixed.areas, mixed.tracks, datetime.now(UTC), rng))
    texts = [
        f"seed {mixed.seed}: {pair.keys}: {text}"
        for pair in pairs
        for text in _wrong(pair, reported.get(pair.keys), mixed.scene.tolerance_m)
    ]
    others = reported.keys() - {pair.keys for pair in pairs}
    return [*texts, *(f"seed {mixed.seed}: {keys}: is reported, and not compared" for keys in sorted(others))], len(
        pairs
    )


def _wrong(pair: PlainPair, reported: Conflict | None, tolerance_m: float) -> Iterator[str]:
    draws = [[span for span in spans if span[1] - span[0] > _SHORTEST_US] for spans in pair.found(0.0)]
    if reported is None:
        if any(draws):
            yield f"missed: in contact {draws}"
        return
    if reported.verdict is Verdict.UNRESOLVED:
        return
    allowed_us = 1e6 * (reported.time_error_s + ROUNDING_S)
    periods = [
        (-np.inf if start is None else start - allowed_us, np.inf if end is None else end + allowed_us)
        for start, end in periods_us(reported)
    ]
    if not pair.required.time_us:
        yield from (f"contact {one} is in no period of {periods}" for one in _outside(draws, periods))
    nearer_m = 1.001 * tolerance_m + TOUCH_M
    if reported.certainty is Certainty.MUST and not all(pair.found(nearer_m)):
        yield f"must conflict, and a voyage does not: {draws}"
    if pair.is_drawn:
        return
    if not pair.is_exact:
        if not pair.may_be_near():
            yield f"{reported.verdict}, and never near: {periods}"
        return
    if reported.verdict is Verdict.CONFLICT and pair.required.separation_m == 0.0:
        nearer_m = 0.0  # contacts, whatever the tolerance is
    (wide,) = pair.found(nearer_m, doubtful=True)
    if not wide:
        yield f"{reported.verdict}, and never nearer than by {nearer_m:g} m: {periods}"
    elif not pair.required.time_us and reported.verdict is Verdict.CONFLICT:
        inner = [(start + 2 * allowed_us, end - 2 * allowed_us) for start, end in periods]
        inner = [(start, end) for start, end in inner if start < end]
        yield from (f"period {one} is not within {wide}" for one in _outside([inner], wide))


def _outside(draws: list[list[Span]], periods: list[Span]) -> Iterator[Span]:
    for spans in draws:
        for start, end in spans:
            if not any(first <= start and end <= last for first, last in periods):
                yield start, end


def main() -> int:
    """Compare the seeds that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:10", help="first:after, default 0:10")
    first, after = map(int, parser.parse_args().seeds.split(":"))
    failed, compared = 0, 0
    for seed in range(first, after):
        texts, pairs = wrong(mixed_scene(seed))
        compared += pairs
        failed += len(texts)
        for text in texts:
            sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{compared} pairs, {failed} wrong\n")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
