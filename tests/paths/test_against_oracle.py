"""`solve` agrees with the oracle on scenes that mix features, rewritten plainly (`against_oracle.py`)."""

import secrets

import pytest
from against_oracle import wrong
from mixed_scenes import mixed_scene
from scene_features import FEATURES

# 375 pairs; the oracle's answers are recorded.
SEEDS = (0, 1, 2, 3, 4, 8, 14, 16, 17, 18, 19, 26, 29, 30, 38, 40, 50, 59)


@pytest.mark.parametrize("seed", SEEDS)
def test_mixed_scenes_equal_brute_force(seed: int) -> None:
    texts, pairs = wrong(mixed_scene(seed))
    assert pairs
    assert not texts, "\n".join(texts)


@pytest.mark.slow
def test_free_mixed_scenes_equal_brute_force() -> None:
    """Each feature in turn, with seeds that no run had before."""
    first = secrets.randbelow(2**31) * len(FEATURES)
    texts = [text for seed in range(first, first + len(FEATURES)) for text in wrong(mixed_scene(seed))[0]]
    assert not texts, "\n".join(texts)
