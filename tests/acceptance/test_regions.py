"""Regions of interference contain all places of contact, by the oracle, and little more."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import oracle
import oracle_circle
import pytest
import shapely
from layouts import ARCTIC, GROWING, GROWING_CIRCLES, HIGH_LATITUDE, LOW_LATITUDE, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene
from numpy.typing import NDArray
from staged import Staged

from conflictdb import Method
from conflictdb.arrays.answers import Conflicts
from conflictdb.core import conflict_regions
from conflictdb.earth.registry import Setup
from conflictdb.kernel.regions import joined
from conflictdb.model.plans import MINUS_INFINITY_US, Area, EarthModel, Motion, Scene, Track
from conflictdb.model.results import Kind

# Metres: coordinates are rounded by less, also those of the oracle.
ROUNDED_M = 1e-2


def found(scene: Scene, areas: list[Area], tracks: list[Track], jobs: int = 1) -> Conflicts:
    """Return the conflicts of a scene with their regions; objects have their places in the lists as numbers."""
    return Staged.of(scene, areas, tracks, regions=scene.method == Method.NLP).run(jobs=jobs)[0]


def regions_of(answer: Conflicts) -> NDArray[np.object_]:
    """Return the regions of all conflicts."""
    return answer.where(np.arange(len(answer))).geometries()


def are_covered(region: shapely.Geometry, lonlat: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether a region covers places (n, 2), longitudes of any turn; of the seam on either side."""
    lon = np.remainder(lonlat[:, 0] + 180.0, 360.0) - 180.0
    on_seam = np.abs(np.abs(lon) - 180.0) < 1e-9
    shapely.prepare(region)
    sides = (np.where(on_seam, side, lon) for side in (-180.0, 180.0))
    return np.logical_or(*(shapely.covers(region, shapely.points(side, lonlat[:, 1])) for side in sides))


def dense(common: shapely.Geometry) -> NDArray[np.float64]:
    """Return places all along the sides of polygons of a plane, (n, 2); lines and points are no place of a region."""
    wide = shapely.union_all([part for part in shapely.get_parts(common) if part.geom_type == "Polygon"])
    return shapely.get_coordinates(shapely.segmentize(wide, max(wide.length / 300.0, 1e-3)))


def region_in_plane(scene: Scene, region: shapely.Geometry, turns: int, near_lon: float) -> shapely.Geometry:
    """Return a region in plane metres east of a longitude, moved by some whole turns."""
    plane = Setup.of(scene).plane

    def project(lonlat: np.ndarray) -> np.ndarray:
        return np.stack(plane.to_plane(lonlat[:, 0] - near_lon + 360.0 * turns, lonlat[:, 1]), axis=1)

    return shapely.transform(region, project)


@pytest.mark.parametrize("earth", EarthModel)
@pytest.mark.parametrize("method", [Method.EXACT, Method.NLP])
@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM, HIGH_LATITUDE, GROWING], ids=lambda workload: workload.name)
def test_regions_hold_all_places_of_contact(workload: Workload, method: Method, earth: EarthModel) -> None:
    """At instants of the periods, regions contain the polygons' intersection; they are valid, within +-180 degrees."""
    scene, areas, tracks = plain_scene(replace(workload, window=1.5), 3, 8, 10, earth, tolerance_m=0.0)
    answer, plane = found(replace(scene, method=method), areas, tracks), Setup.of(scene).plane
    where = regions_of(answer)
    assert len(answer) > 2
    checked = 0
    for k in range(len(answer)):
        region = where[k]
        if region is None and method != Method.EXACT:  # the pair need not come within the separation
            continue
        assert region is not None
        assert region.is_valid
        assert region.geom_type in ("Polygon", "MultiPolygon")
        assert shapely.get_srid(region) == 4326
        west, south, east, north = region.bounds
        assert -180.0 <= west < east <= 180.0
        assert -90.0 < south < north < 90.0
        pair = [
            (areas if kind[k] == Kind.AREA.code else tracks)[number[k]]
            for kind, number in ((answer.a_kind, answer.a_id), (answer.b_kind, answer.b_id))
        ]
        lon = shapely.get_parts(region)[0].centroid.x
        for start, end in answer.period_us[answer.period_offset[k] : answer.period_offset[k + 1]].tolist():
            for at in np.linspace(start, end, 4).astype(np.int64).tolist() if start > MINUS_INFINITY_US else [0]:
                first, second = (shapely.union_all(oracle.polygons_at(scene, one, at, lon)) for one in pair)
                places = dense(first.intersection(second))
                lon_deg, lat_deg = plane.from_plane(*places.T)
                assert are_covered(region, np.stack([lon_deg + lon, lat_deg], axis=1)).all(), (k, at)
                checked += len(places) > 0
    assert checked > 5


