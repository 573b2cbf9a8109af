"""Scenes of great circles for SQL users: settings, limits, where havens and conflicts are, also around a pole."""

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import oracle_circle
import psycopg
import pytest
import shapely
from layouts import ARCTIC, GROWING_CIRCLES, OCEAN
from mixed_scenes import plain_scene
from piecework import load
from scenes import T0_US, box

from conflictdb import store
from conflictdb.core.pieces.cutting import check_plane
from conflictdb.earth.gnomonic import Gnomonic
from conflictdb.earth.registry import Setup
from conflictdb.errors import InvalidInput
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Motion, Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
HOUR_US = 3_600_000_000
CIRCLES = Scene("s", Motion.GREAT_CIRCLE)


def sail(key: str, *positions: tuple[float, float], size_m: float = 5e3, hours: float = 1.0) -> Track:
    times = T0_US + np.rint(hours * HOUR_US * np.arange(len(positions))).astype(np.int64)
    return Track(key, np.array(positions, dtype=float), times, rectangle_outline_m(size_m, size_m, size_m, size_m))


def around_pole(key: str, corners: list[tuple[float, float]], sign: int = 1) -> Area:
    """An area with a pole inside, its ring closed along latitude 90 as maps do it."""
    lons = [-180.0, *(lon for lon, _ in corners), 180.0]
    (_, first), (_, last) = corners[0], corners[-1]
    seam = (first + last) / 2
    ring = [(lons[0], sign * seam), *((lon, sign * lat) for lon, lat in corners), (180.0, sign * seam)]
    return Area(key, shapely.MultiPolygon([shapely.Polygon([*ring, (180.0, sign * 90.0), (-180.0, sign * 90.0)])]))


def centre(conn: Conn) -> tuple[float | None, float | None]:
    row = conn.execute("SELECT centre_lon, centre_lat FROM conflictdb.scene WHERE name = 's'").fetchone()
    assert row is not None
    return row


def pending(conn: Conn) -> int:
    row = conn.execute("SELECT pending FROM conflictdb_internal._scenes() WHERE settings ->> 'name' = 's'").fetchone()
    assert row is not None
    return row[0]


def refused(conn: Conn, query: str, values: list[Any] | None = None) -> tuple[str, str]:
    """SQLSTATE and rule with which a statement is refused; earlier changes stay."""
    with pytest.raises(psycopg.Error) as raised, conn.transaction():
        conn.execute(query.encode(), values)
    return str(raised.value.sqlstate), str(raised.value.diag.constraint_name)


