"""Positions while all else happens: backups, restores, other names, branches, attached tables, two workers."""

import threading
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import psycopg
import pytest
from psycopg.pq import TransactionStatus

from conflictdb import InvalidInput, Scene, Track, connect, rectangle_outline_m, store
from conflictdb.jobs import detect
from conflictdb.jobs.looks import Looks
from conflictdb.jobs.worker import Worker

Conn = psycopg.Connection[Any]
BEGAN = datetime.now(UTC).replace(microsecond=0) - timedelta(minutes=30)
OLD = """
INSERT INTO conflictdb.position (scene, key, instant, place, received_at, slot)
SELECT 's', 'FERRY', now(), 'SRID=4326;POINT(0 0)', {},
       (floor(extract(epoch FROM now()) / 43200)::bigint + 4) % 8 RETURNING slot
"""


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


def late(conn: Conn, scene: str = "s", key: str = "FERRY", minute: float = 28.0) -> None:
    """Insert a position that is 10 minutes late, and commit."""
    conn.execute(
        "INSERT INTO conflictdb.position (scene, key, instant, place) "
        "VALUES (%s, %s, %s, ST_SetSRID(ST_MakePoint(%s, 0), 4326))",
        [scene, key, BEGAN + timedelta(minutes=minute), (minute - 10) / 60],
    )
    conn.commit()


def look(conn: Conn, minute: float = 28.0) -> dict[tuple[str, str, str | None], str]:
    """Look as a worker does; return the verdicts of alarms."""
    Looks().look(conn, us(minute), is_silence_due=True)
    rows = conn.execute("SELECT scene, key, other_key, verdict FROM conflictdb.live_conflicts").fetchall()
    conn.commit()
    return {row[:3]: row[3] for row in rows}


def count(conn: Conn) -> int:
    """Return how many positions a look reads."""
    return len(store.new_positions(conn, 1000))


MEET = {("s", "FERRY", "TOW"): "must"}


@pytest.mark.parametrize("ahead", ["seen too", "not a look yet"])
def test_positions_of_a_restored_database_are_read_once(sea: Conn, ahead: str) -> None:
    """A restore keeps numbers of transactions, which may be larger than all of the new server."""
    late(sea)
    assert look(sea) == MEET
    sea.execute("UPDATE conflictdb.position SET transaction_id = '9000000000'")
    if ahead == "seen too":
        sea.execute("UPDATE conflictdb.position_look SET seen = '9000000001:9000000001:'")
    else:
        sea.execute("DELETE FROM conflictdb.position_look")
    sea.commit()
    read = []
    for _ in range(3):
        read.append(count(sea))
        sea.commit()
    assert read[0] == 1
    assert read[2] == 0
    late(sea, minute=29.0)
    assert count(sea) == 1
    sea.rollback()
    assert look(sea) == MEET


def test_workers_may_read_a_restored_database(sea: Conn) -> None:
    late(sea)
    sea.execute("UPDATE conflictdb.position SET transaction_id = '9000000000'")
    sea.execute("SET ROLE conflictdb_worker")
    assert count(sea) == 1
    sea.rollback()


@pytest.mark.parametrize("who", ["a backup that reads", "a feed that writes"])
def test_old_positions_in_use_stay_for_now(sea: Conn, dsn: str, who: str) -> None:
    """A look waits for no backup, and a position that comes as its half day begins again is kept."""
    (slot,) = sea.execute(OLD.format("now() - interval '3 days'").encode()).fetchone() or ()
    sea.commit()
    with psycopg.connect(dsn) as other:
        other.execute(f"SELECT FROM conflictdb.position_{slot}".encode() if who.endswith("reads") else
                      OLD.format("now()").encode())  # fmt: skip
        sea.execute("SET statement_timeout = '20s'")
        assert sea.execute("SELECT conflictdb_internal._prune_positions()").fetchone() == (0,)
        sea.commit()
        other.commit()
    emptied = 1 if who.endswith("reads") else 0
    assert sea.execute("SELECT conflictdb_internal._prune_positions()").fetchone() == (emptied,)
    assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (2 - 2 * emptied,)