@pytest.mark.parametrize(
    "workload",
    [OCEAN, GROWING_CIRCLES, ARCTIC, replace(OCEAN, name="seam", longitudes=(179.0, 179.0))],
    ids=lambda workload: workload.name,
)
def test_regions_on_great_circles_hold_all_places_of_contact(workload: Workload) -> None:
    """Also across the seam; next to a pole there is none. The oracle uses a plane of its own, about the region."""
    scene, areas, tracks = plain_scene(replace(workload, window=6.0), 5, 12, 16, tolerance_m=0.0)
    answer = found(scene, areas, tracks)
    where = regions_of(answer)
    checked, cut = 0, 0
    for k in range(len(answer)):
        if where[k] is None:
            assert workload.name == ARCTIC.name
            continue
        assert where[k].is_valid
        assert where[k].geom_type in ("Polygon", "MultiPolygon")
        assert shapely.get_srid(where[k]) == 4326
        west, south, east, north = where[k].bounds
        assert -180.0 <= west < east <= 180.0
        assert -90.0 < south < north < 90.0
        cut += west == -180.0 and east == 180.0
        chart = oracle_circle.Chart.about(oracle_circle.space(shapely.get_coordinates(where[k])))
        pair = [
            (areas if kind[k] == Kind.AREA.code else tracks)[number[k]]
            for kind, number in ((answer.a_kind, answer.a_id), (answer.b_kind, answer.b_id))
        ]
        for start, end in answer.period_us[answer.period_offset[k] : answer.period_offset[k + 1]].tolist():
            for at in np.linspace(start, end, 4).astype(np.int64).tolist() if start > MINUS_INFINITY_US else [0]:
                first, second = (
                    shapely.union_all(
                        [
                            phase.place(at, np.zeros(1))[0]
                            for phase in oracle_circle.phases(chart, one)
                            if phase.start_us <= at <= phase.end_us
                        ]
                    )
                    for one in pair
                )
                places = dense(first.intersection(second))
                x, y, z = (chart.space(places) @ chart.frame).T.astype(np.float64)
                lonlat = np.degrees(np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))], axis=1))
                assert are_covered(where[k], lonlat).all(), (k, at)
                checked += len(places) > 0
    assert checked > 5
    assert cut > 0 or workload.name != "seam"


