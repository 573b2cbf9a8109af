"""Positions against plans: who is on plan, late, early, off, silent, past the end, or not yet under way."""

import json
import re
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
from commands import Run
from psycopg import sql

from conflictdb import InvalidInput, connect, store
from conflictdb.cli.codes import NOT_CURRENT
from conflictdb.jobs.looks import Looks
from conflictdb.jobs.worker import Worker
from conflictdb.store import LiveTrack

Conn = psycopg.Connection[Any]

# All plans begin half an hour ago and sail 60 nmi east along the equator in an hour: a degree of longitude.
BEGAN = datetime.now(UTC).replace(microsecond=0) - timedelta(minutes=30)
NMI_M = 1852.0
PLAN = """
SELECT conflictdb.put_track(%(scene)s, %(key)s,
    conflictdb.track_path('SRID=4326;LINESTRING(0 0, 1 0)', ARRAY[%(start)s, %(start)s + interval '1 hour']),
    conflictdb.rectangle_outline(%(half)s, %(half)s, 500, 500))
"""
PUT = """
INSERT INTO conflictdb.position (scene, key, instant, place, height_m, error_m)
VALUES (%s, %s, %s, conflictdb_point(%s, %s), %s, %s)
""".replace("conflictdb_point(%s, %s)", "ST_SetSRID(ST_MakePoint(%s, %s), 4326)")


def plan(conn: Conn, key: str, start: datetime = BEGAN, half: float = 1000.0) -> None:
    conn.execute(PLAN, {"scene": "s", "key": key, "start": start, "half": half})


def put(conn: Conn, key: str, minute: float, lon: float, lat: float = 0.0, *, height_m: float | None = None,
        error_m: float = 10.0, began: datetime = BEGAN) -> None:  # fmt: skip
    """Insert a position, some minutes after the plans began."""
    at = began + timedelta(minutes=minute)
    conn.execute(PUT, ["s", key, at, lon, lat, height_m, error_m])


def look(conn: Conn, minute: float = 30.0, looks: Looks | None = None) -> dict[str, LiveTrack]:
    """Look as a worker does, some minutes after the plans began; return the states by key."""
    conn.commit()
    now = BEGAN + timedelta(minutes=minute)
    (looks or Looks()).look(conn, int(now.timestamp() * 1e6), is_silence_due=True)
    with connect(conn) as db:
        return {one.key: one for one in db.scene("s").live()}


@pytest.fixture
def sea(conn: Conn) -> Conn:
    conn.execute("SELECT conflictdb.create_scene('s')")
    return conn


def test_states_of_tracks_with_known_answers(sea: Conn) -> None:
    """At minute 20 the plan is at a third of a degree; a haven of 1 km either way takes 65 s to pass a place."""
    for key in ("on", "late", "early", "off", "high", "past", "waits", "silent", "unheard"):
        plan(sea, key, BEGAN if key != "waits" else BEGAN + timedelta(hours=1))
    put(sea, "on", 20, 1 / 3)
    put(sea, "late", 20, 10 / 60)
    put(sea, "early", 20, 30 / 60)
    put(sea, "off", 20, 1 / 3, 0.1)
    put(sea, "past", 20, 0.4, 0.2)
    put(sea, "waits", 20, 0.0)
    put(sea, "silent", 5, 5 / 60)
    found = look(sea, 29)
    assert {key: one.state for key, one in found.items()} == {
        "on": "on plan", "late": "late", "early": "early", "off": "off", "past": "off", "waits": "not yet under way",
        "silent": "silent",
    }  # fmt: skip
    speed_mps = 60 * NMI_M * 1.0018 / 3600  # a degree of the equator is longer
    reach_s = (1000 + 10) / speed_mps
    late = found["late"]
    assert late.late_from_s == pytest.approx(600 - reach_s, abs=1.0)
    assert late.late_to_s == pytest.approx(600 + reach_s, abs=1.0)
    assert found["early"].late_to_s == pytest.approx(-600 + reach_s, abs=1.0)
    assert found["off"].off_m == pytest.approx(0.1 * 110_574 - 500 - 10, rel=0.01)
    assert found["off"].late_from_s is None
    # 24 minutes without a word: it may have stopped, and is no faster than its plan.
    silent = found["silent"]
    assert silent.late_to_s == pytest.approx(reach_s + 24 * 60, abs=1.0)
    assert silent.late_from_s == pytest.approx(-reach_s, abs=1.0)


