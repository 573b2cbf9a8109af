"""Queries of SQL users: conflicts by time, place and object, candidates, conflicts of a new area."""

import json
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from databases import TestServer
from piecework import load
from scenes import box, sail

from conflictdb import store
from conflictdb.core import conflict_regions
from conflictdb.jobs.detect import detect
from conflictdb.kernel.regions import OutlineKind
from conflictdb.model.methods import Method
from conflictdb.model.plans import EarthModel, Scene

Conn = psycopg.Connection[Any]

T0 = datetime(2026, 3, 1, tzinfo=UTC)
T0_US = int(T0.timestamp()) * 1_000_000
HOUR_US = 3_600_000_000


# EAST and WEST overlap in [4.5, 5]; the ferry crosses both along 57.5 in one hour and comes back in the next.
AREAS = [
    box("WEST", 4, 57, 5, 58),
    box("EAST", 4.5, 57, 6, 58, start_us=T0_US, end_us=T0_US + 4 * HOUR_US),
    box("DEEP", 4, 57, 6, 58, floor_m=-200.0, ceiling_m=-100.0),
    box("SEAM-1", 179, -10, 181, -9),
    box("SEAM-2", -180.5, -9.5, -178, -8.5),
]
TRACKS = [
    replace(sail("FERRY", (3.0, 57.5), (7.0, 57.5), (3.0, 57.5)), floor_m=0.0, ceiling_m=50.0),
    sail("OCEAN", (178.0, -9.2), (-178.0, -9.2)),
]


@pytest.fixture(scope="module", params=list(EarthModel))
def detected_dsn(_server: TestServer, template: str, worker_id: str, request: pytest.FixtureRequest) -> Iterator[str]:
    """Return the connection string of a database with the scene, detected; tests must not commit to it."""
    name = f"{_server.prefix}_{worker_id}_queries"
    dsn = _server.clone(template, name)
    with psycopg.connect(dsn) as connection:
        load(connection, Scene("s", earth=request.param), AREAS, TRACKS)
        detect(connection, "s", jobs=1)
    yield dsn
    _server.drop(name)


@pytest.fixture
def conn_with_conflicts(detected_dsn: str) -> Iterator[Conn]:
    options = "-c timezone=UTC -c search_path=conflictdb,conflictdb_internal,public"
    with psycopg.connect(detected_dsn, options=options) as connection:
        yield connection


def keys(conn: Conn, query: str, *arguments: object) -> set[tuple[str, ...]]:
    return set(conn.execute(query.encode(), arguments).fetchall())


PAIRS = {
    ("EAST", "WEST"),
    ("EAST", "FERRY"),
    ("WEST", "FERRY"),
    ("SEAM-1", "SEAM-2"),
    ("SEAM-1", "OCEAN"),
    ("SEAM-2", "OCEAN"),
}


def test_view_holds_every_pair(conn_with_conflicts: Conn) -> None:
    conn = conn_with_conflicts
    assert keys(conn, "SELECT a_key, b_key FROM conflicts WHERE scene = 's'") == PAIRS | {
        ("DEEP", "EAST"), ("DEEP", "WEST"),
    }  # fmt: skip
    columns = [column.name for column in conn.execute("SELECT * FROM conflicts").description or ()]
    assert columns == [
        *("scene", "a_key", "a_kind", "b_key", "b_kind", "periods", "first_contact", "last_contact", "verdict"),
        *("region", "first_contact_point", "method", "time_error_s", "is_current", "run_id", "found_at"),
        *("closest_at", "closest_m", "closest_error_m", "closest_a_point", "closest_b_point"),
        *("scene_is_current", "conflict_id", "opened_at", "changed_at"),
        *("acknowledged_by", "acknowledged_at", "acknowledged_for", "acknowledged_until"),
        *("first_contact_lon_deg", "first_contact_lat_deg", "a_name", "b_name", "lacking_s"),
        "certainty",
        *("a_table", "a_row", "b_table", "b_row"),
    ]


