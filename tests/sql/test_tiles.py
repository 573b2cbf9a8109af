"""Vector tiles contain the objects there and then; map views are layers with a key, a type and times."""

import json
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from piecework import load
from tiles import Feature, decode

from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Motion, Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]
T0_US = 1_772_323_200_000_000  # 2026-03-01 00:00 UTC
HOUR_US = 3_600_000_000
NOON = "2026-03-01T12:00:00Z"
OUTLINE = rectangle_outline_m(3000, 3000, 3000, 3000)
LAYERS = ["areas", "tracks", "havens", "conflicts"]


def box(key: str, *corners: float, **more: Any) -> Area:
    return Area(key, shapely.MultiPolygon([shapely.box(*corners)]), **more)


def track(key: str, *points: tuple[float, float], **more: Any) -> Track:
    """Return a track that goes from midnight to midnight."""
    times = T0_US + np.linspace(0, 24 * HOUR_US, len(points)).astype(np.int64)
    return Track(key, np.array(points, dtype=float), times, OUTLINE, **more)


def tile(conn: Conn, kind: str, z: int, x: int, y: int, **params: Any) -> dict[str, list[Feature]]:
    query = f"SELECT conflictdb.tile_{kind}(%s, %s, %s, %s)"
    row = conn.execute(query.encode(), [z, x, y, json.dumps({"scene": "s", **params})]).fetchone()
    assert row is not None
    return decode(row[0])


def keys(found: dict[str, list[Feature]], layer: str) -> list[str]:
    return sorted(str(fields.get("key", fields.get("a_key"))) for fields, _ in found.get(layer, []))


@pytest.fixture
def crossing(conn: Conn) -> Conn:
    """A track along the equator through one of two areas; the other is active on another day, and high up."""
    areas = [
        box("NOW", 9.0, -1.0, 11.0, 1.0, start_us=T0_US, end_us=T0_US + 24 * HOUR_US, floor_m=0.0, ceiling_m=100.0),
        box("LATER", 9.5, -0.5, 10.5, 0.5, start_us=T0_US + 48 * HOUR_US, floor_m=5000.0),
    ]
    load(conn, Scene("s"), areas, [track("T", (0.0, 0.0), (20.0, 0.0), floor_m=50.0)])
    detect(conn, "s", jobs=1)
    return conn


def test_tile_shows_what_is_in_it_and_no_more(crossing: Conn) -> None:
    assert keys(tile(crossing, "areas", 0, 0, 0), "areas") == ["LATER", "NOW"]
    assert keys(tile(crossing, "areas", 4, 8, 7), "areas") == ["LATER", "NOW"]
    assert tile(crossing, "areas", 4, 3, 3) == {}
    assert keys(tile(crossing, "tracks", 4, 8, 7), "tracks") == ["T"]
    assert tile(crossing, "tracks", 4, 7, 3) == {}
    ((fields, shape),) = tile(crossing, "havens", 8, 135, 127, at=NOON)["havens"]
    assert fields["key"] == "T"
    assert fields["floor_m"] == 50.0
    # 10 E is 0.11 of the tile from its left edge; 6 km are 0.038 of it.
    assert shape.bounds[2] - shape.bounds[0] == pytest.approx(4096 * 6000 / 156543.0, abs=3)
    assert shape.centroid.x == pytest.approx(4096 * (10 / 360 * 256 - 135 + 128), abs=2)
    found = tile(crossing, "conflicts", 4, 8, 7)
    assert keys(found, "conflicts") == keys(found, "first_contacts") == ["NOW"]
    ((fields, point),) = found["first_contacts"]
    assert (fields["b_key"], fields["verdict"]) == ("T", "conflict")
    assert point.x == pytest.approx(4096 * 9 / 22.5, abs=2)
    assert 0 < fields["start_s"] - T0_US / 1e6 < fields["end_s"] - T0_US / 1e6 < 86400


