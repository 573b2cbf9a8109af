"""Digests of objects: equal for equal contents, in any batch; different for different contents."""

from dataclasses import replace

import full_plans
import numpy as np
import pytest
import shapely
from mixed_scenes import mixed_scene
from scene_features import Feature

from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.core.pieces.digests import area_digests, track_digests
from conflictdb.model.plan_columns import AREA as AREA_KIND
from conflictdb.model.plan_columns import TRACK as TRACK_KIND
from conflictdb.model.plan_columns import columns_of
from conflictdb.model.plans import Area, Track

AREA = Area("A", shapely.box(0, 0, 1, 1), start_us=0, end_us=10, floor_m=0.0, ceiling_m=10.0)
TRACK = Track(
    "T", [(0, 0), (1, 1), (2, 1)], [0, 10**10, 2 * 10**10], [(0, 1), (1, 0), (-1, 0)], floor_m=0.0, ceiling_m=10.0
)


def of(*objects: Area | Track) -> list[int]:
    areas = [one for one in objects if isinstance(one, Area)]
    tracks = [one for one in objects if isinstance(one, Track)]
    return [*area_digests(AreaBatch.of(areas)).tolist(), *track_digests(TrackBatch.of(tracks)).tolist()]


CHANGED = [
    replace(AREA, footprint=shapely.MultiPolygon([shapely.box(0, 0, 1, 1 + 1e-15)])),
    replace(AREA, footprint=shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)])),
    replace(AREA, start_us=1),
    replace(AREA, start_us=None),
    replace(AREA, end_us=9),
    replace(AREA, floor_m=None),
    replace(AREA, ceiling_m=11.0),
    replace(AREA, object_class="range"),
    replace(AREA, owner="us"),
    replace(TRACK, positions_deg=TRACK.positions_deg + 1e-12),
    replace(TRACK, positions_deg=TRACK.positions_deg[:2], times_us=TRACK.times_us[:2]),
    replace(TRACK, times_us=TRACK.times_us + 1),
    replace(TRACK, outline_m=TRACK.outline_m * 2.0),
    replace(TRACK, grow_mps=0.5),
    replace(TRACK, outlines_m=np.repeat(TRACK.outline_m[None], 3, axis=0)),
    replace(TRACK, floor_m=1.0),
    replace(TRACK, ceiling_m=None),
    replace(TRACK, object_class="ferry"),
    replace(TRACK, owner="us"),
    replace(TRACK, floor_m=None, floors_m=np.array([0.0, 1.0])),
    replace(TRACK, ceiling_m=None, ceilings_m=np.array([10.0, np.inf])),
]


@pytest.mark.parametrize("changed", CHANGED)
def test_digests_differ_where_conflicts_may(changed: Area | Track) -> None:
    assert of(changed) != of(AREA if isinstance(changed, Area) else TRACK)


# The key is no column, the lines of legs are the scene's, and of a schedule digests have the activations.
NOT_IN_DIGESTS = ("key", "legs", "schedule")
ALONE = [one for one in full_plans.specimens() if len(one.fields) == 1 and one.fields[0] not in NOT_IN_DIGESTS]


@pytest.mark.parametrize("one", ALONE, ids=lambda one: one.name)
def test_a_column_is_in_digests_if_it_changes_answers(one: full_plans.Specimen) -> None:
    """A new column fails here until digests have it."""
    kind, plain = (AREA_KIND, full_plans.area()) if isinstance(one.plan, Area) else (TRACK_KIND, full_plans.track())
    (column,) = (column for column in columns_of(kind) if one.fields[0] in column.python)
    assert (of(one.plan) != of(plain)) == column.changes_answers


def test_digests_are_of_contents_alone() -> None:
    """Neither other objects nor their order change theirs, nor do keys, names and properties."""
    for one in (AREA, TRACK):
        assert of(replace(one, key="B", name="b", properties={"a": 1})) == of(one)
    features = {Feature.GROWTH, Feature.OUTLINES, Feature.ACTIVATIONS, Feature.DEPARTURES, Feature.HEIGHTS}
    mixed = [mixed_scene(seed, features) for seed in range(10)]
    areas = [area for one in mixed for area in one.areas]
    tracks = [track for one in mixed for track in one.tracks]
    objects = [*areas, *tracks]
    together = of(*objects)
    assert together == [digest for one in objects for digest in of(one)]
    assert len(set(together)) == len(objects)
    backwards = of(*areas[::-1], *tracks[::-1])
    assert backwards == together[: len(areas)][::-1] + together[len(areas) :][::-1]
    assert of() == []
