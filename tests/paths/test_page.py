"""The page's what-if gives the answer of `solve` on a moved copy, in scenes with the features that it computes."""

from pathlib import Path
from typing import Final

import pytest
from mixed_scenes import Feature, mixed_scene
from test_page_what_if import Plans, check, pytestmark

__all__ = ["pytestmark"]

SCENES: Final = {
    0: {Feature.ACTIVATIONS, Feature.SEPARATION},
    1: {Feature.UNBOUNDED, Feature.OWNERS},
    2: {Feature.HEIGHTS, Feature.VERTICAL_SEPARATION},
    3: {Feature.CLOSED, Feature.HEIGHTS},
    4: {Feature.GROWTH, Feature.SPHERE},
    5: {Feature.OUTLINES, Feature.OWNERS},
    6: {Feature.GREAT_CIRCLE, Feature.SEPARATION},
    7: {Feature.ANTIMERIDIAN, Feature.GROWTH},
    8: {Feature.HIGH_LATITUDE, Feature.SEPARATION},
    9: {Feature.ZERO, Feature.CLOSED},
    10: {Feature.CLASSES, Feature.OWNERS},
    11: {Feature.ALLOWED, Feature.HEIGHTS},
    12: {Feature.CLASS_VERTICAL, Feature.HEIGHTS},
}


@pytest.mark.parametrize("seeds", [range(5), range(5, 10), range(10, 13)])
def test_moved_tracks_meet_what_copies_meet(tmp_path: Path, seeds: range) -> None:
    scenes: list[Plans] = []
    for seed in seeds:
        mixed = mixed_scene(seed, SCENES[seed])
        scenes.append((mixed.scene, mixed.areas, mixed.tracks))
    check(tmp_path, 3, scenes, 1)