def test_a_plan_ends_and_is_not_silent_then(sea: Conn) -> None:
    plan(sea, "arrived", BEGAN - timedelta(hours=1))
    plan(sea, "quiet", BEGAN - timedelta(hours=1))
    put(sea, "arrived", 5, 1.0)
    put(sea, "quiet", -10, 50 / 60)
    found = look(sea)
    assert {one.state for one in found.values()} == {"past its end"}


def test_the_lateness_follows_on_the_former_one(sea: Conn) -> None:
    """A ship that comes back on the same line is where it is at two own times."""
    path = """SELECT conflictdb.put_track('s', 'F', conflictdb.track_path('SRID=4326;LINESTRING(0 0, 0.5 0, 0 0)',
              ARRAY[%(b)s::timestamptz, %(b)s::timestamptz + interval '30 min', %(b)s::timestamptz + interval '1 h']),
              conflictdb.rectangle_outline(500, 500, 500, 500))"""
    sea.execute(path, {"b": BEGAN})
    put(sea, "F", 10, 10 / 60)
    put(sea, "F", 29, 29 / 60)
    assert look(sea)["F"].state == "on plan"
    # Alone, this place is nearer to the plan of the way back.
    sea.execute("UPDATE conflictdb.live_state SET seen_from_s = 0, seen_to_s = 0")
    put(sea, "F", 29.9, 20 / 60)
    assert look(sea)["F"].state == "late"


def test_what_is_older_or_comes_twice_changes_nothing(sea: Conn) -> None:
    plan(sea, "A")
    looks = Looks()
    put(sea, "A", 20, 20 / 60)
    first = look(sea, looks=looks)["A"]
    put(sea, "A", 10, 0.9)
    put(sea, "A", 20, 0.9)
    again = look(sea, looks=looks)["A"]
    assert (again.instant, again.lon_deg, again.state) == (first.instant, first.lon_deg, "on plan")
    sea.execute("UPDATE conflictdb.position_look SET seen = '1:1:'")  # as after a restore
    assert look(sea, looks=looks)["A"] == again


def test_one_session_looks_and_only_workers_can_keep_others_from_it(sea: Conn, dsn: str) -> None:
    """A reader held the lock of looks when it was an advisory one, and there were no more alarms."""
    plan(sea, "A")
    put(sea, "A", 20, 20 / 60)
    may = "SELECT conflictdb_internal._may_look()"
    sea.commit()
    with psycopg.connect(dsn) as other:
        other.execute("SELECT pg_advisory_lock(4711870352216840127)")  # of looks, once
        assert look(sea)["A"].state == "on plan"
        for role in ("conflictdb_reader", "conflictdb_editor", "conflictdb_tracker"):
            other.execute(sql.SQL("SET ROLE {}").format(sql.Identifier(role)))
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                other.execute("SELECT FROM conflictdb.position_look FOR UPDATE")
            other.rollback()
        assert other.execute(may).fetchone() == (True,)
        assert other.execute(may).fetchone() == (True,)
        assert sea.execute(may).fetchone() == (False,)
        sea.commit()
        other.commit()
        assert sea.execute(may).fetchone() == (True,)
    sea.execute("DELETE FROM conflictdb.position_look")  # as in a restored database
    put(sea, "A", 21, 21 / 60)
    assert look(sea)["A"].instant == BEGAN + timedelta(minutes=21)


def test_positions_of_open_transactions_are_not_missed(sea: Conn, dsn: str) -> None:
    """One that began before a look and commits after it is read by the next."""
    plan(sea, "A")
    plan(sea, "B")
    sea.commit()
    with psycopg.connect(dsn) as other:
        put(other, "A", 20, 20 / 60)
        put(sea, "B", 20, 20 / 60)
        assert set(look(sea)) == {"B"}
        put(sea, "B", 21, 21 / 60)
        assert set(look(sea)) == {"B"}
        other.commit()
        assert set(look(sea)) == {"A", "B"}


