"""Scenes of great circles on their way in and out: settings, files, the limits of their plane, and polar polygons."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from layouts import OCEAN
from mixed_scenes import plain_scene
from scenes import T0_US, box
from verdicts import periods_us

from conflictdb import Area, EarthModel, InvalidInput, Motion, Scene, Track, kernel, rectangle_outline_m, solve
from conflictdb.arrays.objects import AreaBatch, TrackBatch
from conflictdb.client.advise import advise
from conflictdb.core.pieces.cutting import area_pieces, check_plane, planar, track_pieces
from conflictdb.earth.geodesy import MEAN_RADIUS_M as RADIUS_M
from conflictdb.earth.geodesy import great_circle_distance
from conflictdb.earth.registry import Setup, centred, middle_deg, summed_directions
from conflictdb.formats.scene_file import read_scene, scene_text
from conflictdb.kernel.movement import Movement

HOUR_US = 3_600_000_000
HAVEN = {"fore_m": 1000, "aft_m": 1000, "port_m": 500, "starboard_m": 500}


def sail(key: str, *positions: tuple[float, float], size_m: float = 1e3) -> Track:
    times = T0_US + HOUR_US * np.arange(len(positions))
    return Track(
        key,
        np.array(positions, dtype=float),
        times,
        rectangle_outline_m(size_m, size_m, size_m, size_m),
        max_speed_kn=np.inf,
    )


def document(scene: dict[str, Any], *features: dict[str, Any]) -> str:
    return json.dumps({"type": "FeatureCollection", "scene": scene, "features": list(features)})


def test_great_circles_are_on_the_sphere() -> None:
    assert Scene("s", Motion.GREAT_CIRCLE).earth is EarthModel.SPHERE
    assert Scene("s", "great_circle").earth is EarthModel.SPHERE  # type: ignore[arg-type]
    assert Scene("s").earth is EarthModel.WGS84
    with pytest.raises(InvalidInput, match="earth: must be 'sphere' with motion 'great_circle', or left out"):
        Scene("s", Motion.GREAT_CIRCLE, EarthModel.WGS84)


@pytest.mark.parametrize("centre", [(0.0,), (181.0, 0.0), (0.0, 90.5), (float("nan"), 0.0), "1, 2", (True, 0), 5])
def test_centre_is_a_place(centre: Any) -> None:
    with pytest.raises(InvalidInput, match=r"centre: must be \[longitude, latitude\] in degrees"):
        Scene("s", Motion.GREAT_CIRCLE, centre=centre)


def test_rhumb_lines_have_no_centre() -> None:
    with pytest.raises(InvalidInput, match="centre: has a meaning with motion 'great_circle' only"):
        Scene("s", centre=(0.0, 0.0))


def test_file_names_motion_and_centre_and_comes_back_as_it_was() -> None:
    area = {
        "type": "Feature",
        "id": "A",
        "geometry": shapely.geometry.mapping(shapely.box(-30.1, 50.2, -29.3, 51.4)),
        "properties": {},
    }
    contents = read_scene(document({"motion": "great_circle", "centre": [-30.25, 51]}, area), "stem")
    assert contents.scene == Scene("stem", Motion.GREAT_CIRCLE, EarthModel.SPHERE, centre=(-30.25, 51.0))
    again = read_scene("".join(scene_text(contents.scene, contents.areas, contents.tracks)), "x")
    assert again.scene == contents.scene
    assert again.areas == contents.areas
    without = read_scene(document({"motion": "great_circle"}, area), "stem")
    assert without.scene is not None
    assert "centre" not in json.loads("".join(scene_text(without.scene, without.areas, [])))["scene"]


@pytest.mark.parametrize(
    ("scene", "match"),
    [
        ({"motion": "great_circle", "earth": "wgs84"}, "earth: must be 'sphere'"),
        ({"motion": "great_circle", "centre": {"lon": 1}}, "centre: must be"),
        ({"motion": "great_circle", "center": [1, 2]}, "center: is no setting of a scene"),
        ({"centre": [1, 2]}, "centre: has a meaning"),
    ],
)
def test_file_with_a_bad_setting_is_refused(scene: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidInput, match=match):
        read_scene(document(scene), "stem")


def test_speeds_are_along_great_circles() -> None:
    """Over the pole from 60 to 60 degrees is 60 degrees of a great circle, although not a rhumb line at all."""
    track = {
        "type": "Feature",
        "id": "T",
        "geometry": {"type": "LineString", "coordinates": [[20, 60], [-160, 60]]},
        "properties": {"start": "2026-03-01T00:00:00Z", "speed_mps": 100, **HAVEN},
    }
    (read,) = read_scene(document({"motion": "great_circle"}, track), "s").tracks
    assert (read.times_us[1] - read.times_us[0]) / 1e6 == pytest.approx(np.radians(60) * RADIUS_M / 100, abs=1e-6)
    track["geometry"]["coordinates"] = [[20, 85], [20, 90], [-70, 85]]  # type: ignore[index]
    (read,) = read_scene(document({"motion": "great_circle"}, track), "s").tracks
    np.testing.assert_allclose(np.diff(read.times_us) / 1e6, np.radians(5) * RADIUS_M / 100, atol=1e-6)


def test_distance_on_a_great_circle_is_good_near_and_far() -> None:
    assert great_circle_distance(0.0, 0.0, 180.0, 0.0) == pytest.approx(np.pi * RADIUS_M, rel=1e-15)
    assert great_circle_distance(10.0, 50.0, 370.0, 50.0) == 0.0
    short = great_circle_distance(10.0, 60.0, 10.0 + 1e-9, 60.0)
    assert short == pytest.approx(np.radians((10.0 + 1e-9) - 10.0) * 0.5 * RADIUS_M, rel=1e-12)


def test_centre_is_the_middle_of_the_objects_where_none_is_given() -> None:
    scene = Scene("s", Motion.GREAT_CIRCLE)
    assert centred(scene, [], []) == scene
    assert centred(Scene("s"), [], [sail("T", (1, 1), (2, 2))]).centre is None
    assert centred(scene, [], [sail("T", (179, 10), (-179, 10))]).centre == pytest.approx((180.0, 10.0015), abs=1e-3)
    assert centred(scene, [], [sail("T", (0, 80), (180, 80))]).centre[1] == 90.0  # type: ignore[index]
    opposite = [sail("T", (10, 20), (-170, -20))]
    assert centred(scene, [], opposite).centre == (10.0, 20.0)
    with pytest.raises(InvalidInput, match="reaches beyond 60 degrees from the scene's centre"):
        solve(opposite, [], scene)
    given = Scene("s", Motion.GREAT_CIRCLE, centre=(3.0, 4.0))
    assert centred(given, [], [sail("T", (1, 1), (2, 2))]) is given


def test_the_middle_of_places_is_that_of_their_parts() -> None:
    places = np.random.default_rng(1).uniform((-60, 40), (10, 80), (1000, 2))
    parts = [summed_directions(part) for part in np.array_split(places, 7)]
    middle = centred(Scene("s", Motion.GREAT_CIRCLE), [], [sail("T", *places)]).centre
    assert middle_deg(np.sum(parts, axis=0)) == middle_deg(summed_directions(places)) == middle


CENTRED = Scene("s", Motion.GREAT_CIRCLE, centre=(0.0, 0.0))


@pytest.mark.parametrize(
    ("areas", "tracks", "match"),
    [
        ([box("A", 0, 0, 1, 1), box("FAR", 59, 0, 61, 1)], [], "area 'FAR': geometry: reaches beyond 60 degrees"),
        ([], [sail("T", (0, 0), (60.5, 0))], "track 'T': geometry: reaches beyond 60 degrees"),
        ([], [sail("T", (0, 0), (180, 0))], "track 'T': geometry: reaches beyond 60 degrees"),
        ([], [sail("T", (10, 10), (-170, -10))], "track 'T': geometry: reaches beyond 60 degrees"),
        ([], [sail("T", (0, 0), (59.9, 0), size_m=1e5)], "track 'T': outline_m: the haven reaches beyond 60 degrees"),
        ([], [sail("T", (0, 0), (1, 0), size_m=1.5e7)], "track 'T': outline_m: the haven reaches beyond 60 degrees"),
    ],
)
def test_what_the_plane_cannot_hold_is_named(areas: list[Area], tracks: list[Track], match: str) -> None:
    """With the limit, the centre and a remedy."""
    with pytest.raises(InvalidInput, match=match) as refused:
        check_plane(Setup.of(CENTRED).plane, areas, tracks)
    assert "(0, 0)" in str(refused.value)
    assert "give the scene a 'centre'" in str(refused.value)


def test_exactly_at_the_limit_is_held() -> None:
    check_plane(Setup.of(CENTRED).plane, [box("A", -59.99, 0, -59, 0.5)], [sail("T", (0, 0), (60, 0), size_m=0.0)])


def test_edges_that_cross_on_the_earth_are_refused() -> None:
    """On a map the tip is clear of the long side, which on the earth runs further north."""
    footprint = shapely.MultiPolygon([shapely.Polygon([(-50, 50), (50, 50), (50, 60), (0, 55), (-50, 60)])])
    scene = Scene("s", Motion.GREAT_CIRCLE, centre=(0.0, 50.0))
    with pytest.raises(InvalidInput, match="crosses itself when its edges are great circles"):
        check_plane(Setup.of(scene).plane, [Area("A", footprint)], [])


def test_what_is_cut_at_the_seam_or_runs_along_a_pole_is_whole() -> None:
    pole = shapely.Polygon([(-180, 80), (-90, 75), (0, 80), (90, 75), (180, 80), (180, 90), (-180, 90)])
    seam = shapely.MultiPolygon([shapely.box(170, 60, 180, 70), shapely.box(-180, 60, -170, 70)])
    whole = shapely.Polygon([(170, 60), (180, 60), (190, 60), (190, 70), (180, 70), (170, 70)])
    scene = Scene("s", Motion.GREAT_CIRCLE, centre=(150.0, 80.0))
    given = [shapely.MultiPolygon([pole]), seam, shapely.MultiPolygon([whole])]
    areas = [Area(f"A{i}", footprint) for i, footprint in enumerate(given)]
    check_plane(Setup.of(scene).plane, areas, [])
    flat = planar(Setup.of(scene).plane, np.array(given, dtype=object))
    assert shapely.is_valid(flat).all()
    assert [len(shapely.get_parts(one)) for one in flat] == [1, 1, 1]
    x, y = Setup.of(scene).plane.to_plane(np.array([-90, 0, 90, 180]), np.array([75, 80, 75, 80]))
    for one, other in ((flat[0], shapely.Polygon(np.stack([x, y], axis=1))), (flat[1], flat[2])):
        assert shapely.symmetric_difference(one, other).area < 1e-9 * one.area
    pieces = area_pieces(Setup.of(scene), AreaBatch.of(areas))
    assert np.bincount(pieces.object_id).tolist() == [1, 2, 2]  # the northern side of a box runs south of its ends
    assert (pieces.turn == 0).all()


def test_area_without_an_end_around_the_pole_meets_what_passes_over_it() -> None:
    pole = shapely.Polygon([(-180, 89), (180, 89), (180, 90), (-180, 90)])
    areas = [
        Area(
            "POLE",
            shapely.MultiPolygon(
                [shapely.Polygon([*pole.exterior.coords[:1], (-60, 89), (60, 89), *pole.exterior.coords[1:]])]
            ),
        )
    ]
    tracks = [sail("OVER", (0, 85), (180, 85), size_m=0.0), sail("PAST", (-60, 80), (60, 80), size_m=0.0)]
    (found,) = solve(tracks, areas, Scene("s", Motion.GREAT_CIRCLE))
    assert (found.a_key, found.b_key) == ("POLE", "OVER")
    # The way passes a corner of the triangle around the pole, and the middle of the opposite edge.
    edge = np.degrees(np.arctan(np.tan(np.radians(1.0)) * np.cos(np.radians(60.0))))
    ((start, end),) = periods_us(found)
    assert start is not None
    assert end is not None
    assert (start - T0_US) / HOUR_US == pytest.approx((5 - edge) / 10, abs=1e-6)
    assert (end - T0_US) / HOUR_US == pytest.approx((5 + 1.0) / 10, abs=1e-6)


def test_loiters_at_a_pole_keep_their_heading_on_whatever_meridian_they_are_written() -> None:
    scene = Scene("s", Motion.GREAT_CIRCLE, centre=(0.0, 90.0))
    track = sail("T", (20, 80), (20, 90), (75, 90), (-100, 90), (-100, 85))
    legs = track_pieces(Setup.of(scene), TrackBatch.of([track]))
    prepared = kernel.KernelScene(Setup.of(scene).plane.kernel_plane, legs)
    tips = []
    for instant_us in (T0_US + HOUR_US - 1, T0_US + HOUR_US, T0_US + 2 * HOUR_US, T0_US + 3 * HOUR_US - 1):
        row = np.flatnonzero((legs.start_us <= instant_us) & (instant_us < legs.end_us))[:1]
        at = Movement.of(prepared, row, np.array([instant_us])).positions(np.zeros(1))
        tips.append(at[:, :, 0])
    for tip in tips[1:]:
        np.testing.assert_allclose(tip, tips[0], atol=1.0)


def test_scenes_near_and_far_from_their_centre_give_one_answer() -> None:
    """The plane is a means: where it touches changes nothing but the last digits."""
    tracks = [sail("T", (10, 50), (20, 58), (12, 60), size_m=3e4), sail("U", (21, 51), (9, 57), (25, 60), size_m=5e4)]
    areas = [box("A", 14, 53, 17, 56), box("B", 12, 54, 15, 57)]
    answers = []
    for centre in [(15.0, 55.0), (-20.0, 30.0), (60.0, 40.0), (100.0, 80.0)]:
        answers.append(solve(tracks, areas, Scene("s", Motion.GREAT_CIRCLE, centre=centre)))
    assert len(answers[0]) == 6
    for answer in answers[1:]:
        for one, other in zip(answers[0], answer, strict=True):
            assert (one.a_key, one.b_key, one.verdict) == (other.a_key, other.b_key, other.verdict)
            for ours, theirs in zip(periods_us(one), periods_us(other), strict=True):
                assert ours == pytest.approx(theirs, abs=2)


def test_advice_about_great_circles() -> None:
    """About the middle of the objects if the scene has no centre yet."""
    scene, areas, tracks = plain_scene(OCEAN, 3, 8, 8)
    for centre in (scene.centre, None):
        advice = advise(replace(scene, centre=centre), areas, tracks, sample=10)
        assert advice.estimates
        assert advice.scene.centre is not None
        assert advice.sampled_pairs > 0
