"""Bad rows are refused by the database itself, each rule with its own SQLSTATE, whoever writes them.

Values that every way in can carry are in tests/integration/test_refusals.py.
"""

import json
import re
from typing import Any

import numpy as np
import psycopg
import pytest
from hostile_objects import put, throw

from conflictdb import connect

Conn = psycopg.Connection[Any]

SQUARE = "'SRID=4326;POLYGON((4 57,5 57,5 58,4 58,4 57))'::geometry"
PATH = "'SRID=4326;LINESTRING M(3 57 1000,4 57 2000)'::geometry"
HIGH = "'SRID=4326;LINESTRING M(5 88 0,5 88 3600)'"
# Properties nested to a number of levels below the object itself.
NESTED = "jsonb_build_object('x', (repeat('[', {0}) || repeat(']', {0}))::jsonb)"
OUTLINE = "rectangle_outline(100, 100, 50, 50)"


def ring(x: str, y: str) -> str:
    """Return SQL for a polygon with a vertex of these ordinates."""
    points = f"ARRAY[ST_MakePoint(4, 57), ST_MakePoint('{x}', '{y}'), ST_MakePoint(5, 58), ST_MakePoint(4, 57)]"
    return f"ST_SetSRID(ST_MakePolygon(ST_MakeLine({points})), 4326)"