CHOICES: list[tuple[dict[str, Any], list[str], list[str], list[str]]] = [
    ({"at": NOON}, ["NOW"], ["T"], ["NOW"]),
    ({"at": "2026-03-01T01:00:00Z"}, ["NOW"], ["T"], []),
    ({"at": "2026-03-01 14:00:00+02"}, ["NOW"], ["T"], ["NOW"]),
    ({"from": "2026-03-02T12:00:00Z"}, ["LATER"], [], []),
    ({"from": "2026-03-01T00:00Z", "to": "2026-03-04T00:00Z"}, ["LATER", "NOW"], ["T"], ["NOW"]),
    ({"to": "2020-01-01T00:00:00.5+05:30"}, [], [], []),
    ({"verdict": "conflict,grazing"}, ["LATER", "NOW"], ["T"], ["NOW"]),
    ({"verdict": "unresolved"}, ["LATER", "NOW"], ["T"], []),
    ({"floor_m": 60, "ceiling_m": "70"}, ["NOW"], ["T"], ["NOW"]),
    ({"ceiling_m": 20}, ["NOW"], [], []),
    ({"floor_m": 1e3}, ["LATER"], ["T"], []),
]


@pytest.mark.parametrize("style", ["ISO, MDY", "German, DMY"])
def test_parameters_choose(crossing: Conn, style: str) -> None:
    crossing.execute("SELECT set_config('DateStyle', %s, false), set_config('TimeZone', 'Asia/Tokyo', false)", [style])
    for params, *expected in CHOICES:
        found = [keys(tile(crossing, kind, 4, 8, 7, **params), kind) for kind in ("areas", "tracks", "conflicts")]
        assert found == expected, params


REFUSED = [
    (None, "ZC009"),
    ("{}", "ZC009"),
    ("[1]", "ZC009"),
    ('{"scene": null}', "ZC009"),
    ('{"scene": "nobody\'s"}', "ZC010"),
    ('{"scene": {"a": 1}}', "ZC010"),
    ('{"scene": "s", "att": "2026-03-01T00:00:00Z"}', "ZC009"),
    ('{"scene": "s", "at": "now"}', "ZC003"),
    ('{"scene": "s", "at": "2026-03-01T00:00:00"}', "ZC003"),
    ('{"scene": "s", "at": "1/2/2026"}', "ZC003"),
    ('{"scene": "s", "at": "2026-13-01T00:00:00Z"}', "22008"),
    ('{"scene": "s", "at": "2026-03-01T00:00:00Z", "to": "2026-03-01T00:00:00Z"}', "ZC003"),
    ('{"scene": "s", "from": "2026-03-02T00:00:00Z", "to": "2026-03-01T00:00:00Z"}', "ZC003"),
    ('{"scene": "s", "verdict": "near"}', "ZC009"),
    ('{"scene": "s", "verdict": ""}', "ZC009"),
    ('{"scene": "s", "verdict": "conflict\'); DROP TABLE conflictdb.area --"}', "ZC009"),
    ('{"scene": "s", "floor_m": "NaN"}', "ZC004"),
    ('{"scene": "s", "floor_m": 5, "ceiling_m": 5}', "ZC004"),
    ('{"scene": "s", "ceiling_m": "1e999"}', "ZC004"),
]


def refusal(conn: Conn, query: str, values: list[Any]) -> str | None:
    with conn.transaction(force_rollback=True), pytest.raises(psycopg.Error) as refused:
        conn.execute(query.encode(), values)
    return refused.value.sqlstate


def test_bad_parameters_are_refused(crossing: Conn) -> None:
    for layer in LAYERS:
        found = [refusal(crossing, f"SELECT conflictdb.tile_{layer}(0, 0, 0, %s)", [given]) for given, _ in REFUSED]
        assert found == [state for _, state in REFUSED]


def test_tiles_that_are_not_there_are_refused(crossing: Conn) -> None:
    given = json.dumps({"scene": "s", "at": NOON})
    for layer in LAYERS:
        for z, x, y in [(-1, 0, 0), (31, 0, 0), (0, 1, 0), (3, 8, 0), (3, 0, -1), (None, 0, 0), (3, None, 0)]:
            query = f"SELECT conflictdb.tile_{layer}(%s::int, %s::int, %s, %s)"
            assert refusal(crossing, query, [z, x, y, given]) == "ZC005"
    assert tile(crossing, "areas", 30, 0, 2**30 - 1) == {}


