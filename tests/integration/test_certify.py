"""Certify stored scenes: one state of the database, only if current, by whoever may read."""

import contextlib
import io
import random
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import psycopg
import pytest
from commands import STRAIT, runner
from psycopg import conninfo, sql

from conflictdb import ConflictDBError, NotCurrent, StoreError, Track, connect, store
from conflictdb.cli.codes import DONE, INPUT_REFUSED, NOT_CURRENT
from conflictdb.client.stored_scene import StoredScene
from conflictdb.formats import check_proof

ACCEPTED, NOT_ALL_CHECKED = 0, 2


def checked(text: str, folder: Path) -> tuple[int, str]:
    """Return the exit status and the report of the checker on a proof."""
    (folder / "proof").write_text(text)
    with contextlib.redirect_stdout(io.StringIO()) as report:
        status = check_proof.main([str(folder / "proof")])
    return status, report.getvalue()


def certified(scene: StoredScene) -> str:
    stream = io.StringIO()
    assert scene.certify(stream)
    return stream.getvalue()


def test_the_command_prints_a_proof(dsn: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """One that the checker accepts, and that is refused until the scene is current."""
    run = runner(dsn, capsys)
    assert run("load", STRAIT).code == DONE
    done = run("admin", "certify", "--scene", "strait")
    assert (done.code, done.out) == (NOT_CURRENT, "")
    assert "not current" in done.err
    assert run("detect", "--scene", "strait").code == DONE
    done = run("admin", "certify", "--scene", "strait")
    assert done.code == DONE
    assert "pairs of pieces apart" in done.err
    status, report = checked(done.out, tmp_path)
    assert status == ACCEPTED, report
    assert "conflicts proven" in report
    with connect(dsn) as db:
        least = {one.key: one.least_later_s for one in db.scene("strait").delays()}
    key = next(key for key, least_s in least.items() if least_s)
    done = run("admin", "certify", "--scene", "strait", "--delays", key)
    assert "1 least delays" in done.err
    status, report = checked(done.out, tmp_path)
    assert (status, "1 least delays proven" in report) == (ACCEPTED, True), report
    done = run("admin", "certify", "--scene", "strait", "--delays", "nobody")
    assert (done.code, done.out) == (INPUT_REFUSED, "")
    with connect(dsn) as db:
        scene = db.scene("strait")
        scene.delete_objects(scene.objects()[0].key)
        with pytest.raises(NotCurrent, match="not current"):
            scene.certify(tmp_path / "none")
        assert not (tmp_path / "none").exists()


def test_a_scene_that_changes_meanwhile_is_certified_as_it_was(
    dsn: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Objects and conflicts are of one state, whatever is written between the two reads."""
    with connect(dsn) as db:
        db.load(STRAIT)
        scene = db.scene("strait")
        scene.detect()
        before, original = certified(scene), store.read_scene

        def read_after_a_change(*given: Any) -> Any:
            with connect(dsn) as other:
                for conflict in other.scene("strait").conflicts()[:3]:
                    with contextlib.suppress(Exception):
                        other.scene("strait").delete_objects(conflict.a_key)
                other.scene("strait").detect()
            return original(*given)

        monkeypatch.setattr(store, "read_scene", read_after_a_change)
        meanwhile = certified(scene)
        monkeypatch.undo()
        after = certified(scene)
    assert meanwhile == before
    assert after != before
    for text in (before, after):
        status, report = checked(text, tmp_path)
        assert status in (ACCEPTED, NOT_ALL_CHECKED), report


def test_each_proof_amid_writers_is_of_one_state(dsn: str, tmp_path: Path) -> None:
    """Sessions write, detect and report positions: a proof is accepted by the checker, or refused as not current."""
    with connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect()
        db.scene("strait").branch("other")
        tracks = store.read_scene(db.connection, "strait")[2]
    halt, errors, made, late = threading.Event(), list[str](), Counter[str](), list[Exception]()

    def write(name: str, seed: int) -> None:
        rng = random.Random(seed)  # noqa: S311 no secret
        try:
            with connect(dsn) as db:
                while not halt.is_set():
                    one = rng.choice(tracks)
                    by_us = 1_000_000 * rng.randrange(-1800, 1800)
                    moved = Track(one.key, one.positions_deg, one.times_us + by_us, one.outline_m)
                    with contextlib.suppress(ConflictDBError):
                        db.scene(name).put(moved)
                        at_us = np.array([int(1e6 * time.time())])
                        with store.transaction(db.connection):
                            store.insert_positions(db.connection, name, [one.key], at_us, one.positions_deg[:1])
                    with contextlib.suppress(ConflictDBError):
                        db.scene(name).detect()
                    halt.wait(0.1)
        except Exception as error:
            late.append(error)

    writers = [threading.Thread(target=write, args=given) for given in (("strait", 1), ("strait", 2), ("other", 3))]
    for one in writers:
        one.start()
    try:
        with connect(dsn) as db:
            while made["accepted"] < 6 and made.total() < 400:
                name = ("strait", "other")[made.total() % 2]
                try:
                    text = certified(db.scene(name))
                except NotCurrent:
                    made["not current"] += 1
                    continue
                status, report = checked(text, tmp_path)
                made["accepted"] += 1
                errors += [] if status in (ACCEPTED, NOT_ALL_CHECKED) else [f"{name}: {report}"]
    finally:
        halt.set()
        for one in writers:
            one.join()
    assert not errors + late
    assert made["accepted"], made
    with connect(dsn) as db:
        assert db.connection.execute("SELECT count(*) FROM conflictdb.position").fetchone()[0]


def test_an_open_transaction_is_refused(dsn: str) -> None:
    """It may see several states."""
    with connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect()
        with db.connection.transaction(), pytest.raises(StoreError, match="transaction"):
            db.scene("strait").certify(io.StringIO())


def test_whoever_may_read_a_scene_may_certify_it(dsn: str, tmp_path: Path) -> None:
    with connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect()
        name = f"certifies_in_{conninfo.conninfo_to_dict(dsn)['dbname']}"
        role = sql.Identifier(name)
        with psycopg.connect(dsn, autocommit=True) as conn:
            conn.execute(sql.SQL("CREATE ROLE {} IN ROLE conflictdb_reader").format(role))
        as_reader = conninfo.make_conninfo(dsn, options=f"-c role={name}")
        try:
            with connect(as_reader) as reader:
                status, report = checked(certified(reader.scene("strait")), tmp_path)
                assert status == ACCEPTED, report
            db.protect_scenes()
            with connect(as_reader) as reader, pytest.raises(Exception, match="not in this database"):
                reader.scene("strait").certify(io.StringIO())
        finally:
            db.protect_scenes(on=False)
            with psycopg.connect(dsn, autocommit=True) as conn:
                conn.execute(sql.SQL("DROP ROLE {}").format(role))