@pytest.mark.parametrize("workload", [LOW_LATITUDE, SEAM], ids=lambda workload: workload.name)
def test_regions_are_no_larger_than_what_is_swept_during_the_contact(
    workload: Workload, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The region of two areas is little more than their intersection, that of a haven no more than what is screened."""
    scene, areas, tracks = plain_scene(replace(workload, window=1.5), 4, 8, 8, tolerance_m=0.0)
    answer = found(scene, areas, tracks)
    # What is swept during all of the shared time: `screen` does not compute it otherwise.
    monkeypatch.setattr(Scene, "has_regions", property(lambda _: True))
    screened = found(replace(scene, method=Method.SCREEN), areas, tracks)
    where = regions_of(answer)
    of_pair = {
        key: region
        for *key, region in zip(
            screened.a_kind, screened.a_id, screened.b_kind, screened.b_id, regions_of(screened), strict=True
        )
        for key in [tuple(int(part) for part in key)]
    }
    static = 0
    for k in range(len(answer)):
        key = tuple(int(column[k]) for column in (answer.a_kind, answer.a_id, answer.b_kind, answer.b_id))
        # Corners of the smaller region move as far outward as those of the larger one.
        assert where[k].area <= of_pair[key].area * (1.0 + 1e-6) + 2e-5 * where[k].length
        if key[0] == key[2] == Kind.AREA.code:
            static += 1
            at = int(answer.period_us[answer.period_offset[k], 0])
            lon = shapely.get_parts(where[k])[0].centroid.x
            first, second = (shapely.union_all(oracle.polygons_at(scene, areas[n], at, lon)) for n in (key[1], key[3]))
            here = shapely.union_all([region_in_plane(scene, where[k], turn, lon) for turn in (-1, 0, 1)])
            half = np.pi * oracle.Globe.of(scene.earth).a
            common = first.intersection(second).intersection(shapely.box(-half, -1e9, half, 1e9))
            # No more than that and a metre.
            around = common.buffer(1.01 * conflict_regions.BEYOND_M / np.cos(np.radians(40.0)))
            assert here.intersection(shapely.box(-half, -1e9, half, 1e9)).difference(around).area < 1.0
    assert static > 0


EVERYWHERE = replace(
    LOW_LATITUDE, name="everywhere", latitudes=(0.0, 88.0), longitudes=(-180.0, 180.0), window=3.0, highest=88.0
)
EVERY_CIRCLE = replace(EVERYWHERE, name="every circle", motion=Motion.GREAT_CIRCLE)


@pytest.mark.parametrize("pairs", [100, pytest.param(2000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("workload", [EVERYWHERE, EVERY_CIRCLE], ids=lambda workload: workload.name)
def test_regions_cover_the_first_contact(workload: Workload, pairs: int) -> None:
    """They reach beyond sides that are straight in the plane by at most a metre, as PostGIS draws them in degrees."""
    seen, seed, agreed = 0, 0, 0
    while seen < pairs:
        seed += 1
        scene, areas, tracks = plain_scene(workload, seed, 5, 5, tolerance_m=0.0)
        answer = found(scene, areas, tracks)
        where, place = regions_of(answer), shapely.points(answer.first_contact_deg)
        known = ~shapely.is_missing(where)  # next to a pole the database finds them out
        assert shapely.is_valid(where[known]).all(), seed
        assert shapely.covers(where[known], place[known]).all(), seed
        seen += np.count_nonzero(known)
        for k in np.flatnonzero(known & (answer.a_kind == Kind.AREA.code) & (answer.b_kind == Kind.AREA.code)).tolist():
            at_us = int(answer.period_us[answer.period_offset[k], 0])
            agreed += agrees(scene, where[k], areas[answer.a_id[k]], areas[answer.b_id[k]], at_us)
    assert agreed > (pairs / 20 if workload.motion is Motion.RHUMB else -1)


def agrees(scene: Scene, region: shapely.Geometry, one: Area, other: Area, at_us: int) -> bool:
    """Compare the sides of a region, straight in degrees, with those of the intersection of two areas in the plane."""
    west, _, east, _ = region.bounds
    if scene.motion is not Motion.RHUMB or west == -180.0 or east == 180.0:
        return False
    lon = region.centroid.x
    first, second = (shapely.union_all(oracle.polygons_at(scene, area, at_us, lon)) for area in (one, other))
    here = region_in_plane(scene, shapely.segmentize(region, 0.02), 0, lon)
    scale = 1.0 / np.cos(np.radians(np.abs(region.bounds[1::2]).max()))
    # The rest of the intersection are lines and points.
    common = shapely.union_all([p for p in shapely.get_parts(first.intersection(second)) if p.geom_type == "Polygon"])
    apart = shapely.distance(shapely.points(shapely.get_coordinates(here)), common.boundary)
    assert apart.max() <= 1.01 * conflict_regions.BEYOND_M * scale
    return True


def test_regions_contain_what_lies_along_a_side_that_bends() -> None:
    """A side from 50 to 60 degrees bends by kilometres: places 5 cm inside both areas are in the region."""
    start, end = (10.0, 50.0), (20.0, 60.0)
    areas = [
        Area("A", shapely.MultiPolygon([shapely.Polygon([start, (20.0, 50.0), end])])),
        Area("B", shapely.MultiPolygon([shapely.box(12.0, 51.0, 18.0, 59.0)])),
    ]
    (region,) = regions_of(found(Scene("s", tolerance_m=0.0), areas, []))
    lat = np.linspace(53.0, 57.0, 2000)
    eccentricity = np.sqrt(0.00669437999014)

    def isometric(degrees: NDArray[np.float64] | float) -> NDArray[np.float64]:
        sine = np.sin(np.radians(degrees))
        return np.arctanh(sine) - eccentricity * np.arctanh(eccentricity * sine)

    share = (isometric(lat) - isometric(start[1])) / (isometric(end[1]) - isometric(start[1]))
    east_m = 0.05 * np.sqrt(2.0)  # the side goes north-east, 45 degrees or steeper
    lon = start[0] + share * (end[0] - start[0]) + east_m / (111_000.0 * np.cos(np.radians(lat)))
    assert shapely.covers(region, shapely.points(lon, lat)).all()


def test_regions_do_not_depend_on_threads() -> None:
    scene, areas, tracks = plain_scene(LOW_LATITUDE, 4, 20, 40)
    one, three = found(scene, areas, tracks), found(scene, areas, tracks, jobs=3)
    assert shapely.to_wkb(regions_of(one)).tolist() == shapely.to_wkb(regions_of(three)).tolist()


def test_region_of_a_haven_that_passes_a_corner_is_about_that_corner() -> None:
    """The region excludes the rest of the slice's swept area: the contact lasts a moment."""
    area = Area("A", shapely.MultiPolygon([shapely.box(0.0, 0.0, 1.0, 1.0)]))
    outline = np.array([[-100.0, -100.0], [100.0, -100.0], [100.0, 100.0], [-100.0, 100.0]])
    # 100 m of the way in 141: the corner comes in by 40 m at most.
    way = np.array([[0.5, 1.5], [1.5, 0.5]]) + 0.0005
    track = Track("T", way, np.array([0, 36_000_000_000]), outline)
    (region,) = regions_of(found(Scene("s", tolerance_m=0.0), [area], [track]))
    assert shapely.box(0.999, 0.999, 1.0, 1.0).buffer(1e-9).covers(region)


@pytest.mark.parametrize("lat", [40.0, -41.0])
def test_thin_and_long_regions_lose_nothing_where_sides_bend_in_degrees(lat: float) -> None:
    """Two areas overlap by a metre along 140 km: in degrees their sides, one with a corner, would cross."""
    scene = Scene("s", tolerance_m=0.0)
    plane = Setup.of(scene).plane
    start, end = np.stack(plane.to_plane(np.array([0.0, 1.0]), np.array([lat, lat + 1.0])), axis=1)
    across = np.array([start[1] - end[1], end[0] - start[0]]) / np.hypot(*(end - start))
    middle = 0.5 * (start + end)

    def area(key: str, corners: list[np.ndarray]) -> Area:
        lonlat = np.stack(plane.from_plane(*np.stack(corners, axis=1)), axis=1)
        return Area(key, shapely.MultiPolygon([shapely.Polygon(lonlat)]))

    below = area("A", [start, end, middle - 1e4 * across])
    above = area("B", [start - across, middle - 1.5 * across, end - across, middle + 1e4 * across])
    (region,) = regions_of(found(scene, [below, above], []))
    assert region.is_valid
    along = start + np.linspace(0.1, 0.9, 50)[:, None] * (end - start) - 0.5 * across
    assert shapely.dwithin(region_in_plane(scene, region, 0, 0.0), shapely.points(along), 1e-3).all()


def test_parts_that_are_next_to_each_other_are_put_together_and_others_are_not() -> None:
    """The union covers all parts, and is little larger; also for parts in a ring around an empty middle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    around = [shapely.Point(2e3 * np.cos(a), 2e3 * np.sin(a)).buffer(150.0, quad_segs=3) for a in angle]
    still = [shapely.box(x, 1e4 + x, x + 100.0, 1e4 + 2.0 * x + 50.0) for x in np.linspace(0.0, 3.0, 500)]
    two_places = [shapely.box(5e4 * (i % 2), -1e4, 5e4 * (i % 2) + 10.0, -9e3) for i in range(20)]
    for parts, most in ((around, 120), (still, 3), (two_places, 20)):
        rings = [np.asarray(shapely.orient_polygons(part).exterior.coords) for part in parts]
        offset = np.concatenate([[0], np.cumsum([len(one) for one in rings])])
        owner = np.full(len(parts), 7)
        ring, ends, owners = joined(np.concatenate(rings), offset, owner)
        assert set(owners.tolist()) == {7}
        assert len(owners) <= most
        put = shapely.union_all([shapely.Polygon(ring[i:j]) for i, j in pairwise(ends.tolist())])
        whole = shapely.union_all(parts)
        assert whole.difference(put).area < 1e-6
        assert put.area <= 1.12 * whole.area  # of each hull a tenth; they overlap


def test_regions_of_many_contacts_have_few_corners() -> None:
    """A haven drifts next to another for hours, at changing speed: each contact had its own corners."""
    outline = np.array([[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]])
    rng = np.random.default_rng(5)
    times = np.arange(60) * 60_000_000
    tracks = [
        Track(key, np.stack([np.cumsum(1e-6 * rng.random(60)), np.full(60, north)], axis=1), times, outline)
        for key, north in (("A", 0.0), ("B", 0.0005))
    ]
    (region,) = regions_of(found(Scene("s", tolerance_m=0.0), [], tracks))
    assert shapely.get_num_coordinates(region) < 60
    west, _, east, _ = shapely.bounds(shapely.multipoints(np.concatenate([t.positions_deg for t in tracks])))
    assert shapely.box(west - 4.6e-4, 0.0, east + 4.6e-4, 5e-4).buffer(1e-4).covers(region)
    assert region.covers(shapely.box(west - 4e-4, 1e-4, west + 4e-4, 4e-4))