def test_earth_is_the_sphere(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s', 'great_circle')")
    assert conn.execute("SELECT motion, earth, centre_lon FROM conflictdb.scene").fetchone() == (
        "great_circle",
        "sphere",
        None,
    )
    for query in (
        "SELECT conflictdb.create_scene('t', 'great_circle', 'wgs84')",
        "SELECT conflictdb.create_scene('s', p_earth => 'wgs84')",
        "INSERT INTO conflictdb.scene (name, motion) VALUES ('t', 'great_circle')",
    ):
        assert refused(conn, query) == ("ZC009", "scene_circles_on_sphere")


def test_centre_is_given_with_the_scene_or_by_the_first_object_and_kept(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s', 'great_circle')")
    conn.execute("SELECT conflictdb.put_area('s', 'A', ST_MakeEnvelope(10, -1, 12, 1, 4326))")
    first = centre(conn)
    assert first == pytest.approx((11.0, 0.0), abs=0.3)
    conn.execute("SELECT conflictdb.put_area('s', 'B', ST_MakeEnvelope(30, 40, 32, 41, 4326))")
    assert centre(conn) == first
    conn.execute("SELECT conflictdb.create_scene('s', p_centre_lon => 20, p_centre_lat => 20)")
    assert centre(conn) == (20.0, 20.0)
    conn.execute("SELECT conflictdb.create_scene('t', 'great_circle', p_centre_lon => -20, p_centre_lat => 5.5)")
    assert store.scene_settings(conn, "t") == Scene("t", Motion.GREAT_CIRCLE, centre=(-20.0, 5.5))


@pytest.mark.parametrize(("lon", "lat"), [(181, 0), (0, 91), (0, None), (None, 3), ("NaN", 0)])
def test_centre_is_a_place(conn: Conn, lon: Any, lat: Any) -> None:
    query = "SELECT conflictdb.create_scene('s', 'great_circle', p_centre_lon => %s, p_centre_lat => %s)"
    assert refused(conn, query, [lon, lat]) == ("ZC009", "scene_centre_on_earth")


def test_rhumb_lines_have_no_centre(conn: Conn) -> None:
    query = "SELECT conflictdb.create_scene('s', 'rhumb', p_centre_lon => 1, p_centre_lat => 1)"
    assert refused(conn, query) == ("ZC009", "scene_centre_of_circles")


def test_another_centre_marks_everything(conn: Conn) -> None:
    load(conn, CIRCLES, [box("A", 0, 50, 2, 51)], [sail("T", (0, 50), (3, 51))])
    detect(conn, "s", jobs=1)
    assert pending(conn) == 0
    conn.execute("SELECT conflictdb.create_scene('s', p_centre_lon => 1, p_centre_lat => 50)")
    assert pending(conn) == 2


def test_motion_may_change_and_takes_the_centre_along(conn: Conn) -> None:
    load(conn, Scene("s"), [box("A", 0, 50, 2, 52)], [sail("T", (1, 51), (1, 51.5))])
    conn.execute("SELECT conflictdb.create_scene('s', 'great_circle')")
    assert centre(conn) == pytest.approx((1.0, 51.0), abs=0.3)
    assert pending(conn) == 2
    conn.execute("SELECT conflictdb.create_scene('s', 'rhumb')")
    assert centre(conn) == (None, None)


FAR = "SELECT conflictdb.put_area('s', 'FAR', ST_MakeEnvelope(60, 30, 61, 31, 4326))"
FAR_TRACK = """SELECT conflictdb.put_track('s', 'FAR', 'SRID=4326;LINESTRING M (0 0 0, 61 0 100000)',
                                           conflictdb.rectangle_outline(1, 1, 1, 1))"""
FAR_GROWING = """SELECT conflictdb.put_track('s', 'FAR', 'SRID=4326;LINESTRING M (0 0 0, 59 0 100000)',
                                             conflictdb.rectangle_outline(1, 1, 1, 1), p_grow_mps => %s)"""
FAR_OUTLINES = """SELECT conflictdb.put_track(
    's', 'FAR', 'SRID=4326;LINESTRING M (0 0 0, 59 0 100000)', NULL,
    p_outlines => ST_Collect(conflictdb.rectangle_outline(1, 1, 1, 1),
                             conflictdb.rectangle_outline(150000, 1, 1, 1)))"""
FAR_HAVEN = """SELECT conflictdb.put_track('s', 'FAR', 'SRID=4326;LINESTRING M (0 0 0, 59.99 0 100000)',
                                           conflictdb.rectangle_outline(5000, 1, 1, 1))"""


def test_what_is_far_from_the_centre_is_refused(conn: Conn) -> None:
    conn.execute("SELECT conflictdb.create_scene('s', 'great_circle', p_centre_lon => 0, p_centre_lat => 0)")
    assert refused(conn, FAR) == ("ZC005", "object_near_centre")
    assert refused(conn, FAR_TRACK) == ("ZC005", "object_near_centre")
    assert refused(conn, FAR_HAVEN) == ("ZC005", "haven_near_centre")
    assert refused(conn, FAR_GROWING.replace("%s", "2")) == ("ZC005", "haven_near_centre")
    assert refused(conn, FAR_OUTLINES) == ("ZC005", "haven_near_centre")
    conn.execute(FAR_GROWING.replace("%s", "1").encode())
    conn.execute(FAR_OUTLINES.replace("150000", "100000").encode())
    conn.execute(FAR_HAVEN.replace("5000", "1000").encode())
    conn.commit()
    detect(conn, "s", jobs=1)
    probe = "SELECT * FROM conflictdb.probe('s', ST_MakeEnvelope(80, 0, 81, 1, 4326))"
    assert refused(conn, probe) == ("ZC005", "object_near_centre")


def test_growing_havens_are_refused_where_python_refuses_them(conn: Conn) -> None:
    """Both by the same bound, at 59.9 to 60.1 degrees and along any leg."""
    scene = Scene("s", Motion.GREAT_CIRCLE, centre=(0.0, 0.0))
    conn.execute("SELECT conflictdb.create_scene('s', 'great_circle', p_centre_lon => 0, p_centre_lat => 0)")
    conn.commit()
    rng = np.random.default_rng(5)
    times = T0_US + HOUR_US * np.array([0, 20])
    held = []
    for k in range(60):
        east, north = rng.uniform(50.0, 59.9), rng.uniform(-30.0, 30.0) * (k % 2)
        places = np.array([[east, 0.0], [np.degrees(np.arccos(0.5 / np.cos(np.radians(north)))) - 0.3, north]])
        size = rng.uniform(1.0, 20000.0, 4)
        ring = np.array([(-size[0], -size[1]), (size[2], -size[1]), (size[2], size[3]), (-size[0], size[3])])
        grown = ring * rng.uniform(0.5, 4.0)
        track = Track(f"T{k}", places, times, ring, outlines_m=np.array([ring, grown]))
        try:
            check_plane(Setup.of(scene).plane, [], [track])
        except InvalidInput:
            held.append(False)
        else:
            held.append(True)
        path = "SRID=4326;LINESTRING M ({} {} 0, {} {} 72000)".format(*places.ravel().tolist())
        rings = [shapely.Polygon(outline).wkt for outline in (ring, grown)]
        put = (
            f"SELECT conflictdb.put_track('s', 'T{k}', '{path}', NULL, p_outlines => "
            f"ST_Collect('{rings[0]}'::geometry, '{rings[1]}'::geometry))"
        )
        if held[-1]:
            conn.execute(put.encode())
            conn.commit()
        else:
            assert refused(conn, put) == ("ZC005", "haven_near_centre")
    assert 10 < sum(held) < 50


def test_a_scene_cannot_turn_away_from_its_objects(conn: Conn) -> None:
    load(conn, CIRCLES, [around_pole("A", [(-90, 80), (0, 80), (90, 80)])], [])
    assert refused(conn, "SELECT conflictdb.create_scene('s', p_centre_lon => 0, p_centre_lat => 10)") == (
        "ZC005",
        "object_near_centre",
    )
    assert refused(conn, "SELECT conflictdb.create_scene('s', 'rhumb')") == ("ZC005", "latitude_in_plane")
    conn.commit()
    conn.execute("UPDATE conflictdb.scene SET centre_lon = 0, centre_lat = 10")
    with pytest.raises(psycopg.Error, match="60"):
        conn.commit()


def test_a_load_may_change_motion_and_objects_together(conn: Conn) -> None:
    load(conn, CIRCLES, [around_pole("A", [(-90, 80), (0, 80), (90, 80)])], [])
    load(conn, Scene("s"), [box("A", 0, 0, 1, 1)], [])
    assert centre(conn) == (None, None)
    with pytest.raises(InvalidInput, match="60"):
        store.replace_scene(conn, Scene("s", Motion.GREAT_CIRCLE, centre=(0.0, 80.0)), [], [], merge=True)
    assert store.scene_settings(conn, "s") == Scene("s")


@pytest.mark.parametrize("workload", [OCEAN, ARCTIC, GROWING_CIRCLES], ids=lambda w: w.name)
def test_haven_at_is_where_brute_force_says(conn: Conn, workload: Any) -> None:
    scene, _, tracks = plain_scene(workload, 21, 0, 12)
    load(conn, scene, [], tracks)
    for track in tracks:
        for leg in range(len(track.times_us) - 1):
            for share in (0.0, 0.3, 0.9):
                us = int(track.times_us[leg] + share * (track.times_us[leg + 1] - track.times_us[leg]))
                at = EPOCH + timedelta(microseconds=us)
                row = conn.execute(
                    "SELECT conflictdb.haven_at(%s, %s, %s)::text",
                    [scene.name, track.key, at],
                ).fetchone()
                assert row is not None
                found = shapely.from_wkb(row[0])
                assert found.is_valid
                expected = oracle_circle.haven_at(track, us, leg).astype(float)
                corners = oracle_circle.space(shapely.get_coordinates(found)).astype(float)
                apart = np.linalg.norm(expected[:, None] - corners[None], axis=-1).min(axis=1) * 6371008.771415
                assert apart.max() < 1e-6


def test_loiter_keeps_the_heading_at_the_end_of_the_leg(conn: Conn) -> None:
    """Eastward from 0 to 90 degrees along the great circle that has its vertex half way: the heading turns."""
    outline = np.array([[0.0, 0.0], [0.0, 1000.0]])
    times = T0_US + HOUR_US * np.arange(3)
    tracks = [
        Track("came", np.array([[0.0, 60.0], [50.0, 60.0], [50.0, 60.0]]), times, outline),
        Track("leaves", np.array([[0.0, 60.0], [0.0, 60.0], [50.0, 60.0]]), times, outline),
        Track("stays", np.array([[5.0, 60.0]] * 3), times, outline),
        Track("pole", np.array([[20.0, 90.0], [110.0, 90.0], [110.0, 80.0]]), times, outline),
    ]
    load(conn, CIRCLES, [], tracks)
    for track, leg in zip(tracks, (1, 0, 0, 0), strict=True):
        us = int(times[leg]) + HOUR_US // 2
        row = conn.execute(
            "SELECT conflictdb.haven_at('s', %s, %s)::text", [track.key, EPOCH + timedelta(microseconds=us)]
        ).fetchone()
        assert row is not None
        line = oracle_circle.space(shapely.get_coordinates(shapely.from_wkb(row[0])))
        found = line[:2]
        expected = oracle_circle.haven_at(track, us, leg)
        assert np.abs(found - expected).max() * 6.4e6 < 1e-6


def inside(region: shapely.Geometry, places: np.ndarray) -> np.ndarray:
    return shapely.intersects_xy(region, places[:, 0], places[:, 1])


REGIONS = {
    "across the seam": ([box("A", 170, 10, 190, 20), box("B", -185, 12, -170, 25)], (180.0, 15.0)),
    "north pole": (
        [
            around_pole("A", [(-120, 75), (-30, 70), (60, 72), (150, 74)]),
            around_pole("B", [(-90, 80), (0, 65), (90, 80)]),
        ],
        (0.0, 90.0),
    ),
    "south pole": (
        [
            around_pole("A", [(-120, 75), (-30, 70), (60, 72), (150, 74)], -1),
            around_pole("B", [(-90, 80), (0, 65), (90, 80)], -1),
        ],
        (0.0, -90.0),
    ),
    "a corner at the pole": (
        [around_pole("A", [(-120, 75), (-30, 70), (60, 72), (150, 74)]), box("B", 20, 60, 100, 90)],
        (60.0, 80.0),
    ),
    "far from the centre": ([box("A", 50, -5, 58, 5), box("B", 52, -6, 59, 2), box("C", -59, -1, -58, 1)], (0.0, 0.0)),
}


def thrown(areas: list[Area], middle: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return places (n, 2) all around where the first two areas overlap, and whether they do there."""
    plane = Gnomonic(*middle)
    flat = []
    for area in areas[:2]:
        parts = [
            shapely.Polygon(np.stack(plane.to_plane(*np.array(p.exterior.coords).T), axis=1))
            for p in area.footprint.geoms
        ]
        flat.append(
            shapely.union_all([shapely.make_valid(part, method="structure", keep_collapsed=False) for part in parts])
        )
    common = shapely.intersection(*flat)
    rng = np.random.default_rng(1)
    box_of = np.array(common.bounds)
    xy = rng.uniform(box_of[:2] - 1e5, box_of[2:] + 1e5, (4000, 2))
    xy = xy[shapely.distance(shapely.points(xy), common.boundary) > 500.0]
    lon, lat = plane.from_plane(*xy.T)
    expected = shapely.intersects_xy(common, *xy.T)
    assert 0 < expected.sum() < len(expected)
    return np.stack([(lon + 180.0) % 360.0 - 180.0, lat], axis=1), expected


def one_region(conn: Conn, query: str) -> shapely.Geometry:
    """Return the only region of a query, which must be valid and within +-180 and +-90 degrees."""
    ((text,),) = conn.execute(query.encode()).fetchall()
    region = shapely.from_wkb(text)
    assert region.is_valid
    west, south, east, north = region.bounds
    assert -180.0 <= west < east <= 180.0
    assert -90.0 <= south < north <= 90.0
    return region


@pytest.mark.parametrize("name", REGIONS)
def test_region_is_where_areas_overlap(conn: Conn, name: str) -> None:
    """The region of the conflict, of the candidates and of a probe with an area: right at random places all over it."""
    areas, middle = REGIONS[name]
    middle = (middle[0] - 360.0 if middle[0] > 180.0 else middle[0], middle[1])
    load(conn, Scene("s", Motion.GREAT_CIRCLE, centre=middle), areas, [])
    detect(conn, "s", jobs=1)
    places, expected = thrown(areas, middle)
    probe = """SELECT p.region::text FROM conflictdb.area a, conflictdb.probe('s', a.footprint) p
               WHERE a.key = 'B' AND p.key = 'A'"""
    for query in (
        "SELECT region::text FROM conflictdb.conflicts",
        "SELECT region::text FROM conflictdb.candidates('s')",
        probe,
    ):
        assert np.array_equal(inside(one_region(conn, query), places), expected), query


def test_conflicts_within_counts_edges_as_great_circles(conn: Conn) -> None:
    """The northern edge of the requested place, from 40 W to 40 E along 62 N, runs over 67 N half way."""
    load(conn, CIRCLES, [box("A", -1, 64.5, 1, 65.5), box("B", -1, 65, 1, 66), box("C", -1, 68, 1, 69)], [])
    detect(conn, "s", jobs=1)
    asked = "SELECT a_key, b_key FROM conflictdb.conflicts_within('s', ST_MakeEnvelope(-40, %s, 40, %s, 4326), '(,)')"
    assert conn.execute(asked, [50, 62]).fetchall() == [("A", "B")]
    assert conn.execute(asked, [63.5, 70]).fetchall() == []


def test_conflicts_within_counts_edges_as_rhumb_lines(conn: Conn) -> None:
    """A rhumb line from 0 N 0 E to 80 N 60 E passes 40 N at 18.8 E; a straight line on a map of degrees at 30 E."""
    load(conn, Scene("s"), [box("A", 24, 38, 26, 40), box("B", 24, 39, 26, 41)], [])
    detect(conn, "s", jobs=1)
    asked = "SELECT a_key, b_key FROM conflictdb.conflicts_within('s', ST_GeomFromText(%s, 4326), '(,)')"
    assert conn.execute(asked, ["POLYGON((0 0, 60 0, 60 80, 0 0))"]).fetchall() == [("A", "B")]
    assert conn.execute(asked, ["POLYGON((0 0, 60 80, 0 80, 0 0))"]).fetchall() == []


def test_questions_about_places(conn: Conn) -> None:
    """Regions of moving pairs, conflicts within, probes and candidates, over the pole and across the seam."""
    tracks = [
        sail("OVER", (20.0, 85.0), (-160.0, 85.0), size_m=2e4, hours=10.0),
        sail("ALONG", (110.0, 85.0), (-70.0, 85.0), size_m=2e4, hours=10.0),
    ]
    load(conn, CIRCLES, [box("SEAM", 178, 83, 183, 84)], tracks)
    detect(conn, "s", jobs=1)
    (row,) = store.conflicts(conn, "s", with_region=True)
    assert (row.a_key, row.b_key) == ("ALONG", "OVER")
    assert row.first_contact_deg is not None
    region = shapely.from_geojson(str(row.region))
    assert region.is_valid
    assert region.bounds[2] - region.bounds[0] == pytest.approx(360.0)
    assert region.bounds[3] == 90.0
    assert region.bounds[1] > 89.0
    asked = "SELECT a_key FROM conflictdb.conflicts_within('s', ST_MakeEnvelope(%s, %s, %s, %s, 4326), '[,]')"
    assert conn.execute(asked, [-30, 89, 30, 90]).fetchall() == [("ALONG",)]
    assert conn.execute(asked, [-30, 80, 30, 85]).fetchall() == []
    found = conn.execute(
        "SELECT key, kind, ST_IsValid(region) FROM conflictdb.probe('s', ST_MakeEnvelope(-181, 83, -155, 89, 4326))"
        " ORDER BY key"
    ).fetchall()
    assert found == [("OVER", "track", True), ("SEAM", "area", True)]
    pairs = conn.execute("SELECT a_key, b_key FROM conflictdb.candidates('s')").fetchall()
    assert [set(pair) for pair in pairs] == [{"ALONG", "OVER"}]
    conn.commit()
    again = detect(conn, "s", full=True, jobs=1)
    assert (again.opened, again.changed, again.closed) == (0, 0, 0)


def test_footprints_that_are_not_projected_are_valid_on_great_circles(conn: Conn) -> None:
    rng, accepted, invalid = np.random.default_rng(8), 0, 0
    for _ in range(400):
        lon, lat = rng.uniform(-20, 20), rng.uniform(-80, 80)
        wide, high = 10 ** rng.uniform(-3, 0.9, 2)
        # Notches of any depth: the tip may cross the long side, which bulges.
        depth = high * (1 - 10 ** rng.uniform(-5, 0))
        ring = [(0, 0), (wide, 0), (wide, high), (0.5 * wide, high - depth), (0, high), (0, 0)]
        side = rng.choice([-1, 1])
        wkt = ", ".join(f"{lon + x} {lat + side * y}" for x, y in ring)
        row = conn.execute(
            "SELECT conflictdb_internal._stays_simple(f), ST_IsValid(conflictdb_internal._to_plane(f, "
            "conflictdb_internal._plane('great_circle', 'sphere', 0, %s))) "
            "FROM (SELECT ST_GeomFromText(%s, 4326) AS f) g",
            (float(np.clip(lat, -40, 40)), f"POLYGON(({wkt}))"),
        ).fetchone()
        assert row is not None
        assert row[1] or not row[0], wkt
        accepted += row[0]
        invalid += not row[1]
    assert accepted > 50
    assert invalid > 5


@pytest.mark.parametrize("member", ["owner", "class"])
@pytest.mark.parametrize("word", ["", "x" * 201])
@pytest.mark.parametrize(("motion", "earth"), [("rhumb", "wgs84"), ("great_circle", "sphere")])
def test_words_of_plain_areas_are_checked(conn: Conn, motion: str, earth: str, word: str, member: str) -> None:
    conn.execute("INSERT INTO conflictdb.scene (name, motion, earth) VALUES ('w', %s, %s)", (motion, earth))
    plan = f"SELECT conflictdb.put_area('w', 'A', 'SRID=4326;POLYGON((8 47,8.1 47,8.1 47.1,8 47))', p_{member} => %s)"
    conn.execute(plan, ("x" * 200,))
    with pytest.raises(psycopg.errors.DatabaseError, match=f"{member}: must be a text of 1 to 200 bytes"):
        conn.execute(plan, (word,))
