"""`connect` and `Database`: every kind of target, the caller's responsibilities, and closing."""

import json
import math
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import psycopg
import pytest
import shapely
import sqlalchemy
from commands import STRAIT
from draws import draws
from full_plans import lost
from mixed_scenes import odd_scene
from odd_values import STORABLE
from psycopg.pq import TransactionStatus
from psycopg.rows import dict_row

import conflictdb
from conflictdb import Area, InvalidInput, Scene, SchemaMissing, ServerError, StoreError, Track
from conflictdb.formats.scene_file import scene_text
from conflictdb.model.results import Verdict
from conflictdb.store import LoadCounts, replace_scene
from conflictdb.store.listing import decode_periods


def test_a_dsn_is_opened_and_closed(dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        assert db.load(STRAIT).name == "strait"
        run = db.scene("strait").detect(tolerance_m=2.0)
        assert (run.conflicts, run.opened, run.closed, run.unresolved) == (7, 7, 0, 0)
        conflicts = db.scene("strait").conflicts()
        assert {conflict.scene for conflict in conflicts} == {"strait"}
        assert [scene.scene.tolerance_m for scene in db.scenes()] == [2.0]
    assert db.connection.closed
    db.close()


def test_a_second_detection_without_changes_changes_nothing(dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect()
        before = db.scene("strait").conflicts()
        run = db.scene("strait").detect()
        assert (run.candidate_pairs, run.opened, run.changed, run.closed, run.conflicts) == (0, 0, 0, 0, 7)
        assert db.scene("strait").conflicts() == before


def test_what_became_of_conflicts_and_what_was_known(dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect()
        then = db.scene("strait").conflicts()
        known_at = datetime.now(UTC)
        with db.connection.transaction():
            db.connection.execute("SELECT conflictdb.remove_object('strait', 'DIVING')")
        run = db.scene("strait").detect()
        known = db.scene("strait").conflicts_known_at(known_at)
        columns = ("a_key", "b_key", "a_kind", "b_kind", "periods", "verdict", "method", "time_error_s", "closest_at")
        for name in (*columns, "closest_m", "closest_error_m", "run_id", "found_at", "conflict_id", "opened_at"):
            assert [getattr(one, name) for one in known] == [getattr(one, name) for one in then]
        with pytest.raises(InvalidInput, match="is before the first detection of the scene"):
            db.scene("strait").conflicts_known_at(known_at - timedelta(days=1))
        opened, closed = db.scene("strait").conflict_events("FERRY", "DIVING")
        assert (opened.kind, closed.kind, closed.run_id) == ("opened", "closed", run.run_id)
        assert (opened.conflict_id, opened.periods) == (closed.conflict_id, closed.periods)
        assert opened.closed_at is None
        assert opened.at == closed.opened_at < known_at < closed.at == closed.closed_at
        assert len(db.scene("strait").conflict_events()) == len(then) + run.closed
        assert len(db.scene("strait").conflict_events(after=opened.event, most=3)) == 3
        number = db.scene("strait").acknowledge("FERRY", "FIRING", "agreed", datetime.now(UTC) + timedelta(hours=1))
        assert number == db.scene("strait").conflict_events("FIRING", "FERRY")[0].conflict_id
        for rows in (db.scene("strait").conflicts(), db.scene("strait").conflicts_known_at(datetime.now(UTC))):
            noted = next(one for one in rows if one.conflict_id == number)
            assert (noted.acknowledged_by, noted.acknowledged_for) == (db.connection.info.user, "agreed")
            assert noted.acknowledged_at
            assert noted.acknowledged_until
            assert noted.acknowledged_until - noted.acknowledged_at > timedelta(minutes=59)
            assert [one.acknowledged_by for one in rows if one is not noted] == [None] * (len(rows) - 1)
        assert db.scene("strait").unacknowledge("FIRING", "FERRY")
        assert not db.scene("strait").unacknowledge("FIRING", "FERRY")
        with pytest.raises(InvalidInput, match="between 'FERRY' and 'DIVING' is not known"):
            db.scene("strait").acknowledge("FERRY", "DIVING", "agreed")


def test_a_connection_of_the_caller_stays_open(dsn: str) -> None:
    with psycopg.connect(dsn, row_factory=dict_row, options="-c timezone=Asia/Tokyo") as connection:
        with conflictdb.connect(connection) as db:
            db.load(STRAIT)
            db.scene("strait").detect()
            first = db.scene("strait").conflicts()[0].first_contact
            assert first is not None
            assert first.tzinfo is UTC
        assert not connection.closed
        assert connection.execute("SELECT count(*) AS n FROM conflictdb.conflicts").fetchone() == {"n": 7}


def test_reading_and_loading_take_part_in_the_callers_transaction(dsn: str) -> None:
    with psycopg.connect(dsn) as connection, conflictdb.connect(connection) as db:
        connection.execute("SELECT 1")
        db.load(STRAIT)
        assert len(db.scenes()) == 1
        with pytest.raises(StoreError, match="without an open transaction"):
            db.scene("strait").detect()
        connection.rollback()
        assert db.scenes() == []


def test_a_connection_in_autocommit_will_do(dsn: str) -> None:
    with psycopg.connect(dsn, autocommit=True) as connection, conflictdb.connect(connection) as db:
        db.load(STRAIT)
        assert db.scene("strait").detect().conflicts == 7
        assert connection.autocommit


def test_an_engine_lends_a_connection(dsn: str) -> None:
    engine = sqlalchemy.create_engine(
        "postgresql+psycopg://", creator=lambda: psycopg.connect(dsn), pool_size=1, max_overflow=0, pool_timeout=5
    )
    try:
        for _ in range(2):
            with conflictdb.connect(engine) as db:
                db.load(STRAIT)
                assert db.scene("strait").detect().conflicts == 7
        with engine.connect() as connection:
            assert connection.execute(sqlalchemy.text("SELECT count(*) FROM conflictdb.conflicts")).scalar() == 7
    finally:
        engine.dispose()


@pytest.mark.parametrize("target", [5, sqlalchemy.create_engine("sqlite://")])
def test_other_targets_are_refused(target: Any) -> None:
    with pytest.raises(InvalidInput, match="psycopg"):
        conflictdb.connect(target)


def test_a_users_database_is_not_changed_without_being_asked(empty_dsn: str) -> None:
    with pytest.raises(SchemaMissing):
        conflictdb.connect(empty_dsn)
    with psycopg.connect(empty_dsn) as connection:
        assert connection.execute("SELECT to_regnamespace('conflictdb')").fetchone() == (None,)
        connection.rollback()
        with pytest.raises(SchemaMissing):
            conflictdb.connect(connection)
    with conflictdb.connect(empty_dsn, create=True) as db:
        assert db.scenes() == []


def test_a_server_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ServerError, match="cannot connect"):
        conflictdb.connect(f"host={tmp_path}")


def test_the_embedded_database_is_there_without_anything(dsn: str) -> None:
    """CONFLICTDB_HOME is a directory of the tests."""
    said: list[str] = []
    with conflictdb.connect(say=said.append) as db:
        db.load(STRAIT, "embedded")
        assert db.scene("embedded").detect().conflicts == 7
    with conflictdb.connect() as db:
        assert [scene.scene.name for scene in db.scenes()] == ["embedded"]
    said.clear()
    with conflictdb.connect(), conflictdb.connect(say=said.append):  # announced only when it starts
        assert said == []


def test_unknown_scenes_and_naive_instants_are_refused(dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        nowhere = db.scene("nowhere")
        for call in (nowhere.conflicts, nowhere.detect, nowhere.text, nowhere.settings):
            with pytest.raises(InvalidInput, match="'nowhere'"):
                call()
        db.load(STRAIT)
        with pytest.raises(InvalidInput, match="offset"):
            db.scene("strait").conflicts(datetime(2026, 6, 1))
        with pytest.raises(InvalidInput, match="method: must be one of"):
            db.scene("strait").detect(method="guess")
        with pytest.warns(conflictdb.IncompleteWarning):
            assert len(db.scene("strait").conflicts()) == 0


def test_what_is_no_instant_duration_or_count_is_refused_before_anything_is_changed(dsn: str) -> None:
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        anything: Any = db
        for at in ("2026-06-01T09:10:00Z", date(2026, 6, 1), 1_780_000_000, 10**30, 9.5):
            with pytest.raises(InvalidInput, match=r"^conflicts: at: "):
                anything.scene("strait").conflicts(at)
        for timeout_s in (-1, float("nan"), float("inf"), 1e12, "1s", timedelta(seconds=1), True):
            with pytest.raises(InvalidInput, match=r"^wait_until_current: timeout_s: must be a number of seconds"):
                anything.scene("strait").wait_until_current(timeout_s)
            with pytest.raises(InvalidInput, match=r"^detect: lock_timeout_s: must be a number of seconds"):
                anything.scene("strait").detect(tolerance_m=2.0, lock_timeout_s=timeout_s)
        for jobs in (0, -1, "2", 1.5):
            with pytest.raises(InvalidInput, match=r"^detect: jobs: must be a whole number"):
                anything.scene("strait").detect(tolerance_m=2.0, jobs=jobs)
        [state] = db.scenes()
        assert state.scene.tolerance_m == 1.0
        assert state.run_id is None


def test_an_instant_may_be_any_that_objects_take(dsn: str) -> None:
    nine = datetime(2026, 6, 1, 9, 10, tzinfo=UTC)
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect()
        wanted = db.scene("strait").conflicts(nine)
        assert wanted
        for at in (np.datetime64("2026-06-01T09:10"), int(nine.timestamp()) * 1_000_000):
            assert db.scene("strait").conflicts(at) == wanted


def test_a_file_that_cannot_be_written_is_named(dsn: str, tmp_path: Path) -> None:
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        with pytest.raises(FileNotFoundError) as failed:
            db.scene("strait").export(tmp_path / "nowhere" / "x.geojson")
        assert failed.value.filename == str(tmp_path / "nowhere" / "x.geojson")


def test_conflicts_can_be_read_as_they_are_asked_for(dsn: str, tmp_path: Path) -> None:
    """The same rows, a cursor's batch at a time; closing a stream early closes its cursor."""
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect(nearest_m=5_000.0)
        listed = db.scene("strait").conflicts(with_region=True)
        with patch("conflictdb.store.connection._ROWS_AT_ONCE", 2):
            assert list(db.scene("strait").stream_conflicts(with_region=True)) == listed
            stream = db.scene("strait").stream_conflicts(with_region=True)
            assert (stream.is_current, next(stream)) == (True, listed[0])
            assert db.connection.execute("SELECT count(*) FROM pg_cursors").fetchall() == [(1,)]
            stream.close()
            assert db.connection.info.transaction_status == TransactionStatus.IDLE
        near = [one for one in db.scene("strait").approaches() if one.verdict is Verdict.NEAR]
        assert list(db.scene("strait").stream_approaches(only_near=True)) == near
        for suffix in (".json", ".csv", ".geojson"):
            conflictdb.write(listed, tmp_path / f"listed{suffix}")
            conflictdb.write(db.scene("strait").stream_conflicts(with_region=True), tmp_path / f"streamed{suffix}")
            assert (tmp_path / f"streamed{suffix}").read_bytes() == (tmp_path / f"listed{suffix}").read_bytes()
        with pytest.raises(InvalidInput, match="'elsewhere'"):
            db.scene("elsewhere").stream_conflicts()


@pytest.mark.parametrize(
    "periods",
    [
        "{}",
        "{(,)}",
        "{(,2026-03-01 06:00:00Z],[2026-03-02 06:00:00.000001Z,)}",
        "{[2026-03-01 06:00:00Z,2026-03-01 06:00:00Z]}",
        "{[0001-01-01 00:00:00Z,1969-12-31 23:59:59.999999Z],[2026-03-01 06:00Z,9999-12-31 23:59:59.999999Z]}",
    ],
)
def test_periods_are_read_as_the_server_has_them(conn: psycopg.Connection[Any], periods: str) -> None:
    wanted = conn.execute("SELECT lower(r), upper(r) FROM unnest(%s::tstzmultirange) r ORDER BY r", [periods])
    (sent,) = conn.execute("SELECT multirange_send(%s::tstzmultirange)", [periods]).fetchone() or ()
    assert list(decode_periods(sent)) == wanted.fetchall()


# Columns that only a database fills; GeoJSON also states whether its scenes are complete.
OF_DATABASES = {"is_current": None, "scene_is_current": None, "run_id": None, "found_at": None}
OF_CONFLICTS = {**OF_DATABASES, "region": None, "conflict_id": None}


def test_solving_in_memory_gives_what_the_database_gives(dsn: str, tmp_path: Path) -> None:
    """The same conflicts and closest approaches, and the same text, except columns that only a database fills."""
    _, areas, tracks, _ = conflictdb.read(STRAIT)
    with conflictdb.connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect(nearest_m=5_000.0)
        scene = db.scene("strait").settings()
        found, near = db.scene("strait").conflicts(with_region=True), db.scene("strait").approaches()
    solved = sorted(conflictdb.solve(tracks, areas, scene), key=lambda one: (one.a_key, one.b_key))
    conflicts = [one for one in solved if one.verdict is not Verdict.NEAR]
    assert 0 < len(conflicts) < len(solved)
    approaches = [one.approach for one in solved if one.approach]
    stored = sorted((replace(one, **OF_CONFLICTS) for one in found), key=lambda one: (one.a_key, one.b_key))
    stored_near = sorted((replace(one, **OF_DATABASES) for one in near), key=lambda one: (one.a_key, one.b_key))
    assert conflicts == stored
    assert approaches == stored_near
    for suffix in (".json", ".csv", ".geojson"):
        for mine, theirs in ((conflicts, stored), (approaches, stored_near)):
            texts = [tmp_path / f"{name}{suffix}" for name in ("memory", "database")]
            for rows, path in zip((mine, theirs), texts, strict=True):
                conflictdb.write(rows, path)
            assert texts[0].read_bytes() == texts[1].read_bytes()
    conflictdb.write(found, tmp_path / "all.geojson")
    written = json.loads((tmp_path / "all.geojson").read_text())
    assert [(one["scene"], one["is_current"]) for one in written["scenes"]] == [("strait", True)]


@draws("scenes", 12, 200)
def test_any_scene_comes_back_from_the_database_as_it_was(dsn: str, tmp_path: Path, scenes: int) -> None:
    path = tmp_path / "scene.geojson"
    for seed in range(scenes):
        scene, areas, tracks = odd_scene(seed, STORABLE)
        path.write_text("".join(scene_text(scene, areas, tracks)))
        with conflictdb.connect(dsn) as db:
            loaded = db.load_files([path], replace=True, max_speed_kn=math.inf)[0]  # random ones have no reason
            assert loaded.scene == scene.name, seed
            db.scene(loaded.scene).export(path)
            again = db.load_files([path], replace=True, max_speed_kn=math.inf)[0].counts
            assert again == LoadCounts(0, 0, 0, len(areas) + len(tracks)), seed
        back = conflictdb.read(path, max_speed_kn=math.inf)
        assert back.scene == scene, seed
        for one, other in zip([*areas, *tracks], [*back.areas, *back.tracks], strict=True):
            assert lost(one, other) == [], seed


def test_objects_of_1970_come_back_from_the_database(dsn: str, tmp_path: Path) -> None:
    """Their instants are not taken for seconds of our time."""
    early = datetime(1970, 1, 1, 0, 30, tzinfo=UTC)
    area = Area("A", shapely.box(9.0, 57.0, 10.0, 58.0), start_us=early)
    track = Track("T", [[9.0, 57.0], [9.1, 57.0]], [early, early + timedelta(minutes=20)], [[0.0, 0.0]])
    with conflictdb.connect(dsn) as db:
        replace_scene(db.connection, Scene("early"), [area], [track], merge=False)
        db.scene("early").export(tmp_path / "early.geojson")
        assert "1970-01-01T00:50:00Z" in (tmp_path / "early.geojson").read_text()
