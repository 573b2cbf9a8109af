"""Looks at positions beside whatever else happens: removed and renamed scenes and objects, odd clocks and sessions."""

import subprocess
import threading
from datetime import UTC, datetime, timedelta
from typing import Any

import psycopg
import pytest
from databases import TestServer, client_programs
from patience import WAIT_S, until_blocked

from conflictdb import InvalidInput, Scene, Track, connect, rectangle_outline_m, store
from conflictdb.formats.fixes import Fixes
from conflictdb.jobs import detect
from conflictdb.jobs.looks import Looks
from conflictdb.jobs.replay import replay

Conn = psycopg.Connection[Any]
BEGAN = datetime.now(UTC).replace(microsecond=0) - timedelta(minutes=30)


def us(minute: float) -> int:
    return int((BEGAN + timedelta(minutes=minute)).timestamp() * 1e6)


def plans() -> list[Track]:
    """Return a ferry that passes a crossing 10 minutes before a tow, both at a mile a minute."""
    side = rectangle_outline_m(500, 500, 500, 500)
    ferry = Track("FERRY", [(0.0, 0.0), (1.0, 0.0)], [us(0), us(60)], side)
    return [ferry, Track("TOW", [(0.5, -0.5), (0.5, 0.5)], [us(10), us(70)], side)]


@pytest.fixture
def sea(conn: Conn) -> Conn:
    store.replace_scene(conn, Scene("s", delays_within_s=3600), [], plans(), merge=False)
    conn.commit()
    detect.detect(conn, "s", jobs=1)
    return conn


def put(conn: Conn, minute: float, late_min: float, key: str = "FERRY", scene: str = "s") -> None:
    """Insert a position of the ferry that is some minutes late."""
    conn.execute(
        "INSERT INTO conflictdb.position (scene, key, instant, place) "
        "VALUES (%s, %s, %s, ST_SetSRID(ST_MakePoint(%s, 0), 4326))",
        [scene, key, BEGAN + timedelta(minutes=minute), (minute - late_min) / 60],
    )


def look(conn: Conn, minute: float, looks: Looks | None = None) -> dict[tuple[str, str | None], tuple[str, int]]:
    """Look as a worker does; return the verdicts and numbers of alarms."""
    conn.commit()
    (looks or Looks()).look(conn, us(minute), is_silence_due=True)
    rows = conn.execute("SELECT key, other_key, verdict, alarm_id FROM conflictdb.live_conflicts").fetchall()
    conn.commit()
    return {row[:2]: row[2:] for row in rows}


def begun(conn: Conn) -> list[tuple[Any, ...]]:
    """Return which alarms began and ended."""
    found = conn.execute("SELECT kind, key, other_key FROM conflictdb.live_events ORDER BY event").fetchall()
    conn.commit()
    return found


@pytest.mark.parametrize("after", ["put_live", "unheard"])
def test_a_scene_is_removed_while_a_look_stores_its_alarms(
    sea: Conn, dsn: str, monkeypatch: pytest.MonkeyPatch, after: str
) -> None:
    """Who removes it waits for the look, which had waited for the removal in turn."""
    put(sea, 20, 0)
    look(sea, 20)
    put(sea, 28, 10)
    if after == "unheard":
        look(sea, 28)
        sea.execute("SELECT conflictdb.remove_object('s', 'FERRY')")
    sea.commit()
    failed: list[Exception] = []

    def remove() -> None:
        try:
            with psycopg.connect(dsn) as other:
                other.execute("SELECT conflictdb.remove_scene('s')")
        except psycopg.Error as error:
            failed.append(error)

    thread = threading.Thread(target=remove)
    whole = getattr(store, after)

    def then_removed(*given: Any) -> Any:
        found = whole(*given)
        if not thread.ident:
            thread.start()
            with psycopg.connect(dsn) as watcher:
                until_blocked(watcher, sea)
        return found

    with monkeypatch.context() as patched:
        patched.setattr(store, after, then_removed)
        Looks().look(sea, us(29), is_silence_due=True)
    thread.join(WAIT_S)
    assert failed == []
    assert look(sea, 29) == {}
    assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (0,)


def test_a_scene_that_is_being_removed_is_left_out_of_the_search_for_silence(sea: Conn, dsn: str) -> None:
    """Its open transaction stops no look at other scenes; if it is rolled back, the scene is looked at again."""
    store.replace_scene(sea, Scene("t", delays_within_s=3600), [], plans(), merge=False)
    sea.commit()
    detect.detect(sea, "t", jobs=1)
    for scene in ("s", "t"):
        put(sea, 10, 0, scene=scene)
    look(sea, 10)
    states = "SELECT scene, state FROM conflictdb.live ORDER BY scene"
    with psycopg.connect(dsn) as other:
        other.execute("SELECT conflictdb.rename_scene('s', 'r')")
        sea.execute("SET lock_timeout = '20s'")
        look(sea, 25)
        assert sea.execute(states).fetchall() == [("s", "on plan"), ("t", "silent")]
        other.rollback()
    look(sea, 25)
    assert sea.execute(states).fetchall() == [("s", "silent"), ("t", "silent")]