BAD = {
    # areas
    "empty footprint": ("put_area('s', 'A', 'SRID=4326;POLYGON EMPTY')", "ZC001", "footprint_not_empty"),
    "null footprint": ("put_area('s', 'A', NULL)", "ZC001", "footprint_not_empty"),
    "NaN in footprint": (
        f"put_area('s', 'A', {ring('NaN', '57')})", "ZC001", "coordinates_finite",
    ),
    "infinite footprint": (
        f"put_area('s', 'A', {ring('5', 'Infinity')})", "ZC001", "coordinates_finite",
    ),
    "a line as footprint": ("put_area('s', 'A', 'SRID=4326;LINESTRING(0 0,1 1)')", "ZC001", "footprint_polygon"),
    "no SRID": ("put_area('s', 'A', 'POLYGON((4 57,5 57,5 58,4 57))')", "ZC001", "footprint_srid"),
    "another SRID": ("put_area('s', 'A', 'SRID=3395;POLYGON((4 57,5 57,5 58,4 57))')", "ZC001", "footprint_srid"),
    "latitude beyond 89 in rhumb": (
        "put_area('s', 'A', 'SRID=4326;POLYGON((4 57,5 57,5 89.5,4 57))')", "ZC005", "latitude_in_plane",
    ),
    "crosses itself between rhumb lines": (
        "put_area('s', 'A', 'SRID=4326;POLYGON((0 0,80 80,39 80,40 41,38 80,0 80,0 0))')",
        "ZC001", "footprint_valid_in_plane",
    ),
    "empty span": (f"put_area('s', 'A', {SQUARE}, 'empty')", "ZC003", "span_not_empty"),
    "span of no instant": (f"put_area('s', 'A', {SQUARE}, '[2026-01-01,2026-01-01)')", "ZC003", "span_not_empty"),
    "span before the year 1": (
        f"put_area('s', 'A', {SQUARE}, '[0044-03-15 BC,2026-01-01)')", "ZC003", "span_in_calendar",
    ),
    "span after the year 9999": (
        f"put_area('s', 'A', {SQUARE}, '[2026-01-01,12026-01-01)')", "ZC003", "span_in_calendar",
    ),
    "empty key": (f"put_area('s', '', {SQUARE})", "ZC008", "key_valid"),
    "null key": (f"put_area('s', NULL, {SQUARE})", "ZC008", "key_valid"),
    "long key": (f"put_area('s', repeat('x', 1001), {SQUARE})", "ZC008", "key_valid"),
    "properties not an object": (
        f"put_area('s', 'A', {SQUARE}, p_properties => '[1]')", "ZC012", "properties_object",
    ),
    "properties too deep": (
        f"put_area('s', 'A', {SQUARE}, p_properties => {NESTED.format(101)})", "ZC012", "properties_plain",
    ),
    "properties thousands deep": (
        f"put_area('s', 'A', {SQUARE}, p_properties => {NESTED.format(3000)})", "ZC012", "properties_plain",
    ),
    "number beyond a double": (
        f"put_area('s', 'A', {SQUARE}, p_properties => jsonb_build_object('x', jsonb_build_array(1, 1e309)))",
        "ZC012", "properties_plain",
    ),
    "number below a double": (
        f"put_area('s', 'A', {SQUARE}, p_properties => jsonb_build_object('x', -1e400))", "ZC012", "properties_plain",
    ),
    "unknown scene": (f"put_area('nowhere', 'A', {SQUARE})", "ZC010", "scene_known"),
    "key of a track": (f"put_area('s', 'T', {SQUARE})", "ZC007", "object_key_unique"),
    # tracks
    "one waypoint": ("put_track('s', 'B', 'SRID=4326;LINESTRING M EMPTY', {o})", "ZC001", "path_of_two"),
    "path without M": ("put_track('s', 'B', 'SRID=4326;LINESTRING(3 57,4 57)', {o})", "ZC001", "path_linestring_m"),
    "path without SRID": ("put_track('s', 'B', 'LINESTRING M(3 57 1,4 57 2)', {o})", "ZC001", "path_srid"),
    "NaN in path": (
        "put_track('s', 'B', 'SRID=4326;LINESTRING M(3 57 1,NaN 57 2)', {o})", "ZC001", "coordinates_finite",
    ),
    "NaN in times": (
        "put_track('s', 'B', 'SRID=4326;LINESTRING M(3 57 1,4 57 NaN,5 57 3)', {o})", "ZC001", "coordinates_finite",
    ),
    "path beyond 89 in rhumb": (
        "put_track('s', 'B', 'SRID=4326;LINESTRING M(5 88 1,5 89.1 2)', {o})", "ZC005", "latitude_in_plane",
    ),
    "haven beyond 89.5 in rhumb": (
        "put_track('s', 'B', 'SRID=4326;LINESTRING M(5 88 0,5 88.9 3600)', rectangle_outline(80000, 0, 1, 1))",
        "ZC005", "haven_in_plane",
    ),
    "times equal": (
        "put_track('s', 'B', 'SRID=4326;LINESTRING M(3 57 1,3 57 2,3 57 2)', {o})", "ZC002", "path_time_increasing",
    ),
    "times in one microsecond": (
        "put_track('s', 'B', 'SRID=4326;LINESTRING M(3 57 1,3 58 1.0000003)', {o})", "ZC002", "path_time_increasing",
    ),
    "times in milliseconds": (
        "put_track('s', 'B', 'SRID=4326;LINESTRING M(3 57 1700000000000,3 58 1700000001000)', {o})",
        "ZC003", "path_in_calendar",
    ),
    "outline twice round": (
        "put_track('s', 'B', {p}, 'POLYGON((0 0,10 0,10 10,0 10,0 0,10 0,10 10,0 10,0 0))')",
        "ZC006", "outline_convex",
    ),
    "outline pentagram": (
        "put_track('s', 'B', {p}, 'POLYGON((0 10,6 -8,-9.5 3,9.5 3,-6 -8,0 10))')", "ZC006", "outline_convex",
    ),
    "outline with a hole": (
        "put_track('s', 'B', {p}, 'POLYGON((0 0,9 0,9 9,0 0),(5 1,6 1,6 2,5 1))')", "ZC006", "outline_ring",
    ),
    "outline NaN": ("put_track('s', 'B', {p}, 'POLYGON((0 0,NaN 0,9 9,0 0))')", "ZC006", "outline_ring"),
    "outline with SRID": ("put_track('s', 'B', {p}, ST_SetSRID({o}, 4326))", "ZC006", "outline_ring"),
    "outline a line": ("put_track('s', 'B', {p}, 'LINESTRING(0 0,1 1)')", "ZC006", "outline_ring"),
    "outline null": ("put_track('s', 'B', {p}, NULL)", "ZC006", "outline_ring"),
    "growth beyond 89.5 in rhumb": (
        f"put_track('s', 'B', {HIGH}, {{o}}, p_grow_mps => 60)",
        "ZC005", "haven_in_plane",
    ),
    "outlines beyond 89.5 in rhumb": (
        f"put_track('s', 'B', {HIGH}, {{o}}, p_outlines => ST_Collect({{o}}, rectangle_outline(170000, 0, 1, 1)))",
        "ZC005", "haven_in_plane",
    ),
    "outlines of different counts": (
        "put_track('s', 'B', {p}, {o}, p_outlines => ST_Collect({o}, 'POLYGON((0 0,1 0,0 1,0 0))'))",
        "ZC006", "outlines_alike",
    ),
    "outlines that do not begin with the outline": (
        "put_track('s', 'B', {p}, rectangle_outline(1, 1, 1, 1), p_outlines => ST_Collect({o}, {o}))",
        "ZC006", "outline_is_first",
    ),
    "outlines with a hole": (
        "put_track('s', 'B', {p}, NULL, p_outlines => ST_Collect({o}, 'POLYGON((0 0,9 0,9 9,0 0),(5 1,6 1,6 2,5 1))'))",
        "ZC006", "outline_ring",
    ),
    "outlines NaN": (
        "put_track('s', 'B', {p}, NULL, p_outlines => 'MULTIPOLYGON(((0 0,9 0,9 9,0 0)),((0 0,NaN 0,9 9,0 0)))')",
        "ZC006", "outline_ring",
    ),
    "outlines not convex on the way, narrower than an atom": (
        ("put_track('s', 'B', {p}, NULL, p_outlines => ST_Scale("
        "'MULTIPOLYGON(((0 0,9 0,9 9,0 9,0 0)),((0 0,0 9,9 9,9 0,0 0)))', 1e-14, 1e-14))"),
        "ZC006", "outlines_stay_convex",
    ),
    "outlines a polygon": ("put_track('s', 'B', {p}, {o}, p_outlines => {o})", "ZC006", "outlines_multipolygon"),
    "key of an area": ("put_track('s', 'X', {p}, {o})", "ZC007", "object_key_unique"),
    "a fraction of a second that Unix seconds lose": (
        "track_path('LINESTRING(3 57,4 57)', array_fill('2900-01-01 00:00:00.000001Z'::timestamptz, ARRAY[2]))",
        "ZC003", "path_time_kept",
    ),
    "times not one per waypoint": (
        "track_path('SRID=4326;LINESTRING(3 57,4 57)', ARRAY[now()])", "ZC002", "path_time_per_waypoint",
    ),
    # scenes
    "blank scene name": ("create_scene('  ')", "ZC008", "scene_name_valid"),
    "null scene name": ("create_scene(NULL)", "ZC008", "scene_name_valid"),
    "unknown motion": ("create_scene('t', p_motion => 'crow')", "ZC009", "scene_motion_known"),
    "unknown earth": ("create_scene('t', p_earth => 'flat')", "ZC009", "scene_earth_known"),
    "unknown method": ("create_scene('t', p_method => 'guess')", "ZC009", "scene_method_known"),
    "negative tolerance": ("create_scene('t', p_tolerance_m => -1)", "ZC009", "scene_tolerance_finite"),
    "separation beyond the earth": ("create_scene('t', p_separation_m => 3e7)", "ZC009", "scene_separation_on_earth"),
    "nearest beyond the earth": ("create_scene('t', p_nearest_m => 1e8)", "ZC009", "scene_nearest_on_earth"),
    "tolerance beyond the earth": ("create_scene('t', p_tolerance_m => 1e308)", "ZC009", "scene_tolerance_on_earth"),
    "NaN separation": ("create_scene('t', p_separation_m => 'NaN')", "ZC009", "scene_separation_finite"),
    "bad change of a setting": ("create_scene('s', p_tolerance_m => 'infinity')", "ZC009", "scene_tolerance_finite"),
    # queries
    "conflicts of an unknown scene": ("conflicts_at('nowhere', now())", "ZC010", "scene_known"),
    "candidates of an unknown scene": ("candidates('nowhere')", "ZC010", "scene_known"),
    "havens of an unknown scene": ("havens('nowhere', now(), now(), '1 s')", "ZC010", "scene_known"),
    "havens without a beginning": ("havens('s', NULL, now(), '1 s')", "ZC003", "havens_span"),
    "havens for ever": ("havens('s', now(), 'infinity', '1 s')", "ZC003", "havens_span"),
    "havens backwards": ("havens('s', '2026-03-02', '2026-03-01', '1 s')", "ZC003", "havens_span"),
    "havens without a step": ("havens('s', now(), now(), NULL)", "ZC003", "havens_step_positive"),
    "havens by steps of nothing": ("havens('s', now(), now(), '0')", "ZC003", "havens_step_positive"),
    "havens by steps back": ("havens('s', now(), now(), '-1 s')", "ZC003", "havens_step_positive"),
    "too many instants": ("havens('s', '1900-01-01', '2200-01-01', '1 us')", "ZC003", "havens_at_most"),
    "steps that return": (
        "havens('s', '2026-01-01', '2026-12-01', '1 month -30 days 1 s')", "ZC003", "havens_at_most",
    ),
    "explanation in an unknown scene": ("explain_conflict('nowhere', 'X', 'T')", "ZC010", "scene_known"),
    "explanation of an unknown object": ("explain_conflict('s', 'X', 'nobody')", "ZC011", "object_known"),
    "explanation of nothing": ("explain_conflict('s', 'X', NULL)", "ZC011", "object_known"),
    "explanation of one object": ("explain_conflict('s', 'X', 'X')", "ZC008", "explained_objects_differ"),
    "haven of an unknown track": ("haven_at('s', 'nobody', now())", "ZC011", "object_known"),
}  # fmt: skip