def test_conflicts_at_an_instant(conn_with_conflicts: Conn) -> None:
    at = "SELECT a_key, b_key FROM conflicts_at('s', %s) WHERE b_key IN ('FERRY', 'WEST') AND a_key <> 'DEEP'"
    assert keys(conn_with_conflicts, at, T0 + timedelta(minutes=20)) == {("WEST", "FERRY"), ("EAST", "WEST")}
    assert keys(conn_with_conflicts, at, T0 + timedelta(minutes=40)) == {("EAST", "FERRY"), ("EAST", "WEST")}
    assert keys(conn_with_conflicts, at, T0 + timedelta(hours=4, microseconds=1)) == set()
    assert keys(conn_with_conflicts, at, None) == set()


def test_conflicts_of_an_object(conn_with_conflicts: Conn) -> None:
    of = "SELECT a_key, b_key FROM conflicts_of('s', %s)"
    assert keys(conn_with_conflicts, of, "FERRY") == {("EAST", "FERRY"), ("WEST", "FERRY")}
    assert keys(conn_with_conflicts, of, "SEAM-2") == {("SEAM-1", "SEAM-2"), ("SEAM-2", "OCEAN")}
    assert keys(conn_with_conflicts, of, "nobody") == set()


@pytest.mark.parametrize(
    ("envelope", "span", "expected"),
    [
        ((4.6, 57.1, 4.7, 57.2), "(,)", {("EAST", "WEST"), ("DEEP", "EAST"), ("DEEP", "WEST")}),
        ((5.5, 57.45, 5.6, 57.55), "(,)", {("EAST", "FERRY"), ("DEEP", "EAST")}),
        ((5.5, 57.45, 5.6, 57.55), "[2026-03-01 05:00+00,)", set()),
        ((0, 0, 1, 1), "(,)", set()),
        ((179.5, -9.4, 179.9, -9.3), "(,)", {("SEAM-1", "SEAM-2")}),
        ((-180.5, -9.4, -180.1, -9.3), "(,)", {("SEAM-1", "SEAM-2")}),
        ((180.5, -9.25, 180.6, -9.15), "(,)", {("SEAM-1", "SEAM-2"), ("SEAM-1", "OCEAN"), ("SEAM-2", "OCEAN")}),
    ],
)
def test_conflicts_within_a_place_and_time(
    conn_with_conflicts: Conn, envelope: tuple[float, ...], span: str, expected: set[tuple[str, str]]
) -> None:
    within = "SELECT a_key, b_key FROM conflicts_within('s', ST_SetSRID(ST_MakeEnvelope(%s, %s, %s, %s), 4326), %s)"
    assert keys(conn_with_conflicts, within, *envelope, span) == expected


def test_region_of_areas_is_their_intersection(conn_with_conflicts: Conn) -> None:
    rows = conn_with_conflicts.execute("SELECT a_key, b_key, region::text FROM conflicts WHERE b_kind = 'area'")
    region = {row[:2]: shapely.from_wkb(row[2]) for row in rows}
    assert region["EAST", "WEST"].symmetric_difference(shapely.box(4.5, 57, 5, 58)).area < 1e-9
    # Both reach over the seam: the answer is cut there.
    wanted = shapely.union(shapely.box(179.5, -9.5, 180, -9), shapely.box(-180, -9.5, -179, -9))
    assert region["SEAM-1", "SEAM-2"].symmetric_difference(wanted).area < 1e-9
    assert shapely.get_srid(region["SEAM-1", "SEAM-2"]) == 4326


