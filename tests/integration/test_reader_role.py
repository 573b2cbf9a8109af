"""A user with no more than conflictdb_reader: reading works, writing ends with one message."""

from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest
from commands import STRAIT, runner
from psycopg import conninfo, sql

from conflictdb import connect
from conflictdb.cli.codes import DONE, FAILED


@pytest.fixture
def reader_dsn(dsn: str) -> Iterator[str]:
    """Connection string of a database with a detected scene, as a user who may read."""
    with connect(dsn) as db:
        db.load(STRAIT)
        db.scene("strait").detect()
    name = f"reader_of_{conninfo.conninfo_to_dict(dsn)['dbname']}"
    user = sql.Identifier(name)
    with psycopg.connect(dsn, autocommit=True) as conn:
        conn.execute(sql.SQL("CREATE ROLE {} IN ROLE conflictdb_reader").format(user))
        yield conninfo.make_conninfo(dsn, options=f"-c role={name}")
        conn.execute(sql.SQL("DROP ROLE {}").format(user))


def test_reading_works(reader_dsn: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    run = runner(reader_dsn, capsys)
    for words in (
        ["conflicts", "--scene", "strait", "--format", "json"],
        ["conflicts", "--scene", "strait", "--format", "geojson"],
        ["approaches", "--scene", "strait"],
        ["advise", "--scene", "strait"],
        ["export", "--scene", "strait", tmp_path / "strait.geojson"],
        ["admin", "attachments"],
        ["status"],
        ["admin", "init"],  # there is nothing to do
        ["admin", "upgrade"],
    ):
        done = run(*words)
        assert (done.code, done.err) == (DONE, ""), (words, done.err)


def test_writing_is_refused(reader_dsn: str, capsys: pytest.CaptureFixture[str]) -> None:
    run = runner(reader_dsn, capsys)
    table = ["--scene", "strait", "--table", "conflictdb.area"]
    for words in (
        ["detect", "--scene", "strait"],
        ["detect", "--scene", "strait", "--full"],
        ["load", STRAIT],
        ["demo"],
        ["admin", "attach", "area", *table, "--map", "key=key,footprint=footprint"],
        ["admin", "detach", *table],
    ):
        done = run(*words)
        assert done.code == FAILED, words
        assert "permission denied" in done.err
        assert len([line for line in done.err.splitlines() if line.startswith("conflictdb: ")]) == 1, done.err


@pytest.mark.parametrize("words", [["worker"], ["worker", "--once"]], ids=" ".join)
def test_a_worker_that_may_not_detect_says_so_at_once(
    reader_dsn: str, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    """It does not wait for the first change, nor retry."""
    done = runner(reader_dsn, capsys)(*words)
    assert (done.code, done.out) == (FAILED, "")
    assert "let an administrator run: GRANT conflictdb_worker TO reader_of_" in done.err
    assert len([line for line in done.err.splitlines() if "administrator" in line]) == 1