def test_havens_need_an_instant(crossing: Conn) -> None:
    with pytest.raises(psycopg.Error) as refused:
        tile(crossing, "havens", 0, 0, 0)
    assert refused.value.sqlstate == "ZC003"


@pytest.mark.parametrize(
    "scene",
    [Scene("s"), Scene("s", Motion.GREAT_CIRCLE, centre=(180.0, 15.0))],
    ids=["rhumb", "great circle"],
)
def test_across_the_seam_both_sides_show_it(conn: Conn, scene: Scene) -> None:
    """However its longitudes are written, and whatever other longitudes a path around that way would have."""
    areas = [box("EAST", 179.0, 10.0, 181.0, 11.0), box("WEST", -181.0, 20.0, -179.0, 21.0)]
    tracks = [track("T", (170.0, 10.5), (-170.0, 10.5)), track("U", (190.0, 20.5), (175.0, 20.5))]
    load(conn, scene, areas, tracks)
    detect(conn, "s", jobs=1)
    for x, edge in ((15, 4096), (0, 0)):
        for kind, expected in (("areas", ["EAST", "WEST"]), ("tracks", ["T", "U"]), ("conflicts", ["EAST", "WEST"])):
            found = tile(conn, kind, 4, x, 7)
            assert keys(found, kind) == expected
            # Into the other side, without a gap.
            assert all(shape.bounds[0] <= edge <= shape.bounds[2] for _, shape in found[kind])
        ((_, haven),) = tile(conn, "havens", 9, 511 if x else 0, 240, at=NOON)["havens"]
        assert haven.bounds[0] - 1 <= edge <= haven.bounds[2] + 1
    for kind in ("areas", "tracks", "conflicts"):
        assert tile(conn, kind, 4, 7, 7) == tile(conn, kind, 4, 8, 7) == {}


def test_near_the_poles_the_map_ends(conn: Conn) -> None:
    """An area around a pole shows as far as Web Mercator reaches; an area north of its end does not show."""
    cap = shapely.segmentize(shapely.box(-180.0, 84.0, 180.0, 90.0), 10.0)
    areas = [Area("CAP", shapely.MultiPolygon([cap])), box("BEYOND", 10.0, 86.0, 20.0, 87.0)]
    load(conn, Scene("s", Motion.GREAT_CIRCLE, centre=(0.0, 90.0)), areas, [track("T", (10.0, 80.0), (-170.0, 80.0))])
    detect(conn, "s", jobs=1)
    for x in range(8):
        found = tile(conn, "areas", 3, x, 0)
        assert keys(found, "areas") == ["CAP"]
        assert found["areas"][0][1].area > 1e5
    assert tile(conn, "areas", 3, 0, 7) == {}
    assert keys(tile(conn, "tracks", 3, 4, 0), "tracks") == ["T"]
    assert tile(conn, "tracks", 3, 6, 0) == {}
    assert tile(conn, "havens", 0, 0, 0, at=NOON) == {}
    # Half an hour after it set out, at 80.4 N.
    assert keys(tile(conn, "havens", 0, 0, 0, at="2026-03-01T00:30:00Z"), "havens") == ["T"]


def test_what_waits_for_detection_shows(conn: Conn) -> None:
    load(conn, Scene("s"), [box("A", 5.0, 5.0, 6.0, 6.0)], [])
    assert keys(tile(conn, "areas", 4, 8, 7), "areas") == ["A"]
    conn.commit()
    detect(conn, "s", jobs=1)
    conn.execute("UPDATE conflictdb.area SET footprint = ST_Translate(footprint, 60, 0)")
    assert tile(conn, "areas", 4, 8, 7) == {}
    assert keys(tile(conn, "areas", 4, 10, 7), "areas") == ["A"]