def test_region_of_a_track_covers_where_they_meet_and_not_much_more(conn_with_conflicts: Conn) -> None:
    rows = conn_with_conflicts.execute("SELECT a_key, b_key, region::text FROM conflicts WHERE b_kind = 'track'")
    region = {row[:2]: shapely.from_wkb(row[2]) for row in rows}
    for pair, west, east in ((("EAST", "FERRY"), 4.5, 6.0), (("WEST", "FERRY"), 4.0, 5.0)):
        band = shapely.box(west, 57.4985, east, 57.5015)
        assert region[pair].covers(band)
        assert region[pair].area < 1.5 * shapely.box(west, 57.4982, east, 57.5018).area
    west, _, east, _ = region["SEAM-1", "OCEAN"].bounds
    assert (west, east) == (-180.0, 180.0)
    assert region["SEAM-1", "OCEAN"].geom_type == "MultiPolygon"


def test_part_of_a_region_whose_edges_cross_when_rounded_is_mended(conn: Conn) -> None:
    """Found in a hull with vertices in a row: GEOS refused the union, and with it the list of all conflicts."""
    part = (
        "POLYGON((-2996096.399562144 2143869.3835451314,-2050675.3101090672 4266676.454102659,"
        "-2050644.9565807781 4266676.454102659,-2050644.9565807781 4266646.10057437,"
        "-2076420.8313166487 4208770.08135973,-2973885.3351701386 2193642.625871392,"
        "-2996066.046033855 2143839.0300168423,-2996096.399562144 2143839.0300168423,"
        "-2996096.399562144 2143869.3835451314))"
    )
    row = conn.execute(
        "SELECT ST_IsValidReason(d.before), ST_IsValid(d.now), ST_Area(d.now) / ST_Area(d.before) "
        "FROM (SELECT conflictdb_internal._part_from_plane(%(part)s, 'wgs84') AS now, "
        "             conflictdb_internal._from_plane(%(part)s, 'wgs84') AS before) d",
        {"part": part},
    ).fetchone()
    assert row is not None
    assert row[0].startswith("Self-intersection")
    assert row[1:] == (True, pytest.approx(1.0, abs=1e-4))


def test_regions_are_stored(conn_with_conflicts: Conn) -> None:
    """Reading them computes nothing."""
    plan = conn_with_conflicts.execute("EXPLAIN (VERBOSE) SELECT * FROM conflicts_of('s', 'FERRY')")
    assert "_conflict_region" not in str(plan.fetchall())
    assert all(c.region is None for c in store.conflicts(conn_with_conflicts, "s"))
    with_region = store.conflicts(conn_with_conflicts, "s", with_region=True)
    assert {json.loads(c.region or "")["type"] for c in with_region} == {"Polygon", "MultiPolygon"}


