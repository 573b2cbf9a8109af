"""A run of tests that is killed leaves nothing for long: the next run that ends removes it."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
from databases import begin, clean_up, run_home
from patience import until

SUPPORT: Final = Path(__file__).resolve().parents[1] / "support"
# A run that has begun a program, as tests do.
RUN: Final = """
import os, subprocess, sys, time
from databases import begin, run_home
begin("killed")
os.environ["CONFLICTDB_HOME"] = str(run_home("killed"))
program = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], stdout=subprocess.DEVNULL)
print(program.pid, flush=True)
time.sleep(600)
"""


@pytest.fixture(autouse=True)
def _own_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CONFLICTDB_TEST_DIRECTORY", str(tmp_path))
    monkeypatch.delenv("CONFLICTDB_TEST_DSN", raising=False)


@pytest.fixture
def running() -> Iterator["tuple[subprocess.Popen[str], int]"]:
    """A run, and the number of the program that it has begun."""
    for name in ("killed", "killed-state"):
        run_home(name).mkdir()
    env = {**os.environ, "PYTHONPATH": str(SUPPORT)}
    with subprocess.Popen([sys.executable, "-c", RUN], stdout=subprocess.PIPE, text=True, env=env) as run:
        try:
            assert run.stdout is not None
            yield run, int(run.stdout.readline())
        finally:
            run.kill()
            clean_up("killed")


def _is_there(number: int) -> bool:
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"  # nobody may have waited for it


def test_leftovers_of_a_killed_run_go_with_the_next(
    tmp_path: Path, running: "tuple[subprocess.Popen[str], int]"
) -> None:
    run, program = running
    before = set(tmp_path.iterdir())
    begin("next")
    clean_up("next")
    assert set(tmp_path.iterdir()) == before, "it is running"
    assert _is_there(program)
    run.kill()
    run.wait()
    assert _is_there(program)
    begin("last")
    clean_up("last")
    assert list(tmp_path.iterdir()) == []
    until(lambda: not _is_there(program), what="the program of a killed run goes on")


def test_programs_that_a_killed_worker_leaves_end_with_the_run(tmp_path: Path) -> None:
    begin("own")
    env = {**os.environ, "CONFLICTDB_HOME": str(run_home("own"))}
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], env=env) as program:
        try:
            until(lambda: f"={run_home('own')}".encode() in Path(f"/proc/{program.pid}/environ").read_bytes())
            clean_up("own")
            until(lambda: program.poll() is not None, what="the program goes on")
        finally:
            program.kill()
    assert list(tmp_path.iterdir()) == []