def test_small_things_are_points_and_lines_far_out(conn: Conn) -> None:
    areas = [box("SMALL", 5.0, 5.0, 5.0001, 5.0001), box("THIN", 5.0, 7.0, 15.0, 7.0001)]
    circle = shapely.Point(5, 10).buffer(1, quad_segs=500)
    load(conn, Scene("s"), [*areas, Area("ROUND", shapely.MultiPolygon([circle]))], [])
    detect(conn, "s", jobs=1)
    shapes = {fields["key"]: shape for fields, shape in tile(conn, "areas", 3, 4, 3)["areas"]}
    assert (shapes["SMALL"].geom_type, shapely.get_dimensions(shapes["THIN"])) == ("Point", 1)
    assert shapely.get_num_coordinates(shapes["ROUND"]) < 200
    near = {fields["key"]: shape for fields, shape in tile(conn, "areas", 18, 134712, 127426)["areas"]}
    assert near["SMALL"].area > 100


def test_one_tile_of_a_large_scene_reads_few_rows(conn: Conn) -> None:
    """A tile of a few of 1600 areas, and of conflicts of neighbours, reads a few rows; counted, not timed.

    Also right after the marks of all objects were deleted, which statistics still count.
    """
    try:
        conn.execute("LOAD 'auto_explain'")
    except psycopg.Error:
        pytest.skip("did not run: the server has no auto_explain")
    conn.rollback()
    grid = [box(f"A{n}", n % 40, n // 40, n % 40 + 1.01, n // 40 + 0.9) for n in range(1600)]
    load(conn, Scene("s"), grid, [])
    conn.execute("ANALYZE")
    conn.commit()
    detect(conn, "s", jobs=1)
    conn.execute("ANALYZE")
    conn.execute("LOAD 'auto_explain'")
    for name, value in (
        ("log_min_duration", "0"), ("log_nested_statements", "on"), ("log_analyze", "on"), ("log_timing", "off"),
        ("log_format", "json"),
    ):  # fmt: skip
        conn.execute(f"SET auto_explain.{name} = {value}".encode())
    conn.execute("SET client_min_messages = log")
    plans: list[dict[str, Any]] = []

    def keep(notice: psycopg.errors.Diagnostic) -> None:
        _, _, text = (notice.message_primary or "").partition("plan:\n")
        if text:
            plans.append(json.loads(text)["Plan"])

    conn.add_notice_handler(keep)
    assert len(keys(tile(conn, "areas", 8, 142, 113), "areas")) > 3
    assert len(keys(tile(conn, "conflicts", 8, 142, 113), "conflicts")) > 1
    assert len(plans) > 3
    assert max(map(read, plans)) < 300
    conn.execute("SET LOCAL auto_explain.log_min_duration = -1")
    conn.execute("SET LOCAL track_functions = 'all'")
    assert len(keys(tile(conn, "conflicts", 3, 4, 3), "conflicts")) > 1000
    assert slow_drawings(conn) < 300  # those at the edges of the tile


def read(plan: dict[str, Any]) -> float:
    """Return the most rows that any node of a plan handed on or threw away."""
    thrown = sum(plan.get(f"Rows Removed by {why}", 0) for why in ("Filter", "Join Filter", "Index Recheck"))
    own = (plan["Actual Rows"] + thrown) * plan["Actual Loops"]
    return max([own, *(read(child) for child in plan.get("Plans", []))])


def test_what_waits_for_detection_is_drawn_in_one_pass(conn: Conn) -> None:
    """A tile draws only the visible ones of 400 waiting objects, never point by point; calls are counted."""
    areas = [box(f"A{n}", n % 40, n // 40, n % 40 + 0.9, n // 40 + 0.9) for n in range(200)]
    tracks = [track(f"T{n}", (n % 40, n // 40), (n % 40 + 0.5, n // 40 + 0.5)) for n in range(200)]
    load(conn, Scene("s"), areas, tracks)
    conn.execute("SET LOCAL track_functions = 'all'")
    for kind in ("areas", "tracks"):
        assert len(tile(conn, kind, 0, 0, 0)[kind]) == 200
        assert 0 < len(tile(conn, kind, 7, 67, 62)[kind]) < 20
        assert tile(conn, kind, 7, 10, 10) == {}
    assert slow_drawings(conn) == 0


def slow_drawings(conn: Conn) -> int:
    """Return how often this transaction drew a shape point by point."""
    row = conn.execute(
        "SELECT coalesce(sum(calls), 0)::integer FROM pg_stat_xact_user_functions "
        "WHERE funcname IN ('_drawn', '_drawn_path', '_tile_shape')"
    ).fetchone()
    assert row is not None
    return int(row[0])


@pytest.mark.parametrize(
    "scene",
    [Scene("s"), Scene("s", Motion.GREAT_CIRCLE, centre=(10.0, 55.0))],
    ids=["rhumb", "great circle"],
)
def test_what_is_drawn_in_one_pass_is_drawn_as_the_rest(conn: Conn, scene: Scene) -> None:
    """Objects of all sizes are where they are to within a unit, whether their sides have points put on them or not."""
    rng = np.random.default_rng(12)
    sizes = 10 ** rng.uniform(-3, 1, 60)
    places = rng.uniform((0, 40), (20, 65), (60, 2))
    areas = [box(f"A{n}", x, y, x + d, y + d / 2) for n, ((x, y), d) in enumerate(zip(places, sizes, strict=True))]
    tracks = [
        track(f"T{n}", (x, y), (x + d, y + d / 3), (x - d, y + d / 2))
        for n, ((x, y), d) in enumerate(zip(places, sizes, strict=True))
    ]
    load(conn, scene, areas, tracks)
    query = "SELECT conflictdb_internal._plane(motion, earth, centre_lon, centre_lat) FROM conflictdb.scene"
    row = conn.execute(query.encode()).fetchone()
    assert row is not None
    for kind, table, drawn in (("areas", "area", "_drawn(footprint"), ("tracks", "track", "_drawn_path(path")):
        for place in ((1, 1, 0), (4, 8, 4), (6, 33, 20)):
            found = {str(fields["key"]): shape for fields, shape in tile(conn, kind, *place)[kind]}
            query = (
                f"SELECT key, ST_AsBinary(ST_Affine(s, 1, 0, 0, -1, 0, 4096)) FROM conflictdb.{table}, "
                f"conflictdb_internal._tile_shape(conflictdb_internal.{drawn}, %s), %s, %s, %s) s WHERE s IS NOT NULL"
            )
            known = {key: shapely.from_wkb(shape) for key, shape in conn.execute(query.encode(), [row[0], *place])}
            # As read, a tile ends at its edge; rounding decides whether shapes next to the edge are in it.
            inner = shapely.box(3, 3, 4093, 4093)
            assert {key for key, shape in known.items() if shape.intersects(inner)} <= set(found) <= set(known)
            assert found
            for key, shape in found.items():
                assert known[key].buffer(3).covers(shape), (key, place)
                assert shape.buffer(3).covers(known[key].intersection(inner)), (key, place)


def test_servers_of_tiles_find_the_functions_and_readers_may_call_them(crossing: Conn) -> None:
    """By names and types of arguments, as pg_tileserv and martin look for them."""
    found = crossing.execute(
        """SELECT p.proname::text FROM pg_proc p
           WHERE p.prorettype = 'bytea'::regtype AND p.proargnames = '{z,x,y,query_params}'
             AND oidvectortypes(p.proargtypes) = 'integer, integer, integer, json'
             AND has_function_privilege('conflictdb_reader', p.oid, 'execute')
             AND NOT has_function_privilege('public', p.oid, 'execute') ORDER BY 1"""
    ).fetchall()
    assert found == [(f"tile_{layer}",) for layer in sorted(LAYERS)]
    crossing.execute("SET ROLE conflictdb_reader")
    crossing.execute("SET search_path = pg_catalog")
    for layer in LAYERS:
        assert tile(crossing, layer, 0, 0, 0, at=NOON)
    row = crossing.execute(
        'SELECT conflictdb.tile_areas(x => 0, y => 0, z => 0, query_params => $${"scene": "s"}$$)'
    ).fetchone()
    assert row is not None
    assert keys(decode(row[0]), "areas") == ["LATER", "NOW"]


def test_views_are_layers(crossing: Conn) -> None:
    crossing.execute("SET ROLE conflictdb_reader")
    registered = crossing.execute(
        """SELECT f_table_name, f_geometry_column, type, srid FROM public.geometry_columns
           WHERE f_table_schema = 'conflictdb' AND f_table_name LIKE 'map%' ORDER BY 1, 2"""
    ).fetchall()
    assert registered == [
        ("map_areas", "footprint", "MULTIPOLYGON", 4326),
        ("map_conflicts", "first_contact_point", "POINT", 4326),
        ("map_conflicts", "region", "MULTIPOLYGON", 4326),
        ("map_tracks", "path", "MULTILINESTRING", 4326),
    ]
    times = crossing.execute(
        "SELECT key, starts_at::text, ends_at IS NULL FROM conflictdb.map_areas ORDER BY key"
    ).fetchall()
    assert [(key, endless) for key, _, endless in times] == [("LATER", True), ("NOW", False)]
    assert crossing.execute("SELECT ends_at - starts_at = '1 day' FROM conflictdb.map_tracks").fetchone() == (True,)
    assert crossing.execute(
        "SELECT a_key, b_key, starts_at < ends_at, ST_Area(region) > 0.01 FROM conflictdb.map_conflicts"
    ).fetchall() == [("NOW", "T", True, True)]


def test_each_period_is_a_row_with_a_key_of_its_own(conn: Conn) -> None:
    """A track that goes there and back through areas, and areas that meet for ever."""
    areas = [box(f"A{n}", 5.0 + n, -1.0, 5.5 + n, 1.0) for n in range(5)] + [box("B", 5.2, 0.5, 5.3, 0.6)]
    load(conn, Scene("s"), areas, [track("T", (0.0, 0.0), (20.0, 0.0), (0.0, 0.0))])
    detect(conn, "s", jobs=1)
    rows = conn.execute("SELECT period_id, a_key, b_key, starts_at, ends_at FROM conflictdb.map_conflicts").fetchall()
    assert len(rows) == len({row[0] for row in rows}) == 11
    assert [row[3:] for row in rows if row[2] == "B"] == [(None, None)]


@pytest.mark.parametrize("motion", list(Motion))
@pytest.mark.parametrize("size_deg", [0.04, 3.0, 50.0])
@pytest.mark.parametrize("place_deg", [(10.0, 50.0), (0.0, 0.0), (-180.0, -30.0), (170.0, 60.0), (30.0, 74.9)])
def test_views_draw_edges_as_they_run_in_the_plane(
    conn: Conn, motion: Motion, size_deg: float, place_deg: tuple[float, float]
) -> None:
    """Whether an edge is short, needs no plane, or crosses the seam: to 200 m; boxes find the same rows."""
    rng = np.random.default_rng(7)
    areas, tracks = [], []
    for k in range(6):
        at = np.array(place_deg) + rng.uniform(-size_deg, size_deg, 2) / 4
        corners = (at + rng.uniform(0.2, 1.0, (3, 2)) * [(1, 0), (0, 1), (-1, 0)] * size_deg / 4).clip(
            (-340, -85), (340, 85)
        )
        areas.append(Area(f"A{k}", shapely.MultiPolygon([shapely.Polygon(corners)])))
        tracks.append(track(f"T{k}", *(tuple(place) for place in corners)))
    load(conn, Scene("s", motion=motion), areas, tracks)
    # The reference: each step by itself, in the plane of the scene.
    conn.execute(
        """CREATE TEMP TABLE reference AS
           SELECT 'map_areas' AS layer, a.key,
                  conflictdb_internal._wrapped(conflictdb_internal._drawn(a.footprint, p)) AS shape
           FROM conflictdb.area a JOIN conflictdb.scene s USING (scene_id),
                conflictdb_internal._plane(s.motion, s.earth, s.centre_lon, s.centre_lat) p
           UNION ALL
           SELECT 'map_tracks', t.key, conflictdb_internal._wrapped(conflictdb_internal._drawn_path(t.path, p))
           FROM conflictdb.track t JOIN conflictdb.scene s USING (scene_id),
                conflictdb_internal._plane(s.motion, s.earth, s.centre_lon, s.centre_lat) p"""
    )
    for layer, column in (("map_areas", "footprint"), ("map_tracks", "path")):
        shown = f"conflictdb.{layer} v JOIN reference r ON r.layer = '{layer}' AND r.key = v.key"
        rows = conn.execute(
            f"SELECT ST_HausdorffDistance(v.{column}, r.shape), ST_XMin(v.{column}), ST_XMax(v.{column}), "
            f"ST_IsValid(v.{column}) FROM {shown}".encode()
        ).fetchall()
        assert len(rows) == 6
        for apart_deg, west, east, is_valid in rows:
            assert apart_deg < 200 / 111_000 / np.cos(np.radians(80))
            assert -180 <= west <= east <= 180
            assert is_valid
        for _ in range(20):
            corner = np.array(place_deg) + rng.uniform(-size_deg, size_deg, 2) / 2
            corner[0] = (corner[0] + 180) % 360 - 180
            window = [
                *corner,
                *(corner + 0.03 + rng.uniform(0, size_deg, 2) / 4),
            ]  # larger than the rest of it below
            found, sure, possible = conn.execute(
                f"""WITH window_ AS (SELECT ST_MakeEnvelope(%s, %s, %s, %s, 4326) AS box)
                    SELECT array_agg(v.key) FILTER (WHERE v.{column} && w.box),
                           array_agg(v.key) FILTER (WHERE r.shape && ST_Expand(w.box, -1e-2)),
                           array_agg(v.key) FILTER (WHERE r.shape && ST_Expand(w.box, 1e-2))
                    FROM {shown}, window_ w""".encode(),
                window,
            ).fetchone() or ([], [], [])
            assert set(sure or []) <= set(found or []) <= set(possible or [])


@pytest.mark.parametrize(("layer", "column"), [("map_areas", "footprint"), ("map_tracks", "path")])
def test_boxes_of_clients_evaluate_each_step_once(crossing: Conn, layer: str, column: str) -> None:
    """Steps that the planner puts into each other are evaluated as often as they are named: milliseconds a row."""
    query = (
        f"EXPLAIN (VERBOSE) SELECT {column} FROM conflictdb.{layer} WHERE {column} && ST_MakeEnvelope(0, 0, 1, 1, 4326)"
    )
    plan = "\n".join(row[0] for row in crossing.execute(query.encode()).fetchall()).lower()
    assert "_shown(" in plan
    assert "transform" not in plan


def test_a_box_of_a_client_calls_no_routine_for_short_edges(conn: Conn) -> None:
    """Half a second for a box among 20,000 areas, for points that none of them needs."""
    load(conn, Scene("s"), [box(f"A{i}", 0.1 * i, 10.0, 0.1 * i + 0.05, 10.1) for i in range(50)], [])
    load(conn, Scene("far"), [box("A", 0.0, 10.0, 3.0, 11.0)], [])
    conn.execute("SET LOCAL track_functions = 'all'")
    asked = (
        "SELECT count(*) FROM conflictdb.map_areas WHERE scene = %s AND footprint && ST_MakeEnvelope(0, 0, 1, 20, 4326)"
    )
    calls = "SELECT coalesce(sum(calls), 0) FROM pg_stat_xact_user_functions WHERE funcname = '_shown'"
    for scene, found, called in (("s", 11, 0), ("far", 1, 1)):
        assert conn.execute(asked.encode(), [scene]).fetchone() == (found,)
        assert conn.execute(calls).fetchone() == (called,)


def test_views_cut_at_the_seam(conn: Conn) -> None:
    load(conn, Scene("s"), [box("A", 179.0, 10.0, 181.0, 11.0)], [track("T", (170.0, 10.5), (-170.0, 10.5))])
    for table, column in (("map_areas", "footprint"), ("map_tracks", "path")):
        row = conn.execute(
            f"SELECT ST_XMin({column}), ST_XMax({column}), ST_NumGeometries({column}), "
            f"ST_Intersects({column}, ST_SetSRID(ST_MakePoint(0, 10.5), 4326)) FROM conflictdb.{table}".encode()
        ).fetchone()
        assert row == (-180, 180, 2, False)
