"""Separations and closest approaches at any distance and latitude: verdicts on either side of a known geodesic.

Places at a distance computed by PROJ, on areas without time limits, on havens at rest and on points.
"""

import numpy as np
import pytest
import shapely
from pyproj import Geod
from scenes import HOUR_S, area, track

from conflictdb import Conflict, solve
from conflictdb.earth.geodesy import MEAN_RADIUS_M, WGS84_FLATTENING, WGS84_RADIUS_M
from conflictdb.errors import InvalidInput
from conflictdb.model.plans import MAX_DISTANCE_M, Area, EarthModel, Motion, Scene, Track
from conflictdb.model.results import Verdict

GEODESICS = {
    EarthModel.WGS84: Geod(a=WGS84_RADIUS_M, f=WGS84_FLATTENING),
    EarthModel.SPHERE: Geod(a=MEAN_RADIUS_M, b=MEAN_RADIUS_M),
}
earths = pytest.mark.parametrize("earth", EarthModel)
# On the sphere it is the same with one error less.
mostly_wgs84 = pytest.mark.parametrize(
    "earth", [EarthModel.WGS84, pytest.param(EarthModel.SPHERE, marks=pytest.mark.slow)]
)
# Latitude, bearing and metres to the other place.
WAYS = [
    (85.0, 95.0, 200_409.0),
    (85.0, 0.0, 200_000.0),
    (88.9, 80.0, 120_000.0),
    (80.0, 70.0, 400_000.0),
    (-80.0, 100.0, 50_000.0),
    (60.0, 40.0, 1_000_000.0),
    (74.0, 90.0, 1_000_000.0),
    (0.0, 30.0, 1_000_000.0),
    (50.0, 60.0, 3_000_000.0),
    (-75.0, 120.0, 3_000_000.0),
    (88.99, 10.0, 6_000_000.0),
]
ways = pytest.mark.parametrize(("lat", "bearing", "away_m"), WAYS)


def places(earth: EarthModel, lat: float, bearing: float, away_m: float) -> list[tuple[float, float]]:
    """Two places this far apart, the first at 175 E, so that ways to the east cross the seam."""
    lon, other, _ = GEODESICS[earth].fwd(175.0, lat, bearing, away_m)
    return [(175.0, lat), (lon, other)]


def speck(key: str, lon: float, lat: float) -> Area:
    """An area of a few centimetres."""
    east, north = 1e-7 / np.cos(np.radians(lat)), 1e-7
    return area(key, shapely.box(lon - east, lat - north, lon + east, lat + north))


def waiting(key: str, lon: float, lat: float, size_m: float) -> Track:
    return track(key, [(lon, lat), (lon, lat)], [0, HOUR_S], size_m, size_m, size_m, size_m)


def objects(at: list[tuple[float, float]]) -> tuple[list[Track], list[Area]]:
    """A point and a small haven, both at rest, and a small area at each of two places."""
    tracks = [waiting(f"{kind}{k}", *at[k], size_m) for k in (0, 1) for kind, size_m in (("P", 0.0), ("H", 0.02))]
    return tracks, [speck(f"A{k}", *at[k]) for k in (0, 1)]


def across(found: list[Conflict]) -> list[Conflict]:
    """Return the conflicts between the two places."""
    return [one for one in found if one.a_key[1] != one.b_key[1]]


def verdicts(found: list[Conflict]) -> list[Verdict]:
    return [one.verdict for one in across(found)]


@mostly_wgs84
@ways
def test_verdicts_on_either_side_of_a_known_distance(
    earth: EarthModel, lat: float, bearing: float, away_m: float
) -> None:
    """A conflict if they are nearer than the required separation by more than the tolerance, else none."""
    things = objects(places(earth, lat, bearing, away_m))
    # A metre, and the uncertainty of the distance that far away.
    step = 1.0 + 3e-6 * away_m * (away_m > 5e5)
    for wanted_m, expected in (
        (away_m - step, []),
        (away_m + step, [Verdict.CONFLICT] * 9),
    ):
        found = solve(*things, Scene("s", earth=earth, separation_m=wanted_m, tolerance_m=0.1))
        assert verdicts(found) == expected, wanted_m