def acknowledged(conn: Conn) -> Any:
    (found,) = conn.execute("SELECT acknowledged_for FROM conflictdb.live_conflicts").fetchone() or ("no alarm",)
    conn.commit()
    return found


def test_an_alarm_that_has_slack_again_is_may_until_it_ends(sea: Conn) -> None:
    """10 minutes late the ferry meets the tow, and 8 minutes late it passes with less than a minute to spare."""
    put(sea, 20, 10)
    ((pair, (verdict, number)),) = look(sea, 20).items()
    assert (pair, verdict) == (("FERRY", "TOW"), "must")
    with connect(sea) as db:
        db.scene("s").acknowledge("FERRY", "TOW", "known")
    put(sea, 21, 8.0)
    assert look(sea, 21) == {pair: ("may", number)}
    (slack,) = sea.execute("SELECT slack_s FROM conflictdb.live WHERE key = 'FERRY'").fetchone() or ()
    (reason,) = sea.execute("SELECT reason FROM conflictdb.live_conflicts").fetchone() or ()
    assert 0 < slack < 60
    assert reason == "they have slack again, less than 60 s"
    assert acknowledged(sea) == "known"
    # It was acknowledged as must, which it is again.
    put(sea, 22, 10)
    assert look(sea, 22) == {pair: ("must", number)}
    assert acknowledged(sea) == "known"
    put(sea, 23, 0)
    assert look(sea, 23) == {}
    assert begun(sea) == [("begun", *pair), ("ended", *pair)]


def test_what_is_acknowledged_as_may_is_not_as_must(sea: Conn) -> None:
    put(sea, 20, 10)
    look(sea, 20)
    put(sea, 21, 8.0)
    ((_, (verdict, _)),) = look(sea, 21).items()
    assert verdict == "may"
    with connect(sea) as db:
        db.scene("s").acknowledge("FERRY", "TOW", "parting")
    put(sea, 21.5, 8.0)
    look(sea, 21.5)
    assert acknowledged(sea) == "parting"
    put(sea, 22, 10)
    look(sea, 22)
    assert acknowledged(sea) is None


@pytest.mark.parametrize(
    ("key", "new", "pair"),
    [
        ("FERRY", "NEW", ("NEW", "TOW")),
        ("FERRY", "ZULU", ("TOW", "ZULU")),  # pairs are in the order of keys
        ("TOW", "ALPHA", ("ALPHA", "FERRY")),
        ("TOW", "NEW", ("FERRY", "NEW")),
    ],
)
@pytest.mark.parametrize("when", ["before a look", "while a look reads", "while a look searches"])
def test_a_renamed_object_keeps_its_alarm(
    sea: Conn, dsn: str, monkeypatch: pytest.MonkeyPatch, key: str, new: str, pair: tuple[str, str], when: str
) -> None:
    """With its number and acknowledgement; nothing begins or ends."""
    put(sea, 27, 10)
    ((_, found),) = look(sea, 27).items()
    with connect(sea) as db:
        db.scene("s").acknowledge("FERRY", "TOW", "known")
    put(sea, 28, 10)
    sea.commit()
    ferry = new if key == "FERRY" else "FERRY"

    def rename() -> None:
        with psycopg.connect(dsn) as other:
            other.execute("SELECT conflictdb.rename_object('s', %s, %s)", [key, new])
            other.commit()
            put(other, 28.5, 10, key=ferry)

    if when == "before a look":
        rename()
    else:
        name = "live_states" if when == "while a look reads" else "unheard"
        whole = getattr(store, name)

        def renamed(*given: Any) -> Any:
            rename()
            monkeypatch.setattr(store, name, whole)
            return whole(*given)

        monkeypatch.setattr(store, name, renamed)
        look(sea, 28)
    assert look(sea, 28.5) == {pair: found}
    assert look(sea, 28.5) == {pair: found}
    assert acknowledged(sea) == "known"
    put(sea, 29, 10, key=ferry)
    assert look(sea, 29) == {pair: found}
    assert begun(sea) == [("begun", "FERRY", "TOW")]
    assert sea.execute("SELECT DISTINCT key FROM conflictdb.position").fetchall() == [(ferry,)]
    assert sea.execute("SELECT key, instant FROM conflictdb.live").fetchall() == [
        (ferry, BEGAN + timedelta(minutes=29))
    ]