def test_a_changed_plan_counts_from_the_next_position_on(sea: Conn) -> None:
    plan(sea, "A")
    looks = Looks()
    put(sea, "A", 20, 10 / 60)
    assert look(sea, looks=looks)["A"].state == "late"
    plan(sea, "A", BEGAN + timedelta(minutes=10))
    put(sea, "A", 21, 11 / 60)
    assert look(sea, looks=looks)["A"].state == "on plan"
    sea.execute("SELECT conflictdb.remove_object('s', 'A')")
    assert look(sea, looks=looks) == {}


@pytest.mark.parametrize(
    ("key", "instant", "lon", "lat", "height_m", "error_m", "said"),
    [
        ("X", "now()", 0, 0, None, 10, "position of 'X': key: is not a track of scene 's'"),
        ("X" * 1_000_000, "now()", 0, 0, None, 10, "position: key: is not a track: it has 1000000 bytes"),
        ("A", "now() + interval '1 hour'", 0, 0, None, 10, "instant: must not be in the future"),
        ("A", "'infinity'", 0, 0, None, 10, "instant: must not be in the future"),
        ("A", "now()", float("nan"), 0, None, 10, "place: must have a longitude"),
        ("A", "now()", 0, 89.5, None, 10, "within +-89 degrees; got 0, 89.5"),
        ("A", "now()", 361, 0, None, 10, "within +-360"),
        ("A", "now()", 0, 0, float("nan"), 10, "height_m: must be a finite number"),
        ("A", "now()", 0, 0, None, float("nan"), "error_m: must be from 0 to 100000 m; got NaN"),
        ("A", "now()", 0, 0, None, -1, "error_m: must be from 0"),
    ],
)
def test_bad_positions_are_refused_in_one_sentence(
    sea: Conn, key: str, instant: str, lon: float, lat: float, height_m: float | None, error_m: float, said: str
) -> None:
    plan(sea, "A")
    sea.commit()
    with pytest.raises(psycopg.Error) as refused:
        sea.execute(f"""INSERT INTO conflictdb.position (scene, key, instant, place, height_m, error_m)
                        SELECT 's', 'A', now(), 'SRID=4326;POINT(0 0)', NULL::float8, 10
                        UNION ALL SELECT 's', %s, {instant}, ST_SetSRID(ST_MakePoint(%s, %s), 4326), %s::float8, %s
                     """.encode(), [key, lon, lat, height_m, error_m])  # fmt: skip
    sea.rollback()
    assert said in str(refused.value.diag.message_primary)
    assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (0,)


def test_jumps_and_other_latitudes(sea: Conn) -> None:
    """A position on the other side of the earth is off, and the next one is as good as ever; also at +-180."""
    sea.execute(
        """SELECT conflictdb.put_track('s', 'A', conflictdb.track_path('SRID=4326;LINESTRING(179.5 80, -179.5 80)',
           ARRAY[%(b)s::timestamptz, %(b)s::timestamptz + interval '1 hour']),
           conflictdb.rectangle_outline(200, 200, 200, 200))""",
        {"b": BEGAN},
    )
    looks = Looks()
    for minute, lon, state in ((10, 179.5 + 1 / 6, "on plan"), (11, 0.0, "off"), (45, -179.75, "on plan")):
        put(sea, "A", min(minute, 30), lon) if lon == 0.0 else put(sea, "A", min(minute, 30), lon, 80.0)
        assert look(sea, min(minute, 30), looks)["A"].state == (state if minute <= 30 else "early")


@pytest.mark.parametrize(("place", "off_km"), [((180.0, -60.0), 19_960), ((0.0, -31.0), 10_062), ((0.0, -20.0), 8_840)])
def test_a_position_outside_the_map_is_off(sea: Conn, place: tuple[float, float], off_km: float) -> None:
    """The map of great circles ends 60 degrees from its centre."""
    sea.execute("SELECT conflictdb.remove_scene('s')")
    sea.execute("SELECT conflictdb.create_scene('s', p_motion => 'great_circle')")
    path = PLAN.replace("0 0, 1 0", "0 60, 1 60")
    sea.execute(path, {"scene": "s", "key": "A", "start": BEGAN, "half": 1000.0})
    put(sea, "A", 20, *place, error_m=1000.0)
    found = look(sea)["A"]
    assert found.state == "off"
    assert found.off_m == pytest.approx(off_km * 1000.0, rel=0.03)
    alarms = sea.execute("SELECT key, other_key, verdict, reason FROM conflictdb.live_conflicts").fetchall()
    assert alarms == [("A", None, "may", "off its plan: it may be anywhere that it can reach")]