def test_names_of_scenes_change(sea: Conn) -> None:
    """Positions and alarms stay with the scene; a copy has none; its old name is nobody's."""
    late(sea)
    assert look(sea) == MEET
    with connect(sea) as db:
        db.scene("s").copy("twin")
        db.scene("s").rename("t")
    assert look(sea) == {("t", "FERRY", "TOW"): "must"}
    with pytest.raises(psycopg.Error, match="scene 's': name: is not in this database"):
        late(sea)
    sea.rollback()
    late(sea, "t", minute=28.5)
    assert look(sea, 28.5) == {("t", "FERRY", "TOW"): "must"}
    late(sea, "twin", minute=28.5)
    with connect(sea) as db:
        db.scene("twin").detect()
    assert look(sea, 28.5) == {("t", "FERRY", "TOW"): "must", ("twin", "FERRY", "TOW"): "must"}


def test_branches_have_no_positions_and_change_what_follows_when_merged(sea: Conn) -> None:
    late(sea)
    assert look(sea) == MEET
    with connect(sea) as db:
        branch = db.scene("s").branch("b")
        with pytest.raises(psycopg.Error, match="is a branch, which has no positions: give them to its parent"):
            late(sea, "b")
        sea.rollback()
        tow = plans()[1]
        branch.put(Track("TOW", tow.positions_deg, tow.times_us + 1_200_000_000, tow.outline_m))
        assert look(sea) == MEET
        branch.merge()
        db.scene("s").detect()
    late(sea, minute=28.5)
    assert look(sea, 28.5) == {}


def test_keys_of_attached_plans_change(sea: Conn, dsn: str) -> None:
    """The state and alarms of the old key end; the new one takes positions."""
    sea.execute("CREATE TABLE public.fix (id integer, voyage text, at timestamptz, place geometry(Point, 4326))")
    for track in plans():
        for (lon, lat), at in zip(track.positions_deg.tolist(), track.times_us.tolist(), strict=True):
            sea.execute(
                "INSERT INTO public.fix VALUES (1, %s, to_timestamp(%s), ST_SetSRID(ST_MakePoint(%s, %s), 4326))",
                [track.key, at / 1e6, lon, lat],
            )
    sea.commit()
    haven = dict.fromkeys(("fore_m", "aft_m", "port_m", "starboard_m"), "500")
    with connect(sea) as db:
        store.replace_scene(sea, Scene("s", delays_within_s=3600), [], [], merge=False)
        sea.commit()
        db.scene("s").attach("track", "public.fix", {"key": "voyage", "position": "place", "time": "at", **haven})
        db.scene("s").detect()
        late(sea)
        assert look(sea) == MEET
        sea.execute("UPDATE public.fix SET voyage = 'NEW' WHERE voyage = 'FERRY'")
        sea.commit()
        db.scene("s").detect()
        assert look(sea) == {}
        assert db.scene("s").live() == []
        with pytest.raises(psycopg.Error, match="position of 'FERRY': key: is not a track"):
            late(sea, minute=29.0)
        sea.rollback()
        late(sea, key="NEW", minute=29.0)
        assert look(sea, 29.0) == {("s", "NEW", "TOW"): "must"}
    sea.execute("DROP TABLE public.fix")
    sea.commit()


def test_objects_change_their_keys(sea: Conn) -> None:
    late(sea)
    assert look(sea) == MEET
    with connect(sea) as db:
        db.scene("s").rename_object("FERRY", "NEW")
        db.scene("s").detect()
    late(sea, key="NEW", minute=28.5)
    assert look(sea, 28.5) == {("s", "NEW", "TOW"): "must"}