def test_an_alarm_with_a_renamed_area_stays(sea: Conn) -> None:
    sea.execute("SELECT conflictdb.put_area('s', 'DIVING', ST_MakeEnvelope(0.7, -0.01, 0.72, 0.01, 4326), "
                "tstzrange(%s, %s))", [BEGAN + timedelta(minutes=50), BEGAN + timedelta(minutes=54)])  # fmt: skip
    sea.commit()
    detect.detect(sea, "s", jobs=1)
    put(sea, 28, 10)
    before = look(sea, 28)
    sea.execute("SELECT conflictdb.rename_object('s', 'DIVING', 'A')")
    after = look(sea, 28.2)
    assert before == {("FERRY", "DIVING"): after["FERRY", "A"], ("FERRY", "TOW"): after["FERRY", "TOW"]}
    assert len(after) == 2


def test_a_key_that_is_free_again_brings_no_alarm_of_its_former_object(sea: Conn) -> None:
    """The alarm of a removed object ends, though another one gets its key before the next look."""
    put(sea, 28, 10)
    ((_, (_, number)),) = look(sea, 28).items()
    third = Track("THIRD", [(0.0, 5.0), (1.0, 5.0)], [us(0), us(60)], rectangle_outline_m(500, 500, 500, 500))
    with connect(sea) as db:
        db.scene("s").put(third)
        sea.execute(
            "INSERT INTO conflictdb.position (scene, key, instant, place) "
            "VALUES ('s', 'THIRD', %s, 'SRID=4326;POINT(0.45 5)')", [BEGAN + timedelta(minutes=27)],
        )  # fmt: skip
        look(sea, 28)
        sea.execute("SELECT conflictdb.remove_object('s', 'FERRY')")
        sea.commit()
        db.scene("s").rename_object("THIRD", "FERRY")
        db.scene("s").detect()
    assert look(sea, 28.2) == {}
    assert begun(sea) == [("begun", "FERRY", "TOW"), ("ended", "FERRY", "TOW")]
    assert sea.execute("SELECT key, ST_Y(place) FROM conflictdb.live").fetchall() == [("FERRY", 5.0)]
    assert number


def test_keys_go_round_and_bring_their_states(sea: Conn) -> None:
    """Two objects exchange their keys between two looks."""
    put(sea, 28, 10)
    ((_, found),) = look(sea, 28).items()
    sea.execute("UPDATE conflictdb.track SET key = 'X' WHERE key = 'TOW'")
    sea.execute("UPDATE conflictdb.track SET key = 'TOW' WHERE key = 'FERRY'")
    sea.execute("UPDATE conflictdb.track SET key = 'FERRY' WHERE key = 'X'")
    assert look(sea, 28.2) == {("FERRY", "TOW"): found}
    assert sea.execute("SELECT key, state FROM conflictdb.live").fetchall() == [("TOW", "late")]


def test_nothing_is_left_of_a_scene_whose_removal_was_replicated(sea: Conn) -> None:
    """Foreign keys do not hold there: an alarm that was left would fail each look."""
    put(sea, 28, 10)
    assert len(look(sea, 28)) == 1
    sea.execute("SET LOCAL session_replication_role = replica")
    sea.execute("DELETE FROM conflictdb.scene WHERE name = 's'")
    assert look(sea, 29) == {}
    for table in ("position", "live_state", "live_conflict", "live_event"):
        assert sea.execute(f"SELECT count(*) FROM conflictdb.{table}".encode()).fetchone() == (0,), table


def test_a_track_waits_between_its_voyages(sea: Conn) -> None:
    """A ferry sails out and back once a day, also on a day of 25 hours; each voyage has a lateness of its own."""
    day, side = 25 * 60, rectangle_outline_m(500, 500, 500, 500)
    ends = [(0.0, 10.0), (0.5, 10.0), (0.0, 10.0)]
    departures = [us(-day), us(0), us(24 * 60)]
    with connect(sea) as db:
        db.scene("s").put(Track("DAILY", ends, [us(0), us(60), us(120)], side, departures_us=departures))
        db.scene("s").detect()
    found = []
    for minute, lon, lat in (
        (-day + 20, 20 / 120, 10.0), (-day + 119.5, 0.0, 10.0), (-day + 125, 0.0, 10.0), (-day + 300, 0.0, 10.02),
        (-day + 700, 0.0, 10.0), (-10, 0.0, 10.0), (20, 20 / 120, 10.0), (28, 18 / 120, 10.0),
    ):  # fmt: skip
        sea.execute(
            "INSERT INTO conflictdb.position (scene, key, instant, place) "
            "VALUES ('s', 'DAILY', %s, ST_SetSRID(ST_MakePoint(%s, %s), 4326))",
            [BEGAN + timedelta(minutes=minute), lon, lat],
        )
        assert look(sea, minute) == {}
        (row,) = sea.execute("SELECT state, round(late_from_s / 60) FROM conflictdb.live")
        found.append(row)
    wait = "not yet under way"
    assert [state for state, _ in found] == ["on plan", "on plan", wait, wait, wait, wait, "on plan", "late"]
    assert found[-1][1] == 9


