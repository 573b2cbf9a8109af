"""./run: what it says when it cannot make its environment, and that it leaves a complete one alone."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def run(path: Path, venv: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run ./run with nothing on PATH but what is in `path`."""
    environ = {"PATH": str(path), "CONFLICTDB_VENV": str(venv)}
    return subprocess.run(
        [ROOT / "run", *arguments], env=environ, capture_output=True, text=True, timeout=60, check=False
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a PATH with the system's programs that ./run needs, and without any Python."""
    for name in ("dirname", "cat", "cmp", "head", "rm", "echo", "sh"):
        (tmp_path / "bin").mkdir(exist_ok=True)
        (tmp_path / "bin" / name).symlink_to(str(shutil.which(name)))
    return tmp_path / "bin"


def program(path: Path, script: str) -> None:
    """Write an executable shell script."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


@pytest.mark.parametrize("found", ["Python 3.9.2", None])
def test_old_python_is_said(tmp_path: Path, path: Path, found: str | None) -> None:
    """A Python that is too old, or none, ends in one line that says what is needed and how to name another."""
    if found:
        program(path / "python3", f'[ "$1" = --version ] && echo {found}; exit 1')
    answer = run(path, tmp_path / "venv", "demo")
    assert answer.returncode == 1
    assert "needs Python 3.11 or newer" in answer.stderr
    assert (found or "none") in answer.stderr
    assert "PYTHON=" in answer.stderr


def test_python_without_venv_names_the_package(tmp_path: Path, path: Path) -> None:
    """Debian's Python without its venv package gets the one command that brings it, and nothing half-made stays."""
    program(path / "python3", 'case "$2" in *ensurepip*) exit 1 ;; esac')
    answer = run(path, tmp_path / "venv", "demo")
    assert answer.returncode == 1
    assert "sudo apt-get install python3-venv" in answer.stderr
    assert not (tmp_path / "venv").exists()


def test_complete_environment_is_used_as_it_is(tmp_path: Path, path: Path) -> None:
    """Nothing is made, nothing is said, and the command gets its arguments unchanged."""
    venv = tmp_path / "venv"
    program(venv / "bin/python", "exit 9")
    program(venv / "bin/conflictdb", 'for a in "$@"; do echo "<$a>"; done; exit 7')
    pins = (ROOT / "requirements.txt").read_text() + (ROOT / "pyproject.toml").read_text()
    (venv / "made-from").write_text(f"{venv}\n{pins}")
    answer = run(path, venv, "detect", "two words", "")
    assert (answer.returncode, answer.stdout, answer.stderr) == (7, "<detect>\n<two words>\n<>\n", "")


def test_pins_carry_hashes_and_no_addresses() -> None:
    """Every requirement has a version and hashes; where packages come from is the machine's business."""
    lines = (ROOT / "requirements.txt").read_text().splitlines()
    pinned = [line for line in lines if line and not line.startswith(("#", " "))]
    assert all("==" in line and line.endswith("\\") for line in pinned)
    assert all(line.lstrip().startswith("--hash=sha256:") for line in lines if line.startswith(" "))
    assert not any("://" in line for line in lines)
    assert os.access(ROOT / "run", os.X_OK)
