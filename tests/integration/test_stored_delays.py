"""Stored differences are those of a full computation; delays that are looked up are those computed, to the bit."""

import json
import runpy
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
from layouts import EQUATOR, GROWING_CIRCLES, HARBOUR, OCEAN, SEAM, Workload
from mixed_scenes import plain_scene
from psycopg import conninfo, sql
from scenes import area, track
from shapely import box

import conflictdb
from conflictdb import InvalidInput, connect, store
from conflictdb.client.stored_scene import StoredScene
from conflictdb.core import pair_differences
from conflictdb.core.delays import Differences, Leeway
from conflictdb.core.forbidden import delays_of
from conflictdb.core.memory_budget import MemoryBudget
from conflictdb.core.pair_differences import PairDifferences
from conflictdb.earth.registry import Setup
from conflictdb.jobs import difference_rows, import_computed, probes, schema
from conflictdb.jobs.detect import detect
from conflictdb.model.plans import Area, Scene, Track

Conn = psycopg.Connection[Any]

WITHIN_S = 3600.0
HOUR_US = 3_600_000_000
ROWS = """SELECT t.key, coalesce(a.key, o.key), d.forbidden_us::text, d.proven_us::text
FROM conflictdb.difference d JOIN conflictdb.scene s USING (scene_id)
JOIN conflictdb.track t USING (track_id)
LEFT JOIN conflictdb.area a ON d.other_kind = 0 AND a.area_id = d.other_id
LEFT JOIN conflictdb.track o ON d.other_kind = 1 AND o.track_id = d.other_id
WHERE s.name = %s ORDER BY 1, 2, 3"""


def rows(conn: Conn, scene: str) -> list[tuple[Any, ...]]:
    found = conn.execute(ROWS.encode(), [scene]).fetchall()
    conn.commit()
    return found


def stored(db: conflictdb.Database, scene: Scene, areas: list[Area], tracks: list[Track]) -> StoredScene:
    store.replace_scene(db.connection, scene, areas, tracks, merge=False)
    found = db.scene(scene.name)
    found.detect()
    return found


def waiting(name: str, lon: float) -> Track:
    """A track that stands for half an hour, and then leaves."""
    return track(name, [(lon, 0.1), (lon, 0.1), (lon, 0.6)], [0, 1800, 5400], 200, 200, 100, 100)