@pytest.fixture
def scene(rolled_back: Conn) -> Conn:
    rolled_back.execute("SELECT create_scene('s')")
    rolled_back.execute(f"SELECT put_area('s', 'X', {SQUARE})")
    rolled_back.execute(f"SELECT put_track('s', 'T', {PATH}, {OUTLINE})")
    return rolled_back


@pytest.mark.parametrize("case", BAD)
def test_bad_row_is_refused(scene: Conn, case: str) -> None:
    call, sqlstate, constraint = BAD[case]
    with pytest.raises(psycopg.Error) as refused:
        scene.execute(f"SELECT * FROM {call.format(p=PATH, o=OUTLINE)}".encode())
    assert (refused.value.sqlstate, refused.value.diag.constraint_name) == (sqlstate, constraint)
    assert refused.value.diag.table_name
    assert refused.value.diag.message_detail is None  # the message says it all
    assert refused.value.diag.column_name


def test_usual_rows_pass_and_fail_as_row_by_row(scene: Conn) -> None:
    """The one expression that accepts usual rows accepts none that the checks one by one refuse.

    A limit of the database that limits nothing leaves all rows to the checks one by one.
    """
    rng = np.random.default_rng(3)
    things = [throw(rng, f"H{i}") for i in range(400)]
    outcomes: list[list[Any]] = []
    for limit in ("", "1000000"):
        for name, value in (("max_speed_kn", "infinity"), ("max_vertices", limit), ("max_waypoints", limit)):
            scene.execute("SELECT set_config(%s, %s, true)", [f"conflictdb.{name}", value])
        outcomes.append([outcome(scene, *put("s", thing)) for thing in things])
    assert outcomes[0] == outcomes[1]
    assert 40 < outcomes[0].count(None) < 360