def test_trackers_insert_positions_and_nothing_else(sea: Conn, dsn: str) -> None:
    plan(sea, "A")
    user = f"feed_{sea.info.dbname}"
    name = sql.Identifier(user)
    sea.execute(sql.SQL("CREATE ROLE {} LOGIN IN ROLE conflictdb_tracker").format(name))
    sea.execute("SELECT conflictdb.create_scene('t')")
    sea.commit()
    try:
        sea.execute(sql.SQL("SET ROLE {}").format(name))
        put(sea, "A", 20, 20 / 60)
        with (
            sea.cursor() as cursor,
            cursor.copy("COPY conflictdb.position (scene, key, instant, place) FROM STDIN") as to,
        ):
            to.write_row(["s", "A", BEGAN, "SRID=4326;POINT(0 0)"])
        for statement in (
            "SELECT * FROM conflictdb.position",
            "SELECT * FROM conflictdb.live",
            "SELECT * FROM conflictdb.track",
            "SELECT * FROM conflictdb.scene",
            "DELETE FROM conflictdb.position",
            "UPDATE conflictdb.position SET key = 'A'",
            "TRUNCATE conflictdb.position",
            "INSERT INTO conflictdb.position (scene, key, instant, place, scene_id) VALUES ('s', 'A', now(), NULL, 1)",
            "SELECT conflictdb.create_scene('new')",
        ):
            with pytest.raises(psycopg.errors.InsufficientPrivilege), sea.transaction():
                sea.execute(statement.encode())
        sea.execute("RESET ROLE")
        sea.execute("SELECT conflictdb.protect_scenes()")
        sea.execute(sql.SQL("SELECT conflictdb.share_scene('t', {}, 'write')").format(sql.Literal(user)))
        sea.execute(sql.SQL("SET ROLE {}").format(name))
        # Neither of a scene of others, nor of one that there is not: the same answer.
        for scene in ("s", "none"):
            with pytest.raises(psycopg.errors.InsufficientPrivilege, match="row-level security"), sea.transaction():
                sea.execute(PUT, [scene, "A", BEGAN, 0, 0, None, 10])
        with pytest.raises(psycopg.Error, match="is not a track of scene 't'"), sea.transaction():
            sea.execute(PUT, ["t", "A", BEGAN, 0, 0, None, 10])
        # As `load --positions`; COPY is refused under row-level security.
        at_us, place = np.array([int(BEGAN.timestamp() * 1e6)]), np.zeros((1, 2))
        with pytest.raises(InvalidInput, match="is not a track of scene 't'"), sea.transaction():
            store.insert_positions(sea, "t", ["A"], at_us, place)
        sea.execute("RESET ROLE")
        sea.execute(sql.SQL("SELECT conflictdb.share_scene('s', {}, 'write')").format(sql.Literal(user)))
        sea.execute(sql.SQL("SET ROLE {}").format(name))
        store.insert_positions(sea, "s", ["A"], at_us, place)
    finally:
        sea.rollback()
        sea.execute("RESET ROLE")
        sea.execute(sql.SQL("DROP ROLE {}").format(name))
        sea.commit()