def test_a_region_on_which_geometry_fails_is_found_out_by_the_database(
    conn: Conn, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other pairs keep theirs, and the detection its end."""
    outlines, united = conflict_regions.outlines, conflict_regions._united_in_degrees

    def crossed(*rings: Any, **more: Any) -> Any:
        data, end, kind = outlines(*rings, **more)
        return data, end, np.full(len(kind), OutlineKind.CROSSED, np.int8)

    def failing(plane: Any, ring: Any, *offsets: Any) -> Any:
        if shapely.polygons(ring).area > 1e10:  # WEST and EAST, plane metres
            raise shapely.errors.GEOSException("planted")
        return united(plane, ring, *offsets)

    monkeypatch.setattr(conflict_regions, "outlines", crossed)
    monkeypatch.setattr(conflict_regions, "_united_in_degrees", failing)
    load(conn, Scene("s"), AREAS, TRACKS)
    assert detect(conn, "s", jobs=1).conflicts == 8
    assert conn.execute("SELECT count(*) FROM conflictdb.conflict WHERE region IS NULL").fetchone() == (0,)
    rows = conn.execute("SELECT region::text FROM conflictdb.conflicts WHERE (a_key, b_key) = ('EAST', 'WEST')")
    (region,) = (shapely.from_wkb(row[0]) for row in rows)
    assert region.covers(shapely.box(4.5, 57, 5, 58))
    assert shapely.box(4.499, 56.999, 5.001, 58.001).covers(region)


@pytest.mark.parametrize("method", sorted(set(Method) - {Method.SCREEN}))
def test_all_conflicts_have_a_valid_region(conn: Conn, method: Method) -> None:
    """But those of `screen`, which computes none."""
    load(conn, Scene("s", method=method), AREAS, TRACKS)
    detect(conn, "s", jobs=1)
    rows = conn.execute(
        "SELECT GeometryType(region), ST_IsValid(region), ST_SRID(region) FROM conflictdb.conflict"
    ).fetchall()
    assert {*rows} == {("POLYGON", True, 4326), ("MULTIPOLYGON", True, 4326)}


@pytest.mark.parametrize(
    "query",
    [
        """SELECT * FROM conflictdb.conflicts_within('grid', ST_MakeEnvelope(3.03, 3.03, 3.04, 3.04, 4326),
                                                     '[2026-03-01,2026-03-02)')""",
        """SELECT * FROM conflictdb.conflicts
           WHERE scene = 'grid' AND region && ST_MakeEnvelope(3.03, 3.03, 3.04, 3.04, 4326)
           AND periods && tstzrange '[2026-03-01,2026-03-02)'""",
    ],
)
def test_conflicts_in_a_window_are_looked_up_in_an_index(conn: Conn, query: str) -> None:
    """By where: the plan reads no more of them."""
    rows = [(i, j) for i in range(40) for j in range(40)]
    areas = [box(f"A{i}-{j}", 0.1 * i, 0.1 * j, 0.1 * i + 0.06, 0.1 * j + 0.06) for i, j in rows]
    more = [box(f"B{i}-{j}", 0.1 * i + 0.02, 0.1 * j + 0.02, 0.1 * i + 0.08, 0.1 * j + 0.08) for i, j in rows]
    load(conn, Scene("grid"), [*areas, *more], [])
    detect(conn, "grid", jobs=1)
    conn.execute("ANALYZE")
    plan = "\n".join(row[0] for row in conn.execute(f"EXPLAIN ANALYZE {query}".encode()).fetchall())
    assert "conflict_region_spgist" in plan
    assert any("Index Cond" in line and "region &&" in line for line in plan.splitlines())
    assert conn.execute(query.encode()).rowcount == 1


def test_areas_nearer_than_the_separation_have_a_region_between_them(conn: Conn) -> None:
    gap = [box("A", 4, 57, 5, 58), box("B", 5.001, 57, 6, 58)]  # 60 m apart
    load(conn, Scene("s", separation_m=100.0), gap, [])
    detect(conn, "s", jobs=1)
    (found,) = store.conflicts(conn, "s", with_region=True)
    west, _, east, _ = shapely.from_geojson(found.region or "").bounds
    assert 4.999 < west < east < 5.002


def test_candidates_are_a_superset_of_the_conflicts(conn_with_conflicts: Conn) -> None:
    conn = conn_with_conflicts
    found = keys(conn, "SELECT a_key, b_key FROM candidates('s')")
    both_ways = found | {(b, a) for a, b in found}
    assert keys(conn, "SELECT a_key, b_key FROM conflicts") <= both_ways
    assert ("DEEP", "FERRY") not in both_ways
    row = conn.execute(
        """SELECT a_kind, b_kind, spans = '{["2026-03-01 00:00+00","2026-03-01 04:00+00")}'::tstzmultirange,
                  ST_Area(region) FROM candidates('s') WHERE 'EAST' IN (a_key, b_key) AND 'WEST' IN (a_key, b_key)"""
    ).fetchone()
    assert row is not None
    assert row[:3] == ("area", "area", True)
    assert row[3] == pytest.approx(0.5, rel=1e-4)


@pytest.mark.parametrize(
    ("envelope", "more", "expected"),
    [
        ((5.5, 57.1, 7, 57.2), "", {"EAST", "DEEP"}),
        ((5.5, 57.1, 7, 57.6), "", {"EAST", "DEEP", "FERRY"}),
        ((5.5, 57.1, 7, 57.6), ", '[2026-03-01 02:30+00,)'", {"EAST", "DEEP"}),
        ((5.5, 57.1, 7, 57.6), ", '[2026-03-01 04:00+00,)'", {"DEEP"}),
        ((5.5, 57.1, 7, 57.6), ", '(,)', 100, 200", {"EAST"}),
        ((5.5, 57.1, 7, 57.6), ", '(,)', NULL, -100", {"EAST", "DEEP"}),
        ((-180.2, -9.6, -180.1, -9.55), "", {"SEAM-1"}),
        ((179.8, -9.6, 179.9, -9.55), "", {"SEAM-1"}),
        ((180.2, -8.9, 180.3, -8.8), "", {"SEAM-2"}),
    ],
)
def test_probe_says_what_an_area_would_meet(
    conn_with_conflicts: Conn, envelope: tuple[float, ...], more: str, expected: set[str]
) -> None:
    query = f"SELECT key FROM probe('s', ST_SetSRID(ST_MakeEnvelope(%s, %s, %s, %s), 4326){more})"
    assert keys(conn_with_conflicts, query, *envelope) == {(key,) for key in expected}


@pytest.mark.parametrize(("wanted_m", "expected"), [(500_000.0, set()), (1_120_000.0, {("A",)})])
def test_probe_reaches_over_the_pole(conn: Conn, wanted_m: float, expected: set[tuple[str]]) -> None:
    """At 85 N and 170 degrees of longitude apart it is 1,107.6 km over the pole, and half way around in the plane."""
    scene = Scene("s", earth=EarthModel.SPHERE, tolerance_m=0.0, separation_m=wanted_m)
    load(conn, scene, [box("A", 0.0, 85.0, 0.001, 85.001)], [])
    detect(conn, "s")
    assert (
        keys(conn, "SELECT key FROM conflictdb.probe('s', ST_SetSRID(ST_MakeEnvelope(170, 85, 170.001, 85.001), 4326))")
        == expected
    )


def test_probe_says_when_and_where_and_writes_nothing(conn_with_conflicts: Conn) -> None:
    conn = conn_with_conflicts
    conn.commit()
    conn.execute("SET TRANSACTION READ ONLY")
    row = conn.execute(
        """SELECT kind, spans, region::text
           FROM probe('s', ST_SetSRID(ST_MakeEnvelope(5.5, 57, 7, 57.4), 4326), '[2026-03-01 03:00+00,2026-03-02)')
           WHERE key = 'EAST'"""
    ).fetchone()
    assert row is not None
    assert row[0] == "area"
    assert [(r.lower, r.upper) for r in row[1]] == [(T0 + timedelta(hours=3), T0 + timedelta(hours=4))]
    assert shapely.from_wkb(row[2]).symmetric_difference(shapely.box(5.5, 57, 6, 57.4)).area < 1e-3


def test_probe_counts_the_separation(conn: Conn) -> None:
    load(conn, Scene("s", separation_m=2000.0), [box("A", 4, 70, 5, 71)], [])
    detect(conn, "s", jobs=1)
    query = "SELECT key FROM conflictdb.probe('s', ST_SetSRID(ST_MakeEnvelope(%s, 70.2, 5.5, 70.3), 4326))"
    metres_per_degree = 111_300 * np.cos(np.radians(70.3))
    assert keys(conn, query, 5 + 1990 / metres_per_degree) == {("A",)}
    assert keys(conn, query, 5 + 2100 / metres_per_degree) == set()


def test_incremental_and_full_detection_give_the_same_regions(conn: Conn) -> None:
    load(conn, Scene("s"), AREAS, TRACKS)
    detect(conn, "s", jobs=1)
    first = [replace(c, run_id=0) for c in store.conflicts(conn, "s", with_region=True)]
    detect(conn, "s", full=True, jobs=1)
    assert [replace(c, run_id=0) for c in store.conflicts(conn, "s", with_region=True)] == first
