"""Intersections of areas of many parts, of any form, computed without uniting thousands of parts."""

from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from shapely.affinity import translate
from staged import Staged

from conflictdb.core import conflict_regions, shared_areas
from conflictdb.core.pieces.cutting import planar
from conflictdb.earth.registry import Setup
from conflictdb.model.plans import Area, Motion, Scene

# Plane metres, at the largest scale of these tests: coordinates and sides are rounded by less.
ROUNDED_M = 0.2


def star(seed: int, corners: int, lon: float, lat: float, size_deg: float) -> shapely.Polygon:
    """Return an area with many dents."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.random(corners)) * 2.0 * np.pi
    wave = np.arange(1, 40)[:, None]
    radius = 1.0 + 0.3 * (rng.standard_normal((39, 1)) / wave * np.cos(wave * angle + 6.28 * rng.random((39, 1)))).sum(
        0
    )
    radius = size_deg * np.maximum(radius, 0.2) * (1.0 + 0.02 * rng.standard_normal(corners))
    xy = np.stack([lon + radius * np.cos(angle) / np.cos(np.radians(lat)), lat + radius * np.sin(angle)], axis=1)
    return shapely.Polygon(xy)


def squares(seed: int, lon: float, lat: float) -> shapely.MultiPolygon:
    """Return an area of many parts."""
    rng = np.random.default_rng(seed)
    at = 0.1 * np.stack(np.meshgrid(np.arange(8), np.arange(8)), axis=-1).reshape(-1, 2) + [lon, lat]
    return shapely.MultiPolygon(shapely.box(*at.T, *(at + 0.1 * rng.uniform(0.3, 0.95, at.shape)).T).tolist())


def pierced(seed: int, lon: float, lat: float) -> shapely.Geometry:
    """Return an area with holes."""
    rng = np.random.default_rng(seed)
    holes = [
        shapely.Point(*at).buffer(0.05, quad_segs=2)
        for at in rng.uniform((lon - 0.6, lat - 0.6), (lon + 0.6, lat + 0.6), (20, 2))
    ]
    return star(seed, 200, lon, lat, 1.0).difference(shapely.union_all(holes))


def as_area(key: str, footprint: shapely.Geometry) -> Area:
    parts = [part for part in shapely.get_parts(footprint) if part.geom_type == "Polygon"]
    return Area(key, shapely.MultiPolygon(parts))


def region_of(scene: Scene, one: shapely.Geometry, other: shapely.Geometry) -> shapely.Geometry:
    """Return the region of two areas in conflict."""
    answer, _ = Staged.of(scene, [as_area("A", one), as_area("B", other)], []).run()
    (region,) = answer.where(np.arange(len(answer))).geometries()
    return region


def in_plane(scene: Scene, region: shapely.Geometry) -> shapely.Geometry:
    return planar(Setup.of(scene).plane, np.array([region], dtype=object))[0]


CASES = {
    "dents": (star(1, 300, 0.0, 50.0, 1.0), star(2, 300, 0.5, 50.3, 1.0)),
    "the same": (star(1, 200, 0.0, 50.0, 1.0), star(1, 200, 0.0, 50.0, 1.0)),
    "holes": (pierced(3, 0.0, 50.0), pierced(4, 0.3, 50.2)),
    "parts": (squares(5, 0.0, 50.0), squares(6, 0.03, 50.02)),
    "85 N": (star(1, 300, 0.0, 85.0, 0.2), star(2, 300, 0.5, 85.05, 0.2)),
    "small": (star(1, 300, 0.0, 50.0, 1e-4), star(2, 300, 5e-5, 50.00003, 1e-4)),
}


@pytest.mark.parametrize("tolerance_m", [0.0, 1.0])
@pytest.mark.parametrize("motion", Motion)
@pytest.mark.parametrize("case", CASES)
def test_areas_of_many_parts_have_in_common_what_their_footprints_do(
    case: str, motion: Motion, tolerance_m: float
) -> None:
    """A union of the intersections of pairs of parts lost some of it, and had a rim where parts touch."""
    one, other = CASES[case]
    if motion == Motion.GREAT_CIRCLE:
        scene = Scene("s", motion=motion, centre=tuple(one.centroid.coords[0]), tolerance_m=tolerance_m)
    else:
        scene = Scene("s", tolerance_m=tolerance_m)
    region = region_of(scene, one, other)
    assert region.is_valid
    assert shapely.get_srid(region) == 4326
    common = in_plane(scene, one).intersection(in_plane(scene, other))
    found, plane = in_plane(scene, region), Setup.of(scene).plane
    dense = shapely.get_coordinates(shapely.segmentize(common.buffer(-1e-4), common.length / 3000.0))
    places = np.stack(plane.from_plane(*dense.T), axis=1)
    shapely.prepare(region)
    assert shapely.covers(region, shapely.points(places)).all()
    # Areas of 10 m touch where they are not cut as in the plane of the test.
    near_m = (1.01 + 3.0 * tolerance_m * float(case == "small")) * float(plane.largest_scale(dense.T[:, :, None]).max())
    assert found.difference(common.buffer(near_m + ROUNDED_M)).area == 0.0
    assert found.area <= common.area + near_m * common.length


@pytest.mark.parametrize("lat", [10.0, -85.0])
def test_what_areas_of_many_parts_have_in_common_is_cut_at_the_seam(lat: float) -> None:
    """The region is that of another longitude, on both sides of the seam."""
    one, other = star(1, 300, 0.0, lat, 0.3), star(2, 300, 0.3, lat + 0.1, 0.3)
    elsewhere = region_of(Scene("s"), one, other)

    def on_seam(footprint: shapely.Geometry) -> shapely.Geometry:
        east = translate(footprint, 179.9)
        beyond = translate(east.intersection(shapely.box(180.0, -90.0, 300.0, 90.0)), -360.0)
        return shapely.union_all([east.intersection(shapely.box(0.0, -90.0, 180.0, 90.0)), beyond])

    region = region_of(Scene("s"), on_seam(one), on_seam(other))
    assert region.is_valid
    west, _, east, _ = region.bounds
    assert (west, east) == (-180.0, 180.0)
    halves = [
        translate(region.intersection(shapely.box(*box)), by)
        for box, by in (((0.0, -90.0, 180.0, 90.0), -179.9), ((-180.0, -90.0, 0.0, 90.0), 180.1))
    ]
    # The cut adds corners: sides between others bend in degrees.
    assert shapely.union_all(halves).symmetric_difference(elsewhere).area < 1e-5 * elsewhere.area


@pytest.mark.parametrize("scene", [Scene("s"), Scene("s", separation_m=500.0)], ids=["touch", "separation"])
def test_where_areas_of_many_parts_only_come_near_is_part_of_their_region(scene: Scene) -> None:
    """They overlap in one place, touch in a second and are 300 m apart in a third: nothing of that is lost."""
    one = squares(5, 0.0, 50.0)
    far = [shapely.box(2.0, 50.0, 2.1, 50.1), shapely.box(3.0, 50.0, 3.1, 50.1)]
    near = [shapely.box(2.1, 50.0, 2.2, 50.1), shapely.box(3.1 + 0.3 / 71.7, 50.0, 3.2, 50.1)]
    mine, others = (
        shapely.MultiPolygon([*one.geoms, *far]),
        shapely.MultiPolygon([*squares(6, 0.03, 50.02).geoms, *near]),
    )
    region = region_of(scene, mine, others)
    assert shapely.dwithin(region, shapely.LineString([(2.1, 50.001), (2.1, 50.099)]), 0.0)
    assert region.buffer(1e-9).covers(shapely.LineString([(2.1, 50.001), (2.1, 50.099)]))
    middle = shapely.LineString([(3.1 + 0.15 / 71.7, 50.001), (3.1 + 0.15 / 71.7, 50.099)])
    assert region.covers(middle) == (scene.separation_m > 0.0)
    assert region.buffer(1e-9).covers(squares(5, 0.0, 50.0).intersection(squares(6, 0.03, 50.02)))


def test_unions_of_parts_that_are_next_to_each_other_by_rounding_lose_nothing() -> None:
    """The intersection of two areas, in four parts: without a grid a tenth of it was lost."""
    rings = (
        (
            "77775.30350456905 3226.832265546531, 86458.41720861946 -71332.55170255814, 93287.42958581126 "
            "-76722.0984397641, 166683.49327875837 39720.77820576208, 77775.30350456905 3226.832265546531"
        ),
        (
            "71445.25293718434 57581.14419526346, 77775.30350456905 3226.832265546531, 166683.49327875837 "
            "39720.77820576208, 193481.3721409011 82235.6209057813, 81496.12255503716 73465.37560310264, "
            "71445.25293718434 57581.14419526346"
        ),
        (
            "64857.708151541505 -69300.5321783173, 84122.56786419128 -72643.92816956392, 86458.41720861946 "
            "-71332.55170255814, 77775.30350456905 3226.8322655465454, 30167.632034849423 -16314.582235953829, "
            "37076.30369102253 -45918.47101247645, 64857.708151541505 -69300.5321783173"
        ),
        (
            "77775.30350456905 3226.8322655465454, 71445.25293718434 57581.14419526346, 27420.568835108945 "
            "-11994.7528686343, 30167.632034849416 -16314.582235953822, 77775.30350456905 3226.8322655465454"
        ),
    )
    parts = shapely.from_wkt([f"POLYGON (({ring}))" for ring in rings])
    (union,) = shared_areas.united(parts[None, :], np.array([True]))
    assert union.area == pytest.approx(shapely.area(parts).sum(), rel=1e-9)


def test_a_union_of_what_is_narrower_than_its_grid_is_not_empty() -> None:
    parts = shapely.box(0.0, np.array([0.2e-6, 0.3e-6]), 100.0, np.array([0.35e-6, 0.45e-6]))
    (union,) = shared_areas.united(parts[None, :], np.array([True]))
    assert union.area > 0.0


def test_a_union_that_plainly_lacks_something_is_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A union without its last part, or empty, is rebuilt; also for tracks, which were never seen to fail."""
    parts = shapely.box([[0.0, 2.0, 5.0]], 0.0, [[1.0, 4.0, 9.0]], 1.0)
    union_all = shapely.union_all

    for keep in (3, 2, 0):

        def losing(parts: NDArray[Any], axis: int, grid_size: float | None = None, keep: int = keep) -> Any:
            return union_all(parts if grid_size else parts[:, :keep], axis=axis, grid_size=grid_size)

        monkeypatch.setattr(shapely, "union_all", losing)
        (union,) = shared_areas.united(parts, np.array([False]))
        assert union.area == 7.0


