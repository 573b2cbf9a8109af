"""A plan that moves keeps its true size, courses and speeds; two plans exchange their times."""

import numpy as np
import pytest
import shapely

from conflictdb.core.moving_plans import delayed, dragged, exchanged, moved
from conflictdb.earth import geodesy
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import Area, EarthModel, Motion, Scene, Track, rectangle_outline_m

T0_US = 1_780_272_000_000_000
HOUR_US = 3_600_000_000
WGS84 = geodesy.earth_of(EarthModel.WGS84)
RHUMB = Scene("s")
CIRCLES = Scene("s", motion=Motion.GREAT_CIRCLE, earth=EarthModel.SPHERE)


def track(places: list[tuple[float, float]], key: str = "T", start_us: int = T0_US) -> Track:
    times = start_us + HOUR_US * np.arange(len(places), dtype=np.int64)
    return Track(key, places, times, rectangle_outline_m(500, 500, 300, 300), max_speed_kn=np.inf)


def coordinates(area: Area | Track) -> np.ndarray:  # type: ignore[type-arg]
    assert isinstance(area, Area)
    return shapely.get_coordinates(area.footprint)


@pytest.mark.parametrize(
    "places",
    [
        [(10.0, 57.0), (10.5, 57.2), (9.8, 58.0)],
        [(179.9, -10.0), (180.4, -9.5), (181.0, -9.9)],
        [(0.0, 80.0), (3.0, 81.0)],
        [(10.0, 57.0), (10.0, 57.0), (10.0, 57.5)],
    ],
)
@pytest.mark.parametrize("bearing", [0.0, 90.0, 225.0, -45.0])
def test_legs_of_a_moved_track_keep_length_and_course(places: list[tuple[float, float]], bearing: float) -> None:
    old, new = track(places), moved(track(places), 50_000.0, bearing, RHUMB)
    assert isinstance(new, Track)
    legs = [geodesy.rhumb_inverse(WGS84, *p[:-1].T, *p[1:].T) for p in (old.positions_deg, new.positions_deg)]
    assert legs[1][0] == pytest.approx(legs[0][0], abs=1e-6)
    assert legs[1][1] == pytest.approx(legs[0][1], abs=1e-9)
    step = geodesy.rhumb_inverse(WGS84, *old.positions_deg[0], *new.positions_deg[0])
    assert float(step[0]) == pytest.approx(50_000.0, abs=1e-6)
    assert (float(step[1] - bearing) + 180.0) % 360.0 == pytest.approx(180.0, abs=1e-8)
    assert (new.times_us == old.times_us).all()


def test_a_moved_area_keeps_its_true_size() -> None:
    """North by 10 degrees its width in degrees grows as the meridians converge."""
    area = Area("A", shapely.box(8.0, 50.0, 8.4, 50.2), start_us=T0_US, end_us=T0_US + HOUR_US)
    ring = coordinates(moved(area, 1_112_000.0, 0.0, RHUMB))
    middle = 0.5 * (ring.min(axis=0) + ring.max(axis=0))
    old = geodesy.rhumb_inverse(WGS84, 8.2, 50.1, *coordinates(area).T)
    new = geodesy.rhumb_inverse(WGS84, *middle, *ring.T)
    assert middle == pytest.approx([8.2, 60.1], abs=0.02)
    assert new[0] == pytest.approx(old[0], rel=1e-4)
    assert np.ptp(ring[:, 0]) == pytest.approx(0.4 * np.cos(np.radians(50.1)) / np.cos(np.radians(60.1)), rel=0.01)
    back = coordinates(moved(moved(area, 5_000.0, 90.0, RHUMB), 5_000.0, 270.0, RHUMB))
    assert back == pytest.approx(coordinates(area), abs=1e-9)


