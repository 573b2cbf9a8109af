"""Scenes go in and come out unchanged, set by set; unchanged rows are not touched."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
import shapely
from full_plans import lost
from psycopg.rows import dict_row

from conflictdb import store
from conflictdb.errors import InvalidInput, StoreError
from conflictdb.jobs.detect import detect
from conflictdb.model.methods import Method
from conflictdb.model.plans import Area, EarthModel, Scene, Track, rectangle_outline_m

Conn = psycopg.Connection[Any]

SQUARE = shapely.MultiPolygon([shapely.box(4, 57, 5, 58)])
ODD = shapely.MultiPolygon(
    [
        shapely.Polygon([(179, 0), (181, 0), (181, 2), (179, 2)], [[(179.5, 0.5), (180.5, 0.5), (180, 1.5)]]),
        shapely.Polygon([(-0.1, 1 / 3), (0.1, 1 / 3), (0.0, 2 / 3)]),
    ]
)
T0_US = 1_772_323_200_000_000
SCENE = Scene("s", earth=EarthModel.SPHERE, method=Method.SCREEN, tolerance_m=0.1, separation_m=1852.0)

AREAS = [
    Area("plain", SQUARE),
    Area(
        "æøå \U0001f6a2 'quoted' \"\\",
        ODD,
        "name\twith\nbreaks",
        T0_US,
        T0_US + 1,
        -0.1,
        1e5,
        {"b": [1, 2.5, None], "a": "ü"},
    ),
    Area("from", SQUARE, "", T0_US + 123_456, None, 0.0, None, {}),
    Area("until", SQUARE, None, None, -62_135_596_800_000_000 + 1, None, 0.0),
    Area("latest", SQUARE, None, 253_402_300_799_999_998, 253_402_300_799_999_999),
]

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def track(key: str, times_us: list[int], outline: Any = None, **more: Any) -> Track:
    positions = np.array([[170.0 + 7 * i, -33.3 + i / 3] for i in range(len(times_us))])
    outline = rectangle_outline_m(100.5, 20, 3, 4) if outline is None else np.array(outline, dtype=np.float64)
    return Track(key, positions, np.array(times_us, dtype=np.int64), outline, **more, max_speed_kn=np.inf)


TRACKS = [
    track("T plain", [T0_US, T0_US + 1, T0_US + 3_600_000_001]),
    track("T point", [T0_US, T0_US + 5], [[0, 0]], name="point", floor_m=-1.5),
    track("T line", [-1, 0, 1], [[1, 2], [3, -4.25]], ceiling_m=3.0, properties={"class": {"x": [True]}}),
    track("T many", [-8_500_000_000_000_001, 8_589_934_591_999_999], [[0, 9], [8, 4], [6, -5], [-3, -7], [-9, 1]]),
    track("T grows", [T0_US, T0_US + 7], grow_mps=1 / 3),
    track(
        "T climbs", [T0_US, T0_US + 5, T0_US + 9], floors_m=np.array([0.1, 1 / 3]), ceilings_m=np.array([0.2, np.inf])
    ),
    track("T dives", [T0_US, T0_US + 5, T0_US + 9], floors_m=np.array([-np.inf, -30.0]), ceiling_m=5.0),
    track("T growing point", [T0_US, T0_US + 7], [[0, 0]], grow_mps=0.25),
    *(
        track(f"T changes {m}", [T0_US, T0_US + 5, T0_US + 9], rings[0], outlines_m=np.array(rings))
        for m, rings in {
            "point": [[[0.0, 0]], [[1, 2]], [[0.1, 0]]],
            "line": [[[1.0, 1], [1, 1]], [[1, 2], [3, 4]], [[0.1, 0], [0, 0]]],
            "triangle": [[[0.0, 0], [1, 1], [1, 1]], [[0, 0], [1, 0], [0, 1]], [[7, 7], [7, 7], [7, 7]]],
            "square": [[[5.0, 5]] * 4, [[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 0], [1, 0], [1, 1 / 3], [0, 1]]],
        }.items()
    ),
    track("T old", [-62_135_596_800_000_000, 253_402_300_799_000_000]),
]


def versions(conn: Conn) -> list[tuple[str, int]]:
    return conn.execute(
        "SELECT key, version FROM conflictdb.area UNION ALL SELECT key, version FROM conflictdb.track ORDER BY 1"
    ).fetchall()


def test_scene_comes_back_as_it_was_loaded(conn: Conn) -> None:
    assert store.replace_scene(conn, SCENE, AREAS, TRACKS, merge=False) == store.LoadCounts(18, 0, 0, 0)
    scene, areas, tracks = store.read_scene(conn, "s")
    assert scene == SCENE
    assert areas == AREAS
    assert [shapely.to_wkb(a.footprint) for a in areas] == [shapely.to_wkb(a.footprint) for a in AREAS]
    for found, wanted in zip(tracks, TRACKS, strict=True):
        assert lost(found, wanted) == []


def test_a_haven_whose_area_is_hardly_a_number_is_stored(conn: Conn) -> None:
    """Part of its area underflows: PostgreSQL raises an error for that, and refused the whole load."""
    corner = 5e-161
    outline_m = np.array([[corner, corner], [corner, 0.0], [0.0, 0.0], [0.0, corner]])
    tiny = replace(TRACKS[0], outline_m=outline_m, max_speed_kn=np.inf)
    outlines_m = np.stack([outline_m] * len(tiny.positions_deg))
    growing = replace(tiny, key="growing", outlines_m=outlines_m, max_speed_kn=np.inf)
    store.replace_scene(conn, SCENE, [], [tiny, growing], merge=False)
    for found, wanted in zip(store.read_scene(conn, "s")[2], (tiny, growing), strict=True):
        assert lost(found, wanted) == []


def test_loading_commits_and_leaves_no_transaction_open(conn: Conn, dsn: str) -> None:
    store.replace_scene(conn, SCENE, AREAS, TRACKS, merge=False)
    assert conn.info.transaction_status == psycopg.pq.TransactionStatus.IDLE
    with store.connect(dsn) as other:
        assert [s.areas for s in store.list_scenes(other)] == [5]
        assert other.info.transaction_status == psycopg.pq.TransactionStatus.IDLE


def test_loading_in_the_callers_transaction_is_the_callers_to_commit(conn: Conn) -> None:
    conn.execute("SELECT 1")
    store.replace_scene(conn, SCENE, AREAS, [], merge=False)
    store.replace_scene(conn, SCENE, AREAS[:1], [], merge=False)
    conn.rollback()
    assert store.list_scenes(conn) == []


def test_callers_connection_may_have_other_rows_and_autocommit(dsn: str) -> None:
    with psycopg.connect(dsn, autocommit=True, row_factory=dict_row) as conn:
        assert store.replace_scene(conn, SCENE, AREAS, TRACKS, merge=False).added == 18
        assert len(store.read_scene(conn, "s")[1]) == 5
        assert store.conflicts(conn, "s") == []


def test_loading_again_touches_nothing(conn: Conn) -> None:
    store.replace_scene(conn, SCENE, AREAS, TRACKS, merge=False)
    before = versions(conn)
    conn.execute("DELETE FROM conflictdb.change")
    conn.commit()
    assert store.replace_scene(conn, SCENE, AREAS[::-1], TRACKS, merge=False) == store.LoadCounts(0, 0, 0, 18)
    assert versions(conn) == before
    assert store.list_scenes(conn)[0].pending == 0


def test_loading_touches_only_what_differs(conn: Conn) -> None:
    store.replace_scene(conn, SCENE, AREAS, TRACKS, merge=False)
    conn.execute("DELETE FROM conflictdb.change")
    conn.commit()
    areas = [replace(AREAS[0], floor_m=5.0), replace(AREAS[1], name="other"), *AREAS[2:4]]
    later = replace(TRACKS[0], times_us=TRACKS[0].times_us + np.array([0, 0, 1]), max_speed_kn=np.inf)
    tracks = [later, *TRACKS[1:], track("new", [1, 2])]
    assert store.replace_scene(conn, SCENE, areas, tracks, merge=False) == store.LoadCounts(1, 3, 1, 14)
    assert store.list_scenes(conn)[0].pending == 4  # not the one whose name changed
    assert lost(store.read_scene(conn, "s")[2][0], later) == []


def test_merge_adds_and_updates_but_removes_nothing(conn: Conn) -> None:
    store.replace_scene(conn, SCENE, AREAS, TRACKS[:1], merge=False)
    areas = [replace(AREAS[0], ceiling_m=1.0), Area("new", SQUARE)]
    assert store.replace_scene(conn, SCENE, areas, [], merge=True) == store.LoadCounts(1, 1, 0, 0)
    assert len(store.read_scene(conn, "s")[1]) == 6


@pytest.mark.parametrize("merge", [False, True])
def test_key_may_pass_from_an_area_to_a_track(conn: Conn, merge: bool) -> None:
    store.replace_scene(conn, SCENE, [Area("X", SQUARE), Area("Y", SQUARE)], [], merge=False)
    counts = store.replace_scene(conn, SCENE, [Area("Y", SQUARE)], [track("X", [1, 2])], merge=merge)
    assert counts == store.LoadCounts(1, 0, 1, 1)
    _, areas, tracks = store.read_scene(conn, "s")
    assert ([a.key for a in areas], [t.key for t in tracks]) == (["Y"], ["X"])


def test_empty_scene_is_a_scene(conn: Conn) -> None:
    assert store.replace_scene(conn, SCENE, [], [], merge=False) == store.LoadCounts(0, 0, 0, 0)
    assert store.read_scene(conn, "s") == (SCENE, [], [])


def test_settings_alone(conn: Conn) -> None:
    key = store.set_scene(conn, SCENE)
    assert store.set_scene(conn, replace(SCENE, tolerance_m=0.0)) == key
    assert store.scene_settings(conn, "s") == replace(SCENE, tolerance_m=0.0)
    assert store.scene_settings(conn, "t") is None
    assert store.scene_id(conn, "s") == key


def test_unknown_scene_is_refused_naming_the_known_ones(conn: Conn) -> None:
    store.set_scene(conn, SCENE)
    store.set_scene(conn, Scene("harbour"))
    with pytest.raises(InvalidInput, match=r"'nowhere'.*known: 'harbour', 's'") as refused:
        store.scene_id(conn, "nowhere")
    assert (refused.value.key, refused.value.field) == ("scene 'nowhere'", "name")
    assert conn.info.transaction_status == psycopg.pq.TransactionStatus.IDLE


@pytest.mark.parametrize(
    ("areas", "tracks", "message"),
    [
        ([Area("twice", SQUARE), Area("twice", SQUARE)], [], "object 'twice': key: is given twice"),
        ([Area("both", SQUARE)], [track("both", [1, 2])], "object 'both': key: is given twice"),
        ([Area("nul\0", SQUARE)], [], "U\\+0000"),
        ([Area("half \ud83d", SQUARE)], [], "Unicode"),
        ([Area("x" * 1001, SQUARE)], [], "1 to 1000 bytes"),
        ([Area("A", SQUARE, "\0")], [], "area 'A': name"),
        ([Area("A", SQUARE, properties={"x": ["\0"]})], [], "area 'A': properties"),
        ([Area("A", SQUARE, properties={"x": float("nan")})], [], "area 'A': properties: must be JSON"),
        ([], [track("T", [0, 8_589_934_592_000_001])], r"track 'T': times\[1\]: cannot be kept"),
    ],
)
def test_what_cannot_be_stored_is_refused_and_nothing_changes(
    conn: Conn, areas: list[Area], tracks: list[Track], message: str
) -> None:
    store.replace_scene(conn, SCENE, AREAS[:1], TRACKS[:1], merge=False)
    with pytest.raises(InvalidInput, match=message):
        store.replace_scene(conn, SCENE, [Area("good", SQUARE), *areas], tracks, merge=False)
    scene, kept, rest = store.read_scene(conn, "s")
    assert (scene, kept, len(rest)) == (SCENE, AREAS[:1], 1)


def test_times_are_kept_to_the_microsecond_or_refused(conn: Conn) -> None:
    """Both ways in refuse the same ones, next to 2^32 and to 2^33 seconds; others come back as they were."""
    ask = "SELECT conflictdb.track_path('LINESTRING(4 57, 4.1 57)', %s::timestamptz[])"
    kept = 0
    near = np.concatenate([2**32 * 1_000_000 + 7_777 * np.arange(-6, 18), 2**33 * 1_000_000 - np.arange(3)])
    for at_us in near.tolist():
        for one in (track("T", [sign * at_us, sign * at_us + 600_000_000]) for sign in (-1, 1)):
            try:
                store.replace_scene(conn, SCENE, [], [one], merge=False)
            except InvalidInput:
                with pytest.raises(psycopg.Error, match="before November 1833") as refused, conn.transaction():
                    conn.execute(ask, [[EPOCH + timedelta(microseconds=at) for at in one.times_us.tolist()]])
                assert refused.value.sqlstate == "ZC003"
                continue
            kept += 1
            assert lost(store.read_scene(conn, "s")[2][0], one) == []
            conn.execute(ask, [[EPOCH + timedelta(microseconds=at) for at in one.times_us.tolist()]])
    assert 20 < kept < 53


def test_backslash_u0000_as_text_is_not_a_null_character(conn: Conn) -> None:
    area = Area("A", SQUARE, properties={"path": "C:\\u0000"})
    store.replace_scene(conn, SCENE, [area], [], merge=False)
    assert store.read_scene(conn, "s")[1] == [area]


def test_other_errors_of_the_database_are_store_errors_with_their_cause(conn: Conn, dsn: str) -> None:
    conn.read_only = True
    with pytest.raises(StoreError, match="takes no changes in this transaction: cannot execute") as failed:
        store.set_scene(conn, SCENE)
    assert isinstance(failed.value.__cause__, psycopg.Error)
    with pytest.raises(StoreError):
        store.connect(dsn.replace("dbname=", "dbname=no_such_"))


@pytest.mark.parametrize("tiny", ["5e-324", "-1e-200", "1e-100", "1e-20"])
@pytest.mark.parametrize("motion", ["rhumb", "great_circle"])
def test_numbers_that_underflow_are_as_good_as_nought(conn: Conn, motion: str, tiny: str) -> None:
    """PostgreSQL refuses products that underflow; but 5e-324 is a place."""
    conn.execute("SELECT conflictdb.create_scene('tiny', %s)", [motion])
    ring = f"ST_MakePoint({tiny}, 1), ST_MakePoint(1, {tiny}), ST_MakePoint(-1, -1), ST_MakePoint({tiny}, 1)"
    ring = f"ST_MakePolygon(ST_MakeLine(ARRAY[{ring}]))"
    path = f"ST_MakePointM({tiny}, -1, 0), ST_MakePointM(0, {tiny}, 3600), ST_MakePointM(1, {tiny}, 7200)"
    conn.execute(f"SELECT conflictdb.put_area('tiny', 'A', ST_SetSRID({ring}, 4326))")
    conn.execute(
        f"SELECT conflictdb.put_track('tiny', 'T', ST_SetSRID(ST_MakeLine(ARRAY[{path}]), 4326), {ring}, "
        f"p_grow_mps => 0.001)"
    )
    conn.commit()
    detect(conn, "tiny")
    query = "SELECT a_key, b_key FROM conflictdb.conflicts WHERE NOT ST_IsEmpty(region)"
    assert conn.execute(query).fetchall() == [("A", "T")]
    for seconds in (0, 1800, 3600, 5400):
        query = "SELECT NOT ST_IsEmpty(conflictdb.haven_at('tiny', 'T', to_timestamp(%s)))"
        assert conn.execute(query, [seconds]).fetchone() == (True,)