def test_two_workers_look_at_each_position_once(sea: Conn, dsn: str) -> None:
    """Each alarm begins once, whoever looks."""
    stop = threading.Event()

    def work() -> None:
        with store.connect(dsn) as own:
            looks = Looks()
            while not stop.is_set():
                looks.look(own, us(30), is_silence_due=True)

    threads = [threading.Thread(target=work) for _ in range(2)]
    for one in threads:
        one.start()
    for n in range(60):
        at = 20.0 + n / 10
        by = 10 if n // 10 % 2 else 0
        sea.execute(
            "INSERT INTO conflictdb.position (scene, key, instant, place) "
            "VALUES ('s', 'FERRY', %s, ST_SetSRID(ST_MakePoint(%s, 0), 4326))",
            [BEGAN + timedelta(minutes=at), (at - by) / 60],
        )
        sea.commit()
    stop.set()
    for one in threads:
        one.join()
    look(sea, 30)
    rows = sea.execute("SELECT kind, alarm_id FROM conflictdb.live_events ORDER BY event").fetchall()
    begun = [number for kind, number in rows if kind == "begun"]
    assert len(begun) == len(set(begun)) >= 1
    assert [kind for kind, _ in rows] == (["begun", "ended"] * len(rows))[: len(rows)]
    assert sea.execute("SELECT instant FROM conflictdb.live").fetchall() == [(BEGAN + timedelta(minutes=25.9),)]


def test_bad_positions_leave_a_connection_usable(sea: Conn) -> None:
    """One sentence for many at once, and nothing half stored."""
    keys = ["FERRY"] * 20_000 + ["NOBODY"]
    at_us, lonlat = np.full(len(keys), us(20)), np.zeros((len(keys), 2))
    with pytest.raises(InvalidInput) as refused, store.transaction(sea):
        store.insert_positions(sea, "s", keys, at_us, lonlat)
    assert str(refused.value).startswith("position of 'NOBODY': key: is not a track of scene 's'")
    assert sea.info.transaction_status == TransactionStatus.IDLE
    assert sea.execute("SELECT count(*) FROM conflictdb.position").fetchone() == (0,)


def test_a_worker_goes_on_after_a_backlog(sea: Conn, dsn: str) -> None:
    """Positions out of order, twice, and of a day ago come in one transaction."""
    for minute in (29.0, 10.0, 29.0, -1440.0, 28.0):
        sea.execute(
            "INSERT INTO conflictdb.position (scene, key, instant, place) "
            "VALUES ('s', 'FERRY', %s, ST_SetSRID(ST_MakePoint(%s, 0), 4326))",
            [BEGAN + timedelta(minutes=minute), (minute - 10) / 60 if minute > 0 else 100.0],
        )
    sea.commit()
    assert Worker(lambda: store.connect(dsn), lambda *_: None).once()
    assert sea.execute("SELECT instant FROM conflictdb.live").fetchall() == [(BEGAN + timedelta(minutes=29),)]


# How late a ferry is, minute by minute; None: off its plan.
LATE_MIN = [0, 0, 10, 10, 0, 0, None, 0, 0, 3, 10, 20, 0, 0, None, None, 10, 0, 10, 10, 0]