def test_a_track_that_is_late_between_its_voyages_does_not_wait(sea: Conn) -> None:
    """It was heard of before its first voyage only, and is under way when that should have ended."""
    side = rectangle_outline_m(500, 500, 500, 500)
    track = Track("DAILY", [(0.0, 10.0), (0.5, 10.0)], [us(0), us(60)], side, departures_us=[us(-120), us(24 * 60)])
    with connect(sea) as db:
        db.scene("s").put(track)
        db.scene("s").detect()
    for minute, place in ((-130, 0.0), (-30, 0.25)):
        sea.execute(
            "INSERT INTO conflictdb.position (scene, key, instant, place) "
            "VALUES ('s', 'DAILY', %s, ST_SetSRID(ST_MakePoint(%s, 10), 4326))",
            [BEGAN + timedelta(minutes=minute), place],
        )
        look(sea, minute)
    assert sea.execute("SELECT state FROM conflictdb.live").fetchall() == [("late",)]


def test_positions_that_no_look_has_read_are_kept(sea: Conn) -> None:
    """No worker ran for two days: the last position of a ship is older than positions are kept."""
    put(sea, 20, 0)
    sea.execute("UPDATE conflictdb.position SET received_at = now() - interval '2 days'")
    sea.commit()
    prune = "SELECT conflictdb_internal._prune_positions()"
    look(sea, 20)
    put(sea, 28, 10)
    sea.execute("UPDATE conflictdb.position SET received_at = now() - interval '2 days'")
    sea.commit()
    assert sea.execute(prune).fetchone() == (0,)
    assert set(look(sea, 28)) == {("FERRY", "TOW")}
    assert sea.execute(prune).fetchone() == (1,)
    assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (0,)


@pytest.mark.parametrize("far", ["a year before", "in the future"])
def test_a_replay_does_not_wait_for_a_wrong_date(sea: Conn, monkeypatch: pytest.MonkeyPatch, far: str) -> None:
    """Positions in the future are refused before any is inserted; long gaps are left out."""
    at_us = [us(20), us(28)]
    if far == "in the future":
        at_us[1] = us(60 * 24 * 365)
    else:
        at_us[0] = us(-60 * 24 * 365)
    fixes = {"FERRY": Fixes(lines=[2, 3], times_us=at_us, positions_deg=[(20 / 60, 0.0), (18 / 60, 0.0)])}
    monkeypatch.setattr("conflictdb.jobs.replay._STEP_US", 3_600_000_000)
    looked: list[int] = []
    if far == "in the future":
        with pytest.raises(InvalidInput, match="position of 'FERRY': instant: must not be in the future"):
            replay(sea, "s", fixes, speed=1e9)
        assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (0,)
    else:
        assert replay(sea, "s", fixes, speed=1e9, report=lambda now_us, _: looked.append(now_us)) == 2
        assert len(looked) < 40
        assert at_us[1] <= looked[-1] < at_us[1] + 3_600_000_000


def test_a_dump_brings_positions_and_alarms(sea: Conn, dsn: str, _server: TestServer, template: str) -> None:  # noqa: PT019
    """As data alone, into a database with the schema: the same alarm goes on."""
    put(sea, 28, 10)
    before = look(sea, 28)
    put(sea, 28.5, 10)
    sea.commit()
    programs, environ = client_programs(sea)
    name = f"{sea.info.dbname}_restored"
    target = _server.clone(template, name)
    try:
        alone = ["--data-only", "--exclude-table-data=conflictdb.alembic_version"]
        archive = subprocess.run(
            [programs / "pg_dump", "-Fc", "-d", dsn, *alone], env=environ, check=True, stdout=subprocess.PIPE
        ).stdout
        subprocess.run([programs / "pg_restore", "-e", "-d", target], env=environ, check=True, input=archive)
        with psycopg.connect(target) as conn:
            assert conn.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (2,)
            conn.commit()
            detect.detect(conn, "s", jobs=1)
            assert look(conn, 28.5) == before
            assert conn.execute("SELECT key, instant FROM conflictdb.live").fetchall() == [
                ("FERRY", BEGAN + timedelta(minutes=28.5))
            ]
            put(conn, 29, 10)
            assert look(conn, 29) == before
            assert begun(conn) == [("begun", "FERRY", "TOW")]
    finally:
        _server.drop(name)