def waits_first(name: str, one: Track) -> Track:
    """A track like another, whose haven it has at the start, that stands for half an hour first."""
    times_us = np.insert(one.times_us, 0, one.times_us[0] - HOUR_US // 2)
    return Track(name, np.insert(one.positions_deg, 0, one.positions_deg[0], axis=0), times_us, one.outline_m)


def voyages(one: Track) -> Track:
    """A track that departs again as soon as it has arrived, and once more an hour after that."""
    first_us, last_us = one.times_us[[0, -1]].tolist()
    return replace(one, departures_us=[first_us, last_us, 2 * last_us - first_us + HOUR_US], max_speed_kn=np.inf)


@pytest.mark.parametrize("workload", [EQUATOR, OCEAN, SEAM, HARBOUR, GROWING_CIRCLES], ids=lambda one: one.name)
@pytest.mark.parametrize("separation_m", [0.0, 5000.0])
def test_a_lookup_is_the_computation_to_the_bit(dsn: str, workload: Workload, separation_m: float) -> None:
    """For each track alone and all together, for each horizon and `now`."""
    scene, areas, tracks = plain_scene(workload, 3, 6, 7, separation_m=separation_m)
    scene = replace(
        scene, delays_within_s=600.0 if workload is HARBOUR else WITHIN_S, time_separation_s=separation_m / 50
    )
    first_us = min(int(one.times_us[0]) for one in tracks)
    with connect(dsn) as db:
        wait = [waits_first(f"WAITS {n}", one) for n, one in enumerate(tracks[:3])]
        wait[2] = voyages(wait[2])
        known = stored(db, scene, areas, [*tracks, *wait])
        settings, areas, tracks = store.read_scene(db.connection, scene.name)
        assert known.state().is_current
        for within_s in (scene.delays_within_s, scene.delays_within_s / 3, 0.0):
            for now_us in (None, first_us - HOUR_US // 7, first_us + HOUR_US // 3):
                now = None if now_us is None else np.datetime64(now_us, "us")
                expected = conflictdb.delays(tracks, areas, settings, None, within_s, now)
                with pytest.MonkeyPatch.context() as patch:
                    patch.setattr(store, "read_scene", None)  # a lookup reads no objects
                    assert known.delays(None, within_s, now) == expected
                    assert [known.delays(one.key, within_s, now)[0] for one in expected] == expected
        assert any(one.forbidden for one in expected)


def random_differences(
    rng: np.random.Generator, tracks: np.ndarray, others: np.ndarray, horizon_us: int
) -> Differences:
    """Intervals that overlap, touch, leave gaps of a microsecond, reach beyond the horizon, and prove nothing."""
    n = int(rng.integers(0, 30))
    low = rng.integers(-horizon_us - 6, horizon_us + 4, n)
    high = low + rng.choice([0, 1, 2, 5, horizon_us, 3 * horizon_us], n)
    inner_low, inner_high = low + rng.integers(0, 3, n), high - rng.integers(0, 3, n)
    known = rng.random(n) < 0.7
    other = rng.choice(others, n)
    track = np.array([rng.choice(tracks[tracks != one]) for one in other], np.int64)
    return Differences(track, other, low, high, np.where(known, inner_low, 1), np.where(known, inner_high, 0))


def test_any_differences_answer_alike_from_pieces_and_from_rows(dsn: str) -> None:
    """Every column, to the bit."""
    rng, horizon_us = np.random.default_rng(11), 20
    plain = track("EAST", [(0.0, 0.0), (0.5, 0.0)], [0, 3600], 100, 100, 50, 50)
    tracks = [plain, waiting("WAITS", 0.25), voyages(waiting("RETURNS", 0.35))]
    areas = [area(f"AREA {n}", box(0.1 * n, 5.0, 0.1 * n + 0.01, 5.01)) for n in range(3)]
    blocked = 0
    with connect(dsn) as db:
        known = stored(db, Scene("s", delays_within_s=horizon_us / 1e6), areas, tracks)
        conn, scene_id = db.connection, store.scene_id(db.connection, "s")
        ids = conn.execute(
            "SELECT key, conflictdb_internal._object_number(0::smallint, area_id) FROM conflictdb.area UNION ALL "
            "SELECT key, conflictdb_internal._object_number(1::smallint, track_id) FROM conflictdb.track"
        ).fetchall()
        number_of = dict(ids)
        keys, numbers = {number: key for key, number in ids}, np.array([one.key for one in tracks])
        track_numbers = np.array([number_of[key] for key in numbers.tolist()], np.int64)
        for _ in range(150):
            every = random_differences(rng, track_numbers, np.array(list(keys), np.int64), horizon_us)
            conn.execute("DELETE FROM conflictdb.difference")
            for part in PairDifferences.of_each(every, horizon_us, 7):
                store.write_differences(conn, scene_id, part)
            within_us = int(rng.choice([horizon_us, rng.integers(0, horizon_us + 1)]))
            starts_us = int(rng.choice([one.times_us[k] for one in tracks for k in (0, 1)]))
            now_us = starts_us + int(rng.integers(-horizon_us - 3, 4)) if rng.random() < 0.7 else None
            own = dict(every.of_each_track())
            expected = [
                delays_of(
                    one.key,
                    keys,
                    own.get(number_of[one.key], every.take(np.empty(0, np.int64))),
                    within_us,
                    Leeway.of(one, within_us, now_us),
                )
                for one in sorted(tracks, key=lambda one: one.key.encode())
            ]
            now = None if now_us is None else np.datetime64(now_us, "us")
            assert known.delays(None, within_us / 1e6, now) == expected
            blocked += sum(bool(one.blocked_by) for one in expected)
    assert blocked > 20


def edit(conn: Conn, rng: np.random.Generator, scene: Scene, spare: list[Track | Area]) -> str:
    """Change something at random, as an editor may; returns what."""
    keys = conn.execute("SELECT key FROM conflictdb.list_objects(%s)", [scene.name]).fetchall()
    key = keys[int(rng.integers(len(keys)))][0]
    what = rng.choice(["add", "add", "delay", "delay", "move", "remove", "close", "rename", "height", "settings"])
    if what == "add":
        one = spare[int(rng.integers(len(spare)))]
        areas, tracks = ([one], []) if isinstance(one, Area) else ([], [one])
        store.replace_scene(conn, store.scene_settings(conn, scene.name) or scene, areas, tracks, merge=True)
    elif what in ("delay", "move"):
        _, _, tracks = store.read_scene(conn, scene.name)
        one = tracks[int(rng.integers(len(tracks)))]
        if what == "delay":
            moved = replace(one, times_us=one.times_us + int(rng.integers(-HOUR_US, HOUR_US)))
        else:
            moved = replace(one, positions_deg=one.positions_deg + rng.uniform(-0.05, 0.05, 2))
        store.replace_scene(conn, store.scene_settings(conn, scene.name) or scene, [], [moved], merge=True)
    elif what == "remove" and len(keys) > 10:
        conn.execute("SELECT conflictdb.remove_object(%s, %s)", [scene.name, key])
    elif what == "close":
        conn.execute("UPDATE conflictdb.area SET active_span = '[2026-01-01, 2027-01-01)' WHERE key = %s", [key])
    elif what == "rename":
        conn.execute("SELECT conflictdb.rename_object(%s, %s, %s)", [scene.name, key, f"{rng.integers(1e9)}"])
    elif what == "height":
        conn.execute("UPDATE conflictdb.track SET floor_m = %s WHERE key = %s", [float(rng.integers(100)), key])
        conn.execute("UPDATE conflictdb.area SET ceiling_m = %s WHERE key = %s", [float(rng.integers(100)), key])
    elif what == "settings":
        name, value = (
            rng.choice(["separation_m", "delays_within_s", "tolerance_m", "time_separation_s"]),
            float(rng.integers(1, 5000)),
        )
        conn.execute(f"SELECT conflictdb.create_scene(%s, p_{name} => %s)".encode(), [scene.name, value])
    conn.commit()
    return str(what)


@pytest.mark.parametrize(
    ("workload", "edits"),
    [(EQUATOR, 35), *(pytest.param(one, 100, marks=pytest.mark.slow) for one in (EQUATOR, GROWING_CIRCLES))],
    ids=lambda one: one.name if isinstance(one, Workload) else str(one),
)
def test_after_random_edits_the_rows_are_those_of_a_full_computation(
    dsn: str, workload: Workload, edits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Edits by a role that may only edit, detected one by one or several together, in batches of any size."""
    rng = np.random.default_rng(7)
    scene, areas, tracks = plain_scene(workload, 5, 18, 24, separation_m=1000.0)
    scene = replace(scene, delays_within_s=WITHIN_S)
    spare = [*areas[10:], *tracks[14:], *(waits_first(f"W{n}", one) for n, one in enumerate(tracks[:3]))]
    areas, tracks = areas[:10], tracks[:14]
    done: list[str] = []
    with connect(dsn) as db:
        known = stored(db, scene, areas, tracks)
        with Colleague(db.connection, dsn) as conn:
            for number in range(edits):
                done.append(edit(conn, rng, scene, spare))
                if rng.uniform() < 0.6:
                    monkeypatch.setattr(difference_rows, "_FIRST_OBJECTS", int(rng.integers(1, 9)))
                    monkeypatch.setattr(pair_differences, "_AXIS", int(rng.integers(1, 9)) * 10_000_000_008)
                    known.detect()
                    found = rows(db.connection, scene.name)
                    settings, areas, tracks = store.read_scene(db.connection, scene.name)
                    assert known.delays() == conflictdb.delays(tracks, areas, settings, None, 7200.0)
                    within_s = settings.delays_within_s
                    assert known.delays(None, within_s) == conflictdb.delays(tracks, areas, settings, None, within_s)
                    if number % 4 == 0:
                        known.detect(full=True)
                        assert rows(db.connection, scene.name) == found
    assert {"add", "delay", "move", "remove", "rename", "settings"} <= set(done)


class Colleague:
    """A session of a role that may only edit, of a protected scene that it may write."""

    def __init__(self, conn: Conn, dsn: str, role: str = "conflictdb_editor", access: str = "write") -> None:
        self.conn, self.user, self.access = conn, f"one_{conn.info.dbname}", access
        self.dsn, self.role = conninfo.make_conninfo(dsn, user=self.user), role

    def __enter__(self) -> Conn:
        name = sql.Identifier(self.user)
        self.conn.execute(sql.SQL("CREATE ROLE {} LOGIN IN ROLE {}").format(name, sql.Identifier(self.role)))
        self.conn.execute("SELECT conflictdb.protect_scenes()")
        if self.access:
            self.conn.execute(
                "SELECT conflictdb.share_scene(name, %s, %s) FROM conflictdb.scene", [self.user, self.access]
            )
        self.conn.commit()
        self.own = store.connect(self.dsn)
        return self.own

    def __exit__(self, *_: object) -> None:
        self.own.close()
        self.conn.rollback()
        self.conn.execute("SELECT conflictdb.protect_scenes(false)")
        self.conn.execute("DELETE FROM conflictdb.scene_share")
        self.conn.execute(sql.SQL("DROP ROLE {}").format(sql.Identifier(self.user)))
        self.conn.commit()


@pytest.fixture
def crossing(dsn: str) -> Iterator[tuple[conflictdb.Database, StoredScene, list[Area], list[Track]]]:
    """Tracks that cross, one that waits, and an area; detected."""
    tracks = [
        track("EAST", [(0.0, 0.0), (0.5, 0.0)], [0, 3600], 100, 100, 50, 50),
        track("NORTH", [(0.25, -0.25), (0.25, 0.25)], [0, 3600], 100, 100, 50, 50),
        waiting("WAITS", 0.25),
    ]
    areas = [area("BAR", box(0.45, -0.01, 0.46, 0.01))]
    with connect(dsn) as db:
        yield db, stored(db, Scene("s", delays_within_s=WITHIN_S), areas, tracks), areas, tracks


Crossing = tuple[conflictdb.Database, StoredScene, list[Area], list[Track]]


def test_pending_marks_are_computed_and_never_looked_up(crossing: Crossing) -> None:
    """Of any object: a new one may meet everything."""
    db, known, areas, tracks = crossing
    found = rows(db.connection, "s")
    late = replace(tracks[1], times_us=tracks[1].times_us + 600_000_000)
    store.replace_scene(db.connection, known.settings(), [], [late], merge=True)
    changed = conflictdb.delays([tracks[0], late, tracks[2]], areas, known.settings(), None, WITHIN_S)
    assert known.delays(None, WITHIN_S) == changed
    assert rows(db.connection, "s") == found
    known.detect()
    assert known.delays(None, WITHIN_S) == changed
    assert rows(db.connection, "s") != found


def test_what_is_not_stored_is_computed(crossing: Crossing) -> None:
    """A longer horizon, waits at a waypoint, margins in metres, unknown tracks."""
    _, known, areas, tracks = crossing
    settings = known.settings()
    assert known.delays("EAST", 2 * WITHIN_S) == conflictdb.delays(tracks, areas, settings, "EAST", 2 * WITHIN_S)
    assert known.delays("WAITS", waypoint=2) == conflictdb.delays(tracks, areas, settings, "WAITS", waypoint=2)
    assert known.delays("EAST", 60.0, clear_within_m=1000.0)[0].clear_by_m == 0.0
    with pytest.raises(InvalidInput, match="is not known"):
        known.delays("nobody", WITHIN_S)


def test_a_worker_looks_up_too(crossing: Crossing, monkeypatch: pytest.MonkeyPatch) -> None:
    """It reads no objects, and says what Python says."""
    db, known, *_ = crossing
    [expected] = known.delays("EAST", WITHIN_S)
    ask = "SELECT conflictdb.request_delays('s', 'EAST', '1 hour')"
    (question,) = db.connection.execute(ask).fetchall()[0]
    db.connection.commit()
    monkeypatch.setattr(store, "read_scene", None)
    probes.answer(db.connection)
    query = "SELECT to_json(d.*) FROM conflictdb.wait_for_delays(%s) d"
    [(found,)] = db.connection.execute(query, [question]).fetchall()
    said = {name: value for name, value in expected.as_json().items() if name[:6] != "clear_"}
    assert datetime.fromisoformat(found.pop("departs_at")) == expected.departs_at
    assert said.pop("departs_at")
    assert found == json.loads(json.dumps(said))  # lists, not tuples


@pytest.mark.parametrize("within_s", [-1.0, float("inf"), float("nan"), 3.2e11])
def test_hostile_horizons_are_refused(crossing: Crossing, within_s: float) -> None:
    """Negative, endless, none, and 10,000 years; by the setting and by a lookup."""
    _, known, *_ = crossing
    with pytest.raises(InvalidInput, match="delays_within_s: must be"):
        known.detect(delays_within_s=within_s)
    assert known.settings().delays_within_s == WITHIN_S
    with pytest.raises(InvalidInput, match="within_s: must be"):
        known.delays("EAST", within_s)


def test_a_failed_detection_leaves_the_old_rows(crossing: Crossing, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the transaction of the conflicts: rows, conflicts and marks stay; the next detection replaces all."""
    db, known, areas, tracks = crossing
    before = rows(db.connection, "s")
    late = replace(tracks[0], times_us=tracks[0].times_us + 600_000_000)
    for few_objects in (-1, 100):
        store.replace_scene(db.connection, known.settings(), [], [late], merge=True)
        for name in ("rows_to_compare", "write_differences", "end_write"):

            def broken(*_: object, **__: object) -> None:
                raise RuntimeError("no more memory")

            with monkeypatch.context() as patch:
                patch.setattr(store, name, broken)
                with pytest.raises(RuntimeError, match="no more memory"):
                    detect(db.connection, "s", few_objects=few_objects)
            assert rows(db.connection, "s") == before
            assert not known.state().is_current
        detect(db.connection, "s", few_objects=few_objects)
        expected = conflictdb.delays([late, *tracks[1:]], areas, known.settings(), None, WITHIN_S)
        assert known.delays(None, WITHIN_S) == expected
        before = rows(db.connection, "s")
        late = replace(late, times_us=late.times_us + 600_000_000)


def test_switched_off_the_rows_are_gone_with_the_next_detection(crossing: Crossing) -> None:
    db, known, *_ = crossing
    assert rows(db.connection, "s")
    run = known.detect(delays_within_s=0.0)
    assert (run.opened, run.changed, run.closed) == (0, 0, 0)
    assert rows(db.connection, "s") == []
    known.detect(delays_within_s=60.0)
    assert rows(db.connection, "s")


def test_a_reader_without_rights_sees_nothing(crossing: Crossing, dsn: str) -> None:
    """Of a protected scene; with them it looks up, and writes nothing. An editor does not write rows either."""
    db, known, *_ = crossing
    expected = known.delays("EAST", WITHIN_S)
    for role, access in (("conflictdb_reader", ""), ("conflictdb_reader", "read"), ("conflictdb_editor", "write")):
        with Colleague(db.connection, dsn, role, access) as conn:
            seen = conn.execute("SELECT count(*) FROM conflictdb.difference").fetchone()
            assert (seen == (0,)) == (not access)
            conn.rollback()
            if access:
                assert StoredScene("s", lambda conn=conn: conn).delays("EAST", WITHIN_S) == expected
            conn.rollback()
            for statement in ("DELETE FROM conflictdb.difference", "UPDATE conflictdb.difference SET track_id = 1"):
                with pytest.raises(psycopg.errors.InsufficientPrivilege):
                    conn.execute(statement.encode())
                conn.rollback()


def test_copies_files_names_and_removal(crossing: Crossing, tmp_path: Path) -> None:
    """A copy and a file have the setting; rows are of a scene, and go with it or with an object."""
    db, known, *_ = crossing
    found = rows(db.connection, "s")
    copy = known.copy("copy")
    assert copy.settings().delays_within_s == WITHIN_S
    assert rows(db.connection, "copy") == []
    copy.detect()
    assert rows(db.connection, "copy") == found
    for name in ("s.geojson", "s.parquet"):
        known.export(tmp_path / name)
        db.load(tmp_path / name, scene="again").detect()
        assert db.scene("again").settings().delays_within_s == WITHIN_S
        assert rows(db.connection, "again") == found
    known.rename("other")
    assert rows(db.connection, "other") == found
    copy.rename_object("EAST", "ZZZ")
    copy.detect()
    assert [row for row in rows(db.connection, "copy") if "ZZZ" in row]
    copy.delete_objects("ZZZ")
    copy.detect()
    assert rows(db.connection, "copy") == [row for row in found if "EAST" not in row]
    copy.delete()
    db.scene("again").delete()
    count = db.connection.execute("SELECT count(*) FROM conflictdb.difference").fetchone()
    assert count == (len(found),)


def test_conflicts_of_spark_bring_differences(crossing: Crossing, monkeypatch: pytest.MonkeyPatch) -> None:
    """Computed elsewhere, conflicts are written back by another routine, which clears marks, too."""
    db, known, areas, tracks = crossing
    conn = db.connection
    late = replace(tracks[0], times_us=tracks[0].times_us + 600_000_000)
    store.replace_scene(conn, known.settings(), [], [late], merge=True)
    states = store.object_states(conn, store.scene_id(conn, "s"))
    conn.commit()
    import_computed.write_back(conn, "s", known.settings(), states, iter(()))
    assert known.state().is_current
    expected = conflictdb.delays([late, *tracks[1:]], areas, known.settings(), None, WITHIN_S)
    assert rows(conn, "s")
    monkeypatch.setattr(store, "read_scene", None)
    assert known.delays(None, WITHIN_S) == expected


def test_memory_bounds_the_batches(dsn: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """However little fits, the rows are the same; no batch has more pieces than fit, but for one of one object."""
    scene, areas, tracks = plain_scene(EQUATOR, 9, 20, 30)
    read: list[tuple[int, int]] = []
    near = store.rows_to_compare

    def counted(conn: Conn, scene_id: int, objects: Any, horizon_us: int) -> Any:
        found = near(conn, scene_id, objects, horizon_us)
        read.append((len(objects), found[1]))
        return found

    with connect(dsn) as db:
        known = stored(db, replace(scene, delays_within_s=WITHIN_S), areas, tracks)
        expected = rows(db.connection, scene.name)
        assert len(expected) > 100
        monkeypatch.setattr(store, "rows_to_compare", counted)
        for pieces in (40, 400):
            read.clear()
            memory = MemoryBudget(pairs=50, pieces=pieces, boxes=10**6)
            with db.connection.transaction():
                db.connection.execute("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ")
                number = store.scene_id(db.connection, scene.name)
                store.cover_all(db.connection, number)
                difference_rows.refresh_differences(db.connection, number, Setup.of(known.settings()), None, memory)
            assert rows(db.connection, scene.name) == expected
            assert max(count for count, _ in read) > 1
            assert len(read) > 10


def test_an_upgrade_adds_the_setting_and_no_row(dsn: str) -> None:
    """From the revision before: scenes store nothing until they are asked to."""
    with connect(dsn) as db:
        stored(db, Scene("s"), [], [waiting("W", 0.1)])
    with psycopg.connect(dsn) as conn:
        conn.execute("DROP TRIGGER scene_before ON conflictdb.scene")
        conn.execute("DROP TABLE conflictdb.difference CASCADE")
        conn.execute("ALTER TABLE conflictdb.scene DROP COLUMN delays_within_s CASCADE")
        conn.execute("UPDATE conflictdb.alembic_version SET version_num = '0003'")
        conn.execute("DROP TABLE conflictdb.probe_reply, conflictdb.probe_request CASCADE")
        first = runpy.run_path(str(next((Path(__file__).parents[2] / "migrations" / "versions").glob("0001_*.py"))))
        for name in ("PROBE_REQUEST", "PROBE_REQUEST_SCENE", "PROBE_REPLY"):
            conn.execute(first[name].encode())
        conn.execute("ALTER TABLE conflictdb.probe_request ADD COLUMN horizon interval, ADD COLUMN delays jsonb")
    assert schema.upgrade(dsn) == schema.head()
    with connect(dsn) as db:
        known = db.scene("s")
        assert known.settings().delays_within_s == 0.0
        known.detect()
        assert rows(db.connection, "s") == []
        known.detect(delays_within_s=60.0)
        assert [one.key for one in known.delays(None, 60.0)] == ["W"]