def test_fixes_of_another_table_are_passed_on(sea: Conn) -> None:
    """By the trigger of the how-to page, also of a table that is renamed, and by who has no rights in conflictdb."""
    page = Path(__file__).parents[2] / "docs" / "how-to" / "compare-plans-with-positions.md"
    [trigger] = re.findall(r"```sql\n(CREATE TABLE ais_fix .*?)```", page.read_text(), re.DOTALL)
    plan(sea, "A")
    owner, feed = (sql.Identifier(f"{name}_{sea.info.dbname}") for name in ("passes", "feed"))
    try:
        sea.execute(sql.SQL("CREATE ROLE {} IN ROLE conflictdb_reader, conflictdb_tracker").format(owner))
        sea.execute(sql.SQL("CREATE ROLE {}").format(feed))
        sea.execute("SET search_path TO public")
        sea.execute(trigger.replace("'strait'", "'s'").encode())
        sea.execute(sql.SQL("ALTER FUNCTION pass_fixes_on OWNER TO {}").format(owner))
        sea.execute(sql.SQL("GRANT INSERT ON ais_fix TO {}").format(feed))
        sea.execute("ALTER TABLE ais_fix RENAME TO fix_of_ships")
        sea.execute(sql.SQL("SET LOCAL ROLE {}").format(feed))
        rows = [
            ("A", BEGAN, "POINT(0 0)"),
            ("X", BEGAN, "POINT(0 0)"),  # no plan
            ("A", BEGAN + timedelta(days=1), "POINT(0 0)"),
            ("A", BEGAN, "POINT(181 91)"),  # not available, in AIS
            ("A", BEGAN, "POINT(NaN NaN)"),
            ("A", BEGAN, "POINT EMPTY"),
            ("A", BEGAN, None),
            ("A", None, "POINT(0 0)"),
            (None, BEGAN, "POINT(0 0)"),
            ("A", BEGAN + timedelta(minutes=1), "POINT(0.1 0)"),
        ]
        for key, at, place in rows:
            sea.execute("INSERT INTO fix_of_ships VALUES (%s, %s, ST_GeomFromText(%s, 4326))", [key, at, place])
        with sea.cursor() as cursor, cursor.copy("COPY fix_of_ships (mmsi, at, place) FROM STDIN") as to:
            to.write_row(["A", BEGAN + timedelta(minutes=2), "SRID=4326;POINT(0.2 0)"])
            to.write_row(["X", BEGAN + timedelta(minutes=2), "SRID=4326;POINT(0.2 0)"])
        with pytest.raises(psycopg.errors.InsufficientPrivilege), sea.transaction():
            put(sea, "A", 3, 0.3)
        sea.execute("RESET ROLE")
        found = sea.execute("SELECT key, instant FROM conflictdb.position ORDER BY instant").fetchall()
        assert found == [("A", BEGAN + timedelta(minutes=n)) for n in range(3)]
        assert sea.execute("SELECT count(*) FROM fix_of_ships").fetchone() == (12,)
    finally:
        sea.rollback()


def test_old_positions_are_emptied_by_partitions(sea: Conn) -> None:
    plan(sea, "A")
    put(sea, "A", 20, 20 / 60)
    old = """INSERT INTO conflictdb.position (scene, key, instant, place, received_at, slot)
             VALUES ('s', 'A', now(), 'SRID=4326;POINT(0 0)', now() - interval '{}', (SELECT (p.slot + 4) % 8
             FROM conflictdb.position p LIMIT 1))"""
    sea.execute(old.format("23 hours").encode())
    assert sea.execute("SELECT conflictdb_internal._prune_positions()").fetchone() == (0,)
    sea.execute("SET conflictdb.positions_kept = '22 hours'")
    assert sea.execute("SELECT conflictdb_internal._prune_positions()").fetchone() == (1,)
    assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (1,)


def test_positions_go_with_their_scene(sea: Conn) -> None:
    """At once, whoever removes it; those of other scenes stay, and so do those of a scene that is renamed."""
    plan(sea, "A")
    put(sea, "A", 20, 20 / 60)
    sea.execute("SELECT conflictdb.create_scene('other')")
    sea.execute(
        "SELECT conflictdb.put_track('other', 'A', path, outline) FROM conflictdb.track"
        " WHERE scene_id = (SELECT scene_id FROM conflictdb.scene WHERE name = 's')"
    )
    sea.execute(
        "INSERT INTO conflictdb.position (scene, key, instant, place) "
        "VALUES ('other', 'A', now(), 'SRID=4326;POINT(0 0)')"
    )
    sea.execute("UPDATE conflictdb.scene SET name = 'renamed' WHERE name = 's'")
    assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (2,)
    sea.execute("SET LOCAL ROLE conflictdb_editor")
    sea.execute("DELETE FROM conflictdb.scene WHERE name = 'renamed'")
    sea.execute("RESET ROLE")
    assert sea.execute("SELECT scene FROM conflictdb.position").fetchall() == [("other",)]