def test_regions_of_areas_of_many_parts_unite_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Uniting the intersections of all pairs of parts took the square of their number: 124 s for 20,000 corners."""
    sizes: list[int] = []
    united = shared_areas.united

    def counted(parts: NDArray[Any], stand: NDArray[np.bool_]) -> NDArray[Any]:
        sizes.append(parts.shape[1])
        return united(parts, stand)

    monkeypatch.setattr(conflict_regions, "united", counted)
    region_of(Scene("s"), star(1, 2000, 0.0, 50.0, 1.0), star(2, 2000, 0.5, 50.3, 1.0))
    assert max(sizes, default=0) < 50


def test_areas_that_could_not_be_cut_are_united_as_what_they_are_taken_for() -> None:
    """As hulls, which may overlap, or lie within another: they are no coverage."""
    parts = shapely.box(np.array([0.0, 5.0, 1.0]), 0.0, np.array([10.0, 15.0, 2.0]), np.array([10.0, 10.0, 2.0]))
    areas = [Area(str(i), shapely.MultiPolygon([part])) for i, part in enumerate(parts)]
    scene = Scene("s")
    whole = shared_areas._whole(Setup.of(scene).plane, Staged.of(scene, areas, []).pieces, np.arange(3))
    assert whole.symmetric_difference(shapely.union_all(planar(Setup.of(scene).plane, parts))).area < 1.0
