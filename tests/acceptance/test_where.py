"""Places of contact compared with the oracle: first contacts, regions, and havens at an instant."""

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import oracle
import psycopg
import pytest
import scenes
import shapely
from layouts import EQUATOR, HIGH_LATITUDE, SEAM, Workload
from mixed_scenes import plain_scene
from verdicts import periods_us

from conflictdb import solve, store
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, EarthModel, Scene

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
CASES = [(EQUATOR, 2, EarthModel.WGS84), (SEAM, 2, EarthModel.SPHERE), (HIGH_LATITUDE, 2, EarthModel.WGS84)]
cases = pytest.mark.parametrize(("workload", "seed", "earth"), CASES, ids=[f"{w.name}-{e}" for w, _, e in CASES])


@cases
def test_first_contact_is_a_point_of_both(workload: Workload, seed: int, earth: EarthModel) -> None:
    scene, areas, tracks = plain_scene(workload, seed, 8, 8, earth)
    objects = {thing.key: thing for thing in (*areas, *tracks)}
    globe = oracle.Globe.of(earth)
    found = [one for one in solve(tracks, areas, scene) if periods_us(one)[0][0] is not None]
    assert len(found) > 2
    for one in found:
        assert one.first_contact_deg is not None
        lon, lat = one.first_contact_deg
        assert -180.0 <= lon <= 180.0
        start = periods_us(one)[0][0]
        assert start is not None
        here = shapely.Point(0.0, globe.a * globe.isometric(np.radians(lat)))
        for key in (one.a_key, one.b_key):
            # A microsecond is millimetres at most, and the plane is larger than the earth.
            apart = [here.distance(p) for p in oracle.polygons_at(scene, objects[key], start, lon)]
            assert min(apart) < 0.1 + 50.0 * one.time_error_s, (one, key)


@pytest.mark.parametrize("upwards", [1.0, -1.0])
@pytest.mark.parametrize(("separation_m", "tolerance_m"), [(0.0, 0.0), (0.0, 30.0), (15.0, 10.0)])
def test_areas_meet_where_they_touch_not_where_parts_of_them_are_near(
    upwards: float, separation_m: float, tolerance_m: float
) -> None:
    """A bracket: one arm is 20 m off another area, and the other reaches 1 km into it."""
    corners = [(0, 0), (0.51, 0), (0.51, 0.1), (0.2, 0.1), (0.2, 0.4), (0.49982, 0.4), (0.49982, 0.5), (0, 0.5)]
    bracket = scenes.area("bracket", shapely.Polygon([(x, upwards * y) for x, y in corners]))
    other = scenes.area("other", shapely.box(0.5, -1.0, 1.0, 1.0))
    (found,) = solve([], [bracket, other], Scene("s", separation_m=separation_m, tolerance_m=tolerance_m))
    assert found.first_contact_deg is not None
    lon, lat = found.first_contact_deg
    assert 0.4999 < lon < 0.511
    assert -1e-9 < upwards * lat < 0.1 + 1e-9


@cases
def test_haven_at_an_instant(conn: psycopg.Connection[Any], workload: Workload, seed: int, earth: EarthModel) -> None:
    """The SQL function has the vertices that the oracle finds, to a tenth of a millimetre; nothing outside the span."""
    scene, _, tracks = plain_scene(workload, seed, 0, 8, earth)
    store.replace_scene(conn, scene, [], tracks, merge=False)
    globe = oracle.Globe.of(earth)
    for track in tracks:
        for leg in range(len(track.times_us) - 1):
            instant = int(track.times_us[leg] + (track.times_us[leg + 1] - track.times_us[leg]) // 3)
            row = conn.execute(
                "SELECT ST_AsBinary(conflictdb.haven_at(%s, %s, %s))",
                [scene.name, track.key, EPOCH + timedelta(microseconds=instant)],
            ).fetchone()
            assert row is not None
            found = shapely.get_coordinates(shapely.from_wkb(row[0]))
            expected = oracle.haven_at(scene, track, instant, leg)
            lon, lat = (found[:, None] - expected[None]).transpose(2, 0, 1)
            east = np.radians((lon + 180.0) % 360.0 - 180.0) * globe.across_m(np.radians(expected[:, 1]))
            apart = np.hypot(east, np.radians(lat) * globe.a)
            assert apart.min(axis=0).max() < 1e-4  # the seam may add others
        for instant in (int(track.times_us[0]) - 1, int(track.times_us[-1])):
            row = conn.execute(
                "SELECT conflictdb.haven_at(%s, %s, %s)",
                [scene.name, track.key, EPOCH + timedelta(microseconds=instant)],
            ).fetchone()
            assert row == (None,), "spans are half-open"


@cases
def test_regions_hold_the_places_of_contact(
    conn: psycopg.Connection[Any], workload: Workload, seed: int, earth: EarthModel
) -> None:
    """The region of a pair contains its first contact, and lies in the area if the pair has one."""
    scene, areas, tracks = plain_scene(workload, seed, 8, 8, earth)
    store.replace_scene(conn, scene, areas, tracks, merge=False)
    detect(conn, scene.name, jobs=1)
    objects = {thing.key: thing for thing in (*areas, *tracks)}
    rows = store.conflicts(conn, scene.name, with_region=True)
    assert rows
    for row in rows:
        assert row.region is not None
        region = shapely.from_geojson(row.region)
        assert not region.is_empty
        west, south, east, north = region.bounds
        assert west >= -180.0 - 1e-9
        assert east <= 180.0 + 1e-9
        assert row.first_contact_deg is not None
        point = shapely.Point(row.first_contact_deg)
        turns = [shapely.transform(point, lambda xy, t=t: xy + np.array([t, 0.0])) for t in (-360.0, 0.0, 360.0)]
        # Straight lines between the corners are rhumb lines in the plane, and chords here: a thousandth of a degree.
        assert min(region.distance(p) for p in turns) < 2e-3, row
        area = objects[row.a_key]
        if isinstance(area, Area):
            _, low, _, high = area.footprint.bounds
            assert low - 1e-3 <= south
            assert north <= high + 1e-3
