"""Scenes with the setting `regions` off: what reads regions copes with their absence and says so."""

from dataclasses import replace
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from piecework import load
from scenes import box, sail
from tiles import decode

from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Scene, Track

Conn = psycopg.Connection[Any]
HOUR_US = 3_600_000_000
# In the order of the view, all but region and what belongs to a run.
KEPT = (
    """a_key, b_key, periods, verdict, ST_AsText(first_contact_point), time_error_s, closest_m, certainty, lacking_s"""
)
OFF = Scene("s", regions="off")  # type: ignore[arg-type]


def objects() -> tuple[list[Area], list[Track]]:
    """Return areas that overlap, tracks that cross them, and areas at the antimeridian."""
    areas = [
        box("WEST", 0.0, 50.0, 1.0, 51.0),
        box("EAST", 0.8, 50.0, 2.0, 51.0),
        box("FAR", 5.0, 50.0, 6.0, 51.0),
        box("SEAM-1", 179.5, -10.0, 181.0, -9.0),
        box("SEAM-2", -180.5, -9.5, -179.0, -8.5),
    ]
    tracks = [sail("FERRY", (-1.0, 50.5), (3.0, 50.5)), sail("TOW", (1.5, 49.0), (1.5, 52.0))]
    return areas, tracks


def rows(conn: Conn, query: str, *given: object) -> list[tuple[Any, ...]]:
    with conn.transaction():
        return conn.execute(query.encode(), given).fetchall()


def within(conn: Conn, scene: str, *corners: float, span: str = "(,)") -> set[tuple[str, str]]:
    place = "ST_SetSRID(ST_MakeEnvelope(%s, %s, %s, %s), 4326)"
    asked = f"SELECT a_key, b_key FROM conflictdb.conflicts_within(%s, {place}, %s)"
    return {(a, b) for a, b in rows(conn, asked, scene, *corners, span)}


def detected(conn: Conn, scene: Scene, *plans: list[Any]) -> None:
    load(conn, scene, *(plans or objects()))
    detect(conn, scene.name, jobs=1)


@pytest.fixture
def both(conn: Conn) -> Conn:
    """The same objects with regions in scene "on", and without in scene "s"."""
    detected(conn, OFF)
    detected(conn, Scene("on"))
    return conn


def test_a_detection_stores_all_but_the_region(both: Conn) -> None:
    asked = f"SELECT {KEPT} FROM conflictdb.conflicts WHERE scene = %s ORDER BY a_key, b_key"
    assert rows(both, asked, "s") == rows(both, asked, "on") != []
    asked = "SELECT count(*), count(region) FROM conflictdb.conflicts WHERE scene = %s"
    ((count, with_region),) = rows(both, asked, "s")
    assert (count, with_region) == (5, 0)
    assert rows(both, asked, "on") == [(5, 5)]
    assert rows(both, "SELECT scene, regions FROM conflictdb.scenes ORDER BY 1") == [("on", "on"), ("s", "off")]


@pytest.mark.parametrize(("method", "regions"), [("screen", "on"), ("screen", "off"), ("nlp", "off")])
def test_other_methods_store_no_region_either(conn: Conn, method: str, regions: str) -> None:
    """`screen` finds no places, whatever the setting."""
    detected(conn, replace(OFF, method=method, regions=regions))  # type: ignore[arg-type]
    ((count, with_region),) = rows(conn, "SELECT count(*), count(region) FROM conflictdb.conflicts")
    assert count >= 5
    assert with_region == 0


def test_many_new_rows_have_no_region(conn: Conn) -> None:
    """They take another way into the table than few."""
    areas = [box(f"A{k}", 0.001 * k, 50.0, 0.001 * k + 1.0, 51.0) for k in range(30)]
    detected(conn, OFF, areas, [])
    assert rows(conn, "SELECT count(*), count(region) FROM conflictdb.conflicts") == [(435, 0)]