def outcome(conn: Conn, statement: str, values: list[Any]) -> tuple[str | None, str | None] | None:
    """How a row is refused, None if it is not; it is not kept."""
    try:
        with conn.transaction():
            conn.execute(statement.encode(), values)
            raise psycopg.Rollback
    except psycopg.Error as refused:
        return refused.sqlstate, refused.diag.message_primary
    return None


@pytest.mark.parametrize(
    ("call", "column", "message"),
    [
        (
            "put_area('s', 'A1', 'SRID=4326;POLYGON((0 0,1 1,1 0,0 1,0 0))')",
            "footprint",
            "area 'A1': footprint: must be a valid polygon: Self-intersection[0.5 0.5]",
        ),
        (
            "put_track('s', 'T1', 'SRID=4326;LINESTRING M(3 57 1,3 57 2,4 57 2)', {o})",
            "path",
            "track 'T1': path: times[2] is at two places at the same time",
        ),
        (
            f"put_area('nowhere', 'A', {SQUARE})",
            "name",
            "scene 'nowhere': name: is not in this database; known: 's'",
        ),
    ],
)
def test_refusal_says_which_object_which_field_and_which_rule(
    scene: Conn, call: str, column: str, message: str
) -> None:
    with pytest.raises(psycopg.Error) as refused:
        scene.execute(f"SELECT {call.format(o=OUTLINE)}".encode())
    assert refused.value.diag.column_name == column
    assert refused.value.diag.message_primary == message