@pytest.mark.parametrize("scene", [RHUMB, CIRCLES])
@pytest.mark.parametrize("to", [(9.1, 50.6), (180.1, 3.0), (8.2, -50.0)])
def test_a_dragged_area_goes_where_its_place_goes_and_back(scene: Scene, to: tuple[float, float]) -> None:
    """As `moved` by the way of its middle, if that is dragged."""
    hole, part = shapely.box(8.1, 50.1, 8.2, 50.15), shapely.box(9.0, 50.0, 9.1, 50.1)
    shape = shapely.box(8.0, 50.0, 8.4, 50.2).difference(hole).union(part)
    area = Area("A", shape, start_us=T0_US, end_us=T0_US + HOUR_US)
    middle = (8.55, 50.1)
    there = dragged(area, middle, to, scene)
    assert isinstance(there, Area)
    if scene is RHUMB:
        far_m, bearing = (float(one) for one in geodesy.rhumb_inverse(WGS84, *middle, *to))
        assert coordinates(there) == pytest.approx(coordinates(moved(area, far_m, bearing, scene)), abs=1e-12)
    back = coordinates(dragged(there, to, middle, scene))
    assert geodesy.unit_vectors(back) == pytest.approx(geodesy.unit_vectors(coordinates(area)), abs=1e-11)


@pytest.mark.parametrize("bearing", [0.0, 77.0, 180.0, 300.0])
def test_great_circles_turn_all_distances_unchanged(bearing: float) -> None:
    """Also across a pole."""
    places = [(170.0, 80.0), (-170.0, 85.0), (-100.0, 84.0)]
    new = moved(track(places), 2_000_000.0, bearing, CIRCLES)
    assert isinstance(new, Track)
    old = np.array(places)
    for p, q in ((0, 1), (1, 2), (0, 2)):
        known = geodesy.great_circle_distance(*old[p], *old[q])
        assert geodesy.great_circle_distance(*new.positions_deg[p], *new.positions_deg[q]) == pytest.approx(
            known, abs=0.1
        )
    assert geodesy.great_circle_distance(*old[0], *new.positions_deg[0]) == pytest.approx(2_000_000.0, abs=0.1)


@pytest.mark.parametrize("far", [float("nan"), float("inf"), -1.0, 3e7])
def test_hostile_distances_are_refused(far: float) -> None:
    with pytest.raises(InvalidInput, match="must be a distance from 0 to 20,000 km"):
        moved(track([(0.0, 0.0), (1.0, 0.0)]), far, 0.0, RHUMB)
    with pytest.raises(InvalidInput, match="beyond a pole"):
        moved(track([(0.0, 0.0), (1.0, 0.0)]), 1.2e7, 0.0, RHUMB)


def test_an_area_that_would_go_round_a_pole_is_refused() -> None:
    area = Area("A", shapely.box(8.0, 50.0, 8.4, 50.2), start_us=T0_US, end_us=T0_US + HOUR_US)
    for scene, far_m in ((RHUMB, 4_450_000.0), (CIRCLES, 4_437_000.0)):
        with pytest.raises(InvalidInput, match="beyond a pole"):
            moved(area, far_m, 0.0, scene)


def test_one_plan_is_not_exchanged_with_itself() -> None:
    one = track([(0.0, 0.0), (1.0, 0.0)], "A")
    with pytest.raises(InvalidInput, match="must be two plans"):
        exchanged(one, one)


def test_tracks_exchange_departures_and_areas_their_times() -> None:
    a, b = track([(0.0, 0.0), (1.0, 0.0)], "A"), track([(0.0, 1.0), (1.0, 1.0), (2.0, 1.0)], "B", T0_US + HOUR_US)
    new_a, new_b = exchanged(a, b)
    assert isinstance(new_a, Track)
    assert isinstance(new_b, Track)
    assert (new_a.times_us - a.times_us == HOUR_US).all()
    assert (new_b.times_us - b.times_us == -HOUR_US).all()
    closed = Area("C", shapely.box(0, 0, 1, 1), start_us=T0_US, end_us=T0_US + HOUR_US)
    weekly = Area("D", shapely.box(2, 0, 3, 1), spans_us=[(np.datetime64(T0_US, "us"), np.datetime64(T0_US + 9, "us"))])
    new_c, new_d = exchanged(closed, weekly)
    assert isinstance(new_c, Area)
    assert isinstance(new_d, Area)
    assert (new_c.spans_us, new_c.key) == (((T0_US, T0_US + 9),), "C")
    assert (new_d.start_us, new_d.end_us, new_d.spans_us) == (closed.start_us, closed.end_us, None)
    with pytest.raises(InvalidInput, match="must be two tracks or two areas"):
        exchanged(a, closed)
    assert delayed(closed, -HOUR_US).start_us == T0_US - HOUR_US  # type: ignore[union-attr]