def excursions(conn: Conn, monkeypatch: pytest.MonkeyPatch, at_once: int) -> list[tuple[Any, ...]]:
    """Look at all positions, some at a time; return which alarms began and ended, and the last states."""
    monkeypatch.setattr("conflictdb.jobs.looks._AT_ONCE", at_once)
    conn.execute("DELETE FROM conflictdb.live_state")
    conn.execute("DELETE FROM conflictdb.live_event")
    conn.execute("DELETE FROM conflictdb.position_look")
    conn.commit()
    looks, read = Looks(), list[int]()
    while not read or looks.is_behind:
        read.append(looks.look(conn, us(0), is_silence_due=False))
    assert [count for count in read if count] == [at_once] * (42 // at_once) + [42 % at_once] * (42 % at_once > 0)
    found = conn.execute(
        "SELECT kind, key, other_key, verdict, reason FROM conflictdb.live_events ORDER BY event"
    ).fetchall()
    found += conn.execute(
        "SELECT key, state, late_from_s, late_to_s, off_m FROM conflictdb.live ORDER BY key"
    ).fetchall()
    conn.execute("DELETE FROM conflictdb.live_conflict")
    conn.commit()
    return found


def test_a_backlog_is_read_in_parts_and_gives_the_same_alarms(sea: Conn, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each part is committed; an excursion that is over by the end of a part raises its alarm, too."""
    for n, late_min in enumerate(LATE_MIN):
        sea.cursor().executemany(
            "INSERT INTO conflictdb.position (scene, key, instant, place) "
            "VALUES ('s', %s, %s, ST_SetSRID(ST_MakePoint(%s, %s), 4326))",
            [
                ("FERRY", BEGAN + timedelta(minutes=n), max(0.0, n - (late_min or 0)) / 60, 0.5 * (late_min is None)),
                ("TOW", BEGAN + timedelta(minutes=n), 0.5, -0.5 + max(0, n - 10) / 60),
            ],
        )
    sea.commit()
    each = excursions(sea, monkeypatch, 1)
    assert sum(row[0] == "begun" for row in each) == 3
    for at_once in (5, 11, 40, 100):
        assert excursions(sea, monkeypatch, at_once) == each


def some(conn: Conn, first: int, count: int) -> None:
    """Insert positions of a ferry, a second apart, the last one first."""
    conn.execute(
        "INSERT INTO conflictdb.position (scene, key, instant, place) "
        "SELECT 's', 'FERRY', %s + n * interval '1 second', 'SRID=4326;POINT(0 0)' FROM generate_series(%s, %s, -1) n",
        [BEGAN - timedelta(days=1), first + count - 1, first],
    )


@pytest.mark.parametrize("at_once", [1, 3, 7, 10, 1000])
def test_each_position_of_a_backlog_is_read_once(sea: Conn, dsn: str, at_once: int) -> None:
    """Also those of transactions that commit while a larger one is read in parts, earlier or later than it."""
    with psycopg.connect(dsn) as early, psycopg.connect(dsn) as later:
        some(early, 0, 9)
        for first, count in ((10, 3), (20, 4), (30, 25), (60, 2)):
            some(sea, first, count)
            sea.commit()
        some(later, 70, 8)
        for first in (80, 90):
            some(sea, first, 8)
            sea.commit()
        read, is_behind = list[list[int]](), True
        for end in [lambda: None] * 2 + [early.commit] + [lambda: None] * 2 + [later.commit] + [lambda: None] * 100:
            heard = store.new_positions(sea, at_once)
            read.append([round(one.at_us / 1e6 - us(-1440) / 1e6) for one in heard])
            is_behind = store.is_behind(sea)
            sea.commit()
            end()
    assert not is_behind
    assert max(map(len, read)) <= at_once
    every = [*range(9), *range(10, 13), *range(20, 24), *range(30, 55), *range(60, 62)]
    assert sorted(n for part in read for n in part) == [*every, *range(70, 78), *range(80, 88), *range(90, 98)]
    assert all(part == sorted(part) for part in read)


@pytest.mark.parametrize("in_each", [50, 100_000])
def test_a_look_costs_the_same_whatever_waits(sea: Conn, in_each: int) -> None:
    """It sorted all positions that waited: a look at 20,000 of a million took as long as the first."""
    blocks, first = list[int](), 0
    for waiting in (2_000, 20_000):
        for own in range(first, first + waiting, in_each):
            some(sea, own, min(in_each, first + waiting - own))
            sea.commit()
        first += waiting
        for _ in range(3):
            ((plan,),) = sea.execute(
                "EXPLAIN (ANALYZE, BUFFERS, FORMAT JSON) SELECT * FROM conflictdb_internal._new_positions(200)"
            ).fetchall()
            assert plan[0]["Plan"]["Actual Rows"] == 200
            sea.commit()
        blocks.append(plan[0]["Plan"]["Shared Hit Blocks"] + plan[0]["Plan"]["Shared Read Blocks"])
    assert blocks[1] < 1.5 * blocks[0]