def test_properties_may_be_as_deep_and_large_as_files_hold(scene: Conn) -> None:
    for given in (NESTED.format(100), "jsonb_build_object('x', 1.7976931348623157e308)"):
        scene.execute(f"SELECT put_area('s', 'B', {SQUARE}, p_properties => {given})".encode())


def test_direct_insert_update_and_copy_are_refused_like_the_functions(scene: Conn) -> None:
    """The rules are the tables', not the functions'."""
    statements = [
        "INSERT INTO area (scene_id, key, footprint) SELECT scene_id, 'B', 'SRID=4326;MULTIPOLYGON EMPTY' FROM scene",
        "UPDATE area SET ceiling_m = -5, floor_m = 5",
        "UPDATE track SET path = 'SRID=4326;LINESTRING M(3 57 2000,4 57 1000)'",
        "UPDATE scene SET tolerance_m = NULL",
    ]
    for statement, state in zip(statements, ["ZC001", "ZC004", "ZC002", "ZC009"], strict=True):
        with pytest.raises(psycopg.Error) as refused, scene.transaction():
            scene.execute(statement.encode())
        assert refused.value.sqlstate == state
    row = scene.execute("SELECT scene_id FROM scene").fetchone()
    assert row is not None
    with (
        pytest.raises(psycopg.Error) as refused,
        scene.transaction(),
        scene.cursor().copy("COPY area (scene_id, key, footprint) FROM STDIN") as copy,
    ):
        copy.write_row((row[0], "C", "SRID=4326;MULTIPOLYGON(((0 0,1 1,1 0,0 1,0 0)))"))
    assert refused.value.sqlstate == "ZC001"


def test_constraints_hold_where_triggers_are_off(scene: Conn) -> None:
    """A restore or replication may run without triggers: the plain rules are constraints as well."""
    for table in ("scene", "area", "track"):
        scene.execute(f"ALTER TABLE {table} DISABLE TRIGGER USER".encode())
    for statement, constraint in {
        "UPDATE area SET floor_m = 5, ceiling_m = 5": "area_ceiling_above_floor",
        "UPDATE area SET floor_m = 'NaN'": "area_heights_finite",
        "UPDATE area SET active_span = 'empty'": "area_span_not_empty",
        "UPDATE area SET key = ''": "area_key_valid",
        "UPDATE track SET ceiling_m = '-infinity'": "track_heights_finite",
        "UPDATE track SET properties = '1'": "track_properties_object",
        "UPDATE track SET grow_mps = 'NaN'": "track_growth_in_range",
        "UPDATE track SET grow_mps = 1, outlines = 'MULTIPOLYGON EMPTY'": "track_growth_given_once",
        "UPDATE scene SET earth = 'flat'": "scene_earth_known",
        "UPDATE scene SET separation_m = 'NaN'": "scene_separation_finite",
    }.items():
        with pytest.raises(psycopg.errors.CheckViolation) as refused, scene.transaction():
            scene.execute(statement.encode())
        assert refused.value.diag.constraint_name == constraint


