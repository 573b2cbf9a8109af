"""Windows of stage 3: closed forms, and that they are of use."""

import numpy as np
import pytest
import scenes
import shapely

from conflictdb import kernel
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.arrays.pairs import Pairs
from conflictdb.arrays.pieces import Pieces
from conflictdb.core.pieces.covers import pieces_of
from conflictdb.core.published.stage3_projection import windows
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import Area, EarthModel, Scene, Track


def met(scene: Scene, areas: list[Area], tracks: list[Track]) -> tuple[Pieces, Pairs]:
    """Pieces, and the pairs of different objects whose hulls and spans meet, with their regions."""
    pieces = pieces_of(Setup.of(scene), AreaBatch.of(areas), TrackBatch.of(tracks))
    hulls = [
        shapely.Polygon(pieces.hull_xy[start:end])
        for start, end in zip(pieces.hull_offset[:-1], pieces.hull_offset[1:], strict=True)
    ]
    found, regions = [], []
    for a in range(len(pieces)):
        for b in range(a + 1, len(pieces)):
            same = pieces.kind[a] == pieces.kind[b] and pieces.object_id[a] == pieces.object_id[b]
            late = max(pieces.start_us[a], pieces.start_us[b]) >= min(pieces.end_us[a], pieces.end_us[b])
            if not same and not late and hulls[a].intersects(hulls[b]):
                found.append((a, b))
                regions.append(shapely.get_coordinates(hulls[a].intersection(hulls[b])))
    offset = np.concatenate([[0], np.cumsum([len(region) for region in regions])]).astype(np.int64)
    a, b = np.array(found, dtype=np.int64).reshape(-1, 2).T
    return pieces, Pairs(a, b, np.concatenate([np.empty((0, 2)), *regions]), offset)


def windows_of(scene: Scene, pieces: Pieces, pairs: Pairs) -> tuple[np.ndarray, np.ndarray]:
    setup = Setup.of(scene)
    return windows(setup, kernel.KernelScene(setup.plane.kernel_plane, pieces), pairs)


def union_s(pieces: Pieces, pairs: Pairs, first: np.ndarray, last: np.ndarray) -> tuple[float, float]:
    """From when to when, seconds after T0, the windows of all pairs reach."""
    start = (pieces.shared_span(pairs.a, pairs.b)[0] - scenes.T0_US) / 1e6
    some = first <= last
    return float((start + first)[some].min()), float((start + last)[some].max())


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("separation_m", [0.0, 5000.0])
def test_window_on_the_equator_is_the_contact_itself(separation_m: float, earth: EarthModel) -> None:
    """A rectangle along the equator through a box: nothing bends, so only the padding is over."""
    degree = scenes.parallel_m(earth, 0.0)
    track = scenes.track("T", [(0, 0), (1, 0)], [0, 3600], fore=4000, aft=2000, port=500, starboard=500)
    scene = Scene("s", earth=earth, separation_m=separation_m)
    pieces, pairs = met(scene, [scenes.area("A", shapely.box(0.5, -0.1, 0.6, 0.1))], [track])
    low, high = union_s(pieces, pairs, *windows_of(scene, pieces, pairs))
    begins, ends = (0.5 - (4000 + separation_m) / degree) * 3600, (0.6 + (2000 + separation_m) / degree) * 3600
    # A metre of tolerance here and there is 0.03 s each way; hulls are padded on both sides for both.
    slack_s = 0.3 + 0.51 * separation_m / degree * 3600
    assert begins - slack_s <= low <= begins
    assert ends <= high <= ends + slack_s


@pytest.mark.parametrize(("lat", "slack_s"), [(20.0, 30.0), (75.0, 900.0)])
def test_window_holds_a_growing_haven(lat: float, slack_s: float) -> None:
    """Northbound along a meridian the image grows; the window still contains the contact, which is known."""
    earth = EarthModel.WGS84
    scene = Scene("s", earth=earth)
    m = [scenes.meridian_m(earth, x) for x in (lat, lat + 2, lat + 0.9, lat + 1.1)]
    speed = (m[1] - m[0]) / 36000
    track = scenes.track("T", [(0, lat), (0, lat + 2)], [0, 36000], 20000, 30000, 15000, 15000)
    pieces, pairs = met(scene, [scenes.area("A", shapely.box(-1, lat + 0.9, 1, lat + 1.1))], [track])
    low, high = union_s(pieces, pairs, *windows_of(scene, pieces, pairs))
    begins, ends = (m[2] - m[0] - 20000) / speed, (m[3] - m[0] + 30000) / speed
    assert begins - slack_s <= low <= begins
    assert ends <= high <= ends + slack_s


def test_two_tracks_have_the_window_that_both_allow() -> None:
    """Crossing paths at different times: the hulls of the slices meet, the windows do not, or hardly."""
    scene = Scene("s", earth=EarthModel.SPHERE)
    sizes = 1000.0, 1000.0, 1000.0, 1000.0
    east = scenes.track("E", [(-1, 0), (1, 0)], [0, 7200], *sizes)
    north = scenes.track("N", [(0.02, -1), (0.02, 1)], [0, 7200], *sizes)
    pieces, pairs = met(scene, [], [east, north])
    first, last = windows_of(scene, pieces, pairs)
    assert (first <= last).any()
    low, high = union_s(pieces, pairs, first, last)
    assert low <= 3600 + 72 - 36 <= high
    late = scenes.track("N", [(0.02, -1), (0.02, 1)], [300, 7500], *sizes)
    pieces, pairs = met(scene, [], [east, late])
    first, last = windows_of(scene, pieces, pairs)
    assert not (first <= last).any()


def test_loiter_has_its_whole_span_for_a_window() -> None:
    scene = Scene("s")
    waiting = scenes.track("T", [(0, 0), (0, 0)], [0, 3600], 5000, 5000, 5000, 5000)
    pieces, pairs = met(scene, [scenes.area("A", shapely.box(0, 0, 1, 1), 600, 1200)], [waiting])
    first, last = windows_of(scene, pieces, pairs)
    assert len(pairs) == 1
    assert first[0] <= 0.0
    assert last[0] >= 600.0


def test_areas_share_their_span() -> None:
    scene = Scene("s")
    areas = [scenes.area("A", shapely.box(0, 0, 1, 1)), scenes.area("B", shapely.box(0, 0, 1, 1))]
    pieces, pairs = met(scene, areas, [])
    first, last = windows_of(scene, pieces, pairs)
    assert first.tolist() == [0.0]
    assert last.tolist() == [np.inf]
