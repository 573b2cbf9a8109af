"""docs/reference/proof.md has the formulas of `check_proof.py`: both say the same of the steps of 1,000 pairs."""

import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import proof_formulas
import pytest
from draws import draws
from layouts import GROWING, GROWING_CIRCLES, HIGH_LATITUDE, LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene

from conflictdb import certify
from conflictdb.formats import check_proof
from conflictdb.model.plans import EarthModel, Motion

# The sum of a gap is compared where both agree to this share of its terms, or by sign.
ROUNDING_M = 2e-7


def leg_of(body: Any) -> proof_formulas.Leg:
    ends, seconds, bearing, havens = body.given
    return proof_formulas.Leg(np.array(ends), seconds, bearing, np.array(havens))


def keeping(of: Any) -> Any:
    """Return a class of the checker whose bodies keep what they were made of."""

    def made(*given: Any) -> Any:
        body = of(*given)
        body.given = given[1:]
        return body

    return made


@pytest.mark.parametrize("apart_m", [0.0, 926.0])
@draws("pairs", 3, 85)
@pytest.mark.parametrize(
    "workload", [LOW_LATITUDE, HIGH_LATITUDE, SEAM, GROWING, OCEAN, GROWING_CIRCLES], ids=lambda one: one.name
)
def test_both_say_the_same_of_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workload: Workload, pairs: int, apart_m: float
) -> None:
    """With the angles of the proof, and with angles next to them, at which the gap is about as large as the bend."""
    for name in ("_Rhumb", "_Circle"):
        monkeypatch.setattr(check_proof, name, keeping(getattr(check_proof, name)))
    rng, seen, proven = random.Random(1), 0, 0  # noqa: S311 - chance, not secrecy
    for seed in range(100):
        earth = list(EarthModel)[seed % 2] if workload.motion is Motion.RHUMB else EarthModel.SPHERE
        scene, areas, tracks = plain_scene(workload, seed, 3, 5, earth, separation_m=apart_m)
        certify(tracks, areas, tmp_path / "proof", scene)
        parts = check_proof.read((tmp_path / "proof").read_text().splitlines(keepends=True))
        checker, centre = check_proof.Checker(parts), parts["settings"][0].get("centre")
        is_sphere = earth is EarthModel.SPHERE
        plane: Any = proof_formulas.Gnomonic(tuple(centre or (0.0, 0.0)))
        if workload.motion is Motion.RHUMB:
            plane = proof_formulas.Mercator(*((proof_formulas.R, 0.0) if is_sphere else (6378137.0, 1 / 298.257223563)))
        for (p, q, turns), line in checker.steps.items():
            one, other = checker.scene.pieces[p], checker.scene.pieces[q]
            both = check_proof._together(one, other, math.inf, False)
            values = check_proof.json.loads(line)[3:]
            if both is None or values[0] is None or (one.is_still and other.is_still):
                continue
            *_, zero, lasts, _ = both
            step = 0.0, values[1] if len(values) > 1 else lasts
            given = [np.array(piece.body) if piece.is_still else leg_of(piece.body) for piece in (one, other)]
            into = tuple(0.0 if piece.is_still else (zero - piece.leg[0]) / 1e6 for piece in (one, other))
            for angle in (values[0], values[0] + rng.choice((0.3, -0.3, 0.02))):
                excess = proof_formulas.excess(plane, *given, turns, into, step, angle, apart_m)
                said = check_proof._is_apart(checker.scene.plane, one, other, turns, zero, step, angle, apart_m)
                assert said == (excess > 0.0) or abs(excess) < ROUNDING_M, (seed, p, q, angle, excess)
                proven += said
            seen += 1
            if seen == pairs:
                assert proven > 0
                return
    raise AssertionError(f"only {seen} pairs have steps")