def test_a_query_by_place_compares_swept_hulls_and_says_so(both: Conn) -> None:
    """All that are there by their regions, and none far from both objects."""
    notices: list[str] = []
    both.add_notice_handler(lambda notice: notices.append(str(notice.message_primary)))
    rng = np.random.default_rng(5)
    for _ in range(60):
        west, south = rng.uniform(-1.5, 2.5), rng.uniform(49.0, 51.5)
        corners = west, south, west + rng.uniform(0.001, 0.4), south + rng.uniform(0.001, 0.4)
        assert within(both, "s", *corners) >= within(both, "on", *corners)
    assert set(notices) == {
        "scene 's': has conflicts without regions: those whose swept hulls meet the place are in the answer"
    }
    assert within(both, "s", 0.85, 50.7, 0.95, 50.8) == {("EAST", "WEST")}
    assert within(both, "s", 1.45, 50.45, 1.55, 50.55) == {("EAST", "FERRY"), ("EAST", "TOW")}
    assert within(both, "s", 5.2, 50.2, 5.8, 50.8) == set()
    assert within(both, "s", 179.9, -9.4, 180.1, -9.3) == within(both, "s", -180.1, -9.4, -179.9, -9.3)
    assert within(both, "s", 179.9, -9.4, 180.1, -9.3) == {("SEAM-1", "SEAM-2")}
    assert within(both, "s", 0.85, 50.4, 0.95, 50.6, span="[1999-01-01,1999-01-02)") == {("EAST", "WEST")}


def test_a_query_at_a_first_contact_or_an_edge_of_a_region_finds_the_conflict(conn: Conn) -> None:
    """Regions reach beyond swept hulls by up to a metre, and first contacts are rounded."""
    for name, regions in (("on", "on"), ("s", "off")):
        detected(conn, Scene(name, tolerance_m=0.0, regions=regions))  # type: ignore[arg-type]
    asked = """SELECT ST_X(d.geom), ST_Y(d.geom) FROM conflictdb.conflicts c
               CROSS JOIN ST_DumpPoints(ST_Collect(c.region, c.first_contact_point)) d WHERE c.scene = 'on'"""
    places = rows(conn, asked)
    assert len(places) > 20
    for lon, lat in places:
        corners = lon, lat, lon + 1e-10, lat + 1e-10
        assert within(conn, "s", *corners) >= within(conn, "on", *corners), corners


def test_a_query_by_place_finds_what_screen_finds(both: Conn) -> None:
    rows(both, "SELECT conflictdb.create_scene('s', p_method => 'screen', p_regions => 'on')")
    detect(both, "s", jobs=1)
    assert within(both, "s", 0.85, 50.4, 0.95, 50.6) >= {("EAST", "WEST"), ("EAST", "FERRY"), ("WEST", "FERRY")}
    assert within(both, "s", 5.2, 50.2, 5.8, 50.8) == set()
    rows(both, "SELECT conflictdb.create_scene('s', p_method => 'exact')")
    detect(both, "s", jobs=1)
    assert rows(both, "SELECT count(*), count(region) FROM conflictdb.conflicts WHERE scene = 's'") == [(5, 5)]


def test_a_query_by_place_finds_conflicts_of_changed_objects(both: Conn) -> None:
    """The conflict is that of the object as it was, which has no pieces any more."""
    rows(both, "SELECT conflictdb.put_area('s', 'WEST', ST_SetSRID(ST_MakeEnvelope(40, 50, 41, 51), 4326))")
    assert ("EAST", "WEST") in within(both, "s", 0.85, 50.7, 0.95, 50.8)


def test_a_query_by_place_knows_separation_in_time(conn: Conn) -> None:
    """Two tracks use one place an hour apart."""
    tracks = [sail("A", (0.0, 0.0), (1.0, 0.0)), sail("B", (0.5, -0.5), (0.5, 0.5), start_us=1_772_323_200_000_000)]
    later = replace(tracks[1], times_us=tracks[1].times_us + HOUR_US)
    for name, regions in (("s", "off"), ("on", "on")):
        scene = Scene(name, time_separation_s=7200.0, separation_m=500.0, regions=regions)  # type: ignore[arg-type]
        detected(conn, scene, [], [tracks[0], later])
        assert within(conn, name, 0.45, -0.05, 0.55, 0.05) == {("A", "B")}
        assert within(conn, name, 0.1, -0.05, 0.2, 0.05) == set()


