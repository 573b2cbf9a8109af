"""Verdicts on pairs of areas on either side of every limit: separation, tolerance, how well distances are known."""

import pytest
import scenes
import shapely
from staged import Staged

from conflictdb.core.stage4.constants import TOUCH_M
from conflictdb.core.stage4.contact_search import CONFLICT, GRAZING, UNRESOLVED, static_verdicts
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import EarthModel, Scene

APART = -1


def verdict_of(apart_m: float, scene: Scene) -> int:
    """The verdict on a corner on the equator and a side across it, so far apart; overlaps are below 0."""
    east = 1.0 + apart_m / scenes.parallel_m(scene.earth, 0.0)
    areas = [
        scenes.area("A", shapely.Polygon([(1.0, 0.0), (0.5, 0.2), (0.5, -0.2)])),
        scenes.area("B", shapely.box(east, -0.2, east + 0.5, 0.2)),
    ]
    staged = Staged.of(scene, areas, [])
    if not len(staged.pairs):
        return APART
    ((found,), _) = static_verdicts(staged.setup, staged.prepared, staged.pairs)
    return int(found)


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("separation_m", [0.0, 5000.0])
@pytest.mark.parametrize("tolerance_m", [0.0, 100.0])
def test_verdicts_on_either_side_of_each_limit(earth: EarthModel, separation_m: float, tolerance_m: float) -> None:
    """Near, distances are known to less than the step, depths to the scale in the middle of the areas."""
    scene = Scene("s", earth=earth, separation_m=separation_m, tolerance_m=tolerance_m)
    margin_m, step_m = max(tolerance_m, TOUCH_M), max(1e-6, 1e-5 * tolerance_m)
    expected = [(margin_m + step_m, APART), (-margin_m - step_m, CONFLICT)]
    if tolerance_m > 0.0:
        expected += [(further_m, GRAZING) for further_m in (margin_m - step_m, 0.0, -margin_m + step_m)]
    for further_m, verdict in expected:
        assert verdict_of(separation_m + further_m, scene) == verdict, further_m


def test_what_is_not_known_to_the_tolerance_is_not_called() -> None:
    """3,000 km away, distances are known to some metres: a pair that is nearer than that to a limit is unresolved."""
    scene = Scene("s", earth=EarthModel.WGS84, separation_m=3e6, tolerance_m=0.01)
    error_m = float(Setup.of(scene).plane.distance_error_m(scene.separation_m))
    assert error_m > 0.1
    for further_m, verdict in (
        (error_m + 1.0, APART),
        (0.8 * error_m, UNRESOLVED),
        (0.2 * error_m, UNRESOLVED),
        (-error_m - 1.0, CONFLICT),
    ):
        assert verdict_of(scene.separation_m + further_m, scene) == verdict, further_m