@pytest.mark.parametrize(
    ("given", "stored"),
    [
        ("[2026-01-01 00:00+00,2026-01-02 00:00+00]", "[2026-01-01 00:00+00,2026-01-02 00:00:00.000001+00)"),
        ("(2026-01-01 00:00+00,2026-01-02 00:00+00)", "[2026-01-01 00:00:00.000001+00,2026-01-02 00:00+00)"),
        ("[-infinity,infinity]", "(,)"),
        ("(,2026-01-02 00:00+00)", "(,2026-01-02 00:00+00)"),
        ("[2026-01-02 00:00+00,2026-01-02 00:00+00]", "[2026-01-02 00:00+00,2026-01-02 00:00:00.000001+00)"),
    ],
)
def test_span_is_stored_half_open_and_holds_the_same_instants(scene: Conn, given: str, stored: str) -> None:
    scene.execute(f"SELECT put_area('s', 'X', {SQUARE}, '{given}')".encode())
    assert scene.execute("SELECT active_span = %s::tstzrange FROM area", [stored]).fetchone() == (True,)


NEXT_DAY = "2026-01-02 00:00+00"
SPANS = [
    ("half_open", f"[2026-01-01 00:00+00,{NEXT_DAY}]", "2026-01-02 00:00:00.000001+00"),
    ("closed", f"[2026-01-01 00:00+00,{NEXT_DAY}]", NEXT_DAY),
    ("half_open", "[2026-01-01 00:00+00,2026-01-01 00:00+00]", "2026-01-01 00:00:00.000001+00"),
    ("closed", "[2026-01-01 00:00+00,2026-01-01 00:00+00]", "2026-01-01 00:00:00.000001+00"),
]
ZONE = f"scene_id, 'A', ST_Multi({SQUARE})"
WAYS = {
    "put": f"SELECT put_area('s', 'A', {SQUARE}, %(span)s)",
    "activations": f"SELECT put_area('s', 'A', {SQUARE}, p_activations => ('{{' || %(span)s || '}}')::tstzmultirange)",
    "insert": f"INSERT INTO area (scene_id, key, footprint, active_span) SELECT {ZONE}, %(span)s FROM scene",
    "update": f"INSERT INTO area (scene_id, key, footprint) SELECT {ZONE} FROM scene; "
    "UPDATE area SET active_span = %(span)s",
    "admit": f"SELECT admit('s', jsonb_build_array(jsonb_build_object('key', 'A', 'footprint', ST_AsText({SQUARE}), "
    "'active_span', %(span)s)))",
    "attach": f"CREATE TABLE public.zone AS SELECT 'A'::text AS id, {SQUARE} AS geom, %(span)s::tstzrange AS span; "
    "ALTER TABLE public.zone ADD PRIMARY KEY (id); SELECT attach('s', 'area', 'public.zone', "
    """'{"key": "id", "footprint": "geom", "span": "span"}')""",
    "probe": f"SELECT request_probe('s', {SQUARE}, %(span)s)",
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("intervals", "span", "end"), SPANS)
def test_an_inclusive_end_adds_no_microsecond_where_intervals_are_closed(
    conn: Conn, way: str, intervals: str, span: str, end: str
) -> None:
    """There [start, end) contains its end; an instant still lasts a microsecond, as a span is never empty."""
    conn.execute("SET search_path = conflictdb, conflictdb_internal, public")
    conn.execute("SELECT create_scene('s', p_intervals => %s)", [intervals])
    for statement in WAYS[way].split("; "):
        psycopg.ClientCursor(conn).execute(statement.encode(), {"span": span} if "%(" in statement else None)
    if way == "attach":
        conn.commit()
        connect(conn).scene("s").detect()
    ends = "upper(active_span) = %s, upper_inc(active_span) FROM area"
    if way == "probe":
        ends = "(plans #>> '{features,0,properties,end}')::timestamptz = %s, false FROM probe_request"
    found = conn.execute(f"SELECT {ends}".encode(), [end])
    assert found.fetchall() == [(True, False)]
    conn.execute("DROP TABLE IF EXISTS public.zone")