def test_tiles_and_layers_show_first_contacts(both: Conn) -> None:
    def tile(scene: str, z: int, x: int, y: int) -> dict[str, list[Any]]:
        asked = "SELECT conflictdb.tile_conflicts(%s, %s, %s, json_build_object('scene', %s::text))"
        ((made,),) = rows(both, asked, z, x, y, scene)
        return decode(made)

    def pairs(scene: str, layer: str, *place: int) -> list[tuple[str, str]]:
        return sorted((one["a_key"], one["b_key"]) for one, _ in tile(scene, *place).get(layer, []))

    for place in ((0, 0, 0), (5, 16, 10), (9, 257, 173)):
        assert "conflicts" not in tile("s", *place)
        assert pairs("s", "first_contacts", *place) == pairs("on", "first_contacts", *place)
    assert len(pairs("s", "first_contacts", 0, 0, 0)) == 5
    asked = "SELECT count(region), count(first_contact_point) FROM conflictdb.map_conflicts WHERE scene = %s"
    assert rows(both, asked, "s") == [(0, 5)]


def test_a_changed_setting_holds_from_the_next_detection_on(conn: Conn) -> None:
    """No conflict opens, changes or closes by it; ids stay."""
    detected(conn, Scene("s"))
    state = "SELECT conflict_id, a_key, b_key, found_at FROM conflictdb.conflicts ORDER BY 1"
    first, regions = rows(conn, state), rows(conn, "SELECT conflict_id, region FROM conflictdb.conflicts ORDER BY 1")
    rows(conn, "SELECT conflictdb.create_scene('s', p_regions => 'off')")
    assert rows(conn, "SELECT is_current FROM conflictdb.scenes") == [(False,)]
    run = detect(conn, "s", jobs=1)
    assert (run.opened, run.changed, run.closed) == (0, 0, 0)
    assert rows(conn, state) == first
    assert rows(conn, "SELECT count(region) FROM conflictdb.conflicts") == [(0,)]
    rows(conn, "SELECT conflictdb.put_area('s', 'FAR', ST_SetSRID(ST_MakeEnvelope(0.9, 50, 1.1, 51), 4326))")
    assert detect(conn, "s", jobs=1).opened == 3
    assert rows(conn, "SELECT count(*), count(region) FROM conflictdb.conflicts") == [(8, 0)]
    rows(conn, "SELECT conflictdb.create_scene('s', p_regions => 'on')")
    assert detect(conn, "s", jobs=1).changed == 0
    known = dict(rows(conn, "SELECT conflict_id, region FROM conflictdb.conflicts"))
    assert {number: known[number] for number, _ in regions} == dict(regions)
    assert None not in known.values()


@pytest.mark.parametrize("wrong", ["", "yes", "ON", "none"])
def test_another_value_is_refused(conn: Conn, wrong: str) -> None:
    with pytest.raises(psycopg.Error) as refused, conn.transaction():
        conn.execute("SELECT conflictdb.create_scene('s', p_regions => %s)", [wrong])
    assert refused.value.sqlstate == "ZC009"
    assert "regions: must be one of on, off" in str(refused.value)


def test_a_branch_follows_its_parent(both: Conn) -> None:
    rows(both, "SELECT conflictdb.create_branch('s', 'b')")
    rows(both, "SELECT conflictdb.put_area('b', 'FAR', ST_SetSRID(ST_MakeEnvelope(0.9, 50, 1.1, 51), 4326))")
    detect(both, "b", jobs=1)
    assert rows(both, "SELECT count(*), count(region) FROM conflictdb.conflicts WHERE scene = 'b'") == [(8, 0)]


def test_regions_of_hulls_are_not_computed_either(conn: Conn) -> None:
    """Next to a pole on great circles the database computes the regions."""
    scene = Scene("s", motion="great_circle", centre=(0.0, 90.0), regions="off")  # type: ignore[arg-type]
    ring = [(-180, 89.5), (-90, 89.5), (0, 89.5), (90, 89.5), (180, 89.5), (180, 90), (-180, 90), (-180, 89.5)]
    areas = [Area("CAP", shapely.MultiPolygon([shapely.Polygon(ring)])), box("OTHER", 0.0, 89.0, 40.0, 89.9)]
    detected(conn, replace(scene, name="on", regions="on"), areas, [])  # type: ignore[arg-type]
    assert rows(conn, "SELECT count(region) FROM conflictdb.conflicts") == [(1,)]
    rows(conn, "SELECT conflictdb.remove_scene('on')")
    detected(conn, scene, areas, [])
    assert rows(conn, "SELECT count(*), count(region) FROM conflictdb.conflicts") == [(1, 0)]