@mostly_wgs84
@ways
def test_closest_approach_of_places_far_apart(earth: EarthModel, lat: float, bearing: float, away_m: float) -> None:
    """The distance is the geodesic, up to its bound and the size of the objects; the closest points fit it."""
    things = objects(places(earth, lat, bearing, away_m))
    found = across(solve(*things, Scene("s", earth=earth, nearest_m=away_m * 1.1, tolerance_m=0.0)))
    assert [one.verdict for one in found] == [Verdict.NEAR] * 9
    for one in found:
        size_m = sum({"P": 0.0, "A": 0.03, "H": 0.03}[key[0]] for key in (one.a_key, one.b_key))
        assert abs(one.closest_m - away_m) <= one.closest_error_m + size_m + 1e-6
        between = GEODESICS[earth].inv(*one.closest_a_deg, *one.closest_b_deg)[2]
        assert abs(between - one.closest_m) <= one.closest_error_m + 1e-6
        assert one.closest_error_m <= 2e-3 + 4e-6 * away_m * (away_m / 6e6) ** 2
    least_m = away_m - max(one.closest_error_m for one in found) - 1.0
    assert not across(solve(*things, Scene("s", earth=earth, nearest_m=least_m, tolerance_m=0.0)))


def test_points_at_85_degrees() -> None:
    """Once found as a conflict, 6 km nearer than they are, by a formula for places near each other."""
    at = [(10.0, 85.0), (29.733025909255737, 84.68977614741037)]
    true = GEODESICS[EarthModel.WGS84].inv(*at[0], *at[1])[2]
    assert true == pytest.approx(200_000.0, abs=1e-3)
    points = [waiting(key, *place, 0.0) for key, place in zip("AB", at, strict=True)]
    for tolerance_m in (0.0, 1.0):
        assert not solve(points, [], Scene("s", separation_m=195_000.0, tolerance_m=tolerance_m))
    (found,) = solve(points, [], Scene("s", nearest_m=250_000.0, tolerance_m=0.0))
    assert found.verdict is Verdict.NEAR
    assert abs(found.closest_m - true) <= found.closest_error_m < 2e-3


@earths
def test_too_close_to_call_is_not_called(earth: EarthModel) -> None:
    """If distances are not known to the tolerance, a pair between the bounds is unresolved, not a conflict."""
    away_m = 9_000_000.0
    at = places(earth, 10.0, 50.0, away_m)
    things = [waiting(f"P{k}", *at[k], 0.0) for k in (0, 1)], [speck(f"A{k}", *at[k]) for k in (0, 1)]
    near = across(solve(*things, Scene("s", earth=earth, nearest_m=away_m * 1.1, tolerance_m=0.0)))
    (near,) = (one for one in near if one.a_key[0] == one.b_key[0] == "P")
    least, most = near.closest_m - near.closest_error_m, near.closest_m + near.closest_error_m
    between = Scene("s", earth=earth, separation_m=near.closest_m + 0.1, tolerance_m=0.0)
    expected = [Verdict.CONFLICT if earth is EarthModel.SPHERE else Verdict.UNRESOLVED] * 4
    assert verdicts(solve(*things, between)) == expected
    tolerance_m = 0.5 * near.closest_error_m
    apart = Scene("s", earth=earth, separation_m=least - tolerance_m - 0.1, tolerance_m=tolerance_m)
    assert verdicts(solve(*things, apart)) == []
    close = Scene("s", earth=earth, separation_m=most * 1.00001 + tolerance_m + 0.1, tolerance_m=tolerance_m)
    assert verdicts(solve(*things, close)) == [Verdict.CONFLICT] * 4


@earths
def test_opposite_places(earth: EarthModel) -> None:
    """No shortest way is known between them: the bound says how little is."""
    at = [(10.0, 30.0), (-170.0, -29.0)]
    true = GEODESICS[earth].inv(*at[0], *at[1])[2]
    points = [waiting(key, *place, 0.0) for key, place in zip("AB", at, strict=True)]
    (found,) = solve(points, [], Scene("s", earth=earth, nearest_m=MAX_DISTANCE_M, tolerance_m=0.0))
    assert abs(found.closest_m - true) <= found.closest_error_m
    assert (found.closest_error_m < 0.01) is (earth is EarthModel.SPHERE)


@pytest.mark.parametrize("motion", Motion)
@pytest.mark.parametrize("name", ["separation_m", "nearest_m", "tolerance_m"])
def test_no_two_places_are_further_apart(motion: Motion, name: str) -> None:
    Scene("s", motion=motion, **{name: MAX_DISTANCE_M})
    with pytest.raises(InvalidInput, match=f"{name}.* half the way around the earth"):
        Scene("s", motion=motion, **{name: np.nextafter(MAX_DISTANCE_M, np.inf)})