@pytest.mark.parametrize(
    ("plan", "rule", "hint"),
    [
        ({}, "plan 'T': times: is missing: a path without M needs a time for each waypoint", 'Give "times": \\["2026'),
        ({"times": None}, "plan 'T': times: is missing", "or a LineStringM whose M is Unix seconds"),
    ],
)
@pytest.mark.parametrize(
    "path",
    ["LINESTRING(5 50,6 50)", "LINESTRING Z(5 50 0,6 50 0)", {"type": "LineString", "coordinates": [[5, 50], [6, 50]]}],
)
def test_a_plan_without_times_is_told_to_give_them(scene: Conn, path: Any, plan: Any, rule: str, hint: str) -> None:
    given = {"key": "T", "path": path, "outline": "POLYGON((0 0,1 0,1 1,0 0))"} | plan
    with pytest.raises(psycopg.Error, match=rule) as refused:
        scene.execute("SELECT admit('s', %s, p_replace => '{T}')", [json.dumps([given])])
    assert refused.value.sqlstate == "ZC002"
    assert re.search(hint, refused.value.diag.message_hint or "")


@pytest.mark.parametrize(
    "outline",
    [
        "POLYGON((0 0,0 0,0 0,0 0))",  # a point
        "POLYGON((0 0,5 5,5 5,0 0))",  # a line
        "POLYGON((0 0,10 0,10 0,10 10,0 10,0 0))",  # a vertex twice
        "POLYGON((0 0,5 0,10 0,10 10,0 10,0 0))",  # collinear
        "POLYGON((0 0,0 10,10 10,10 0,0 0))",  # clockwise
        "POLYGON((0 0,1000000 0,1000000 0.000000001,0 0))",  # a sliver
        "POLYGON((0 0,0.1 0.3,0.2 0.6,0.3 0.9,0 1,0 0))",  # collinear up to rounding
    ],
)
def test_convex_outline_is_accepted(scene: Conn, outline: str) -> None:
    scene.execute(f"SELECT put_track('s', 'T', {PATH}, %s)".encode(), [outline])
    assert scene.execute("SELECT outline = %s::geometry FROM track", [outline]).fetchone() == (True,)


def test_track_may_run_along_the_limit(scene: Conn) -> None:
    """Latitude 89 belongs to the plane; a haven that points away from the pole does not count against it."""
    path = "SRID=4326;LINESTRING M(5 89 0,5 88 3600)"
    scene.execute("SELECT put_track('s', 'T', %s, rectangle_outline(80000, 0, 10, 10))", [path])


def test_duplicate_keys_of_two_writers_at_once_cannot_both_be_put(conn: Conn, dsn: str) -> None:
    """One puts an area, the other a track with the same key: whoever commits second is refused."""
    conn.execute("SET search_path = conflictdb, conflictdb_internal, public")
    conn.execute("SELECT create_scene('s')")
    conn.commit()
    conn.execute(f"SELECT put_area('s', 'K', {SQUARE})")
    with psycopg.connect(dsn) as other:
        other.execute("SET search_path = conflictdb, conflictdb_internal, public")
        other.execute("SET lock_timeout = '200ms'")
        other.commit()
        with pytest.raises(psycopg.errors.LockNotAvailable):
            other.execute(f"SELECT put_track('s', 'K', {PATH}, {OUTLINE})")
        other.rollback()
        conn.commit()
        with pytest.raises(psycopg.Error) as refused:
            other.execute(f"SELECT put_track('s', 'K', {PATH}, {OUTLINE})")
        assert refused.value.sqlstate == "ZC007"


@pytest.mark.parametrize(
    ("statement", "most"),
    [
        ("SELECT put_area('nowhere', 'A', {square})", 4),
        ("SELECT * FROM conflicts_of('nowhere', 'A')", 3),
        ("SELECT acknowledge('s', 'A', 'B', 'seen')", 3),
        ("SELECT attach('s', 'area', 'pg_class', '{{}}')", 7),  # reattach shares the checks
    ],
)
def test_the_context_of_a_refusal_is_short_and_without_its_source(scene: Conn, statement: str, most: int) -> None:
    """psql shows it: PL/pgSQL adds a line for each routine; the statement that raises adds none."""
    with pytest.raises(psycopg.Error) as refused:
        scene.execute(statement.format(square=SQUARE).encode())
    lines = (refused.value.diag.context or "").splitlines()
    assert 0 < len(lines) <= most
    assert "_raise('" not in "".join(lines)