def test_files_of_positions(sea: Conn, dsn: str, run: Run, tmp_path: Path) -> None:
    """CSV as of AIS, and GPX; a file with a position in the future is refused as a whole."""
    plan(sea, "219000001")
    plan(sea, "F")
    sea.commit()
    at = [f"{BEGAN + timedelta(minutes=minute):%Y-%m-%dT%H:%M:%SZ}" for minute in (20, 21)]
    ais = tmp_path / "ais.csv"
    ais.write_text(
        f"mmsi,BaseDateTime,lat,lon\n219000001,{at[0]},0,0.1666667\n219000002,{at[0]},0,0\n219000001,{at[1]},91,181\n"
    )
    gpx = tmp_path / "f.gpx"
    points = "".join(
        f'<trkseg><trkpt lat="0" lon="{lon}"><time>{time}</time></trkpt></trkseg>'
        for lon, time in zip((20 / 60, 21 / 60), at, strict=True)
    )
    gpx.write_text(f'<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><name>F</name>{points}</trk></gpx>')
    said = run("load", "--positions", "--scene", "s", str(ais), str(gpx))
    assert said.out.splitlines() == ["s: 1 positions of 1 tracks", "s: 2 positions of 1 tracks"]
    assert "1 ids are no tracks of the scene, and left out: '219000002'" in said.err
    assert "1 rows without a time or a place are left out" in said.err
    look(sea)
    asked = run("conflicts", "--live", "--scene", "s")
    # Plans that are not detected have no differences to look up.
    assert "s: not complete: " in asked.err
    assert asked.code == NOT_CURRENT
    shown = asked.out
    alarm = "219000001 9 to 11 min late: may meet anything near (the scene stores no delays: set delays_within_s)"
    assert shown.splitlines()[0] == alarm
    assert [line.split()[:2] for line in shown.splitlines()[3:]] == [["219000001", "late"], ["F", "on"]]
    rows = json.loads(run("conflicts", "--live", "--scene", "s", "--format", "json").out)
    assert [(row["key"], row["other_key"], row["first_contact"]) for row in rows["conflicts"]] == [
        ("219000001", None, None)
    ]
    assert [(row["key"], row["instant"]) for row in rows["tracks"]] == [
        ("219000001", at[0].replace("Z", ".000000Z")), ("F", at[1].replace("Z", ".000000Z"))
    ]  # fmt: skip
    late = tmp_path / "late.csv"
    late.write_text(f"id,time,lon,lat\nF,{at[0]},0,0\nF,2100-01-01T00:00:00Z,0,0\n")
    with connect(dsn) as db, pytest.raises(InvalidInput, match="must not be in the future"):
        db.scene("s").load_positions(late)
    assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (3,)


def test_a_plan_that_changes_is_compared_with_the_last_position(sea: Conn) -> None:
    """The lateness of the former plan says nothing about the new one."""
    plan(sea, "A")
    put(sea, "A", 20, 10 / 60)
    assert look(sea)["A"].state == "late"
    plan(sea, "A", BEGAN + timedelta(minutes=10))
    found = look(sea)["A"]
    assert found.state == "on plan"
    assert abs(found.late_from_s or 0.0) < 60.0


def test_a_look_that_fails_does_not_stop_detection(sea: Conn, dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    plan(sea, "A")
    sea.commit()
    said: list[str] = []

    def failing(*_: Any, **__: Any) -> int:
        raise ValueError("no such place")

    monkeypatch.setattr(Looks, "look", failing)
    assert not Worker(lambda: store.connect(dsn), lambda *_: None, say=said.append).once()
    assert said[0] == "cannot compare positions with plans, trying again: no such place"
    assert sea.execute("SELECT is_current FROM conflictdb.scenes").fetchall() == [(True,)]


def test_a_worker_looks(sea: Conn, dsn: str) -> None:
    """By the clock: neither its silence nor the end of the plan comes while it does."""
    began = datetime.now(UTC) - timedelta(minutes=30)
    plan(sea, "A", began)
    sea.commit()
    put(sea, "A", 29.9, 10 / 60, began=began)
    sea.commit()
    assert Worker(lambda: store.connect(dsn), lambda *_: None).once()
    assert sea.execute("SELECT state FROM conflictdb.live").fetchall() == [("late",)]
