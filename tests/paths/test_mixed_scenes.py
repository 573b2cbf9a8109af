"""The generator of scenes: each feature occurs, objects meet often, and a seed is one scene."""

import warnings

import pytest
from mixed_scenes import mixed_scene
from scene_features import FEATURES, Feature

from conflictdb import IncompleteWarning, solve


def test_a_feature_that_is_wanted_is_there() -> None:
    for n, feature in enumerate(FEATURES):
        found = [feature in mixed_scene(seed, {feature}).features for seed in range(n, n + 4)]
        assert sum(found) >= 2, feature


def test_about_a_third_of_the_pairs_meets() -> None:
    pairs = met = 0
    for seed in range(len(FEATURES)):
        mixed = mixed_scene(seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IncompleteWarning)
            met += len(solve(mixed.tracks, mixed.areas, mixed.scene))
        pairs += len(mixed.objects) * (len(mixed.objects) - 1) // 2
        assert 3 <= len(mixed.objects) <= 12
    assert 0.25 < met / pairs < 0.5


@pytest.mark.parametrize("seed", range(3))
def test_a_seed_is_one_scene(seed: int) -> None:
    one, other = mixed_scene(seed), mixed_scene(seed)
    assert (one.scene, one.plan_key, one.features) == (other.scene, other.plan_key, other.features)
    assert str(one.objects) == str(other.objects)


def test_far_plans_depart_beyond_the_other_voyages() -> None:
    mixed = mixed_scene(4, {Feature.FAR})
    assert {Feature.FAR, Feature.SCHEDULE_OF_AREA} <= mixed.features
    assert mixed.plan.key == "P"
